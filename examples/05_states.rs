//! A door: closed -> opening -> open -> closing -> closed, with a time-out that a person in the door restarts.
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
    changed: Signal<State>,
}

impl Door {
    fn new(cx: &mut Cx, this: Handle<Door>) -> Door {
        let timer = cx.under(this).spawn(Timer::default());
        attach!(cx, timer.timeout => this.on_timeout);
        Door { state: State::Closed, timer, changed: Signal::new() }
    }

    fn go(&mut self, cx: &mut Cx, to: State, stay: Duration) -> Result<(), Access> {
        self.state = to;
        self.changed.emit(cx, to);
        if stay.is_zero() { self.timer.stop(cx) } else { self.timer.start_once(cx, stay) }
    }

    fn press(&mut self, cx: &mut Cx) -> Result<(), Access> {
        match self.state {
            State::Open => Ok(()),
            _ => self.go(cx, State::Opening, Duration::from_millis(20)),
        }
    }

    fn person(&mut self, cx: &mut Cx) -> Result<(), Access> {
        match self.state {
            State::Closed => Ok(()),
            _ => self.go(cx, State::Open, Duration::from_millis(50)),
        }
    }

    fn on_timeout(&mut self, cx: &mut Cx) -> Result<(), Access> {
        match self.state {
            State::Opening => self.go(cx, State::Open, Duration::from_millis(50)),
            State::Open => self.go(cx, State::Closing, Duration::from_millis(20)),
            State::Closing => self.go(cx, State::Closed, Duration::ZERO),
            State::Closed => Ok(()),
        }
    }
}
object! { Door { signals { changed(State) } slots { press() person() on_timeout() } } }

#[derive(Default)]
struct Log {
    steps: u32,
}
impl Log {
    fn note(&mut self, cx: &mut Cx, state: State) {
        self.steps += 1;
        println!("{state:?}");
        if state == State::Closed {
            cx.quit();
        }
    }
}
object! { Log { slots { note(State) } } }

fn main() {
    let mut app = SkApp::new();
    let cx = app.cx();
    let door = cx.spawn_with(Door::new);
    let log = cx.spawn(Log::default());
    attach!(cx, door.changed => log.note);
    attach!(cx, cx.slow_zone().pulse => door.press, OneShot); // someone presses once …
    attach!(cx, door.changed => door.person(), Queued.once()); // … and walks through as it opens
    app.run();
}
