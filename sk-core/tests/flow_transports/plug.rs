//! A cable between a satellite and its hub that can be cut after any byte, or hold what it carries.

use super::socket::{Listening, Socket};
use sk_core::flow::HubAddress;
use std::io::{Read, Write};
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::thread;

/// What a cable holds back.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Hold {
    Nothing,
    /// What the hub says.
    FromHub,
    /// Everything.
    Both,
}

struct Shared {
    /// After so many bytes towards the hub the connection is cut.
    cut_after: AtomicUsize,
    carried_to_hub: AtomicUsize,
    hold: Mutex<Hold>,
    changed: Condvar,
}

#[derive(Clone)]
pub struct Cable {
    shared: Arc<Shared>,
    /// Where a satellite plugs in.
    pub address: HubAddress,
}

impl Cable {
    pub fn to(hub: &HubAddress, path: PathBuf) -> Cable {
        let (listening, address) = Listening::like(hub, path);
        let shared = Arc::new(Shared {
            cut_after: AtomicUsize::new(usize::MAX),
            carried_to_hub: AtomicUsize::new(0),
            hold: Mutex::new(Hold::Nothing),
            changed: Condvar::new(),
        });
        let (carrying, hub) = (shared.clone(), hub.clone());
        // It ends with the process: nothing else ends its wait for one more connection.
        thread::spawn(move || {
            while let Ok(near) = listening.accept() {
                let Ok(far) = Socket::connect(&hub) else {
                    near.end();
                    continue;
                };
                carrying.carried_to_hub.store(0, Ordering::SeqCst);
                let (near_too, far_too, back) = (near.clone(), far.clone(), carrying.clone());
                thread::spawn(move || carry(far_too, near_too, |_| Some(usize::MAX), &back, Hold::FromHub));
                let there = carrying.clone();
                thread::spawn(move || {
                    let allowance = |wanted: usize| there.allow(wanted);
                    carry(near, far, allowance, &there, Hold::Both);
                });
            }
        });
        Cable { shared, address }
    }

    /// Cuts each connection from now on after so many bytes towards the hub.
    pub fn cut_after(&self, bytes: usize) {
        self.shared.cut_after.store(bytes, Ordering::SeqCst);
    }

    /// How many bytes the newest connection has carried towards the hub.
    pub fn carried_to_hub(&self) -> usize {
        self.shared.carried_to_hub.load(Ordering::SeqCst)
    }

    pub fn hold(&self, hold: Hold) {
        *self.shared.hold.lock().expect("no holder panics") = hold;
        self.shared.changed.notify_all();
    }
}

impl Shared {
    /// How many of these bytes may go on; `None` cuts.
    fn allow(&self, wanted: usize) -> Option<usize> {
        let (carried, most) =
            (self.carried_to_hub.load(Ordering::SeqCst), self.cut_after.load(Ordering::SeqCst));
        let allowed = wanted.min(most.saturating_sub(carried));
        self.carried_to_hub.fetch_add(allowed, Ordering::SeqCst);
        (allowed > 0).then_some(allowed)
    }

    fn wait_while_held(&self, from: Hold) {
        let mut hold = self.hold.lock().expect("no holder panics");
        while *hold == Hold::Both || *hold == from {
            hold = self.changed.wait(hold).expect("no holder panics");
        }
    }
}

fn carry(
    mut from: Socket,
    mut to: Socket,
    allow: impl Fn(usize) -> Option<usize>,
    shared: &Shared,
    held_by: Hold,
) {
    let mut room = vec![0; 64 * 1024];
    loop {
        shared.wait_while_held(held_by);
        let Ok(count @ 1..) = from.read(&mut room) else { break };
        shared.wait_while_held(held_by);
        let Some(allowed) = allow(count) else { break };
        if to.write_all(&room[..allowed.min(count)]).is_err() || allowed < count {
            break;
        }
    }
    // A cable that holds everything does not carry the news of an end either.
    shared.wait_while_held(held_by);
    from.end();
    to.end();
}
