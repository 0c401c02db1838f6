//! A database of the hub, as an object of a satellite, and what it tells.

use super::super::SkFlowSat;
use crate::object::Handle;
use crate::signal::Signal;
use sk_flat::SkVariant;
use std::rc::Rc;

/// A variable that was watched and has changed.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    database: Rc<str>,
    key: String,
    value: Option<SkVariant>,
}

impl Variable {
    pub(super) fn new(database: &Rc<str>, key: &str, value: Option<SkVariant>) -> Variable {
        Variable { database: database.clone(), key: key.to_owned(), value }
    }

    /// The database; empty for the satellite's own.
    pub fn database(&self) -> &str {
        &self.database
    }

    /// What the variable is called.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// Its value now; none if it was deleted.
    pub fn value(&self) -> Option<&SkVariant> {
        self.value.as_ref()
    }
}

/// A database at the hub (`SkFlowPairDatabase` of the papers), made by [`database`](Handle#method.database) of a
/// satellite. Commands are given on its handle, also before there is a hub; answers come as signals. After a
/// reconnection it is created and watched as before.
///
/// ```no_run
/// use sk_core::flow::{FlowDatabase, SkFlowSat, Variable};
/// use sk_core::prelude::*;
///
/// struct Arm { gain: f64 }
/// impl Arm {
///     fn tune(&mut self, _cx: &mut Cx, variable: &Variable) {
///         if let Some(gain) = variable.value().and_then(|value| f64::try_from(value).ok()) {
///             self.gain = gain;
///         }
///     }
/// }
/// object! { Arm { slots { tune(&Variable) } } }
///
/// let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
/// let cx = app.cx();
/// let hub = SkFlowSat::connect(cx, &"unix:/run/user/1000/skrobot/hub.sock".parse()?);
/// let database = hub.database(cx, "arm")?;
/// database.create(cx, true); // if there is none yet; true: every change goes to the disk
/// let arm = cx.spawn(Arm { gain: 1.0 });
/// attach!(cx, database.changed => arm.tune);
/// database.watch(cx, "gain.");
/// database.set(cx, "gain.p", 1.5);
/// database.get(cx, "gain.p", |_cx, value| println!("{value:?}"));
/// app.run();
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct FlowDatabase {
    pub(super) name: Rc<str>,
    pub(super) satellite: Handle<SkFlowSat>,
    /// A watched variable has another value now, or none.
    pub changed: Signal<Variable>,
    /// A watch with this prefix has told all that there is; what changes from here on follows.
    pub watching: Signal<String>,
    /// The hub did what it was told: carries the key that was set or deleted, empty after a save or load. If the
    /// database is durable, it is on the disk.
    pub done: Signal<String>,
    /// The hub did not do something; carries its words.
    pub refused: Signal<String>,
}

crate::object! {
    pub FlowDatabase {
        signals { changed(&Variable) watching(String) done(String) refused(String) }
    }
}

impl FlowDatabase {
    /// The name; empty for the satellite's own.
    pub fn name(&self) -> &str {
        &self.name
    }
}
