//! POSIX signals of the real kernel, in a test binary of their own.

mod objects;

use nix::sys::signal::{Signal as Posix, raise};
use objects::*;
use sk_core::prelude::*;
use sk_core::world::OsSignal;

struct Listener(Log);
impl Listener {
    fn heard(&mut self, cx: &mut Cx, signal: OsSignal) {
        self.0.note(format!("{signal:?}"));
        if signal == OsSignal::Terminate {
            cx.quit();
        }
    }
}
object! { Listener { slots { heard(OsSignal) } } }

fn app(mode: TimingMode) -> SkApp {
    SkApp::builder().mode(mode).interval(ms(1)).build().unwrap()
}

#[test]
fn posix_signals_arrive_as_a_signal_of_the_app() {
    for mode in [TimingMode::SelectIo, TimingMode::Coarse, TimingMode::Realtime, TimingMode::NoTiming] {
        let log = Log::default();
        let mut app = app(mode);
        let cx = app.cx();
        let listener = cx.spawn(Listener(log.clone()));
        attach!(cx, cx.event_loop().os_signal => listener.heard);
        app.pulse();
        raise(Posix::SIGINT).unwrap();
        raise(Posix::SIGTERM).unwrap();
        raise(Posix::SIGHUP).unwrap();
        assert_eq!(app.run(), Run::Quit);
        // Signals that wait together come in the kernel's order: that of their numbers.
        assert_eq!(log.take(), ["HangUp", "Interrupt", "Terminate"], "{mode:?}");
    }
}

#[test]
fn a_posix_signal_that_nobody_hears_ends_the_app_and_its_objects() {
    let log = Log::default();
    let mut app = app(TimingMode::SelectIo);
    app.cx().spawn(Lamp::new("lamp", &log));
    raise(Posix::SIGTERM).unwrap();
    assert_eq!(app.run(), Run::Quit);
    drop(app);
    assert_eq!(log.take(), ["lamp goes", "lamp dropped"]);
}
