//! The hub and its tool as processes, for the tests that meet them as a user does.

#![allow(dead_code, reason = "each test binary uses a part")]

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};

/// A hub process with a state folder of its own, ended and cleaned away at the end of a test.
pub struct Hub {
    pub process: Child,
    pub lines: BufReader<std::process::ChildStdout>,
    pub folder: PathBuf,
    pub greeting: Vec<String>,
}

pub fn new_folder() -> PathBuf {
    static NUMBER: AtomicU32 = AtomicU32::new(0);
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    std::env::temp_dir().join(format!("skrobot-test-{}-{number}", std::process::id()))
}

impl Hub {
    pub fn start() -> Hub {
        Hub::start_in(new_folder(), &["--tcp", "127.0.0.1:0"])
    }

    pub fn start_in(folder: PathBuf, options: &[&str]) -> Hub {
        Hub::start_with(folder, options, |_| {})
    }

    /// With what `change` says of the command: its environment.
    pub fn start_with(folder: PathBuf, options: &[&str], change: impl FnOnce(&mut Command)) -> Hub {
        let mut command = skrobot(&folder);
        change(&mut command);
        Hub::start_as(command, folder, options)
    }

    /// By another command than the usual one.
    pub fn start_as(mut command: Command, folder: PathBuf, options: &[&str]) -> Hub {
        let mut process = command
            .args(options)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(process.stdout.take().unwrap());
        let mut greeting = Vec::new();
        read_greeting(&mut lines, &mut greeting);
        Hub { process, lines, folder, greeting }
    }

    /// The next greeting, of a hub that was started again.
    pub fn greeted_again(&mut self) -> Vec<String> {
        let mut greeting = Vec::new();
        read_greeting(&mut self.lines, &mut greeting);
        greeting
    }

    /// Reads the log up to a line that contains this, and answers it.
    pub fn logged(&mut self, part: &str) -> String {
        let log = self.process.stderr.as_mut().expect("it is not read elsewhere");
        // Byte by byte: what comes after the line stays for the next one.
        let (mut line, mut byte) = (Vec::new(), [0]);
        loop {
            assert_ne!(log.read(&mut byte).unwrap(), 0, "the log ended before {part:?}");
            line.push(byte[0]);
            if byte[0] == b'\n' {
                let found = text(&line);
                if found.contains(part) {
                    return found;
                }
                line.clear();
            }
        }
    }

    pub fn sk(&self, arguments: &[&str]) -> Output {
        sk(&self.folder, arguments)
    }

    pub fn tcp(&self) -> String {
        let line = self
            .greeting
            .iter()
            .find_map(|line| line.split_once("tcp:"))
            .expect("it listens for TCP")
            .1;
        line.split_whitespace().next().unwrap().to_owned()
    }

    pub fn signal(&self, signal: nix::sys::signal::Signal) {
        nix::sys::signal::kill(nix::unistd::Pid::from_raw(self.process.id() as i32), signal).unwrap();
    }

    /// Waits for the end; answers whether it was a good one.
    pub fn end_by_itself(mut self) -> bool {
        self.process.wait().unwrap().success()
    }

    /// Ctrl-C, and what it said until its end.
    pub fn end(mut self) -> (bool, String, String) {
        self.signal(nix::sys::signal::Signal::SIGINT);
        let (mut out, mut log) = (String::new(), String::new());
        self.lines.read_to_string(&mut out).unwrap();
        self.process.stderr.take().unwrap().read_to_string(&mut log).unwrap();
        let status = self.process.wait().unwrap();
        (status.success(), out, log)
    }
}

fn read_greeting(lines: &mut impl BufRead, greeting: &mut Vec<String>) {
    loop {
        let mut line = String::new();
        assert_ne!(lines.read_line(&mut line).unwrap(), 0, "the hub ended: {greeting:?}");
        greeting.push(line.trim().to_owned());
        if line.contains("Ctrl-C") {
            return;
        }
    }
}

/// The hub's program, which sees nothing of the user's own configuration.
pub fn skrobot(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_skrobot"));
    command
        .env_remove("SKROBOT_CONFIG")
        .env("XDG_CONFIG_HOME", folder.join("config"));
    command.arg("--state-dir").arg(folder);
    command
}

impl Drop for Hub {
    fn drop(&mut self) {
        // One that has ended already cannot be killed; its folder goes all the same.
        let _ = self.process.kill();
        let _ = self.process.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

pub fn sk(folder: &Path, arguments: &[&str]) -> Output {
    sk_command(folder, arguments).output().unwrap()
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

impl Hub {
    /// As [`sk`](Hub::sk), with this on its standard input.
    pub fn sk_with_input(&self, arguments: &[&str], input: &str) -> Output {
        let mut process = sk_command(&self.folder, arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        std::io::Write::write_all(&mut process.stdin.take().unwrap(), input.as_bytes()).unwrap();
        process.wait_with_output().unwrap()
    }
}

fn sk_command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sk"));
    command.arg("--state-dir").arg(folder).args(arguments);
    command.env_remove("SKROBOT_HUB");
    command
}

/// A tool that goes on by itself, ended with its test.
pub struct Running {
    process: Child,
    out: Option<BufReader<std::process::ChildStdout>>,
}

impl Running {
    pub fn start(hub: &Hub, arguments: &[&str]) -> Running {
        let mut process = sk_command(&hub.folder, arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let out = process.stdout.take().map(BufReader::new);
        Running { process, out }
    }

    pub fn pid(&self) -> nix::unistd::Pid {
        nix::unistd::Pid::from_raw(self.process.id() as i32)
    }

    /// The next line that it prints.
    pub fn line(&mut self) -> String {
        let mut line = String::new();
        let read = self.out.as_mut().expect("its output is open").read_line(&mut line).unwrap();
        if read == 0 {
            let mut said = String::new();
            self.process.stderr.take().unwrap().read_to_string(&mut said).unwrap();
            panic!("it ended: {said}");
        }
        line.trim_end().to_owned()
    }

    pub fn close_output(&mut self) {
        self.out = None;
    }

    /// All that it prints until it ends by itself, which must be a good end.
    pub fn all(mut self) -> String {
        let mut all = String::new();
        self.out.take().unwrap().read_to_string(&mut all).unwrap();
        assert_eq!(self.end(), (Some(0), String::new()));
        all
    }

    /// Its exit code when it has ended by itself, and what it complained of.
    pub fn end(mut self) -> (Option<i32>, String) {
        let mut said = String::new();
        self.process.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        (self.process.wait().unwrap().code(), said)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// What it printed, after a good end without complaints.
pub fn success(output: &Output) -> String {
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()));
    text(&output.stdout)
}

/// What it complained of, after an end with this code.
pub fn failure(output: &Output, code: i32) -> String {
    assert_eq!(output.status.code(), Some(code), "{}{}", text(&output.stdout), text(&output.stderr));
    text(&output.stderr)
}

pub fn lines(output: &Output) -> Vec<String> {
    success(output).lines().map(str::to_owned).collect()
}

/// One JSON object a line.
pub fn objects(output: &Output) -> Vec<serde_json::Value> {
    success(output)
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}
