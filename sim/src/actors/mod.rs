//! Those who take part in a run.

mod filer;
mod follower;
mod member;
mod plain;
mod poller;
mod scribe;
mod talker;
mod wild;
mod wire;

pub(crate) use filer::Filer;
pub(crate) use follower::Follower;
pub(crate) use member::Member;
pub(crate) use plain::Plain;
pub(crate) use poller::Poller;
pub(crate) use scribe::Scribe;
pub(crate) use talker::{SERVICE, Talker};
pub(crate) use wild::Wild;
