//! Passwords: typed without an echo, read from a line of standard input, or from a file that is nobody else's.
//! Never from the command line, which every process of the machine can read.

use nix::sys::termios::{LocalFlags, SetArg, Termios, tcgetattr, tcsetattr};
use sk_core::flow::scram::Password;
use sk_core::world::World;
use std::io::{self, IsTerminal, Read, Write};
use std::path::Path;

/// What is longer is something else.
const PASSWORD_BYTES_MAX: usize = 1024;

/// The password of a file: its text without the line end.
pub fn from_file(world: &World, path: &Path) -> Result<Password, String> {
    let said = |error: io::Error| format!("{}: {error}", path.display());
    // By its full path: a storage knows no working folder.
    let whole = std::path::absolute(path).map_err(said)?;
    let (_, mode) = world.storage.owner_and_mode(&whole).map_err(said)?;
    if mode & 0o077 != 0 {
        let mode = mode & 0o777;
        return Err(format!(
            "{} has mode {mode:03o}, so others can read the password: chmod 600",
            path.display()
        ));
    }
    let bytes = world.storage.read(&whole, PASSWORD_BYTES_MAX as u64 + 2).map_err(said)?;
    checked(bytes).map_err(|why| format!("{}: {why}", path.display()))
}

/// A password that is known: asked for at a terminal, else the next line of standard input.
pub fn known(whose: &str) -> Result<Password, String> {
    match io::stdin().is_terminal() {
        true => typed(&format!("Password of {whose}: ")),
        false => next_line(),
    }
}

/// A new password: asked for twice at a terminal, else the next line of standard input.
pub fn new(whose: &str) -> Result<Password, String> {
    if !io::stdin().is_terminal() {
        return next_line();
    }
    let first = typed(&format!("New password of {whose}: "))?;
    let second = typed("Once more: ")?;
    if first == second { Ok(first) } else { Err("the two passwords differ".to_owned()) }
}

fn checked(mut bytes: Vec<u8>) -> Result<Password, String> {
    for end in [b'\n', b'\r'] {
        if bytes.last() == Some(&end) {
            bytes.pop();
        }
    }
    if bytes.is_empty() {
        return Err("the password is empty".to_owned());
    }
    if bytes.len() > PASSWORD_BYTES_MAX {
        return Err(format!("a password has at most {PASSWORD_BYTES_MAX} bytes"));
    }
    let text = String::from_utf8(bytes).map_err(|_| "the password is not UTF-8".to_owned())?;
    if text.contains(['\n', '\r', '\0']) {
        return Err("a password is one line".to_owned());
    }
    Ok(Password::new(text))
}

/// One line, byte by byte: what follows it is for the next one who reads.
fn next_line() -> Result<Password, String> {
    let (mut line, mut byte) = (Vec::new(), [0]);
    let mut input = io::stdin().lock();
    while input.read(&mut byte).map_err(|error| format!("standard input: {error}"))? != 0 {
        if byte[0] == b'\n' {
            break;
        }
        line.push(byte[0]);
        if line.len() > PASSWORD_BYTES_MAX {
            break;
        }
    }
    checked(line)
}

/// Turns the echo off, and on again at its end.
struct Silence(Termios);

impl Silence {
    fn begin() -> nix::Result<Silence> {
        let before = tcgetattr(io::stdin())?;
        let mut silent = before.clone();
        silent.local_flags.remove(LocalFlags::ECHO);
        tcsetattr(io::stdin(), SetArg::TCSAFLUSH, &silent)?;
        Ok(Silence(before))
    }
}

impl Drop for Silence {
    fn drop(&mut self) {
        // A terminal that is gone has no echo either.
        let _ = tcsetattr(io::stdin(), SetArg::TCSAFLUSH, &self.0);
    }
}

fn typed(prompt: &str) -> Result<Password, String> {
    let said = |error: io::Error| format!("the terminal: {error}");
    let silence = Silence::begin().map_err(|error| said(error.into()))?;
    let mut out = io::stderr();
    out.write_all(prompt.as_bytes()).and_then(|()| out.flush()).map_err(said)?;
    let line = next_line();
    drop(silence);
    out.write_all(b"\n").map_err(said)?;
    line
}
