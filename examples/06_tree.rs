//! A supervisor restarts failing workers; a worker may bury its own parent from a slot.
use sk_core::prelude::*;

struct Worker {
    n: u32,
    failed: Signal<(Handle<Worker>, String)>,
}
impl Worker {
    fn work(&mut self, cx: &mut Cx) {
        self.n += 1;
        if self.n == 3 {
            let me = cx.this(self);
            self.failed.emit(cx, (me, "worn out".to_string()));
            cx.destroy_later(me);
        }
    }
    fn on_destroy(&mut self, _cx: &mut Cx) {
        println!("  worker goes after {} calls", self.n)
    }
}
object! { Worker { signals { failed(Handle<Worker>, &str) } slots { work() } hooks { on_destroy } } }

#[derive(Default)]
struct Supervisor {
    restarts: u32,
    worker: Option<Handle<Worker>>,
    gave_up: Signal<u32>,
}
impl Supervisor {
    fn on_spawn(&mut self, cx: &mut Cx) {
        self.start(cx)
    }
    fn start(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        let worker = cx.under(this).spawn(Worker { n: 0, failed: Signal::new() });
        attach!(cx, worker.failed => this.on_failed, Queued);
        attach!(cx, cx.fast_zone().pulse => worker.work);
        self.worker = Some(worker);
    }
    fn on_failed(&mut self, cx: &mut Cx, who: Handle<Worker>, why: &str) {
        println!("{who:?} failed: {why}");
        self.restarts += 1;
        if self.restarts < 3 { self.start(cx) } else { self.gave_up.emit(cx, self.restarts) }
    }
    fn on_destroy(&mut self, cx: &mut Cx) {
        println!("supervisor goes");
        cx.quit()
    }
}
object! { Supervisor { signals { gave_up(u32) } slots { on_failed(Handle<Worker>, &str) } hooks { on_spawn on_destroy } } }

struct Assassin {
    parent: Handle<Supervisor>,
}
impl Assassin {
    fn strike(&mut self, cx: &mut Cx) {
        cx.destroy_later(self.parent)
    }
    fn on_destroy(&mut self, _: &mut Cx) {
        println!("  assassin goes too")
    }
}
object! { Assassin { signals {} slots { strike() } hooks { on_destroy } } }

fn main() {
    let mut app = SkApp::new();
    let cx = app.cx();
    let boss = cx.spawn(Supervisor::default());
    let child = cx.under(boss).spawn(Assassin { parent: boss });
    attach!(cx, boss.gave_up => child.strike());
    app.run();
    assert!(!app.cx().is_alive(boss) && !app.cx().is_alive(child));
}
