//! `sk blob`: what blob channels hold, files from them, and files to one.

use crate::arguments::Arguments;
use crate::output::{print, safe};
use crate::session::{Session, Visit};
use clap::{Args, Subcommand};
use sk_core::flow::blob::BlobEntry;
use sk_core::flow::satellite::ChannelInfo;
use sk_core::flow::{BlobProgress, ChannelKind, FlowBlob, SkFlowSat};
use sk_core::prelude::*;
use std::io::{IsTerminal, Write};
use std::path::PathBuf;

#[derive(Subcommand, Debug)]
pub enum Blob {
    /// List a folder
    Ls(BlobLook),
    /// Tell the length and the checksum of a file
    Stat(BlobLook),
    /// Download a file; it appears when it is whole
    Get(BlobGet),
    /// Open a blob channel of your own, with what it held before and these files, until Ctrl-C
    Serve(BlobServe),
}

#[derive(Args, Debug, Clone)]
pub struct BlobPlace {
    /// The channel, with or without the account: robot.maps or maps
    pub channel: String,
    /// The path inside it
    #[arg(default_value = "")]
    pub path: String,
}

#[derive(Args, Debug)]
pub struct BlobLook {
    #[command(flatten)]
    pub place: BlobPlace,
}

#[derive(Args, Debug)]
pub struct BlobGet {
    #[command(flatten)]
    pub place: BlobPlace,
    /// Where to write it: a file or a folder [default: its name, here]
    pub file: Option<PathBuf>,
}

#[derive(Args, Debug)]
pub struct BlobServe {
    /// The channel's name without the account
    pub name: String,
    /// Files to upload
    pub files: Vec<PathBuf>,
}

/// What is to be done with a channel once it was found.
enum Wish {
    List,
    Stat,
    Get(PathBuf),
}

struct Reader {
    hub: Handle<SkFlowSat>,
    session: Handle<Session>,
    place: BlobPlace,
    wish: Wish,
    json: bool,
}

object! { Reader { slots { on_entered() on_progress(u64, u64) on_done() on_failed(String) } } }

pub fn run(arguments: &Arguments, task: &Blob) -> Result<(), String> {
    match task {
        Blob::Ls(task) => read(arguments, task.place.clone(), Wish::List, arguments.json),
        Blob::Stat(task) => read(arguments, task.place.clone(), Wish::Stat, arguments.json),
        Blob::Get(task) => read(arguments, task.place.clone(), Wish::Get(target(task)?), false),
        Blob::Serve(task) => serve(arguments, task),
    }
}

/// Where a download goes: the file that was named, or one of the same name here.
fn target(task: &BlobGet) -> Result<PathBuf, String> {
    let name = task.place.path.rsplit('/').next().unwrap_or_default();
    match &task.file {
        Some(file) if file.is_dir() => Ok(file.join(name)),
        Some(file) => Ok(file.clone()),
        None if name.is_empty() => Err("name the file to get".to_owned()),
        None => Ok(PathBuf::from(name)),
    }
}

fn read(arguments: &Arguments, place: BlobPlace, wish: Wish, json: bool) -> Result<(), String> {
    let mut visit = Visit::begin(arguments)?;
    let (hub, session) = (visit.hub, visit.session);
    let cx = visit.app.cx();
    let reader = cx.spawn(Reader { hub, session, place, wish, json });
    attach!(cx, session.entered => reader.on_entered, Queued);
    visit.run()
}

/// The full name of the blob channel that is meant.
fn full_name(wanted: &str, channels: &[ChannelInfo]) -> Result<String, String> {
    let means = |name: &str| name == wanted || name.split_once('.').is_some_and(|(_, own)| own == wanted);
    match channels.iter().find(|channel| means(&channel.name)) {
        Some(channel) if channel.kind == ChannelKind::Blob => Ok(channel.name.clone()),
        Some(channel) => {
            Err(format!("{} is a {} channel and holds no files", safe(&channel.name), channel.kind))
        }
        None => Err(format!("no channel {}: `sk ls` lists them", safe(wanted))),
    }
}

impl Reader {
    fn on_entered(&mut self, cx: &mut Cx) {
        if let Err(failure) = self.begin(cx) {
            fail(cx, self.session, failure);
        }
    }

    fn begin(&mut self, cx: &mut Cx) -> Result<(), String> {
        let channel = full_name(&self.place.channel, &self.hub.channels(cx))?;
        let (session, json, path) = (self.session, self.json, self.place.path.as_str());
        let asked = match &self.wish {
            Wish::List => self.hub.list_blob(cx, &channel, path, move |cx, list| {
                show(cx, session, list.and_then(|list| shown(&list, json)));
            }),
            Wish::Stat => self.hub.stat_blob(cx, &channel, path, move |cx, found| {
                show(cx, session, found.and_then(|(entry, checksum)| told(&entry, checksum, json)));
            }),
            Wish::Get(file) => self.hub.download_to(cx, &channel, path, file).map(|download| {
                let this = cx.this(self);
                attach!(cx, download.progress => this.on_progress);
                attach!(cx, download.done => this.on_done);
                attach!(cx, download.failed => this.on_failed);
            }),
        };
        asked.map_err(|error| error.to_string())
    }

    fn on_progress(&mut self, _cx: &mut Cx, bytes: u64, of: u64) {
        show_progress(&self.place.path, bytes, of);
    }

    fn on_done(&mut self, cx: &mut Cx) {
        end_progress();
        cx.quit();
    }

    fn on_failed(&mut self, cx: &mut Cx, why: String) {
        end_progress();
        fail(cx, self.session, format!("{}: {}", safe(&self.place.path), safe(&why)));
    }
}

fn fail(cx: &mut Cx, session: Handle<Session>, failure: String) {
    // A session that is gone has failed by itself.
    let _ = cx.with(session, |session, cx| session.fail(cx, failure));
}

fn show(cx: &mut Cx, session: Handle<Session>, text: Result<String, String>) {
    match text.and_then(|text| print(cx, &text)) {
        Ok(()) => cx.quit(),
        Err(failure) => fail(cx, session, failure),
    }
}

/// For people, and only where they look.
fn show_progress(path: &str, bytes: u64, of: u64) {
    let mut out = std::io::stderr();
    if out.is_terminal() {
        let percent = bytes.saturating_mul(100).checked_div(of).unwrap_or(100);
        // A terminal that is gone shows nothing.
        let _ = write!(out, "\r{}: {percent} % of {of} bytes", safe(path));
    }
}

fn end_progress() {
    let mut out = std::io::stderr();
    if out.is_terminal() {
        let _ = writeln!(out);
    }
}

fn shown(entries: &[BlobEntry], json: bool) -> Result<String, String> {
    let line = |entry: &BlobEntry| match (json, entry.is_folder) {
        (true, _) => as_json(entry, None),
        (false, true) => Ok(format!("{:>12}  {}/\n", "-", safe(&entry.name))),
        (false, false) => Ok(format!("{:>12}  {}\n", entry.bytes, safe(&entry.name))),
    };
    entries.iter().map(line).collect()
}

fn told(entry: &BlobEntry, checksum: u32, json: bool) -> Result<String, String> {
    match (json, entry.is_folder) {
        (true, is_folder) => as_json(entry, (!is_folder).then_some(checksum)),
        (false, true) => Ok("a folder\n".to_owned()),
        (false, false) => Ok(format!("{} bytes, CRC-32 {checksum:08x}\n", entry.bytes)),
    }
}

fn as_json(entry: &BlobEntry, checksum: Option<u32>) -> Result<String, String> {
    let mut fields = vec![("folder", SkVariant::from(entry.is_folder)), ("bytes", entry.bytes.into())];
    if !entry.name.is_empty() {
        fields.push(("name", entry.name.as_str().into()));
    }
    if let Some(checksum) = checksum {
        fields.push(("crc32", checksum.into()));
    }
    let json = SkVariant::map(fields).to_json().map_err(|error| error.to_string())?;
    Ok(json + "\n")
}

/// Owns a blob channel while it runs.
struct Server {
    blob: Handle<FlowBlob>,
    session: Handle<Session>,
    files: Vec<PathBuf>,
    name: String,
    left: usize,
}

object! { Server { slots { on_entered() on_progress(&BlobProgress) on_saved(String) on_refused(String, String) } } }

fn serve(arguments: &Arguments, task: &BlobServe) -> Result<(), String> {
    let mut visit = Visit::begin(arguments)?;
    let (hub, session) = (visit.hub, visit.session);
    let cx = visit.app.cx();
    let blob = hub.blob(cx, &task.name).map_err(|error| error.to_string())?;
    let (files, name) = (task.files.clone(), task.name.clone());
    let left = files.len();
    let server = cx.spawn(Server { blob, session, files, name, left });
    attach!(cx, session.entered => server.on_entered, Queued);
    attach!(cx, blob.progress => server.on_progress);
    attach!(cx, blob.saved => server.on_saved);
    attach!(cx, blob.refused => server.on_refused);
    visit.run()
}

impl Server {
    fn on_entered(&mut self, cx: &mut Cx) -> Result<(), String> {
        for file in std::mem::take(&mut self.files) {
            let name = file.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            if !self.blob.upload_file(cx, name, &file) {
                let failure = format!("{} has a name that no file in a blob channel has", file.display());
                fail(cx, self.session, failure);
            }
        }
        self.say_if_ready(cx)
    }

    fn on_progress(&mut self, _cx: &mut Cx, progress: &BlobProgress) {
        show_progress(&progress.path, progress.bytes, progress.of);
    }

    fn on_saved(&mut self, cx: &mut Cx, _path: String) -> Result<(), String> {
        end_progress();
        self.left = self.left.saturating_sub(1);
        self.say_if_ready(cx)
    }

    fn on_refused(&mut self, cx: &mut Cx, path: String, why: String) {
        end_progress();
        fail(cx, self.session, format!("{}: {}", safe(&path), safe(&why)));
    }

    fn say_if_ready(&self, cx: &mut Cx) -> Result<(), String> {
        if self.left > 0 {
            return Ok(());
        }
        print(cx, &format!("{} is open until Ctrl-C\n", safe(&self.name)))
    }
}
