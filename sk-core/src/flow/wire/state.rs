//! How far a connection has come.

use std::fmt;

/// How far a connection has come. It only ever goes forward, one at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum State {
    /// Nothing but the first frame may come.
    Greeting = 0,
    /// The versions are agreed; a login is awaited.
    Login = 1,
    /// Logged in: each command is answered in order.
    Synchronous = 2,
    /// The connection is a satellite's flow: commands and events cross.
    Flow = 3,
}

impl State {
    /// All, in their order.
    pub const ALL: [State; 4] = [State::Greeting, State::Login, State::Synchronous, State::Flow];

    /// The state that comes next; a flow stays one.
    pub const fn next(self) -> State {
        match self {
            State::Greeting => State::Login,
            State::Login => State::Synchronous,
            State::Synchronous | State::Flow => State::Flow,
        }
    }
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            State::Greeting => "greeting",
            State::Login => "login",
            State::Synchronous => "synchronous",
            State::Flow => "flow",
        })
    }
}
