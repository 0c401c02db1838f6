//! Links and calls by name, with variants for arguments.

mod objects;

use objects::*;
use sk_core::prelude::*;

#[derive(Default)]
struct Pid {
    target: f64,
    gains: (f64, f64, f64),
    label: String,
    samples: Vec<i64>,
    calls: u32,
    output: Signal<f64>,
    named: Signal<str>,
    hidden: u8,
    #[allow(dead_code)]
    secret: Signal<u8>,
}
impl Pid {
    fn set_target(&mut self, cx: &mut Cx, target: f64) {
        self.target = target;
        self.output.emit(cx, target);
    }
    fn set_gains(&mut self, _cx: &mut Cx, p: f64, i: f64, d: f64) {
        self.gains = (p, i, d);
    }
    fn rename(&mut self, cx: &mut Cx, label: &str) {
        self.label = label.to_owned();
        self.named.emit(cx, label);
    }
    fn feed(&mut self, _cx: &mut Cx, samples: Vec<i64>) {
        self.samples = samples;
    }
    fn reset(&mut self, _cx: &mut Cx) {
        self.calls += 1;
    }
    fn adopt(&mut self, _cx: &mut Cx, _other: Handle<Pid>) {
        self.hidden = 1;
    }
}
object! { Pid {
    signals { output(f64) named(&str) }
    slots { set_target(f64) set_gains(f64, f64, f64) rename(&str) feed(Vec<i64>) reset() adopt(Handle<Pid>) }
} }

fn links(app: &mut SkApp) -> usize {
    let ids: Vec<ObjectId> = app.cx().objects().iter().map(|info| info.id).collect();
    ids.into_iter().map(|id| app.cx().links_of(id).len()).sum()
}

#[test]
fn s12_strangers_are_joined_by_name() {
    // Neither side names the other's type: only addresses and names pass through this function.
    fn join(cx: &mut Cx, from: ObjectId, signal: &str, to: ObjectId, slot: &str) -> Result<(), MetaError> {
        cx.attach_by_name(from, signal, to, slot, Mode::Queued)
    }
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (button, lamp) = (cx.spawn(Button::default()), cx.spawn(Lamp::new("lamp", &log)));
    join(cx, button.id(), "pressed", lamp.id(), "on").unwrap();
    join(cx, button.id(), "pressed", lamp.id(), "blink").unwrap();
    app.pulse();
    push(&mut app, button, 4);
    app.pulse();
    assert_eq!(log.take(), ["lamp 4", "lamp blinks"], "a slot without arguments fits every signal");
    let cx = app.cx();
    cx.detach_by_name(button, "pressed", lamp, "on").unwrap();
    cx.detach_by_name(button, "pressed", button, "press").unwrap();
    app.pulse();
    push(&mut app, button, 5);
    app.pulse();
    assert_eq!(log.take(), ["lamp blinks"]);
}

#[test]
fn s47_attach_joins_with_a_mode() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    let modes =
        [Mode::Direct, Mode::Queued, Mode::Latest, Mode::OneShot, Mode::Queued.once(), Mode::Latest.once()];
    for mode in modes {
        let lamp = cx.spawn(Lamp::new("lamp", &log));
        cx.attach_by_name(button, "pressed", lamp, "on", mode).unwrap();
    }
    app.pulse();
    let listed = app.cx().links_of(button);
    assert_eq!(listed.iter().map(|(_, link)| link.mode).collect::<Vec<_>>(), modes);
    let names: Vec<String> = modes.iter().map(Mode::to_string).collect();
    assert_eq!(names, ["Direct", "Queued", "Latest", "OneShot", "Queued.once", "Latest.once"]);
}

#[test]
fn s11_an_unknown_name_is_an_error_and_changes_nothing() {
    let (_world, mut app) = world();
    let cx = app.cx();
    let pid = cx.spawn(Pid::default());
    let other = cx.spawn(Pid::default());
    attach!(cx, pid.output => other.set_target);
    app.pulse();
    let before = links(&mut app);
    let cx = app.cx();
    let error = cx.attach_by_name(pid, "secret", other, "reset", Mode::Direct).unwrap_err();
    assert_eq!(
        error.to_string(),
        "Pid has no signal `secret`; it has: output, named",
        "a field that is not declared"
    );
    let error = cx.attach_by_name(pid, "output", other, "hidden", Mode::Direct).unwrap_err();
    assert!(matches!(&error, MetaError::NoSuchSlot { slot, .. } if slot == "hidden"), "{error}");
    let error = cx.attach_by_name(pid, "output", other, "set_gains", Mode::Direct).unwrap_err();
    assert_eq!(error.to_string(), "`set_gains` takes (f64, f64, f64): the signal `output` carries (f64)");
    let error = cx.attach_by_name(pid, "named", other, "set_target", Mode::Direct).unwrap_err();
    assert!(matches!(error, MetaError::Arguments { .. }));
    assert!(cx.detach_by_name(pid, "output", other, "set_taget").is_err());
    assert!(cx.detach_by_name(pid, "ouput", other, "set_target").is_err());
    assert!(cx.invoke_method(pid, "set_taget", &[1.0.into()]).is_err());
    app.pulse();
    assert_eq!(links(&mut app), before);
    assert_eq!(app.cx().counters().queued_calls, 0);
}

#[test]
fn s59_invoke_method_is_never_direct() {
    let (_world, mut app) = world();
    let pid = app.cx().named("pid").spawn(Pid::default());
    app.cx().invoke_method(pid, "reset", &[]).unwrap();
    assert_eq!(app.cx().with(pid, |pid, _| pid.calls), Ok(0));
    app.pulse();
    assert_eq!(app.cx().with(pid, |pid, _| pid.calls), Ok(1));
    // From a slot of the very object too, and then in the next round.
    let cx = app.cx();
    let caller = cx.spawn(Actor::new(move |cx, _, _| {
        let pid = cx.find("pid").unwrap();
        cx.invoke_method(pid, "reset", &[]).unwrap();
    }));
    attach!(cx, cx.fast_zone().pulse => caller.go, OneShot);
    app.pulse();
    app.pulse();
    assert_eq!(app.cx().with(pid, |pid, _| pid.calls), Ok(1));
    app.pulse();
    assert_eq!(app.cx().with(pid, |pid, _| pid.calls), Ok(2));
}

#[test]
fn by_name_converts_strictly_and_answers_what_does_not_fit() {
    let (_world, mut app) = world();
    let cx = app.cx();
    let pid = cx.spawn(Pid::default());
    let list = SkVariant::List(vec![1i64.into(), 2i64.into()].into());
    cx.invoke_method(pid, "set_target", &[2i64.into()]).unwrap();
    cx.invoke_method(pid, "set_gains", &[1i64.into(), 0.5.into(), 0i64.into()])
        .unwrap();
    cx.invoke_method(pid, "rename", &["left".into()]).unwrap();
    cx.invoke_method(pid, "feed", &[list]).unwrap();
    let wrong: [(&str, Vec<SkVariant>); 8] = [
        ("set_target", vec![]),
        ("set_target", vec![1.0.into(), 2.0.into()]),
        ("set_target", vec!["1.0".into()]),
        ("set_target", vec![((1i64 << 53) + 1).into()]),
        ("set_gains", vec![1.0.into(), 2.0.into()]),
        ("rename", vec![5i64.into()]),
        ("reset", vec![1i64.into()]),
        ("adopt", vec![1i64.into()]),
    ];
    for (slot, args) in wrong {
        let error = cx.invoke_method(pid, slot, &args).unwrap_err();
        assert!(matches!(error, MetaError::Arguments { .. }), "{slot} {args:?}: {error}");
        assert!(error.to_string().starts_with(&format!("`{slot}` takes (")), "{error}");
    }
    app.pulse();
    app.cx()
        .with(pid, |pid, _| {
            assert_eq!((pid.target, pid.gains), (2.0, (1.0, 0.5, 0.0)));
            assert_eq!((pid.label.as_str(), pid.samples.as_slice()), ("left", [1, 2].as_slice()));
            assert_eq!(pid.calls, 0);
        })
        .unwrap();
}

#[test]
fn by_name_says_that_an_end_is_gone() {
    let (_world, mut app) = world();
    let cx = app.cx();
    let (pid, gone) = (cx.spawn(Pid::default()), cx.spawn(Pid::default()));
    cx.destroy_later(gone);
    assert_eq!(cx.invoke_method(gone, "reset", &[]), Err(MetaError::Gone(gone.id())), "marked is gone");
    app.pulse();
    let cx = app.cx();
    let is_gone = Err(MetaError::Gone(gone.id()));
    assert_eq!(cx.invoke_method(gone, "reset", &[]), is_gone);
    assert_eq!(cx.attach_by_name(gone, "output", pid, "reset", Mode::Direct), is_gone);
    assert_eq!(cx.attach_by_name(pid, "output", gone, "reset", Mode::Direct), is_gone);
    assert_eq!(cx.detach_by_name(pid, "output", gone, "reset"), is_gone);
    assert_eq!(cx.invoke_method(ObjectId::NOBODY, "reset", &[]), Err(MetaError::Gone(ObjectId::NOBODY)));
}

#[test]
fn the_live_graph_is_listed() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let base = cx.named("base").spawn(Button::default());
    let lamp = cx.under(base).named("lamp").spawn(Lamp::new("lamp", &log));
    attach!(cx, base.pressed => lamp.on, Latest);
    app.pulse();
    let cx = app.cx();
    let objects = cx.objects();
    let paths: Vec<&str> = objects.iter().map(|info| info.path.as_str()).collect();
    assert!(paths.contains(&"base") && paths.contains(&"base/lamp"), "{paths:?}");
    let classes: Vec<&str> = objects.iter().map(|info| info.class.name).collect();
    assert_eq!(classes, ["SkEventLoop", "Zone", "Zone", "Zone", "Button", "Lamp"]);
    assert_eq!(objects[5].parent, Some(base.id()));
    let (signal, link) = &cx.links_of(base)[0];
    assert_eq!(
        (signal.name, link.target, link.slot.name, link.mode),
        ("pressed", lamp.id(), "on", Mode::Latest)
    );
    assert!(!link.remote);
}

#[test]
fn a_link_by_name_and_one_by_type_call_the_same_slot_alike() {
    let (_world, mut app) = world();
    let cx = app.cx();
    let (a, b) = (cx.spawn(Pid::default()), cx.spawn(Pid::default()));
    cx.attach_by_name(a, "output", b, "set_target", Mode::Direct).unwrap();
    cx.attach_by_name(a, "named", b, "rename", Mode::Direct).unwrap();
    app.pulse();
    app.cx()
        .with(a, |a, cx| {
            a.set_target(cx, 3.0);
            a.rename(cx, "x")
        })
        .unwrap();
    assert_eq!(app.cx().with(b, |b, _| (b.target, b.label.clone())), Ok((3.0, "x".to_owned())));
    let cx = app.cx();
    detach!(cx, a.output => b.set_target);
    app.pulse();
    assert_eq!(links(&mut app), 1);
}
