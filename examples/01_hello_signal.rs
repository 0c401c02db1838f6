//! A counter that tells a printer about every 1000th tick.
use sk_core::prelude::*;

#[derive(Default)]
struct Counter {
    ticks: u64,
    thousand: Signal<u64>,
}

impl Counter {
    fn on_tick(&mut self, cx: &mut Cx) {
        self.ticks += 1;
        if self.ticks.is_multiple_of(1000) {
            self.thousand.emit(cx, self.ticks)
        }
    }
}
object! { Counter { signals { thousand(u64) } slots { on_tick() } } }

struct Printer;
impl Printer {
    fn show(&mut self, cx: &mut Cx, n: u64) {
        println!("{n} ticks");
        if n == 3000 {
            cx.quit()
        }
    }
}
object! { Printer { signals {} slots { show(u64) } } }

fn main() -> Result<(), AppError> {
    let mut app = SkApp::builder().interval(Duration::from_millis(1)).build()?;
    let cx = app.cx();
    let counter = cx.spawn(Counter::default());
    let printer = cx.spawn(Printer);
    attach!(cx, cx.fast_zone().pulse => counter.on_tick);
    attach!(cx, counter.thousand => printer.show, Queued);
    app.run();
    Ok(())
}
