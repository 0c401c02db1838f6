//! A blob channel of one's own, and a download, as objects.

use super::super::SkFlowSat;
use super::porter::downloads::Sink;
use super::porter::uploads::Source;
use super::porter::{ListAnswer, LookAnswer, Order, Told};
use crate::Cx;
use crate::flow::Flow;
use crate::flow::RefusalCode;
use crate::flow::blob::{BlobEntry, BlobPath};
use crate::object::Handle;
use crate::signal::Signal;
use bytes::Bytes;
use sk_flat::{IntoVariant, Name, SkVariant};
use std::io;
use std::path::PathBuf;
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
    name: Rc<str>,
    satellite: Handle<SkFlowSat>,
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

fn check_path(path: &str) -> io::Result<()> {
    BlobPath::parse_folder(path).map(|_| ()).map_err(bad)
}

fn bad(code: RefusalCode) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, code.to_string())
}

impl Handle<SkFlowSat> {
    /// A blob channel of this satellite's, opened now or as soon as there is a hub. The hub calls it `account.name`;
    /// what it held when it was there last it holds again. The same name gives the same object.
    ///
    /// # Errors
    /// If the name cannot be, or the satellite is gone.
    pub fn blob(self, cx: &mut Cx, name: &str) -> io::Result<Handle<FlowBlob>> {
        self.blob_with(cx, name, SkVariant::map([("format", "files".into())]))
    }

    /// As [`blob`](Handle#method.blob), with properties.
    ///
    /// # Errors
    /// If the name or the properties cannot be, or the satellite is gone.
    pub fn blob_with(
        self,
        cx: &mut Cx,
        name: &str,
        properties: impl IntoVariant,
    ) -> io::Result<Handle<FlowBlob>> {
        Name::new(name).map_err(io::Error::other)?;
        let known = cx
            .with(self, |satellite, _| satellite.porter.object(name))
            .map_err(io::Error::other)?;
        if let Some(object) = known {
            return Ok(object);
        }
        let name: Rc<str> = name.into();
        let object = cx.under(self).spawn(FlowBlob {
            name: name.clone(),
            satellite: self,
            progress: Signal::new(),
            saved: Signal::new(),
            refused: Signal::new(),
        });
        let properties = properties.into_variant();
        cx.with(self, |satellite, cx| {
            satellite.porter.add(satellite.core.as_mut(), &name, properties, object);
            satellite.flush_later(cx);
        })
        .map_err(io::Error::other)?;
        Ok(object)
    }

    /// Downloads a file of a blob channel, by the channel's full name. The object tells what comes.
    ///
    /// # Errors
    /// If the names cannot be, too much waits, or the satellite is gone.
    pub fn download(self, cx: &mut Cx, channel: &str, path: &str) -> io::Result<Handle<FlowDownload>> {
        self.begin_download(cx, channel, path, None)
    }

    /// The same into a file of this machine's, which appears when it is whole.
    ///
    /// # Errors
    /// As [`download`](Handle#method.download).
    pub fn download_to(
        self,
        cx: &mut Cx,
        channel: &str,
        path: &str,
        file: impl Into<PathBuf>,
    ) -> io::Result<Handle<FlowDownload>> {
        self.begin_download(cx, channel, path, Some(file.into()))
    }

    fn begin_download(
        self,
        cx: &mut Cx,
        channel: &str,
        path: &str,
        file: Option<PathBuf>,
    ) -> io::Result<Handle<FlowDownload>> {
        Name::new(channel).map_err(io::Error::other)?;
        BlobPath::parse(path).map_err(bad)?;
        let object = cx.under(self).spawn(FlowDownload {
            data: Signal::new(),
            progress: Signal::new(),
            done: Signal::new(),
            failed: Signal::new(),
        });
        let begun = self.with_porter(cx, |porter| {
            porter.download(channel, path, object, file.map_or(Sink::Signal, Sink::file))
        });
        if !matches!(begun, Ok(true)) {
            cx.destroy_later(object);
            begun?;
            return Err(io::Error::other("too much waits for the hub"));
        }
        Ok(object)
    }

    /// Asks what stands in a folder of a blob channel; the empty path is the channel's own folder. `answer` is called
    /// with the entries, sorted by name, or with why there are none.
    ///
    /// # Errors
    /// If the names cannot be, too much waits, or the satellite is gone: then `answer` is never called.
    pub fn list_blob(
        self,
        cx: &mut Cx,
        channel: &str,
        path: &str,
        answer: impl FnOnce(&mut Cx, Result<Vec<BlobEntry>, String>) + 'static,
    ) -> io::Result<()> {
        let answer: ListAnswer = Box::new(answer);
        self.ask_blob(cx, channel, path, move |porter, channel, path| porter.list(channel, path, answer))
    }

    /// Asks what stands at a path of a blob channel: `answer` is called with its kind and length and, of a file, the
    /// CRC-32, or with why there is no answer.
    ///
    /// # Errors
    /// As [`list_blob`](Handle#method.list_blob).
    pub fn stat_blob(
        self,
        cx: &mut Cx,
        channel: &str,
        path: &str,
        answer: impl FnOnce(&mut Cx, Result<(BlobEntry, u32), String>) + 'static,
    ) -> io::Result<()> {
        let answer: LookAnswer = Box::new(answer);
        self.ask_blob(cx, channel, path, move |porter, channel, path| porter.look(channel, path, answer))
    }

    fn ask_blob(
        self,
        cx: &mut Cx,
        channel: &str,
        path: &str,
        ask: impl FnOnce(&mut super::Porter, &str, &str) -> bool,
    ) -> io::Result<()> {
        Name::new(channel).map_err(io::Error::other)?;
        check_path(path)?;
        if self.with_porter(cx, |porter| ask(porter, channel, path))? {
            Ok(())
        } else {
            Err(io::Error::other("too much waits for the hub"))
        }
    }

    fn with_porter<R>(self, cx: &mut Cx, work: impl FnOnce(&mut super::Porter) -> R) -> io::Result<R> {
        cx.with(self, |satellite, cx| {
            let done = work(&mut satellite.porter);
            satellite.carry_on(cx);
            done
        })
        .map_err(io::Error::other)
    }
}

impl Flow {
    /// A blob channel of this module's; see [`blob`](Handle#method.blob) of a satellite.
    ///
    /// # Errors
    /// If the name cannot be, or the satellite is gone.
    pub fn blob(&self, cx: &mut Cx, name: &str) -> io::Result<Handle<FlowBlob>> {
        let name = self.channel_name(name);
        self.satellite().blob(cx, &name)
    }
}

impl Handle<FlowBlob> {
    /// Uploads bytes to a path. Answers whether that is under way; the signals tell what becomes of it. A new upload
    /// to a path takes the place of one that is under way there.
    pub fn upload(self, cx: &mut Cx, path: &str, content: impl Into<Bytes>) -> bool {
        self.begin(cx, path, Source::Bytes(content.into()))
    }

    /// Uploads a file of this machine's, a piece at a time. It must not change meanwhile.
    pub fn upload_file(self, cx: &mut Cx, path: &str, file: impl Into<PathBuf>) -> bool {
        self.begin(cx, path, Source::File(file.into()))
    }

    fn begin(self, cx: &mut Cx, path: &str, source: Source) -> bool {
        BlobPath::parse(path).is_ok() && self.on_porter(cx, |porter, name| porter.upload(name, path, source))
    }

    /// Gives up the upload to a path; the hub forgets what it has of it.
    pub fn abort(self, cx: &mut Cx, path: &str) -> bool {
        self.order(cx, path, Order::Abort)
    }

    /// Makes a folder; the one above must be there.
    pub fn make_dir(self, cx: &mut Cx, path: &str) -> bool {
        self.order(cx, path, Order::MakeFolder)
    }

    /// Moves a file or a folder, over a file that is there.
    pub fn move_to(self, cx: &mut Cx, from: &str, to: &str) -> bool {
        BlobPath::parse(from).is_ok() && self.order(cx, to, Order::Move { from: from.to_owned() })
    }

    /// Removes a file or an empty folder.
    pub fn remove(self, cx: &mut Cx, path: &str) -> bool {
        self.order(cx, path, Order::Remove)
    }

    fn order(self, cx: &mut Cx, path: &str, order: Order) -> bool {
        BlobPath::parse(path).is_ok() && self.on_porter(cx, |porter, name| porter.order(name, path, order))
    }

    fn on_porter(self, cx: &mut Cx, work: impl FnOnce(&mut super::Porter, &Rc<str>) -> bool) -> bool {
        let Ok((satellite, name)) = cx.with(self, |blob, _| (blob.satellite, blob.name.clone())) else {
            return false;
        };
        satellite.with_porter(cx, |porter| work(porter, &name)).unwrap_or(false)
    }
}

/// Emits what the porter has to tell, unleased.
pub(in super::super) fn tell_told(cx: &mut Cx, satellite: Handle<SkFlowSat>) {
    while let Ok(Some(told)) = cx.with(satellite, |satellite, _| satellite.porter.next_told()) {
        match told {
            Told::Progress(object, progress) => cx.emit_own(object, |o: &FlowBlob| &o.progress, &progress),
            Told::Saved(object, path) => cx.emit_own(object, |o: &FlowBlob| &o.saved, &path),
            Told::Refused(object, path, why) => {
                cx.emit_own(object, |o: &FlowBlob| &o.refused, &(path, why));
            }
            Told::Data(object, bytes) => cx.emit_own(object, |o: &FlowDownload| &o.data, &bytes),
            Told::Came(object, bytes, of) => {
                cx.emit_own(object, |o: &FlowDownload| &o.progress, &(bytes, of))
            }
            Told::Done(object) => {
                cx.emit_own(object, |o: &FlowDownload| &o.done, &());
                cx.destroy_later(object);
            }
            Told::Failed(object, why) => {
                cx.emit_own(object, |o: &FlowDownload| &o.failed, &why);
                cx.destroy_later(object);
            }
            Told::Listed(answer, entries) => answer(cx, entries),
            Told::Looked(answer, found) => answer(cx, found),
        }
    }
}
