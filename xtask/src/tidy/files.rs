//! The size and the names of files.

use super::{Violation, tree::Tree};

/// Beyond this length a file holds more than one idea.
const LINES_MAX: usize = 600;
/// Names that say nothing about what is inside.
const EMPTY_NAMES: [&str; 4] = ["utils", "helpers", "common", "misc"];

/// No Rust file is longer than a reader can keep in mind.
pub(super) fn are_short(tree: &Tree<'_>) -> Vec<Violation> {
    let long = tree
        .files()
        .filter(|(name, _)| name.ends_with(".rs"))
        .filter_map(|(name, text)| {
            let lines = text.lines().count();
            (lines > LINES_MAX).then(|| {
                let what = format!("{lines} lines, at most {LINES_MAX} are allowed; split the file by idea");
                Violation::new(name, 0, what)
            })
        });
    long.collect()
}

/// No file or folder has a name under which anything could stand.
pub(super) fn have_telling_names(tree: &Tree<'_>) -> Vec<Violation> {
    let is_empty = |part: &str| EMPTY_NAMES.contains(&part.split('.').next().unwrap_or(part));
    let found = tree.files().filter_map(|(name, _)| {
        let part = name.split('/').find(|part| is_empty(part))?;
        let what = format!("the name `{part}` says nothing; name it after the one subject it holds");
        Some(Violation::new(name, 0, what))
    });
    found.collect()
}

#[cfg(test)]
mod tests {
    use super::super::tree::broken;
    use super::*;
    use crate::workspace::Workspace;

    #[test]
    fn a_file_of_601_lines_is_too_long() {
        let (long, short) = ("\n".repeat(601), "\n".repeat(600));
        let files = [("a.rs", long.as_str()), ("b.rs", short.as_str()), ("c.md", long.as_str())];
        let found = broken(are_short, &Workspace::default(), &files);
        assert_eq!(found, ["a.rs: 601 lines, at most 600 are allowed; split the file by idea"]);
    }

    #[test]
    fn a_file_or_folder_for_anything_is_refused() {
        let files = [("src/utils.rs", ""), ("src/common/clock.rs", ""), ("src/uncommon.rs", "")];
        let found = broken(have_telling_names, &Workspace::default(), &files);
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(found[0].starts_with("src/common/clock.rs: the name `common` says nothing"));
    }
}
