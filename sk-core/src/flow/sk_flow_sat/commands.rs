//! What a satellite can be told to do, on its handle.

use super::SkFlowSat;
use crate::Cx;
use crate::flow::satellite::{ChannelInfo, SatelliteCore, SatelliteError};
use crate::flow::{Flow, Policy};
use crate::object::Handle;
use bytes::Bytes;
use sk_flat::{IntoVariant, SkVariant};
use std::io;

impl Handle<SkFlowSat> {
    /// Opens a streaming channel of this satellite's, now or as soon as there is a hub; one that is open stays
    /// as it is. The hub calls it `account.name`. Properties say what flows: `unit`, `format`, `rate`, `doc` …
    /// Two of them change how: with `latch: true` the hub keeps the last message, and who comes later hears it
    /// first; with `delivery: "reliable"` nothing is dropped that a slow subscriber cannot take yet, but
    /// [`publish`](Handle#method.publish) answers `false` until [`room`](SkFlowSat::room) is emitted.
    ///
    /// # Errors
    /// If the name or the properties cannot be, or the satellite is gone.
    pub fn open(self, cx: &mut Cx, name: &str, properties: impl IntoVariant) -> io::Result<()> {
        let properties = properties.into_variant();
        self.command(cx, |satellite, cx| satellite.open(cx, name, properties))
    }

    /// Publishes a value as a variant, on a channel that is opened if it is not yet. Answers whether it was
    /// sent: nothing is encoded or sent while nobody listens, unless the channel has a latch.
    pub fn publish(self, cx: &mut Cx, name: &str, value: impl IntoVariant) -> bool {
        self.ensure_open(cx, name, "variant")
            && cx
                .with(self, |satellite, cx| {
                    satellite.publish(cx, name, || value.into_variant().encode().ok().map(Bytes::from))
                })
                .unwrap_or(false)
    }

    /// Publishes bytes as they are; they are not copied.
    pub fn publish_bytes(self, cx: &mut Cx, name: &str, payload: impl Into<Bytes>) -> bool {
        self.ensure_open(cx, name, "bytes")
            && cx
                .with(self, |satellite, cx| satellite.publish(cx, name, || Some(payload.into())))
                .unwrap_or(false)
    }

    fn ensure_open(self, cx: &mut Cx, name: &str, format: &str) -> bool {
        let opened = cx.with(self, |satellite, cx| {
            if satellite.own.contains_key(name) {
                return true;
            }
            let properties = SkVariant::map([("format", format.into())]);
            match satellite.open(cx, name, properties) {
                Ok(()) => true,
                Err(error) => {
                    tracing::error!("channel {name} cannot be opened: {error}");
                    false
                }
            }
        });
        opened.unwrap_or(false)
    }

    /// From now on a channel of this satellite's own is published by datagrams, over all links that it has in its
    /// life. What is lost on the way is lost, and no message arrives in parts or behind a newer one. Until the hub has
    /// opened the session, and with a hub that takes no datagrams (which is told as
    /// [`refused`](SkFlowSat::refused)), messages go over the connection; those of a reliable channel always do.
    ///
    /// # Errors
    /// If there is no such channel, or the satellite is gone.
    pub fn publish_by_udp(self, cx: &mut Cx, name: &str) -> io::Result<()> {
        self.command(cx, |satellite, cx| satellite.publish_by_udp(cx, name))
    }

    /// Whether the hub has opened the session for datagrams.
    pub fn is_udp_open(self, cx: &mut Cx) -> bool {
        cx.with(self, |satellite, _| satellite.core().is_some_and(SatelliteCore::is_udp_open)) == Ok(true)
    }

    /// Whether somebody listens to a channel of this satellite's own.
    pub fn is_listened(self, cx: &mut Cx, name: &str) -> bool {
        cx.with(self, |satellite, _| satellite.is_listened(name)) == Ok(true)
    }

    /// Changes what a channel of this satellite's own says about itself.
    ///
    /// # Errors
    /// If there is no such channel, the properties cannot be sent, or the satellite is gone.
    pub fn change_header(self, cx: &mut Cx, name: &str, properties: impl IntoVariant) -> io::Result<()> {
        let properties = properties.into_variant();
        self.command(cx, |satellite, cx| satellite.change_header(cx, name, properties))
    }

    /// Lets a channel of this satellite's own repeat another one, of this full name, now or as soon as both
    /// exist: who subscribes to it gets what the other carries. It cannot be published on meanwhile. It repeats
    /// one at a time; the last one named counts.
    ///
    /// # Errors
    /// If a name cannot be, there is no such channel, or the satellite is gone.
    pub fn repeat(self, cx: &mut Cx, name: &str, source: &str) -> io::Result<()> {
        self.command(cx, |satellite, cx| satellite.repeat(cx, name, Some(source)))
    }

    /// Ends that.
    ///
    /// # Errors
    /// If there is no such channel, or the satellite is gone.
    pub fn repeat_no_more(self, cx: &mut Cx, name: &str) -> io::Result<()> {
        self.command(cx, |satellite, cx| satellite.repeat(cx, name, None))
    }

    /// Names this satellite's flow, from the next link on: to be called just after the satellite was made. The
    /// hub calls it `account.name` and lets in one of that name at a time; another one is refused, and comes
    /// back until the name is free.
    ///
    /// # Errors
    /// If the name cannot be, or the satellite is gone.
    pub fn name_flow(self, cx: &mut Cx, name: &str) -> io::Result<()> {
        self.command(cx, |satellite, _| satellite.name_flow(name))
    }

    fn command<R>(
        self,
        cx: &mut Cx,
        f: impl FnOnce(&mut SkFlowSat, &mut Cx) -> Result<R, SatelliteError>,
    ) -> io::Result<R> {
        cx.with(self, f).map_err(io::Error::other)?.map_err(io::Error::other)
    }

    /// Hears a channel, by its full name, now or as soon as it exists: the newest messages, if this satellite
    /// does not keep up with all.
    ///
    /// # Errors
    /// If the name cannot be, or the satellite is gone.
    pub fn subscribe(self, cx: &mut Cx, full_name: &str) -> io::Result<()> {
        self.subscribe_to_newest(cx, full_name, 0)
    }

    /// As [`subscribe`](Handle#method.subscribe); at most `depth` messages wait at the hub, 0 for its default
    /// of 64. With 1 it is always the newest that comes next.
    ///
    /// # Errors
    /// If the name cannot be, or the satellite is gone.
    pub fn subscribe_to_newest(self, cx: &mut Cx, full_name: &str, depth: u16) -> io::Result<()> {
        self.command(cx, |satellite, cx| satellite.change_wish(cx, full_name, Some((Policy::Latest, depth))))
    }

    /// Hears every message of a channel. If more than `depth` wait, 0 for the hub's default of 64, the hub ends
    /// the connection, since this satellite must not miss any; it comes back by itself.
    ///
    /// # Errors
    /// If the name cannot be, or the satellite is gone.
    pub fn subscribe_to_all(self, cx: &mut Cx, full_name: &str, depth: u16) -> io::Result<()> {
        self.command(cx, |satellite, cx| satellite.change_wish(cx, full_name, Some((Policy::All, depth))))
    }

    /// Hears a channel no more.
    ///
    /// # Errors
    /// If the name cannot be, or the satellite is gone.
    pub fn unsubscribe(self, cx: &mut Cx, full_name: &str) -> io::Result<()> {
        self.command(cx, |satellite, cx| satellite.change_wish(cx, full_name, None))
    }

    /// All channels of the hub, by name; none while there is no link.
    pub fn channels(self, cx: &mut Cx) -> Vec<ChannelInfo> {
        let known = cx.with(self, |satellite, _| {
            satellite
                .core
                .as_ref()
                .map(|core| core.channels().cloned().collect())
                .unwrap_or_default()
        });
        known.unwrap_or_default()
    }

    /// The id of the present connection at its hub, by which the hub names the owner of channels; `None` while
    /// there is no link that was let in.
    pub fn connection(self, cx: &mut Cx) -> Option<u64> {
        let id = cx.with(self, |satellite, _| satellite.core.as_ref().map(|core| core.connection()));
        id.ok().flatten().filter(|id| *id != 0)
    }

    /// Whether the last link broke because who answered is no hub that can be talked to: its certificate is not
    /// trusted, its HTTP server refuses the upgrade, or it speaks another protocol. [`lost`](SkFlowSat::lost) says
    /// which; it is `false` where nobody answered.
    pub fn is_unusable(self, cx: &mut Cx) -> bool {
        cx.with(self, |satellite, _| satellite.is_unusable) == Ok(true)
    }

    /// The same satellite for one module: its channels' names begin with the module's.
    pub fn flow(self, module: &str) -> Flow {
        Flow::new(self, module)
    }
}
