//! The registry of channels: identifiers, epochs, names and owners.

pub mod delivery;
pub(super) mod outgoing;

use super::codec::ChannelRef;
use super::definition::Encoded;
use super::error::RefusalCode;
use super::frame::Flags;
use super::limits::{CHANNELS_MAX, CHANNELS_RESERVED_FOR_HUB};
use super::wire::kinds::ChannelKind;
use super::wire::value::{Form, Properties};
use super::{Event, Message};
use crate::testing::{Bug, is_planted};
use sk_flat::Name;
use std::collections::{BTreeMap, VecDeque};

/// Who owns a channel: the only one who may publish on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Owner {
    /// The hub. Such a channel outlives every flow.
    Hub,
    /// The flow of this connection id, never 0.
    Flow(u64),
}

impl Owner {
    /// The number on the wire.
    pub const fn wire(self) -> u64 {
        match self {
            Owner::Hub => 0,
            Owner::Flow(connection) => connection,
        }
    }
}

/// What is known of a channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Identifier and epoch.
    pub reference: ChannelRef,
    /// What it is for.
    pub kind: ChannelKind,
    /// The full name, `user.name`.
    pub name: Name,
    /// The hashID.
    pub hash: u64,
    /// Its owner.
    pub owner: Owner,
    /// What its owner says about it.
    pub properties: Properties,
}

impl Channel {
    /// The event that tells of it, to a flow that wants values in this form.
    pub fn added(&self, tag: u32, form: Form) -> Encoded {
        Event::ChannelAdded {
            channel: self.reference,
            kind: self.kind,
            hash: self.hash,
            owner: self.owner.wire(),
            name: self.name.to_string(),
            properties: self.properties.clone().in_form(form),
        }
        .encode(tag, Flags::NONE)
    }

    /// The line of a list.
    pub fn listed(&self, tag: u32, form: Form) -> Encoded {
        Event::ChannelListed {
            channel: self.reference,
            kind: self.kind,
            hash: self.hash,
            owner: self.owner.wire(),
            name: self.name.to_string(),
            properties: self.properties.clone().in_form(form),
        }
        .encode(tag, Flags::NONE)
    }
}

/// All channels of a hub, with what the hub keeps beside each.
///
/// Freed identifiers are given out again in the order in which they were freed, and only when no fresh
/// one is left; the epoch tells their bearers apart. The lowest identifiers are the hub's own.
///
/// ```
/// use sk_core::flow::channel::{Owner, Registry};
/// use sk_core::flow::{ChannelKind, Properties, RefusalCode};
/// use sk_flat::SkVariant;
///
/// let none = Properties::new(&SkVariant::map([] as [(&str, SkVariant); 0]))?;
/// let mut channels: Registry<()> = Registry::default();
/// let stream = ChannelKind::Stream;
/// let imu = channels.add("robot.imu".parse()?, stream, Owner::Flow(1), none.clone(), ()).expect("room");
/// assert_eq!(channels.by_name("robot.imu").map(|(channel, _)| channel.reference), Some(imu));
/// assert_eq!(channels.add("robot.imu".parse()?, stream, Owner::Flow(2), none, ()), Err(RefusalCode::Exists));
/// channels.remove(imu);
/// assert!(channels.get(imu).is_none(), "a stale reference finds nobody");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Registry<T> {
    /// By identifier: looked up for every fragment, so it is an index and no search.
    slots: Vec<Slot<T>>,
    open: usize,
    names: BTreeMap<Name, u16>,
    hashes: BTreeMap<u64, u16>,
    for_hub: Ids,
    for_flows: Ids,
}

#[derive(Debug)]
struct Slot<T> {
    /// Of the present bearer of the identifier, or the last one.
    epoch: u16,
    open: Option<Box<(Channel, T)>>,
}

#[derive(Debug)]
struct Ids {
    fresh: std::ops::Range<u16>,
    freed: VecDeque<u16>,
}

impl Ids {
    fn take(&mut self) -> Option<u16> {
        self.fresh.next().or_else(|| self.freed.pop_front())
    }
}

impl<T> Default for Registry<T> {
    fn default() -> Self {
        let (reserved, all) = (CHANNELS_RESERVED_FOR_HUB as u16, CHANNELS_MAX as u16);
        Registry {
            slots: Vec::new(),
            open: 0,
            names: BTreeMap::new(),
            hashes: BTreeMap::new(),
            for_hub: Ids { fresh: 0..reserved, freed: VecDeque::new() },
            for_flows: Ids { fresh: reserved..all, freed: VecDeque::new() },
        }
    }
}

impl<T> Registry<T> {
    /// Gives flows no other fresh identifiers than these; those that are reserved for the hub stay its own.
    pub fn narrow(&mut self, ids: std::ops::Range<u16>) {
        let (reserved, all) = (CHANNELS_RESERVED_FOR_HUB as u16, CHANNELS_MAX as u16);
        self.for_flows.fresh = ids.start.max(reserved)..ids.end.min(all);
    }

    /// Opens a channel under its full name.
    ///
    /// # Errors
    /// `Exists` if the name, or its hash, is taken; `NoFreeChannel` if no identifier is free.
    pub fn add(
        &mut self,
        name: Name,
        kind: ChannelKind,
        owner: Owner,
        properties: Properties,
        beside: T,
    ) -> Result<ChannelRef, RefusalCode> {
        let hash = name.channel_hash();
        if self.names.contains_key(&name) || self.hashes.contains_key(&hash) {
            return Err(RefusalCode::Exists);
        }
        let ids = if owner == Owner::Hub { &mut self.for_hub } else { &mut self.for_flows };
        let id = ids.take().ok_or(RefusalCode::NoFreeChannel)?;
        // Epoch 0 is never given out, so that a reference of zeros is always stale.
        if self.slots.len() <= usize::from(id) {
            self.slots.resize_with(usize::from(id) + 1, || Slot { epoch: 0, open: None });
        }
        let slot = &mut self.slots[usize::from(id)];
        slot.epoch = slot.epoch.checked_add(1).unwrap_or(1);
        let reference = ChannelRef { id: id as i16, epoch: slot.epoch };
        slot.open = Some(Box::new((
            Channel { reference, kind, name: name.clone(), hash, owner, properties },
            beside,
        )));
        self.open += 1;
        self.names.insert(name, id);
        self.hashes.insert(hash, id);
        Ok(reference)
    }

    /// Closes a channel; `None` if the reference is stale.
    pub fn remove(&mut self, reference: ChannelRef) -> Option<(Channel, T)> {
        self.get(reference)?;
        let id = reference.id as u16;
        let (channel, beside) = *self.slots.get_mut(usize::from(id))?.open.take()?;
        self.open -= 1;
        self.names.remove(&channel.name);
        self.hashes.remove(&channel.hash);
        let ids =
            if usize::from(id) < CHANNELS_RESERVED_FOR_HUB { &mut self.for_hub } else { &mut self.for_flows };
        ids.freed.push_back(id);
        Some((channel, beside))
    }

    /// The channel of a reference; `None` if it is stale.
    pub fn get(&self, reference: ChannelRef) -> Option<&(Channel, T)> {
        let id = usize::try_from(reference.id).ok()?;
        self.slots
            .get(id)?
            .open
            .as_deref()
            .filter(|(channel, _)| channel.reference == reference || is_planted(Bug::StaleEpoch))
    }

    /// The channel of a reference, to be changed; `None` if it is stale.
    pub fn get_mut(&mut self, reference: ChannelRef) -> Option<&mut (Channel, T)> {
        let id = usize::try_from(reference.id).ok()?;
        self.slots
            .get_mut(id)?
            .open
            .as_deref_mut()
            .filter(|(channel, _)| channel.reference == reference || is_planted(Bug::StaleEpoch))
    }

    /// The channel of a full name.
    pub fn by_name(&self, name: &str) -> Option<&(Channel, T)> {
        self.slots.get(usize::from(*self.names.get(name)?))?.open.as_deref()
    }

    /// The channel of a hashID.
    pub fn by_hash(&self, hash: u64) -> Option<&(Channel, T)> {
        self.slots.get(usize::from(*self.hashes.get(&hash)?))?.open.as_deref()
    }

    /// The open channel with the lowest identifier from `id` on.
    pub fn from_id(&self, id: u16) -> Option<&(Channel, T)> {
        self.slots.get(usize::from(id)..)?.iter().find_map(|slot| slot.open.as_deref())
    }

    /// All open channels by identifier.
    pub fn iter(&self) -> impl Iterator<Item = &(Channel, T)> {
        self.slots.iter().filter_map(|slot| slot.open.as_deref())
    }

    /// How many channels are open.
    pub fn len(&self) -> usize {
        self.open
    }

    /// Whether no channel is open.
    pub fn is_empty(&self) -> bool {
        self.open == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use sk_flat::SkVariant;

    fn no_properties() -> Properties {
        Properties::new(&SkVariant::map([] as [(&str, SkVariant); 0])).expect("an empty map")
    }

    fn add(channels: &mut Registry<()>, name: &str, owner: Owner) -> Result<ChannelRef, RefusalCode> {
        channels.add(name.parse().expect("a name"), ChannelKind::Stream, owner, no_properties(), ())
    }

    #[test]
    fn flows_open_all_but_the_reserved_identifiers_and_the_next_is_refused() {
        let mut channels = Registry::default();
        for index in 0..CHANNELS_MAX - CHANNELS_RESERVED_FOR_HUB {
            let opened = add(&mut channels, &format!("a.{index}"), Owner::Flow(1)).expect("room");
            assert!(opened.id >= CHANNELS_RESERVED_FOR_HUB as i16, "never wraps into the negative");
        }
        assert_eq!(add(&mut channels, "a.more", Owner::Flow(1)), Err(RefusalCode::NoFreeChannel));
        for index in 0..CHANNELS_RESERVED_FOR_HUB {
            add(&mut channels, &format!("hub.{index}"), Owner::Hub).expect("room for the hub");
        }
        assert_eq!(channels.len(), CHANNELS_MAX);
        assert_eq!(add(&mut channels, "hub.more", Owner::Hub), Err(RefusalCode::NoFreeChannel));
        let first = channels.by_name("a.0").expect("open").0.reference;
        channels.remove(first);
        let again = add(&mut channels, "a.more", Owner::Flow(1)).expect("one is free again");
        assert_eq!((again.id, again.epoch), (first.id, first.epoch + 1));
        assert!(channels.get(first).is_none() && channels.get(again).is_some());
    }

    #[test]
    fn an_epoch_passes_over_zero() {
        let mut channels = Registry::default();
        let first = add(&mut channels, "a.x", Owner::Flow(1)).expect("room");
        channels.remove(first);
        channels.slots[first.id as usize].epoch = u16::MAX;
        channels.for_flows.fresh = 0..0;
        let again = add(&mut channels, "a.x", Owner::Flow(1)).expect("the freed one");
        assert_eq!((again.id, again.epoch), (first.id, 1));
    }

    #[test]
    fn a_negative_identifier_finds_nobody() {
        let mut channels: Registry<()> = Registry::default();
        add(&mut channels, "a.x", Owner::Flow(1)).expect("room");
        assert!(channels.get(ChannelRef { id: -1, epoch: 1 }).is_none());
        assert!(channels.remove(ChannelRef { id: i16::MIN, epoch: 0 }).is_none());
    }

    proptest! {
        #[test]
        fn the_registry_does_what_a_plain_list_does(steps in prop::collection::vec((any::<bool>(), 0_usize..12), 0..120)) {
            let mut channels = Registry::default();
            // Few identifiers, so that they are reused.
            channels.for_flows.fresh = 1024..1030;
            let mut model: Vec<(String, ChannelRef)> = Vec::new();
            let mut freed: VecDeque<i16> = (1024..1030).collect();
            let mut stale: Vec<ChannelRef> = Vec::new();
            for (open, pick) in steps {
                if open {
                    let name = format!("a.{pick}");
                    let taken = model.iter().any(|(known, _)| *known == name);
                    match add(&mut channels, &name, Owner::Flow(1)) {
                        Ok(reference) => {
                            prop_assert!(!taken);
                            prop_assert_eq!(Some(reference.id), freed.pop_front(), "first freed, first reused");
                            prop_assert!(!stale.contains(&reference));
                            model.push((name, reference));
                        }
                        Err(code) if taken => prop_assert_eq!(code, RefusalCode::Exists),
                        Err(code) => {
                            prop_assert_eq!(code, RefusalCode::NoFreeChannel);
                            prop_assert!(freed.is_empty());
                        }
                    }
                } else if !model.is_empty() {
                    let (_, reference) = model.remove(pick % model.len());
                    prop_assert!(channels.remove(reference).is_some());
                    freed.push_back(reference.id);
                    stale.push(reference);
                }
                prop_assert!(stale.iter().all(|old| channels.get(*old).is_none()));
                for (name, reference) in &model {
                    let found = channels.by_name(name).map(|(channel, _)| channel.reference);
                    prop_assert_eq!(found, Some(*reference));
                    let hash = sk_flat::channel_hash(name);
                    prop_assert_eq!(channels.by_hash(hash).map(|(channel, _)| channel.reference), found);
                }
                prop_assert_eq!(channels.len(), model.len());
            }
        }
    }
}
