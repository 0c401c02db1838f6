//! What a satellite hears, and a module's way to publish.

use super::SkFlowSat;
use super::services::Call;
use crate::Cx;
use crate::flow::satellite::ChannelInfo;
use crate::flow::service::Service;
use crate::object::Handle;
use bytes::Bytes;
use sk_flat::{IntoVariant, SkVariant, VariantError};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io;
use std::rc::Rc;

/// A message of a channel. A clone shares the bytes.
#[derive(Clone, Debug)]
pub struct FlowMessage {
    channel: Rc<ChannelInfo>,
    payload: Bytes,
}

impl FlowMessage {
    pub(crate) fn new(channel: Rc<ChannelInfo>, payload: Bytes) -> FlowMessage {
        FlowMessage { channel, payload }
    }

    /// The channel's full name, `account.name`.
    pub fn name(&self) -> &str {
        &self.channel.name
    }

    /// The channel.
    pub fn channel(&self) -> &ChannelInfo {
        &self.channel
    }

    /// The bytes as they were published.
    pub fn payload(&self) -> &Bytes {
        &self.payload
    }

    /// The value, if it was published as a variant.
    ///
    /// # Errors
    /// If the bytes are no variant.
    pub fn value(&self) -> Result<SkVariant, VariantError> {
        SkVariant::decode_from(&self.payload)
    }
}

/// A module's way into the network: the satellite it lives in, with the module's name before its channels'.
///
/// A module sees no difference between a hub it lives in and one it is a satellite of.
#[derive(Clone, Debug)]
pub struct Flow {
    satellite: Handle<SkFlowSat>,
    module: Rc<str>,
    /// Names with the module's before them, so that publishing again builds no text.
    names: Rc<RefCell<BTreeMap<String, Rc<str>>>>,
}

impl Flow {
    pub(crate) fn new(satellite: Handle<SkFlowSat>, module: &str) -> Flow {
        Flow { satellite, module: module.into(), names: Rc::default() }
    }

    /// The satellite behind, for its signals and for subscribing.
    pub fn satellite(&self) -> Handle<SkFlowSat> {
        self.satellite
    }

    /// The name a channel of this module has within the account: `module.name`.
    pub fn channel_name(&self, name: &str) -> Rc<str> {
        let mut names = self.names.borrow_mut();
        if let Some(full) = names.get(name) {
            return full.clone();
        }
        let full: Rc<str> = format!("{}.{name}", self.module).into();
        names.insert(name.to_owned(), full.clone());
        full
    }

    /// Opens a channel with properties; see [`Handle::open`](Handle#method.open).
    ///
    /// # Errors
    /// If the name or the properties cannot be, or the satellite is gone.
    pub fn open(&self, cx: &mut Cx, name: &str, properties: impl IntoVariant) -> io::Result<()> {
        self.satellite.open(cx, &self.channel_name(name), properties)
    }

    /// Publishes a value, on a channel that is opened if it is not yet. Answers whether it was sent:
    /// nothing is encoded or sent while nobody listens.
    pub fn publish(&self, cx: &mut Cx, name: &str, value: impl IntoVariant) -> bool {
        self.satellite.publish(cx, &self.channel_name(name), value)
    }

    /// Publishes bytes as they are.
    pub fn publish_bytes(&self, cx: &mut Cx, name: &str, payload: impl Into<Bytes>) -> bool {
        self.satellite.publish_bytes(cx, &self.channel_name(name), payload)
    }

    /// Offers a service of this module's; see [`Handle::serve`](Handle#method.serve).
    ///
    /// # Errors
    /// If the name or the properties cannot be, or the satellite is gone.
    pub fn serve(
        &self,
        cx: &mut Cx,
        name: &str,
        properties: impl IntoVariant,
    ) -> io::Result<Handle<Service>> {
        self.satellite.serve(cx, &self.channel_name(name), properties)
    }

    /// Asks anybody's service, by its full name; see [`Handle::call`](Handle#method.call).
    pub fn call(&self, cx: &mut Cx, service: &str, value: impl IntoVariant) -> Handle<Call> {
        self.satellite.call(cx, service, value)
    }

    /// Whether somebody listens to a channel of this module.
    pub fn is_listened(&self, cx: &mut Cx, name: &str) -> bool {
        self.satellite.is_listened(cx, &self.channel_name(name))
    }
}
