//! What is answered, as bytes.

use super::request::{Method, RequestError};
use bytes::Bytes;
use std::fmt::Write as _;

/// An answer: a status, fields and a body.
///
/// ```
/// use sk_core::net::http::Answer;
///
/// let answer = Answer::words(404, "There is no page at /nowhere.");
/// assert_eq!(answer.status(), 404);
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    status: u16,
    kind: &'static str,
    extra: Vec<(&'static str, String)>,
    body: Bytes,
}

impl Answer {
    /// An answer of plain words for a person.
    pub fn words(status: u16, words: &str) -> Answer {
        Answer {
            status,
            kind: "text/plain; charset=utf-8",
            extra: Vec::new(),
            body: Bytes::from(format!("{words}\n")),
        }
    }

    /// A page as it stands.
    pub(super) fn page(kind: &'static str, body: Bytes) -> Answer {
        Answer { status: 200, kind, extra: Vec::new(), body }
    }

    /// With another header field.
    pub fn with(mut self, name: &'static str, value: impl Into<String>) -> Answer {
        self.extra.push((name, value.into()));
        self
    }

    /// The status.
    pub fn status(&self) -> u16 {
        self.status
    }

    /// Head and body for the wire; the body is shared and not copied.
    pub(super) fn encode(&self, method: &Method, keep_alive: bool) -> (Bytes, Bytes) {
        let mut head = format!("HTTP/1.1 {} {}\r\n", self.status, reason(self.status));
        let connection = if keep_alive { "keep-alive" } else { "close" };
        // Writing to a string cannot fail. Nothing here may be framed, guessed at, or fetch from elsewhere.
        let _ = write!(
            head,
            "Content-Type: {}\r\nContent-Length: {}\r\nConnection: {connection}\r\n\
             X-Content-Type-Options: nosniff\r\nCache-Control: no-store\r\n\
             Content-Security-Policy: default-src 'self'; frame-ancestors 'none'\r\n",
            self.kind,
            self.body.len(),
        );
        for (name, value) in &self.extra {
            let _ = write!(head, "{name}: {value}\r\n");
        }
        head.push_str("\r\n");
        let body = if *method == Method::Head { Bytes::new() } else { self.body.clone() };
        (Bytes::from(head), body)
    }
}

impl From<&RequestError> for Answer {
    fn from(error: &RequestError) -> Answer {
        Answer::words(error.status(), &format!("Refused: {error}."))
    }
}

fn reason(status: u16) -> &'static str {
    match status {
        200 => "OK",
        400 => "Bad Request",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        408 => "Request Timeout",
        413 => "Content Too Large",
        421 => "Misdirected Request",
        426 => "Upgrade Required",
        431 => "Request Header Fields Too Large",
        503 => "Service Unavailable",
        505 => "HTTP Version Not Supported",
        _ => "Refused",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_head_is_answered_with_the_length_and_without_the_body() {
        let answer = Answer::words(404, "Nothing.").with("Allow", "GET, HEAD");
        let (head, body) = answer.encode(&Method::Head, false);
        let head = String::from_utf8(head.to_vec()).expect("text");
        assert!(head.starts_with("HTTP/1.1 404 Not Found\r\n"), "{head}");
        assert!(head.contains("Content-Length: 9\r\n") && head.contains("Connection: close\r\n"), "{head}");
        assert!(head.ends_with("Allow: GET, HEAD\r\n\r\n") && body.is_empty(), "{head}");
    }
}
