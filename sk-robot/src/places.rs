//! Where a hub keeps its files, and where it is reached.

use sk_core::flow::HubAddress;
use sk_core::world::Storage;
use std::env;
use std::path::{Path, PathBuf};

/// The longest path of a Unix socket that Linux takes, in bytes.
const SOCKET_PATH_BYTES_MAX: usize = 107;

/// The files of one hub. Hubs with different state folders run side by side.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Places {
    state: PathBuf,
}

/// Why no place was found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PlacesError {
    /// No variable says where.
    #[error(
        "no folder for the hub's state: set HOME, XDG_STATE_HOME or SKROBOT_STATE_DIR, or give --state-dir"
    )]
    Nowhere,
    /// The kernel has no room for the socket's path.
    #[error(
        "the path of the hub's socket has {length} bytes, {SOCKET_PATH_BYTES_MAX} are possible: choose a shorter --state-dir than {state}"
    )]
    TooLong {
        /// The path's length in bytes.
        length: usize,
        /// The state folder.
        state: String,
    },
    /// The folder is somebody else's.
    #[error(
        "the state folder {state} belongs to user id {owner} and this hub runs as user id {uid}: choose another --state-dir, or run the hub as its owner"
    )]
    NotOurs {
        /// The state folder.
        state: String,
        /// Whose it is.
        owner: u32,
        /// Who we are.
        uid: u32,
    },
    /// Others could put files of theirs in the place of the hub's.
    #[error(
        "others may write to the state folder {state} (its mode is {mode:03o}): `chmod go-w` it, or choose another --state-dir"
    )]
    Open {
        /// The state folder.
        state: String,
        /// Its permission bits.
        mode: u32,
    },
}

/// The file in which the configuration stands unless told otherwise: `$SKROBOT_CONFIG`, which must exist then; else
/// `skrobot/skrobot.json` in `$XDG_CONFIG_HOME` or `~/.config`. Answers whether it must exist.
pub fn config_file() -> Option<(PathBuf, bool)> {
    if let Some(file) = env::var_os("SKROBOT_CONFIG").filter(|file| !file.is_empty()) {
        return Some((file.into(), true));
    }
    let folder = absolute("XDG_CONFIG_HOME").or_else(|| absolute("HOME").map(|home| home.join(".config")))?;
    Some((folder.join("skrobot/skrobot.json"), false))
}

/// A folder named by a variable; one that is not absolute is as if it were not set.
fn absolute(name: &str) -> Option<PathBuf> {
    env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute())
}

impl Places {
    /// The files below `state`; else below `$SKROBOT_STATE_DIR`, `$XDG_STATE_HOME/skrobot` or
    /// `~/.local/state/skrobot`, the first that is set.
    ///
    /// # Errors
    /// If no variable says where, or the path is too long for a socket.
    pub fn find(state: Option<&Path>) -> Result<Places, PlacesError> {
        let state = match state {
            Some(state) => env::current_dir().map_or_else(|_| state.to_owned(), |here| here.join(state)),
            None => match absolute("SKROBOT_STATE_DIR") {
                Some(state) => state,
                None => absolute("XDG_STATE_HOME")
                    .or_else(|| absolute("HOME").map(|home| home.join(".local/state")))
                    .ok_or(PlacesError::Nowhere)?
                    .join("skrobot"),
            },
        };
        let places = Places { state };
        let length = places.socket().as_os_str().len();
        if length > SOCKET_PATH_BYTES_MAX {
            return Err(PlacesError::TooLong { length, state: places.state.display().to_string() });
        }
        Ok(places)
    }

    /// Refuses a state folder that is there and is not this user's alone: whoever may write to it could put a socket
    /// or a token of his in the place of the hub's.
    ///
    /// # Errors
    /// It belongs to another user, or others may write to it.
    pub fn check_owner(&self, storage: &dyn Storage, uid: u32) -> Result<(), PlacesError> {
        // One that is missing will be made, and is ours then; one that cannot be looked at shows when it is used.
        let Ok((owner, mode)) = storage.owner_and_mode(&self.state) else { return Ok(()) };
        let state = self.state.display().to_string();
        if owner != uid {
            return Err(PlacesError::NotOurs { state, owner, uid });
        }
        if mode & 0o022 != 0 {
            return Err(PlacesError::Open { state, mode: mode & 0o777 });
        }
        Ok(())
    }

    /// The folder of everything; mode 0700.
    pub fn state(&self) -> &Path {
        &self.state
    }

    /// The hub's Unix socket; mode 0600.
    pub fn socket(&self) -> PathBuf {
        self.state.join("hub.sock")
    }

    /// The owner's token; mode 0600.
    pub fn token(&self) -> PathBuf {
        self.state.join("owner.token")
    }

    /// The hub's databases; mode 0600.
    pub fn databases(&self) -> PathBuf {
        self.state.join("databases.redb")
    }

    /// The files of blob channels; mode 0700.
    pub fn blobs(&self) -> PathBuf {
        self.state.join("blobs")
    }

    /// The hub's address for programs of the same user.
    pub fn address(&self) -> HubAddress {
        HubAddress::Unix(self.socket())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_given_folder_wins_and_is_made_absolute() {
        let places = Places::find(Some(Path::new("robot"))).unwrap();
        assert!(places.state().is_absolute() && places.state().ends_with("robot"));
        assert_eq!(places.socket().file_name().unwrap(), "hub.sock");
    }

    #[test]
    fn a_folder_too_deep_for_a_socket_is_refused_with_its_length() {
        let deep = Path::new("/").join("x".repeat(120));
        let error = Places::find(Some(&deep)).unwrap_err();
        assert!(error.to_string().contains("130 bytes"), "{error}");
    }
}
