//! Accounts through the objects of a program: login by password, on a worker and again after a loss, and what an
//! administrator does.
#![cfg(feature = "store")]

use sk_core::flow::database::disk::Store;
use sk_core::flow::satellite::{AccountInfo, Credentials, PasswordLogin};
use sk_core::flow::scram::Password;
use sk_core::flow::server::Settings;
use sk_core::flow::{FlowMessage, HubAddress, SkFlowSat, SkFlowServer};
use sk_core::prelude::*;
use sk_core::testing::{Simulation, USER_ID};
use sk_core::{SkVariant, attach};
use std::cell::RefCell;
use std::rc::Rc;

const ADDRESS: &str = "/hub.sock";

fn start_hub(cx: &mut Cx) -> Handle<SkFlowServer> {
    let settings = Settings { user: "robot".parse().unwrap(), token: None, owner_uid: Some(USER_ID) };
    let server = SkFlowServer::start(cx, settings);
    server.listen(cx, &HubAddress::Unix(ADDRESS.into())).unwrap();
    let opened = Store::open(cx.world().storage.clone(), "/state/databases.redb".into()).unwrap();
    server.keep_databases(cx, opened.store, opened.saved).unwrap();
    server
}

fn seconds(count: u64) -> Duration {
    Duration::from_secs(count)
}

/// Writes down how a satellite fares.
#[derive(Default)]
struct Diary {
    ready: u32,
    lost: Vec<String>,
    refused: Vec<String>,
    heard: Vec<SkVariant>,
}

impl Diary {
    fn ready(&mut self, _cx: &mut Cx) {
        self.ready += 1;
    }
    fn lost(&mut self, _cx: &mut Cx, why: String) {
        self.lost.push(why);
    }
    fn refused(&mut self, _cx: &mut Cx, why: String) {
        self.refused.push(why);
    }
    fn heard(&mut self, _cx: &mut Cx, message: &FlowMessage) -> Result<(), sk_flat::VariantError> {
        self.heard.push(message.value()?);
        Ok(())
    }
}

object! { Diary { slots { ready() lost(String) refused(String) heard(&FlowMessage) } } }

fn diary_of(cx: &mut Cx, satellite: Handle<SkFlowSat>) -> Handle<Diary> {
    let diary = cx.spawn(Diary::default());
    attach!(cx, satellite.ready => diary.ready);
    attach!(cx, satellite.lost => diary.lost);
    attach!(cx, satellite.refused => diary.refused);
    attach!(cx, satellite.message => diary.heard);
    diary
}

fn log_in(cx: &mut Cx, user: &str, password: &str) -> (Handle<SkFlowSat>, Handle<Diary>) {
    let login = PasswordLogin::new(user.parse().unwrap(), Password::new(password));
    let to = HubAddress::Unix(ADDRESS.into());
    let satellite = SkFlowSat::connect_as(cx, &to, Credentials::Password(login));
    (satellite, diary_of(cx, satellite))
}

type Answers<T> = Rc<RefCell<Vec<Result<T, String>>>>;

fn answers<T: 'static>() -> (Answers<T>, impl FnOnce(&mut Cx, Result<T, String>)) {
    let answers = Answers::<T>::default();
    let kept = answers.clone();
    (answers, move |_: &mut Cx, answer| kept.borrow_mut().push(answer))
}

#[test]
fn s89_a_satellite_logs_in_by_password_and_again_after_the_hub_was_lost() {
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    let server = start_hub(cx);
    let owner = SkFlowSat::connect(cx, &HubAddress::Unix(ADDRESS.into()));
    let heard = diary_of(cx, owner);
    owner.subscribe(cx, "ada.voltage").unwrap();
    simulation.run_for(&mut app, seconds(1));

    let cx = app.cx();
    let (added, note) = answers();
    owner.set_account(cx, "ada", Password::new("pencil"), note).unwrap();
    simulation.run_for(&mut app, seconds(1));
    assert_eq!(*added.borrow(), [Ok(())]);
    let cx = app.cx();
    let rights = owner.database(cx, "user:ada").unwrap();
    rights.set(cx, "right.publish", SkVariant::list(["ada.*"]));
    let (ada, diary) = log_in(cx, "ada", "pencil");
    let (_, stranger) = log_in(cx, "ada", "pencils");
    ada.open(cx, "voltage", SkVariant::map([("format", "variant".into())])).unwrap();
    simulation.run_for(&mut app, seconds(1));
    let cx = app.cx();
    assert!(ada.publish(cx, "voltage", 12.5), "somebody listens");
    simulation.run_for(&mut app, seconds(1));
    let cx = app.cx();
    assert_eq!(cx.with(heard, |diary, _| diary.heard.clone()), Ok(vec![12.5.into()]));
    let (ready, refused) = cx.with(stranger, |diary, _| (diary.ready, diary.refused.clone())).unwrap();
    assert!(ready == 0 && !refused.is_empty(), "a wrong password: {refused:?}");

    // Another run of the hub has the accounts from its disk.
    server.shut_down(cx).unwrap();
    simulation.run_for(&mut app, seconds(3));
    app.cx().destroy_later(server);
    simulation.run_for(&mut app, seconds(1));
    start_hub(app.cx());
    simulation.run_for(&mut app, seconds(12));
    let cx = app.cx();
    assert!(ada.publish(cx, "voltage", 12.4), "it came back, with its channel and its listener");
    simulation.run_for(&mut app, seconds(1));
    let cx = app.cx();
    assert_eq!(cx.with(heard, |diary, _| diary.heard.clone()), Ok(vec![12.5.into(), 12.4.into()]));
    assert_eq!(cx.with(diary, |diary, _| (diary.ready, diary.refused.clone())), Ok((2, vec![])));
}

#[test]
fn accounts_are_listed_and_one_that_is_removed_is_told_so_and_stays_out() {
    let simulation = Simulation::new(2);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    start_hub(cx);
    let owner = SkFlowSat::connect(cx, &HubAddress::Unix(ADDRESS.into()));
    simulation.run_for(&mut app, seconds(1));
    let cx = app.cx();
    let (_, note) = answers();
    owner.set_account(cx, "ada", Password::new("pencil"), note).unwrap();
    simulation.run_for(&mut app, seconds(1));
    let (ada, diary) = log_in(app.cx(), "ada", "pencil");
    simulation.run_for(&mut app, seconds(1));

    let cx = app.cx();
    let ((listed, of_owner), (denied, of_ada)) = (answers(), answers());
    owner.accounts(cx, of_owner).unwrap();
    ada.accounts(cx, of_ada).unwrap();
    simulation.run_for(&mut app, seconds(1));
    let account = |name: &str, connections| AccountInfo { name: name.to_owned(), connections };
    assert_eq!(*listed.borrow(), [Ok(vec![account("ada", 1), account("robot", 1)])]);
    assert!(matches!(&denied.borrow()[..], [Err(why)] if why.contains("no right")));

    let (removed, note) = answers();
    owner.remove_account(app.cx(), "ada", note).unwrap();
    simulation.run_for(&mut app, seconds(10));
    assert_eq!(*removed.borrow(), [Ok(())]);
    let (ready, lost) = app.cx().with(diary, |diary, _| (diary.ready, diary.lost.clone())).unwrap();
    assert!(ready == 1 && lost[0].contains("account was removed"), "{lost:?}");

    let (unanswered, note) = answers();
    ada.accounts(app.cx(), note).unwrap();
    simulation.run_for(&mut app, seconds(1));
    assert!(matches!(&unanswered.borrow()[..], [Err(_)]), "without a hub there is an answer too");
}
