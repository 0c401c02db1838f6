//! How many descriptors this process may have.

use nix::sys::resource::{Resource, getrlimit};

/// The number that no descriptor of this process reaches; none if that is not known.
pub(crate) fn limit() -> Option<u64> {
    getrlimit(Resource::RLIMIT_NOFILE).ok().map(|(soft, _)| soft)
}
