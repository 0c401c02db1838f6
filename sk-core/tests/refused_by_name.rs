//! What another thread finds wrong with a request by name comes back to the asker as a call.

mod objects;

use objects::*;
use sk_core::eventloop::Refusal;
use sk_core::prelude::*;

/// Remembers what was refused.
#[derive(Default)]
struct Asker {
    refused: Vec<(ObjectId, String, MetaError)>,
    out: Signal<u32>,
}
impl Asker {
    fn on_refused(&mut self, _cx: &mut Cx, refusal: &Refusal) {
        let Refusal { target, what, error } = refusal.clone();
        self.refused.push((target.id(), what, error));
    }
    fn take(&mut self, _cx: &mut Cx, _word: &str) {}
}
object! { Asker { signals { out(u32) } slots { on_refused(&Refusal) take(&str) } } }

fn asker(app: &mut SkApp) -> Handle<Asker> {
    let cx = app.cx();
    let asker = cx.spawn(Asker::default());
    attach!(cx, cx.event_loop().by_name_refused => asker.on_refused);
    asker
}

fn button(thread: &SkThread) -> Remote<Button> {
    thread
        .build(|cx| {
            let button = cx.spawn(Button::default());
            cx.remote(button)
        })
        .unwrap()
}

/// Pulses until so many refusals have come. A refusal that never comes ends in the test's own limit.
fn refusals(app: &mut SkApp, asker: Handle<Asker>, count: usize) -> Vec<(ObjectId, String, MetaError)> {
    let long = std::time::Instant::now() + Duration::from_secs(60);
    loop {
        app.pulse();
        let came = app.cx().with(asker, |asker, _| asker.refused.clone()).unwrap();
        if came.len() >= count || std::time::Instant::now() > long {
            return came;
        }
    }
}

/// Asks three loops for everything that can be wrong.
fn everything_wrong_is_told(app: &mut SkApp) {
    let asker = asker(app);
    let (near, far) = (
        SkThread::new("near").start(app.cx()).unwrap(),
        SkThread::new("far").start(app.cx()).unwrap(),
    );
    let (source, target) = (button(&near), button(&far));
    let (source_id, target_id) = (Address::from(&source).id(), Address::from(&target).id());
    let own_id = asker.id();
    let cx = app.cx();
    cx.invoke_method(&target, "pusch", &[1.into()]).unwrap();
    cx.invoke_method(&target, "push", &["one".into()]).unwrap();
    let mut came = refusals(app, asker, 2);
    app.cx().attach_by_name(asker, "out", &target, "pusch", Mode::Queued).unwrap();
    came.extend(refusals(app, asker, 3).split_off(2));
    let cx = app.cx();
    // Over two loops, and over one and back.
    cx.attach_by_name(&source, "presed", &target, "push", Mode::Queued).unwrap();
    came.extend(refusals(app, asker, 4).split_off(3));
    app.cx()
        .attach_by_name(&source, "pressed", &target, "pusch", Mode::Queued)
        .unwrap();
    came.extend(refusals(app, asker, 5).split_off(4));
    app.cx()
        .attach_by_name(&source, "pressed", asker, "take", Mode::Queued)
        .unwrap();
    came.extend(refusals(app, asker, 6).split_off(5));
    app.cx().detach_by_name(&source, "pressed", &target, "pusch").unwrap();
    came.extend(refusals(app, asker, 7).split_off(6));
    let expected = [
        (target_id, "call pusch", "Button has no slot `pusch`; it has: press, push"),
        (target_id, "call push", "`push` takes (u32): "),
        (target_id, "attach out => pusch", "Button has no slot `pusch`; it has: press, push"),
        (source_id, "attach presed => push", "Button has no signal `presed`; it has: pressed"),
        (target_id, "attach pressed => pusch", "Button has no slot `pusch`; it has: press, push"),
        (
            own_id,
            "attach pressed => take",
            "`take` takes (& str): the signal `pressed` carries (u32)",
        ),
        (target_id, "detach pressed => pusch", "Button has no slot `pusch`; it has: press, push"),
    ];
    assert_eq!(came.len(), expected.len(), "{came:?}");
    for ((target, what, error), (at, asked, why)) in came.iter().zip(expected) {
        assert_eq!((*target, what.as_str()), (at, asked));
        assert!(error.to_string().replace("&str", "& str").starts_with(why), "{error}");
    }
    assert_eq!(app.cx().links_of(asker).len(), 0, "and the graph stays as it was");
}

#[test]
fn s12_what_another_thread_refuses_comes_back_as_a_call() {
    let mut app = SkApp::builder().interval(ms(1)).mode(TimingMode::SelectIo).build().unwrap();
    everything_wrong_is_told(&mut app);
}

#[test]
fn what_another_thread_refuses_comes_back_in_simulation_too() {
    let (_simulation, mut app) = world();
    everything_wrong_is_told(&mut app);
}

#[test]
fn a_link_by_name_with_arguments_that_do_not_fit_is_not_made_across_threads() {
    let (_simulation, mut app) = world();
    let asker = asker(&mut app);
    let far = SkThread::new("far").start(app.cx()).unwrap();
    let taker = far
        .build(|cx| {
            let taker = cx.spawn(Asker::default());
            cx.remote(taker)
        })
        .unwrap();
    app.cx().attach_by_name(asker, "out", &taker, "take", Mode::Queued).unwrap();
    let came = refusals(&mut app, asker, 1);
    assert!(matches!(&came[..], [(_, _, MetaError::Arguments { slot: "take", .. })]), "{came:?}");
    assert_eq!(app.cx().counters().links_made, 1, "only that of the asker to its loop");
}
