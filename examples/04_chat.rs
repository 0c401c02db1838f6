//! A chat server: one object per connection, gone when its peer leaves; what one says all others hear.
use bytes::{Bytes, BytesMut};
use sk_core::prelude::*;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};

struct Peer {
    socket: Handle<Socket>,
    said: Signal<(Handle<Peer>, Bytes)>,
    left: Signal<()>,
}
impl Peer {
    fn listen(&mut self, cx: &mut Cx) -> std::io::Result<()> {
        let this = cx.this(self);
        let mut text = BytesMut::new();
        if self.socket.read_into(cx, &mut text)? > 0 {
            self.said.emit(cx, (this, text.freeze()));
        }
        Ok(())
    }
    fn hear(&mut self, cx: &mut Cx, from: Handle<Peer>, text: &Bytes) -> Result<(), WriteError> {
        if from != cx.this(self) {
            self.socket.write(cx, text.clone())?;
        }
        Ok(())
    }
    fn leave(&mut self, cx: &mut Cx) {
        self.left.emit(cx, ());
        cx.destroy_later(self.socket); // and this peer, which is its child
    }
}
object! {
    Peer {
        signals { said(Handle<Peer>, Bytes) left() }
        slots { listen() hear(Handle<Peer>, &Bytes) leave() }
    }
}

struct Room {
    listener: Handle<Listener>,
    joined: u32,
    left: u32,
    line: Signal<(Handle<Peer>, Bytes)>,
}
impl Room {
    fn accept(&mut self, cx: &mut Cx) -> Result<(), Box<dyn std::error::Error>> {
        let this = cx.this(self);
        while let Some(socket) = self.listener.accept_under(cx, this)? {
            let peer = cx
                .under(socket)
                .spawn(Peer { socket, said: Signal::new(), left: Signal::new() });
            attach!(cx, socket.readable => peer.listen);
            attach!(cx, socket.closed => peer.leave());
            attach!(cx, peer.said => this.relay, Queued);
            attach!(cx, peer.left => this.count);
            attach!(cx, this.line => peer.hear);
            socket.write(cx, "!")?; // who has read this is in the room
            self.joined += 1;
        }
        Ok(())
    }
    fn relay(&mut self, cx: &mut Cx, from: Handle<Peer>, text: &Bytes) {
        self.line.emit(cx, (from, text.clone()));
    }
    fn count(&mut self, cx: &mut Cx) {
        self.left += 1;
        if self.left == 3 {
            cx.quit();
        }
    }
}
object! {
    Room {
        signals { line(Handle<Peer>, Bytes) }
        slots { accept() relay(Handle<Peer>, &Bytes) count() }
    }
}

/// Three people talk, over plain blocking sockets.
fn talk(at: SocketAddr) -> std::io::Result<()> {
    let mut all = Vec::new();
    for _ in 0..3 {
        let mut one = TcpStream::connect(at)?;
        one.read_exact(&mut [0])?;
        all.push(one);
    }
    all[0].write_all(b"hello")?;
    let mut got = [0; 5];
    for one in &mut all[1..] {
        one.read_exact(&mut got)?;
        assert_eq!(&got, b"hello");
    }
    all.remove(1); // one leaves
    all[0].write_all(b"again")?;
    all[1].read_exact(&mut got)?;
    println!("heard {}", String::from_utf8_lossy(&got));
    Ok(())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
    let cx = app.cx();
    let listener = Listener::on(cx, &Endpoint::Ip("127.0.0.1:0".parse()?))?;
    let room = cx.spawn(Room { listener, joined: 0, left: 0, line: Signal::new() });
    attach!(cx, listener.incoming => room.accept);
    let Endpoint::Ip(at) = listener.local(cx)? else { return Err("it listens on TCP".into()) };

    let client = std::thread::spawn(move || talk(at));
    app.run();
    client.join().map_err(|_| "the client panicked")??;
    let cx = app.cx();
    let joined = cx.with(room, |room, _| room.joined)?;
    println!("joined {joined}, dead links met {}", cx.counters().gone);
    Ok(())
}
