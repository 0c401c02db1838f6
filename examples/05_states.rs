//! A door: closed -> opening (2 pulses) -> open -> closing -> closed, with a timeout that a person in the door restarts.
use sk_core::prelude::*;

#[derive(PartialEq, Debug, Clone, Copy)]
enum State {
    Closed,
    Opening,
    Open,
    Closing,
}

struct Door {
    state: State,
    timer: Handle<Timer>,
    changed: Signal<&'static str>,
}
impl Door {
    fn new(cx: &mut Cx, this: Handle<Door>) -> Door {
        let timer = cx.spawn_under(this, Timer::default()); // the parent is not placed yet
        attach!(cx, timer.timeout => this.on_timeout); // S54: attach in the constructor
        Door { state: State::Closed, timer, changed: Signal::new() }
    }
    fn go(&mut self, cx: &mut Cx, to: State, ms: u64) {
        self.state = to;
        self.changed.emit(
            cx,
            match to {
                State::Closed => "closed",
                State::Opening => "opening",
                State::Open => "open",
                State::Closing => "closing",
            },
        );
        if ms > 0 {
            let _ = cx.with(self.timer, |t, cx| t.start_once(cx, Duration::from_millis(ms)));
        }
    }
    fn press(&mut self, cx: &mut Cx) {
        if self.state != State::Open {
            self.go(cx, State::Opening, 20)
        }
    }
    fn person(&mut self, cx: &mut Cx) {
        if self.state != State::Closed {
            self.go(cx, State::Open, 50)
        }
    }
    fn on_timeout(&mut self, cx: &mut Cx) {
        match self.state {
            State::Opening => self.go(cx, State::Open, 50),
            State::Open => self.go(cx, State::Closing, 20),
            State::Closing => self.go(cx, State::Closed, 0),
            State::Closed => {}
        }
    }
}
object! { Door { signals { changed(&'static str) } slots { press() person() on_timeout() } } }

struct Log(u32);
impl Log {
    fn note(&mut self, cx: &mut Cx, what: &'static str) {
        self.0 += 1;
        println!("{what}");
        if what == "closed" {
            cx.quit()
        }
    }
}
object! { Log { signals {} slots { note(&'static str) } } }

fn main() {
    let mut app = SkApp::new();
    let cx = app.cx();
    let door = cx.spawn_with(Door::new);
    let log = cx.spawn(Log(0));
    attach!(cx, door.changed => log.note);
    attach!(cx, cx.slow_zone().pulse => door.press, OneShot); // someone presses once
    app.run();
}
