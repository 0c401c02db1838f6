//! Running other programs: with their output let through, watched, or kept in a log.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// How often a program with a time limit is looked at.
const POLL_MS: u64 = 20;
/// How many lines of a failed program's log are shown.
const LOG_TAIL_LINES: usize = 60;

/// Why a command of this program did not succeed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// The program could not be started at all.
    #[error("cannot start `{program}`: {error}")]
    Start { program: String, error: io::Error },
    /// The program ran and said no.
    #[error("`{program}` failed ({status})")]
    Status { program: String, status: ExitStatus },
    /// The program did not end in time and was killed.
    #[error("`{program}` was killed: it did not end within {limit_s} s")]
    Late { program: String, limit_s: u64 },
    /// A file or folder could not be used.
    #[error("{}: {error}", path.display())]
    File { path: PathBuf, error: io::Error },
    /// Anything else, as a whole sentence.
    #[error("{0}")]
    Other(String),
}

impl Failure {
    /// The failure to use the file or folder at `path`.
    pub(crate) fn file(path: &Path, error: io::Error) -> Self {
        Failure::File { path: path.to_owned(), error }
    }
}

/// The cargo that started this program, so that its children use the same toolchain.
pub(crate) fn cargo() -> Command {
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

/// The command line as a person would type it.
pub(crate) fn spelled(command: &Command) -> String {
    let program = Path::new(command.get_program()).file_name().unwrap_or(command.get_program());
    let words = std::iter::once(program).chain(command.get_args());
    words.map(OsStr::to_string_lossy).collect::<Vec<_>>().join(" ")
}

/// Whether the program exists and answers with success. Its output is thrown away.
pub(crate) fn answers(command: &mut Command) -> bool {
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

/// Runs the program with its output let through.
pub(crate) fn run(command: &mut Command) -> Result<(), Failure> {
    let status = command.stdin(Stdio::null()).status();
    let status = status.map_err(|error| Failure::Start { program: spelled(command), error })?;
    judge(command, status)
}

/// Runs the program and returns what it wrote to its standard output.
pub(crate) fn read(command: &mut Command) -> Result<String, Failure> {
    let output = command.stdin(Stdio::null()).stderr(Stdio::inherit()).output();
    let output = output.map_err(|error| Failure::Start { program: spelled(command), error })?;
    judge(command, output.status)?;
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Runs the program and returns what it wrote to its standard output and to its standard error.
pub(crate) fn read_both(command: &mut Command) -> Result<(String, String), Failure> {
    let output = command.stdin(Stdio::null()).output();
    let output = output.map_err(|error| Failure::Start { program: spelled(command), error })?;
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    judge(command, output.status).inspect_err(|_| eprint!("{}", text(&output.stderr)))?;
    Ok((text(&output.stdout), text(&output.stderr)))
}

/// Runs the program with its output let through line by line, and returns all lines as well.
pub(crate) fn run_and_listen(command: &mut Command) -> Result<Vec<String>, Failure> {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command
        .spawn()
        .map_err(|error| Failure::Start { program: spelled(command), error })?;
    let errors = child
        .stderr
        .take()
        .map(|from| thread::spawn(move || pass_on(from, io::stderr())));
    let mut lines = child.stdout.take().map(|from| pass_on(from, io::stdout())).unwrap_or_default();
    if let Some(errors) = errors {
        lines.extend(errors.join().unwrap_or_default());
    }
    let status = child
        .wait()
        .map_err(|error| Failure::Start { program: spelled(command), error })?;
    judge(command, status)?;
    Ok(lines)
}

/// Runs the program with its output going to the file `log`, for at most `limit` if there is one. The end
/// of the log is shown only when the program fails.
pub(crate) fn run_logged(command: &mut Command, log: &Path, limit: Option<Duration>) -> Result<(), Failure> {
    let file = File::create(log).map_err(|error| Failure::file(log, error))?;
    let second = file.try_clone().map_err(|error| Failure::file(log, error))?;
    command.stdin(Stdio::null()).stdout(file).stderr(second);
    let outcome = run_limited(command, limit);
    if outcome.is_err() {
        show_tail(log);
    }
    outcome
}

fn run_limited(command: &mut Command, limit: Option<Duration>) -> Result<(), Failure> {
    let started = Instant::now();
    let program = spelled(command);
    let mut child = match command.spawn() {
        Ok(child) => child,
        Err(error) => return Err(Failure::Start { program, error }),
    };
    let Some(limit) = limit else {
        let status = child.wait().map_err(|error| Failure::Start { program, error })?;
        return judge(command, status);
    };
    loop {
        match child.try_wait() {
            Ok(Some(status)) => return judge(command, status),
            Ok(None) if started.elapsed() < limit => thread::sleep(Duration::from_millis(POLL_MS)),
            Ok(None) => {
                // It may have ended by itself meanwhile; either way it is gone after these two calls.
                let _ = child.kill();
                let _ = child.wait();
                return Err(Failure::Late { program, limit_s: limit.as_secs() });
            }
            Err(error) => return Err(Failure::Start { program, error }),
        }
    }
}

fn judge(command: &Command, status: ExitStatus) -> Result<(), Failure> {
    if status.success() { Ok(()) } else { Err(Failure::Status { program: spelled(command), status }) }
}

/// Copies lines from `from` to `to` as they come. A reader that went away does not stop the listening.
fn pass_on(from: impl Read, mut to: impl Write) -> Vec<String> {
    let mut lines = Vec::new();
    let mut reader = BufReader::new(from);
    let mut line = Vec::new();
    while reader.read_until(b'\n', &mut line).is_ok_and(|length| length > 0) {
        let _ = to.write_all(&line).and_then(|()| to.flush());
        lines.push(String::from_utf8_lossy(&line).trim_end().to_owned());
        line.clear();
    }
    lines
}

fn show_tail(log: &Path) {
    let Ok(bytes) = fs::read(log) else { return };
    let text = String::from_utf8_lossy(&bytes);
    let lines: Vec<_> = text.lines().collect();
    for line in lines.iter().skip(lines.len().saturating_sub(LOG_TAIL_LINES)) {
        eprintln!("    | {line}");
    }
    eprintln!("    whole output: {}", log.display());
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str) -> Command {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        command
    }

    fn log(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("xtask-process-{}-{name}.log", std::process::id()))
    }

    #[test]
    fn a_program_that_fails_is_named_with_its_status() {
        let failure = run(&mut shell("exit 3")).unwrap_err();
        assert_eq!(failure.to_string(), "`sh -c exit 3` failed (exit status: 3)");
    }

    #[test]
    fn a_program_that_does_not_exist_is_a_failure() {
        let failure = run(&mut Command::new("no-such-program-anywhere")).unwrap_err();
        assert!(failure.to_string().starts_with("cannot start `no-such-program-anywhere`"));
        assert!(!answers(&mut Command::new("no-such-program-anywhere")));
    }

    #[test]
    fn a_program_that_does_not_end_is_killed() {
        let log = log("late");
        let outcome = run_logged(&mut shell("exec tail -f /dev/null"), &log, Some(Duration::from_millis(50)));
        assert!(matches!(outcome, Err(Failure::Late { .. })), "{outcome:?}");
        fs::remove_file(log).unwrap();
    }

    #[test]
    fn the_log_holds_both_outputs() {
        let log = log("both");
        run_logged(&mut shell("echo out; echo err >&2"), &log, None).unwrap();
        assert_eq!(fs::read_to_string(&log).unwrap(), "out\nerr\n");
        fs::remove_file(log).unwrap();
    }

    #[test]
    fn listening_returns_the_lines_of_both_outputs() {
        let lines = run_and_listen(&mut shell("echo heard; echo also >&2")).unwrap();
        assert_eq!(lines, ["heard", "also"]);
        assert_eq!(read(&mut shell("echo read")).unwrap(), "read\n");
        let both = read_both(&mut shell("echo out; echo err >&2")).unwrap();
        assert_eq!(both, ("out\n".to_owned(), "err\n".to_owned()));
    }
}
