//! Asker, hub and owner, each on a loop of its own, over TCP.

use crate::{PAYLOAD_BYTES, note};
use sk_benches::{BenchError, Sheet};
use sk_core::flow::login::OwnerToken;
use sk_core::flow::satellite::Credentials;
use sk_core::flow::server::Settings;
use sk_core::flow::{Answer, CallError, Request, SkFlowSat, SkFlowServer};
use sk_core::prelude::*;
use std::io;
use std::sync::mpsc::{Sender, channel};

struct Mirror;
impl Mirror {
    fn reflect(&mut self, cx: &mut Cx, request: &Request) {
        request.answer_bytes(cx, request.payload().clone());
    }
}
object! { Mirror { slots { reflect(&Request) } } }

/// Calls again as soon as it has the answer.
struct Asker {
    hub: Handle<SkFlowSat>,
    left: usize,
    asked: Instant,
    took: Sender<u64>,
}
impl Asker {
    fn ask(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        self.asked = cx.clock_now();
        let call = self
            .hub
            .call_bytes(cx, "robot.mirror", vec![0; PAYLOAD_BYTES], Duration::from_secs(5));
        attach!(cx, call.answered => this.hear);
    }
    fn hear(&mut self, cx: &mut Cx, answer: &Answer) -> Result<(), CallError> {
        answer.payload()?;
        let took = cx.clock_now().since(self.asked).as_nanos();
        // Nobody hears what comes after the end.
        let _ = self.took.send(u64::try_from(took).unwrap_or(u64::MAX));
        self.left -= 1;
        if self.left > 0 {
            self.ask(cx);
        }
        Ok(())
    }
}
object! { Asker { slots { ask() hear(&Answer) } } }

pub(crate) fn measure(sheet: &mut Sheet, calls: usize) -> Result<(), BenchError> {
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build().map_err(io::Error::other)?;
    let cx = app.cx();
    let token = OwnerToken::new([7; 32]);
    let user = "robot".parse().map_err(io::Error::other)?;
    let server = SkFlowServer::start(cx, Settings { user, token: Some(token.clone()), owner_uid: None });
    let at = server.listen(cx, &"tcp:127.0.0.1:0".parse().map_err(io::Error::other)?)?;
    let (took, heard) = channel();
    let mut threads = Vec::new();
    for name in ["owner", "asker"] {
        let thread = SkThread::new(name)
            .mode(TimingMode::SelectIo)
            .start(cx)
            .map_err(io::Error::other)?;
        let (at, credentials, took) = (at.clone(), Credentials::Token(token.clone()), took.clone());
        thread
            .build(move |cx| {
                let hub = SkFlowSat::connect_as(cx, &at, credentials);
                if name == "owner" {
                    let mirror = cx.spawn(Mirror);
                    if let Ok(service) = hub.serve(cx, "mirror", "answers what it is asked") {
                        attach!(cx, service.request => mirror.reflect);
                    }
                } else {
                    let asker = cx.spawn(Asker { hub, left: calls, asked: Instant::ZERO, took });
                    attach!(cx, hub.ready => asker.ask, OneShot);
                }
            })
            .map_err(io::Error::other)?;
        threads.push(thread);
    }
    drop(took);
    let remote = cx.remote(cx.event_loop());
    let gather = std::thread::spawn(move || {
        let took: Vec<u64> = heard.into_iter().take(calls).collect();
        // A loop that has ended needs no telling.
        let _ = remote.post(|_, cx| cx.quit());
        took
    });
    app.run();
    threads.into_iter().for_each(SkThread::stop);
    let took = gather.join().map_err(|_| io::Error::other("the asker's figures were lost"))?;
    // The first one waited for the service to come.
    took.into_iter().skip(1).for_each(|ns| note(sheet, ns));
    Ok(())
}
