//! Lines to standard output. A reader that goes away (`| head`) ends the program without a word.

use sk_core::{Cx, SkVariant};
use std::io::{self, ErrorKind, Write};

/// Prints text, and ends the program if nobody reads it any more.
pub fn print(cx: &mut Cx, text: &str) -> Result<(), String> {
    if !write(text.as_bytes())? {
        cx.quit();
    }
    Ok(())
}

/// Writes bytes; `false` if nobody reads them any more.
pub fn write(bytes: &[u8]) -> Result<bool, String> {
    let mut out = io::stdout().lock();
    match out.write_all(bytes).and_then(|()| out.flush()) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
        Err(error) => Err(format!("standard output: {error}")),
    }
}

/// A variant as one line of JSON; a peer's text in it cannot command a terminal.
pub fn json(value: &SkVariant) -> Result<String, String> {
    value
        .to_json()
        .map(|json| safe(&json) + "\n")
        .map_err(|error| error.to_string())
}

/// Text of a peer's with everything escaped that could command a terminal.
pub fn safe(text: &str) -> String {
    let shown = |c: char| {
        !c.is_control() && !('\u{200e}'..='\u{202e}').contains(&c) && !('\u{2066}'..='\u{2069}').contains(&c)
    };
    text.chars()
        .map(|c| if shown(c) { c.to_string() } else { c.escape_unicode().to_string() })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_could_command_a_terminal_is_escaped() {
        assert_eq!(safe("21.5 °C"), "21.5 °C");
        assert_eq!(safe("\u{1b}[2J\n\u{202e}x"), "\\u{1b}[2J\\u{a}\\u{202e}x");
    }
}
