//! The shortest form of a program: a set-up, and a loop that is called at each pulse.

use crate::eventloop::{AppError, Cx, Run, SkApp, SkAppBuilder};
use crate::object::Handle;
use crate::signal::{IntoOutcome, Outcome};

/// A program in the manner of an Arduino sketch: `setup` makes its state once, `each_pulse` is its `loop`,
/// called at every fast tick.
///
/// ```
/// use sk_core::prelude::*;
///
/// let sketch = Sketch::setup(|_cx| 0).on(|app| app.interval(Duration::from_millis(1)));
/// sketch.each_pulse(|blinks, cx| {
///     *blinks += 1;
///     println!("blink {blinks}");
///     if *blinks == 3 {
///         cx.quit();
///     }
/// })?;
/// # Ok::<(), AppError>(())
/// ```
pub struct Sketch<M> {
    make: M,
    app: SkAppBuilder,
}

impl<S: 'static, M: FnOnce(&mut Cx) -> S> Sketch<M> {
    /// The set-up: it runs once, before the first pulse, and gives the state that the loop works on.
    pub fn setup(make: M) -> Sketch<M> {
        Sketch { make, app: SkApp::builder().name("sketch") }
    }

    /// Says how the sketch's application keeps time: `.on(|app| app.mode(TimingMode::Realtime))`.
    pub fn on(self, app: impl FnOnce(SkAppBuilder) -> SkAppBuilder) -> Sketch<M> {
        Sketch { make: self.make, app: app(self.app) }
    }

    /// Runs the sketch in an application of its own until `cx.quit()` or Ctrl-C. The loop may fail like a
    /// slot: its error is logged and the next pulse comes.
    ///
    /// # Errors
    /// If the application cannot be made.
    pub fn each_pulse<R: IntoOutcome>(
        self,
        step: impl FnMut(&mut S, &mut Cx) -> R + 'static,
    ) -> Result<Run, AppError> {
        let mut app = self.app.build()?;
        spawn(app.cx(), self.make, step);
        Ok(app.run())
    }

    /// Runs the sketch on a loop that exists, which keeps time as it does: several sketches can share one.
    /// Destroying the object ends the sketch.
    pub fn each_pulse_of<R: IntoOutcome>(
        self,
        cx: &mut Cx,
        step: impl FnMut(&mut S, &mut Cx) -> R + 'static,
    ) -> Handle<SketchObject> {
        spawn(cx, self.make, step)
    }
}

fn spawn<S: 'static, R: IntoOutcome>(
    cx: &mut Cx,
    make: impl FnOnce(&mut Cx) -> S,
    mut step: impl FnMut(&mut S, &mut Cx) -> R + 'static,
) -> Handle<SketchObject> {
    let mut state = make(cx);
    let step = Box::new(move |cx: &mut Cx| step(&mut state, cx).into_outcome());
    let sketch = cx.spawn(SketchObject { step });
    crate::attach!(cx, cx.fast_zone().pulse => sketch.pulse);
    sketch
}

/// A sketch that runs.
pub struct SketchObject {
    step: Box<dyn FnMut(&mut Cx) -> Outcome>,
}

crate::object! { pub SketchObject { slots { pulse() } } }

impl SketchObject {
    fn pulse(&mut self, cx: &mut Cx) -> Outcome {
        (self.step)(cx)
    }
}
