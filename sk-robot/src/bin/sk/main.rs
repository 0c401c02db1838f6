//! `sk`: looks into a running hub, and helps to write what runs in one.
#![forbid(unsafe_code)]

mod arguments;
mod command_line;
mod commands;
mod names;
mod output;
mod password;
mod session;
mod table;

use clap::{CommandFactory, Parser};
use command_line::{CommandLine, Task};
use commands::{
    blob, call, completions, database, doctor, echo, graph, hz, info, ls, module, publish, user, why,
};
use std::process::ExitCode;

fn main() -> ExitCode {
    let CommandLine { arguments, task } = CommandLine::parse();
    if let Err(error) = sk_robot::logging::to_stderr(&arguments.log) {
        eprintln!("sk: --log {:?}: {error}", arguments.log);
        return ExitCode::from(2);
    }
    let outcome = match &task {
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
        Task::Completions(task) => completions::run(task, CommandLine::command()),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("sk: {error}");
            ExitCode::FAILURE
        }
    }
}
