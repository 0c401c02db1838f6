//! The source of ticks for others, and a loop that follows another's.

use super::SkFlowSat;
use super::closing::remove_or_give_up;
use crate::eventloop::TimingMode;
use crate::flow::ChannelRef;
use crate::flow::satellite::{Divisor, SatelliteCore, SatelliteError, SatelliteEvent, TickReport};
use crate::object::Handle;
use crate::{Cx, attach, detach};
use sk_flat::{Instant, SkVariant};
use std::io;
use std::time::Duration;

/// The property of a sync channel that says the planned interval of its ticks.
const INTERVAL_NS: &str = "interval_ns";

/// What a satellite does with sync channels.
#[derive(Default)]
pub(super) struct Sync {
    source: Option<Source>,
    target: Option<Target>,
}

impl Sync {
    pub(super) fn is_source(&self, name: &str) -> bool {
        self.source.as_ref().is_some_and(|source| source.name == name)
    }

    /// Asks for the sync channel of this name, if it is wanted and not there.
    pub(super) fn open_if_missing(&self, core: &mut SatelliteCore, name: &str) {
        if let Some(source) = &self.source
            && source.name == name
            && source.channel.is_none()
            && let Err(error) = core.create_sync(name, &source_properties(source.interval))
        {
            tracing::error!("sync channel {name} cannot be opened: {error}");
        }
    }
}

struct Source {
    name: String,
    channel: Option<ChannelRef>,
    interval: Duration,
    sequence: u64,
    /// The last tick that was one for others.
    ticked: Option<Instant>,
}

struct Target {
    name: String,
    divisor: Divisor,
    /// Once the hub has said that the ticks come.
    followed: Option<Followed>,
}

struct Followed {
    channel: ChannelRef,
    /// How the loop kept time before.
    own_mode: TimingMode,
    own_interval: Duration,
    /// The source's.
    interval: Option<Duration>,
    /// Ticks whose pulse is not over, each with the round in which it was read.
    ticks: Vec<(u64, u64)>,
}

impl SkFlowSat {
    // ---- the source ----

    fn begin_source(&mut self, cx: &mut Cx, name: &str) -> Result<(), SatelliteError> {
        sk_flat::Name::new(name)?;
        let interval = cx.settings().interval;
        if let Some(core) = self.core.as_mut().filter(|core| core.is_ready()) {
            core.create_sync(name, &source_properties(interval))?;
        }
        let this = cx.this(self);
        attach!(cx, cx.fast_zone().pulse => this.on_source_tick);
        self.sync.source =
            Some(Source { name: name.to_owned(), channel: None, interval, sequence: 0, ticked: None });
        self.flush_later(cx);
        Ok(())
    }

    /// Every fast tick of the loop is numbered, whether somebody follows or not. In `SelectIo` traffic makes ticks of
    /// its own: one that comes before its time is none for others, or the answers to it would cause the next one.
    pub(super) fn on_source_tick(&mut self, cx: &mut Cx) {
        let Some(source) = &mut self.sync.source else { return };
        let (settings, now) = (cx.settings(), cx.now());
        let is_early = source.ticked.is_some_and(|before| now.since(before) < settings.interval);
        if is_early && settings.mode == TimingMode::SelectIo {
            return;
        }
        source.ticked = Some(now);
        source.sequence += 1;
        if let (Some(core), Some(channel)) = (&mut self.core, source.channel) {
            // A tick that finds no room is missed, and its number tells.
            let _ = core.sync_tick(channel, source.sequence);
        }
        self.flush_later(cx);
    }

    pub(super) fn end_source(&mut self, cx: &mut Cx) {
        let Some(source) = self.sync.source.take() else { return };
        let this = cx.this(self);
        detach!(cx, cx.fast_zone().pulse => this.on_source_tick);
        if let Some(core) = &mut self.core {
            // Refused where there is no room to say so: then the link is about to break anyway.
            let _ = remove_or_give_up(core, &source.name, source.channel);
        }
        self.flush_later(cx);
    }

    pub(super) fn sync_created(&mut self, name: &str, channel: ChannelRef) {
        if let Some(source) = self.sync.source.as_mut().filter(|source| source.name == name) {
            source.channel = Some(channel);
        }
    }

    // ---- the target ----

    fn begin_target(&mut self, cx: &mut Cx, name: &str, divisor: Divisor) -> Result<(), SatelliteError> {
        sk_flat::Name::new(name)?;
        if self.sync.target.as_ref().is_some_and(|target| target.name != name) {
            self.end_target(cx);
        }
        match &mut self.sync.target {
            Some(target) => target.divisor = divisor,
            None => self.sync.target = Some(Target { name: name.to_owned(), divisor, followed: None }),
        }
        if let Some(core) = self.core.as_mut().filter(|core| core.is_ready()) {
            core.follow(name, divisor)?;
        }
        self.flush_later(cx);
        Ok(())
    }

    fn end_target(&mut self, cx: &mut Cx) {
        self.leave_sync(cx);
        if let Some(target) = self.sync.target.take()
            && let Some(core) = self.core.as_mut().filter(|core| core.is_ready())
        {
            // Refused where there is no room to say so: then the link is about to break anyway.
            let _ = core.unfollow(&target.name);
        }
        self.flush_later(cx);
    }

    /// The ticks come from here on: the loop's own interval rests.
    fn enter_sync(&mut self, cx: &mut Cx, channel: ChannelRef) {
        let Some(info) = self.heard.get(&channel).cloned() else { return };
        let this = cx.this(self);
        let Some(target) = self.sync.target.as_mut().filter(|target| target.name == info.name) else {
            return;
        };
        if let Some(followed) = &target.followed {
            // The divisor was changed; if the hub chooses it, a report tells.
            return match target.divisor {
                Divisor::Auto => {}
                divisor => follow_interval(cx, followed, divisor as u8),
            };
        }
        let interval = info.properties.variant().get(INTERVAL_NS).and_then(|ns| u64::try_from(ns).ok());
        let settings = cx.settings();
        let followed = Followed {
            channel,
            own_mode: settings.mode,
            own_interval: settings.interval,
            interval: interval.filter(|ns| *ns > 0).map(Duration::from_nanos),
            ticks: Vec::new(),
        };
        follow_interval(cx, &followed, (target.divisor as u8).max(1));
        target.followed = Some(followed);
        // No mode contradicts any other setting.
        let _ = cx.set_mode(TimingMode::Synced);
        cx.post_own(this, move |cx| cx.emit_own(this, |satellite| &satellite.synced, &true));
    }

    /// No ticks come any more: the loop keeps time as it did before.
    pub(super) fn leave_sync(&mut self, cx: &mut Cx) {
        let Some(followed) = self.sync.target.as_mut().and_then(|target| target.followed.take()) else {
            return;
        };
        if cx.settings().mode == TimingMode::Synced {
            // It was good before, so it is now.
            let _ = cx.set_interval(followed.own_interval);
            let _ = cx.set_mode(followed.own_mode);
        }
        let this = cx.this(self);
        cx.post_own(this, move |cx| cx.emit_own(this, |satellite| &satellite.synced, &false));
    }

    /// A tick is read in step 4: the next round is one. If another was read in this round already, that one is
    /// missed.
    fn on_tick(&mut self, cx: &mut Cx, channel: ChannelRef, sequence: u64) {
        let round = cx.pulse().round;
        let followed = self.sync.target.as_mut().and_then(|target| target.followed.as_mut());
        let Some(followed) = followed.filter(|followed| followed.channel == channel) else { return };
        followed.ticks.retain(|(_, read)| *read != round);
        followed.ticks.push((sequence, round));
        cx.sync_tick();
        self.flush_in_next_round(cx);
    }

    /// In step 7: says of the ticks that were read in earlier rounds that their pulse is over.
    pub(super) fn finish_pulses(&mut self, cx: &mut Cx) {
        let round = cx.pulse().round;
        let followed = self.sync.target.as_mut().and_then(|target| target.followed.as_mut());
        let (Some(followed), Some(core)) = (followed, &mut self.core) else { return };
        let channel = followed.channel;
        followed.ticks.retain(|(sequence, read)| {
            if *read < round {
                // Refused where there is no room to say so: then the hub counts a miss, and rightly.
                let _ = core.tick_done(channel, *sequence);
            }
            *read >= round
        });
        if !followed.ticks.is_empty() {
            self.flush_in_next_round(cx);
        }
    }

    fn on_report(&mut self, cx: &mut Cx, report: TickReport) {
        let followed = self.sync.target.as_ref().and_then(|target| target.followed.as_ref());
        if let Some(followed) =
            followed.filter(|followed| report.is_own && followed.channel == report.channel)
        {
            follow_interval(cx, followed, report.divisor);
        }
    }

    // ---- the link ----

    /// A new link: the channel is opened and the source followed again.
    pub(super) fn restore_sync(&mut self) {
        let Some(core) = &mut self.core else { return };
        if let Some(name) = self.sync.source.as_ref().map(|source| source.name.clone()) {
            self.sync.open_if_missing(core, &name);
        }
        if let Some(target) = &self.sync.target
            && let Err(error) = core.follow(&target.name, target.divisor)
        {
            tracing::error!("sync channel {} cannot be followed: {error}", target.name);
        }
    }

    /// The link is over.
    pub(super) fn end_sync(&mut self, cx: &mut Cx) {
        self.leave_sync(cx);
        if let Some(source) = &mut self.sync.source {
            source.channel = None;
        }
    }

    /// What an event does here, before it is told.
    pub(super) fn note_sync(&mut self, cx: &mut Cx, event: &SatelliteEvent) {
        match event {
            SatelliteEvent::Subscribed(channel) => self.enter_sync(cx, *channel),
            SatelliteEvent::Tick { channel, sequence } => self.on_tick(cx, *channel, *sequence),
            SatelliteEvent::TickReport(report) => self.on_report(cx, *report),
            SatelliteEvent::Unsubscribed(channel) => self.leave_sync_of(cx, *channel),
            SatelliteEvent::ChannelRemoved(info) => self.leave_sync_of(cx, info.channel),
            _ => {}
        }
    }

    fn leave_sync_of(&mut self, cx: &mut Cx, channel: ChannelRef) {
        let followed = self.sync.target.as_ref().and_then(|target| target.followed.as_ref());
        if followed.is_some_and(|followed| followed.channel == channel) {
            self.leave_sync(cx);
        }
    }
}

/// Sets the interval of a loop that follows to what it gets, so that `cx.pulse().interval` is true.
fn follow_interval(cx: &mut Cx, followed: &Followed, divisor: u8) {
    let Some(interval) = followed.interval else { return };
    let interval = interval * u32::from(divisor.max(1));
    if cx.settings().interval != interval {
        // It is not zero, which is all that could be wrong with it.
        let _ = cx.set_interval(interval);
    }
}

fn source_properties(interval: Duration) -> SkVariant {
    let ns = u64::try_from(interval.as_nanos()).unwrap_or(u64::MAX);
    SkVariant::map([(INTERVAL_NS, ns.into())])
}

impl Handle<SkFlowSat> {
    /// Makes this loop's fast tick the clock of others: it goes to the hub on a sync channel, now or as soon as
    /// there is a hub, and from there to every loop that follows it. A satellite is one source at most: another name
    /// ends the former one. Nothing is sent while nobody follows. Of a loop in `SelectIo`, which ticks whenever something
    /// comes in, only ticks that are an interval or more apart are sent.
    ///
    /// # Errors
    /// If the name cannot be, or the satellite is gone.
    pub fn sync_source(self, cx: &mut Cx, name: &str) -> io::Result<()> {
        let begun = cx.with(self, |satellite, cx| {
            if satellite.sync.source.as_ref().is_some_and(|source| source.name == name) {
                return Ok(());
            }
            satellite.end_source(cx);
            satellite.begin_source(cx, name)
        });
        begun.map_err(io::Error::other)?.map_err(io::Error::other)
    }

    /// Sends no ticks any more; those who follow go back to their own time.
    ///
    /// # Errors
    /// If the satellite is gone.
    pub fn end_sync_source(self, cx: &mut Cx) -> io::Result<()> {
        cx.with(self, |satellite, cx| satellite.end_source(cx))
            .map_err(io::Error::other)
    }

    /// Lets this loop follow the ticks of a sync channel, by its full name, now or as soon as it exists. Then the loop is
    /// in the mode [`Synced`](TimingMode::Synced): its fast zone pulses when the source's does. When the channel or the
    /// hub goes it keeps time as before, until they are back; [`synced`](SkFlowSat::synced) tells of both. Again,
    /// it changes the divisor or the channel.
    ///
    /// # Errors
    /// If the name cannot be, or the satellite is gone.
    pub fn sync_to(self, cx: &mut Cx, full_name: &str, divisor: Divisor) -> io::Result<()> {
        cx.with(self, |satellite, cx| satellite.begin_target(cx, full_name, divisor))
            .map_err(io::Error::other)?
            .map_err(io::Error::other)
    }

    /// Follows no more: the loop keeps time as it did before.
    ///
    /// # Errors
    /// If the satellite is gone.
    pub fn end_sync_to(self, cx: &mut Cx) -> io::Result<()> {
        cx.with(self, |satellite, cx| satellite.end_target(cx))
            .map_err(io::Error::other)
    }
}
