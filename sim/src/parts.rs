//! Those who take part in a run: who they are, on which machine, and whether they live.

use crate::actors::{Filer, Follower, Member, Plain, Poller, Scribe, Talker, Wild};
use crate::script::{Role, Script};
use sk_core::flow::SkFlowServer;
use sk_core::prelude::*;
use sk_core::testing::{Node, Simulation};
use sk_core::world::SimulatedWorld;
use std::collections::BTreeMap;

/// Who acts on a node.
#[derive(Clone, Copy)]
pub(crate) enum Actor {
    Hub(Handle<SkFlowServer>),
    Member(Handle<Member>),
    Plain(Handle<Plain>),
    Talker(Handle<Talker>),
    Wild(Handle<Wild>),
    Scribe(Handle<Scribe>),
    Follower(Handle<Follower>),
    Poller(Handle<Poller>),
    Filer(Handle<Filer>),
}

/// One that takes part.
pub(crate) struct Part {
    pub(crate) role: Role,
    pub(crate) life: u16,
    pub(crate) machine: SimulatedWorld,
    /// Its process, if it runs and is not the hub's.
    pub(crate) node: Option<Node>,
    pub(crate) actor: Option<Actor>,
    /// Of one inside the hub, on a thread of its own.
    pub(crate) thread: Option<(SkThread, Remote<Member>)>,
    /// It calls another hub than its own.
    pub(crate) astray: Option<u16>,
}

impl Part {
    /// The number of the hub that it calls.
    pub(crate) fn hub(&self) -> u16 {
        self.astray.unwrap_or(self.role.hub())
    }
}

/// All of them, by number, and the world they live in.
pub(crate) struct Parts {
    pub(crate) simulation: Simulation,
    pub(crate) all: BTreeMap<u16, Part>,
}

impl Parts {
    /// Nobody lives yet.
    pub(crate) fn new(script: &Script) -> Parts {
        let simulation = Simulation::new(script.seed);
        let part = |&(number, role): &(u16, Role)| {
            let machine = match role {
                Role::Hub | Role::Inside { .. } => simulation.world().clone(),
                _ => simulation.world().machine(),
            };
            let (node, actor, thread, astray) = (None, None, None, None);
            (number, Part { role, life: 0, machine, node, actor, thread, astray })
        };
        let all = script.nodes.iter().map(part).collect();
        Parts { simulation, all }
    }

    pub(crate) fn numbers(&self) -> Vec<u16> {
        self.all.keys().copied().collect()
    }

    /// The numbers of those with such a role.
    pub(crate) fn with_role(&self, is: impl Fn(Role) -> bool) -> Vec<u16> {
        let them = self.all.iter().filter(|(_, part)| is(part.role));
        them.map(|(number, _)| *number).collect()
    }

    pub(crate) fn hubs(&self) -> Vec<u16> {
        self.with_role(Role::is_hub)
    }

    pub(crate) fn insiders(&self) -> Vec<u16> {
        self.with_role(|role| matches!(role, Role::Inside { .. }))
    }

    /// A hub's process and its server, while it runs.
    pub(crate) fn hub(&self, number: u16) -> Option<(&Node, Handle<SkFlowServer>)> {
        let part = self.all.get(&number)?;
        match (&part.node, part.actor) {
            (Some(node), Some(Actor::Hub(server))) => Some((node, server)),
            _ => None,
        }
    }

    /// The process of a node; of one inside the hub, the hub's.
    pub(crate) fn node_of(&self, number: u16) -> Option<&Node> {
        let part = self.all.get(&number)?;
        match part.role {
            Role::Inside { .. } => self.hub(0).map(|(node, _)| node),
            _ => part.node.as_ref(),
        }
    }
}
