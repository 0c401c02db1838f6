//! Where in a JSON text a key or value stands, so that an error can say it.

/// Where an entry of an object begins, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// Its key.
    pub(super) key: usize,
    /// Its value.
    pub(super) value: usize,
}

/// Finds the entry at the end of a path of keys. The text is JSON already, with no key twice; of other text it
/// finds nothing, or anything.
pub(super) fn find(text: &str, path: &[&str]) -> Option<Place> {
    let mut cursor = Cursor { text, at: 0 };
    let mut found = None;
    for wanted in path {
        let place = cursor.entry(wanted)?;
        cursor.at = place.value;
        found = Some(place);
    }
    found
}

/// Line and column of a byte, both counted from 1.
pub(super) fn line_and_column(text: &str, at: usize) -> (usize, usize) {
    let before = text.get(..at).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
}

struct Cursor<'a> {
    text: &'a str,
    at: usize,
}

impl Cursor<'_> {
    fn next(&self) -> Option<u8> {
        self.text.as_bytes().get(self.at).copied()
    }

    fn skip_blanks(&mut self) {
        while self.next().is_some_and(|byte| byte.is_ascii_whitespace()) {
            self.at += 1;
        }
    }

    /// Looks for a key in the object that begins here.
    fn entry(&mut self, wanted: &str) -> Option<Place> {
        self.skip_blanks();
        if self.next() != Some(b'{') {
            return None;
        }
        self.at += 1;
        loop {
            self.skip_blanks();
            let key = self.at;
            if self.next() != Some(b'"') {
                return None;
            }
            self.skip_string();
            let name: Option<String> = serde_json::from_str(self.text.get(key..self.at)?).ok();
            self.skip_blanks();
            // The colon.
            self.at += 1;
            self.skip_blanks();
            if name.as_deref() == Some(wanted) {
                return Some(Place { key, value: self.at });
            }
            self.skip_value();
            self.skip_blanks();
            // The comma, or the end of the object, after which no key comes.
            self.at += 1;
        }
    }

    fn skip_string(&mut self) {
        self.at += 1;
        while let Some(byte) = self.next() {
            self.at += if byte == b'\\' { 2 } else { 1 };
            if byte == b'"' {
                return;
            }
        }
    }

    fn skip_value(&mut self) {
        let mut depth = 0usize;
        while let Some(byte) = self.next() {
            match byte {
                b'"' => {
                    self.skip_string();
                    if depth == 0 {
                        return;
                    }
                    continue;
                }
                b'{' | b'[' => depth += 1,
                b'}' | b']' if depth == 0 => return,
                b'}' | b']' => {
                    depth -= 1;
                    if depth == 0 {
                        self.at += 1;
                        return;
                    }
                }
                b',' if depth == 0 => return,
                _ => {}
            }
            self.at += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "{\n  \"a\": [1, {\"b\": \"}\"}, \"\\\"],\"],\n  \"ü\": {\"b\": {}, \"c\\n\": -1.5e3 , \"d\" : {\"e\": null}}}";

    fn at(path: &[&str]) -> Option<(&'static str, (usize, usize))> {
        let place = find(TEXT, path)?;
        Some((&TEXT[place.value..], line_and_column(TEXT, place.value)))
    }

    #[test]
    fn a_value_is_found_behind_whatever_stands_before_it() {
        assert_eq!(at(&["a"]).map(|(_, place)| place), Some((2, 8)));
        let (text, place) = at(&["ü", "d", "e"]).unwrap();
        assert!(text.starts_with("null"), "{text}");
        assert_eq!(place.0, 3);
        assert!(at(&["ü", "c\n"]).unwrap().0.starts_with("-1.5e3"));
        assert_eq!(line_and_column(TEXT, find(TEXT, &["ü"]).unwrap().key), (3, 3));
    }

    #[test]
    fn what_is_not_there_is_not_found() {
        for path in [&["x"][..], &["ü", "x"], &["a", "b"], &["ü", "b", "x"], &["ü", "c\n", "x"]] {
            assert_eq!(at(path), None, "{path:?}");
        }
        assert_eq!(find("", &["a"]), None);
        assert_eq!(find("{\"a", &["a"]), None);
    }
}
