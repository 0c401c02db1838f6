//! The files the rules look at: what git tracks or would track, read once.

use super::source::Source;
use crate::process::{self, Failure};
use crate::workspace::Workspace;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

/// Folders whose code is not what users run: it may read the clock, print and block.
const NOT_SHIPPED: [&str; 5] = ["tests", "benches", "examples", "xtask", "fuzz"];
/// Folders with files of other people, which keep their own habits.
const VENDORED: &str = "vendor";

/// The tree the rules are applied to.
pub(super) struct Tree<'a> {
    pub(super) workspace: &'a Workspace,
    files: BTreeMap<String, File>,
    /// Files and folders that exist only in tests because of how their module is declared.
    test_modules: BTreeSet<String>,
}

struct File {
    text: String,
    source: Option<Source>,
}

impl<'a> Tree<'a> {
    /// Reads every file of the workspace that is text.
    pub(super) fn load(workspace: &'a Workspace) -> Result<Self, Failure> {
        let mut ask = Command::new("git");
        ask.current_dir(&workspace.root).args([
            "ls-files",
            "-z",
            "--cached",
            "--others",
            "--exclude-standard",
        ]);
        let mut files = Vec::new();
        for name in process::read(&mut ask)?.split('\0').filter(|name| !name.is_empty()) {
            // A file that is tracked and deleted, or not text, has nothing the rules could read.
            if let Ok(text) = std::fs::read_to_string(workspace.root.join(name)) {
                files.push((name.to_owned(), text));
            }
        }
        Ok(Self::new(workspace, files))
    }

    /// A tree of the given names and texts.
    pub(super) fn new(workspace: &'a Workspace, files: impl IntoIterator<Item = (String, String)>) -> Self {
        let mut tree = Self { workspace, files: BTreeMap::new(), test_modules: BTreeSet::new() };
        for (name, text) in files {
            let source = name.ends_with(".rs").then(|| Source::new(&text));
            for module in source.iter().flat_map(|source| &source.test_modules) {
                tree.test_modules.insert(format!("{}/{module}", folder_of_modules(&name)));
            }
            tree.files.insert(name, File { text, source });
        }
        tree
    }

    /// All files that are ours, with their text.
    pub(super) fn files(&self) -> impl Iterator<Item = (&str, &str)> {
        let ours = self
            .files
            .iter()
            .filter(|(name, _)| !name.split('/').any(|part| part == VENDORED));
        ours.map(|(name, file)| (name.as_str(), file.text.as_str()))
    }

    /// The text of one file.
    pub(super) fn text(&self, name: &str) -> Option<&str> {
        self.files.get(name).map(|file| file.text.as_str())
    }

    /// Whether a file or folder of that name is in the tree.
    pub(super) fn holds(&self, name: &str) -> bool {
        let name = name.trim_end_matches('/');
        let folder = format!("{name}/");
        name.is_empty() || self.files.keys().any(|file| file == name || file.starts_with(&folder))
    }

    /// All Rust files.
    pub(super) fn rust(&self) -> impl Iterator<Item = (&str, &Source)> {
        self.files
            .iter()
            .filter_map(|(name, file)| Some((name.as_str(), file.source.as_ref()?)))
    }

    /// The Rust files of what users run; tests, benches, examples and tools are left out.
    pub(super) fn shipped(&self) -> impl Iterator<Item = (&str, &Source)> {
        self.rust().filter(|(name, _)| !self.is_for_tests(name))
    }

    fn is_for_tests(&self, name: &str) -> bool {
        let in_folder = name.split('/').any(|part| NOT_SHIPPED.contains(&part));
        let module = name.strip_suffix(".rs").unwrap_or(name);
        let declared = Path::new(module).ancestors().filter_map(Path::to_str);
        in_folder || declared.into_iter().any(|part| self.test_modules.contains(part))
    }
}

/// The folder in which the modules declared in this file are found.
fn folder_of_modules(name: &str) -> String {
    let path = Path::new(name);
    let parent = path.parent().unwrap_or(Path::new(""));
    let stem = path.file_stem().unwrap_or_default();
    let folder = if ["mod", "lib", "main"].iter().any(|root| stem == *root) {
        parent.to_owned()
    } else {
        parent.join(stem)
    };
    folder.to_string_lossy().into_owned()
}

/// Applies a rule to a made-up tree and returns what it finds as text.
#[cfg(test)]
pub(super) fn broken(rule: super::Rule, workspace: &Workspace, files: &[(&str, &str)]) -> Vec<String> {
    let files = files.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned()));
    let tree = Tree::new(workspace, files);
    rule(&tree).iter().map(ToString::to_string).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_modules_declared_for_tests_are_not_shipped() {
        let workspace = Workspace::default();
        let files = [
            ("sk-core/src/lib.rs", "#[cfg(test)]\nmod check;\nmod flow;\n"),
            ("sk-core/src/check.rs", ""),
            ("sk-core/src/flow/mod.rs", "#[cfg(test)]\nmod rounds;\n"),
            ("sk-core/src/flow/rounds/deep.rs", ""),
            ("sk-core/tests/direct.rs", ""),
        ];
        let tree = Tree::new(&workspace, files.map(|(name, text)| (name.to_owned(), text.to_owned())));
        let shipped: Vec<_> = tree.shipped().map(|(name, _)| name).collect();
        assert_eq!(shipped, ["sk-core/src/flow/mod.rs", "sk-core/src/lib.rs"]);
        assert!(tree.holds("sk-core/src/flow") && tree.holds("sk-core/src/check.rs"));
        assert!(!tree.holds("sk-core/src/fl"));
    }
}
