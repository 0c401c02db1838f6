//! A service and the requests that it gets, as its owner sees them.

use crate::Cx;
use crate::object::Handle;
use crate::signal::Signal;
use bytes::Bytes;
use sk_flat::{IntoVariant, SkVariant, VariantError};
use std::fmt;
use std::rc::Rc;

/// A service of one's own, made by `serve` of a satellite or of a hub. It is restored when a lost hub is found
/// again; `cx.destroy_later(service)` withdraws it.
///
/// ```
/// use sk_core::flow::{Answer, CallError, Request, SkFlowSat, SkFlowServer, server::Settings};
/// use sk_core::prelude::*;
///
/// struct Doubler;
/// impl Doubler {
///     fn double(&mut self, cx: &mut Cx, request: &Request) -> Result<(), sk_flat::VariantError> {
///         let number = i64::try_from(&request.value()?)?;
///         request.answer(cx, 2 * number);
///         Ok(())
///     }
/// }
/// object! { Doubler { slots { double(&Request) } } }
///
/// struct Asker(i64);
/// impl Asker {
///     fn hear(&mut self, cx: &mut Cx, answer: &Answer) -> Result<(), CallError> {
///         cx.quit();
///         self.0 = i64::try_from(&answer.value()?)?;
///         Ok(())
///     }
/// }
/// object! { Asker { slots { hear(&Answer) } } }
///
/// let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
/// let cx = app.cx();
/// let hub = SkFlowServer::start(cx, Settings { user: "robot".parse()?, token: None, owner_uid: None });
/// let pipe = hub.pipe(cx, sk_core::flow::Rights::ALL)?;
/// let satellite = SkFlowSat::inside(cx, pipe);
///
/// let service = satellite.serve(cx, "double", "an integer; answers twice as much")?;
/// let doubler = cx.spawn(Doubler);
/// attach!(cx, service.request => doubler.double);
///
/// let call = satellite.call(cx, "robot.double", 21);
/// let asker = cx.spawn(Asker(0));
/// attach!(cx, call.answered => asker.hear);
/// app.run();
/// assert_eq!(app.cx().with(asker, |asker, _| asker.0)?, 42);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Service {
    home: Rc<dyn Home>,
    name: Rc<str>,
    /// Somebody asks. To be answered from the slot or later, declined, or left to its deadline.
    pub request: Signal<Request>,
    /// Nobody waits any more for the answer to a request: its deadline has passed, its asker has gone or given
    /// it up, or the hub was lost.
    pub request_over: Signal<Request>,
}

crate::object! {
    pub Service { signals { request(&Request) request_over(&Request) } hooks { on_destroy } }
}

/// What a service needs of where it lives: in a satellite, or in the hub itself.
pub(crate) trait Home: fmt::Debug {
    /// The service was buried.
    fn withdraw(&self, cx: &mut Cx, service: Handle<Service>, name: &str);

    /// Sends an answer. Says whether somebody waited for it.
    fn answer(&self, cx: &mut Cx, request: &Request, payload: Bytes, more: bool) -> bool;

    /// Will not answer. Says whether somebody waited.
    fn decline(&self, cx: &mut Cx, request: &Request, text: &str) -> bool;

    /// Whether somebody waits for an answer.
    fn is_asked(&self, cx: &mut Cx, request: &Request) -> bool;
}

impl Service {
    pub(crate) fn new(home: Rc<dyn Home>, name: Rc<str>) -> Service {
        Service { home, name, request: Signal::new(), request_over: Signal::new() }
    }

    /// The name that it was given to `serve`.
    pub fn name(&self) -> &str {
        &self.name
    }

    fn on_destroy(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        self.home.withdraw(cx, this, &self.name);
    }
}

/// A request to a service. A clone stands for the same request; it may be kept and answered later, once.
#[derive(Clone, Debug)]
pub struct Request {
    pub(crate) home: Rc<dyn Home>,
    /// Which link to the hub it came over: another hub may give the same id again.
    pub(crate) link: u64,
    pub(crate) id: u64,
    pub(crate) service: Rc<str>,
    pub(crate) asker: u64,
    pub(crate) payload: Bytes,
}

impl Request {
    /// The name of the service, as it was given to `serve`.
    pub fn service(&self) -> &str {
        &self.service
    }

    /// The connection that asks.
    pub fn asker(&self) -> u64 {
        self.asker
    }

    /// The request's id at its hub.
    pub fn id(&self) -> u64 {
        self.id
    }

    /// The bytes as they were sent.
    pub fn payload(&self) -> &Bytes {
        &self.payload
    }

    /// The value, if it was sent as a variant.
    ///
    /// # Errors
    /// If the bytes are no variant.
    pub fn value(&self) -> Result<SkVariant, VariantError> {
        SkVariant::decode_from(&self.payload)
    }

    /// Answers with a value. Says whether somebody waited for it.
    pub fn answer(&self, cx: &mut Cx, value: impl IntoVariant) -> bool {
        self.send_value(cx, value, false)
    }

    /// Answers with a value, and leaves the request open for further answers: a stream for one asker. The
    /// deadline for the next one begins anew.
    pub fn answer_more(&self, cx: &mut Cx, value: impl IntoVariant) -> bool {
        self.send_value(cx, value, true)
    }

    /// As [`answer`](Request::answer), with bytes as they are; they are not copied.
    pub fn answer_bytes(&self, cx: &mut Cx, payload: impl Into<Bytes>) -> bool {
        self.send(cx, payload.into(), false)
    }

    /// As [`answer_more`](Request::answer_more), with bytes as they are.
    pub fn answer_more_bytes(&self, cx: &mut Cx, payload: impl Into<Bytes>) -> bool {
        self.send(cx, payload.into(), true)
    }

    /// Will not answer; the asker hears the text. Says whether somebody waited.
    pub fn decline(&self, cx: &mut Cx, text: &str) -> bool {
        self.home.decline(cx, self, text)
    }

    /// Whether somebody waits for an answer.
    pub fn is_open(&self, cx: &mut Cx) -> bool {
        self.home.is_asked(cx, self)
    }

    fn send_value(&self, cx: &mut Cx, value: impl IntoVariant, more: bool) -> bool {
        match value.into_variant().encode() {
            Ok(payload) => self.send(cx, payload.into(), more),
            Err(error) => {
                tracing::error!("an answer of service {} cannot be sent: {error}", self.service);
                false
            }
        }
    }

    fn send(&self, cx: &mut Cx, payload: Bytes, more: bool) -> bool {
        self.home.answer(cx, self, payload, more)
    }
}

/// A text about a channel is its map's `doc`.
pub(crate) fn doc_or_map(properties: SkVariant) -> SkVariant {
    match properties.as_str() {
        Some(text) => SkVariant::map([("doc", text.into())]),
        None => properties,
    }
}
