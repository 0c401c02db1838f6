//! What the hub says when it refuses names what it is about.

mod lines;

use lines::{Line, hub};
use sk_core::SkVariant;
use sk_core::flow::satellite::SatelliteEvent;
use sk_core::flow::server::ServerCore;
use sk_core::flow::{Command, Form, RefusalCode};

/// What the hub said to the last refused command.
fn said(line: &mut Line, hub: &mut ServerCore) -> Option<(RefusalCode, String)> {
    line.exchange(hub);
    let refused = |event| match event {
        SatelliteEvent::Refused { code, text, .. } => Some((RefusalCode::from_code(code)?, text)),
        _ => None,
    };
    line.events().into_iter().filter_map(refused).last()
}

fn exists(text: &str) -> Option<(RefusalCode, String)> {
    Some((RefusalCode::Exists, text.to_owned()))
}

#[test]
fn what_exists_already_is_called_what_it_is() {
    let mut hub = hub();
    let mut arm = Line::new(&mut hub, 1, |core| core.named("arm"));
    let mut other = Line::new(&mut hub, 2, |core| core.named("arm"));
    assert_eq!(said(&mut other, &mut hub), exists("A flow of this name exists."));
    let mut other = Line::new(&mut hub, 3, |core| core);

    let properties = SkVariant::map([("unit", "m".into())]);
    arm.core.create("x", &properties).expect("a flow");
    assert_eq!(said(&mut arm, &mut hub), None);
    other.core.create_service("x", &properties).expect("a flow");
    assert_eq!(said(&mut other, &mut hub), exists("A channel of this name exists."));

    let create = Command::DbCreate { database: "calibration".into(), durable: 0 };
    arm.core.database(&create).expect("a flow");
    assert_eq!(said(&mut arm, &mut hub), None);
    other.core.database(&create).expect("a flow");
    assert_eq!(said(&mut other, &mut hub), exists("A database of this name exists."));
}

#[test]
fn what_is_not_there_or_too_long_is_called_what_it_is() {
    let mut hub = hub();
    let mut line = Line::new(&mut hub, 1, |core| core);
    line.core.inspect("channel robot.x").expect("it is ready");
    let gone = Some((RefusalCode::Gone, "There is no channel of this name.".to_owned()));
    assert_eq!(said(&mut line, &mut hub), gone);

    // As JSON the value is longer than a value may be.
    let database = "flow:".to_owned() + line.core.flow_name().expect("it is one");
    line.core.database(&Command::DbSelect { database }).expect("a flow");
    let value = sk_core::flow::Value::new(&"\u{1}".repeat(300 * 1024).into()).expect("short enough");
    line.core.database(&Command::VarSet { key: "k".into(), value }).expect("a flow");
    assert_eq!(said(&mut line, &mut hub), None);
    line.core
        .database(&Command::VarGet { key: "k".into(), form: Form::Json })
        .expect("a flow");
    let too_long = "The value is too long as JSON: ask for it as a variant.";
    assert_eq!(said(&mut line, &mut hub), Some((RefusalCode::TooLong, too_long.to_owned())));
}
