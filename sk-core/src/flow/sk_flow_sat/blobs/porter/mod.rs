//! Who carries files between a satellite and its hub. It knows no disk and no thread: what is to be done there it
//! asks for as errands.

pub(super) mod downloads;
pub(super) mod uploads;

use super::super::super::Command;
use super::super::super::Path;
use super::super::super::blob::BlobEntry;
use super::super::super::satellite::{SatelliteCore, SatelliteEvent};
use super::errands::{Errand, Fetched, Source};
use super::objects::{BlobProgress, FlowBlob, FlowDownload};
use crate::Cx;
use crate::flow::ChannelRef;
use crate::object::Handle;
use crate::world::Job;
use bytes::Bytes;
use downloads::{Download, Sink};
use sk_flat::SkVariant;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use uploads::Upload;

/// How many uploads, downloads and commands may be under way or wait for a hub.
const WAITING_MAX: usize = 1_024;
/// Why what was sent has no answer.
const LOST: &str = "the hub was lost before it answered";

pub(super) type ListAnswer = Box<dyn FnOnce(&mut Cx, Result<Vec<BlobEntry>, String>)>;
pub(super) type LookAnswer = Box<dyn FnOnce(&mut Cx, Result<(BlobEntry, u32), String>)>;

/// What is to be done at a path of one's own.
pub(super) enum Order {
    Abort,
    MakeFolder,
    Move { from: String },
    Remove,
}

/// What a command that was sent was for.
pub(super) enum Sent {
    Begin(u64),
    Piece(u64, u64),
    Commit(u64),
    Order(Handle<FlowBlob>, String),
    /// The end of an upload that was given up: nobody wants to know.
    Quiet,
    List(ListAnswer),
    Look(LookAnswer),
    DownloadLook(u64),
    DownloadRead(u64),
}

/// What is to be told to the user, when the satellite is not leased.
pub(super) enum Told {
    Progress(Handle<FlowBlob>, BlobProgress),
    Saved(Handle<FlowBlob>, String),
    Refused(Handle<FlowBlob>, String, String),
    Data(Handle<FlowDownload>, Bytes),
    Came(Handle<FlowDownload>, u64, u64),
    Done(Handle<FlowDownload>),
    Failed(Handle<FlowDownload>, String),
    Listed(ListAnswer, Result<Vec<BlobEntry>, String>),
    Looked(LookAnswer, Result<(BlobEntry, u32), String>),
}

/// A blob channel of one's own.
pub(super) struct Own {
    pub(super) object: Handle<FlowBlob>,
    properties: SkVariant,
    pub(super) channel: Option<ChannelRef>,
    orders: VecDeque<(String, Order)>,
}

enum Question {
    List(ListAnswer),
    Look(LookAnswer),
}

#[derive(Default)]
pub(in super::super) struct Porter {
    pub(super) own: BTreeMap<Rc<str>, Own>,
    uploads: BTreeMap<u64, Upload>,
    downloads: BTreeMap<u64, Download>,
    /// Questions that wait for their channel.
    questions: VecDeque<(String, String, Question)>,
    pub(super) sent: BTreeMap<u32, Sent>,
    pub(super) told: VecDeque<Told>,
    pub(super) errands: VecDeque<Errand>,
    /// What the worker had no room for.
    pub(super) stalled: VecDeque<Job>,
    last: u64,
}

impl Porter {
    pub(super) fn object(&self, name: &str) -> Option<Handle<FlowBlob>> {
        self.own.get(name).map(|own| own.object)
    }

    pub(in super::super) fn has(&self, name: &str) -> bool {
        self.own.contains_key(name)
    }

    /// The object of a name, and its channel if it is there.
    pub(in super::super) fn channel_of(&self, name: &str) -> Option<(Handle<FlowBlob>, Option<ChannelRef>)> {
        self.own.get(name).map(|own| (own.object, own.channel))
    }

    /// The channel is wanted no more: what was to be done in it is given up.
    pub(in super::super) fn close(&mut self, name: &str) {
        self.own.remove(name);
        self.uploads.retain(|_, upload| *upload.blob != *name);
    }

    /// Asks for the channel of this name, if it is wanted and not there.
    pub(in super::super) fn open_if_missing(&self, core: &mut SatelliteCore, name: &str) {
        if let Some(own) = self.own.get(name).filter(|own| own.channel.is_none()) {
            create(core, name, &own.properties);
        }
    }

    pub(super) fn add(
        &mut self,
        core: Option<&mut SatelliteCore>,
        name: &Rc<str>,
        properties: SkVariant,
        object: Handle<FlowBlob>,
    ) {
        if let Some(core) = core.filter(|core| core.is_ready()) {
            create(core, name, &properties);
        }
        self.own
            .insert(name.clone(), Own { object, properties, channel: None, orders: VecDeque::new() });
    }

    pub(super) fn next_told(&mut self) -> Option<Told> {
        self.told.pop_front()
    }

    pub(super) fn next_id(&mut self) -> u64 {
        self.last += 1;
        self.last
    }

    fn has_room(&self) -> bool {
        let orders: usize = self.own.values().map(|own| own.orders.len()).sum();
        self.uploads.len() + self.downloads.len() + self.questions.len() + self.sent.len() + orders
            < WAITING_MAX
    }

    pub(super) fn upload(&mut self, name: &Rc<str>, path: &str, source: Source) -> bool {
        if !self.has_room() {
            return false;
        }
        self.uploads.retain(|_, upload| upload.blob != *name || upload.path != path);
        let id = self.next_id();
        self.errands.push_back(Errand::Survey { id, source: source.clone() });
        self.uploads.insert(id, Upload::new(name.clone(), path, source));
        true
    }

    pub(super) fn order(&mut self, name: &Rc<str>, path: &str, order: Order) -> bool {
        if !self.has_room() {
            return false;
        }
        if matches!(order, Order::Abort) {
            self.uploads.retain(|_, upload| upload.blob != *name || upload.path != path);
        }
        let Some(own) = self.own.get_mut(name) else { return false };
        own.orders.push_back((path.to_owned(), order));
        true
    }

    pub(super) fn list(&mut self, channel: &str, path: &str, answer: ListAnswer) -> bool {
        self.question(channel, path, Question::List(answer))
    }

    pub(super) fn look(&mut self, channel: &str, path: &str, answer: LookAnswer) -> bool {
        self.question(channel, path, Question::Look(answer))
    }

    fn question(&mut self, channel: &str, path: &str, question: Question) -> bool {
        let has_room = self.has_room();
        if has_room {
            self.questions.push_back((channel.to_owned(), path.to_owned(), question));
        }
        has_room
    }

    pub(super) fn download(
        &mut self,
        channel: &str,
        path: &str,
        object: Handle<FlowDownload>,
        sink: Sink,
    ) -> bool {
        let has_room = self.has_room();
        if has_room {
            let id = self.next_id();
            self.downloads.insert(id, Download::new(channel, path, object, sink));
        }
        has_room
    }

    /// A hub is there again: the channels are opened anew.
    pub(in super::super) fn restore(&mut self, core: &mut SatelliteCore) {
        // Those that the hub kept have their channels already.
        for (name, own) in self.own.iter().filter(|(_, own)| own.channel.is_none()) {
            create(core, name, &own.properties);
        }
    }

    /// The hub is lost. Uploads and downloads go on with the next one; of commands nobody knows what became.
    pub(in super::super) fn lose(&mut self) {
        for own in self.own.values_mut() {
            own.channel = None;
        }
        self.uploads.values_mut().for_each(Upload::pause);
        self.downloads.values_mut().for_each(Download::pause);
        for sent in std::mem::take(&mut self.sent).into_values() {
            match sent {
                Sent::Order(object, path) => {
                    self.told.push_back(Told::Refused(object, path, LOST.to_owned()));
                }
                Sent::List(answer) => self.told.push_back(Told::Listed(answer, Err(LOST.to_owned()))),
                Sent::Look(answer) => self.told.push_back(Told::Looked(answer, Err(LOST.to_owned()))),
                _ => {}
            }
        }
    }

    /// Sends what can be sent now.
    pub(super) fn go_on(&mut self, core: &mut SatelliteCore) {
        if !core.is_ready() {
            return;
        }
        self.send_orders(core);
        self.send_questions(core);
        self.go_on_uploading(core);
        self.go_on_downloading(core);
    }

    fn send_orders(&mut self, core: &mut SatelliteCore) {
        for own in self.own.values_mut() {
            let Some(channel) = own.channel else { continue };
            while let Some((path, order)) = own.orders.pop_front() {
                let at = Path(path.clone());
                let command = match &order {
                    Order::Abort => Command::BlobAbort { channel, path: at },
                    Order::MakeFolder => Command::BlobMkdir { channel, path: at },
                    Order::Move { from } => Command::BlobMove { channel, from: Path(from.clone()), to: at },
                    Order::Remove => Command::BlobRemove { channel, path: at },
                };
                let Ok(tag) = core.blob(&command) else {
                    own.orders.push_front((path, order));
                    break;
                };
                let sent = match order {
                    Order::Abort => Sent::Quiet,
                    _ => Sent::Order(own.object, path),
                };
                self.sent.insert(tag, sent);
            }
        }
    }

    fn send_questions(&mut self, core: &mut SatelliteCore) {
        for (name, path, question) in std::mem::take(&mut self.questions) {
            let command = core.channel(&name).map(|info| info.channel).map(|channel| match question {
                Question::List(_) => Command::BlobList { channel, path: Path(path.clone()) },
                Question::Look(_) => Command::BlobStat { channel, path: Path(path.clone()) },
            });
            match command.and_then(|command| core.blob(&command).ok()) {
                Some(tag) => {
                    let sent = match question {
                        Question::List(answer) => Sent::List(answer),
                        Question::Look(answer) => Sent::Look(answer),
                    };
                    self.sent.insert(tag, sent);
                }
                None => self.questions.push_back((name, path, question)),
            }
        }
    }

    /// Takes an event that is about blobs alone; answers whether it was.
    pub(in super::super) fn hear(&mut self, core: &mut SatelliteCore, event: &SatelliteEvent) -> bool {
        let heard = match event {
            SatelliteEvent::Created { channel, name, .. } => {
                if let Some(own) = self.own.get_mut(super::super::own_name(name)) {
                    own.channel = Some(*channel);
                }
                false
            }
            SatelliteEvent::ChannelRemoved(info) => {
                self.removed(info.channel);
                false
            }
            SatelliteEvent::ChannelAdded(_) => false,
            SatelliteEvent::BlobResume { tag, offset } => self.resumed(*tag, *offset),
            SatelliteEvent::Done { tag } => self.done(*tag),
            SatelliteEvent::Saved { tag } => self.saved(*tag),
            SatelliteEvent::BlobEntries { tag, entries } => self.listed(*tag, entries),
            SatelliteEvent::BlobLooked { tag, entry, checksum } => self.looked(*tag, entry, *checksum),
            SatelliteEvent::BlobData { tag, payload, last } => self.came(*tag, payload, *last),
            SatelliteEvent::Refused { tag, text, .. } => self.refused(*tag, text),
            _ => return false,
        };
        self.go_on(core);
        heard
    }

    fn removed(&mut self, channel: ChannelRef) {
        for (name, own) in &mut self.own {
            if own.channel == Some(channel) {
                own.channel = None;
                let of_it = self.uploads.values_mut().filter(|upload| upload.blob == *name);
                of_it.for_each(Upload::pause);
            }
        }
    }

    /// The entry of a tag, if it is one that this event answers.
    fn take_sent(&mut self, tag: u32, is: impl Fn(&Sent) -> bool) -> Option<Sent> {
        if self.sent.get(&tag).is_some_and(is) { self.sent.remove(&tag) } else { None }
    }

    fn resumed(&mut self, tag: u32, offset: u64) -> bool {
        if let Some(Sent::Begin(id)) = self.take_sent(tag, |sent| matches!(sent, Sent::Begin(_)))
            && let Some(upload) = self.uploads.get_mut(&id)
        {
            upload.resumed(offset);
        }
        true
    }

    fn done(&mut self, tag: u32) -> bool {
        match self.take_sent(tag, |sent| matches!(sent, Sent::Piece(..) | Sent::Quiet)) {
            Some(Sent::Piece(id, bytes)) => self.piece_done(id, bytes),
            Some(_) => {}
            None => return false,
        }
        true
    }

    fn saved(&mut self, tag: u32) -> bool {
        match self.take_sent(tag, |sent| matches!(sent, Sent::Commit(_) | Sent::Order(..))) {
            Some(Sent::Commit(id)) => self.committed(id),
            Some(Sent::Order(object, path)) => self.told.push_back(Told::Saved(object, path)),
            _ => return false,
        }
        true
    }

    fn listed(&mut self, tag: u32, entries: &[BlobEntry]) -> bool {
        if let Some(Sent::List(answer)) = self.take_sent(tag, |sent| matches!(sent, Sent::List(_))) {
            self.told.push_back(Told::Listed(answer, Ok(entries.to_vec())));
        }
        true
    }

    fn looked(&mut self, tag: u32, entry: &BlobEntry, checksum: u32) -> bool {
        match self.take_sent(tag, |sent| matches!(sent, Sent::Look(_) | Sent::DownloadLook(_))) {
            Some(Sent::Look(answer)) => {
                self.told.push_back(Told::Looked(answer, Ok((entry.clone(), checksum))));
            }
            Some(Sent::DownloadLook(id)) => self.download_looked(id, entry, checksum),
            _ => {}
        }
        true
    }

    fn came(&mut self, tag: u32, payload: &Bytes, last: bool) -> bool {
        let Some(Sent::DownloadRead(id)) = self.sent.get(&tag) else { return true };
        let id = *id;
        if last {
            self.sent.remove(&tag);
        }
        self.download_came(id, payload, last);
        true
    }

    fn refused(&mut self, tag: u32, why: &str) -> bool {
        let Some(sent) = self.sent.remove(&tag) else { return false };
        let why = why.to_owned();
        match sent {
            Sent::Begin(id) | Sent::Piece(id, _) | Sent::Commit(id) => self.upload_failed(id, why),
            Sent::Order(object, path) => self.told.push_back(Told::Refused(object, path, why)),
            Sent::Quiet => {}
            Sent::List(answer) => self.told.push_back(Told::Listed(answer, Err(why))),
            Sent::Look(answer) => self.told.push_back(Told::Looked(answer, Err(why))),
            Sent::DownloadLook(id) | Sent::DownloadRead(id) => self.download_failed(id, why),
        }
        true
    }

    /// An errand was run.
    pub(super) fn fetched(&mut self, fetched: Fetched) {
        match fetched {
            Fetched::Surveyed { id, outcome } => self.surveyed(id, outcome),
            Fetched::Piece { id, offset, outcome } => self.piece_read(id, offset, outcome),
            Fetched::Kept { id, outcome } => self.download_kept(id, outcome),
        }
    }
}

fn create(core: &mut SatelliteCore, name: &str, properties: &SkVariant) {
    if let Err(error) = core.create_blob(name, properties) {
        tracing::error!("blob channel {name} cannot be opened: {error}");
    }
}
