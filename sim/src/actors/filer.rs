//! A satellite that keeps files in a blob channel of the hub's, and looks at those of others.
//!
//! It has one change of its channel under way at a time, so that it is known which one an answer is for.

use crate::action::Action;
use crate::files::{BYTES_MIN, Change, Content, Look, PATHS, Sight, Thing, sight_of};
use crate::identity::Identity;
use crate::ledger;
use crate::rule::Rule;
use crate::script::Way;
use crate::stamp::{USER, files_name};
use crate::wishes::Wishes;
use bytes::Bytes;
use sk_core::flow::{FlowBlob, RefusalCode, SkFlowSat};
use sk_core::prelude::*;
use std::collections::VecDeque;

/// The folder among the paths.
const FOLDER_PATH: &str = PATHS[PATHS.len() - 1];

/// A program around an `SkFlowSat` that keeps files.
pub(crate) struct Filer {
    who: Identity,
    hub: Handle<SkFlowSat>,
    files: Handle<FlowBlob>,
    orders: VecDeque<Change>,
    under_way: Option<Change>,
    /// Questions and downloads that have no answer.
    open_looks: usize,
    ready: bool,
}

object! {
    pub(crate) Filer {
        slots { let_in() lose() refused(&str) saved(&str) not_saved(&str, &str) }
    }
}

/// A download that gathers what comes.
struct Gatherer {
    filer: Handle<Filer>,
    look: Look,
    came: Vec<u8>,
}

object! { Gatherer { slots { data(&Bytes) done() failed(&str) } } }

impl Filer {
    pub(crate) fn start(cx: &mut Cx, who: Identity, way: Way) -> Option<Handle<Filer>> {
        let hub = SkFlowSat::connect_as(cx, &way.address(who.hub), way.credentials(who.home));
        let files = hub.blob(cx, &files_name(who.node)).ok()?;
        let (orders, under_way) = (VecDeque::new(), None);
        let this = cx.spawn(Filer { who, hub, files, orders, under_way, open_looks: 0, ready: false });
        attach!(cx, hub.ready => this.let_in);
        attach!(cx, hub.lost => this.lose());
        attach!(cx, hub.refused => this.refused);
        attach!(cx, files.saved => this.saved);
        attach!(cx, files.refused => this.not_saved);
        Some(this)
    }

    pub(crate) fn act(&mut self, cx: &mut Cx, action: Action) {
        let path = |number: u8| PATHS[usize::from(number) % PATHS.len()];
        match action {
            Action::Put(at, version, bytes) => {
                let bytes = bytes.max(BYTES_MIN);
                let content = Content { node: self.who.node, version, bytes };
                self.orders.push_back(Change::Put(path(at), content));
            }
            Action::MakeFolder => self.orders.push_back(Change::MakeFolder(FOLDER_PATH)),
            // With a folder all that stands in it would move.
            Action::Shift(from, to)
                if path(from) != path(to) && ![path(from), path(to)].contains(&FOLDER_PATH) =>
            {
                self.orders.push_back(Change::Move(path(from), path(to)));
            }
            Action::Drop(at) => self.orders.push_back(Change::Remove(path(at))),
            Action::Fetch(node, at) => self.fetch(cx, node, path(at)),
            Action::Browse(node) => self.browse(cx, node),
            _ => {}
        }
        self.go_on(cx);
    }

    pub(crate) fn wishes(&self, cx: &mut Cx) -> Wishes {
        Wishes { ready: self.ready, connection: self.hub.connection(cx), ..Wishes::default() }
    }

    /// What it still waits for, in words.
    pub(crate) fn unfinished(&self) -> Option<String> {
        let node = self.who.node;
        // Nobody can look at the channel of one that got no identifier.
        let excused = ledger::with(|ledger| !ledger.without_identifier.is_empty());
        let is_done = self.under_way.is_none() && self.orders.is_empty() && self.open_looks == 0;
        (!is_done && !excused).then(|| {
            format!("n{node}: {:?} and {} questions have no answer", self.under_way, self.open_looks)
        })
    }

    fn go_on(&mut self, cx: &mut Cx) {
        while self.under_way.is_none()
            && let Some(change) = self.orders.pop_front()
        {
            ledger::with(|ledger| ledger.files.begins(self.who.node, change));
            self.under_way = Some(change);
            let accepted = match change {
                Change::Put(path, content) => self.files.upload(cx, path, content.make()),
                Change::MakeFolder(path) => self.files.make_dir(cx, path),
                Change::Move(from, to) => self.files.move_to(cx, from, to),
                Change::Remove(path) => self.files.remove(cx, path),
            };
            if !accepted {
                self.finish(false);
            }
        }
    }

    fn finish(&mut self, well: bool) {
        self.under_way = None;
        ledger::with(|ledger| ledger.files.ended(self.who.node, well));
    }

    fn answered(&mut self, cx: &mut Cx, path: &str, well: bool) {
        let expected = self.under_way.map(|change| match change {
            Change::Put(path, _)
            | Change::MakeFolder(path)
            | Change::Move(_, path)
            | Change::Remove(path) => path,
        });
        ledger::with(|ledger| {
            ledger.now = cx.clock_now();
            ledger.note(&[17, well.into(), cx.clock_now().as_nanos()]);
            if expected != Some(path) {
                let text = format!("{path} was answered, {expected:?} was asked");
                ledger.complain(Rule::Files, text);
            }
        });
        self.finish(well);
        self.go_on(cx);
    }

    fn saved(&mut self, cx: &mut Cx, path: &str) {
        self.answered(cx, path, true);
    }

    fn not_saved(&mut self, cx: &mut Cx, path: &str, _why: &str) {
        self.answered(cx, path, false);
    }

    /// Downloads a file, and asks what stands there besides.
    fn fetch(&mut self, cx: &mut Cx, node: u16, path: &'static str) {
        let filer = cx.this(self);
        let channel = format!("{USER}.{}", files_name(node));
        let look = ledger::with(|ledger| ledger.files.look(node, path));
        if let Ok(download) = self.hub.download(cx, &channel, path) {
            let gatherer = cx.under(filer).spawn(Gatherer { filer, look, came: Vec::new() });
            attach!(cx, download.data => gatherer.data);
            attach!(cx, download.done => gatherer.done);
            attach!(cx, download.failed => gatherer.failed);
            self.open_looks += 1;
        }
        let answer = move |cx: &mut Cx, found: Result<(sk_core::flow::blob::BlobEntry, u32), String>| {
            let sight = match found {
                Ok((entry, _)) if entry.is_folder => Some(Sight::Thing(Thing::Folder)),
                Ok((entry, _)) => Some(Sight::Length(entry.bytes)),
                Err(why) => absence(&why),
            };
            end_look(cx, filer, look, sight);
        };
        if self.hub.stat_blob(cx, &channel, path, answer).is_ok() {
            self.open_looks += 1;
        }
    }

    /// Asks for all that stands in a channel's own folder.
    fn browse(&mut self, cx: &mut Cx, node: u16) {
        let filer = cx.this(self);
        let channel = format!("{USER}.{}", files_name(node));
        let here = PATHS.into_iter().filter(|path| !path.contains('/'));
        let looks: Vec<(&str, Look)> = here
            .map(|path| (path, ledger::with(|ledger| ledger.files.look(node, path))))
            .collect();
        let answer = move |cx: &mut Cx, listed: Result<Vec<sk_core::flow::blob::BlobEntry>, String>| {
            for (path, look) in listed.iter().flat_map(|_| &looks) {
                let entry = listed.iter().flatten().find(|entry| entry.name == *path);
                let sight = match entry {
                    None => Sight::Thing(Thing::Nothing),
                    Some(entry) if entry.is_folder => Sight::Thing(Thing::Folder),
                    Some(entry) => Sight::Length(entry.bytes),
                };
                judge(cx, *look, &sight);
            }
            let other = listed.iter().flatten().find(|entry| !PATHS.contains(&entry.name.as_str()));
            if let Some(other) = other {
                let text = format!("{other:?} stands in the channel of n{node}, and nobody put it there");
                ledger::with(|ledger| ledger.complain(Rule::Files, text));
            }
            let _ = cx.with(filer, |filer, _| filer.open_looks -= 1);
        };
        if self.hub.list_blob(cx, &channel, "", answer).is_ok() {
            self.open_looks += 1;
        }
    }

    fn let_in(&mut self, cx: &mut Cx) {
        self.ready = true;
        let connection = self.hub.connection(cx).unwrap_or(0);
        ledger::with(|ledger| {
            ledger.now = cx.clock_now();
            ledger.was_let_in(self.who, connection);
        });
    }

    fn lose(&mut self, _: &mut Cx) {
        self.ready = false;
    }

    fn refused(&mut self, _: &mut Cx, why: &str) {
        ledger::with(|ledger| ledger.was_refused(self.who.node, why));
    }
}

/// That nothing is there, if a refusal says so.
fn absence(why: &str) -> Option<Sight> {
    (why == RefusalCode::NoSuchPath.to_string()).then_some(Sight::Thing(Thing::Nothing))
}

fn judge(cx: &mut Cx, look: Look, sight: &Sight) {
    ledger::with(|ledger| {
        ledger.now = cx.clock_now();
        ledger.note(&[18, cx.clock_now().as_nanos()]);
        if let Some(wrong) = ledger.files.saw(look, sight) {
            ledger.complain(Rule::Files, wrong);
        }
    });
}

fn end_look(cx: &mut Cx, filer: Handle<Filer>, look: Look, sight: Option<Sight>) {
    if let Some(sight) = sight {
        judge(cx, look, &sight);
    }
    let _ = cx.with(filer, |filer, _| filer.open_looks -= 1);
}

impl Gatherer {
    fn data(&mut self, _: &mut Cx, bytes: &Bytes) {
        self.came.extend_from_slice(bytes);
    }

    fn done(&mut self, cx: &mut Cx) {
        let sight = sight_of(&self.came);
        self.end(cx, Some(sight));
    }

    fn failed(&mut self, cx: &mut Cx, why: &str) {
        if why.contains("replaced") {
            ledger::with(|ledger| {
                ledger.now = cx.clock_now();
                if let Some(wrong) = ledger.files.saw_pieces(self.look) {
                    ledger.complain(Rule::Files, wrong);
                }
            });
        }
        let is_folder = why == RefusalCode::WrongPath.to_string();
        let sight = if is_folder { None } else { absence(why) };
        self.end(cx, sight);
    }

    fn end(&mut self, cx: &mut Cx, sight: Option<Sight>) {
        end_look(cx, self.filer, self.look, sight);
        let this = cx.this(self);
        cx.destroy_later(this);
    }
}
