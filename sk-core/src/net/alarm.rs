//! A moment at which a socket is to be looked at again.

use crate::Cx;
use crate::eventloop::Timer;
use crate::object::ObjectId;
use std::time::Duration;

/// Calls a function on its parent once and goes. An object of its own, so that the parent is not leased
/// while the function runs.
pub(super) struct Alarm {
    of: ObjectId,
    wake: fn(&mut Cx, ObjectId),
}

impl Alarm {
    pub(super) fn set(cx: &mut Cx, of: ObjectId, after: Duration, wake: fn(&mut Cx, ObjectId)) {
        let alarm = cx.under(of).spawn(Alarm { of, wake });
        let timer = cx.under(alarm).spawn(Timer::default());
        crate::attach!(cx, timer.timeout => alarm.ring);
        // It cannot be gone: it was made in this round.
        let _ = timer.start_once(cx, after);
    }

    fn ring(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        cx.destroy_later(this);
        (self.wake)(cx, self.of);
    }
}

crate::object! { Alarm { slots { ring() } } }
