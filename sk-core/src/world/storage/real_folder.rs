//! A folder of the machine's file system.

use super::real_file::RealFile;
use super::{Found, StoredFile, StoredFolder};
use crate::sys::beneath::{self, Kind};
use std::io;
use std::os::fd::OwnedFd;
use std::path::Path;
use std::sync::Arc;

pub(super) struct RealFolder(OwnedFd);

impl RealFolder {
    pub(super) fn open(path: &Path) -> io::Result<RealFolder> {
        beneath::open_root(path).map(RealFolder)
    }
}

impl StoredFolder for RealFolder {
    fn look(&self, path: &Path) -> io::Result<Found> {
        Ok(match beneath::look(&self.0, path)? {
            Kind::Folder => Found::Folder,
            Kind::File { bytes } => Found::File { bytes },
            Kind::Other => Found::Other,
        })
    }

    fn open(&self, path: &Path) -> io::Result<Arc<dyn StoredFile>> {
        Ok(Arc::new(RealFile::new(beneath::open_file(&self.0, path)?)))
    }

    fn create(&self, path: &Path) -> io::Result<Arc<dyn StoredFile>> {
        Ok(Arc::new(RealFile::new(beneath::create_file(&self.0, path)?)))
    }

    fn create_dir(&self, path: &Path) -> io::Result<()> {
        beneath::create_folder(&self.0, path)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        beneath::rename(&self.0, from, to)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        beneath::remove_file(&self.0, path)
    }

    fn remove_dir(&self, path: &Path) -> io::Result<()> {
        beneath::remove_folder(&self.0, path)
    }

    fn list(&self, path: &Path) -> io::Result<Vec<String>> {
        let mut names = beneath::list(&self.0, path)?;
        names.sort();
        Ok(names)
    }
}
