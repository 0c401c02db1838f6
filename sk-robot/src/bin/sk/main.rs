//! `sk`: looks into a running hub, and helps to write what runs in one.
#![forbid(unsafe_code)]

mod arguments;
mod blob;
mod echo;
mod ls;
mod module_new;
mod output;
mod session;

use arguments::{Arguments, Module, Task};
use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    if let Err(error) = sk_robot::logging::to_stderr(&arguments.log) {
        eprintln!("sk: --log {:?}: {error}", arguments.log);
        return ExitCode::from(2);
    }
    let outcome = match &arguments.task {
        Task::Ls(task) => ls::run(&arguments, task),
        Task::Echo(task) => echo::run(&arguments, task),
        Task::Blob(task) => blob::run(&arguments, task),
        Task::Module(Module::New(task)) => module_new::run(task),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("sk: {error}");
            ExitCode::FAILURE
        }
    }
}
