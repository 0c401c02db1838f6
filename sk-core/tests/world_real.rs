//! What only the real world has: descriptors, socket files, threads, POSIX signals.

#[path = "util/mod.rs"]
mod util;

use nix::sys::signal::{Signal, raise};
use sk_core::world::{
    Clock, Endpoint, JOBS_WAITING_MAX, Net, OsSignal, RealClock, RealNet, RealStorage, RealWorker, Storage,
    Token, Worker, World,
};
use std::collections::BTreeSet;
use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixListener;
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;
use util::{TempFolder, look, told};

#[test]
fn a_wait_is_never_shorter_than_its_time_out() {
    let (clock, mut net, mut ready) = (RealClock::new(), RealNet::new().unwrap(), Vec::new());
    for span in [Duration::from_micros(1), Duration::from_micros(700), Duration::from_micros(2_300)] {
        let start = clock.now();
        net.wait(Some(span), &mut ready).unwrap();
        assert!(clock.now() >= start + span, "{span:?}");
    }
    assert_eq!(ready, []);
}

#[test]
fn a_timer_left_from_a_shorter_wait_does_not_end_a_longer_one() {
    let (clock, mut net, mut ready) = (RealClock::new(), RealNet::new().unwrap(), Vec::new());
    net.waker().wake();
    net.wait(Some(Duration::from_micros(1_900)), &mut ready).unwrap();
    let (start, span) = (clock.now(), Duration::from_millis(6));
    net.wait(Some(span), &mut ready).unwrap();
    assert!(clock.now() >= start + span);
}

#[test]
fn a_wake_from_another_thread_ends_an_endless_wait() {
    let (mut net, mut ready) = (RealNet::new().unwrap(), Vec::new());
    let waker = net.waker();
    let other = std::thread::spawn(move || waker.wake());
    net.wait(None, &mut ready).unwrap();
    other.join().unwrap();
    assert_eq!(ready, []);
}

#[test]
fn tokens_of_the_net_itself_are_refused() {
    let (mut net, at) = (RealNet::new().unwrap(), Endpoint::Ip("127.0.0.1:0".parse().unwrap()));
    for own in [u64::MAX, u64::MAX - 1] {
        let refused = net.listen(&at, Token(own)).err().map(|error| error.kind());
        assert_eq!(refused, Some(ErrorKind::InvalidInput));
    }
    net.listen(&at, Token(u64::MAX - 2)).unwrap();
}

#[test]
fn a_socket_file_is_private_and_goes_with_its_listener() {
    let (folder, mut net) = (TempFolder::new(), RealNet::new().unwrap());
    let path = folder.path().join("hub.sock");
    let listener = net.listen(&Endpoint::Unix(path.clone()), Token(1)).unwrap();
    assert_eq!(fs::symlink_metadata(&path).unwrap().permissions().mode() & 0o7777, 0o600);
    drop(listener);
    assert!(!path.exists());
}

#[test]
fn the_socket_file_of_a_dead_process_is_replaced() {
    let (folder, mut net) = (TempFolder::new(), RealNet::new().unwrap());
    let path = folder.path().join("hub.sock");
    drop(UnixListener::bind(&path).unwrap());
    assert!(path.exists(), "std leaves the file as a killed process does");
    let _listener = net.listen(&Endpoint::Unix(path.clone()), Token(1)).unwrap();
    net.connect(&Endpoint::Unix(path), Token(2)).unwrap();
}

#[test]
fn a_file_that_is_no_socket_stays() {
    let (folder, mut net) = (TempFolder::new(), RealNet::new().unwrap());
    let path = folder.path().join("notes");
    fs::write(&path, "mine").unwrap();
    let refused = net.listen(&Endpoint::Unix(path.clone()), Token(1)).err().unwrap();
    assert_eq!(refused.kind(), ErrorKind::AddrInUse);
    assert!(refused.to_string().contains("not a socket"), "{refused}");
    assert_eq!(fs::read(&path).unwrap(), b"mine");
}

#[test]
fn a_living_listener_is_named_as_the_reason() {
    let (folder, mut net) = (TempFolder::new(), RealNet::new().unwrap());
    let path = folder.path().join("hub.sock");
    let _living = UnixListener::bind(&path).unwrap();
    let refused = net.listen(&Endpoint::Unix(path), Token(1)).err().unwrap();
    assert!(refused.to_string().contains("a living process listens there"), "{refused}");
}

#[test]
fn a_listener_leaves_the_file_of_its_successor() {
    let (folder, mut net) = (TempFolder::new(), RealNet::new().unwrap());
    let at = Endpoint::Unix(folder.path().join("hub.sock"));
    let first = net.listen(&at, Token(1)).unwrap();
    fs::remove_file(folder.path().join("hub.sock")).unwrap();
    let _second = net.listen(&at, Token(2)).unwrap();
    drop(first);
    net.connect(&at, Token(3)).unwrap();
}

fn open_descriptors() -> BTreeSet<String> {
    let names = fs::read_dir("/proc/self/fd").unwrap();
    names.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn every_descriptor_is_closed_on_exec() {
    if !in_own_process("every_descriptor_is_closed_on_exec") {
        return;
    }
    let (folder, before) = (TempFolder::new(), open_descriptors());
    let mut net = RealNet::new().unwrap();
    let any = "127.0.0.1:0".parse().unwrap();
    let mut listener = net.listen(&Endpoint::Ip(any), Token(1)).unwrap();
    let _file = net.listen(&Endpoint::Unix(folder.path().join("x")), Token(2)).unwrap();
    let _client = net.connect(&listener.local(), Token(3)).unwrap();
    let _datagrams = net.bind(any, Token(4)).unwrap();
    let _signals = net.watch_os_signals(Token(5)).unwrap();
    let mut ready = Vec::new();
    while !told(&ready, Token(1)).0 {
        net.wait(None, &mut ready).unwrap();
    }
    let _server = listener.accept(Token(6)).unwrap();

    let new: Vec<String> = open_descriptors().difference(&before).cloned().collect();
    assert!(new.len() >= 10, "{new:?}");
    for descriptor in new {
        // The descriptor of the listing itself is closed by now.
        let Ok(info) = fs::read_to_string(format!("/proc/self/fdinfo/{descriptor}")) else { continue };
        let flags = info.lines().find_map(|line| line.strip_prefix("flags:")).unwrap();
        let flags = i32::from_str_radix(flags.trim(), 8).unwrap();
        assert_ne!(flags & libc::O_CLOEXEC, 0, "descriptor {descriptor}");
    }
}

/// Runs one test of this file again in a process of its own, where it may spoil what all threads share.
/// Answers whether this already is that process.
fn in_own_process(test: &str) -> bool {
    if std::env::var_os("SK_TEST_OWN_PROCESS").is_some() {
        return true;
    }
    let this = std::env::current_exe().unwrap();
    let ran = Command::new(this)
        .args(["--exact", test])
        .env("SK_TEST_OWN_PROCESS", "1")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&ran.stdout);
    assert!(ran.status.success() && said.contains("1 passed"), "{said}");
    false
}

#[test]
fn running_out_of_descriptors_is_told_by_accept_and_passes() {
    if !in_own_process("running_out_of_descriptors_is_told_by_accept_and_passes") {
        return;
    }
    let mut net = RealNet::new().unwrap();
    let mut listener = net.listen(&Endpoint::Ip("127.0.0.1:0".parse().unwrap()), Token(1)).unwrap();
    let _client = net.connect(&listener.local(), Token(2)).unwrap();
    let mut ready = Vec::new();
    while !told(&ready, Token(1)).0 {
        net.wait(None, &mut ready).unwrap();
    }
    // The lowest free number is given next: with the limit at it there is none.
    let next = fs::File::open("/dev/null").unwrap();
    let limit = std::os::fd::AsRawFd::as_raw_fd(&next) as libc::rlim_t;
    drop(next);
    let nofile = nix::sys::resource::Resource::RLIMIT_NOFILE;
    let (soft, hard) = nix::sys::resource::getrlimit(nofile).unwrap();
    nix::sys::resource::setrlimit(nofile, limit, hard).unwrap();
    let refused = listener.accept(Token(3)).err().unwrap();
    assert_eq!(refused.raw_os_error(), Some(libc::EMFILE));
    nix::sys::resource::setrlimit(nofile, soft, hard).unwrap();
    // Who waited was turned away, so that he does not wait for nothing, and whoever comes next is let in.
    assert_eq!(listener.accept(Token(3)).err().unwrap().kind(), ErrorKind::WouldBlock);
    let _next = net.connect(&listener.local(), Token(4)).unwrap();
    ready.clear();
    while !told(&ready, Token(1)).0 {
        net.wait(None, &mut ready).unwrap();
    }
    listener.accept(Token(5)).unwrap();
}

#[test]
fn a_signal_to_the_process_arrives_as_something_to_read() {
    if !in_own_process("a_signal_to_the_process_arrives_as_something_to_read") {
        return;
    }
    let mut net = RealNet::new().unwrap();
    net.block_os_signals().unwrap();
    let mut signals = net.watch_os_signals(Token(7)).unwrap();
    assert_eq!(signals.take().unwrap(), None);
    for (signal, heard) in [(Signal::SIGTERM, OsSignal::Terminate), (Signal::SIGINT, OsSignal::Interrupt)] {
        raise(signal).unwrap();
        let mut ready = Vec::new();
        net.wait(None, &mut ready).unwrap();
        assert!(told(&ready, Token(7)).0);
        assert_eq!(signals.take().unwrap(), Some(heard));
        assert_eq!(signals.take().unwrap(), None);
        assert_eq!(look(&mut net), []);
    }
}

#[test]
fn a_full_pool_gives_the_job_back_and_a_drop_runs_what_waits() {
    let worker = RealWorker::new();
    let (started, has_started) = mpsc::channel();
    let mut held = Vec::new();
    for _ in 0..2 {
        let (release, released) = mpsc::channel::<()>();
        let started = started.clone();
        let job = Box::new(move || {
            started.send(std::thread::current().name().map(str::to_owned)).unwrap();
            // Ends when the other side is dropped.
            let _ = released.recv();
        });
        assert!(worker.run(job).is_ok());
        held.push(release);
    }
    let names: BTreeSet<_> = (0..2).map(|_| has_started.recv().unwrap().unwrap()).collect();
    assert_eq!(names.into_iter().collect::<Vec<_>>(), ["sk-worker-0", "sk-worker-1"]);

    let ran = Arc::new(AtomicUsize::new(0));
    let count = |ran: &Arc<AtomicUsize>| {
        let ran = ran.clone();
        Box::new(move || {
            ran.fetch_add(1, Ordering::SeqCst);
        })
    };
    for _ in 0..JOBS_WAITING_MAX {
        assert!(worker.run(count(&ran)).is_ok());
    }
    let back = worker.run(count(&ran)).expect_err("the queue is full");
    back();
    assert_eq!(ran.load(Ordering::SeqCst), 1);
    drop(held);
    drop(worker);
    assert_eq!(ran.load(Ordering::SeqCst), JOBS_WAITING_MAX + 1);
}

#[test]
fn a_pool_may_be_dropped_by_its_own_job() {
    let (worker, (done, outcome)) = (Arc::new(RealWorker::new()), mpsc::channel());
    let (go, may_go) = mpsc::channel::<()>();
    let last = worker.clone();
    let job = Box::new(move || {
        let _ = may_go.recv();
        drop(last);
        done.send(()).unwrap();
    });
    assert!(worker.run(job).is_ok());
    drop(worker);
    drop(go);
    outcome.recv().unwrap();
}

#[test]
fn a_world_grows_on_another_thread_with_the_same_clock() {
    let world = World::real().unwrap();
    assert!(world.simulated_share().is_none());
    let seed = world.for_thread().unwrap();
    let before = world.clock.now();
    let there = std::thread::spawn(move || {
        let mut world = seed.grow().unwrap();
        world
            .net
            .listen(&Endpoint::Ip("127.0.0.1:0".parse().unwrap()), Token(1))
            .unwrap();
        assert_ne!(world.rng.next_u64(), world.rng.next_u64());
        world.clock.now()
    });
    let there = there.join().unwrap();
    assert!(before <= there && there <= world.clock.now());
}

#[test]
fn a_replacement_that_fails_leaves_nothing_behind() {
    let (folder, storage) = (TempFolder::new(), RealStorage::new());
    // A folder of that name cannot be renamed over, so the failure comes after the writing.
    fs::create_dir(folder.path().join("taken")).unwrap();
    assert!(storage.replace(&folder.path().join("taken"), b"x").is_err());
    assert_eq!(storage.list(folder.path()).unwrap().len(), 1);
}
