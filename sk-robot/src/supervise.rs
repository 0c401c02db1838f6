//! A parent that starts the hub again when it has crashed.
//!
//! The parent holds nothing that could fail with the hub: no loop, no socket, no file. It waits for its child and
//! for signals, and passes these on. A hub that ends by itself, or says that it cannot run as it was told, is not
//! started again.

use nix::sys::signal::{SigSet, Signal, kill};
use nix::sys::wait::{Id, WaitPidFlag, waitid};
use nix::unistd::{Pid, getppid};
use sk_core::world::{Clock, RealClock};
use std::io;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, ExitStatus};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

/// The variable that tells a hub the process id of its supervisor.
pub const SUPERVISOR_VARIABLE: &str = "SKROBOT_SUPERVISOR";
/// The variable that tells a hub how often it was started again.
pub const RESTARTS_VARIABLE: &str = "SKROBOT_RESTARTS";
/// What a hub ends with that was told something that cannot be: on the command line or in the configuration.
pub const EXIT_MISTOLD: u8 = 2;
/// What a hub ends with that has said why it cannot run.
pub const EXIT_REFUSED: u8 = 1;

/// The wait before the first new start.
const WAIT_FIRST: Duration = Duration::from_millis(100);
/// The longest.
const WAIT_MAX: Duration = Duration::from_secs(10);
/// A hub that ran so long begins with the first wait again.
const GOOD_RUN: Duration = Duration::from_secs(60);
/// What a shell adds to the number of the signal that ended a process.
const SIGNAL_EXIT: u8 = 128;
/// Signals and ends that wait to be looked at.
const EVENTS_MAX: usize = 64;
/// The signals that are passed on.
const PASSED_ON: [Signal; 5] =
    [Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP, Signal::SIGUSR1, Signal::SIGUSR2];

enum Event {
    Told(Signal),
    /// The child of that process id has ended and waits to be buried.
    Ended(Pid),
}

/// Starts the child, again and again when it crashes, until it ends by itself or somebody ends both. Answers what
/// this process is to end with: the child's code, or 128 and the number of the signal that ended it. Blocks; to be
/// called before any other thread is started. `make` is told how often the hub was started again.
///
/// # Errors
/// If signals cannot be heard, no thread is left, or the child cannot be started at all.
pub fn run(make: impl Fn(u64) -> Command) -> io::Result<u8> {
    let clock = RealClock::new();
    let mut heard = SigSet::empty();
    heard.extend(PASSED_ON);
    // The threads that are started below inherit the mask, so only the one that asks hears.
    heard.thread_block()?;
    let (sender, events) = sync_channel(EVENTS_MAX);
    hear_signals(heard, sender.clone())?;
    let (mut restarts, mut wait, mut asked_to_end) = (0, WAIT_FIRST, false);
    loop {
        let started = clock.now();
        let status = watch_one(make(restarts), &sender, &events, &mut asked_to_end)?;
        if asked_to_end || !has_crashed(status) {
            return Ok(code_of(status));
        }
        if clock.now().since(started) >= GOOD_RUN {
            wait = WAIT_FIRST;
        }
        restarts += 1;
        tracing::error!("the hub has crashed ({status}); start {restarts} after this in {wait:?}");
        if told_to_end_within(&events, wait) {
            return Ok(code_of(status));
        }
        wait = (wait * 2).min(WAIT_MAX);
    }
}

/// Runs one child to its end.
fn watch_one(
    mut command: Command,
    sender: &SyncSender<Event>,
    events: &Receiver<Event>,
    asked_to_end: &mut bool,
) -> io::Result<ExitStatus> {
    // In a group of its own, so that Ctrl-C reaches it once, through this parent, and not twice.
    let mut child = command.process_group(0).spawn()?;
    let pid = Pid::from_raw(child.id().cast_signed());
    hear_end(pid, sender.clone()).inspect_err(|_| end(&mut child))?;
    loop {
        match events.recv() {
            Ok(Event::Ended(ended)) if ended == pid => return child.wait(),
            Ok(Event::Ended(_)) => {}
            Ok(Event::Told(signal)) => {
                *asked_to_end |= matches!(signal, Signal::SIGINT | Signal::SIGTERM);
                // The child is there or waits to be buried: its process id is nobody else's.
                let _ = kill(pid, signal);
            }
            Err(_) => {
                end(&mut child);
                return Err(io::Error::other("signals are heard no more"));
            }
        }
    }
}

fn end(child: &mut Child) {
    // It may have ended by itself.
    let _ = child.kill();
    let _ = child.wait();
}

fn hear_signals(heard: SigSet, sender: SyncSender<Event>) -> io::Result<()> {
    let hear = move || {
        while let Ok(signal) = heard.wait() {
            if sender.send(Event::Told(signal)).is_err() {
                return;
            }
        }
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(hear).map(|_| ())
}

/// Waits for the child's end without burying it, so that no signal can reach another process of its number.
fn hear_end(pid: Pid, sender: SyncSender<Event>) -> io::Result<()> {
    let hear = move || {
        let ended = WaitPidFlag::WEXITED | WaitPidFlag::WNOWAIT;
        while waitid(Id::Pid(pid), ended) == Err(nix::errno::Errno::EINTR) {}
        // Nobody listens only when this process is ending itself.
        let _ = sender.send(Event::Ended(pid));
    };
    std::thread::Builder::new().name("child".to_owned()).spawn(hear).map(|_| ())
}

/// Waits before the next start; answers whether the wait was ended by a signal that asks for the end.
fn told_to_end_within(events: &Receiver<Event>, wait: Duration) -> bool {
    loop {
        match events.recv_timeout(wait) {
            Ok(Event::Told(Signal::SIGINT | Signal::SIGTERM)) => return true,
            // The hub that shall read its configuration again reads it in a moment.
            Ok(_) => {}
            Err(RecvTimeoutError::Timeout) => return false,
            Err(RecvTimeoutError::Disconnected) => return true,
        }
    }
}

/// Whether a new start may help: it was killed, or panicked. What ends with a code has said why.
fn has_crashed(status: ExitStatus) -> bool {
    /// What the Rust runtime ends a process with whose main thread panicked.
    const PANICKED: i32 = 101;
    status.code().is_none_or(|code| code == PANICKED)
}

fn code_of(status: ExitStatus) -> u8 {
    let signal = status.signal().and_then(|signal| u8::try_from(signal).ok()).unwrap_or(0);
    status
        .code()
        .and_then(|code| u8::try_from(code).ok())
        .unwrap_or_else(|| SIGNAL_EXIT.saturating_add(signal))
}

/// Called by the hub at its start: if it has a supervisor, the end of that is a SIGTERM for the hub, so that no hub is
/// left behind. Answers how often it was started again.
pub fn tie_to_supervisor() -> Option<u64> {
    let number = |name: &str| std::env::var(name).ok()?.parse::<u64>().ok();
    let supervisor = number(SUPERVISOR_VARIABLE)?;
    let is_parent = || u64::from(getppid().as_raw().cast_unsigned()) == supervisor;
    if !is_parent() {
        // The variable was inherited from a hub further up.
        return None;
    }
    if let Err(error) = nix::sys::prctl::set_pdeathsig(Signal::SIGTERM) {
        tracing::warn!("the end of the supervisor would not be heard: {error}");
    }
    if !is_parent() {
        tracing::error!("the supervisor has ended before the hub began: nobody starts it again");
    }
    number(RESTARTS_VARIABLE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_a_new_start_may_help_is_a_crash() {
        let code = |code: i32| ExitStatus::from_raw(code << 8);
        let killed = |signal: Signal| ExitStatus::from_raw(signal as i32);
        assert!(has_crashed(killed(Signal::SIGABRT)) && has_crashed(killed(Signal::SIGSEGV)));
        assert!(has_crashed(code(101)));
        assert!(!has_crashed(code(0)) && !has_crashed(code(1)) && !has_crashed(code(2)));
        assert_eq!((code_of(code(2)), code_of(killed(Signal::SIGABRT))), (2, 134));
    }
}
