//! The Arduino-like form of a program.

use sk_core::prelude::*;
use sk_core::testing::Simulation;
use std::cell::RefCell;

#[test]
fn s42_a_sketch_runs_setup_once_and_its_loop_at_each_pulse() {
    let simulation = Simulation::new(1);
    let mut app = simulation.app();
    let seen = Rc::new(RefCell::new(Vec::new()));
    let (at_setup, at_pulse) = (seen.clone(), seen.clone());
    let sketch = Sketch::setup(move |cx: &mut Cx| {
        at_setup.borrow_mut().push(("setup", cx.pulse().number));
        0
    });
    let sketch = sketch.each_pulse_of(app.cx(), move |calls, cx| {
        *calls += 1;
        at_pulse.borrow_mut().push(("loop", cx.pulse().number));
        if *calls == 2 { Err("a loop may fail") } else { Ok(()) }
    });
    for _ in 0..4 {
        app.pulse();
    }
    assert_eq!(*seen.borrow(), [("setup", 0), ("loop", 2), ("loop", 3), ("loop", 4)]);
    assert_eq!(app.cx().counters().failures, 1);
    app.cx().destroy_later(sketch);
    app.pulse();
    app.pulse();
    assert_eq!(seen.borrow().len(), 4, "a destroyed sketch pulses no more");
}

#[test]
fn a_sketch_makes_an_application_of_its_own() {
    let sketch = Sketch::setup(|_| ()).on(|app| app.interval(Duration::from_millis(1)));
    let run = sketch.each_pulse(|(), cx| cx.quit());
    assert_eq!(run.unwrap(), Run::Quit);
    let zero = Sketch::setup(|_| ()).on(|app| app.interval(Duration::ZERO));
    assert!(zero.each_pulse(|(), cx| cx.quit()).is_err());
}
