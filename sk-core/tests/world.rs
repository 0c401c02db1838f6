//! The contracts of the world's traits, each run against the real and the simulated world.

#[path = "util/mod.rs"]
mod util;

use sk_core::Instant;
use sk_core::world::{Datagram, Endpoint, Listener, Stream, Token, World};
use std::io::{ErrorKind, IoSlice};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;
use util::{Backend, look, told};

const LISTENER: Token = Token(10);
const CLIENT: Token = Token(11);
const SERVER: Token = Token(12);

contracts! {
    real: a_clock_goes_on_and_sleeps_to_the_end, a_stream_carries_bytes_both_ways,
        a_unix_stream_carries_bytes_and_names_its_user, a_refused_connection_says_so,
        a_full_stream_blocks_until_it_is_read, half_closed_streams_still_answer,
        a_dropped_peer_is_the_end, bytes_left_unread_reset_the_peer, a_dropped_listener_refuses,
        a_taken_address_is_refused, readiness_comes_once_per_change, datagrams_keep_their_borders,
        a_wake_ends_the_next_wait_once, files_are_read_and_written_in_place, replacing_is_whole,
        names_follow_the_files, modes_are_private, folders_and_errors, jobs_run_and_panics_stay_inside,
        a_job_may_hand_over_another, connecting_shows_who_it_is;
    simulated: a_clock_goes_on_and_sleeps_to_the_end, a_stream_carries_bytes_both_ways,
        a_unix_stream_carries_bytes_and_names_its_user, a_refused_connection_says_so,
        a_full_stream_blocks_until_it_is_read, half_closed_streams_still_answer,
        a_dropped_peer_is_the_end, bytes_left_unread_reset_the_peer, a_dropped_listener_refuses,
        a_taken_address_is_refused, readiness_comes_once_per_change, datagrams_keep_their_borders,
        a_wake_ends_the_next_wait_once, files_are_read_and_written_in_place, replacing_is_whole,
        names_follow_the_files, modes_are_private, folders_and_errors, jobs_run_and_panics_stay_inside,
        a_job_may_hand_over_another, connecting_shows_who_it_is;
    simulated_far_away: a_stream_carries_bytes_both_ways, a_refused_connection_says_so,
        a_full_stream_blocks_until_it_is_read, half_closed_streams_still_answer,
        a_dropped_peer_is_the_end, a_dropped_listener_refuses;
}

/// Two loops with a connection between them.
struct Pair {
    backend: Backend,
    here: World,
    there: World,
    listener: Box<dyn Listener>,
    client: Box<dyn Stream>,
    server: Box<dyn Stream>,
}

impl Pair {
    fn new(mut backend: Backend, at: &Endpoint) -> Pair {
        let (mut here, mut there) = (backend.world(), backend.world());
        let mut listener = there.net.listen(at, LISTENER).unwrap();
        assert_eq!(listener.accept(SERVER).err().map(|e| e.kind()), Some(ErrorKind::WouldBlock));
        let mut client = here.net.connect(&listener.local(), CLIENT).unwrap();
        let (mut server, mut made) = (None, false);
        while server.is_none() || !made {
            let [mine, theirs] = backend.wait([&mut here, &mut there]);
            if told(&theirs, LISTENER).0 {
                server = Some(listener.accept(SERVER).unwrap());
            }
            if told(&mine, CLIENT).1 {
                made = client.connected().unwrap();
            }
        }
        let server = server.unwrap();
        Pair { backend, here, there, listener, client, server }
    }

    fn over_tcp(backend: Backend) -> Pair {
        let at = backend.any_port();
        Pair::new(backend, &at)
    }

    /// Reads at the server until `count` bytes have come.
    fn read_there(&mut self, count: usize) -> Vec<u8> {
        let mut bytes = Vec::new();
        let server = &mut self.server;
        self.backend.until([&mut self.here, &mut self.there], || {
            drain(&mut **server, &mut bytes);
            bytes.len() >= count
        });
        bytes
    }
}

/// Reads what is there; answers whether the end was reached.
fn drain(stream: &mut dyn Stream, into: &mut Vec<u8>) -> bool {
    let mut chunk = [0; 4096];
    loop {
        match stream.read(&mut chunk) {
            Ok(0) => return true,
            Ok(count) => into.extend_from_slice(&chunk[..count]),
            Err(error) if error.kind() == ErrorKind::WouldBlock => return false,
            Err(error) => panic!("reading failed: {error}"),
        }
    }
}

fn write(stream: &mut dyn Stream, bytes: &[u8]) -> usize {
    stream.write_vectored(&[IoSlice::new(bytes)]).unwrap()
}

fn a_clock_goes_on_and_sleeps_to_the_end(mut backend: Backend) {
    let clock = backend.clock();
    let start = clock.now();
    clock.sleep(Duration::from_micros(300));
    let slept = clock.now();
    assert!(slept >= start + Duration::from_micros(300));
    clock.sleep_until(slept + Duration::from_micros(300));
    assert!(clock.now() >= slept + Duration::from_micros(300));
    clock.sleep_until(Instant::ZERO);
    clock.sleep(Duration::ZERO);
    assert!(clock.since_epoch() > Duration::from_secs(1_700_000_000));
    assert!(backend.clock().now() >= slept, "all shares have one clock");
}

fn a_stream_carries_bytes_both_ways(backend: Backend) {
    let mut pair = Pair::over_tcp(backend);
    let parts = [IoSlice::new(b"one "), IoSlice::new(b""), IoSlice::new(b"two")];
    assert_eq!(pair.client.write_vectored(&parts).unwrap(), 7);
    assert_eq!(pair.read_there(7), b"one two");
    assert_eq!(write(&mut *pair.server, b"three"), 5);
    let (mut answer, client) = (Vec::new(), &mut pair.client);
    pair.backend.until([&mut pair.here, &mut pair.there], || {
        drain(&mut **client, &mut answer);
        answer.len() == 5
    });
    assert_eq!(answer, b"three");
    assert_eq!(pair.client.read(&mut [0]).unwrap_err().kind(), ErrorKind::WouldBlock);
    assert_eq!(pair.client.write_vectored(&[]).unwrap(), 0);
}

fn connecting_shows_who_it_is(backend: Backend) {
    let pair = Pair::over_tcp(backend);
    assert_eq!(pair.client.peer(), Some(pair.listener.local()));
    let Some(Endpoint::Ip(client)) = pair.server.peer() else { panic!("a TCP peer has an address") };
    assert!(client.ip().is_loopback() && client.port() != 0);
    assert_eq!((pair.client.peer_uid(), pair.server.peer_uid()), (None, None));
}

fn a_unix_stream_carries_bytes_and_names_its_user(mut backend: Backend) {
    let path = backend.folder().join("hub.sock");
    let own = backend.storage().owner_and_mode(&backend.folder()).unwrap().0;
    let mut pair = Pair::new(backend, &Endpoint::Unix(path.clone()));
    assert_eq!(write(&mut *pair.client, b"over a file"), 11);
    assert_eq!(pair.read_there(11), b"over a file");
    assert_eq!((pair.server.peer_uid(), pair.client.peer_uid()), (Some(own), Some(own)));
    assert_eq!(pair.server.peer(), None);
    assert_eq!(pair.client.peer(), Some(Endpoint::Unix(path.clone())));
    assert_eq!(pair.listener.local(), Endpoint::Unix(path.clone()));

    drop(pair.listener);
    let gone = pair.here.net.connect(&Endpoint::Unix(path.clone()), Token(1));
    assert_eq!(gone.err().map(|e| e.kind()), Some(ErrorKind::NotFound), "the file goes with its listener");
    pair.there.net.listen(&Endpoint::Unix(path), LISTENER).unwrap();
}

fn a_refused_connection_says_so(mut backend: Backend) {
    let (mut here, mut there) = (backend.world(), backend.world());
    let listener = there.net.listen(&backend.any_port(), LISTENER).unwrap();
    let nobody = listener.local();
    drop(listener);
    let mut client = here.net.connect(&nobody, CLIENT).unwrap();
    let [mine] = backend.wait([&mut here]);
    assert!(told(&mine, CLIENT).1);
    for _ in 0..2 {
        let refused = client.connected().unwrap_err();
        assert_eq!(refused.kind(), ErrorKind::ConnectionRefused, "also when asked again");
    }
}

fn a_dropped_listener_refuses(backend: Backend) {
    let mut pair = Pair::over_tcp(backend);
    let at = pair.listener.local();
    drop(pair.listener);
    assert_eq!(write(&mut *pair.client, b"still here"), 10, "accepted streams live on");
    let mut late = pair.here.net.connect(&at, Token(20)).unwrap();
    let mut outcome = Ok(false);
    pair.backend.until([&mut pair.here, &mut pair.there], || {
        outcome = late.connected();
        !matches!(outcome, Ok(false))
    });
    assert_eq!(outcome.unwrap_err().kind(), ErrorKind::ConnectionRefused);
}

fn a_full_stream_blocks_until_it_is_read(backend: Backend) {
    let mut pair = Pair::over_tcp(backend);
    let chunk: Vec<u8> = (0..10_007_u32).map(|n| (n % 251) as u8).collect();
    let mut sent: Vec<u8> = Vec::new();
    loop {
        let blocked = loop {
            match pair.client.write_vectored(&[IoSlice::new(&chunk)]) {
                Ok(count) => sent.extend_from_slice(&chunk[..count]),
                Err(error) => break error.kind(),
            }
        };
        assert_eq!(blocked, ErrorKind::WouldBlock);
        // The kernel may have moved bytes on to the receiver meanwhile, and then has told so.
        if !told(&look(&mut *pair.here.net), CLIENT).1 {
            break;
        }
    }
    assert!(sent.len() >= 64 * 1024);

    let mut received = Vec::new();
    let mut writable = false;
    while !writable || received.len() < sent.len() {
        let [mine, _] = pair.backend.wait([&mut pair.here, &mut pair.there]);
        writable |= told(&mine, CLIENT).1;
        drain(&mut *pair.server, &mut received);
    }
    assert_eq!(received, sent);
    assert!(write(&mut *pair.client, &chunk) > 0);
}

fn half_closed_streams_still_answer(backend: Backend) {
    let mut pair = Pair::over_tcp(backend);
    assert_eq!(write(&mut *pair.client, b"question"), 8);
    pair.client.shutdown_write().unwrap();
    let failed = pair.client.write_vectored(&[IoSlice::new(b"more")]).unwrap_err();
    assert_eq!(failed.kind(), ErrorKind::BrokenPipe);

    let (mut question, mut ended, server) = (Vec::new(), false, &mut pair.server);
    pair.backend.until([&mut pair.here, &mut pair.there], || {
        ended |= drain(&mut **server, &mut question);
        ended
    });
    assert_eq!(question, b"question");
    assert_eq!(write(&mut *pair.server, b"answer"), 6);
    drop(pair.server);

    let (mut answer, mut ended, client) = (Vec::new(), false, &mut pair.client);
    pair.backend.until([&mut pair.here, &mut pair.there], || {
        ended |= drain(&mut **client, &mut answer);
        ended
    });
    assert_eq!(answer, b"answer");
}

fn a_dropped_peer_is_the_end(backend: Backend) {
    let mut pair = Pair::over_tcp(backend);
    assert_eq!(write(&mut *pair.server, b"bye"), 3);
    drop(pair.server);
    let (mut last, mut ended, client) = (Vec::new(), false, &mut pair.client);
    pair.backend.until([&mut pair.here, &mut pair.there], || {
        ended |= drain(&mut **client, &mut last);
        ended
    });
    assert_eq!(last, b"bye");
    // The kernel takes one write before it learns that nobody is there.
    let mut failed = None;
    for _ in 0..1_000_000 {
        failed = pair.client.write_vectored(&[IoSlice::new(b"?")]).err().map(|e| e.kind());
        if failed.is_some() {
            break;
        }
    }
    assert!(matches!(failed, Some(ErrorKind::BrokenPipe | ErrorKind::ConnectionReset)), "{failed:?}");
}

fn bytes_left_unread_reset_the_peer(backend: Backend) {
    let mut pair = Pair::over_tcp(backend);
    assert_eq!(write(&mut *pair.client, b"unread"), 6);
    // The connection's own first report is out of the way once the bytes are told.
    let mut arrived = [0; 1];
    let server = &mut pair.server;
    pair.backend
        .until([&mut pair.here, &mut pair.there], || server.read(&mut arrived).is_ok());
    drop(pair.server);
    let (mut outcome, client) = (None, &mut pair.client);
    pair.backend.until([&mut pair.here, &mut pair.there], || {
        outcome = client.read(&mut [0; 8]).err().map(|e| e.kind());
        outcome != Some(ErrorKind::WouldBlock)
    });
    assert_eq!(outcome, Some(ErrorKind::ConnectionReset));
}

fn a_taken_address_is_refused(mut backend: Backend) {
    let (mut here, mut there) = (backend.world(), backend.world());
    let listener = there.net.listen(&backend.any_port(), LISTENER).unwrap();
    let Endpoint::Ip(local) = listener.local() else { panic!("an address") };
    assert_ne!(local.port(), 0);
    let again = here.net.listen(&listener.local(), LISTENER);
    assert_eq!(again.err().map(|e| e.kind()), Some(ErrorKind::AddrInUse));

    let any = "127.0.0.1:0".parse().unwrap();
    let (one, other) = (here.net.bind(any, Token(1)).unwrap(), here.net.bind(any, Token(2)).unwrap());
    assert_ne!(one.local(), other.local());
    let again = there.net.bind(one.local(), Token(3));
    assert_eq!(again.err().map(|e| e.kind()), Some(ErrorKind::AddrInUse));

    let file = Endpoint::Unix(backend.folder().join("taken.sock"));
    let living = there.net.listen(&file, Token(4)).unwrap();
    let again = here.net.listen(&file, Token(5));
    assert_eq!(again.err().map(|e| e.kind()), Some(ErrorKind::AddrInUse));
    drop(living);
    here.net.listen(&file, Token(5)).unwrap();
}

fn readiness_comes_once_per_change(backend: Backend) {
    let mut pair = Pair::over_tcp(backend);
    while !look(&mut *pair.there.net).is_empty() {}
    for _ in 0..2 {
        assert_eq!(write(&mut *pair.client, b"x"), 1);
        let [theirs] = pair.backend.wait([&mut pair.there]);
        assert!(told(&theirs, SERVER).0);
        assert_eq!(look(&mut *pair.there.net), [], "unread bytes alone are not told again");
    }
    let mut bytes = Vec::new();
    drain(&mut *pair.server, &mut bytes);
    assert_eq!(bytes, b"xx");

    assert_eq!(write(&mut *pair.client, b"y"), 1);
    assert_eq!(pair.read_there(1), b"y");
    assert!(!told(&look(&mut *pair.there.net), SERVER).0, "what was read is not told");
}

fn datagrams_keep_their_borders(mut backend: Backend) {
    let (mut here, mut there) = (backend.world(), backend.world());
    let any = "127.0.0.1:0".parse().unwrap();
    let mut one: Box<dyn Datagram> = here.net.bind(any, Token(1)).unwrap();
    let mut other = there.net.bind("0.0.0.0:0".parse().unwrap(), Token(2)).unwrap();
    let to = std::net::SocketAddr::new(any.ip(), other.local().port());
    assert_eq!(one.send(to, b"first").unwrap(), 5);
    assert_eq!(one.send(to, b"").unwrap(), 0);
    assert_eq!(one.send(to, b"a longer one").unwrap(), 12);

    let (mut received, mut space) = (Vec::new(), [0; 8]);
    backend.until([&mut here, &mut there], || {
        while let Ok((count, from)) = other.receive(&mut space) {
            received.push((space[..count].to_vec(), from));
        }
        received.len() == 3
    });
    let texts: Vec<&[u8]> = received.iter().map(|(bytes, _)| &bytes[..]).collect();
    assert_eq!(texts, [&b"first"[..], b"", b"a longer"], "what does not fit is lost");
    assert!(received.iter().all(|(_, from)| *from == one.local()));
    assert_eq!(other.receive(&mut space).unwrap_err().kind(), ErrorKind::WouldBlock);
    let too_long = one.send(to, &vec![0; 65_508]).unwrap_err();
    assert_eq!(too_long.raw_os_error(), Some(libc::EMSGSIZE));
}

fn a_wake_ends_the_next_wait_once(mut backend: Backend) {
    let mut world = backend.world();
    let waker = world.net.waker();
    for _ in 0..3 {
        waker.wake();
    }
    if let Some(share) = world.simulated_share() {
        assert!(share.woken() && share.next_event().is_some());
    }
    let mut ready = Vec::new();
    // Returns at once although nothing else will ever happen.
    world.net.wait(None, &mut ready).unwrap();
    assert_eq!(ready, []);
    if let Some(share) = world.simulated_share() {
        assert!(!share.woken() && share.next_event().is_none());
    }
}

fn files_are_read_and_written_in_place(mut backend: Backend) {
    let (storage, path) = (backend.storage(), backend.folder().join("data"));
    assert_eq!(storage.open(&path, false).err().map(|e| e.kind()), Some(ErrorKind::NotFound));
    let file = storage.open(&path, true).unwrap();
    assert!(file.is_empty().unwrap());
    file.write_at(3, b"defg").unwrap();
    file.write_at(0, b"abc").unwrap();
    file.sync().unwrap();
    let again = storage.open(&path, true).unwrap();
    let mut middle = [0; 3];
    again.read_at(2, &mut middle).unwrap();
    assert_eq!((&middle, again.len().unwrap()), (b"cde", 7));
    assert_eq!(again.read_at(5, &mut middle).unwrap_err().kind(), ErrorKind::UnexpectedEof);
    again.set_len(2).unwrap();
    again.set_len(4).unwrap();
    assert_eq!(storage.read(&path, 4).unwrap(), b"ab\0\0");
    assert_eq!(storage.read(&path, 3).unwrap_err().kind(), ErrorKind::InvalidData);
}

fn replacing_is_whole(mut backend: Backend) {
    let (storage, folder) = (backend.storage(), backend.folder());
    let path = folder.join("settings");
    storage.replace(&path, b"one").unwrap();
    let old = storage.open(&path, false).unwrap();
    storage.replace(&path, b"another").unwrap();
    assert_eq!(storage.read(&path, 100).unwrap(), b"another");
    let mut before = [0; 3];
    old.read_at(0, &mut before).unwrap();
    assert_eq!(&before, b"one", "who has the old file open keeps it");
    assert_eq!(storage.list(&folder).unwrap(), [Path::new("settings")], "nothing is left beside it");
    assert!(storage.replace(&folder, b"a folder").is_err());
    assert!(storage.replace(&folder.join("missing/file"), b"x").is_err());
    assert_eq!(storage.list(&folder).unwrap().len(), 1);
}

fn names_follow_the_files(mut backend: Backend) {
    let (storage, folder) = (backend.storage(), backend.folder());
    let (a, b) = (folder.join("a"), folder.join("b"));
    storage.replace(&a, b"of a").unwrap();
    storage.replace(&b, b"of b").unwrap();
    storage.rename(&a, &b).unwrap();
    assert_eq!(storage.read(&b, 10).unwrap(), b"of a");
    assert_eq!(storage.rename(&a, &b).unwrap_err().kind(), ErrorKind::NotFound);
    storage.create_dir(&folder.join("x/y")).unwrap();
    storage.rename(&b, &folder.join("x/y/c")).unwrap();
    storage.rename(&folder.join("x"), &folder.join("z")).unwrap();
    assert_eq!(storage.read(&folder.join("z/y/c"), 10).unwrap(), b"of a");
    storage.remove(&folder.join("z/y/c")).unwrap();
    assert_eq!(storage.remove(&folder.join("z/y/c")).unwrap_err().kind(), ErrorKind::NotFound);
    assert_eq!(storage.list(&folder).unwrap(), [Path::new("z")]);
}

fn modes_are_private(mut backend: Backend) {
    let (storage, folder) = (backend.storage(), backend.folder().join("deep/er"));
    storage.create_dir(&folder).unwrap();
    storage.replace(&folder.join("replaced"), b"").unwrap();
    storage.open(&folder.join("opened"), true).unwrap();
    let mode = |name: &str| storage.owner_and_mode(&folder.join(name)).unwrap().1;
    assert_eq!((mode("replaced"), mode("opened"), mode("")), (0o600, 0o600, 0o700));
    assert_eq!(storage.owner_and_mode(folder.parent().unwrap()).unwrap().1, 0o700);
}

fn folders_and_errors(mut backend: Backend) {
    let (storage, folder) = (backend.storage(), backend.folder());
    for name in ["c", "a", "b"] {
        storage.create_dir(&folder.join(name)).unwrap();
    }
    storage.create_dir(&folder.join("a")).unwrap();
    assert_eq!(storage.list(&folder).unwrap(), [Path::new("a"), Path::new("b"), Path::new("c")]);
    let file = folder.join("file");
    storage.replace(&file, b"x").unwrap();
    assert_eq!(storage.create_dir(&file).unwrap_err().kind(), ErrorKind::AlreadyExists);
    assert_eq!(storage.list(&folder.join("none")).unwrap_err().kind(), ErrorKind::NotFound);
    assert_eq!(storage.list(&file).unwrap_err().kind(), ErrorKind::NotADirectory);
    assert_eq!(storage.read(&folder, 10).unwrap_err().kind(), ErrorKind::IsADirectory);
    assert_eq!(storage.read(&folder.join("none"), 10).unwrap_err().kind(), ErrorKind::NotFound);
}

fn jobs_run_and_panics_stay_inside(mut backend: Backend) {
    let worker = backend.worker();
    let ran = Arc::new(AtomicUsize::new(0));
    for number in 0..20 {
        let ran = ran.clone();
        let job = Box::new(move || {
            // The unwinding is meant; the default hook would only fill the test's output.
            if number % 5 == 0 {
                std::panic::resume_unwind(Box::new("a job that fails"));
            }
            ran.fetch_add(1, Ordering::SeqCst);
        });
        assert!(worker.run(job).is_ok());
    }
    backend.work_until(|| ran.load(Ordering::SeqCst) == 16);
}

fn a_job_may_hand_over_another(mut backend: Backend) {
    let (worker, (done, outcome)) = (backend.worker(), mpsc::channel());
    let again = worker.clone();
    let first = Box::new(move || {
        let second = Box::new(move || done.send(2).unwrap());
        assert!(again.run(second).is_ok());
    });
    assert!(worker.run(first).is_ok());
    let mut result = None;
    backend.work_until(|| {
        result = outcome.try_recv().ok();
        result.is_some()
    });
    assert_eq!(result, Some(2));
}
