//! The owner's token: made at first start, kept in a file that only the owner can read.

use crate::places::Places;
use sk_core::flow::login::{OwnerToken, TokenError};
use sk_core::world::World;
use std::io::{self, ErrorKind};
use std::path::PathBuf;

/// A token's file is 65 bytes; anything much longer is something else.
const TOKEN_FILE_BYTES_MAX: u64 = 256;

/// Why there is no token.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TokenFileError {
    /// The file system refused.
    #[error("{path}: {error}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What it said.
        #[source]
        error: io::Error,
    },
    /// The folder of the state cannot be made.
    #[error("cannot make the state folder {path}: {error}; choose another --state-dir", path = path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the file system said.
        #[source]
        error: io::Error,
    },
    /// The file is not a token.
    #[error("{path}: {error}; remove the file and restart the hub to get a new token", path = path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        #[source]
        error: TokenError,
    },
    /// Others could have read it.
    #[error("{path} has mode {mode:03o}, so others may have read the token: remove it and restart the hub to get a new one", path = path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// Its permission bits.
        mode: u32,
    },
}

/// Reads the token; `None` if there is no file.
///
/// # Errors
/// If the file cannot be read, is open to others, or is not a token.
pub fn read(world: &World, places: &Places) -> Result<Option<OwnerToken>, TokenFileError> {
    let path = places.token();
    let bytes = match world.storage.read(&path, TOKEN_FILE_BYTES_MAX) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(TokenFileError::Io { path, error }),
    };
    match world.storage.owner_and_mode(&path) {
        Ok((_, mode)) if mode & 0o077 != 0 => return Err(TokenFileError::Open { path, mode: mode & 0o777 }),
        Ok(_) => {}
        Err(error) => return Err(TokenFileError::Io { path, error }),
    }
    let text = String::from_utf8_lossy(&bytes);
    OwnerToken::parse(&text)
        .map(Some)
        .map_err(|error| TokenFileError::Malformed { path, error })
}

/// Reads the token, or makes one. Blocks on the disk: before the loop runs.
///
/// # Errors
/// As [`read`], or if the file cannot be made.
pub fn read_or_make(world: &mut World, places: &Places) -> Result<OwnerToken, TokenFileError> {
    let refused = |path: PathBuf| move |error| TokenFileError::Io { path, error };
    let folder = places.state().to_owned();
    world
        .storage
        .create_dir(&folder)
        .map_err(|error| TokenFileError::Folder { path: folder, error })?;
    if let Some(token) = read(world, places)? {
        return Ok(token);
    }
    let mut bytes = [0; 32];
    world.rng.fill(&mut bytes);
    let token = OwnerToken::new(bytes);
    let path = places.token();
    world
        .storage
        .replace(&path, token.to_file_text().as_bytes())
        .map_err(refused(path))?;
    Ok(token)
}

#[cfg(test)]
mod tests {
    use super::*;
    use sk_core::world::SimulatedWorld;
    use std::path::Path;

    #[test]
    fn the_first_start_makes_a_token_and_the_second_finds_it() {
        let simulation = SimulatedWorld::new(1);
        let places = Places::find(Some(Path::new("/state"))).unwrap();
        let mut world = simulation.world();
        assert!(read(&world, &places).unwrap().is_none());
        let first = read_or_make(&mut world, &places).unwrap();
        let second = read_or_make(&mut simulation.world(), &places).unwrap();
        assert_eq!(first.to_file_text(), second.to_file_text());
    }

    #[test]
    fn a_damaged_token_is_an_error_and_not_replaced() {
        let simulation = SimulatedWorld::new(1);
        let places = Places::find(Some(Path::new("/state"))).unwrap();
        let mut world = simulation.world();
        world.storage.create_dir(places.state()).unwrap();
        world.storage.replace(&places.token(), b"not a token").unwrap();
        let error = read_or_make(&mut world, &places).unwrap_err();
        assert!(error.to_string().contains("remove the file"), "{error}");
    }
}
