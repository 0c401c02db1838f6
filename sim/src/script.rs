//! What a run does, as a value: who takes part, and who does what when.
//!
//! A script with its seed is the whole run: the same script gives the same bytes at the same virtual times. It
//! can be written down as lines of text and read again, and a shrinker can delete from it.

use crate::action::Action;
use crate::words::{Words, name_of, named, number};
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// A run, completely.
///
/// ```
/// use sk_sim::script::Script;
///
/// let text = "seed 7\nnode 0 hub\nnode 1 satellite tcp\nat 1.500ms n1 open 0\n";
/// let script: Script = text.parse()?;
/// assert_eq!(script.to_string(), text);
/// # Ok::<(), sk_sim::script::ScriptError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Script {
    /// From it follows everything that chance decides while the script runs.
    pub seed: u64,
    /// Who takes part, with the numbers by which steps name them. Number 0 is the hub.
    pub nodes: Vec<(u16, Role)>,
    /// What happens, in order of time.
    pub steps: Vec<Step>,
}

/// One thing that happens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Step {
    /// When, in microseconds of virtual time.
    pub at_us: u64,
    /// To whom.
    pub node: u16,
    /// What.
    pub action: Action,
}

/// What a node is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The hub.
    Hub,
    /// A satellite as programs have it, an `SkFlowSat` on a machine of its own.
    Satellite(Way),
    /// A satellite inside the hub's process with limited rights.
    Inside {
        /// On a thread of its own.
        thread: bool,
        /// It may open channels and publish.
        publish: bool,
        /// It may subscribe.
        subscribe: bool,
    },
    /// A client of another make: the protocol's core over a plain socket. It can do what `SkFlowSat` does not offer,
    /// such as reading slowly.
    Plain(Way),
    /// A client that asks for the newest messages of channels instead of hearing all.
    Poller(Way),
    /// A client that serves and calls.
    Talker,
    /// A satellite that keeps things in databases, and watches those of others. If there is one, the hub has a store.
    Scribe(Way),
    /// Another hub, on a machine of its own, with other addresses and another owner's token.
    OtherHub,
    /// A satellite of another hub: of that node's.
    Guest(Way, u16),
    /// A client that follows the undisturbed pair's ticks on a way without fault, and counts itself what the hub tells it.
    Follower,
    /// A satellite that keeps files in a blob channel, and looks at those of others. If there is one, the hub has a place
    /// for them.
    Filer(Way),
    /// A client that is not honest.
    Wild,
    /// The undisturbed pair's first: it publishes all the time.
    Speaker,
    /// The undisturbed pair's second: it must miss nothing, whatever the others suffer.
    Listener,
}

/// How a satellite reaches its hub.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// TCP, with the owner's token.
    Tcp,
    /// A Unix socket, by user id.
    Unix,
    /// WebSocket in the hub's HTTP port, with the owner's token.
    Web,
}

/// Their names in scripts.
const WAYS: [(Way, &str); 3] = [(Way::Tcp, "tcp"), (Way::Unix, "unix"), (Way::Web, "web")];

/// Why a text is no script.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("line {line}: {what}: {text:?}")]
pub struct ScriptError {
    /// Counted from 1.
    pub line: usize,
    /// What was expected.
    pub what: &'static str,
    /// The line.
    pub text: String,
}

impl Script {
    /// The role of a node, if it takes part.
    pub fn role(&self, node: u16) -> Option<Role> {
        self.nodes.iter().find(|(number, _)| *number == node).map(|(_, role)| *role)
    }

    /// When the last step is, in microseconds.
    pub fn end_us(&self) -> u64 {
        self.steps.last().map_or(0, |step| step.at_us)
    }
}

impl fmt::Display for Script {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "seed {}", self.seed)?;
        for (number, role) in &self.nodes {
            writeln!(f, "node {number} {role}")?;
        }
        for Step { at_us, node, action } in &self.steps {
            writeln!(f, "at {}.{:03}ms n{node} {action}", at_us / 1000, at_us % 1000)?;
        }
        Ok(())
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Role::Hub => f.write_str("hub"),
            Role::Satellite(way) => write!(f, "satellite {way}"),
            Role::Inside { thread, publish, subscribe } => {
                f.write_str(if *thread { "inside thread" } else { "inside loop" })?;
                f.write_str(if *publish { " publish" } else { "" })?;
                f.write_str(if *subscribe { " subscribe" } else { "" })
            }
            Role::Plain(way) => write!(f, "plain {way}"),
            Role::Poller(way) => write!(f, "poller {way}"),
            Role::Filer(way) => write!(f, "filer {way}"),
            Role::Scribe(way) => write!(f, "scribe {way}"),
            Role::OtherHub => f.write_str("other-hub"),
            Role::Guest(way, hub) => write!(f, "guest {way} {hub}"),
            Role::Follower => f.write_str("follower"),
            Role::Talker => f.write_str("talker"),
            Role::Wild => f.write_str("wild"),
            Role::Speaker => f.write_str("speaker"),
            Role::Listener => f.write_str("listener"),
        }
    }
}

impl fmt::Display for Way {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(name_of(&WAYS, self))
    }
}

impl Role {
    /// It is a hub.
    pub fn is_hub(self) -> bool {
        matches!(self, Role::Hub | Role::OtherHub)
    }

    /// The number of the hub that it belongs to.
    pub fn hub(self) -> u16 {
        match self {
            Role::Guest(_, hub) => hub,
            _ => 0,
        }
    }

    /// Its own ways are left alone, whatever happens to others.
    pub fn is_undisturbed(self) -> bool {
        matches!(self, Role::Speaker | Role::Listener | Role::Follower)
    }

    fn parse(words: &mut Words<'_>) -> Option<Role> {
        Some(match words.next()? {
            "hub" => Role::Hub,
            "satellite" => Role::Satellite(Way::parse(words)?),
            "plain" => Role::Plain(Way::parse(words)?),
            "poller" => Role::Poller(Way::parse(words)?),
            "filer" => Role::Filer(Way::parse(words)?),
            "scribe" => Role::Scribe(Way::parse(words)?),
            "other-hub" => Role::OtherHub,
            "guest" => Role::Guest(Way::parse(words)?, number(words)?),
            "follower" => Role::Follower,
            "talker" => Role::Talker,
            "wild" => Role::Wild,
            "speaker" => Role::Speaker,
            "listener" => Role::Listener,
            "inside" => {
                let thread = match words.next()? {
                    "thread" => true,
                    "loop" => false,
                    _ => return None,
                };
                let rest: Vec<&str> = words.collect();
                if !rest.iter().all(|word| ["publish", "subscribe"].contains(word)) {
                    return None;
                }
                let has = |right: &str| rest.contains(&right);
                Role::Inside { thread, publish: has("publish"), subscribe: has("subscribe") }
            }
            _ => return None,
        })
    }
}

impl Way {
    fn parse(words: &mut Words<'_>) -> Option<Way> {
        named(&WAYS, words)
    }
}

impl FromStr for Script {
    type Err = ScriptError;

    fn from_str(text: &str) -> Result<Script, ScriptError> {
        let mut script = Script { seed: 0, nodes: Vec::new(), steps: Vec::new() };
        for (index, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or_default().trim();
            if line.is_empty() {
                continue;
            }
            let wrong = |what| ScriptError { line: index + 1, what, text: line.to_owned() };
            let mut words = line.split_ascii_whitespace();
            match words.next() {
                Some("seed") => {
                    script.seed = number(&mut words).ok_or_else(|| wrong("`seed NUMBER` is expected"))?;
                }
                Some("node") => {
                    let node = number(&mut words).zip(Role::parse(&mut words));
                    let node = node.ok_or_else(|| wrong("`node NUMBER ROLE …` is expected"))?;
                    script.nodes.push(node);
                }
                Some("at") => {
                    let step = Step::parse(&mut words);
                    let step = step.ok_or_else(|| wrong("`at TIMEms nNUMBER ACTION …` is expected"))?;
                    if step.at_us < script.end_us() {
                        return Err(wrong("steps stand in order of time"));
                    }
                    script.steps.push(step);
                }
                _ => return Err(wrong("a line begins with `seed`, `node` or `at`")),
            }
            if words.next().is_some() {
                return Err(wrong("there are too many words"));
            }
        }
        Ok(script)
    }
}

impl Step {
    fn parse(words: &mut Words<'_>) -> Option<Step> {
        let (whole, thousandths) = words.next()?.strip_suffix("ms")?.split_once('.')?;
        if thousandths.len() != 3 {
            return None;
        }
        let at_us = whole.parse::<u64>().ok()?.checked_mul(1000)? + thousandths.parse::<u64>().ok()?;
        let node = words.next()?.strip_prefix('n')?.parse().ok()?;
        Some(Step { at_us, node, action: Action::parse(words)? })
    }
}
