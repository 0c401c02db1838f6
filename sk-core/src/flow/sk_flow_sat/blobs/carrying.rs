//! Where the porter's work is done: on the loop, on a worker, and what the user is told of it.

use super::super::SkFlowSat;
use super::errands::{Errand, Fetched};
use super::objects::{FlowBlob, FlowDownload};
use super::porter::Told;
use crate::Cx;
use crate::object::Handle;
use crate::world::Job;

impl SkFlowSat {
    /// Sends what can be sent of blobs, and hands to the worker what is to be done there.
    pub(in super::super) fn carry_on(&mut self, cx: &mut Cx) {
        if let Some(core) = &mut self.core {
            self.porter.go_on(core);
        }
        self.porter.give_up_downloads(|download| cx.is_alive(download));
        let this = cx.this(self);
        while let Some(errand) = self.porter.errands.pop_front() {
            if let Errand::Send { id, offset, piece } = errand {
                if let Some(core) = &mut self.core {
                    self.porter.send_piece(core, id, offset, piece);
                    self.porter.go_on(core);
                }
                continue;
            }
            let (storage, remote) = (cx.world().storage.clone(), cx.remote(this));
            let job: Job = Box::new(move || {
                if let Some(fetched) = errand.run(&*storage) {
                    // A satellite that is gone waits for nothing.
                    let _ = remote.post(move |satellite, cx| satellite.on_fetched(cx, fetched));
                }
            });
            self.porter.stalled.push_back(job);
        }
        while let Some(job) = self.porter.stalled.pop_front() {
            // Without room now it is tried again at the next check.
            if let Err(job) = cx.world().worker.run(job) {
                self.porter.stalled.push_front(job);
                break;
            }
        }
        self.flush_later(cx);
    }

    fn on_fetched(&mut self, cx: &mut Cx, fetched: Fetched) {
        self.porter.fetched(fetched);
        self.carry_on(cx);
        let this = cx.this(self);
        cx.post_own(this, move |cx| tell_told(cx, this));
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
