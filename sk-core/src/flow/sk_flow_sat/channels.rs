//! The channels that a satellite owns and those that it hears, over all links that it has in its life.

use super::SkFlowSat;
use crate::Cx;
use crate::flow::satellite::{ChannelInfo, SatelliteCore, SatelliteError};
use crate::flow::{ChannelRef, Policy};
use crate::testing::{Bug, is_planted};
use bytes::Bytes;
use sk_flat::SkVariant;

/// A channel that a satellite owns, whether there is a hub at the moment or not.
pub(super) struct Own {
    properties: SkVariant,
    channel: Option<ChannelRef>,
    /// The last message, if the channel has a latch: a hub that comes back is given it again.
    latched: Option<Bytes>,
    /// The hub does not have it.
    latch_is_due: bool,
    /// The full name of what it repeats.
    source: Option<String>,
    /// Its messages go by datagram where the hub takes them.
    pub(super) by_udp: bool,
}

impl Own {
    fn new(properties: SkVariant) -> Own {
        Own { properties, channel: None, latched: None, latch_is_due: false, source: None, by_udp: false }
    }

    pub(super) fn channel(&self) -> Option<ChannelRef> {
        self.channel
    }

    fn has_latch(&self) -> bool {
        self.properties.get("latch") == Some(&SkVariant::Bool(true))
    }

    fn send(&self, core: &mut SatelliteCore, channel: ChannelRef, payload: Bytes) -> bool {
        let sent =
            if self.by_udp { core.publish_by_udp(channel, payload) } else { core.publish(channel, payload) };
        sent == Ok(true)
    }

    /// The link is over.
    pub(super) fn forget_channel(&mut self) {
        self.channel = None;
    }
}

impl SkFlowSat {
    /// There is a flow: what this satellite had is had again, as far as the hub has not kept it.
    pub(super) fn restore(&mut self, cx: &mut Cx) {
        self.reconnect_after = super::RECONNECT_FIRST;
        self.was_ready = true;
        let Some(core) = &mut self.core else { return };
        self.session = core.session();
        // The hub may have said in the same breath that it ends: then all this is for the next one.
        if !core.is_ready() {
            return;
        }
        for name in std::mem::take(&mut self.renounced) {
            if core.is_resumed() && !self.wanted.contains_key(&name) {
                log_failure(&name, core.renounce(&name));
            }
        }
        for (name, own) in self.own.iter().filter(|(_, own)| own.channel.is_none()) {
            log_failure(name, core.create(name, &own.properties));
        }
        for (name, (policy, depth)) in self.wanted.iter().filter(|_| !is_planted(Bug::SubscriptionsForgotten))
        {
            log_failure(name, core.subscribe_as(name, *policy, *depth));
        }
        self.introduce_pulse(cx);
        let Some(core) = &mut self.core else { return };
        self.clerk.restore(core);
        self.porter.restore(core);
        self.restore_services(cx);
        self.restore_sync();
        self.ask_for_udp(cx);
        self.carry_on(cx);
    }

    /// A channel of this satellite's exists: it was opened, or (tag 0) kept by the hub.
    pub(super) fn created(&mut self, cx: &mut Cx, tag: u32, channel: ChannelRef, full_name: &str) {
        let name = own_name(full_name);
        let Some(own) = self.own.get_mut(name) else { return };
        own.channel = Some(channel);
        let Some(core) = &mut self.core else { return };
        if let Some(latched) = &own.latched
            && (tag != 0 || own.latch_is_due)
        {
            own.latch_is_due = core.publish(channel, latched.clone()) != Ok(true);
        }
        if tag == 0 && own.source.is_some() && core.is_ready() {
            // The hub may have kept the tie, or lost it with the source.
            log_failure(name, core.detach(channel));
        }
        attach_to_source(core, name, own);
        self.flush_later(cx);
    }

    /// A channel exists that one of this satellite's may be waiting to repeat.
    pub(super) fn repeat_new_source(&mut self, cx: &mut Cx, info: &ChannelInfo) {
        let Some(core) = self.core.as_mut().filter(|core| core.is_ready()) else { return };
        for (name, own) in &self.own {
            if own.source.as_deref() == Some(&info.name) {
                attach_to_source(core, name, own);
            }
        }
        self.flush_later(cx);
    }

    /// A channel is gone, and one of this satellite's own may have waited for its name: a hub keeps what a process had
    /// that vanished until it was silent for long enough, and refuses it to the next one.
    pub(super) fn name_is_free(&mut self, cx: &mut Cx, full_name: &str) {
        let Some(core) = self.core.as_mut().filter(|core| core.is_ready()) else { return };
        let ours = full_name
            .split_once('.')
            .filter(|(user, _)| core.user().is_some_and(|own| own.as_str() == *user));
        // What was asked for in its place may be there already, and only be told later.
        let is_ours_soon = core.is_creating(full_name) || core.owns(full_name);
        let Some((_, name)) = ours.filter(|_| !is_ours_soon) else { return };
        if let Some(own) = self.own.get(name).filter(|own| own.channel.is_none()) {
            log_failure(name, core.create(name, &own.properties));
        }
        self.services.open_if_missing(core, name);
        self.sync.open_if_missing(core, name);
        self.porter.open_if_missing(core, name);
        self.flush_later(cx);
    }

    pub(super) fn own_name_of(&self, channel: ChannelRef) -> Option<String> {
        let found = self.own.iter().find(|(_, own)| own.channel == Some(channel));
        found.map(|(name, _)| name.clone())
    }

    pub(super) fn is_listened(&self, name: &str) -> bool {
        let channel = self.own.get(name).and_then(|own| own.channel);
        channel
            .zip(self.core.as_ref())
            .is_some_and(|(channel, core)| core.is_listened(channel))
    }

    pub(super) fn open(
        &mut self,
        cx: &mut Cx,
        name: &str,
        properties: SkVariant,
    ) -> Result<(), SatelliteError> {
        sk_flat::Name::new(name)?;
        if self.own.contains_key(name) {
            // Opened before, by a module that was restarted: the channel and its listeners are kept.
            return Ok(());
        }
        if let Some(core) = self.core.as_mut().filter(|core| core.is_ready()) {
            core.create(name, &properties)?;
        }
        self.own.insert(name.to_owned(), Own::new(properties));
        self.flush_later(cx);
        Ok(())
    }

    pub(super) fn publish(
        &mut self,
        cx: &mut Cx,
        name: &str,
        payload: impl FnOnce() -> Option<Bytes>,
    ) -> bool {
        let Some(own) = self.own.get_mut(name) else { return false };
        let way = self.core.as_mut().zip(own.channel);
        if own.has_latch() {
            let Some(payload) = payload() else { return false };
            own.latched = Some(payload.clone());
            let sent = way.is_some_and(|(core, channel)| own.send(core, channel, payload));
            own.latch_is_due = !sent;
            self.flush_later(cx);
            return sent;
        }
        let Some((core, channel)) = way else {
            self.losses += 1;
            return false;
        };
        if !core.is_listened(channel) {
            return false;
        }
        let sent = payload().is_some_and(|payload| own.send(core, channel, payload));
        if !sent {
            self.losses += 1;
        }
        self.flush_later(cx);
        sent
    }

    pub(super) fn change_header(
        &mut self,
        cx: &mut Cx,
        name: &str,
        properties: SkVariant,
    ) -> Result<(), SatelliteError> {
        let own = self.own.get_mut(name).ok_or_else(|| SatelliteError::NotOpen(name.to_owned()))?;
        if let Some((core, channel)) = self.core.as_mut().zip(own.channel) {
            core.change_header(channel, &properties)?;
        }
        own.properties = properties;
        self.flush_later(cx);
        Ok(())
    }

    pub(super) fn repeat(
        &mut self,
        cx: &mut Cx,
        name: &str,
        source: Option<&str>,
    ) -> Result<(), SatelliteError> {
        if let Some(source) = source {
            sk_flat::Name::new(source)?;
        }
        let own = self.own.get_mut(name).ok_or_else(|| SatelliteError::NotOpen(name.to_owned()))?;
        let was_tied = own.source.take().is_some();
        own.source = source.map(str::to_owned);
        if let Some((core, channel)) = self.core.as_mut().zip(own.channel) {
            if was_tied {
                core.detach(channel)?;
            }
            attach_to_source(core, name, own);
        }
        self.flush_later(cx);
        Ok(())
    }

    pub(super) fn name_flow(&mut self, name: &str) -> Result<(), SatelliteError> {
        sk_flat::Name::new(name)?;
        name.clone_into(&mut self.flow_name);
        if let Some(core) = &mut self.core {
            core.name_flow(name);
        }
        Ok(())
    }

    pub(super) fn change_wish(
        &mut self,
        cx: &mut Cx,
        full_name: &str,
        wish: Option<(Policy, u16)>,
    ) -> Result<(), SatelliteError> {
        sk_flat::Name::new(full_name)?;
        match wish {
            Some(wish) => drop(self.wanted.insert(full_name.to_owned(), wish)),
            None => drop(self.wanted.remove(full_name)),
        }
        match (self.core.as_mut().filter(|core| core.is_ready()), wish) {
            (Some(core), Some((policy, depth))) => core.subscribe_as(full_name, policy, depth)?,
            (Some(core), None) => core.unsubscribe(full_name)?,
            (None, Some(_)) => {}
            (None, None) => drop(self.renounced.insert(full_name.to_owned())),
        }
        self.flush_later(cx);
        Ok(())
    }
}

fn attach_to_source(core: &mut SatelliteCore, name: &str, own: &Own) {
    if !core.is_ready() {
        return;
    }
    let source = own.source.as_ref().and_then(|source| core.channel(source));
    if let (Some(source), Some(replica)) = (source.map(|info| info.channel), own.channel) {
        log_failure(name, core.attach(replica, source));
    }
}

fn log_failure<T>(name: &str, outcome: Result<T, SatelliteError>) {
    if let Err(error) = outcome {
        tracing::error!("channel {name} cannot be restored: {error}");
    }
}

/// `user.name` without the user.
pub(super) fn own_name(full: &str) -> &str {
    full.split_once('.').map_or(full, |(_, name)| name)
}
