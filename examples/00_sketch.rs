//! The shortest program: a set-up, and a loop that runs at each pulse.
use sk_core::prelude::*;

fn main() -> Result<(), AppError> {
    let sketch = Sketch::setup(|_cx| 0).on(|app| app.interval(Duration::from_millis(20)));
    sketch.each_pulse(|blinks, cx| {
        *blinks += 1;
        println!("{}", if *blinks % 2 == 0 { "light" } else { "dark" });
        if *blinks == 6 {
            cx.quit();
        }
    })?;
    Ok(())
}
