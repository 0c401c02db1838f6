//! The release build of what users run, and the promise about its size.

use super::Gate;
use crate::process::{self, Failure};

/// The program a user starts.
const PROGRAM: &str = "skrobot";
/// The promise: one file below 15 MB.
const SIZE_MAX_BYTES: u64 = 15_000_000;

/// Builds the default members as a user does and weighs the program.
pub(super) fn build_and_weigh(gate: &mut Gate<'_>) -> Result<String, Failure> {
    process::run(process::cargo().args(["build", "--quiet", "--release"]))?;
    let program = gate.workspace.target.join("release").join(PROGRAM);
    let size = std::fs::metadata(&program)
        .map_err(|error| Failure::file(&program, error))?
        .len();
    within(size)?;
    Ok(format!(
        "{PROGRAM} has {:.1} MB of at most {} MB",
        in_mb(size),
        SIZE_MAX_BYTES / 1_000_000
    ))
}

fn within(size_bytes: u64) -> Result<(), Failure> {
    if size_bytes < SIZE_MAX_BYTES {
        return Ok(());
    }
    let (size, limit) = (in_mb(size_bytes), SIZE_MAX_BYTES / 1_000_000);
    Err(Failure::Other(format!("{PROGRAM} has {size:.1} MB; the promise is less than {limit} MB")))
}

fn in_mb(bytes: u64) -> f64 {
    bytes as f64 / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_size_limit_is_kept_to_the_byte() {
        assert!(within(SIZE_MAX_BYTES - 1).is_ok());
        let failure = within(SIZE_MAX_BYTES).unwrap_err().to_string();
        assert_eq!(failure, "skrobot has 15.0 MB; the promise is less than 15 MB");
    }
}
