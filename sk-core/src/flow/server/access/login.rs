//! Greeting, login, and the switch to a flow.

use super::super::connection::identity::Origin;
use super::super::connection::telling::Telling;
use super::super::{ConnectionId, Notice, ServerCore};
use super::permission::Permission;
use crate::flow::error::{ClosingReason, ProtocolError};
use crate::flow::limits::{
    FAILED_LOGIN_DELAY, FRAGMENT_BYTES_MAX, FRAGMENT_BYTES_MIN, MAGIC, MESSAGE_BYTES_MAX, VERSION,
    VERSION_OLDEST,
};
use crate::flow::login::{NO_PROOF, Nonce, Proof};
use crate::flow::{Event, Form, Rights};
use sk_flat::Name;

/// The fields of a client's first frame.
pub(in super::super) struct Greeting {
    pub(in super::super) magic: [u8; 8],
    pub(in super::super) version: u16,
    pub(in super::super) version_oldest: u16,
    pub(in super::super) fragment_bytes: u32,
    pub(in super::super) message_bytes: u32,
    pub(in super::super) nonce: Nonce,
}

impl ServerCore {
    pub(in super::super) fn hello(
        &mut self,
        id: ConnectionId,
        tag: u32,
        said: Greeting,
    ) -> Result<(), ProtocolError> {
        let bad = |field, value| Err(ProtocolError::BadValue { kind: "hello", field, value });
        if said.magic != MAGIC {
            return Err(ProtocolError::NotFlow);
        }
        if said.version_oldest > said.version {
            return bad("version_oldest", said.version_oldest.into());
        }
        if (said.fragment_bytes as usize) < FRAGMENT_BYTES_MIN {
            return bad("fragment_bytes", said.fragment_bytes.into());
        }
        if said.message_bytes < said.fragment_bytes {
            return bad("message_bytes", said.message_bytes.into());
        }
        let version = said.version.min(VERSION);
        if version < said.version_oldest.max(VERSION_OLDEST) {
            self.close(id, ClosingReason::Version);
            return Ok(());
        }
        let fragment_bytes = said.fragment_bytes.min(FRAGMENT_BYTES_MAX as u32);
        let message_bytes = said.message_bytes.min(MESSAGE_BYTES_MAX as u32);
        let Some(connection) = self.connections.get_mut(id) else { return Ok(()) };
        connection.client_nonce = said.nonce;
        connection.inbound.agree(fragment_bytes, message_bytes);
        connection.inbound.advance();
        connection.output.fragment_bytes_max = fragment_bytes as usize;
        connection.output.message_bytes_max = message_bytes as usize;
        let nonce = connection.hub_nonce;
        self.answer(id, tag, &Event::Welcome { magic: MAGIC, version, fragment_bytes, message_bytes, nonce });
        Ok(())
    }

    pub(in super::super) fn login_token(&mut self, id: ConnectionId, tag: u32, proof: &Proof) {
        let (Some(connection), Some(token)) = (self.connections.get(id), &self.settings.token) else {
            return self.login_failed(id);
        };
        let (client, hub) = (&connection.client_nonce, &connection.hub_nonce);
        // A client that cannot bind its login, as most in other languages cannot, proves the token as it is.
        let bound = connection.binding.map(|binding| token.bound_to(&binding));
        let plain = Some(token).filter(|_| bound.is_none() || !self.must_bind);
        let mut tokens = bound.iter().chain(plain);
        let proven = tokens.find(|token| token.client_is_true(client, hub, proof));
        if let Some(token) = proven.filter(|_| connection.scram.is_none()) {
            let proof = token.hub_proof(client, hub);
            let owner = self.settings.user.clone();
            self.logged_in(id, tag, owner, Permission::of(Rights::ALL), proof);
        } else {
            self.login_failed(id);
        }
    }

    pub(in super::super) fn login_peer(&mut self, id: ConnectionId, tag: u32) {
        let Some(connection) = self.connections.get(id) else { return };
        let rights = match connection.origin {
            Origin::Inside { rights } => Some(rights),
            Origin::Unix { uid } if self.settings.owner_uid == Some(uid) => Some(Rights::ALL),
            Origin::Unix { .. } | Origin::Line | Origin::Network(_) => None,
        };
        match rights.filter(|_| connection.scram.is_none()) {
            Some(rights) => {
                let owner = self.settings.user.clone();
                self.logged_in(id, tag, owner, Permission::of(rights), NO_PROOF);
            }
            None => self.login_failed(id),
        }
    }

    pub(super) fn logged_in(
        &mut self,
        id: ConnectionId,
        tag: u32,
        user: Name,
        rights: Permission,
        proof: Proof,
    ) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        connection.user = Some(user.clone());
        self.waiting -= 1;
        connection.rights = rights;
        connection.inbound.advance();
        self.answer(id, tag, &Event::LoggedIn { connection: id.wire(), user: user.to_string(), proof });
        self.notices.push_back(Notice::LoggedIn { connection: id, user });
    }

    /// One attempt for each connection: the nonces are used up. An honest client may hold an old token, so
    /// this is no reason to call it spurious. Where many fail, all that fail are answered late, whatever the
    /// reason; one that succeeds never is.
    pub(super) fn login_failed(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        if self.addresses.failed(connection.origin, self.now) {
            let at = self.now + FAILED_LOGIN_DELAY;
            connection.login_refused_at = Some(at);
            self.look_at(id, at);
        } else {
            self.close(id, ClosingReason::LoginFailed);
        }
    }

    pub(in super::super) fn list(&mut self, id: ConnectionId, tag: u32, form: Form) {
        self.tell_list(id, tag, form, Telling::Channels { begins_flow: false, next: 0 });
    }
}
