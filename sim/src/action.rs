//! What can happen to a node.

use crate::words::{Words, name_of, named, number, words};
use sk_core::world::Death;
use std::fmt;

/// What happens at one step. Those that do not fit the node's role or state do nothing, so that a script stays
/// a script whatever is deleted from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// The node opens its channel of that number.
    Open(u8),
    /// It closes it.
    Close(u8),
    /// It subscribes to another node's channel: whose, which, and how many messages may wait (0: the hub's default).
    Hear(u16, u8, u16),
    /// The same, and it must not miss a message: if more wait than that, it is to be told by the end of its connection.
    HearAll(u16, u8, u16),
    /// It gives that subscription up.
    Unhear(u16, u8),
    /// Its channel of that number is published by datagrams from now on.
    ByUdp(u8),
    /// It asks for the newest message of another node's channel, as one who asks now and then.
    Poll(u16, u8),
    /// It does not ask for it any more.
    PollNoMore(u16, u8),
    /// Its channel of that number repeats another node's: whose, and which.
    Repeat(u8, u16, u8),
    /// It repeats nothing any more.
    RepeatNoMore(u8),
    /// Its loop's ticks are a clock for others.
    Tick,
    /// They are not any more.
    TickNoMore,
    /// Its loop follows the ticks of that node: every one, every second, every fourth, or (0) as many as it can.
    Follow(u16, u8),
    /// It keeps its own time again.
    FollowNoMore,
    /// It publishes that many messages of that many bytes on its channel.
    Burst(u8, u16, u32),
    /// It begins a message of that many bytes on its channel and gives it up.
    Abort(u8, u32),
    /// It offers its service: it echoes, late, never, or declines, by chance.
    Serve,
    /// It offers it no more.
    Unserve,
    /// It calls that node's service that many times, with that many bytes.
    Call(u16, u16, u32),
    /// It changes that many variables of its durable database, one after the other.
    Write(u16),
    /// It changes its other database and saves it.
    Save,
    /// It takes back what it saved last.
    Load,
    /// It watches the databases of that node.
    Watch(u16),
    /// It compares what it was told of what it watches with what there is.
    Ask,
    /// It uploads to the path of that number the content of that version, of so many bytes.
    Put(u8, u16, u32),
    /// It makes a folder in its blob channel.
    MakeFolder,
    /// It moves what stands at a path to another one.
    Shift(u8, u8),
    /// It removes what stands at a path.
    Drop(u8),
    /// It downloads what stands at a path of that node's blob channel, and asks what it is.
    Fetch(u16, u8),
    /// It asks what stands in that node's blob channel.
    Browse(u16),
    /// Of 1024 reads, writes and synchronisations of the hub's disk so many fail, and it has room for so many KiB (0: as
    /// many as are wanted).
    Disk(u16, u16, u16, u16),
    /// Bytes of the hub's store are other ones when it is started next: at that 1024th of the file, so many.
    Rot(u16, u16),
    /// It reads no more than that many bytes every five milliseconds; 0 is as fast as they come.
    Slow(u32),
    /// It sends what no honest client sends, of that kind.
    Wild(Wildness),
    /// The way to the hub is late by microseconds, by chance later still, and cut into pieces of at most that size
    /// (0: whole).
    Link(u32, u32, u16),
    /// Of 1024 datagrams to the hub so many are lost and so many come twice, and all are late by chance by up to so many
    /// microseconds.
    Lossy(u16, u16, u32),
    /// The way refuses those who want to connect.
    Refuse,
    /// The way is in order again, and no partition is left.
    Mend,
    /// Nothing comes through any more: towards the hub, from the hub.
    Part(bool, bool),
    /// All connections with the hub break.
    Reset,
    /// The process ends without a word.
    Die(Death),
    /// It is started anew and calls another hub than its own.
    Stray,
    /// It is started anew and calls its own hub again.
    Home,
    /// It says that it is done with a tick so many microseconds late.
    Late(u32),
    /// It ends as it should.
    Quit,
    /// It is started again.
    Start,
}

/// What a client can do that is not honest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wildness {
    /// Random bytes instead of a greeting.
    Noise,
    /// A header that announces gigabytes.
    SizeBomb,
    /// An honest login, and then random bytes.
    LateNoise,
    /// An honest login, and then a second greeting.
    WrongState,
    /// Half a frame, and then silence.
    Half,
    /// A login with a token that is not the hub's.
    FalseToken,
    /// An honest login, and then publishing on the channels of others.
    Usurper,
    /// An honest login, and then references to channels that never were.
    Stale,
}

/// Their names in scripts.
pub(crate) const WILDNESSES: [(Wildness, &str); 8] = [
    (Wildness::Noise, "noise"),
    (Wildness::SizeBomb, "size-bomb"),
    (Wildness::LateNoise, "late-noise"),
    (Wildness::WrongState, "wrong-state"),
    (Wildness::Half, "half"),
    (Wildness::FalseToken, "false-token"),
    (Wildness::Usurper, "usurper"),
    (Wildness::Stale, "stale"),
];

const DEATHS: [(Death, &str); 3] =
    [(Death::Killed, "killed"), (Death::Vanished, "vanished"), (Death::PowerCut, "power-cut")];

impl fmt::Display for Action {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Action::Open(channel) => words(f, "open", &[channel.into()]),
            Action::Close(channel) => words(f, "close", &[channel.into()]),
            Action::Hear(node, channel, depth) => {
                words(f, "hear", &[node.into(), channel.into(), depth.into()])
            }
            Action::HearAll(node, channel, depth) => {
                words(f, "hear-all", &[node.into(), channel.into(), depth.into()])
            }
            Action::Unhear(node, channel) => words(f, "unhear", &[node.into(), channel.into()]),
            Action::Poll(node, channel) => words(f, "poll", &[node.into(), channel.into()]),
            Action::ByUdp(channel) => words(f, "by-udp", &[channel.into()]),
            Action::Lossy(loss, twice, jitter) => {
                words(f, "lossy", &[loss.into(), twice.into(), jitter.into()])
            }
            Action::PollNoMore(node, channel) => words(f, "poll-no-more", &[node.into(), channel.into()]),
            Action::Repeat(channel, node, source) => {
                words(f, "repeat", &[channel.into(), node.into(), source.into()])
            }
            Action::RepeatNoMore(channel) => words(f, "repeat-no-more", &[channel.into()]),
            Action::Tick => f.write_str("tick"),
            Action::TickNoMore => f.write_str("tick-no-more"),
            Action::Follow(node, divisor) => words(f, "follow", &[node.into(), divisor.into()]),
            Action::FollowNoMore => f.write_str("follow-no-more"),
            Action::Burst(channel, count, bytes) => {
                words(f, "burst", &[channel.into(), count.into(), bytes.into()])
            }
            Action::Abort(channel, bytes) => words(f, "abort", &[channel.into(), bytes.into()]),
            Action::Serve => f.write_str("serve"),
            Action::Unserve => f.write_str("unserve"),
            Action::Call(node, count, bytes) => words(f, "call", &[node.into(), count.into(), bytes.into()]),
            Action::Write(count) => words(f, "write", &[count.into()]),
            Action::Save => f.write_str("save"),
            Action::Load => f.write_str("load"),
            Action::Watch(node) => words(f, "watch", &[node.into()]),
            Action::Ask => f.write_str("ask"),
            Action::Put(path, version, bytes) => {
                words(f, "put", &[path.into(), version.into(), bytes.into()])
            }
            Action::MakeFolder => f.write_str("make-folder"),
            Action::Shift(from, to) => words(f, "shift", &[from.into(), to.into()]),
            Action::Drop(path) => words(f, "drop", &[path.into()]),
            Action::Fetch(node, path) => words(f, "fetch", &[node.into(), path.into()]),
            Action::Browse(node) => words(f, "browse", &[node.into()]),
            Action::Disk(read, write, sync, kib) => {
                words(f, "disk", &[read.into(), write.into(), sync.into(), kib.into()])
            }
            Action::Rot(at, bytes) => words(f, "rot", &[at.into(), bytes.into()]),
            Action::Slow(bytes) => words(f, "slow", &[bytes.into()]),
            Action::Wild(kind) => write!(f, "wild {}", name_of(&WILDNESSES, &kind)),
            Action::Link(delay, jitter, piece) => {
                words(f, "link", &[delay.into(), jitter.into(), piece.into()])
            }
            Action::Refuse => f.write_str("refuse"),
            Action::Mend => f.write_str("mend"),
            Action::Part(out, back) => words(f, "part", &[out.into(), back.into()]),
            Action::Reset => f.write_str("reset"),
            Action::Die(death) => write!(f, "die {}", name_of(&DEATHS, &death)),
            Action::Stray => f.write_str("stray"),
            Action::Home => f.write_str("home"),
            Action::Late(us) => words(f, "late", &[us.into()]),
            Action::Quit => f.write_str("quit"),
            Action::Start => f.write_str("start"),
        }
    }
}

impl Action {
    pub(crate) fn parse(words: &mut Words<'_>) -> Option<Action> {
        Some(match words.next()? {
            "open" => Action::Open(number(words)?),
            "close" => Action::Close(number(words)?),
            "hear" => Action::Hear(number(words)?, number(words)?, number(words)?),
            "hear-all" => Action::HearAll(number(words)?, number(words)?, number(words)?),
            "unhear" => Action::Unhear(number(words)?, number(words)?),
            "poll" => Action::Poll(number(words)?, number(words)?),
            "by-udp" => Action::ByUdp(number(words)?),
            "lossy" => Action::Lossy(number(words)?, number(words)?, number(words)?),
            "poll-no-more" => Action::PollNoMore(number(words)?, number(words)?),
            "repeat" => Action::Repeat(number(words)?, number(words)?, number(words)?),
            "repeat-no-more" => Action::RepeatNoMore(number(words)?),
            "tick" => Action::Tick,
            "tick-no-more" => Action::TickNoMore,
            "follow" => Action::Follow(number(words)?, number(words)?),
            "follow-no-more" => Action::FollowNoMore,
            "burst" => Action::Burst(number(words)?, number(words)?, number(words)?),
            "abort" => Action::Abort(number(words)?, number(words)?),
            "serve" => Action::Serve,
            "unserve" => Action::Unserve,
            "call" => Action::Call(number(words)?, number(words)?, number(words)?),
            "write" => Action::Write(number(words)?),
            "save" => Action::Save,
            "load" => Action::Load,
            "watch" => Action::Watch(number(words)?),
            "ask" => Action::Ask,
            "put" => Action::Put(number(words)?, number(words)?, number(words)?),
            "make-folder" => Action::MakeFolder,
            "shift" => Action::Shift(number(words)?, number(words)?),
            "drop" => Action::Drop(number(words)?),
            "fetch" => Action::Fetch(number(words)?, number(words)?),
            "browse" => Action::Browse(number(words)?),
            "disk" => Action::Disk(number(words)?, number(words)?, number(words)?, number(words)?),
            "rot" => Action::Rot(number(words)?, number(words)?),
            "slow" => Action::Slow(number(words)?),
            "wild" => Action::Wild(named(&WILDNESSES, words)?),
            "link" => Action::Link(number(words)?, number(words)?, number(words)?),
            "refuse" => Action::Refuse,
            "mend" => Action::Mend,
            "part" => Action::Part(number::<u8>(words)? == 1, number::<u8>(words)? == 1),
            "reset" => Action::Reset,
            "die" => Action::Die(named(&DEATHS, words)?),
            "stray" => Action::Stray,
            "home" => Action::Home,
            "late" => Action::Late(number(words)?),
            "quit" => Action::Quit,
            "start" => Action::Start,
            _ => return None,
        })
    }
}
