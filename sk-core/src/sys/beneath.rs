//! Files below an open folder, reached without following symbolic links, so that no path leads out of it.

use nix::dir::Dir;
use nix::errno::Errno;
use nix::fcntl::{AtFlags, OFlag, OpenHow, ResolveFlag, openat, openat2, renameat};
use nix::sys::stat::{FileStat, Mode, SFlag, fstat, fstatat, mkdirat};
use nix::unistd::{UnlinkatFlags, unlinkat};
use std::ffi::OsStr;
use std::fs::File;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::path::{Component, Path};

/// Owner only, as everything of a robot's.
const FILE_MODE: Mode = Mode::S_IRUSR.union(Mode::S_IWUSR);
const FOLDER_MODE: Mode = Mode::S_IRWXU;

/// What stands at a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Folder,
    File { bytes: u64 },
    Other,
}

fn kind_of(stat: &FileStat) -> Kind {
    match SFlag::from_bits_truncate(stat.st_mode) & SFlag::S_IFMT {
        SFlag::S_IFDIR => Kind::Folder,
        SFlag::S_IFREG => Kind::File { bytes: u64::try_from(stat.st_size).unwrap_or(0) },
        _ => Kind::Other,
    }
}

/// Opens a folder whose own name is not a symbolic link.
pub(crate) fn open_root(path: &Path) -> io::Result<OwnedFd> {
    let fd = nix::fcntl::open(path, folder_flags(), Mode::empty())?;
    Ok(fd)
}

fn folder_flags() -> OFlag {
    OFlag::O_RDONLY | OFlag::O_DIRECTORY | OFlag::O_NOFOLLOW | OFlag::O_CLOEXEC
}

/// Opens the folder at `path` below `root`; the empty path is `root` itself.
pub(crate) fn open_folder(root: &OwnedFd, path: &Path) -> io::Result<OwnedFd> {
    refuse_leaving(path)?;
    let here = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    let resolve =
        ResolveFlag::RESOLVE_BENEATH | ResolveFlag::RESOLVE_NO_SYMLINKS | ResolveFlag::RESOLVE_NO_MAGICLINKS;
    match openat2(root, here, OpenHow::new().flags(folder_flags()).resolve(resolve)) {
        Ok(fd) => Ok(fd),
        // A kernel or a sandbox that does not know the call. EAGAIN is a race with a rename elsewhere.
        Err(Errno::ENOSYS | Errno::EPERM | Errno::EAGAIN) => step_by_step(root, path),
        Err(error) => Err(not_followed(error)),
    }
}

/// The same with calls that every kernel has: one folder after the other.
pub(crate) fn step_by_step(root: &OwnedFd, path: &Path) -> io::Result<OwnedFd> {
    refuse_leaving(path)?;
    let mut folder = openat(root, ".", folder_flags(), Mode::empty())?;
    for step in path.components() {
        folder = openat(&folder, step.as_os_str(), folder_flags(), Mode::empty()).map_err(not_followed)?;
    }
    Ok(folder)
}

/// A symbolic link on the way is as if a file stood where a folder is needed.
fn not_followed(error: Errno) -> io::Error {
    match error {
        Errno::ELOOP | Errno::EXDEV => io::ErrorKind::NotADirectory.into(),
        other => other.into(),
    }
}

fn refuse_leaving(path: &Path) -> io::Result<()> {
    if path.components().all(|part| matches!(part, Component::Normal(_))) {
        Ok(())
    } else {
        Err(io::Error::new(io::ErrorKind::InvalidInput, "a path below a folder has only names"))
    }
}

/// The folder that a name stands in, and the name.
fn parent<'a>(root: &OwnedFd, path: &'a Path) -> io::Result<(OwnedFd, &'a OsStr)> {
    refuse_leaving(path)?;
    let name = path.file_name().ok_or(io::ErrorKind::InvalidInput)?;
    Ok((open_folder(root, path.parent().unwrap_or(Path::new("")))?, name))
}

fn look_in(folder: BorrowedFd<'_>, name: &OsStr) -> io::Result<Kind> {
    Ok(kind_of(&fstatat(folder, name, AtFlags::AT_SYMLINK_NOFOLLOW)?))
}

/// What stands at `path`.
pub(crate) fn look(root: &OwnedFd, path: &Path) -> io::Result<Kind> {
    if path.as_os_str().is_empty() {
        return Ok(kind_of(&fstat(root)?));
    }
    let (folder, name) = parent(root, path)?;
    look_in(folder.as_fd(), name)
}

/// Opens a regular file for reading and writing.
///
/// # Errors
/// `IsADirectory` for a folder, `InvalidInput` for what is neither.
pub(crate) fn open_file(root: &OwnedFd, path: &Path) -> io::Result<File> {
    let (folder, name) = parent(root, path)?;
    let refuse = |kind| match kind {
        Kind::File { .. } => Ok(()),
        Kind::Folder => Err(io::Error::from(io::ErrorKind::IsADirectory)),
        Kind::Other => Err(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file")),
    };
    // The opening alone of a device can do something.
    refuse(look_in(folder.as_fd(), name)?)?;
    let flags = OFlag::O_RDWR | OFlag::O_NOFOLLOW | OFlag::O_NONBLOCK | OFlag::O_NOCTTY | OFlag::O_CLOEXEC;
    let file = openat(&folder, name, flags, Mode::empty()).map_err(|error| match error {
        Errno::ELOOP => io::Error::new(io::ErrorKind::InvalidInput, "not a regular file"),
        other => other.into(),
    })?;
    // It may have been replaced since it was looked at.
    refuse(kind_of(&fstat(&file)?))?;
    Ok(File::from(file))
}

/// Makes a file that was not there.
pub(crate) fn create_file(root: &OwnedFd, path: &Path) -> io::Result<File> {
    let (folder, name) = parent(root, path)?;
    let flags = OFlag::O_RDWR | OFlag::O_CREAT | OFlag::O_EXCL | OFlag::O_NOFOLLOW | OFlag::O_CLOEXEC;
    let file = openat(&folder, name, flags, FILE_MODE)?;
    sync(folder)?;
    Ok(File::from(file))
}

/// Makes a folder that was not there.
pub(crate) fn create_folder(root: &OwnedFd, path: &Path) -> io::Result<()> {
    let (folder, name) = parent(root, path)?;
    mkdirat(&folder, name, FOLDER_MODE)?;
    sync(folder)
}

/// Renames, over a file that is there.
pub(crate) fn rename(root: &OwnedFd, from: &Path, to: &Path) -> io::Result<()> {
    let (old_folder, old_name) = parent(root, from)?;
    let (new_folder, new_name) = parent(root, to)?;
    renameat(&old_folder, old_name, &new_folder, new_name)?;
    sync(new_folder)?;
    sync(old_folder)
}

/// Removes a name that is not a folder's.
pub(crate) fn remove_file(root: &OwnedFd, path: &Path) -> io::Result<()> {
    let (folder, name) = parent(root, path)?;
    unlinkat(&folder, name, UnlinkatFlags::NoRemoveDir)?;
    sync(folder)
}

/// Removes an empty folder.
pub(crate) fn remove_folder(root: &OwnedFd, path: &Path) -> io::Result<()> {
    let (folder, name) = parent(root, path)?;
    unlinkat(&folder, name, UnlinkatFlags::RemoveDir)?;
    sync(folder)
}

/// The names in a folder, in no order; those that are not UTF-8 are left out.
pub(crate) fn list(root: &OwnedFd, path: &Path) -> io::Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in Dir::from_fd(open_folder(root, path)?)? {
        let entry = entry?;
        let name = OsStr::from_bytes(entry.file_name().to_bytes());
        if let Some(name) = name.to_str().filter(|name| *name != "." && *name != "..") {
            names.push(name.to_owned());
        }
    }
    Ok(names)
}

/// Makes the names in a folder durable.
fn sync(folder: OwnedFd) -> io::Result<()> {
    File::from(folder).sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn one_call_and_step_by_step_agree_on_what_leads_out() {
        let place = std::env::temp_dir().join(format!("sk-beneath-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&place);
        std::fs::create_dir_all(place.join("inside/deep")).expect("a folder");
        std::fs::create_dir_all(place.join("outside")).expect("a folder");
        symlink("../outside", place.join("inside/link")).expect("a link");
        symlink("deep", place.join("inside/near")).expect("a link");
        let root = open_root(&place.join("inside")).expect("a folder");
        assert!(open_root(&place.join("inside/near")).is_err(), "the root itself may be no link");
        for (path, leads_somewhere) in [
            ("", true),
            ("deep", true),
            ("link", false),
            ("near", false),
            ("..", false),
            ("deep/..", false),
            ("../outside", false),
            ("/", false),
            ("missing", false),
        ] {
            let path = Path::new(path);
            assert_eq!(open_folder(&root, path).is_ok(), leads_somewhere, "{path:?} in one call");
            assert_eq!(step_by_step(&root, path).is_ok(), leads_somewhere, "{path:?} step by step");
        }
        std::fs::remove_dir_all(&place).expect("it was ours");
    }
}
