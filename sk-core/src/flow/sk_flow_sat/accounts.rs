//! Accounts, for a satellite: its own login by password, and the commands of an administrator.

use super::SkFlowSat;
use super::Way;
use super::databases::clerk::{Answer, listed};
use crate::Cx;
use crate::flow::Command;
use crate::flow::satellite::{AccountInfo, Credentials};
use crate::flow::scram::{ClientKeys, Password, ROUNDS_MIN, Verifier};
use crate::object::Handle;
use std::collections::BTreeMap;
use std::io;

/// Why an answer does not come.
const NO_HUB: &str = "there is no hub";

/// What a worker derives, and for whom.
#[derive(Default)]
pub(super) struct Deriving {
    last: u64,
    passwords: BTreeMap<u64, (String, Answer)>,
}

impl SkFlowSat {
    /// The hub challenged this satellite: the keys are derived on a worker.
    pub(super) fn derive_if_challenged(&mut self, cx: &mut Cx) {
        let Some(derivation) = self.core.as_mut().and_then(|core| core.take_derivation()) else { return };
        let this = cx.this(self);
        let (remote, link) = (cx.remote(this), self.link_number);
        let job = Box::new(move || {
            let keys = derivation.run();
            // A satellite that is gone does not log in.
            let _ = remote.post(move |satellite, cx| satellite.derived(cx, link, keys));
        });
        if cx.world().worker.run(job).is_err() {
            self.break_link(cx, "too much work waits to derive the keys of a login".to_owned());
        }
    }

    fn derived(&mut self, cx: &mut Cx, link: u64, keys: ClientKeys) {
        let core = self.core.as_mut().filter(|_| link == self.link_number);
        let gone_on = core.map(|core| core.derived(&keys));
        if let Way::Address { credentials: Credentials::Password(login), .. } = &mut self.way {
            login.keep(keys);
        }
        match gone_on {
            Some(Err(error)) => self.break_link(cx, error.to_string()),
            _ => self.flush_later(cx),
        }
    }

    /// The verifier of a new password was derived: it goes to the hub.
    fn send_account(&mut self, cx: &mut Cx, number: u64, verifier: &Verifier) {
        let Some((user, answer)) = self.deriving.passwords.remove(&number) else { return };
        let (rounds, salt, stored_key, server_key) = verifier.parts();
        self.ask_about_accounts(cx, &Command::UserSet { user, rounds, salt, stored_key, server_key }, answer);
    }

    fn ask_about_accounts(&mut self, cx: &mut Cx, command: &Command, answer: Answer) {
        let sent = match &mut self.core {
            Some(core) => core.account(command).map_err(|error| error.to_string()),
            None => Err(NO_HUB.to_owned()),
        };
        match sent {
            Ok(tag) => self.clerk.expect_answer(tag, answer),
            Err(why) => {
                let this = cx.this(self);
                self.clerk.answer_later(answer, Err(why));
                cx.post_own(this, move |cx| super::databases::commands::tell_told(cx, this));
            }
        }
        self.flush_later(cx);
    }
}

impl Handle<SkFlowSat> {
    /// Adds an account without any rights, or changes the password of one; `answer` hears when it is on the hub's
    /// disk, or why not. The hub never gets the password itself.
    ///
    /// # Errors
    /// If the satellite is gone, or too much work waits.
    pub fn set_account(
        self,
        cx: &mut Cx,
        user: &str,
        password: Password,
        answer: impl FnOnce(&mut Cx, Result<(), String>) + 'static,
    ) -> io::Result<()> {
        let mut salt = [0; 16];
        cx.world().rng.fill(&mut salt);
        let remote = cx.remote(self);
        let number = cx
            .with(self, |satellite, _| {
                satellite.deriving.last += 1;
                let number = satellite.deriving.last;
                let answer: Answer = Box::new(move |cx, outcome| answer(cx, outcome.map(drop)));
                satellite.deriving.passwords.insert(number, (user.to_owned(), answer));
                number
            })
            .map_err(io::Error::other)?;
        let job = Box::new(move || {
            let verifier = ClientKeys::derive(&password, salt, ROUNDS_MIN).verifier();
            // Nobody waits any more when the satellite is gone.
            let _ = remote.post(move |satellite, cx| satellite.send_account(cx, number, &verifier));
        });
        cx.world().worker.run(job).map_err(|_| io::Error::other("too much work waits"))
    }

    /// Removes an account with its rights; its connections end. `answer` hears when that is on the hub's disk, or
    /// why not.
    ///
    /// # Errors
    /// If the satellite is gone.
    pub fn remove_account(
        self,
        cx: &mut Cx,
        user: &str,
        answer: impl FnOnce(&mut Cx, Result<(), String>) + 'static,
    ) -> io::Result<()> {
        let command = Command::UserRemove { user: user.to_owned() };
        let answer: Answer = Box::new(move |cx, outcome| answer(cx, outcome.map(drop)));
        cx.with(self, |satellite, cx| satellite.ask_about_accounts(cx, &command, answer))
            .map_err(io::Error::other)
    }

    /// Lists the accounts by name.
    ///
    /// # Errors
    /// If the satellite is gone.
    pub fn accounts(
        self,
        cx: &mut Cx,
        answer: impl FnOnce(&mut Cx, Result<Vec<AccountInfo>, String>) + 'static,
    ) -> io::Result<()> {
        let answer: Answer = Box::new(move |cx, outcome| answer(cx, outcome.map(listed)));
        cx.with(self, |satellite, cx| satellite.ask_about_accounts(cx, &Command::UserList {}, answer))
            .map_err(io::Error::other)
    }
}
