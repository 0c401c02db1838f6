//! Services of the hub's own.

use super::SkFlowServer;
use crate::Cx;
use crate::eventloop::Timer;
use crate::flow::server::{ConnectionId, RequestId};
use crate::flow::service::{Home, Request, Service, doc_or_map};
use crate::flow::{ChannelRef, Properties, RefusalCode, Right};
use crate::object::Handle;
use bytes::Bytes;
use sk_flat::{Instant, IntoVariant, Name};
use std::collections::BTreeMap;
use std::io;
use std::rc::Rc;

/// What a hub serves itself.
pub(super) struct Services {
    serving: BTreeMap<ChannelRef, Serving>,
    asked: BTreeMap<RequestId, (Handle<Service>, Request)>,
    timer: Handle<Timer>,
    /// The deadline that the timer waits for.
    armed: Option<Instant>,
}

#[derive(Clone)]
struct Serving {
    name: Rc<str>,
    object: Handle<Service>,
    home: Rc<dyn Home>,
}

impl Services {
    pub(super) fn new(timer: Handle<Timer>) -> Services {
        Services { serving: BTreeMap::new(), asked: BTreeMap::new(), timer, armed: None }
    }
}

impl SkFlowServer {
    fn serve_own(
        &mut self,
        cx: &mut Cx,
        name: Name,
        properties: Properties,
    ) -> Result<Handle<Service>, RefusalCode> {
        let channel = self.core.open_service(name.clone(), properties)?;
        let (this, name) = (cx.this(self), Rc::<str>::from(name.as_str()));
        let home: Rc<dyn Home> = Rc::new(this);
        let object = cx.under(this).spawn(Service::new(home.clone(), name.clone()));
        self.services.serving.insert(channel, Serving { name, object, home });
        self.after(cx);
        Ok(object)
    }

    /// A service was buried.
    fn withdraw(&mut self, cx: &mut Cx, object: Handle<Service>) {
        let found = self.services.serving.iter().find(|(_, serving)| serving.object == object);
        if let Some(channel) = found.map(|(channel, _)| *channel) {
            self.services.serving.remove(&channel);
            self.core.close_channel(channel);
            self.after(cx);
        }
    }

    fn answer(&mut self, cx: &mut Cx, request: &Request, payload: Bytes, more: bool) -> bool {
        let id = RequestId::from_wire(request.id);
        let said = self.core.answer_own(id, payload, more).unwrap_or_else(|error| {
            tracing::warn!("an answer of service {} was not sent: {error}", request.service);
            false
        });
        if !more {
            self.services.asked.remove(&id);
        }
        self.after(cx);
        said
    }

    fn decline(&mut self, cx: &mut Cx, request: &Request, text: &str) -> bool {
        let id = RequestId::from_wire(request.id);
        let said = self.core.decline_own(id, text);
        self.services.asked.remove(&id);
        self.after(cx);
        said
    }

    fn is_asked(&self, request: &Request) -> bool {
        self.core.is_asked(RequestId::from_wire(request.id))
    }

    /// The timer waits for the first deadline of all requests. It is armed anew only for a sooner one; one that
    /// moved on finds nothing to do and costs a round.
    pub(super) fn watch_request_deadlines(&mut self, cx: &mut Cx) {
        let Some(due) = self.core.next_request_deadline() else { return };
        if self.services.armed.is_none_or(|armed| due < armed) {
            self.services.armed = Some(due);
            // The timer is this object's child and lives as long as it.
            let _ = self.services.timer.start_once(cx, due.since(cx.now()));
        }
    }

    pub(super) fn on_request_deadline(&mut self, cx: &mut Cx) {
        self.services.armed = None;
        self.core.tick(cx.now());
        self.after(cx);
    }

    /// Told in the next round, when this object is not leased: a slot answers through it.
    pub(super) fn on_request(
        &mut self,
        cx: &mut Cx,
        channel: ChannelRef,
        id: RequestId,
        asker: ConnectionId,
        payload: Bytes,
    ) {
        let Some(serving) = self.services.serving.get(&channel).cloned() else { return };
        let Serving { name: service, object, home } = serving;
        let request = Request { home, link: 0, id: id.wire(), service, asker: asker.wire(), payload };
        self.services.asked.insert(id, (object, request.clone()));
        cx.post_own(object, move |cx| cx.emit_own(object, |service| &service.request, &request));
    }

    pub(super) fn on_request_over(&mut self, cx: &mut Cx, id: RequestId) {
        if let Some((object, request)) = self.services.asked.remove(&id) {
            cx.post_own(object, move |cx| cx.emit_own(object, |service| &service.request_over, &request));
        }
    }
}

/// Where the hub has gone before its service, nobody waits and there is nothing to withdraw.
impl Home for Handle<SkFlowServer> {
    fn withdraw(&self, cx: &mut Cx, service: Handle<Service>, _name: &str) {
        let _ = cx.with(*self, |server, cx| server.withdraw(cx, service));
    }

    fn answer(&self, cx: &mut Cx, request: &Request, payload: Bytes, more: bool) -> bool {
        cx.with(*self, |server, cx| server.answer(cx, request, payload, more)) == Ok(true)
    }

    fn decline(&self, cx: &mut Cx, request: &Request, text: &str) -> bool {
        cx.with(*self, |server, cx| server.decline(cx, request, text)) == Ok(true)
    }

    fn is_asked(&self, cx: &mut Cx, request: &Request) -> bool {
        cx.with(*self, |server, _| server.is_asked(request)) == Ok(true)
    }
}

impl Handle<SkFlowServer> {
    /// Offers a service of the hub's own, by its full name, as a satellite would. It outlives every flow.
    ///
    /// # Errors
    /// If the name is taken or cannot be, the properties are too long, or the server is gone.
    pub fn serve(
        self,
        cx: &mut Cx,
        full_name: &str,
        properties: impl IntoVariant,
    ) -> io::Result<Handle<Service>> {
        let name = Name::new(full_name).map_err(io::Error::other)?;
        let properties = doc_or_map(properties.into_variant());
        let properties = Properties::new(&properties).map_err(io::Error::other)?;
        cx.with(self, |server, cx| server.serve_own(cx, name, properties))
            .map_err(io::Error::other)?
            .map_err(|code| io::Error::other(code.to_string()))
    }

    /// Whether the connection of this id, such as that of a request's [asker](Request::asker), has a right for this
    /// name: for services of the hub's own that not everybody who may call is to use for everything.
    pub fn may(self, cx: &mut Cx, connection: u64, right: Right, name: &str) -> bool {
        cx.with(self, |server, _| server.core.has_right(connection, right, name)) == Ok(true)
    }
}
