//! How processes begin and end.

use crate::actors::Member;
use crate::identity::Identity;
use crate::ledger;
use crate::parts::{Actor, Part, Parts};
use crate::script::Role;
use crate::start::{HubStart, start_actor};
use sk_core::flow::{Right, Rights, SkFlowSat};
use sk_core::prelude::*;
use sk_core::world::{Death, SimulatedRng};

/// How long a loop without news waits; long, because simulated rounds cost real time.
const INTERVAL: Duration = Duration::from_millis(250);

impl Parts {
    /// Starts a node's process, unless it runs.
    pub(crate) fn start(&mut self, number: u16, hub: &HubStart) {
        let Some(part) = self.all.get_mut(&number) else { return };
        if part.actor.is_some() || part.thread.is_some() {
            return;
        }
        let who = part.identity(number);
        if let Role::Inside { .. } = part.role {
            return self.start_inside(who);
        }
        let role = part.role;
        let name = format!("n{number}");
        let node = self.simulation.node(&part.machine, &name, |settings| {
            settings.mode = TimingMode::SelectIo;
            settings.interval = INTERVAL;
            settings.slow_interval = INTERVAL;
        });
        ledger::with(|ledger| ledger.begins(who));
        let actor = node.with(|cx| start_actor(cx, who, role, hub));
        if actor.is_none() {
            // It could not begin; it may be started again.
            part.machine = node.quit();
            return;
        }
        part.node = Some(node);
        part.actor = actor;
        if role == Role::Hub {
            self.insiders().into_iter().for_each(|number| self.start(number, hub));
        }
    }

    fn start_inside(&mut self, who: Identity) {
        let Some(&Role::Inside { thread, publish, subscribe }) = self.all.get(&who.node).map(|p| &p.role)
        else {
            return;
        };
        let Some((node, server)) = self.hub(0) else { return };
        ledger::with(|ledger| ledger.begins(who));
        let mut rights = Rights::NONE;
        if publish {
            rights = rights.with(Right::Publish);
        }
        if subscribe {
            rights = rights.with(Right::Subscribe);
        }
        let started = node.with(|cx| {
            let seed = server.pipe(cx, rights).ok()?;
            if !thread {
                let hub = SkFlowSat::inside(cx, seed);
                return Some((Some(Actor::Member(Member::start(cx, who, hub))), None));
            }
            let thread = SkThread::new("inside")
                .mode(TimingMode::SelectIo)
                .interval(INTERVAL)
                .start(cx)
                .ok()?;
            let remote = thread.build(move |cx| {
                let hub = SkFlowSat::inside(cx, seed);
                let member = Member::start(cx, who, hub);
                cx.remote(member)
            });
            let remote = remote.ok()?;
            Some((None, Some((thread, remote))))
        });
        if let (Some((actor, thread)), Some(part)) = (started, self.all.get_mut(&who.node)) {
            part.actor = actor;
            part.thread = thread;
        }
    }

    /// Ends a node's process, if it runs.
    pub(crate) fn end(&mut self, number: u16, death: Option<Death>, chances: &mut SimulatedRng) {
        if self.all.get(&number).is_none_or(|part| part.node.is_none()) {
            return;
        }
        // Those inside the hub end with it; their threads are dropped after they have died.
        let mut threads = Vec::new();
        if number == 0 {
            for insider in self.insiders() {
                if let Some(part) = self.all.get_mut(&insider) {
                    part.actor = None;
                    part.life += 1;
                    threads.extend(part.thread.take());
                }
            }
            ledger::with(|ledger| ledger.pair = None);
        }
        let Some(part) = self.all.get_mut(&number) else { return };
        let Some(node) = part.node.take() else { return };
        ledger::with(|ledger| {
            if part.role.is_hub() {
                ledger.hub_ends(number);
            }
            ledger.forget_calls(number);
            ledger.hears_all.retain(|(node, _), _| *node != number);
            ledger.files.abandon(number);
            ledger.archive.abandon(|database| database.starts_with(&format!("n{number}.")));
        });
        part.actor = None;
        part.life += 1;
        part.machine = match death {
            Some(death) => node.die(death, chances),
            None => node.quit(),
        };
    }

    /// One inside the hub leaves.
    pub(crate) fn leave_inside(&mut self, number: u16) {
        let Some(part) = self.all.get_mut(&number) else { return };
        let (actor, thread) = (part.actor.take(), part.thread.take());
        match (actor, thread) {
            (_, Some((thread, _))) => thread.stop(),
            (Some(Actor::Member(member)), None) => {
                let Some((node, _)) = self.hub(0) else { return };
                node.with(|cx| {
                    let hub = cx.with(member, |member, _| member.hub());
                    cx.destroy_later(member);
                    if let Ok(hub) = hub {
                        cx.destroy_later(hub);
                    }
                });
            }
            _ => {}
        }
    }
}

impl Part {
    fn identity(&self, node: u16) -> Identity {
        let way = match self.role {
            Role::Satellite(way) | Role::Guest(way, _) => Some(way),
            _ => None,
        };
        let invited = self.astray.is_none() || way.is_some_and(|way| way.opens_any_hub());
        Identity { node, life: self.life, hub: self.hub(), home: self.role.hub(), invited }
    }
}
