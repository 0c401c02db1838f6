//! A serial cable between two pseudo-terminals that can be held, and be given noise.

use nix::pty::openpty;
use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};
use nix::unistd::ttyname;
use sk_core::flow::HubAddress;
use sk_core::world::SimulatedRng;
use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::thread;

#[derive(Default)]
struct Shared {
    held: Mutex<bool>,
    changed: Condvar,
    /// After about so many bytes one is spoilt; 0 for never.
    spoil_every: AtomicUsize,
    spoilt: AtomicU64,
}

pub struct Wire {
    shared: Arc<Shared>,
    ends: [Pty; 2],
}

struct Pty {
    master: File,
    /// Kept open, so that the master is not hung up while nobody has the port.
    _slave: OwnedFd,
    address: HubAddress,
}

impl Pty {
    fn new() -> Pty {
        let pair = openpty(None, None).expect("the system has pseudo-terminals");
        let mut settings = tcgetattr(&pair.slave).expect("it is a terminal");
        cfmakeraw(&mut settings);
        tcsetattr(&pair.slave, SetArg::TCSANOW, &settings).expect("it is a terminal");
        let path = ttyname(&pair.slave).expect("it has a name");
        let address = HubAddress::Tty { path, baud: 4_000_000 };
        Pty { master: File::from(pair.master), _slave: pair.slave, address }
    }

    fn master(&self) -> File {
        self.master.try_clone().expect("descriptors are left")
    }
}

impl Wire {
    pub fn new() -> Wire {
        let shared = Arc::new(Shared::default());
        let ends = [Pty::new(), Pty::new()];
        for (from, to) in [(0, 1), (1, 0)] {
            let (from, to, shared) = (ends[from].master(), ends[to].master(), shared.clone());
            // It ends with the process, or when nobody has the other side of either terminal.
            thread::spawn(move || carry(from, to, &shared));
        }
        Wire { shared, ends }
    }

    pub fn hub(&self) -> HubAddress {
        self.ends[0].address.clone()
    }

    pub fn satellite(&self) -> HubAddress {
        self.ends[1].address.clone()
    }

    pub fn hold(&self, held: bool) {
        *self.shared.held.lock().expect("no holder panics") = held;
        self.shared.changed.notify_all();
    }

    pub fn spoil_every(&self, bytes: usize) {
        self.shared.spoil_every.store(bytes, Ordering::SeqCst);
    }

    pub fn spoilt(&self) -> u64 {
        self.shared.spoilt.load(Ordering::SeqCst)
    }

    /// Both sides receive this from nowhere.
    pub fn noise(&self, bytes: &[u8]) {
        for end in &self.ends {
            end.master().write_all(bytes).expect("the terminal has room");
        }
    }
}

fn carry(mut from: File, mut to: File, shared: &Shared) {
    let (mut room, mut since_spoilt) = ([0; 1024], 0);
    // Noise that came at regular intervals could meet the same envelope again and again.
    let mut irregular = SimulatedRng::new(1, 0);
    let mut next = 0;
    while let Ok(count @ 1..) = from.read(&mut room) {
        let mut held = shared.held.lock().expect("no holder panics");
        while *held {
            held = shared.changed.wait(held).expect("no holder panics");
        }
        drop(held);
        since_spoilt += count;
        let every = shared.spoil_every.load(Ordering::SeqCst);
        if every > 0 && since_spoilt >= next {
            since_spoilt = 0;
            next = every / 2 + irregular.below(every as u64) as usize;
            room[count / 2] ^= 0x10;
            shared.spoilt.fetch_add(1, Ordering::SeqCst);
        }
        if to.write_all(&room[..count]).is_err() {
            return;
        }
    }
}
