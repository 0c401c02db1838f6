//! `docs/coverage.md` cannot lie: what it names as proof is really there.
//!
//! A row is `| S6 | meaning | shown by |`. The last cell names tests, files or commands in backticks, or it
//! begins with a dash while nothing shows the line yet. After the dash it may say, without backticks, the
//! name the test will have; when a test of that name appears, the row has to be completed.

use super::source::Source;
use super::{Violation, tree::Tree};
use crate::test::examples;
use std::collections::BTreeSet;

const PAGE: &str = "docs/coverage.md";
/// The lines the page covers so far, all of them. Of those beyond it stand some, in order.
const LAST_LINE: usize = 65;
/// What begins the last cell of a line that nothing shows yet.
const NOT_YET: char = '—';

/// The page has each line once, in order, with a meaning.
pub(super) fn every_line_is_there(tree: &Tree<'_>) -> Vec<Violation> {
    let Some(page) = tree.text(PAGE) else {
        return vec![Violation::new(PAGE, 0, "the page is missing; it says which promise is shown by what")];
    };
    let mut found = Vec::new();
    let mut expected = 1;
    for row in rows(page) {
        let is_next = if expected <= LAST_LINE { row.number == expected } else { row.number >= expected };
        if !is_next {
            found.push(Violation::new(PAGE, row.line, format!("S{expected} should stand here")));
        }
        if row.meaning.is_empty() || row.shown_by.is_empty() {
            let what = format!("S{} needs a meaning, and what shows it or `{NOT_YET}`", row.number);
            found.push(Violation::new(PAGE, row.line, what));
        }
        expected = row.number + 1;
    }
    if expected <= LAST_LINE {
        found.push(Violation::new(PAGE, 0, format!("the rows from S{expected} to S{LAST_LINE} are missing")));
    }
    found
}

/// Every test and file the page names exists, and no test that exists is still called missing.
pub(super) fn what_is_named_exists(tree: &Tree<'_>) -> Vec<Violation> {
    let tests = tests(tree);
    let mut found = Vec::new();
    for row in tree.text(PAGE).map(rows).unwrap_or_default() {
        if row.shown_by.starts_with(NOT_YET) {
            for name in row.shown_by.split(|c: char| !c.is_alphanumeric() && c != '_') {
                if !name.is_empty() && tests.contains(name) {
                    let what = format!("S{} is shown by now: replace the dash by `{name}`", row.number);
                    found.push(Violation::new(PAGE, row.line, what));
                }
            }
            continue;
        }
        let named: Vec<&str> = row.shown_by.split('`').skip(1).step_by(2).collect();
        if named.is_empty() {
            let what = format!("S{} names nothing in backticks that shows it", row.number);
            found.push(Violation::new(PAGE, row.line, what));
        }
        for name in named.into_iter().filter(|name| !exists(tree, &tests, name)) {
            let what =
                format!("S{} is shown by `{name}`, which is neither a test nor a file here", row.number);
            found.push(Violation::new(PAGE, row.line, what));
        }
    }
    found
}

/// An example that does not run by itself names a test that runs it.
pub(super) fn examples_name_the_test_that_runs_them(tree: &Tree<'_>) -> Vec<Violation> {
    let tests = tests(tree);
    let mut found = Vec::new();
    for (name, source) in tree.rust().filter(|(name, _)| name.starts_with("examples/")) {
        if let Some(test) = examples::run_by(&source.text).filter(|test| !tests.contains(*test)) {
            found.push(Violation::new(
                name,
                1,
                format!("no test is called `{test}`; name the one that runs this"),
            ));
        }
    }
    found
}

struct Row<'a> {
    line: usize,
    number: usize,
    meaning: &'a str,
    shown_by: &'a str,
}

fn rows(page: &str) -> Vec<Row<'_>> {
    page.lines()
        .enumerate()
        .filter_map(|(index, line)| row_of(index + 1, line))
        .collect()
}

fn row_of(line: usize, text: &str) -> Option<Row<'_>> {
    let mut cells = text.trim().strip_prefix('|')?.strip_suffix('|')?.split('|').map(str::trim);
    let number = cells.next()?.strip_prefix('S')?.parse().ok()?;
    Some(Row { line, number, meaning: cells.next()?, shown_by: cells.next()? })
}

fn exists(tree: &Tree<'_>, tests: &BTreeSet<&str>, name: &str) -> bool {
    let is_command = name.starts_with("cargo ");
    is_command || tests.contains(name.rsplit("::").next().unwrap_or(name)) || tree.holds(name)
}

/// The names of all functions marked as tests, and of Python's.
fn tests<'a>(tree: &'a Tree<'_>) -> BTreeSet<&'a str> {
    let mut names: BTreeSet<&str> = tree.rust().flat_map(|(_, source)| tests_of(source)).collect();
    for (_, text) in tree.files().filter(|(name, _)| name.ends_with(".py")) {
        let functions = text.lines().filter_map(|line| line.trim_start().strip_prefix("def "));
        let names_of = functions.filter_map(|rest| rest.split('(').next());
        names.extend(names_of.filter(|name| name.starts_with("test_")));
    }
    names
}

fn tests_of(source: &Source) -> Vec<&str> {
    let mut names = Vec::new();
    let mut marked = false;
    for (_, line) in source.lines() {
        marked |= line.contains("#[test]");
        if marked && let Some((_, rest)) = line.split_once("fn ") {
            names.extend(rest.split(|c: char| !c.is_alphanumeric() && c != '_').next());
            marked = false;
        }
    }
    names
}

#[cfg(test)]
mod tests {
    use super::super::tree::broken;
    use super::*;
    use crate::workspace::Workspace;

    const TESTS: &str = "#[test]\nfn s01_names_are_kept() {}\nfn s02_not_a_test() {}\n";

    fn found(rule: super::super::Rule, page: &str) -> Vec<String> {
        broken(
            rule,
            &Workspace::default(),
            &[("docs/coverage.md", page), ("sk-flat/tests/names.rs", TESTS)],
        )
    }

    #[test]
    fn a_row_that_is_missing_or_empty_is_found() {
        let mut page: String = (1..=64).map(|number| format!("| S{number} | meaning | — |\n")).collect();
        assert_eq!(
            found(every_line_is_there, &page),
            ["docs/coverage.md: the rows from S65 to S65 are missing"]
        );
        let later = format!("{page}| S65 | meaning | — |\n| S109 | meaning | — |\n| S132 | meaning | — |\n");
        assert_eq!(found(every_line_is_there, &later), Vec::<String>::new());
        let back = format!("{later}| S110 | meaning | — |\n");
        assert_eq!(found(every_line_is_there, &back).len(), 1);
        page.push_str("| S66 | | — |\n");
        assert_eq!(found(every_line_is_there, &page).len(), 2);
        assert_eq!(broken(every_line_is_there, &Workspace::default(), &[]).len(), 1);
    }

    #[test]
    fn proof_that_does_not_exist_is_found() {
        let honest = "| S1 | names | `s01_names_are_kept`, `sk-flat/tests/names.rs`, `cargo xtask tidy` |\n\
                      | S2 | later | — s02_containers_carry_a_name |\n";
        assert_eq!(found(what_is_named_exists, honest), Vec::<String>::new());
        let lying =
            "| S1 | names | `s01_gone`, `s02_not_a_test`, `sk-flat/gone.rs` |\n| S2 | words | trust me |\n";
        let lies = found(what_is_named_exists, lying);
        assert_eq!(lies.len(), 4, "{lies:?}");
        assert!(lies[0].contains("`s01_gone`, which is neither a test nor a file here"));
    }

    #[test]
    fn a_row_that_could_be_completed_is_found() {
        let late = found(what_is_named_exists, "| S1 | names | — s01_names_are_kept |\n");
        assert_eq!(
            late,
            ["docs/coverage.md:1: S1 is shown by now: replace the dash by `s01_names_are_kept`"]
        );
    }

    #[test]
    fn an_example_that_nothing_runs_is_found() {
        let files = [
            ("examples/a.rs", "//! Talks.\n//! xtask: run by `gone`\n"),
            ("examples/b.rs", "//! Talks.\n//! xtask: run by `s01_names_are_kept`\n"),
            ("sk-flat/tests/names.rs", TESTS),
        ];
        let found = broken(examples_name_the_test_that_runs_them, &Workspace::default(), &files);
        assert_eq!(found, ["examples/a.rs:1: no test is called `gone`; name the one that runs this"]);
    }
}
