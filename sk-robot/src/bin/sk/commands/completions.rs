//! `sk completions`: what a shell needs to complete the command line.

use crate::output;
use clap::{Args, Command};

#[derive(Args, Debug)]
pub struct Completions {
    /// The shell
    pub shell: clap_complete::Shell,
}

pub fn run(task: &Completions, mut line: Command) -> Result<(), String> {
    let mut text = Vec::new();
    clap_complete::generate(task.shell, &mut line, "sk", &mut text);
    output::write(&text).map(|_| ())
}
