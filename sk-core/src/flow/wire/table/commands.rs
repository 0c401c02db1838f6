//! The lines of the table for what a client sends.

use super::super::codec::{ChannelRef, Path, Payload, Reader, Wire};
use super::super::error::ProtocolError;
use super::super::frame::{Flags, Header};
use super::super::kinds::Policy;
use super::super::state::State;
use super::super::value::{Form, Properties, Value};
use super::definition::{Definition, Direction, Encoded, Field, Message, Right, States, Tagged, flow_table};
use bytes::Bytes;

flow_table! {
    /// What a client sends to its hub.
    Command: ClientToHub

    /// The first frame of a client: which versions it speaks and what it can take.
    0x01 hello Hello [Greeting] Nothing 1 whole {
        magic: [u8; 8] = "The bytes `SpecialK`.",
        version: u16 = "The newest version that the client speaks.",
        version_oldest: u16 = "The oldest version that the client speaks.",
        fragment_bytes: u32 = "The longest fragment payload that the client takes, at least 256.",
        message_bytes: u32 = "The longest message that the client takes, at least `fragment_bytes`.",
        nonce: [u8; 32] = "Random bytes, new for each connection.",
    }
    /// Logs in to the owner's account by proof of the owner's token; answered by `logged_in`, or `closing`.
    0x02 login_token LoginToken [Login] Nothing 16 whole {
        proof: [u8; 32] = "HMAC-SHA-256 over both nonces, keyed by the token.",
    }
    /// Logs in to the owner's account by the user id that the kernel tells of the other end of a Unix socket.
    0x03 login_peer LoginPeer [Login] Nothing 16 whole {
    }
    /// Asks whether the hub is there; answered by `pong` with the same tag.
    0x04 ping Ping [Synchronous Flow] Nothing 1 whole {
    }
    /// Answers a `ping` of the hub, with its tag.
    0x05 pong Pong [Synchronous Flow] Nothing 1 whole {
    }
    /// Turns the connection into a flow; answered by a `channel_added` for each channel there is, then `flow_begun`.
    0x06 set_async SetAsync [Synchronous] Nothing 64 whole {
        name: String = "The flow's name without its user; empty lets the hub choose one. It is called `user.name`.",
        session: [u8; 16] = "The session that an earlier `flow_begun` told, to take its place; zeros for a new one.",
        form: Form = "The form in which values come on this flow.",
    }
    /// Lists the channels; answered by a `channel_listed` for each, then `list_end`.
    0x07 list_channels ListChannels [Synchronous Flow] List 64 whole {
        form: Form = "The form of the properties in the answer.",
    }
    /// Begins a login by name and password (SCRAM-SHA-256, RFC 7677); answered by `scram_challenge`, or `closing`.
    0x08 login_scram LoginScram [Login] Nothing 16 whole {
        message: String = "The `client-first-message` of RFC 5802.",
    }
    /// Ends a login by name and password; answered by `logged_in`, or `closing`.
    0x09 login_scram_proof LoginScramProof [Login] Nothing 16 whole {
        message: String = "The `client-final-message` of RFC 5802.",
    }
    /// Asks what the hub knows of itself; answered by `value`.
    0x0a inspect Inspect [Synchronous Flow] List 64 whole {
        subject: String = "What to tell of; see the list of subjects.",
        form: Form = "The form of the answer.",
    }
    /// Opens a session for publishing by UDP; answered by `udp_opened`.
    0x0b udp_open UdpOpen [Flow] Publish 16 whole {
    }
    /// Creates a streaming channel owned by this flow; all hear `channel_added`, this flow with the tag.
    0x10 create_stream CreateStream [Flow] Publish 16 whole {
        name: String = "The name without its user, of `a-z 0-9 _ . -`. The channel is called `user.name`.",
        properties: Properties = "A map that says what flows: `mime`, `format`, `unit`, `rate`, and whatever is useful.",
    }
    /// Removes a channel that this flow owns; all hear `channel_removed`, this flow with the tag.
    0x11 remove_channel RemoveChannel [Flow] Nothing 16 whole {
        channel: ChannelRef = "The channel.",
    }
    /// Subscribes to a streaming or sync channel; answered by `subscribed`. Again, it changes the subscription.
    0x12 subscribe Subscribe [Flow] Subscribe 4 whole {
        channel: ChannelRef = "The channel.",
        policy: Policy = "What becomes of messages when this flow does not keep up.",
        depth: u16 = "How many whole messages wait at most; 0 means 64; at most 1,024.",
        divisor: u8 = "Of a sync channel: every tick (1), every second (2), every fourth (4), or as the hub finds bearable (0). Of others 1.",
    }
    /// Ends a subscription; answered by `unsubscribed`. It may be sent where there is none.
    0x13 unsubscribe Unsubscribe [Flow] Subscribe 4 whole {
        channel: ChannelRef = "The channel.",
    }
    /// One fragment of a message on a channel that this flow owns; not answered unless it is refused.
    0x14 publish Publish [Flow] Publish 1 fragment {
        channel: ChannelRef = "The channel.",
        message: u32 = "The message's id, chosen by the publisher; the same in all its fragments.",
        payload: Payload = "The bytes of this fragment.",
    }
    /// Changes what a channel of this flow says about itself; all hear `header_changed`, this flow with the tag.
    0x15 change_header ChangeHeader [Flow] Nothing 16 whole {
        channel: ChannelRef = "The channel.",
        properties: Properties = "The new map, in place of the old one.",
    }
    /// Makes a streaming channel of this flow repeat what another one carries; answered by `attached`.
    0x16 attach Attach [Flow] Subscribe 16 whole {
        replica: ChannelRef = "The channel of this flow that repeats.",
        source: ChannelRef = "The streaming channel that is repeated.",
    }
    /// Ends the repeating; answered by `detached`.
    0x17 detach Detach [Flow] Nothing 4 whole {
        replica: ChannelRef = "The channel that repeats.",
    }
    /// Asks the hub to keep the newest message of a streaming channel for this connection to poll; answered by `done`.
    0x18 poll_register PollRegister [Synchronous] Subscribe 4 whole {
        channel: ChannelRef = "The channel.",
    }
    /// Ends what `poll_register` began; answered by `done`.
    0x19 poll_deregister PollDeregister [Synchronous] Subscribe 4 whole {
        channel: ChannelRef = "The channel.",
    }
    /// Asks for the newest message; answered by `latest`, or refused as `NothingYet`.
    0x1a poll Poll [Synchronous] Subscribe 4 whole {
        channel: ChannelRef = "A channel that this connection registered for.",
    }
    /// Creates a sync channel owned by this flow; all hear `channel_added`, this flow with the tag.
    0x1b create_sync CreateSync [Flow] Publish 16 whole {
        name: String = "The name without its user.",
        properties: Properties = "A map; `interval_ns` says the planned interval of the ticks.",
    }
    /// A tick of this flow's sync channel; not answered unless it is refused.
    0x1c sync_tick SyncTick [Flow] Publish 1 whole {
        channel: ChannelRef = "The channel.",
        sequence: u64 = "One more than that of the tick before; a missing one is a missed tick.",
    }
    /// Says that the pulse which followed a `tick` is over; not answered.
    0x1d tick_done TickDone [Flow] Subscribe 1 whole {
        channel: ChannelRef = "The channel.",
        sequence: u64 = "That of the tick.",
    }
    /// Creates a service channel owned by this flow; all hear `channel_added`, this flow with the tag.
    0x20 create_service CreateService [Flow] Serve 16 whole {
        name: String = "The name without its user.",
        properties: Properties = "A map that says what is asked and answered.",
    }
    /// One fragment of a request to a service; answered by `reply`, or refused. Several may be open at once.
    0x21 call Call [Synchronous Flow] Call 4 fragment {
        channel: ChannelRef = "The service channel.",
        deadline_ms: u32 = "How long the answer may take, in milliseconds from the last fragment; 0 means 5,000; at most 3,600,000.",
        payload: Payload = "The bytes of this fragment.",
    }
    /// One fragment of an answer to a request, by the owner of the service; not answered unless it is refused.
    0x22 answer Answer [Flow] Serve 1 fragment {
        request: u64 = "The id that came with the `request`.",
        more: u8 = "1: further answers follow, the request stays open (a stream for one asker); 0: this is the last.",
        payload: Payload = "The bytes of this fragment.",
    }
    /// Says that a request will have no answer; the asker's call is refused as `Declined`.
    0x23 decline Decline [Flow] Serve 1 whole {
        request: u64 = "The id that came with the `request`.",
        text: String = "Why, for people.",
    }
    /// Gives up a call of this connection; it has no further answer.
    0x24 cancel Cancel [Flow] Call 1 whole {
        call: u32 = "The tag of the call.",
    }
    /// Creates a blob channel owned by this flow, or finds again what the hub kept under its name; all hear `channel_added`.
    0x30 create_blob CreateBlob [Flow] BlobWrite 16 whole {
        name: String = "The name without its user.",
        properties: Properties = "A map.",
    }
    /// Begins or resumes an upload to a blob channel of this flow; answered by `blob_resume`.
    0x31 blob_begin BlobBegin [Flow] BlobWrite 64 whole {
        channel: ChannelRef = "The channel.",
        path: Path = "Where the file will be.",
        bytes: u64 = "How long it is.",
        checksum: u32 = "CRC-32 of the whole, as zlib calculates it.",
    }
    /// One fragment of a piece of an upload; a whole piece is answered by `done`.
    0x32 blob_write BlobWrite [Flow] BlobWrite 1 fragment {
        channel: ChannelRef = "The channel.",
        path: Path = "As in `blob_begin`.",
        offset: u64 = "Where the piece begins in the file: the end of what the hub has.",
        payload: Payload = "The bytes of this fragment.",
    }
    /// Ends an upload: checks length and checksum and puts the file in its place; answered by `saved`.
    0x33 blob_commit BlobCommit [Flow] BlobWrite 64 whole {
        channel: ChannelRef = "The channel.",
        path: Path = "As in `blob_begin`.",
    }
    /// Gives an upload up and forgets what was sent; answered by `done`.
    0x34 blob_abort BlobAbort [Flow] BlobWrite 16 whole {
        channel: ChannelRef = "The channel.",
        path: Path = "As in `blob_begin`.",
    }
    /// Makes a directory; answered by `saved`.
    0x35 blob_mkdir BlobMkdir [Flow] BlobWrite 64 whole {
        channel: ChannelRef = "The channel.",
        path: Path = "The directory; the one above must be there.",
    }
    /// Moves a file or a directory, in place of a file that is there; answered by `saved`.
    0x36 blob_move BlobMove [Flow] BlobWrite 64 whole {
        channel: ChannelRef = "The channel.",
        from: Path = "What is moved.",
        to: Path = "Its new path.",
    }
    /// Removes a file or an empty directory; answered by `saved`.
    0x37 blob_remove BlobRemove [Flow] BlobWrite 64 whole {
        channel: ChannelRef = "The channel.",
        path: Path = "What is removed.",
    }
    /// Lists a directory; answered by a `blob_listed` for each entry, then `list_end`.
    0x38 blob_list BlobList [Synchronous Flow] BlobRead 64 whole {
        channel: ChannelRef = "The channel.",
        path: Path = "The directory; empty for the channel's own.",
    }
    /// Asks about one file or directory; answered by `blob_entry`.
    0x39 blob_stat BlobStat [Synchronous Flow] BlobRead 16 whole {
        channel: ChannelRef = "The channel.",
        path: Path = "What is asked about.",
    }
    /// Downloads a range of a file; answered by `blob_data`.
    0x3a blob_read BlobRead [Synchronous Flow] BlobRead 64 whole {
        channel: ChannelRef = "The channel.",
        path: Path = "The file.",
        offset: u64 = "Where the range begins.",
        bytes: u32 = "How long it is at most; less comes at the end of the file.",
    }
    /// Makes a database the current one of this connection; answered by `database_selected`.
    0x40 db_select DbSelect [Synchronous Flow] Nothing 4 whole {
        database: String = "`flow:user.name`, `user:name`, `chan:user.name`, or a plain name.",
    }
    /// Creates a named database; answered by `done`, or `saved` if it is durable.
    0x41 db_create DbCreate [Synchronous Flow] DatabaseWrite 16 whole {
        database: String = "A plain name.",
        durable: u8 = "1: every change is on the disk before it is acknowledged. 0: only `db_save` writes.",
    }
    /// Asks whether a database exists; answered by `flag`.
    0x42 db_exists DbExists [Synchronous Flow] DatabaseRead 4 whole {
        database: String = "Its name.",
    }
    /// Removes a named database, on the disk too; answered by `saved`. Who had it selected hears `database_selected` with an empty name.
    0x43 db_remove DbRemove [Synchronous Flow] DatabaseWrite 16 whole {
        database: String = "A plain name.",
    }
    /// Writes the current database to the disk in one transaction; answered by `saved`.
    0x44 db_save DbSave [Synchronous Flow] DatabaseWrite 64 whole {
    }
    /// Puts what was saved in place of what the current database holds; answered by `done`.
    0x45 db_load DbLoad [Synchronous Flow] DatabaseWrite 64 whole {
    }
    /// Lists databases; answered by a `database_listed` for each, then `list_end`.
    0x46 db_list DbList [Synchronous Flow] List 64 whole {
        prefix: String = "What their names begin with; empty for all.",
    }
    /// Sets a variable of the current database; answered by `done`, or `saved` if it is durable. With the tag 0 only a refusal answers.
    0x47 var_set VarSet [Synchronous Flow] DatabaseWrite 4 whole {
        key: String = "Its key: 1 to 255 bytes without control characters.",
        value: Value = "Its value.",
    }
    /// Asks for a variable of the current database; answered by `value`.
    0x48 var_get VarGet [Synchronous Flow] DatabaseRead 4 whole {
        key: String = "Its key.",
        form: Form = "The form of the answer.",
    }
    /// Asks whether the current database has a variable; answered by `flag`.
    0x49 var_has VarHas [Synchronous Flow] DatabaseRead 4 whole {
        key: String = "Its key.",
    }
    /// Deletes a variable of the current database; answered as `var_set`. It may be sent where there is none.
    0x4a var_delete VarDelete [Synchronous Flow] DatabaseWrite 4 whole {
        key: String = "Its key.",
    }
    /// Lists the keys of the current database; answered by a `key_listed` for each, then `list_end`.
    0x4b db_keys DbKeys [Synchronous Flow] DatabaseRead 64 whole {
        prefix: String = "What they begin with; empty for all.",
    }
    /// Lists the variables of the current database; answered by a `variable` for each, then `list_end`.
    0x4c db_all DbAll [Synchronous Flow] DatabaseRead 64 whole {
        prefix: String = "What their keys begin with; empty for all.",
        form: Form = "The form of the values.",
    }
    /// Watches variables: what there is comes as `changed`, then `watching`, then every change, all with the tag.
    0x4d watch Watch [Flow] DatabaseRead 64 whole {
        database: String = "The database.",
        prefix: String = "What the keys begin with; empty for all.",
        after: u64 = "The last sequence number that was heard before a reconnection; 0 for a new watch.",
        form: Form = "The form of the values.",
    }
    /// Ends a watch; answered by `done`.
    0x4e unwatch Unwatch [Flow] DatabaseRead 4 whole {
        watch: u32 = "The tag of its `watch`.",
    }
    /// Adds an account, or changes its password; answered by `saved`. An account may change its own.
    0x60 user_set UserSet [Synchronous Flow] Nothing 64 whole {
        user: String = "The name of the account, without a dot.",
        rounds: u32 = "The rounds of PBKDF2, at least 15,000.",
        salt: [u8; 16] = "The salt, random.",
        stored_key: [u8; 32] = "`StoredKey` of RFC 5802.",
        server_key: [u8; 32] = "`ServerKey` of RFC 5802.",
    }
    /// Removes an account with its rights; its connections end. Answered by `saved`.
    0x61 user_remove UserRemove [Synchronous Flow] Administer 64 whole {
        user: String = "The name of the account.",
    }
    /// Lists the accounts; answered by a `user_listed` for each, then `list_end`.
    0x62 user_list UserList [Synchronous Flow] Administer 64 whole {
    }
}
