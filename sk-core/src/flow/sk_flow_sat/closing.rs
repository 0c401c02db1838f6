//! The end of a channel that a satellite opened, of whichever kind it is.

use super::SkFlowSat;
use crate::Cx;
use crate::flow::satellite::{SatelliteCore, SatelliteError};
use crate::flow::{ChannelRef, Flow};
use crate::object::{Handle, ObjectId};
use std::io;

impl SkFlowSat {
    /// Whether this satellite wants to own a channel of this name.
    pub(super) fn opened(&self, name: &str) -> bool {
        self.own.contains_key(name)
            || self.services.serves(name)
            || self.porter.has(name)
            || self.sync.is_source(name)
    }

    /// A channel of this satellite's exists that it wants no more: it was closed while there was no link.
    pub(super) fn remove_unwanted(&mut self, cx: &mut Cx, name: &str, channel: ChannelRef) {
        if self.opened(name) {
            return;
        }
        if let Some(core) = &mut self.core {
            // Refused where there is no room to say so: then the link is about to break anyway.
            let _ = core.remove(channel);
        }
        self.flush_later(cx);
    }

    /// Answers the object that stood for the channel, to be buried.
    fn close_channel(&mut self, cx: &mut Cx, name: &str) -> Result<Option<ObjectId>, SatelliteError> {
        if self.own.contains_key(name) {
            self.remove_at_hub(name, self.own.get(name).and_then(|own| own.channel()))?;
            self.own.remove(name);
            self.flush_later(cx);
            return Ok(None);
        }
        if let Some(service) = self.services.object(name) {
            self.withdraw(cx, service, name);
            return Ok(Some(service.id()));
        }
        if let Some((blob, channel)) = self.porter.channel_of(name) {
            self.remove_at_hub(name, channel)?;
            self.porter.close(name);
            self.flush_later(cx);
            return Ok(Some(blob.id()));
        }
        if self.sync.is_source(name) {
            self.end_source(cx);
            return Ok(None);
        }
        Err(SatelliteError::NotOpen(name.to_owned()))
    }

    /// Asks the hub to remove a channel, or not to open it.
    fn remove_at_hub(&mut self, name: &str, channel: Option<ChannelRef>) -> Result<(), SatelliteError> {
        let Some(core) = self.core.as_mut().filter(|core| core.is_ready()) else { return Ok(()) };
        remove_or_give_up(core, name, channel)
    }
}

/// Removes a channel of one's own that exists, or gives up one that was asked for.
pub(super) fn remove_or_give_up(
    core: &mut SatelliteCore,
    name: &str,
    channel: Option<ChannelRef>,
) -> Result<(), SatelliteError> {
    match channel {
        Some(channel) => core.remove(channel).map(drop),
        None => {
            core.give_up_creating(name);
            Ok(())
        }
    }
}

impl Handle<SkFlowSat> {
    /// Closes a channel that this satellite opened, by its own name: a stream, a service, a blob channel or the
    /// source of ticks. Everybody hears [`channel_removed`](SkFlowSat::channel_removed); subscriptions to it end,
    /// and so do open requests. The files of a blob channel stay at the hub, to be found again under its name; a
    /// [`Service`](crate::flow::Service) or [`FlowBlob`](crate::flow::FlowBlob) that stood for the channel is
    /// destroyed. The name may be used again at once.
    ///
    /// ```
    /// use sk_core::flow::{Rights, SkFlowSat, SkFlowServer, server::Settings};
    /// use sk_core::prelude::*;
    ///
    /// let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
    /// let cx = app.cx();
    /// let hub = SkFlowServer::start(cx, Settings { user: "robot".parse()?, token: None, owner_uid: None });
    /// let pipe = hub.pipe(cx, Rights::ALL)?;
    /// let satellite = SkFlowSat::inside(cx, pipe);
    /// satellite.publish(cx, "speed", 1.5);
    /// satellite.close_channel(cx, "speed")?;
    /// assert!(satellite.close_channel(cx, "speed").is_err(), "there is none any more");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If this satellite has opened no channel of this name, too much waits to be sent, or the satellite is gone.
    pub fn close_channel(self, cx: &mut Cx, name: &str) -> io::Result<()> {
        let closed = cx.with(self, |satellite, cx| satellite.close_channel(cx, name));
        if let Some(object) = closed.map_err(io::Error::other)?.map_err(io::Error::other)? {
            cx.destroy_later(object);
        }
        Ok(())
    }
}

impl Flow {
    /// Closes a channel of this module's, of whichever kind; see
    /// [`close_channel`](Handle#method.close_channel) of a satellite.
    ///
    /// # Errors
    /// If this module has opened no channel of this name, too much waits, or the satellite is gone.
    pub fn close_channel(&self, cx: &mut Cx, name: &str) -> io::Result<()> {
        let name = self.channel_name(name);
        self.satellite().close_channel(cx, &name)
    }
}
