//! Running a program for a limited time, with all that it starts.

use nix::sys::signal::{Signal, killpg};
use nix::unistd::Pid;
use std::io::{self, Read};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};

/// How often a program that has closed its output is looked at until it has ended.
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// What became of a program.
pub(crate) enum Ended {
    /// It ended by itself, with this and what it wrote to its standard output.
    Itself(ExitStatus, Vec<u8>),
    /// It did not in time, and was killed.
    Killed,
}

/// Runs the program for at most `limit`. It gets a process group of its own, so that the programs it has
/// started are killed with it. While it runs nothing here wakes up, which would disturb what it measures.
pub(crate) fn run(command: &mut Command, limit: Duration) -> io::Result<Ended> {
    let deadline = Instant::now() + limit;
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).process_group(0).spawn()?;
    let (sender, receiver) = channel();
    if let Some(mut output) = child.stdout.take() {
        thread::spawn(move || {
            let mut written = Vec::new();
            let outcome = output.read_to_end(&mut written).map(|_| written);
            // The receiver is gone if the program was killed meanwhile.
            let _ = sender.send(outcome);
        });
    }
    let written = match receiver.recv_timeout(limit) {
        Ok(written) => written,
        Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return kill(&mut child),
    };
    while Instant::now() < deadline {
        if let Some(status) = child.try_wait()? {
            return Ok(Ended::Itself(status, written?));
        }
        thread::sleep(LOOK_EVERY);
    }
    kill(&mut child)
}

fn kill(child: &mut Child) -> io::Result<Ended> {
    // It may have ended by itself just now, and its group with it.
    let _ = killpg(Pid::from_raw(child.id().cast_signed()), Signal::SIGKILL);
    child.wait()?;
    Ok(Ended::Killed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str) -> Command {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        command
    }

    #[test]
    fn what_a_program_writes_and_how_it_ends_comes_back() {
        let ended = run(&mut shell("echo told; exit 3"), Duration::from_secs(60)).unwrap();
        assert!(
            matches!(ended, Ended::Itself(status, told) if status.code() == Some(3) && told == b"told\n")
        );
    }

    #[test]
    fn a_program_that_hangs_is_killed_with_those_it_started() {
        // The inner one would keep the pipe open.
        let mut command = shell("echo $$; tail -f /dev/null & wait");
        assert!(matches!(run(&mut command, Duration::from_millis(50)).unwrap(), Ended::Killed));
    }

    #[test]
    fn a_program_that_has_closed_its_output_and_hangs_is_killed() {
        let mut command = shell("exec >/dev/null; exec tail -f /dev/null");
        assert!(matches!(run(&mut command, Duration::from_millis(50)).unwrap(), Ended::Killed));
    }

    #[test]
    fn a_killed_program_leaves_nobody_behind() {
        let (mut end, start) = nix::unistd::pipe()
            .map(|(end, start)| (std::fs::File::from(end), start))
            .unwrap();
        let mut command = shell("tail -f /dev/null >&2 & exec tail -f /dev/null");
        // Its end of the pipe is open as long as any of them lives.
        command.stderr(Stdio::from(start));
        assert!(matches!(run(&mut command, Duration::from_millis(50)).unwrap(), Ended::Killed));
        drop(command);
        assert_eq!(
            end.read_to_end(&mut Vec::new()).unwrap(),
            0,
            "read to the end, because all have closed it"
        );
    }
}
