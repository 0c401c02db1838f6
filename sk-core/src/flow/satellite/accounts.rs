//! Login by password, and commands about accounts.

use super::super::error::ProtocolError;
use super::super::scram::{ClientExchange, ClientKeys, Derivation, Password};
use super::super::{Command, Message};
use super::{Credentials, SatelliteCore, SatelliteError, databases::List};
use sk_flat::Name;

/// Whose account, and its password. The keys that were derived for a login serve the next one too.
///
/// ```
/// use sk_core::flow::satellite::{Credentials, PasswordLogin, SatelliteCore, SatelliteEvent};
/// use sk_core::flow::scram::{ClientKeys, Password, ROUNDS_MIN};
/// use sk_core::flow::server::{Origin, ServerCore, Settings};
/// use sk_flat::Instant;
///
/// let settings = Settings { user: "robot".parse()?, token: None, owner_uid: None };
/// let mut hub = ServerCore::new(settings, Instant::ZERO);
/// let keys = ClientKeys::derive(&Password::new("pencil"), [7; 16], ROUNDS_MIN);
/// hub.add_account("ada".parse()?, keys.verifier());
///
/// let connection = hub.open(Origin::Line, [1; 32], Instant::ZERO)?;
/// let login = PasswordLogin::new("ada".parse()?, Password::new("pencil"));
/// let mut ada = SatelliteCore::synchronous(Credentials::Password(login), [2; 32], Instant::ZERO);
/// for _ in 0..3 {
///     while let Some(frame) = ada.take() {
///         hub.accept(connection, frame, Instant::ZERO);
///     }
///     while let Some(frame) = hub.take(connection) {
///         ada.accept(frame, Instant::ZERO)?;
///     }
///     if let Some(derivation) = ada.take_derivation() {
///         ada.derived(&derivation.run())?; // a satellite with a loop lets a worker do this
///     }
/// }
/// assert!(matches!(ada.next_event(), Some(SatelliteEvent::LoggedIn { user, .. }) if user == "ada"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct PasswordLogin {
    user: Name,
    password: Password,
    keys: Option<ClientKeys>,
}

impl PasswordLogin {
    /// A login to this account.
    pub fn new(user: Name, password: Password) -> PasswordLogin {
        PasswordLogin { user, password, keys: None }
    }

    pub(super) fn user(&self) -> &Name {
        &self.user
    }

    /// Keeps keys for later logins.
    pub fn keep(&mut self, keys: ClientKeys) {
        self.keys = Some(keys);
    }
}

/// One account of a list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AccountInfo {
    /// Its name.
    pub name: String,
    /// How many connections are logged in to it.
    pub connections: u32,
}

/// The lines of the table that are about accounts.
const ACCOUNT_COMMANDS: std::ops::RangeInclusive<u8> = 0x60..=0x62;

impl SatelliteCore {
    /// Sends a command about accounts: `UserSet`, `UserRemove` or `UserList`. What answers has its tag.
    ///
    /// # Errors
    /// If it is another command, the connection is not ready, or too much waits.
    pub fn account(&mut self, command: &Command) -> Result<u32, SatelliteError> {
        let line = command.definition();
        if !ACCOUNT_COMMANDS.contains(&line.id) || !self.is_ready() {
            return Err(SatelliteError::State(line.name));
        }
        let tag = self.command(command)?;
        if let Command::UserList {} = command {
            self.lists.insert(tag, List::Accounts(Vec::new()));
        }
        Ok(tag)
    }

    /// The first message of a login by password.
    pub(super) fn begin_scram(&mut self, user: &Name) -> Command {
        let exchange = ClientExchange::new(user.as_str(), &self.nonce).bound_to(self.binding);
        let message = exchange.first();
        self.scram = Some(exchange);
        Command::LoginScram { message }
    }

    pub(super) fn on_challenge(&mut self, message: &str) -> Result<(), ProtocolError> {
        let (Credentials::Password(login), Some(exchange)) = (&self.credentials, &mut self.scram) else {
            return Err(ProtocolError::FalseHub);
        };
        let derivation = exchange
            .challenged(message, login.password.clone())
            .map_err(ProtocolError::Scram)?;
        match login.keys.clone().filter(|keys| derivation.is_done_by(keys)) {
            Some(keys) => self.derived(&keys),
            None => {
                self.derivation = Some(derivation);
                Ok(())
            }
        }
    }

    /// What is to be derived from the password for this login, once. It takes milliseconds: a worker does it, and
    /// gives the outcome to [`derived`](SatelliteCore::derived).
    pub fn take_derivation(&mut self) -> Option<Derivation> {
        self.derivation.take()
    }

    /// Goes on with the login.
    ///
    /// # Errors
    /// If the hub's challenge was none, or no login by password is under way.
    pub fn derived(&mut self, keys: &ClientKeys) -> Result<(), ProtocolError> {
        let exchange = self.scram.as_mut().ok_or(ProtocolError::FalseHub)?;
        let message = exchange.last(keys).map_err(ProtocolError::Scram)?;
        self.send(&Command::LoginScramProof { message });
        Ok(())
    }
}
