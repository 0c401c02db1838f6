//! The file of a listening Unix socket: private, cleared of a dead process's left-over, removed at the end.

use crate::sys::unix;
use mio::net::UnixListener;
use std::fs::{self, File};
use std::io;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::os::unix::net;
use std::path::{Path, PathBuf};

/// Removes the socket file when dropped, unless another one has taken its name.
#[derive(Debug)]
pub(super) struct SocketFile {
    path: PathBuf,
    identity: (u64, u64),
}

impl SocketFile {
    /// Listens at `path`. The file of a process that has died is replaced.
    ///
    /// # Errors
    /// `AddrInUse` if a living process listens there, if the name is taken by something that is not a
    /// socket, or if another process is clearing the same folder at this moment.
    pub(super) fn listen(path: &Path) -> io::Result<(UnixListener, SocketFile)> {
        let fd = match unix::listen_private(path) {
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => listen_over_stale(path)?,
            other => other?,
        };
        let identity = identity(path)?;
        let listener = UnixListener::from_std(net::UnixListener::from(fd));
        Ok((listener, SocketFile { path: path.to_owned(), identity }))
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for SocketFile {
    fn drop(&mut self) {
        if identity(&self.path).is_ok_and(|found| found == self.identity) {
            // Nothing is lost if it stays: the next listener recognises it as stale.
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// What tells one file from another that got the same name later.
fn identity(path: &Path) -> io::Result<(u64, u64)> {
    let metadata = fs::symlink_metadata(path)?;
    Ok((metadata.dev(), metadata.ino()))
}

/// Listens at a name that is taken, if what has it is the left-over of a dead process.
fn listen_over_stale(path: &Path) -> io::Result<std::os::fd::OwnedFd> {
    // Two processes that start together would both find the old file dead, and the slower would remove
    // the file of the faster: whoever clears up holds the folder's lock from the look to the new file.
    let folder = path
        .parent()
        .filter(|parent| !parent.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let folder = File::open(folder)?;
    if folder.try_lock().is_err() {
        return Err(taken(path, "another process is clearing it"));
    }
    match fs::symlink_metadata(path) {
        Ok(metadata) if !metadata.file_type().is_socket() => return Err(taken(path, "it is not a socket")),
        Ok(_) => {
            if is_alive(path) {
                return Err(taken(path, "a living process listens there"));
            }
            fs::remove_file(path)?;
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => {}
        Err(error) => return Err(error),
    }
    unix::listen_private(path)
    // The lock ends with the folder's descriptor.
}

/// Whether somebody listens: only a refusal shows that nobody does.
fn is_alive(path: &Path) -> bool {
    match mio::net::UnixStream::connect(path) {
        Ok(_) => true,
        Err(error) => error.kind() != io::ErrorKind::ConnectionRefused,
    }
}

fn taken(path: &Path, why: &str) -> io::Error {
    io::Error::new(io::ErrorKind::AddrInUse, format!("{} is taken: {why}", path.display()))
}
