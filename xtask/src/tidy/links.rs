//! Links between the pages of this repository.

use super::{Violation, tree::Tree};
use std::path::{Component, Path};

/// Every relative link of a page leads to a file or folder of the tree.
pub(super) fn lead_somewhere(tree: &Tree<'_>) -> Vec<Violation> {
    let mut found = Vec::new();
    for (name, text) in tree.files().filter(|(name, _)| name.ends_with(".md")) {
        let mut in_code = false;
        for (index, line) in text.lines().enumerate() {
            if line.trim_start().starts_with("```") {
                in_code = !in_code;
            }
            for target in targets(line).filter(|target| !in_code && is_relative(target)) {
                let path = target.split(['#', ' ']).next().unwrap_or(target);
                if !resolve(name, path).is_some_and(|path| tree.holds(&path)) {
                    let what = format!("the link to `{target}` leads nowhere; correct or remove it");
                    found.push(Violation::new(name, index + 1, what));
                }
            }
        }
    }
    found
}

/// What stands in the round brackets of `[text](target)`.
fn targets(line: &str) -> impl Iterator<Item = &str> {
    line.split("](").skip(1).filter_map(|rest| rest.split(')').next())
}

/// Paths of Rust items stand in pages that a crate's docs include: rustdoc checks those.
fn is_relative(target: &str) -> bool {
    !target.starts_with('#')
        && !target.contains("::")
        && !target.contains("://")
        && !target.starts_with("mailto:")
}

/// The path from the root of what a page calls `path`; nothing if it leaves the repository.
fn resolve(page: &str, path: &str) -> Option<String> {
    let mut parts: Vec<&str> = page.split('/').collect();
    parts.pop();
    for component in Path::new(path).components() {
        match component {
            Component::ParentDir => drop(parts.pop()?),
            Component::Normal(part) => parts.push(part.to_str()?),
            Component::CurDir => {}
            Component::RootDir | Component::Prefix(_) => return None,
        }
    }
    Some(parts.join("/"))
}

#[cfg(test)]
mod tests {
    use super::super::tree::broken;
    use super::*;
    use crate::workspace::Workspace;

    #[test]
    fn links_into_the_void_are_found() {
        let page = "[a](../README.md) [b](guide/) [c](#here) [d](https://example.org/x)\n[e](gone.md#part)\n\
                    ```\n[f](gone.md)\n```\n[g](../../outside.md)\n";
        let files = [("README.md", ""), ("docs/guide/objects.md", ""), ("docs/index.md", page)];
        let found = broken(lead_somewhere, &Workspace::default(), &files);
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(found[0].starts_with("docs/index.md:2: the link to `gone.md#part`"));
        assert!(found[1].starts_with("docs/index.md:6: the link to `../../outside.md`"));
    }
}
