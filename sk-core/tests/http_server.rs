//! The HTTP server over real sockets: what it answers, to whom, and for how long.
#![cfg(feature = "http")]

#[path = "flow_transports/supply.rs"]
mod supply;

use sk_core::net::http::{HttpServer, HttpSettings, Page};
use sk_core::prelude::*;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;

/// Far longer than anything here takes.
const WATCHDOG: Duration = Duration::from_secs(30);

struct Bench {
    app: SkApp,
    clock: Arc<supply::PushedClock>,
    at: SocketAddr,
}

struct Client {
    socket: TcpStream,
    heard: Vec<u8>,
    over: bool,
}

impl Bench {
    fn new() -> Bench {
        let (world, clock) = supply::world();
        let builder = SkApp::builder().mode(TimingMode::SelectIo).interval(Duration::from_millis(2));
        let mut app = builder.world(world).build().expect("descriptors are left");
        let server = HttpServer::start(app.cx(), HttpSettings::default());
        let any = Endpoint::Ip("127.0.0.1:0".parse().expect("an address"));
        let Ok(Endpoint::Ip(at)) = server.listen(app.cx(), &any) else {
            panic!("the loopback has a free port")
        };
        let page = |body: &[u8]| Page { kind: "text/plain", body: body.to_vec().into() };
        server.page(app.cx(), "/", page(b"hello")).expect("it lives");
        server.page(app.cx(), "/large", page(&vec![b'x'; 8 << 20])).expect("it lives");
        Bench { app, clock, at }
    }

    fn client(&mut self, says: &str) -> Client {
        let mut socket = TcpStream::connect(self.at).expect("it listens");
        socket.write_all(says.as_bytes()).expect("the kernel has room");
        socket.set_nonblocking(true).expect("it is open");
        Client { socket, heard: Vec::new(), over: false }
    }

    fn until(&mut self, what: &str, mut done: impl FnMut() -> bool) {
        let started = std::time::Instant::now();
        while !done() {
            assert!(started.elapsed() < WATCHDOG, "never came: {what}");
            self.app.pulse();
        }
    }

    /// Everything that a client hears until the connection ends.
    fn answer(&mut self, says: &str) -> String {
        let mut client = self.client(says);
        self.until("the end of the connection", || client.listen().over);
        client.text()
    }
}

impl Client {
    fn listen(&mut self) -> &Client {
        let mut room = [0; 64 * 1024];
        while !self.over {
            match self.socket.read(&mut room) {
                Ok(0) => self.over = true,
                Ok(count) => self.heard.extend_from_slice(&room[..count]),
                Err(error) => {
                    self.over = error.kind() != ErrorKind::WouldBlock;
                    break;
                }
            }
        }
        self
    }

    fn text(&self) -> String {
        String::from_utf8_lossy(&self.heard).into_owned()
    }
}

fn ask(path: &str, fields: &str) -> String {
    format!("GET {path} HTTP/1.1\r\nHost: localhost\r\n{fields}\r\n")
}

#[test]
fn pages_are_answered_one_after_another_on_one_connection() {
    let mut bench = Bench::new();
    let text =
        bench.answer(&[ask("/", ""), ask("/nowhere", ""), ask("/?x", "Connection: close\r\n")].concat());
    let statuses: Vec<&str> = text.split("HTTP/1.1 ").skip(1).filter_map(|part| part.get(..3)).collect();
    assert_eq!(statuses, ["200", "404", "200"]);
    assert!(
        text.ends_with("\r\n\r\nhello") && text.contains("There is no page at this path."),
        "{text}"
    );
    assert!(text.contains("X-Content-Type-Options: nosniff\r\n"), "{text}");
}

#[test]
fn t13_strangers_are_told_why_they_are_not_answered() {
    let mut bench = Bench::new();
    let close = "Connection: close\r\n";
    let text = bench.answer(&format!("GET / HTTP/1.1\r\nHost: evil.example\r\n{close}\r\n"));
    assert!(text.starts_with("HTTP/1.1 421 ") && !text.contains("hello"), "{text}");
    let text = bench.answer(&ask("/", &format!("Origin: http://evil.example\r\n{close}")));
    assert!(text.starts_with("HTTP/1.1 403 ") && !text.contains("hello"), "{text}");
    let text = bench.answer("\x16\x03\x01 is no HTTP");
    assert!(text.starts_with("HTTP/1.1 400 "), "{text}");
    let text = bench.answer("POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5\r\n\r\nhello");
    assert!(text.starts_with("HTTP/1.1 413 "), "{text}");
    let text = bench.answer(&format!("GET / HTTP/1.1\r\nHost: localhost\r\nX: {}", "x".repeat(9000)));
    assert!(text.starts_with("HTTP/1.1 431 "), "{text}");
}

#[test]
fn a_head_that_does_not_come_is_ended_after_two_seconds() {
    let mut bench = Bench::new();
    let mut slow = bench.client("GET / HT");
    let mut prompt = bench.client(&ask("/", ""));
    bench.until("the prompt one is answered", || prompt.listen().text().ends_with("hello"));
    bench.clock.push(Duration::from_secs(2));
    bench.until("the slow one is ended", || slow.listen().over);
    assert!(slow.text().starts_with("HTTP/1.1 408 "), "{}", slow.text());
    assert!(!prompt.listen().over, "it may ask again");
    bench.clock.push(Duration::from_secs(9));
    bench.until("nobody stays for ever", || prompt.listen().over);
}

#[test]
fn those_who_ask_at_once_find_a_place_however_many_only_wait() {
    let mut bench = Bench::new();
    let mut waiting = Vec::new();
    for _ in 0..400 {
        waiting.push(bench.client(""));
        // The kernel keeps few of those who have not been taken in.
        bench.app.pulse();
    }
    let mut prompt = bench.client(&ask("/", ""));
    bench.until("it is answered", || prompt.listen().text().ends_with("hello"));
    let open = waiting
        .into_iter()
        .filter_map(|mut client| (!client.listen().over).then_some(()))
        .count();
    assert!(open <= 256, "{open} connections are held open by those who say nothing");
}

#[test]
fn a_client_that_takes_nothing_of_its_answer_is_given_up() {
    let mut bench = Bench::new();
    let mut lazy = bench.client(&ask("/large", ""));
    let mut prompt = bench.client(&ask("/large", "Connection: close\r\n"));
    bench.until("the other has all of it", || prompt.listen().over);
    assert_eq!(prompt.heard.iter().filter(|byte| **byte == b'x').count() >> 20, 8);
    bench.clock.push(Duration::from_secs(10));
    let mut again = bench.client(&ask("/", "Connection: close\r\n"));
    bench.until("others are served meanwhile", || again.listen().over);
    for _ in 0..200 {
        bench.app.pulse();
    }
    bench.until("it finds its connection ended", || lazy.listen().over);
    assert!(lazy.heard.len() < 8 << 20, "it was not sent to the end");
}
