//! The kernel's files below a root folder.

use crate::SenseError;
use std::borrow::Cow;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// No file that a sense reads is longer. The longest is `/proc/stat`: some 100 KB on machines with hundreds
/// of cores and thousands of interrupts.
pub const FILE_BYTES_MAX: usize = 4 * 1024 * 1024;
/// No folder that a sense lists has more entries; what lies beyond is not looked at. `/proc` is the largest.
pub const FOLDER_ENTRIES_MAX: usize = 1024 * 1024;

/// Where the kernel shows itself: the folder that holds `proc` and `sys`.
///
/// It is `/` on a real machine, the mount point of the host's files inside a container, and a made-up tree in
/// tests. Reading is a plain system call on files that live in memory, so it may happen on a loop; the
/// crate's documentation says what it costs.
///
/// ```
/// use sk_host::{Kernel, Memory, Sense};
/// use sk_flat::Instant;
///
/// let memory = Memory::default().read(&Kernel::default(), Instant::ZERO)?;
/// assert!(memory.is_some_and(|memory| memory.total > 0));
/// # Ok::<(), sk_host::SenseError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Kernel {
    root: PathBuf,
}

impl Default for Kernel {
    fn default() -> Kernel {
        Kernel::at("/")
    }
}

impl Kernel {
    /// The kernel whose `proc` and `sys` are below this folder.
    pub fn at(root: impl Into<PathBuf>) -> Kernel {
        Kernel { root: root.into() }
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The path of a kernel file, given without the leading slash.
    pub fn path(&self, file: &str) -> PathBuf {
        self.root.join(file)
    }

    /// Whether there is such a file or folder.
    pub fn has(&self, file: &str) -> bool {
        self.path(file).exists()
    }

    /// The text of a file, read into `buffer`, whose memory is used again from reading to reading. Bytes that
    /// are no UTF-8 become replacement characters: a device may have any name.
    ///
    /// # Errors
    /// The file cannot be read, or it is longer than [`FILE_BYTES_MAX`].
    pub fn read<'a>(&self, file: &str, buffer: &'a mut Vec<u8>) -> Result<Cow<'a, str>, SenseError> {
        let path = self.path(file);
        buffer.clear();
        let limit = FILE_BYTES_MAX as u64 + 1;
        if let Err(source) = File::open(&path).and_then(|file| file.take(limit).read_to_end(buffer)) {
            return Err(SenseError::Unreadable { path, source });
        }
        if buffer.len() > FILE_BYTES_MAX {
            return Err(SenseError::TooLong { path, bytes_max: FILE_BYTES_MAX });
        }
        Ok(String::from_utf8_lossy(buffer))
    }

    /// The trimmed text of a small file that may be missing or refuse to be read, as many files of devices do
    /// while a device sleeps or goes away.
    pub fn word<'a>(&self, file: &str, buffer: &'a mut Vec<u8>) -> Option<Cow<'a, str>> {
        let text = self.read(file, buffer).ok()?;
        let word = match text {
            Cow::Borrowed(text) => Cow::Borrowed(text.trim()),
            Cow::Owned(text) => Cow::Owned(text.trim().to_owned()),
        };
        (!word.is_empty()).then_some(word)
    }

    /// The names in a folder, `card2` before `card10`; none if there is no such folder.
    ///
    /// # Errors
    /// The folder is there and cannot be read.
    pub fn list(&self, folder: &str) -> Result<Vec<String>, SenseError> {
        let mut names = Vec::new();
        self.each(folder, |name| names.push(name.to_owned()))?;
        names.sort_by(|a, b| natural(a).cmp(&natural(b)).then_with(|| a.cmp(b)));
        Ok(names)
    }

    /// Calls `visit` with each name in a folder, in no order; not at all if there is no such folder. Names
    /// that are no UTF-8 are left out: the path could not be built from them again.
    ///
    /// # Errors
    /// The folder is there and cannot be read.
    pub fn each(&self, folder: &str, mut visit: impl FnMut(&str)) -> Result<(), SenseError> {
        let path = self.path(folder);
        let entries = match fs::read_dir(&path) {
            Ok(entries) => entries,
            Err(source) if source.kind() == io::ErrorKind::NotFound => return Ok(()),
            Err(source) => return Err(SenseError::Unreadable { path, source }),
        };
        for entry in entries.take(FOLDER_ENTRIES_MAX).flatten() {
            if let Some(name) = entry.file_name().to_str() {
                visit(name);
            }
        }
        Ok(())
    }

    /// The error of a file that does not hold what it should.
    pub(crate) fn malformed(&self, file: &str, expected: &'static str) -> SenseError {
        SenseError::Malformed { path: self.path(file), expected }
    }
}

/// A name as its letters before the first digit, and the number there.
fn natural(name: &str) -> (&str, u64) {
    let start = name.find(|c: char| c.is_ascii_digit()).unwrap_or(name.len());
    let digits = &name[start..];
    let end = digits.find(|c: char| !c.is_ascii_digit()).unwrap_or(digits.len());
    (&name[..start], digits[..end].parse().unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_ordered_by_their_numbers() {
        let mut names = ["hwmon10", "hwmon2", "hwmon", "a99999999999999999999", "hwmon2b"];
        names.sort_by(|a, b| natural(a).cmp(&natural(b)).then_with(|| a.cmp(b)));
        assert_eq!(names, ["a99999999999999999999", "hwmon", "hwmon2", "hwmon2b", "hwmon10"]);
    }

    #[test]
    fn what_is_missing_is_told_apart_from_what_is_broken() {
        let kernel = Kernel::at(env!("CARGO_MANIFEST_DIR"));
        assert_eq!(kernel.list("no/such/folder").unwrap(), Vec::<String>::new());
        assert!(kernel.list("Cargo.toml").is_err());
        assert_eq!(kernel.word("no/such/file", &mut Vec::new()), None);
        let error = kernel.read("no/such/file", &mut Vec::new()).unwrap_err().to_string();
        assert!(error.contains("no/such/file: "), "{error}");
    }

    #[test]
    fn a_file_without_end_is_refused() {
        let error = Kernel::default().read("dev/zero", &mut Vec::new()).unwrap_err();
        assert!(matches!(error, SenseError::TooLong { bytes_max: FILE_BYTES_MAX, .. }), "{error}");
    }
}
