//! What a satellite can be told to do, on its handle.

use super::SkFlowSat;
use crate::Cx;
use crate::flow::Flow;
use crate::flow::satellite::{ChannelInfo, SatelliteError};
use crate::object::Handle;
use bytes::Bytes;
use sk_flat::{IntoVariant, SkVariant};
use std::io;

impl Handle<SkFlowSat> {
    /// Opens a streaming channel of this satellite's, now or as soon as there is a hub; one that is open stays
    /// as it is. The hub calls it `account.name`. Properties say what flows: `unit`, `format`, `rate`, `doc` …
    ///
    /// # Errors
    /// If the name or the properties cannot be, or the satellite is gone.
    pub fn open(self, cx: &mut Cx, name: &str, properties: impl IntoVariant) -> io::Result<()> {
        let properties = properties.into_variant();
        cx.with(self, |satellite, cx| satellite.open(cx, name, properties))
            .map_err(io::Error::other)?
            .map_err(io::Error::other)
    }

    /// Publishes a value as a variant, on a channel that is opened if it is not yet. Answers whether it was
    /// sent: nothing is encoded or sent while nobody listens.
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

    /// Whether somebody listens to a channel of this satellite's own.
    pub fn is_listened(self, cx: &mut Cx, name: &str) -> bool {
        let listened = cx.with(self, |satellite, _| {
            let channel = satellite.own.get(name)?.channel?;
            Some(satellite.core.as_ref()?.is_listened(channel))
        });
        matches!(listened, Ok(Some(true)))
    }

    /// Hears a channel, by its full name, now or as soon as it exists.
    ///
    /// # Errors
    /// If the name cannot be, or the satellite is gone.
    pub fn subscribe(self, cx: &mut Cx, full_name: &str) -> io::Result<()> {
        self.change_wish(cx, full_name, true)
    }

    /// Hears a channel no more.
    ///
    /// # Errors
    /// If the name cannot be, or the satellite is gone.
    pub fn unsubscribe(self, cx: &mut Cx, full_name: &str) -> io::Result<()> {
        self.change_wish(cx, full_name, false)
    }

    fn change_wish(self, cx: &mut Cx, full_name: &str, wanted: bool) -> io::Result<()> {
        let changed = cx.with(self, |satellite, cx| {
            sk_flat::Name::new(full_name)?;
            if wanted {
                satellite.wanted.insert(full_name.to_owned(), 0);
            } else {
                satellite.wanted.remove(full_name);
            }
            if let Some(core) = satellite.core.as_mut().filter(|core| core.is_ready()) {
                if wanted { core.subscribe(full_name, 0)? } else { core.unsubscribe(full_name)? }
            }
            satellite.flush_later(cx);
            Ok::<(), SatelliteError>(())
        });
        changed.map_err(io::Error::other)?.map_err(io::Error::other)
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

    /// The same satellite for one module: its channels' names begin with the module's.
    pub fn flow(self, module: &str) -> Flow {
        Flow::new(self, module)
    }
}
