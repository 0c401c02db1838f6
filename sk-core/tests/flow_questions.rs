//! Questions of a satellite to its hub: each is answered once, or told why it is not.

use sk_core::flow::{Rights, SkFlowSat, SkFlowServer, server::Settings};
use sk_core::prelude::*;
use std::cell::RefCell;
use std::rc::Rc;

type Heard = Rc<RefCell<Vec<String>>>;

/// A step of the test: it asks, and says what it hears.
type Step = fn(&mut Cx, Handle<SkFlowSat>, Heard);

/// A hub with one satellite inside; `steps` are taken when it is let in. Answers what they heard.
fn heard_by(steps: &[Step], answers: usize) -> Vec<String> {
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build().unwrap();
    let cx = app.cx();
    let settings = Settings { user: "robot".parse().unwrap(), token: None, owner_uid: None };
    let server = SkFlowServer::start(cx, settings);
    let pipe = server.pipe(cx, Rights::ALL).unwrap();
    let satellite = SkFlowSat::inside(cx, pipe);
    while cx_connection(app.cx(), satellite).is_none() {
        app.pulse();
    }
    let heard = Heard::default();
    for step in steps {
        step(app.cx(), satellite, heard.clone());
    }
    while heard.borrow().len() < answers {
        app.pulse();
    }
    heard.take()
}

fn cx_connection(cx: &mut Cx, satellite: Handle<SkFlowSat>) -> Option<u64> {
    // A flow has a name; a connection that is only logged in has none.
    let named = cx.with(satellite, |satellite, _| satellite.core().is_some_and(|core| core.is_ready()));
    satellite.connection(cx).filter(|_| named == Ok(true))
}

fn shown<R: std::fmt::Debug>(heard: &Heard, answer: Result<R, String>) {
    heard.borrow_mut().push(match answer {
        Ok(answer) => format!("{answer:?}"),
        Err(why) => format!("refused: {why}"),
    });
}

#[test]
fn without_a_hub_a_question_is_answered_that_there_is_none() {
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build().unwrap();
    let nowhere = std::env::temp_dir().join(format!("no-hub-{}", std::process::id()));
    let satellite = SkFlowSat::connect(app.cx(), &nowhere.as_path().into());
    let heard = Heard::default();
    let tell = heard.clone();
    satellite.inspect(app.cx(), "hub", move |_, answer| shown(&tell, answer));
    assert!(heard.borrow().is_empty(), "never while the asker is running");
    while heard.borrow().is_empty() {
        app.pulse();
    }
    assert_eq!(heard.take(), ["refused: there is no hub"]);
}

#[test]
fn a_subject_that_is_none_is_refused_in_the_hubs_words() {
    let heard = heard_by(
        &[|cx, satellite, heard| satellite.inspect(cx, "weather", move |_, answer| shown(&heard, answer))],
        1,
    );
    assert!(heard[0].starts_with("refused: ") && heard[0] != "refused: ", "{heard:?}");
}

#[test]
fn databases_are_made_listed_read_whole_and_removed_in_the_order_that_was_asked() {
    let heard = heard_by(
        &[|cx, satellite, heard| {
            let tell = || {
                let heard = heard.clone();
                move |_: &mut Cx, answer: Result<(), String>| shown(&heard, answer)
            };
            satellite.create_database(cx, "arm", false, tell());
            satellite.create_database(cx, "arm", false, tell());
            let arm = satellite.database(cx, "arm").unwrap();
            assert!(arm.set(cx, "gain.p", 1.5) && arm.set(cx, "gain.d", 2u8) && arm.set(cx, "name", "left"));
            let told = heard.clone();
            arm.keys(cx, "gain.", move |_, answer| shown(&told, answer));
            let told = heard.clone();
            arm.all(cx, "name", move |_, answer| shown(&told, answer));
            let told = heard.clone();
            satellite.databases(cx, "arm", move |_, answer| {
                let names = answer
                    .map(|list| list.into_iter().map(|one| (one.name, one.variables)).collect::<Vec<_>>());
                shown(&told, names);
            });
            satellite.remove_database(cx, "arm", tell());
            satellite.remove_database(cx, "arm", tell());
        }],
        7,
    );
    assert_eq!(heard[0], "()");
    assert!(heard[1].starts_with("refused: "), "there is one: {heard:?}");
    assert_eq!(
        heard[2..6],
        ["[\"gain.d\", \"gain.p\"]", "[(\"name\", \"left\")]", "[(\"arm\", 3)]", "()",]
    );
    assert!(heard[6].starts_with("refused: "), "it is gone: {heard:?}");
}

#[test]
fn a_database_that_is_not_there_is_told_as_the_reason() {
    let heard = heard_by(
        &[|cx, satellite, heard| {
            let nothing = satellite.database(cx, "nothing").unwrap();
            nothing.keys(cx, "", move |_, answer| shown(&heard, answer));
        }],
        1,
    );
    assert!(
        heard[0].starts_with("refused: ") && heard[0].to_lowercase().contains("database"),
        "{heard:?}"
    );
}
