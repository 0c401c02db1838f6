//! Accounts: who there is, by which password they log in, and which rights they have.
//!
//! The verifiers of passwords are kept in a database of their own that no command reaches, the rights in the
//! database of each account. A new account has no rights at all.

use super::super::connection::Connection;
use super::super::connection::telling::Telling;
use super::super::databases::storing::Purpose;
use super::super::{ConnectionId, ServerCore};
use super::permission::Permission;
use crate::flow::database::{Contents, DatabaseKind, DatabaseName, Entity, Reach, StoreWork};
use crate::flow::definition::Encoded;
use crate::flow::error::{ClosingReason, RefusalCode};
use crate::flow::limits::{
    ACCOUNT_NAME_BYTES_MAX, ACCOUNTS_MAX, CONNECTIONS_MAX, CONNECTIONS_PER_ACCOUNT_MAX, UNAUTHENTICATED_MAX,
};
use crate::flow::login::OwnerToken;
use crate::flow::rights::{Grants, RIGHT_PREFIX, RightError};
use crate::flow::scram::{ServerExchange, Verifier};
use crate::flow::{Event, Flags, Form, Message as _, Right, Rights, Value};
use sk_flat::Name;
use std::collections::BTreeMap;
use std::ops::Bound;
use std::sync::Arc;
use thiserror::Error;

/// An entry of the accounts that is none: the hub does not start with it, since nobody could say who would be let
/// in.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("the entry {0:?} of the hub's accounts cannot be read")]
pub struct AccountsError(pub String);

/// The accounts of a hub. The owner's stands among them once it has a password.
#[derive(Debug)]
pub(in super::super) struct Accounts {
    accounts: BTreeMap<Name, Account>,
    /// What the challenges for accounts that are not there are made from.
    secret: [u8; 32],
}

#[derive(Debug)]
struct Account {
    verifier: Verifier,
    /// What its database says, as far as it is in memory.
    grants: Arc<Grants>,
    /// The variables there that grant nothing because of what is in them.
    unreadable: Vec<(String, RightError)>,
}

impl Accounts {
    pub(in super::super) fn new(token: Option<&OwnerToken>) -> Accounts {
        let secret = token.map_or([0; 32], OwnerToken::secret_of_nobody);
        Accounts { accounts: BTreeMap::new(), secret }
    }

    /// The first account behind `after`.
    fn next(&self, after: Option<&Name>) -> Option<&Name> {
        let from = after.map_or(Bound::Unbounded, Bound::Excluded);
        self.accounts
            .range::<Name, _>((from, Bound::Unbounded))
            .next()
            .map(|(name, _)| name)
    }

    fn put(&mut self, user: &Name, verifier: Verifier) {
        match self.accounts.get_mut(user) {
            Some(account) => account.verifier = verifier,
            None => {
                let account = Account { verifier, grants: Arc::default(), unreadable: Vec::new() };
                self.accounts.insert(user.clone(), account);
            }
        }
    }

    /// The variables of an account's rights that grant nothing because of what is in them.
    pub(in super::super) fn unreadable(&self, user: &str) -> &[(String, RightError)] {
        self.accounts.get(user).map_or(&[], |account| &account.unreadable)
    }
}

/// The name of an account: a name without a dot, not too long.
fn account_name(text: &str) -> Result<Name, RefusalCode> {
    let fits = text.len() <= ACCOUNT_NAME_BYTES_MAX && !text.contains('.');
    Name::new(text).ok().filter(|_| fits).ok_or(RefusalCode::BadUser)
}

impl ServerCore {
    // ---- login ----

    pub(in super::super) fn login_scram(&mut self, id: ConnectionId, tag: u32, message: &str) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        let Accounts { accounts, secret } = &self.accounts;
        let find = |user: &str| accounts.get(user).map(|account| account.verifier.clone());
        let exchange = ServerExchange::begin(message, &connection.hub_nonce, secret, &find);
        match (exchange, connection.scram.is_some()) {
            (Ok(exchange), false) => {
                let message = exchange.challenge().to_owned();
                connection.scram = Some(Box::new(exchange));
                self.answer(id, tag, &Event::ScramChallenge { message });
            }
            _ => self.login_failed(id),
        }
    }

    pub(in super::super) fn login_scram_proof(&mut self, id: ConnectionId, tag: u32, message: &str) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        let Some(exchange) = connection.scram.take() else { return self.login_failed(id) };
        let user = Name::new(exchange.user()).ok();
        let binding = connection.binding;
        let must_bind = binding.is_some() && self.must_bind;
        let is_bound = exchange.is_bound();
        let proof = exchange.finish_on(message, binding.as_ref());
        let proof = proof.ok().filter(|_| is_bound || !must_bind);
        // The account may have been removed since the challenge.
        let user = user.filter(|user| self.accounts.accounts.contains_key(user));
        match (proof, user) {
            (Some(_), Some(user)) if !self.has_place(&user) => self.close(id, ClosingReason::Crowded),
            (Some(proof), Some(user)) => {
                let permission = self.permission_at_login(id, &user);
                self.logged_in(id, tag, user, permission, proof);
            }
            _ => self.login_failed(id),
        }
    }

    /// Whether one more connection of this account is let in. The last places are for those who have not logged in
    /// yet, so that the owner finds one whatever the others do.
    fn has_place(&self, user: &Name) -> bool {
        let logged_in = self.connections.len() - self.waiting;
        if *user == self.settings.user || logged_in < CONNECTIONS_PER_ACCOUNT_MAX {
            return true;
        }
        let own = self.connections.iter().filter(|(_, found)| found.user.as_ref() == Some(user));
        logged_in < CONNECTIONS_MAX - UNAUTHENTICATED_MAX && own.count() < CONNECTIONS_PER_ACCOUNT_MAX
    }

    /// What an account may do. If its rights are on the disk, the connection's commands wait until they are here.
    fn permission_at_login(&mut self, id: ConnectionId, user: &Name) -> Permission {
        if *user == self.settings.user {
            return Permission::of(Rights::ALL);
        }
        let Some(account) = self.accounts.accounts.get(user) else { return Permission::NONE };
        let permission = Permission::granted(&account.grants);
        if let Some(name) = DatabaseName::of(DatabaseKind::User, user) {
            let request = match self.databases.reach(&name) {
                Reach::Here | Reach::Nowhere => None,
                Reach::Coming(request) => Some(request),
                Reach::OnDisk => {
                    let request = self.ask_store(&name, StoreWork::Load, Purpose::Summon);
                    self.databases.expect(&name, request);
                    Some(request)
                }
            };
            if let (Some(request), Some(connection)) = (request, self.connections.get_mut(id)) {
                connection.desk.answers_wait_for(request);
            }
        }
        permission
    }

    // ---- rights ----

    /// A variable of an account's rights changed, or all of them came from the disk: who is logged in to it has
    /// the new ones from here on.
    pub(in super::super) fn rights_changed(&mut self, database: &DatabaseName) {
        if database.kind() != DatabaseKind::User || self.databases.reach(database) != Reach::Here {
            return;
        }
        let Some(account) = self.accounts.accounts.get_mut(database.entity()) else { return };
        let open = self.databases.open(database);
        let variables = open.into_iter().flat_map(|open| open.pairs.iter(RIGHT_PREFIX, None));
        let (grants, unreadable) = Grants::read(variables.map(|(key, value)| (key, value.variant())));
        if account.unreadable != unreadable {
            for (key, why) in &unreadable {
                tracing::warn!(account = database.entity(), key, "a right grants nothing: {why}");
            }
            account.unreadable = unreadable;
        }
        if *account.grants == grants {
            return;
        }
        account.grants = Arc::new(grants);
        let permission = Permission::granted(&account.grants);
        for id in self.connections_of(database.entity()) {
            self.change_permission(id, permission.clone());
        }
    }

    /// The connections that are logged in to an account with the rights of its database.
    fn connections_of(&self, user: &str) -> Vec<ConnectionId> {
        self.connections
            .iter()
            .filter(|(_, found)| {
                found.rights.is_of_account()
                    && found.user.as_ref().is_some_and(|known| known.as_str() == user)
            })
            .map(|(id, _)| id)
            .collect()
    }

    pub(super) fn has_rights_of_account(&self, connection: &Connection) -> bool {
        let account = connection.user.as_ref().and_then(|user| self.accounts.accounts.get(user));
        account.is_some_and(|account| {
            Right::ALL
                .into_iter()
                .all(|right| !connection.rights.has(right) || !account.grants.patterns(right).is_empty())
        })
    }

    // ---- commands ----

    pub(in super::super) fn user_set(
        &mut self,
        id: ConnectionId,
        tag: u32,
        user: &str,
        verifier: Option<Verifier>,
    ) {
        if let Err(code) = self.try_user_set(id, tag, user, verifier) {
            self.refuse(id, tag, code);
        }
    }

    fn try_user_set(
        &mut self,
        id: ConnectionId,
        tag: u32,
        user: &str,
        verifier: Option<Verifier>,
    ) -> Result<(), RefusalCode> {
        let connection = self.connections.get(id).ok_or(RefusalCode::Denied)?;
        let administers = connection.rights.allows_everywhere(Right::Administer);
        let own = connection.user.as_ref().is_some_and(|own| own.as_str() == user);
        let is_owner = self.settings.user.as_str() == user;
        // What is inside the hub bears the owner's name without all of its rights.
        if !(administers || own && !is_owner) {
            return Err(RefusalCode::Denied);
        }
        if is_owner && !own {
            return Err(RefusalCode::BadUser);
        }
        let (user, verifier) = (account_name(user)?, verifier.ok_or(RefusalCode::BadUser)?);
        if !self.storing.is_on() {
            return Err(RefusalCode::NotOffered);
        }
        let value = Value::new(&verifier.variant()).map_err(|_| RefusalCode::BadUser)?;
        let new = !self.accounts.accounts.contains_key(&user);
        if new && self.accounts.accounts.len() >= ACCOUNTS_MAX {
            return Err(RefusalCode::DatabaseFull);
        }
        if new && !is_owner {
            // Whoever had the name before leaves no rights behind.
            self.forget_account_database(&user);
        }
        self.add_account(user.clone(), verifier);
        self.write_account(id, tag, &user, Some(value))
    }

    /// Adds an account without rights, or changes the password of one. It lasts as long as this hub: what outlives
    /// it is added by `user_set`.
    pub fn add_account(&mut self, user: Name, verifier: Verifier) {
        self.accounts.put(&user, verifier);
        self.entity_began(DatabaseKind::User, &user, Entity::User);
    }

    /// Takes in the accounts that are on the disk, after [`keep_databases`](ServerCore::keep_databases).
    ///
    /// # Errors
    /// If one cannot be read; then none is taken in.
    pub fn keep_accounts(&mut self, contents: &Contents) -> Result<(), AccountsError> {
        let mut read = Vec::new();
        for (key, value) in contents {
            let bad = || AccountsError(key.to_string());
            let user = account_name(key).map_err(|_| bad())?;
            read.push((user, Verifier::from_variant(&value.variant()).ok_or_else(bad)?));
        }
        let database = DatabaseName::accounts();
        self.databases.expect(&database, 0);
        self.databases.arrived(&database, 0, Some(contents));
        for (user, verifier) in read {
            self.add_account(user, verifier);
        }
        Ok(())
    }

    pub(in super::super) fn user_remove(&mut self, id: ConnectionId, tag: u32, user: &str) {
        if let Err(code) = self.try_user_remove(id, tag, user) {
            self.refuse(id, tag, code);
        }
    }

    fn try_user_remove(&mut self, id: ConnectionId, tag: u32, user: &str) -> Result<(), RefusalCode> {
        if !self.administers_accounts(id) {
            return Err(RefusalCode::Denied);
        }
        if self.settings.user.as_str() == user {
            return Err(RefusalCode::BadUser);
        }
        let user = Name::new(user).map_err(|_| RefusalCode::NoSuchUser)?;
        if !self.accounts.accounts.contains_key(&user) {
            return Err(RefusalCode::NoSuchUser);
        }
        if !self.storing.is_on() {
            return Err(RefusalCode::NotOffered);
        }
        let connections = self.connections_of(user.as_str());
        self.accounts.accounts.remove(&user);
        self.entity_ended(DatabaseKind::User, &user, Entity::User);
        self.forget_account_database(&user);
        let written = self.write_account(id, tag, &user, None);
        for connection in connections {
            self.close(connection, ClosingReason::AccountRemoved);
        }
        written
    }

    /// Whether a connection may do with accounts as it likes: whoever may, may give itself every right.
    fn administers_accounts(&self, id: ConnectionId) -> bool {
        let connection = self.connections.get(id);
        connection.is_some_and(|connection| connection.rights.allows_everywhere(Right::Administer))
    }

    /// Its rights go before the account does, or in the same transaction: the disk has no rights of an account
    /// that is not there.
    fn forget_account_database(&mut self, user: &Name) {
        if let Some(name) = DatabaseName::of(DatabaseKind::User, user)
            && self.databases.is_saved(&name)
            && self.databases.remove(&name).is_ok()
        {
            self.ask_store(&name, StoreWork::Remove, Purpose::Quiet);
        }
    }

    fn write_account(
        &mut self,
        id: ConnectionId,
        tag: u32,
        user: &Name,
        value: Option<Value>,
    ) -> Result<(), RefusalCode> {
        let database = DatabaseName::accounts();
        match &value {
            Some(value) => drop(self.databases.set(&database, user.as_str(), value.clone())?),
            None => drop(self.databases.delete(&database, user.as_str())?),
        }
        self.write_change(id, tag, &database, user.as_str(), value)
    }

    pub(in super::super) fn user_list(&mut self, id: ConnectionId, tag: u32) {
        if self.administers_accounts(id) {
            self.tell_list(id, tag, Form::Binary, Telling::Accounts { after: None });
        } else {
            self.refuse(id, tag, RefusalCode::Denied);
        }
    }

    /// The line of the next account. The owner's is listed whether or not it has a password.
    pub(in super::super) fn account_line(&self, tag: u32, after: &mut Option<Name>) -> Option<Encoded> {
        let owner =
            Some(&self.settings.user).filter(|owner| after.as_ref().is_none_or(|after| after < owner));
        let next = self.accounts.next(after.as_ref());
        let user = match (owner, next) {
            (Some(owner), Some(next)) => owner.min(next),
            (owner, next) => owner.or(next)?,
        };
        let connections = self
            .connections
            .iter()
            .filter(|(_, found)| found.user.as_ref() == Some(user))
            .count() as u32;
        let line = Event::UserListed { user: user.to_string(), connections }.encode(tag, Flags::NONE);
        *after = Some(user.clone());
        Some(line)
    }
}
