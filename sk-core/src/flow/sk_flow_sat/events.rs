//! What the hub says, told as signals.

use super::SkFlowSat;
use crate::Cx;
use crate::flow::FlowMessage;
use crate::flow::satellite::SatelliteEvent;
use crate::object::Handle;

/// Emits what the hub said, unleased: a slot may publish on the satellite that called it.
pub(super) fn tell_all(cx: &mut Cx, satellite: Handle<SkFlowSat>) {
    while let Ok(Some(event)) = cx.with(satellite, |satellite, cx| satellite.next_event(cx)) {
        super::databases::commands::tell_told(cx, satellite);
        super::asking::tell_answers(cx, satellite);
        super::blobs::tell_told(cx, satellite);
        tell(cx, satellite, event);
    }
    super::databases::commands::tell_told(cx, satellite);
    super::asking::tell_answers(cx, satellite);
    super::blobs::tell_told(cx, satellite);
    let _ = cx.with(satellite, |satellite, cx| satellite.carry_on(cx));
}

fn tell(cx: &mut Cx, satellite: Handle<SkFlowSat>, event: SatelliteEvent) {
    if super::services::tell(cx, satellite, &event) {
        return;
    }
    match event {
        SatelliteEvent::Ready => cx.emit_own(satellite, |s| &s.ready, &()),
        SatelliteEvent::ChannelAdded(info) => cx.emit_own(satellite, |s| &s.channel_added, &info),
        SatelliteEvent::ChannelRemoved(info) => cx.emit_own(satellite, |s| &s.channel_removed, &info),
        SatelliteEvent::HeaderChanged { info, .. } => cx.emit_own(satellite, |s| &s.header_changed, &info),
        SatelliteEvent::OwnerChanged(info) => cx.emit_own(satellite, |s| &s.owner_changed, &info),
        SatelliteEvent::Room(channel) => {
            if let Ok(Some(name)) = cx.with(satellite, |s, _| s.own_name_of(channel)) {
                cx.emit_own(satellite, |s| &s.room, &name);
            }
        }
        SatelliteEvent::StartPublishing(channel) => {
            if let Ok(Some(name)) = cx.with(satellite, |s, _| s.own_name_of(channel)) {
                cx.emit_own(satellite, |s| &s.start_publishing, &name);
            }
        }
        SatelliteEvent::StopPublishing(channel) => {
            if let Ok(Some(name)) = cx.with(satellite, |s, _| s.own_name_of(channel)) {
                cx.emit_own(satellite, |s| &s.stop_publishing, &name);
            }
        }
        SatelliteEvent::Message { channel, payload } => {
            if let Ok(Some(info)) = cx.with(satellite, |s, _| s.heard_channel(channel)) {
                cx.emit_own(satellite, |s| &s.message, &FlowMessage::new(info, payload));
            }
        }
        SatelliteEvent::Dropped { channel, reason, total } => {
            let name = cx.with(satellite, |s, _| s.heard_channel(channel).map(|info| info.name.clone()));
            if let Ok(Some(name)) = name {
                let reason = reason.map_or_else(|| "unknown".to_owned(), |reason| reason.to_string());
                cx.emit_own(satellite, |s| &s.dropped, &(name, reason, total));
            }
        }
        SatelliteEvent::Refused { text, .. } => cx.emit_own(satellite, |s| &s.refused, &text),
        SatelliteEvent::Closing { text, .. } => {
            // Before anything was allowed it is a refusal; later it is why the hub is lost.
            let refused = cx.with(satellite, |s, _| {
                s.farewell = Some(text.clone());
                !s.was_ready
            });
            if refused == Ok(true) {
                cx.emit_own(satellite, |s| &s.refused, &text);
            }
        }
        SatelliteEvent::TickReport(report) => cx.emit_own(satellite, |s| &s.sync_report, &report),
        _ => {}
    }
}
