//! What holds over real sockets as well as over simulated ones.

use crate::actors::{Door, Then, Visitor, any_port, everywhere};
use bytes::Bytes;
use sk_core::prelude::*;

fn pattern(length: usize) -> Bytes {
    (0..length).map(|i| (i * 31 % 251) as u8).collect::<Vec<u8>>().into()
}

#[test]
fn an_echo_comes_back_and_closing_in_the_own_slot_is_told_once() {
    everywhere(|stage| {
        let cx = stage.cx();
        let (door, at) = Door::open(cx, &any_port());
        let visitor = Visitor::send(cx, &at, pattern(30_000), Then::Close);
        stage.play();
        let cx = stage.cx();
        cx.with(visitor, |v, _| {
            assert_eq!(v.got, pattern(30_000));
            assert_eq!((v.connected, v.buried), (1, true));
            assert!(v.drained >= 1);
            assert_eq!(v.closed, [CloseReason::Local]);
        })
        .expect("it lives");
        let accepted = cx.with(door, |door, _| door.sockets.len());
        assert_eq!(accepted, Ok(1));
    });
}

#[test]
fn destroying_in_the_own_slot_is_not_told_as_closed() {
    everywhere(|stage| {
        let cx = stage.cx();
        let (_, at) = Door::open(cx, &any_port());
        let visitor = Visitor::send(cx, &at, pattern(100), Then::Destroy);
        stage.play();
        let closed = stage.cx().with(visitor, |v, _| (v.closed.clone(), v.buried));
        assert_eq!(closed, Ok((vec![], true)));
    });
}

#[test]
fn eight_mebibytes_pass_through_an_echo_that_holds_little() {
    everywhere(|stage| {
        let cx = stage.cx();
        let (_, at) = Door::open(cx, &any_port());
        let sent = pattern(8 << 20);
        let visitor = Visitor::send(cx, &at, sent.clone(), Then::Close);
        stage.play();
        let same = stage.cx().with(visitor, |v, _| (v.got == sent, v.closed.clone()));
        assert_eq!(same, Ok((true, vec![CloseReason::Local])));
    });
}

#[test]
fn a_refused_connection_is_closed_with_the_error() {
    everywhere(|stage| {
        let cx = stage.cx();
        let listener = Listener::on(cx, &any_port()).expect("a port is free");
        let at = listener.local(cx).expect("it lives");
        cx.destroy_later(listener);
        stage.app.pulse();
        assert!(!stage.cx().exists(listener));
        let cx = stage.cx();
        let visitor = Visitor::send(cx, &at, pattern(10), Then::Destroy);
        stage.play();
        let (connected, closed) = stage
            .cx()
            .with(visitor, |v, _| (v.connected, v.closed.clone()))
            .expect("it lives");
        assert_eq!(connected, 0);
        assert!(
            matches!(&closed[..], [CloseReason::Failed(error)] if error.contains("refused")),
            "{closed:?}"
        );
    });
}

/// Accepts one connection, says a few bytes and half closes it by `close`.
struct Host {
    listener: Handle<Listener>,
    heard: Vec<u8>,
    socket: Handle<Socket>,
}
impl Host {
    fn accept(&mut self, cx: &mut Cx) -> std::io::Result<()> {
        let this = cx.this(self);
        while let Some(socket) = self.listener.accept(cx)? {
            self.socket = socket;
            attach!(cx, socket.closed => this.answer());
            attach!(cx, socket.readable => this.hear);
        }
        Ok(())
    }
    fn hear(&mut self, cx: &mut Cx) -> std::io::Result<()> {
        let mut heard = bytes::BytesMut::new();
        self.socket.read_into(cx, &mut heard)?;
        self.heard.extend_from_slice(&heard);
        Ok(())
    }
    /// The peer has ended: everything it said was heard, and it still listens.
    fn answer(&mut self, cx: &mut Cx) -> Result<(), WriteError> {
        self.socket.write(cx, self.heard.clone())?;
        Ok(self.socket.close(cx)?)
    }
}
object! { Host { slots { accept() hear() answer() } } }

#[test]
fn after_a_half_close_the_answer_still_comes() {
    use std::io::{Read, Write};
    for mode in [TimingMode::Coarse, TimingMode::SelectIo] {
        let mut stage = crate::actors::Stage::real(mode);
        let cx = stage.cx();
        let listener = Listener::on(cx, &any_port()).expect("a port is free");
        let host = cx.spawn(Host { listener, heard: Vec::new(), socket: Handle::nobody() });
        attach!(cx, listener.incoming => host.accept);
        let Ok(Endpoint::Ip(at)) = listener.local(cx) else { panic!("it listens on TCP") };
        let client = std::thread::spawn(move || {
            let mut stream = std::net::TcpStream::connect(at).expect("it listens");
            stream.write_all(&pattern(200_000)).expect("it reads");
            stream.shutdown(std::net::Shutdown::Write).expect("it is open");
            let mut got = Vec::new();
            stream.read_to_end(&mut got).expect("it answers");
            got
        });
        while !client.is_finished() {
            stage.app.pulse();
        }
        assert_eq!(client.join().expect("it does not panic"), pattern(200_000));
    }
}

/// Writes to a peer that is gone until it is told.
struct Shouter {
    socket: Handle<Socket>,
    closed: Vec<CloseReason>,
    refused: u32,
}
impl Shouter {
    fn shout(&mut self, cx: &mut Cx) {
        if self.socket.write(cx, "is anybody there?").is_err() {
            self.refused += 1;
        }
    }
    fn on_closed(&mut self, _cx: &mut Cx, why: CloseReason) {
        self.closed.push(why);
    }
    fn on_buried(&mut self, cx: &mut Cx) {
        cx.quit();
    }
}
object! { Shouter { slots { shout() on_closed(CloseReason) on_buried() } } }

/// Drops whatever comes at once.
struct Refuser {
    listener: Handle<Listener>,
}
impl Refuser {
    fn accept(&mut self, cx: &mut Cx) -> std::io::Result<()> {
        while let Some(socket) = self.listener.accept(cx)? {
            cx.destroy_later(socket);
        }
        Ok(())
    }
}
object! { Refuser { slots { accept() } } }

#[test]
fn writing_to_a_peer_that_is_gone_ends_in_one_closed() {
    everywhere(|stage| {
        let cx = stage.cx();
        let listener = Listener::on(cx, &any_port()).expect("a port is free");
        let refuser = cx.spawn(Refuser { listener });
        attach!(cx, listener.incoming => refuser.accept);
        let at = listener.local(cx).expect("it lives");
        let socket = Socket::connect(cx, &at).expect("a connection can be begun");
        let shouter = cx.spawn(Shouter { socket, closed: Vec::new(), refused: 0 });
        attach!(cx, cx.fast_zone().pulse => shouter.shout);
        attach!(cx, socket.closed => shouter.on_closed);
        let watch = cx.watch(socket);
        attach!(cx, watch.buried => shouter.on_buried());
        stage.play();
        let closed = stage.cx().with(shouter, |s, _| s.closed.clone()).expect("it lives");
        assert_eq!(closed.len(), 1, "{closed:?}");
        assert!(matches!(closed[0], CloseReason::Ended | CloseReason::Failed(_)), "{closed:?}");
    });
}

#[test]
fn a_unix_socket_tells_who_is_at_the_other_end() {
    everywhere(|stage| {
        let name = format!("sk-net-{}-{:?}", std::process::id(), stage.cx().settings().mode);
        let at = Endpoint::Unix(std::env::temp_dir().join(name));
        let cx = stage.cx();
        let (door, local) = Door::open(cx, &at);
        assert_eq!(local, at);
        let visitor = Visitor::send(cx, &at, pattern(5000), Then::Close);
        stage.play();
        let cx = stage.cx();
        assert_eq!(cx.with(visitor, |v, _| v.got.len()), Ok(5000));
        let uids = cx.with(door, |door, _| door.uids.clone()).expect("it lives");
        assert!(matches!(uids[..], [Some(_)]), "{uids:?}");
    });
}

#[test]
fn a_full_queue_takes_nothing_and_says_so() {
    everywhere(|stage| {
        let cx = stage.cx();
        let (_, at) = Door::open(cx, &any_port());
        let visitor = Visitor::send(cx, &at, pattern(100), Then::Close);
        let socket = cx.with(visitor, |v, _| v.socket).expect("it lives");
        socket.set_queued_bytes_max(cx, 150).expect("it lives");
        let refused = socket.write(cx, pattern(51));
        assert_eq!(refused, Err(WriteError::Full { queued: 100, max: 150 }));
        assert_eq!(socket.queued_bytes(cx), Ok(100));
        stage.play();
        assert_eq!(socket.write(stage.cx(), "late"), Err(WriteError::Access(Access::Gone)));
    });
}

/// Answers datagrams, or takes the answer.
struct Post {
    socket: Handle<Datagrams>,
    answers: bool,
    got: u32,
}
impl Post {
    fn hear(&mut self, cx: &mut Cx) -> std::io::Result<()> {
        let mut room = [0; 100];
        while let Ok((count, from)) = self.socket.receive(cx, &mut room) {
            self.got += 1;
            if self.answers {
                self.socket.send(cx, from, &room[..count])?;
            } else if self.got == 100 {
                cx.quit();
            }
        }
        Ok(())
    }
}
object! { Post { slots { hear() } } }

#[test]
fn a_hundred_datagrams_come_back() {
    everywhere(|stage| {
        let cx = stage.cx();
        let ends = [true, false].map(|answers| {
            let socket = Datagrams::bind(cx, "127.0.0.1:0".parse().expect("an address")).expect("a port");
            let post = cx.spawn(Post { socket, answers, got: 0 });
            attach!(cx, socket.readable => post.hear);
            (socket, post)
        });
        let to = ends[0].0.local(cx).expect("it lives");
        for n in 0..100 {
            ends[1].0.send(cx, to, &[n]).expect("there is room for a hundred");
        }
        stage.play();
        assert_eq!(stage.cx().with(ends[0].1, |post, _| post.got), Ok(100));
    });
}
