//! A blob channel of one's own, and a download, as objects.

use super::super::SkFlowSat;
use crate::object::Handle;
use crate::signal::Signal;
use bytes::Bytes;
use std::rc::Rc;

/// How far an upload has come.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlobProgress {
    /// Which file.
    pub path: String,
    /// How many bytes the hub has.
    pub bytes: u64,
    /// How many there are.
    pub of: u64,
}

/// A blob channel of a satellite's own, made by [`blob`](Handle#method.blob): files that the hub keeps, also while this
/// program does not run. Commands are given on its handle, before there is a hub too; an upload that a lost
/// connection interrupts goes on where it was.
///
/// ```no_run
/// use sk_core::flow::SkFlowSat;
/// use sk_core::prelude::*;
///
/// struct Mapper;
/// impl Mapper {
///     fn on_saved(&mut self, _cx: &mut Cx, path: String) {
///         println!("{path} is on the hub's disk");
///     }
/// }
/// object! { Mapper { slots { on_saved(String) } } }
///
/// let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
/// let cx = app.cx();
/// let hub = SkFlowSat::connect(cx, &"unix:/run/user/1000/skrobot/hub.sock".parse()?);
/// let maps = hub.blob(cx, "maps")?;
/// let mapper = cx.spawn(Mapper);
/// attach!(cx, maps.saved => mapper.on_saved);
/// maps.make_dir(cx, "floors");
/// maps.upload(cx, "floors/2.png", vec![0; 100]);
/// app.run();
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct FlowBlob {
    pub(super) name: Rc<str>,
    pub(super) satellite: Handle<SkFlowSat>,
    /// An upload goes on.
    pub progress: Signal<BlobProgress>,
    /// What was to be done at a path is done, and on the hub's disk: an upload, a folder made, something moved there
    /// or removed.
    pub saved: Signal<String>,
    /// What was to be done at a path was not; carries the path and why.
    pub refused: Signal<(String, String)>,
}

crate::object! {
    pub FlowBlob {
        signals { progress(&BlobProgress) saved(String) refused(String, String) }
    }
}

/// A download, made by [`download`](Handle#method.download) or [`download_to`](Handle#method.download_to). It begins
/// as soon as the channel is there, goes on after a lost connection, and is checked when it is whole. To give it up,
/// destroy it.
pub struct FlowDownload {
    /// Bytes of the file, in their order.
    pub data: Signal<Bytes>,
    /// How many bytes have come, of how many.
    pub progress: Signal<(u64, u64)>,
    /// It is whole, and what was announced.
    pub done: Signal<()>,
    /// There is no more to come; carries why.
    pub failed: Signal<String>,
}

crate::object! {
    pub FlowDownload {
        signals { data(&Bytes) progress(u64, u64) done() failed(String) }
    }
}
