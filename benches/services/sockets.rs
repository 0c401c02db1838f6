//! The same way over bare blocking sockets: asker, relay and mirror, each on a thread of its own.

use crate::{PAYLOAD_BYTES, note};
use sk_benches::Sheet;
use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread;
use std::time::Instant;

/// Two ends of a connection.
fn pair() -> io::Result<(TcpStream, TcpStream)> {
    let listener = TcpListener::bind("127.0.0.1:0")?;
    let near = TcpStream::connect(listener.local_addr()?)?;
    let (far, _) = listener.accept()?;
    for end in [&near, &far] {
        end.set_nodelay(true)?;
    }
    Ok((near, far))
}

/// Hands on what comes from one to the other, and its answer back, until the first one closes.
fn relay(mut from: TcpStream, mut to: TcpStream) -> io::Result<()> {
    let mut room = [0; PAYLOAD_BYTES];
    while from.read_exact(&mut room).is_ok() {
        to.write_all(&room)?;
        to.read_exact(&mut room)?;
        from.write_all(&room)?;
    }
    Ok(())
}

fn reflect(mut from: TcpStream) -> io::Result<()> {
    let mut room = [0; PAYLOAD_BYTES];
    while from.read_exact(&mut room).is_ok() {
        from.write_all(&room)?;
    }
    Ok(())
}

pub(crate) fn measure(sheet: &mut Sheet, calls: usize) -> io::Result<()> {
    let (mut asker, hub) = pair()?;
    let (onward, owner) = pair()?;
    let threads = [thread::spawn(move || relay(hub, onward)), thread::spawn(move || reflect(owner))];
    let mut room = [0; PAYLOAD_BYTES];
    for _ in 0..calls {
        let asked = Instant::now();
        asker.write_all(&room)?;
        asker.read_exact(&mut room)?;
        note(sheet, u64::try_from(asked.elapsed().as_nanos()).unwrap_or(u64::MAX));
    }
    drop(asker);
    for thread in threads {
        thread.join().map_err(|_| io::Error::other("a relay failed"))??;
    }
    Ok(())
}
