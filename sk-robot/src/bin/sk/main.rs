//! `sk`: looks into a running hub, and helps to write what runs in one.
#![forbid(unsafe_code)]

mod arguments;
mod blob;
mod call;
mod database;
mod doctor;
mod echo;
mod graph;
mod hz;
mod info;
mod ls;
mod machine;
mod module;
mod module_new;
mod names;
mod output;
mod password;
mod publish;
mod pulse;
mod session;
mod table;
mod user;
mod why;

use arguments::{Arguments, Completions, Task};
use clap::{CommandFactory, Parser};
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    if let Err(error) = sk_robot::logging::to_stderr(&arguments.log) {
        eprintln!("sk: --log {:?}: {error}", arguments.log);
        return ExitCode::from(2);
    }
    let outcome = match &arguments.task {
        Task::Ls(task) => ls::run(&arguments, task),
        Task::Info(task) => info::run(&arguments, task),
        Task::Graph(task) => graph::run(&arguments, task),
        Task::Echo(task) => echo::run(&arguments, task),
        Task::Blob(task) => blob::run(&arguments, task),
        Task::User(task) => user::run(&arguments, task),
        Task::Pub(task) => publish::run(&arguments, task),
        Task::Hz(task) => hz::run(&arguments, task),
        Task::Call(task) => call::run(&arguments, task),
        Task::Db(task) => database::run(&arguments, task),
        Task::Module(task) => module::run(&arguments, task),
        Task::Why(task) => why::run(&arguments, task),
        Task::Doctor => doctor::run(&arguments),
        Task::Completions(task) => completions(task),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("sk: {error}");
            ExitCode::FAILURE
        }
    }
}

fn completions(task: &Completions) -> Result<(), String> {
    let mut text = Vec::new();
    clap_complete::generate(task.shell, &mut Arguments::command(), "sk", &mut text);
    output::write(&text).map(|_| ())
}
