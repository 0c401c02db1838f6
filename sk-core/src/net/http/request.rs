//! The head of a request: what was asked, and what of it cannot be.

use thiserror::Error;

/// The longest head of a request, from its first byte to the empty line.
pub const HEAD_BYTES_MAX: usize = 8 * 1024;
/// The most header fields of one request.
pub const HEADERS_MAX: usize = 64;

/// What is asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Method {
    /// The page.
    Get,
    /// The page without its body.
    Head,
    /// Anything else, which is refused.
    Other(String),
}

/// Why a request was not understood.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum RequestError {
    /// The head is longer than [`HEAD_BYTES_MAX`].
    #[error("the head of the request is longer than {HEAD_BYTES_MAX} bytes")]
    TooLong,
    /// There are more fields than [`HEADERS_MAX`].
    #[error("the request has more than {HEADERS_MAX} header fields")]
    TooManyFields,
    /// It is no HTTP.
    #[error("this is no HTTP/1.1 request: {0}")]
    Malformed(&'static str),
    /// It is another version of HTTP.
    #[error("only HTTP/1.1 is spoken here")]
    Version,
    /// A field that may stand once stands twice.
    #[error("the header field {0} stands twice")]
    Twice(&'static str),
    /// It comes with a body.
    #[error("requests with a body are not taken here")]
    Body,
}

impl RequestError {
    /// The status that says so.
    pub fn status(&self) -> u16 {
        match self {
            RequestError::TooLong | RequestError::TooManyFields => 431,
            RequestError::Malformed(_) | RequestError::Twice(_) => 400,
            RequestError::Version => 505,
            RequestError::Body => 413,
        }
    }
}

/// One request.
///
/// ```
/// use sk_core::net::http::{Method, Request};
///
/// let bytes = b"GET /flow?x=1 HTTP/1.1\r\nHost: localhost:4180\r\n\r\nGET";
/// let (request, length) = Request::read(bytes)?.expect("the head is whole");
/// assert_eq!((request.method(), request.path(), request.host()), (&Method::Get, "/flow", "localhost:4180"));
/// assert_eq!(&bytes[length..], b"GET");
/// assert_eq!(Request::read(&bytes[..20])?, None);
/// # Ok::<(), sk_core::net::http::RequestError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    method: Method,
    path: String,
    host: String,
    origin: Option<String>,
    keep_alive: bool,
    fields: Vec<(String, String)>,
}

impl Request {
    /// Reads the request that stands first in `bytes`, with the length of its head; `None` while the head is
    /// not whole.
    ///
    /// # Errors
    /// What cannot become a request any more, whatever follows.
    pub fn read(bytes: &[u8]) -> Result<Option<(Request, usize)>, RequestError> {
        let Some(length) = head_length(bytes)? else { return Ok(None) };
        let mut places = [httparse::EMPTY_HEADER; HEADERS_MAX];
        let mut head = httparse::Request::new(&mut places);
        match head.parse(&bytes[..length]) {
            Ok(httparse::Status::Complete(parsed)) if parsed == length => {}
            Ok(_) => return Err(RequestError::Malformed("the empty line is not where it should be")),
            Err(error) => return Err(parse_error(error)),
        }
        if head.version != Some(1) {
            return Err(RequestError::Version);
        }
        let method = match head.method {
            Some("GET") => Method::Get,
            Some("HEAD") => Method::Head,
            other => Method::Other(other.unwrap_or_default().to_owned()),
        };
        let target = head.path.unwrap_or_default();
        let path = target.split('?').next().unwrap_or_default();
        if !path.starts_with('/') {
            return Err(RequestError::Malformed("the target is no path"));
        }
        let text = |value: &[u8]| String::from_utf8_lossy(value).trim().to_owned();
        let fields: Vec<(String, String)> = head
            .headers
            .iter()
            .map(|field| (field.name.to_ascii_lowercase(), text(field.value)))
            .collect();
        let request = Request {
            method,
            path: path.to_owned(),
            host: once(&fields, "host")?
                .ok_or(RequestError::Malformed("there is no Host"))?
                .to_owned(),
            origin: once(&fields, "origin")?.map(str::to_owned),
            keep_alive: !lists(&fields, "connection", "close"),
            fields,
        };
        request.refuse_body()?;
        Ok(Some((request, length)))
    }

    /// What is asked for.
    pub fn method(&self) -> &Method {
        &self.method
    }

    /// The path, without what follows a question mark and as it came: nothing in it is decoded.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// The host that the client meant, with the port if it named one.
    pub fn host(&self) -> &str {
        &self.host
    }

    /// The page from which a browser asks.
    pub fn origin(&self) -> Option<&str> {
        self.origin.as_deref()
    }

    /// A header field that may stand once only; `name` in small letters.
    ///
    /// # Errors
    /// If it stands twice.
    pub fn field(&self, name: &'static str) -> Result<Option<&str>, RequestError> {
        once(&self.fields, name)
    }

    /// Whether a field that holds a list has that word in it, whatever its case.
    pub fn lists(&self, name: &str, word: &str) -> bool {
        lists(&self.fields, name, word)
    }

    /// Whether the connection is meant to go on after the answer.
    pub fn keeps_alive(&self) -> bool {
        self.keep_alive
    }

    /// A body has a length or comes in chunks. Two opinions about where it ends are how requests are smuggled,
    /// so none is taken at all.
    fn refuse_body(&self) -> Result<(), RequestError> {
        let is_body = |(name, value): &(String, String)| match name.as_str() {
            "transfer-encoding" => true,
            "content-length" => value != "0",
            _ => false,
        };
        if self.fields.iter().any(is_body) { Err(RequestError::Body) } else { Ok(()) }
    }
}

/// The length of the head, its empty line included; `None` while that is not there. What is no text is
/// refused at its first byte and not kept until the limit.
fn head_length(bytes: &[u8]) -> Result<Option<usize>, RequestError> {
    let mut line_is_empty = false;
    for (index, byte) in bytes.iter().enumerate() {
        if index == HEAD_BYTES_MAX {
            return Err(RequestError::TooLong);
        }
        match byte {
            b'\n' if line_is_empty => return Ok(Some(index + 1)),
            b'\n' if index == 0 => return Err(RequestError::Malformed("it begins with an empty line")),
            b'\n' => line_is_empty = true,
            b'\r' => {}
            b'\t' | b' '..=b'~' | 0x80.. => line_is_empty = false,
            _ => return Err(RequestError::Malformed("it has control characters")),
        }
        if index == 0 && !byte.is_ascii_uppercase() {
            return Err(RequestError::Malformed("it does not begin with a method"));
        }
    }
    if bytes.len() >= HEAD_BYTES_MAX { Err(RequestError::TooLong) } else { Ok(None) }
}

fn parse_error(error: httparse::Error) -> RequestError {
    match error {
        httparse::Error::TooManyHeaders => RequestError::TooManyFields,
        httparse::Error::Version => RequestError::Version,
        httparse::Error::HeaderName => RequestError::Malformed("the name of a header field cannot be"),
        httparse::Error::HeaderValue => RequestError::Malformed("the value of a header field cannot be"),
        httparse::Error::NewLine => RequestError::Malformed("a line ends as none may"),
        _ => RequestError::Malformed("the request line cannot be read"),
    }
}

fn once<'a>(fields: &'a [(String, String)], name: &'static str) -> Result<Option<&'a str>, RequestError> {
    let mut values = fields
        .iter()
        .filter(|(field, _)| field == name)
        .map(|(_, value)| value.as_str());
    let first = values.next();
    if values.next().is_some() { Err(RequestError::Twice(name)) } else { Ok(first) }
}

fn lists(fields: &[(String, String)], name: &str, word: &str) -> bool {
    fields
        .iter()
        .filter(|(field, _)| field == name)
        .flat_map(|(_, value)| value.split(','))
        .any(|part| part.trim().eq_ignore_ascii_case(word))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Option<(Request, usize)>, RequestError> {
        Request::read(text.as_bytes())
    }

    #[test]
    fn a_head_is_whole_at_its_empty_line_and_not_before() {
        let text = "GET / HTTP/1.1\r\nHost: a\r\nConnection: Upgrade, close\r\n\r\nrest";
        for cut in 0..text.len() - 4 {
            assert_eq!(read(&text[..cut]), Ok(None), "{cut}");
        }
        let (request, length) = read(text).expect("good").expect("whole");
        assert_eq!(&text[length..], "rest");
        assert!(request.lists("connection", "upgrade") && !request.keeps_alive());
    }

    #[test]
    fn what_is_no_request_is_refused_at_its_first_wrong_byte() {
        for garbage in ["\x16\x03\x01", "\0", "get / HTTP/1.1", "\r\n", "GE\x01"] {
            assert!(matches!(read(garbage), Err(RequestError::Malformed(_))), "{garbage:?}");
        }
        assert_eq!(read("GET / HTTP/2.0\r\n\r\n"), Err(RequestError::Version));
        assert_eq!(read("GET / HTTP/1.0\r\nHost: a\r\n\r\n"), Err(RequestError::Version));
        assert!(matches!(read("GET / HTTP/1.1\r\n\r\n"), Err(RequestError::Malformed("there is no Host"))));
        assert!(matches!(read("GET x HTTP/1.1\r\nHost: a\r\n\r\n"), Err(RequestError::Malformed(_))));
    }

    #[test]
    fn two_hosts_and_bodies_are_refused() {
        assert_eq!(read("GET / HTTP/1.1\r\nHost: a\r\nhost: b\r\n\r\n"), Err(RequestError::Twice("host")));
        for field in ["Content-Length: 1", "Content-Length: x", "Transfer-Encoding: chunked"] {
            let text = format!("POST / HTTP/1.1\r\nHost: a\r\n{field}\r\n\r\n");
            assert_eq!(read(&text), Err(RequestError::Body), "{field}");
        }
        assert!(read("GET / HTTP/1.1\r\nHost: a\r\nContent-Length: 0\r\n\r\n").is_ok());
    }

    #[test]
    fn length_and_number_of_fields_are_limited() {
        let long = format!("GET /{} HTTP/1.1\r\n", "x".repeat(HEAD_BYTES_MAX));
        assert_eq!(read(&long), Err(RequestError::TooLong));
        assert_eq!(read(&long[..HEAD_BYTES_MAX - 1]), Ok(None));
        let fields: String = (0..=HEADERS_MAX).map(|n| format!("a{n}: b\r\n")).collect();
        assert_eq!(read(&format!("GET / HTTP/1.1\r\n{fields}\r\n")), Err(RequestError::TooManyFields));
    }
}
