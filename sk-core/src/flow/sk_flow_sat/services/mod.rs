//! Serving and calling, for a satellite.

mod call;

pub use call::{Answer, Call, CallError};

use super::SkFlowSat;
use super::closing::remove_or_give_up;
use crate::Cx;
use crate::flow::limits::{DEADLINE_DEFAULT, DEADLINE_MAX};
use crate::flow::satellite::{SatelliteCore, SatelliteError, SatelliteEvent};
use crate::flow::service::{Home, Request, Service, doc_or_map};
use crate::flow::{ChannelKind, ChannelRef};
use crate::object::Handle;
use bytes::Bytes;
use sk_flat::{Instant, IntoVariant, SkVariant};
use std::collections::BTreeMap;
use std::io;
use std::rc::Rc;
use std::time::Duration;

/// How many calls of a satellite wait for their service to exist.
const CALLS_WAITING_MAX: usize = 1024;
/// A deadline of nothing would mean the hub's default.
const DEADLINE_MIN: Duration = Duration::from_millis(1);

/// What a satellite serves, and what it asks.
#[derive(Default)]
pub(super) struct Services {
    /// By own names; opened again after a reconnection.
    serving: BTreeMap<Rc<str>, Serving>,
    /// The requests that wait for an answer, by their id at the hub.
    asked: BTreeMap<u64, Request>,
    /// The calls at the hub, by tag.
    sent: BTreeMap<u32, Asking>,
    /// Calls that wait for their service, or for a hub at all.
    waiting: Vec<Waiting>,
}

impl Services {
    pub(super) fn serves(&self, name: &str) -> bool {
        self.serving.contains_key(name)
    }

    pub(super) fn object(&self, name: &str) -> Option<Handle<Service>> {
        self.serving.get(name).map(|serving| serving.object)
    }

    /// Asks for the service of this name, if it is served and its channel is not there.
    pub(super) fn open_if_missing(&self, core: &mut SatelliteCore, name: &str) {
        if let Some(serving) = self.serving.get(name).filter(|known| known.channel.is_none())
            && let Err(error) = core.create_service(name, &serving.properties)
        {
            tracing::error!("service {name} cannot be opened: {error}");
        }
    }
}

struct Serving {
    properties: SkVariant,
    channel: Option<ChannelRef>,
    object: Handle<Service>,
    home: Rc<dyn Home>,
}

struct Asking {
    call: Handle<Call>,
    service: Rc<str>,
}

struct Waiting {
    asking: Asking,
    payload: Bytes,
    deadline: Instant,
}

impl Asking {
    fn answer(&self, outcome: Result<Bytes, CallError>, more: bool) -> Answer {
        Answer { call: self.call, service: self.service.clone(), outcome, more }
    }
}

/// Emits an answer; the call ends with its last one.
fn tell_answer(cx: &mut Cx, answer: &Answer) {
    cx.emit_own(answer.call, |call| &call.answered, answer);
    if answer.is_last() {
        cx.destroy_later(answer.call);
    }
}

impl SkFlowSat {
    // ---- serving ----

    fn serve_as(
        &mut self,
        cx: &mut Cx,
        name: &str,
        properties: SkVariant,
    ) -> Result<Handle<Service>, SatelliteError> {
        sk_flat::Name::new(name)?;
        if let Some(serving) = self.services.serving.get(name) {
            // Opened before, by a module that was restarted.
            return Ok(serving.object);
        }
        if let Some(core) = self.core.as_mut().filter(|core| core.is_ready()) {
            core.create_service(name, &properties)?;
        }
        let (this, name) = (cx.this(self), Rc::<str>::from(name));
        let home: Rc<dyn Home> = Rc::new(this);
        let object = cx.under(this).spawn(Service::new(home.clone(), name.clone()));
        self.services
            .serving
            .insert(name, Serving { properties, channel: None, object, home });
        self.flush_later(cx);
        Ok(object)
    }

    /// A service was buried.
    pub(super) fn withdraw(&mut self, cx: &mut Cx, object: Handle<Service>, name: &str) {
        if self.services.serving.get(name).is_none_or(|serving| serving.object != object) {
            return;
        }
        let withdrawn = self.services.serving.remove(name);
        if let Some(core) = &mut self.core {
            // Refused where there is no room to say so: then the link is about to break anyway.
            let _ = remove_or_give_up(core, name, withdrawn.and_then(|serving| serving.channel));
        }
        self.flush_later(cx);
    }

    fn answer(&mut self, cx: &mut Cx, request: &Request, payload: Bytes, more: bool) -> bool {
        let said = self.say(request, |core| core.answer(request.id, payload, more));
        if said && !more {
            self.services.asked.remove(&request.id);
        }
        self.flush_later(cx);
        said
    }

    fn decline(&mut self, cx: &mut Cx, request: &Request, text: &str) -> bool {
        let said = self.say(request, |core| core.decline(request.id, text));
        if said {
            self.services.asked.remove(&request.id);
        }
        self.flush_later(cx);
        said
    }

    fn say(
        &mut self,
        request: &Request,
        what: impl FnOnce(&mut SatelliteCore) -> Result<(), SatelliteError>,
    ) -> bool {
        let Some(core) = self.core.as_mut().filter(|_| request.link == self.link_number) else {
            return false;
        };
        match what(core) {
            Ok(()) => true,
            Err(SatelliteError::NoRequest(_)) => false,
            Err(error) => {
                tracing::warn!("an answer of service {} was not sent: {error}", request.service);
                self.losses += 1;
                false
            }
        }
    }

    fn is_asked(&self, request: &Request) -> bool {
        request.link == self.link_number && self.core.as_ref().is_some_and(|core| core.is_asked(request.id))
    }

    fn on_request(&mut self, channel: ChannelRef, id: u64, asker: u64, payload: Bytes) -> Option<Told> {
        let found = self
            .services
            .serving
            .iter()
            .find(|(_, serving)| serving.channel == Some(channel));
        let (name, serving) = found?;
        let home = serving.home.clone();
        let (link, service) = (self.link_number, name.clone());
        let request = Request { home, link, id, service, asker, payload };
        let object = serving.object;
        self.services.asked.insert(id, request.clone());
        Some(Told::Request(object, request))
    }

    // ---- calling ----

    fn begin_call(
        &mut self,
        cx: &mut Cx,
        service: &str,
        payload: Result<Bytes, CallError>,
        within: Duration,
    ) -> Handle<Call> {
        let this = cx.this(self);
        let call = cx.under(this).spawn(Call::new(this));
        let asking = Asking { call, service: service.into() };
        let full = self.services.waiting.len() >= CALLS_WAITING_MAX;
        match payload {
            Err(error) => post_answer(cx, asking.answer(Err(error), false)),
            Ok(_) if full => post_answer(cx, asking.answer(Err(CallError::TooManyRequests), false)),
            Ok(payload) => {
                let deadline = cx.now() + within.clamp(DEADLINE_MIN, DEADLINE_MAX);
                self.send_or_wait(cx, Waiting { asking, payload, deadline });
            }
        }
        call
    }

    /// A call goes to its service, or waits for it.
    fn send_or_wait(&mut self, cx: &mut Cx, waiting: Waiting) {
        let now = cx.now();
        let Waiting { asking, payload, deadline } = waiting;
        let core = self.core.as_mut().filter(|core| core.is_ready());
        let known = core.and_then(|core| {
            let info = core.channel(&asking.service)?;
            let (channel, kind) = (info.channel, info.kind);
            Some((core, channel, kind))
        });
        let Some((core, channel, kind)) = known else {
            self.services.waiting.push(Waiting { asking, payload, deadline });
            return self.watch_deadlines(cx);
        };
        if kind != ChannelKind::Service {
            return post_answer(cx, asking.answer(Err(CallError::WrongKind), false));
        }
        match core.call(channel, deadline.since(now).max(DEADLINE_MIN), payload) {
            Ok(tag) => {
                self.services.sent.insert(tag, asking);
            }
            Err(error) => {
                post_answer(cx, asking.answer(Err(CallError::NotSent(error.to_string())), false));
            }
        }
        self.flush_later(cx);
    }

    /// Calls whose service has come go to it: of this name, or of any.
    pub(super) fn send_waiting(&mut self, cx: &mut Cx, name: Option<&str>) {
        let waiting = std::mem::take(&mut self.services.waiting);
        for call in waiting {
            if name.is_none_or(|name| *call.asking.service == *name) {
                self.send_or_wait(cx, call);
            } else {
                self.services.waiting.push(call);
            }
        }
    }

    fn watch_deadlines(&mut self, cx: &mut Cx) {
        if let Some(first) = self.services.waiting.iter().map(|waiting| waiting.deadline).min() {
            // The timer is this object's child and lives as long as it.
            let _ = self.call_timer.start_once(cx, first.since(cx.now()));
        }
    }

    /// Slot of the timer for calls that wait.
    pub(super) fn on_call_deadline(&mut self, cx: &mut Cx) {
        let now = cx.now();
        let has_hub = self.core.as_ref().is_some_and(SatelliteCore::is_ready);
        let why = if has_hub { CallError::NoSuchService } else { CallError::HubLost };
        self.services.waiting.retain(|waiting| {
            let late = waiting.deadline <= now;
            if late {
                post_answer(cx, waiting.asking.answer(Err(why.clone()), false));
            }
            !late
        });
        self.watch_deadlines(cx);
    }

    /// A call was buried: by its last answer, or because it is of no interest any more.
    pub(crate) fn give_up(&mut self, cx: &mut Cx, call: Handle<Call>) {
        self.services.waiting.retain(|waiting| waiting.asking.call != call);
        let found = self.services.sent.iter().find(|(_, asking)| asking.call == call);
        if let Some(tag) = found.map(|(tag, _)| *tag) {
            self.services.sent.remove(&tag);
            if let Some(core) = &mut self.core {
                // Without room to say so the hub ends the call at its deadline.
                let _ = core.cancel(tag);
            }
            self.flush_later(cx);
        }
    }

    // ---- the link ----

    /// A service's channel exists now.
    pub(super) fn service_created(&mut self, name: &str, channel: ChannelRef) {
        if let Some(serving) = self.services.serving.get_mut(name) {
            serving.channel = Some(channel);
        }
    }

    /// A new link: services are opened again, and calls that waited are sent.
    pub(super) fn restore_services(&mut self, cx: &mut Cx) {
        if let Some(core) = &mut self.core {
            // Those that the hub kept have their channels already.
            let names: Vec<Rc<str>> = self.services.serving.keys().cloned().collect();
            names.iter().for_each(|name| self.services.open_if_missing(core, name));
        }
        self.send_waiting(cx, None);
    }

    /// The link is over: so are the calls at the hub and the requests that came from it.
    pub(super) fn end_services(&mut self, cx: &mut Cx) {
        for (_, asking) in std::mem::take(&mut self.services.sent) {
            post_answer(cx, asking.answer(Err(CallError::HubLost), false));
        }
        for (_, request) in std::mem::take(&mut self.services.asked) {
            if let Some(serving) = self.services.serving.get(&request.service) {
                let object = serving.object;
                cx.post_own(object, move |cx| cx.emit_own(object, |s| &s.request_over, &request));
            }
        }
        for serving in self.services.serving.values_mut() {
            serving.channel = None;
        }
    }
}

/// What an event of services is for those who listen.
enum Told {
    Request(Handle<Service>, Request),
    Over(Handle<Service>, Request),
    Answer(Answer),
}

/// Emits what an event says of services; `false` if it says nothing of them.
pub(super) fn tell(cx: &mut Cx, satellite: Handle<SkFlowSat>, event: &SatelliteEvent) -> bool {
    let told = cx.with(satellite, |s, _| match event {
        SatelliteEvent::Request { channel, request, asker, payload } => {
            s.on_request(*channel, *request, *asker, payload.clone())
        }
        SatelliteEvent::RequestOver { request } => {
            let request = s.services.asked.remove(request)?;
            let object = s.services.serving.get(&request.service)?.object;
            Some(Told::Over(object, request))
        }
        SatelliteEvent::Reply { tag, more, payload } => {
            let answer = s.services.sent.get(tag)?.answer(Ok(payload.clone()), *more);
            if !more {
                s.services.sent.remove(tag);
            }
            Some(Told::Answer(answer))
        }
        SatelliteEvent::Refused { tag, code, text } => {
            let asking = s.services.sent.remove(tag)?;
            Some(Told::Answer(asking.answer(Err(CallError::of_refusal(*code, text.clone())), false)))
        }
        _ => None,
    });
    match told {
        Ok(Some(Told::Request(service, request))) => cx.emit_own(service, |s| &s.request, &request),
        Ok(Some(Told::Over(service, request))) => cx.emit_own(service, |s| &s.request_over, &request),
        Ok(Some(Told::Answer(answer))) => tell_answer(cx, &answer),
        _ => return false,
    }
    true
}

/// Emits an answer in the next round, when nobody is leased and who called has attached. What is attached before
/// the first round or between two is linked at the end of a round, so the answer comes in the one after that.
fn post_answer(cx: &mut Cx, answer: Answer) {
    let before = !cx.in_round;
    cx.post_own(
        answer.call,
        move |cx| {
            if before { post_answer(cx, answer) } else { tell_answer(cx, &answer) }
        },
    );
}

/// Where the satellite has gone before its service, nobody waits and there is nothing to withdraw.
impl Home for Handle<SkFlowSat> {
    fn withdraw(&self, cx: &mut Cx, service: Handle<Service>, name: &str) {
        let _ = cx.with(*self, |satellite, cx| satellite.withdraw(cx, service, name));
    }

    fn answer(&self, cx: &mut Cx, request: &Request, payload: Bytes, more: bool) -> bool {
        cx.with(*self, |satellite, cx| satellite.answer(cx, request, payload, more)) == Ok(true)
    }

    fn decline(&self, cx: &mut Cx, request: &Request, text: &str) -> bool {
        cx.with(*self, |satellite, cx| satellite.decline(cx, request, text)) == Ok(true)
    }

    fn is_asked(&self, cx: &mut Cx, request: &Request) -> bool {
        cx.with(*self, |satellite, _| satellite.is_asked(request)) == Ok(true)
    }
}

impl Handle<SkFlowSat> {
    /// Offers a service, now or as soon as there is a hub: the hub calls it `account.name`, and its
    /// [`request`](Service::request) tells of each request. One that is offered already is answered as it is. The
    /// properties say what is asked and answered; a text stands for the map `{doc: text}`.
    ///
    /// # Errors
    /// If the name or the properties cannot be, or the satellite is gone.
    pub fn serve(self, cx: &mut Cx, name: &str, properties: impl IntoVariant) -> io::Result<Handle<Service>> {
        let properties = doc_or_map(properties.into_variant());
        cx.with(self, |satellite, cx| satellite.serve_as(cx, name, properties))
            .map_err(io::Error::other)?
            .map_err(io::Error::other)
    }

    /// Asks a service, by its full name, with a value as a variant. A service that is not there yet is waited
    /// for. [`Call::answered`] brings the answer within five seconds, or why there is none; what is attached
    /// to it in the same slot misses nothing.
    pub fn call(self, cx: &mut Cx, service: &str, value: impl IntoVariant) -> Handle<Call> {
        self.call_within(cx, service, value, DEADLINE_DEFAULT)
    }

    /// As [`call`](Handle#method.call), with another deadline for the coming of the service and the answer
    /// together, at most an hour. A service that streams has as much again for each further answer.
    pub fn call_within(
        self,
        cx: &mut Cx,
        service: &str,
        value: impl IntoVariant,
        within: Duration,
    ) -> Handle<Call> {
        let payload = value.into_variant().encode();
        let payload = payload.map(Bytes::from).map_err(|error| CallError::NotSent(error.to_string()));
        self.begin_call(cx, service, payload, within)
    }

    /// As [`call_within`](Handle#method.call_within), with bytes as they are; they are not copied.
    pub fn call_bytes(
        self,
        cx: &mut Cx,
        service: &str,
        payload: impl Into<Bytes>,
        within: Duration,
    ) -> Handle<Call> {
        self.begin_call(cx, service, Ok(payload.into()), within)
    }

    fn begin_call(
        self,
        cx: &mut Cx,
        service: &str,
        payload: Result<Bytes, CallError>,
        within: Duration,
    ) -> Handle<Call> {
        // The call of a satellite that is gone names nobody.
        cx.with(self, |satellite, cx| satellite.begin_call(cx, service, payload, within))
            .unwrap_or_else(|_| Handle::nobody())
    }
}
