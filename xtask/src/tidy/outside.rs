//! What code may take from outside: time and randomness only from the world that is handed in, nothing
//! printed by libraries, no queue that grows without end.
//!
//! These rules read text, not types, because the lints that could know better cannot tell tests from what
//! is shipped. They catch the honest slip, not somebody who hides.

use super::source::{Source, has_word};
use super::{Violation, tree::Tree};

/// Where the world meets the machine.
const WORLD: [&str; 2] = ["sk-core/src/world/", "sk-core/src/sys/"];
/// What announces that a queue without a bound in its constructor is bounded otherwise.
const BOUNDED_BY: &str = "// bounded by: ";

/// Nobody but the world reads the machine's clocks or sleeps.
pub(super) fn time_comes_from_the_world(tree: &Tree<'_>) -> Vec<Violation> {
    let mut found = Vec::new();
    for (name, source) in shipped_beside_the_world(tree) {
        let clocks = paths_into(source, "std::time::").chain(paths_into(source, "std::{"));
        for (line, path) in clocks {
            if !source.is_test(line) && ["Instant", "SystemTime"].iter().any(|clock| has_word(path, clock)) {
                found.push(Violation::new(name, line, "reads the machine's clock; ask the world's `Clock`"));
            }
        }
        for (line, code) in source.lines_outside_tests() {
            // A path that begins with `std::time::` was judged above.
            let by_import = ["time::Instant::now", "SystemTime::now"];
            let clock = !code.contains("std::time::") && by_import.iter().any(|word| has_word(code, word));
            if clock || has_word(code, "thread::sleep") {
                found.push(Violation::new(
                    name,
                    line,
                    "takes time from the machine; ask the world's `Clock`",
                ));
            }
        }
    }
    found
}

/// Nobody but the world asks the machine for randomness, not even for the seed of a hash map.
pub(super) fn randomness_comes_from_the_world(tree: &Tree<'_>) -> Vec<Violation> {
    let words = ["rand::", "getrandom", "RandomState", "HashMap::new(", "HashSet::new("];
    let found = shipped_beside_the_world(tree).flat_map(|(name, source)| {
        let lines = source
            .lines_outside_tests()
            .filter(|(_, code)| words.iter().any(|word| begins(code, word)));
        lines.map(|(line, code)| {
            let code = code.trim();
            let what = format!("`{code}` is random anew in each process; seed it from the world's `Rng`");
            Violation::new(name, line, what)
        })
    });
    found.collect()
}

/// Libraries below the hub neither print nor read the environment.
pub(super) fn libraries_do_not_print(tree: &Tree<'_>) -> Vec<Violation> {
    let words = ["println!", "eprintln!", "print!", "eprint!", "std::env", "env::var", "env::args"];
    let mut found = Vec::new();
    for (name, source) in tree.shipped().filter(|(name, _)| is_library_below_the_hub(name)) {
        for (line, code) in source.lines_outside_tests() {
            if let Some(word) = words.iter().find(|word| begins(code, word)) {
                let what = format!("`{word}` in a library; report by `tracing`, a value or a parameter");
                found.push(Violation::new(name, line, what));
            }
        }
    }
    found
}

/// A queue is made with a bound, or says beside its making what bounds it.
pub(super) fn queues_are_bounded(tree: &Tree<'_>) -> Vec<Violation> {
    let words = ["unbounded(", "unbounded::<", "mpsc::channel(", "mpsc::channel::<", "SegQueue::new("];
    let mut found = Vec::new();
    for (name, source) in tree.shipped() {
        for (line, code) in source.lines_outside_tests() {
            if words.iter().any(|word| begins(code, word)) && !says_what_bounds_it(source, line) {
                let what =
                    format!("a queue without a bound; make it bounded, or write `{BOUNDED_BY}…` beside it");
                found.push(Violation::new(name, line, what));
            }
        }
    }
    found
}

fn shipped_beside_the_world<'a>(tree: &'a Tree<'_>) -> impl Iterator<Item = (&'a str, &'a Source)> {
    tree.shipped()
        .filter(|(name, _)| !WORLD.iter().any(|folder| name.starts_with(folder)))
}

fn is_library_below_the_hub(name: &str) -> bool {
    let program = name.ends_with("/main.rs") || name.contains("/src/bin/");
    let below = name.starts_with("sk-flat/") || name.starts_with("sk-core/") || name.starts_with("modules/");
    below && !program
}

/// Whether `word` stands in the line and no longer name ends in it.
fn begins(code: &str, word: &str) -> bool {
    let is_part = |character: char| character.is_alphanumeric() || character == '_';
    code.match_indices(word)
        .any(|(start, _)| !code[..start].chars().next_back().is_some_and(is_part))
}

/// The comment stands on the line itself or in the comment directly above it.
fn says_what_bounds_it(source: &Source, line: usize) -> bool {
    let lines: Vec<&str> = source.text.lines().take(line).collect();
    let Some((own, above)) = lines.split_last() else { return false };
    let comment = above.iter().rev().take_while(|text| text.trim_start().starts_with("//"));
    std::iter::once(own).chain(comment).any(|text| text.contains(BOUNDED_BY))
}

/// The rest of every path that begins with `start`: one segment, or everything in the braces.
fn paths_into<'a>(source: &'a Source, start: &'a str) -> impl Iterator<Item = (usize, &'a str)> {
    source.code.match_indices(start).map(move |(at, _)| {
        let rest = &source.code[at + start.len()..];
        let grouped = start.ends_with('{') || rest.starts_with('{');
        let end = if grouped { rest.find(';') } else { rest.find(|c: char| !c.is_alphanumeric()) };
        (source.line_at(at), &rest[..end.unwrap_or(rest.len())])
    })
}

#[cfg(test)]
mod tests {
    use super::super::tree::broken;
    use super::*;
    use crate::workspace::Workspace;

    fn lines(rule: super::super::Rule, files: &[(&str, &str)]) -> Vec<String> {
        let found = broken(rule, &Workspace::default(), files);
        found
            .iter()
            .map(|text| text.split(": ").next().unwrap_or_default().to_owned())
            .collect()
    }

    #[test]
    fn clocks_and_sleeps_of_the_machine_are_found() {
        let files = [
            ("sk-core/src/world/clock.rs", "use std::time::Instant;"),
            ("sk-core/tests/direct.rs", "std::thread::sleep(x);"),
            (
                "sk-core/src/a.rs",
                "use std::time::Duration;\nuse std::time::{\n    Duration, Instant,\n};\nstd::thread::sleep(std::time::Duration::ZERO);\n\
                 std::time::SystemTime::now();\nuse sk_flat::Instant;\nuse std::{io, time::Instant};\n",
            ),
            ("sk-core/src/b.rs", "#[cfg(test)]\nmod tests {\n    use std::time::Instant;\n}\n"),
        ];
        let found = lines(time_comes_from_the_world, &files);
        assert_eq!(
            found,
            ["sk-core/src/a.rs:2", "sk-core/src/a.rs:6", "sk-core/src/a.rs:8", "sk-core/src/a.rs:5"]
        );
    }

    #[test]
    fn randomness_of_the_machine_is_found() {
        let files = [
            ("sk-core/src/sys/random.rs", "nix::getrandom(x)"),
            (
                "sk-core/src/a.rs",
                "rand::random();\nlet a = FxHashMap::new();\nlet b = HashMap::new();\nbrand::x();\n",
            ),
        ];
        assert_eq!(
            lines(randomness_comes_from_the_world, &files),
            ["sk-core/src/a.rs:1", "sk-core/src/a.rs:3"]
        );
    }

    #[test]
    fn printing_libraries_are_found_and_programs_are_not() {
        let text = "/// println!(\"\")\nfn f() { println!(); }\nstd::env::var(\"A\");\n";
        let files =
            [("sk-flat/src/a.rs", text), ("modules/host/src/main.rs", text), ("sk-robot/src/hub.rs", text)];
        assert_eq!(lines(libraries_do_not_print, &files), ["sk-flat/src/a.rs:2", "sk-flat/src/a.rs:3"]);
    }

    #[test]
    fn a_queue_without_a_bound_or_a_reason_is_found() {
        let text = "let a = unbounded();\nlet b = mpsc::channel::<u8>(); // bounded by: one request a client\n\
                    // bounded by: the number of threads\n// which is fixed\nlet c = unbounded::<u8>();\n\
                    let d = channel::bounded(4);\n";
        assert_eq!(lines(queues_are_bounded, &[("sk-core/src/a.rs", text)]), ["sk-core/src/a.rs:1"]);
    }
}
