//! The kernel's randomness.
#![allow(unsafe_code)]

use std::io;

/// Fills `bytes` from the kernel's generator; waits only if the machine has just started and has no
/// randomness yet.
pub(crate) fn fill(bytes: &mut [u8]) -> io::Result<()> {
    let mut rest = bytes;
    while !rest.is_empty() {
        // SAFETY: the pointer and the length describe `rest`, a live and exclusively borrowed slice, and
        // the kernel writes at most that many bytes into it.
        let written = unsafe { libc::getrandom(rest.as_mut_ptr().cast(), rest.len(), 0) };
        match usize::try_from(written) {
            Ok(count) => rest = &mut rest[count..],
            Err(_) => {
                let error = io::Error::last_os_error();
                if error.kind() != io::ErrorKind::Interrupted {
                    return Err(error);
                }
            }
        }
    }
    Ok(())
}
