//! Words that must not be left behind.
//!
//! The words are put together from halves so that this file does not break its own rules.

use super::{Violation, tree::Tree};

/// Marks of unfinished work, as whole words.
const UNFINISHED: [&str; 6] = [
    concat!("TO", "DO"),
    concat!("FIX", "ME"),
    concat!("XX", "X"),
    concat!("HA", "CK"),
    concat!("to", "do!"),
    concat!("unimple", "mented!"),
];

/// How a test or an example in the documentation is left out.
const SKIPPED: [&str; 3] = [concat!("#[ign", "ore"), concat!("```ign", "ore"), concat!("```rust,ign", "ore")];

/// Paths of one machine.
const PATHS: [&str; 3] = [concat!("/wo", "rk/"), concat!("/ro", "ot/"), concat!("/ho", "me/")];

/// Papers that lie on one machine and that a reader of this repository does not have.
const PAPERS: [&str; 6] = [
    concat!("DES", "IGN.md"),
    concat!("HOU", "SE.md"),
    concat!("STA", "CK.md"),
    concat!("REQUIRE", "MENTS.md"),
    concat!("RELIA", "BILITY.md"),
    concat!("FA", "CTS.md"),
];

/// Nothing in the tree says of itself that it is not done.
pub(super) fn nothing_is_left_unfinished(tree: &Tree<'_>) -> Vec<Violation> {
    containing(tree, &UNFINISHED, |word| {
        format!("`{word}`: finish it, or open an issue and take the mark away")
    })
}

/// Every test that is written is run.
pub(super) fn no_test_is_skipped(tree: &Tree<'_>) -> Vec<Violation> {
    let mut found = containing(tree, &SKIPPED, |word| {
        format!("`{word}`: a test that does not run shows nothing; make it run")
    });
    found.retain(|violation| violation.file.ends_with(".rs"));
    found
}

/// The repository means the same on every machine.
pub(super) fn nothing_names_one_machine(tree: &Tree<'_>) -> Vec<Violation> {
    let mut found =
        containing(tree, &PATHS, |word| format!("`{word}`: a path of one machine; make it relative"));
    let papers = |word: &str| format!("`{word}` is not in this repository; say here what it says");
    found.extend(containing(tree, &PAPERS, papers));
    found
}

fn containing(tree: &Tree<'_>, words: &[&str], what: impl Fn(&str) -> String) -> Vec<Violation> {
    let mut found = Vec::new();
    for (name, text) in tree.files() {
        for (index, line) in text.lines().enumerate() {
            if let Some(word) = words.iter().find(|word| stands_alone(line, word)) {
                found.push(Violation::new(name, index + 1, what(word)));
            }
        }
    }
    found
}

/// Whether `word` stands in the line and is not a part of a longer word or path. Only an end that is a
/// letter can be continued.
fn stands_alone(line: &str, word: &str) -> bool {
    let is_part = |character: char| character.is_alphanumeric() || character == '_';
    line.match_indices(word).any(|(start, _)| {
        let before = line[..start].chars().next_back();
        let after = line[start + word.len()..].chars().next();
        let joined_before = !word.starts_with(['#', '`']) && before.is_some_and(|c| is_part(c) || c == '.');
        let joined_after = word.ends_with(char::is_alphabetic) && after.is_some_and(is_part);
        !joined_before && !joined_after
    })
}

#[cfg(test)]
mod tests {
    use super::super::Rule;
    use super::super::tree::broken;
    use super::*;
    use crate::workspace::Workspace;

    fn found(rule: Rule, word: &str) -> usize {
        let text = format!("fine\nbefore {word}\n");
        let found = broken(rule, &Workspace::default(), &[("src/a.rs", &text)]);
        assert!(found.iter().all(|text| text.starts_with("src/a.rs:2: ")), "{found:?}");
        found.len()
    }

    #[test]
    fn every_mark_of_unfinished_work_is_found() {
        assert!(UNFINISHED.iter().all(|word| found(nothing_is_left_unfinished, word) == 1));
        assert_eq!(found(nothing_is_left_unfinished, concat!("XX", "XL")), 0);
    }

    #[test]
    fn every_way_to_skip_a_test_is_found() {
        assert_eq!(found(no_test_is_skipped, concat!("#[ign", "ore]")), 1);
        assert_eq!(found(no_test_is_skipped, concat!("#[ign", "ore = \"slow\"]")), 1);
        assert_eq!(found(no_test_is_skipped, concat!("/// ```ign", "ore")), 1);
        assert_eq!(found(no_test_is_skipped, "/// ```no_run"), 0);
    }

    #[test]
    fn paths_and_papers_of_one_machine_are_found() {
        assert!(
            PATHS
                .iter()
                .all(|word| found(nothing_names_one_machine, &format!("{word}x")) == 1)
        );
        assert!(PAPERS.iter().all(|word| found(nothing_names_one_machine, word) == 1));
        assert_eq!(found(nothing_names_one_machine, concat!("base/wo", "rk/left")), 0);
    }
}
