//! A pair that is attached again is counted always, and logged once with both names.

mod objects;

use objects::*;
use sk_core::prelude::*;
use std::fmt::{Debug, Write};
use std::sync::{Arc, Mutex};
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Metadata, Subscriber};

/// Keeps the messages that tell of a pair that is attached again.
#[derive(Clone, Default)]
struct Heard(Arc<Mutex<Vec<String>>>);

impl Heard {
    fn take(&self) -> Vec<String> {
        std::mem::take(&mut self.0.lock().unwrap())
    }
}

struct Message(String);
impl Visit for Message {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        if field.name() == "message" {
            write!(self.0, "{value:?}").unwrap();
        }
    }
}

impl Subscriber for Heard {
    fn enabled(&self, _: &Metadata<'_>) -> bool {
        true
    }
    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }
    fn record(&self, _: &Id, _: &Record<'_>) {}
    fn record_follows_from(&self, _: &Id, _: &Id) {}
    fn event(&self, event: &Event<'_>) {
        let mut message = Message(String::new());
        event.record(&mut message);
        if message.0.contains("already") {
            self.0.lock().unwrap().push(message.0);
        }
    }
    fn enter(&self, _: &Id) {}
    fn exit(&self, _: &Id) {}
}

#[test]
fn each_pair_attached_again_is_logged_once_with_both_names() {
    let heard = Heard::default();
    tracing::subscriber::with_default(heard.clone(), || {
        let (log, (_world, mut app)) = (Log::default(), world());
        let cx = app.cx();
        let button = cx.named("button").spawn(Button::default());
        let (left, right) = (
            cx.named("left").spawn(Lamp::new("left", &log)),
            cx.named("right").spawn(Lamp::new("right", &log)),
        );
        let attach_both = |cx: &mut Cx, times: usize| {
            (0..times).for_each(|_| attach!(cx, button.pressed => left.on));
            (0..times).for_each(|_| attach!(cx, button.pressed => right.on));
        };
        attach_both(cx, 1);
        app.pulse();
        assert_eq!(heard.take(), [""; 0]);
        attach_both(app.cx(), 100);
        app.pulse();
        assert_eq!(app.cx().counters().duplicates, 200);
        let said = heard.take();
        assert_eq!(said.len(), 2, "{said:?}");
        assert!(said[0].starts_with("button.pressed is attached to left.on already"), "{said:?}");
        assert!(said[1].starts_with("button.pressed is attached to right.on already"), "{said:?}");
        for _ in 0..100 {
            attach_both(app.cx(), 1);
        }
        app.pulse();
        assert_eq!(app.cx().counters().duplicates, 400);
        assert!(heard.take().len() <= 10, "two that take turns do not flood the log");
    });
}
