//! Turns: a bounded piece of a connection's commands, from bytes to effects.

use super::super::definition::{Encoded, Tagged};
use super::super::error::{ProtocolError, RefusalCode};
use super::super::limits::{FRAGMENT_BYTES_MAX, TURN_COST_MAX};
use super::super::scram::Verifier;
use super::super::{ChannelKind, Command, Event, Flags, Message};
use super::blobs::UploadPiece;
use super::channels::subscriptions::Wish;
use super::services::{AnswerPiece, CallPiece};
use super::{ConnectionId, ServerCore};
use crate::testing::{Bug, is_planted};
use sk_flat::Instant;

impl ServerCore {
    /// Takes received bytes and handles the commands in them, up to the budget of one turn; what is left
    /// waits for [`work`](ServerCore::work).
    pub fn receive(&mut self, id: ConnectionId, bytes: &[u8], now: Instant) {
        let Some(connection) = self.heard(id, now) else { return };
        if connection.closing.is_some() {
            return;
        }
        connection.inbound.feed(bytes);
        if !connection.queued {
            self.turn(id);
        }
        self.settle();
    }

    /// Takes a frame from inside the process; the payload is not copied.
    pub fn accept(&mut self, id: ConnectionId, frame: Encoded, now: Instant) {
        let Some(connection) = self.heard(id, now) else { return };
        if connection.closing.is_some() {
            return;
        }
        connection.parts.push_back(frame);
        if !connection.queued {
            self.turn(id);
        }
        self.settle();
    }

    /// Gives one connection whose commands wait a turn. Answers whether more wait.
    pub fn work(&mut self, now: Instant) -> bool {
        self.now = now;
        if let Some(id) = self.work.pop_front() {
            if let Some(connection) = self.connections.get_mut(id) {
                connection.queued = false;
                let tells = connection.replay.is_some() || connection.desk.has_news();
                self.turn(id);
                if tells {
                    // What was not found out in the turn before is looked for when there is room to tell it.
                    self.mark_dirty(id);
                }
            }
            self.settle();
        }
        !self.work.is_empty()
    }

    fn heard(&mut self, id: ConnectionId, now: Instant) -> Option<&mut super::Connection> {
        self.now = now;
        let connection = self.connections.get_mut(id)?;
        connection.heard = now;
        Some(connection)
    }

    fn turn(&mut self, id: ConnectionId) {
        let mut budget = TURN_COST_MAX;
        while let Some(connection) = self.connections.get_mut(id) {
            if connection.is_held() {
                return;
            }
            match connection.next_command() {
                Err(error) => return self.kill(id, error),
                Ok(None) => {
                    let waits = connection.inbound.pending() > 0;
                    connection.frame_begun = waits.then(|| connection.frame_begun.unwrap_or(self.now));
                    return;
                }
                Ok(Some(tagged)) => {
                    connection.frame_begun = None;
                    if self.must_wait(&tagged.message) {
                        return self.pace(id, tagged);
                    }
                    let cost = tagged.message.definition().cost;
                    self.asked = Some(tagged.message.definition().name);
                    let done = self.dispatch(id, tagged);
                    self.asked = None;
                    if let Err(error) = done {
                        return self.kill(id, error);
                    }
                    if cost >= budget {
                        return self.enqueue(id);
                    }
                    budget -= cost;
                }
            }
        }
    }

    /// One command. The state was checked when its frame was; the right is checked here, for every
    /// command alike.
    fn dispatch(&mut self, id: ConnectionId, tagged: Tagged<Command>) -> Result<(), ProtocolError> {
        let Tagged { tag, flags, message } = tagged;
        let Some(connection) = self.connections.get(id) else { return Ok(()) };
        if !connection.rights.has(message.definition().right) && !is_planted(Bug::RightsSkipped) {
            self.refuse_once(id, tag, flags, &message, RefusalCode::Denied);
            return Ok(());
        }
        // A whole message finds room, or none, with those who hear it.
        let held = message.definition().fragment
            && !(flags == Flags::WHOLE && matches!(message, Command::Publish { .. }));
        if held && !self.budget.has_room_for(FRAGMENT_BYTES_MAX) {
            // Who does not read what waits for him is not to keep others from sending.
            self.make_room();
        }
        match message {
            Command::Hello { magic, version, version_oldest, fragment_bytes, message_bytes, nonce } => {
                self.hello(
                    id,
                    tag,
                    super::access::login::Greeting {
                        magic,
                        version,
                        version_oldest,
                        fragment_bytes,
                        message_bytes,
                        nonce,
                    },
                )?;
            }
            Command::LoginToken { proof } => self.login_token(id, tag, &proof),
            Command::LoginPeer {} => self.login_peer(id, tag),
            Command::LoginScram { message } => self.login_scram(id, tag, &message),
            Command::LoginScramProof { message } => self.login_scram_proof(id, tag, &message),
            Command::UserSet { user, rounds, salt, stored_key, server_key } => {
                self.user_set(id, tag, &user, Verifier::new(rounds, salt, stored_key, server_key));
            }
            Command::UserRemove { user } => self.user_remove(id, tag, &user),
            Command::UserList {} => self.user_list(id, tag),
            Command::Ping {} => self.answer(id, tag, &Event::Pong {}),
            Command::Pong {} => {}
            Command::SetAsync { name, session, form } => self.set_async(id, tag, &name, session, form),
            Command::ListChannels { form } => self.list(id, tag, form),
            Command::CreateStream { name, properties } => {
                self.create_channel(id, tag, ChannelKind::Stream, &name, properties);
            }
            Command::RemoveChannel { channel } => self.remove_on_request(id, tag, channel),
            Command::Subscribe { channel, policy, depth, divisor } => {
                self.subscribe(id, tag, channel, Wish { policy, depth, divisor })?;
            }
            Command::Unsubscribe { channel } => self.unsubscribe(id, tag, channel),
            Command::Publish { channel, message, payload } => {
                self.publish(id, tag, flags, super::channels::publish::Piece { channel, message, payload })?;
            }
            Command::UdpOpen {} => self.udp_open(id, tag),
            Command::Inspect { subject, form } => self.inspect(id, tag, &subject, form),
            Command::ChangeHeader { channel, properties } => {
                self.change_header(id, tag, channel, properties);
            }
            Command::Attach { replica, source } => self.attach(id, tag, replica, source),
            Command::Detach { replica } => self.detach(id, tag, replica),
            Command::PollRegister { channel } => self.poll_register(id, tag, channel),
            Command::PollDeregister { channel } => self.poll_deregister(id, tag, channel),
            Command::Poll { channel } => self.poll(id, tag, channel),
            Command::CreateSync { name, properties } => {
                self.create_channel(id, tag, ChannelKind::Sync, &name, properties);
            }
            Command::SyncTick { channel, sequence } => self.sync_tick(id, tag, channel, sequence)?,
            Command::TickDone { channel, sequence } => self.tick_done(id, channel, sequence)?,
            Command::CreateService { name, properties } => {
                self.create_channel(id, tag, ChannelKind::Service, &name, properties);
            }
            Command::Call { channel, deadline_ms, payload } => {
                self.call(id, tag, flags, CallPiece { channel, deadline_ms, payload })?;
            }
            Command::Answer { request, more, payload } => {
                self.answer_request(id, flags, AnswerPiece { request, more, payload })?;
            }
            Command::Decline { request, text } => self.decline(id, request, text),
            Command::Cancel { call } => self.cancel(id, call),
            Command::CreateBlob { name, properties } => self.create_blob(id, tag, &name, properties),
            Command::BlobWrite { channel, path, offset, payload } => {
                self.blob_write(id, tag, flags, UploadPiece { channel, path: path.0, offset, payload })?;
            }
            message @ (Command::BlobBegin { .. }
            | Command::BlobCommit { .. }
            | Command::BlobAbort { .. }
            | Command::BlobMkdir { .. }
            | Command::BlobMove { .. }
            | Command::BlobRemove { .. }
            | Command::BlobList { .. }
            | Command::BlobStat { .. }
            | Command::BlobRead { .. }) => self.blob_command(id, tag, message),
            message @ (Command::DbSelect { .. }
            | Command::DbCreate { .. }
            | Command::DbExists { .. }
            | Command::DbRemove { .. }
            | Command::DbSave {}
            | Command::DbLoad {}
            | Command::DbList { .. }
            | Command::VarSet { .. }
            | Command::VarGet { .. }
            | Command::VarHas { .. }
            | Command::VarDelete { .. }
            | Command::DbKeys { .. }
            | Command::DbAll { .. }
            | Command::Watch { .. }
            | Command::Unwatch { .. }) => self.database_command(id, tag, message),
        }
        Ok(())
    }

    /// Refuses a command; a message in fragments once.
    fn refuse_once(
        &mut self,
        id: ConnectionId,
        tag: u32,
        flags: Flags,
        command: &Command,
        code: RefusalCode,
    ) {
        if !command.definition().fragment || flags.has(Flags::FIRST) {
            self.refuse(id, tag, code);
        }
    }
}
