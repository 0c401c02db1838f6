//! Keeping the process in memory.

use nix::sys::mman::{MlockAllFlags, mlockall};
use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit};
use std::io;

/// The bit of CAP_IPC_LOCK in a capability set.
const CAP_IPC_LOCK: u32 = 14;

/// Locks every page the process has and will have into memory, so that no page fault delays a tick.
///
/// Needs CAP_IPC_LOCK or an unlimited RLIMIT_MEMLOCK.
///
/// # Errors
/// `PermissionDenied` without that privilege, although the kernel would accept the call below a finite
/// limit: later allocations beyond the limit would then fail, and a failed allocation aborts.
pub(crate) fn lock_all() -> io::Result<()> {
    let (limit, _) = getrlimit(Resource::RLIMIT_MEMLOCK)?;
    if limit != RLIM_INFINITY && !may_lock() {
        let why = format!("locking memory needs CAP_IPC_LOCK; the limit is {limit} bytes");
        return Err(io::Error::new(io::ErrorKind::PermissionDenied, why));
    }
    Ok(mlockall(MlockAllFlags::MCL_CURRENT | MlockAllFlags::MCL_FUTURE)?)
}

/// Whether the calling thread holds CAP_IPC_LOCK; no, if that cannot be learnt.
fn may_lock() -> bool {
    let status = std::fs::read_to_string("/proc/thread-self/status").unwrap_or_default();
    let effective = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    let effective = effective.and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok());
    effective.is_some_and(|set| set & (1 << CAP_IPC_LOCK) != 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nix::sys::mman::munlockall;

    #[test]
    fn locked_memory_shows_in_the_status_or_the_refusal_is_told() {
        match lock_all() {
            Ok(()) => {
                let status = std::fs::read_to_string("/proc/self/status").unwrap();
                munlockall().unwrap();
                let locked = status.lines().find_map(|line| line.strip_prefix("VmLck:")).unwrap();
                assert_ne!(locked.trim(), "0 kB");
            }
            Err(refused) => assert_eq!(refused.kind(), io::ErrorKind::PermissionDenied),
        }
    }
}
