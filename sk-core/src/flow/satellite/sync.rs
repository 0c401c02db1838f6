//! Sync channels, from both ends: being the source of ticks, and following one.

use super::super::{ChannelKind, ChannelRef, Command, Policy};
use super::{ChannelInfo, SatelliteCore, SatelliteError};
use sk_flat::{Name, SkVariant};

/// Which ticks of a sync channel a target gets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Divisor {
    /// As many as it keeps up with: the hub divides them down while it misses too many, and gives more again when
    /// it has kept up for a while.
    #[default]
    Auto = 0,
    /// Every one, whether it keeps up or not.
    Every = 1,
    /// Every second one.
    Second = 2,
    /// Every fourth one.
    Fourth = 4,
}

impl SatelliteCore {
    /// Asks for a sync channel; `Created` or `Refused` with the tag answers. The property `interval_ns` says the
    /// planned interval of the ticks.
    ///
    /// # Errors
    /// If the name or the properties cannot be, or the connection is no ready flow.
    pub fn create_sync(&mut self, name: &str, properties: &SkVariant) -> Result<u32, SatelliteError> {
        let sync = |name, properties| Command::CreateSync { name, properties };
        self.create_as("create_sync", sync, name, properties)
    }

    /// Sends a tick on a sync channel of one's own. Numbers grow by one from tick to tick. Answers `false`, having
    /// sent nothing, while nobody follows.
    ///
    /// # Errors
    /// If the channel is not one's own, or too much waits to be sent.
    pub fn sync_tick(&mut self, channel: ChannelRef, sequence: u64) -> Result<bool, SatelliteError> {
        let listened = self.own.get(&channel).ok_or(SatelliteError::NotOwn(channel))?.listened;
        if listened {
            self.command(&Command::SyncTick { channel, sequence })?;
        }
        Ok(listened)
    }

    /// Wants the ticks of the sync channel of this full name, now or when it will exist.
    ///
    /// # Errors
    /// If the name cannot be, or the connection is no ready flow.
    pub fn follow(&mut self, name: &str, divisor: Divisor) -> Result<(), SatelliteError> {
        self.need_flow("subscribe")?;
        Name::new(name)?;
        self.followed.insert(name.to_owned(), divisor);
        if let Some(info) = self.channel(name).cloned() {
            self.follow_if_wanted(&info);
        }
        Ok(())
    }

    /// Wants the ticks of a sync channel no more.
    ///
    /// # Errors
    /// If the connection is no ready flow, or too much waits.
    pub fn unfollow(&mut self, name: &str) -> Result<(), SatelliteError> {
        self.need_flow("unsubscribe")?;
        let known = self.channel(name).map(|info| info.channel);
        if let (Some(_), Some(channel)) = (self.followed.remove(name), known) {
            self.command(&Command::Unsubscribe { channel })?;
        }
        Ok(())
    }

    /// Says that the pulse which followed a tick is over.
    ///
    /// # Errors
    /// If the connection is no ready flow, or too much waits.
    pub fn tick_done(&mut self, channel: ChannelRef, sequence: u64) -> Result<(), SatelliteError> {
        self.need_flow("tick_done")?;
        self.command(&Command::TickDone { channel, sequence }).map(|_| ())
    }

    pub(super) fn follow_if_wanted(&mut self, info: &ChannelInfo) {
        if let Some(divisor) = self.followed.get(&info.name).copied()
            && info.kind == ChannelKind::Sync
        {
            let channel = info.channel;
            let divisor = divisor as u8;
            self.send(&Command::Subscribe { channel, policy: Policy::Latest, depth: 1, divisor });
        }
    }
}
