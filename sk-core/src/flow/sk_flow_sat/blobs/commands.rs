//! What a blob channel and a satellite can be told about files.

use super::super::SkFlowSat;
use super::errands::Source;
use super::objects::{FlowBlob, FlowDownload};
use super::porter::downloads::Sink;
use super::porter::{ListAnswer, LookAnswer, Order};
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
