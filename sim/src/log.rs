//! The log of a run: errors are complaints, and the last warning explains others.

use std::cell::RefCell;
use std::fmt::{self, Write as _};
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Level, Metadata, Subscriber};

#[derive(Default)]
struct Kept {
    error: Option<String>,
    warning: Option<String>,
    panic: Option<String>,
    /// Whether everything is printed, for a replay.
    aloud: bool,
}

thread_local! {
    static KEPT: RefCell<Kept> = RefCell::default();
}

/// Errors that a run may bring about: a queue of connections that cannot be taken in is a limit, not a fault, and a
/// disk that fails is told.
const EXPECTED: [&str; 2] = ["connections cannot be taken in", "the disk failed"];

struct Keeper;

/// Makes the log of this process the runs' own. Harmless if it was done before.
pub fn listen() {
    // Whoever was there first stays.
    if tracing::subscriber::set_global_default(Keeper).is_ok() {
        // Runs that fail are run again and again to be shrunk: one line of each panic is kept, none is printed.
        std::panic::set_hook(Box::new(|info| {
            let text = info.payload_as_str().unwrap_or("(not a text)").to_owned();
            let place = info.location().map(ToString::to_string).unwrap_or_default();
            // A panic inside of this very place is not worth another one.
            let _ = KEPT.try_with(|kept| {
                if let Ok(mut kept) = kept.try_borrow_mut() {
                    kept.panic = Some(format!("{place}: {text}"));
                }
            });
        }));
    }
}

/// What panicked last in this run.
pub(crate) fn last_panic() -> String {
    KEPT.with_borrow(|kept| kept.panic.clone()).unwrap_or_default()
}

/// Prints what the log says from now on.
pub fn aloud() {
    KEPT.with_borrow_mut(|kept| kept.aloud = true);
}

pub(crate) fn begin() {
    listen();
    KEPT.with_borrow_mut(|kept| (kept.error, kept.warning, kept.panic) = (None, None, None));
}

pub(crate) fn first_error() -> Option<String> {
    KEPT.with_borrow(|kept| kept.error.clone())
}

pub(crate) fn last_warning() -> Option<String> {
    KEPT.with_borrow(|kept| kept.warning.clone())
}

struct Text(String);

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        // Writing to a string does not fail.
        let _ = match field.name() {
            "message" => write!(self.0, "{value:?} "),
            name => write!(self.0, "{name}={value:?} "),
        };
    }
}

impl Subscriber for Keeper {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        *metadata.level() <= Level::WARN
    }
    fn max_level_hint(&self) -> Option<tracing::level_filters::LevelFilter> {
        Some(tracing::level_filters::LevelFilter::WARN)
    }
    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }
    fn record(&self, _: &Id, _: &Record<'_>) {}
    fn record_follows_from(&self, _: &Id, _: &Id) {}
    fn enter(&self, _: &Id) {}
    fn exit(&self, _: &Id) {}

    fn event(&self, event: &Event<'_>) {
        let mut text = Text(String::new());
        event.record(&mut text);
        KEPT.with_borrow_mut(|kept| {
            if kept.aloud {
                println!("log: {} {}", event.metadata().level(), text.0);
            }
            let place = match *event.metadata().level() {
                Level::ERROR if EXPECTED.iter().any(|expected| text.0.contains(expected)) => return,
                Level::ERROR if kept.error.is_some() => return,
                Level::ERROR => &mut kept.error,
                _ => &mut kept.warning,
            };
            *place = Some(text.0);
        });
    }
}
