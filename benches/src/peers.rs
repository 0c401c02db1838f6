//! Where the programs of the peers are.

use std::path::PathBuf;

/// The folder into which `cargo xtask bench-peers` builds: `bench-peers` below cargo's target folder.
/// `None` if this program does not lie in one.
pub fn folder() -> Option<PathBuf> {
    let me = std::env::current_exe().ok()?;
    // target/PROFILE/deps/NAME
    let deps = me.ancestors().find(|folder| folder.ends_with("deps"))?;
    Some(deps.parent()?.parent()?.join("bench-peers"))
}

/// The program of that name, if it was built.
pub fn program(name: &str) -> Option<PathBuf> {
    folder().map(|folder| folder.join(name)).filter(|program| program.is_file())
}
