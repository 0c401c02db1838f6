//! `cargo xtask tidy`: the rules of this tree that no compiler knows, one small function each.
//!
//! A rule looks at the [`Tree`] and returns what it found wrong: where, what, and what to do about it. Its
//! unit tests show it a made-up tree that breaks it. Rules read the code with comments and the inside of
//! string literals blanked out, see [`source`].

mod coverage;
mod files;
mod layers;
mod links;
mod manifests;
mod outside;
mod source;
mod tree;
mod unsafety;
mod wording;

use crate::process::Failure;
use crate::workspace::Workspace;
use std::fmt;
use tree::Tree;

/// A rule: what it is called in the tests and how to apply it.
type Rule = fn(&Tree<'_>) -> Vec<Violation>;

const RULES: &[Rule] = &[
    files::are_short,
    files::have_telling_names,
    unsafety::unsafe_stays_below_sys,
    unsafety::every_crate_root_says_so,
    layers::dependencies_point_down,
    layers::only_the_registry_names_modules,
    outside::time_comes_from_the_world,
    outside::randomness_comes_from_the_world,
    outside::libraries_do_not_print,
    outside::queues_are_bounded,
    wording::nothing_is_left_unfinished,
    wording::no_test_is_skipped,
    wording::nothing_names_one_machine,
    manifests::every_crate_says_what_it_is,
    manifests::every_version_stands_once,
    links::lead_somewhere,
    coverage::every_line_is_there,
    coverage::what_is_named_exists,
    coverage::examples_name_the_test_that_runs_them,
];

/// Something that breaks a rule.
#[derive(Debug, PartialEq, Eq)]
struct Violation {
    /// The file, relative to the root.
    file: String,
    /// The line, counted from one; zero means the file as a whole.
    line: usize,
    /// What is wrong, and what to do.
    what: String,
}

impl Violation {
    fn new(file: &str, line: usize, what: impl Into<String>) -> Self {
        Self { file: file.to_owned(), line, what: what.into() }
    }
}

impl fmt::Display for Violation {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => write!(to, "{}: {}", self.file, self.what),
            line => write!(to, "{}:{line}: {}", self.file, self.what),
        }
    }
}

/// Checks the tree of the workspace this program belongs to.
pub(crate) fn run() -> Result<String, Failure> {
    check(&Workspace::load()?)
}

/// Checks the tree of `workspace` and prints what breaks a rule.
pub(crate) fn check(workspace: &Workspace) -> Result<String, Failure> {
    let tree = Tree::load(workspace)?;
    let violations: Vec<Violation> = RULES.iter().flat_map(|rule| rule(&tree)).collect();
    for violation in &violations {
        eprintln!("   {violation}");
    }
    match violations.len() {
        0 => Ok(format!("{} rules hold over {} files", RULES.len(), tree.files().count())),
        1 => Err(Failure::Other("one place breaks a rule of this tree; see above".into())),
        many => Err(Failure::Other(format!("{many} places break a rule of this tree; see above"))),
    }
}
