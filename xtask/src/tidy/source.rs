//! Rust source as the rules see it: comments and the inside of literals blanked out, tests marked.
//!
//! This is not a parser. It knows just enough of the language to tell code from text and to find the end
//! of an item that only exists in tests; the compiler has already judged everything else.

/// One Rust file.
#[derive(Debug)]
pub(super) struct Source {
    /// The text with every comment and the inside of every literal replaced by blanks, line by line as before.
    pub(super) code: String,
    /// The text as it stands.
    pub(super) text: String,
    /// For each line whether it belongs to an item that exists only in tests.
    tests: Vec<bool>,
    /// The modules kept in files of their own that exist only in tests.
    pub(super) test_modules: Vec<String>,
}

impl Source {
    pub(super) fn new(text: &str) -> Self {
        let code = blank(text);
        let mut source = Self {
            tests: vec![false; code.lines().count()],
            code,
            text: text.to_owned(),
            test_modules: vec![],
        };
        source.mark_tests();
        source
    }

    /// The lines of code with their numbers, those of tests left out.
    pub(super) fn lines_outside_tests(&self) -> impl Iterator<Item = (usize, &str)> {
        self.lines().filter(|(number, _)| !self.is_test(*number))
    }

    /// All lines of code with their numbers.
    pub(super) fn lines(&self) -> impl Iterator<Item = (usize, &str)> {
        self.code.lines().enumerate().map(|(index, line)| (index + 1, line))
    }

    /// Whether that line exists only in tests.
    pub(super) fn is_test(&self, number: usize) -> bool {
        self.tests.get(number - 1).copied().unwrap_or(false)
    }

    /// The number of the line that holds the byte at `offset`.
    pub(super) fn line_at(&self, offset: usize) -> usize {
        self.code.as_bytes()[..offset].iter().filter(|byte| **byte == b'\n').count() + 1
    }

    fn mark_tests(&mut self) {
        for mark in ["#[cfg(test)]", "#[cfg(all(test", "#[test]"] {
            let starts: Vec<usize> = self.code.match_indices(mark).map(|(start, _)| start).collect();
            for start in starts {
                let end = end_of_item(&self.code, start);
                let (first, last) = (self.line_at(start), self.line_at(end.saturating_sub(1)));
                self.tests[first - 1..last].fill(true);
                let item = &self.code[start..end];
                if let Some(name) = item.strip_suffix(';').and_then(|item| item.rsplit_once("mod ")) {
                    self.test_modules.push(name.1.trim().to_owned());
                }
            }
        }
    }
}

/// Whether `name` stands in `line` as a whole word.
pub(super) fn has_word(line: &str, name: &str) -> bool {
    let is_part = |character: char| character.is_alphanumeric() || character == '_';
    line.match_indices(name).any(|(start, _)| {
        let before = line[..start].chars().next_back();
        let after = line[start + name.len()..].chars().next();
        !before.is_some_and(is_part) && !after.is_some_and(is_part)
    })
}

/// Where the item that begins at `start`, attributes included, ends: after its `;` or its closing brace.
fn end_of_item(code: &str, start: usize) -> usize {
    let mut depth = 0usize;
    for (index, byte) in code.bytes().enumerate().skip(start) {
        match byte {
            b'{' | b'(' | b'[' => depth += 1,
            b'}' | b')' | b']' => {
                depth = depth.saturating_sub(1);
                if depth == 0 && byte == b'}' {
                    return index + 1;
                }
            }
            b';' if depth == 0 => return index + 1,
            _ => {}
        }
    }
    code.len()
}

/// Replaces comments and the inside of literals by blanks; newlines and lengths in bytes stay.
fn blank(text: &str) -> String {
    let bytes = text.as_bytes();
    let mut code = bytes.to_vec();
    let mut at = 0;
    while at < bytes.len() {
        let end = end_of_text(bytes, at);
        if end == at {
            at += 1;
            continue;
        }
        for byte in &mut code[at..end] {
            if *byte != b'\n' {
                *byte = b' ';
            }
        }
        at = end;
    }
    // Only whole comments and literals were replaced, so that no character was cut in two.
    String::from_utf8(code).unwrap_or_default()
}

/// Where the comment or literal that begins at `at` ends; `at` itself if none begins there.
fn end_of_text(bytes: &[u8], at: usize) -> usize {
    let rest = &bytes[at..];
    if rest.starts_with(b"//") {
        return at + rest.iter().position(|byte| *byte == b'\n').unwrap_or(rest.len());
    }
    if rest.starts_with(b"/*") {
        return at + end_of_block(rest);
    }
    if rest[0] == b'"' {
        return at + end_of_quoted(rest, b'"');
    }
    let inside_a_name = at > 0 && (bytes[at - 1].is_ascii_alphanumeric() || bytes[at - 1] == b'_');
    if !inside_a_name && let Some(length) = raw_string(rest) {
        return at + length;
    }
    if rest[0] == b'\'' && is_character(rest) {
        return at + end_of_quoted(rest, b'\'');
    }
    at
}

fn end_of_block(rest: &[u8]) -> usize {
    let (mut depth, mut at) = (0usize, 0);
    while at < rest.len() {
        if rest[at..].starts_with(b"/*") {
            depth += 1;
            at += 2;
        } else if rest[at..].starts_with(b"*/") {
            depth -= 1;
            at += 2;
            if depth == 0 {
                return at;
            }
        } else {
            at += 1;
        }
    }
    rest.len()
}

fn end_of_quoted(rest: &[u8], quote: u8) -> usize {
    let mut at = 1;
    while at < rest.len() {
        match rest[at] {
            b'\\' => at += 2,
            byte if byte == quote => return at + 1,
            _ => at += 1,
        }
    }
    rest.len()
}

/// The length of a raw string (`r"…"`, `br#"…"#`), if one begins here.
fn raw_string(rest: &[u8]) -> Option<usize> {
    let prefix = [&b"br"[..], b"cr", b"r"]
        .into_iter()
        .find(|prefix| rest.starts_with(prefix))?
        .len();
    let hashes = rest[prefix..].iter().take_while(|byte| **byte == b'#').count();
    let open = prefix + hashes;
    if rest.get(open) != Some(&b'"') {
        return None;
    }
    let mut close = vec![b'"'];
    close.resize(hashes + 1, b'#');
    let inside = &rest[open + 1..];
    let end = inside.windows(close.len()).position(|window| window == close);
    Some(end.map_or(rest.len(), |end| open + 1 + end + close.len()))
}

/// Tells `'a'` from the lifetime `'a`.
fn is_character(rest: &[u8]) -> bool {
    match rest.get(1) {
        Some(b'\\') => true,
        Some(first) => {
            let width = match first {
                0xf0.. => 4,
                0xe0.. => 3,
                0xc0.. => 2,
                _ => 1,
            };
            rest.get(1 + width) == Some(&b'\'')
        }
        None => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_and_literals_are_blanked_and_lines_stay() {
        let text = "let a = \"x // y\"; // why\n/* one\n/* two */ */ let b = 'c';\nlet d: &'static str = r#\"e\"f\"#;\n";
        let code = blank(text);
        assert_eq!(code.len(), text.len());
        let lines: Vec<_> = code.lines().map(|line| line.split_whitespace().collect::<String>()).collect();
        assert_eq!(lines, ["leta=;", "", "letb=;", "letd:&'staticstr=;"]);
    }

    #[test]
    fn escaped_quotes_and_wide_characters_end_where_they_should() {
        let code = blank("f('\\'', \"\\\"\", 'ü', b'\"', br\"\\\");");
        assert_eq!(code.split_whitespace().collect::<String>(), "f(,,,b,);");
    }

    #[test]
    fn items_of_tests_are_marked_to_their_end() {
        let source = Source::new(
            "fn a() {}\n#[cfg(test)]\nmod tests {\n    fn b() {}\n}\nfn c() {}\n#[cfg(test)]\nmod more;\n",
        );
        let outside: Vec<_> = source.lines_outside_tests().map(|(number, _)| number).collect();
        assert_eq!(outside, [1, 6]);
        assert_eq!(source.test_modules, ["more"]);
    }

    #[test]
    fn words_are_whole() {
        assert!(has_word("pub unsafe fn", "unsafe"));
        assert!(!has_word("unsafe_code", "unsafe"));
        assert!(!has_word("not_unsafe", "unsafe"));
    }
}
