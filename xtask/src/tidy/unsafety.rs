//! Where `unsafe` may stand.

use super::source::has_word;
use super::{Violation, tree::Tree};

/// The only folder with `unsafe` in it.
const SYS: &str = "sk-core/src/sys/";
/// The package that has this folder: it denies instead of forbidding, so that the folder can allow.
const CORE: &str = "specialk-core";

/// `unsafe` stands only where the system calls are.
pub(super) fn unsafe_stays_below_sys(tree: &Tree<'_>) -> Vec<Violation> {
    let mut found = Vec::new();
    for (name, source) in tree.rust().filter(|(name, _)| !name.starts_with(SYS)) {
        for (line, code) in source.lines().filter(|(_, code)| has_word(code, "unsafe")) {
            let what = format!("`{}`: unsafe code belongs below {SYS}, behind a safe function", code.trim());
            found.push(Violation::new(name, line, what));
        }
    }
    found
}

/// The root of every library and program of ours forbids unsafe code, so that the compiler checks it too.
pub(super) fn every_crate_root_says_so(tree: &Tree<'_>) -> Vec<Violation> {
    let mut found = Vec::new();
    for package in &tree.workspace.members {
        let built = |kind: &str| ["lib", "bin", "proc-macro"].contains(&kind);
        for target in package.targets.iter().filter(|target| built(&target.kind)) {
            let is_core = package.name == CORE && target.kind == "lib";
            let wanted = if is_core { "#![deny(unsafe_code)]" } else { "#![forbid(unsafe_code)]" };
            let name = target.file.to_string_lossy();
            if tree
                .text(&name)
                .is_some_and(|text| !text.lines().any(|line| line.trim() == wanted))
            {
                found.push(Violation::new(&name, 1, format!("the crate's root needs `{wanted}`")));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::tree::broken;
    use super::*;
    use crate::workspace::{Package, Target, Workspace};

    #[test]
    fn unsafe_outside_sys_is_found_also_in_tests() {
        let files = [
            ("sk-core/src/sys/time.rs", "unsafe { read() }"),
            ("sk-core/src/flow.rs", "// unsafe\n#[cfg(test)]\nmod tests { unsafe fn f() {} }"),
        ];
        let found = broken(unsafe_stays_below_sys, &Workspace::default(), &files);
        assert_eq!(found.len(), 1);
        assert!(
            found[0].starts_with("sk-core/src/flow.rs:3: `mod tests { unsafe fn f() {} }`"),
            "{found:?}"
        );
    }

    #[test]
    fn a_root_without_the_attribute_is_found() {
        let root = |kind: &str, file: &str| Target { kind: kind.into(), file: file.into(), name: "x".into() };
        let package = |name: &str, targets| Package { name: name.into(), targets, ..Package::default() };
        let members = vec![
            package(CORE, vec![root("lib", "core.rs")]),
            package("skrobot", vec![root("lib", "lib.rs"), root("bin", "sk.rs"), root("test", "t.rs")]),
        ];
        let workspace = Workspace { members, ..Workspace::default() };
        let files = [
            ("core.rs", "#![deny(unsafe_code)]"),
            ("lib.rs", "#![deny(unsafe_code)]"),
            ("sk.rs", "#![forbid(unsafe_code)]"),
            ("t.rs", ""),
        ];
        let found = broken(every_crate_root_says_so, &workspace, &files);
        assert_eq!(found, ["lib.rs:1: the crate's root needs `#![forbid(unsafe_code)]`"]);
    }
}
