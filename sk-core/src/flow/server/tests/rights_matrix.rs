//! Every command with every right, made from the table: what is not granted is refused, and nothing but the right
//! that the table names opens a command.

use super::accounts::{flow_of, log_in};
use super::rights::{grant, hub_with};
use super::*;
use crate::flow::{Definition, Right, table::samples};

fn sample(line: &Definition) -> Command {
    let samples = samples::commands([0; 32]).expect("small");
    samples
        .into_iter()
        .find(|sample| sample.definition() == line)
        .expect("one of each")
}

/// Sends the sample of a command on a connection of an account with these rights, for every name; answers why it
/// was refused, if it was.
fn refused_with(line: &Definition, state: State, rights: &[Right]) -> Option<RefusalCode> {
    let (mut hub, mut owner) = hub_with(&["ada"]);
    for right in rights {
        grant(&mut hub, &mut owner, "ada", right.name(), &["*"]);
    }
    let mut raw = match state {
        State::Flow => flow_of(&mut hub, "ada"),
        _ => log_in(&mut hub, "ada"),
    };
    let flags = if line.fragment { Flags::WHOLE } else { Flags::NONE };
    raw.send_flagged(&mut hub, 5, flags, &sample(line));
    let events = raw.read(&mut hub);
    assert_eq!(hub.spurious(), 0, "{} is honest in {state}", line.name);
    assert_eq!(hub.widened_rights(), [""; 0]);
    refusal(&events, 5)
}

#[test]
fn s92_no_command_goes_without_its_right_and_no_other_right_stands_for_it() {
    let mut cells = 0;
    for line in Command::TABLE.iter().filter(|line| line.right != Right::Nothing) {
        for state in [State::Synchronous, State::Flow] {
            if !line.states.has(state) {
                continue;
            }
            let all_but = Right::ALL.into_iter().filter(|right| *right != line.right);
            let found = refused_with(line, state, &all_but.collect::<Vec<_>>());
            assert_eq!(found, Some(RefusalCode::Denied), "{} in {state} without its right", line.name);
            for right in Right::ALL.into_iter().filter(|right| *right != line.right) {
                let found = refused_with(line, state, &[right]);
                assert_eq!(found, Some(RefusalCode::Denied), "{} in {state} with {right:?}", line.name);
                cells += 1;
            }
            let found = refused_with(line, state, &Right::ALL);
            assert_ne!(found, Some(RefusalCode::Denied), "{} in {state} with all rights", line.name);
        }
    }
    assert!(cells > 400, "{cells}");
}

#[test]
fn a_new_account_may_greet_ask_and_become_a_flow_and_no_more() {
    // These are for the owner of what they name; what they name is not there, or is another's.
    let own = ["remove_channel", "change_header", "detach", "db_select", "user_set", "blob_commit"];
    for line in Command::TABLE.iter().filter(|line| line.states.has(State::Synchronous)) {
        let found = refused_with(line, State::Synchronous, &[]);
        let free = ["ping", "pong", "set_async"].contains(&line.name);
        assert_eq!(found.is_none(), free, "{}: {found:?}", line.name);
        assert!(free || own.contains(&line.name) || found == Some(RefusalCode::Denied), "{}", line.name);
    }
}
