//! What a server answers to whom: pages, doors for upgrades, and the lists of hosts and origins.

use super::answer::Answer;
use super::request::{Method, Request};
use crate::Cx;
use crate::world::{Endpoint, Stream, Token};
use bytes::Bytes;
use sk_flat::Instant;
use std::collections::BTreeMap;
use std::net::IpAddr;
use std::rc::Rc;

/// Who may talk to an HTTP server.
///
/// A browser sends whatever page it shows to any address, this machine's included. So a request is answered
/// only if the host that it names is one of ours, and, when a page sent it, only if the page came from here
/// too or from an origin that was allowed.
///
/// ```
/// use sk_core::net::http::HttpSettings;
///
/// let settings = HttpSettings::default().allow_host("robot.local").allow_origin("https://lab.example");
/// # let _ = settings;
/// ```
#[derive(Clone, Debug, Default)]
pub struct HttpSettings {
    hosts: Vec<String>,
    origins: Vec<String>,
}

impl HttpSettings {
    /// Answers also to this name of the host, without a port. `localhost`, the loopback's addresses and the
    /// address that the server listens at need not be named.
    pub fn allow_host(mut self, name: &str) -> HttpSettings {
        self.hosts.push(name.to_ascii_lowercase());
        self
    }

    /// Answers also to pages of this origin, `https://lab.example:8080`.
    pub fn allow_origin(mut self, origin: &str) -> HttpSettings {
        self.origins.push(origin.to_ascii_lowercase());
        self
    }

    /// Allows also what other settings allow.
    pub(super) fn join(&mut self, other: HttpSettings) {
        self.hosts.extend(other.hosts);
        self.origins.extend(other.origins);
    }

    fn has_host(&self, host: &str) -> bool {
        let name = without_port(host).trim_end_matches('.').to_ascii_lowercase();
        matches!(name.as_str(), "localhost" | "127.0.0.1" | "[::1]") || self.hosts.contains(&name)
    }

    fn has_origin(&self, origin: &str, host: &str) -> bool {
        let origin = origin.to_ascii_lowercase();
        let page = origin
            .split_once("://")
            .filter(|(scheme, _)| matches!(*scheme, "http" | "https"));
        page.is_some_and(|(_, from)| from.eq_ignore_ascii_case(host)) || self.origins.contains(&origin)
    }
}

/// The host of `host:port`, also of `[::1]:port`.
fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if !port.contains(']') => name,
        _ => host,
    }
}

/// A page that stands in memory.
#[derive(Clone, Debug)]
pub struct Page {
    /// Its media type: `text/html; charset=utf-8`.
    pub kind: &'static str,
    /// What it says.
    pub body: Bytes,
}

/// A connection that has become something else than HTTP. So far that is WebSocket only.
#[cfg_attr(not(feature = "websocket"), expect(dead_code))]
pub(crate) struct Upgraded {
    pub(crate) stream: Box<dyn Stream>,
    pub(crate) token: Token,
    /// What is to be written first: the answer to the request.
    pub(crate) answer: Bytes,
    /// What came after the request.
    pub(crate) leftover: Vec<u8>,
    /// When the connection was made, or its request begun: the time for the login counts from there.
    pub(crate) begun: Instant,
}

/// Takes a connection that has upgraded.
pub(crate) type TakeUpgraded = Rc<dyn Fn(&mut Cx, Upgraded)>;

/// A path at which connections may upgrade.
#[derive(Clone)]
pub(crate) struct Upgrade {
    /// The head that agrees to the upgrade, or the refusal.
    pub(crate) agree: fn(&Request) -> Result<Bytes, Answer>,
    /// Takes the connection.
    pub(crate) take: TakeUpgraded,
}

/// What is to be done with a request.
pub(super) enum Reply {
    Answer(Answer),
    Upgrade { answer: Bytes, take: TakeUpgraded },
}

/// All that a server has to offer.
#[derive(Default)]
pub(super) struct Site {
    pub(super) settings: HttpSettings,
    pub(super) pages: BTreeMap<String, Page>,
    pub(super) upgrades: BTreeMap<String, Upgrade>,
}

impl Site {
    /// The address one listens at is a name of the host too; what reaches every address has none.
    pub(super) fn listens_at(&mut self, at: &Endpoint) {
        let name = match at {
            Endpoint::Ip(at) if at.ip().is_unspecified() => return,
            Endpoint::Ip(at) => match at.ip() {
                IpAddr::V4(ip) => ip.to_string(),
                IpAddr::V6(ip) => format!("[{ip}]"),
            },
            _ => return,
        };
        if !self.settings.hosts.contains(&name) {
            self.settings.hosts.push(name);
        }
    }

    pub(super) fn reply(&self, request: &Request) -> Reply {
        if !self.settings.has_host(request.host()) {
            return Reply::Answer(Answer::words(
                421,
                "This server does not answer to that name. Allow the host in its settings.",
            ));
        }
        if let Some(origin) = request.origin()
            && !self.settings.has_origin(origin, request.host())
        {
            return Reply::Answer(Answer::words(
                403,
                "Pages of other origins are not let in. Allow the origin in the settings.",
            ));
        }
        if let Method::Other(_) = request.method() {
            return Reply::Answer(
                Answer::words(405, "Only GET and HEAD are answered here.").with("Allow", "GET, HEAD"),
            );
        }
        if let Some(upgrade) = self.upgrades.get(request.path()) {
            return match (upgrade.agree)(request) {
                Ok(answer) => Reply::Upgrade { answer, take: upgrade.take.clone() },
                Err(answer) => Reply::Answer(answer),
            };
        }
        match self.pages.get(request.path()) {
            Some(page) => Reply::Answer(Answer::page(page.kind, page.body.clone())),
            None => Reply::Answer(Answer::words(404, "There is no page at this path.")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn site() -> Site {
        let settings = HttpSettings::default().allow_origin("https://lab.example");
        let mut site = Site { settings, ..Site::default() };
        site.pages
            .insert("/".into(), Page { kind: "text/html", body: Bytes::from_static(b"here") });
        site.listens_at(&Endpoint::Ip("192.0.2.7:80".parse().expect("an address")));
        site.listens_at(&Endpoint::Ip("0.0.0.0:80".parse().expect("an address")));
        site
    }

    fn status(first: &str, fields: &str) -> u16 {
        let text = format!("{first} HTTP/1.1\r\n{fields}\r\n");
        let (request, _) = Request::read(text.as_bytes()).expect("good").expect("whole");
        match site().reply(&request) {
            Reply::Answer(answer) => answer.status(),
            Reply::Upgrade { .. } => 101,
        }
    }

    #[test]
    fn t13_only_our_own_names_are_answered() {
        for host in ["localhost", "LOCALHOST:4180", "127.0.0.1:1", "[::1]:4180", "[::1]", "192.0.2.7:80"] {
            assert_eq!(status("GET /", &format!("Host: {host}\r\n")), 200, "{host}");
        }
        for host in ["evil.example", "localhost.evil.example", "127.0.0.1.evil.example:80", "0.0.0.0", "::1"]
        {
            assert_eq!(status("GET /", &format!("Host: {host}\r\n")), 421, "{host}");
        }
    }

    #[test]
    fn t13_pages_of_other_origins_are_not_let_in() {
        for origin in ["http://localhost:80", "https://localhost:80", "https://lab.example"] {
            let fields = format!("Host: localhost:80\r\nOrigin: {origin}\r\n");
            assert_eq!(status("GET /", &fields), 200, "{origin}");
        }
        let others =
            ["null", "http://localhost", "http://localhost:81", "http://evil.example", "file://", ""];
        for origin in others {
            let fields = format!("Host: localhost:80\r\nOrigin: {origin}\r\n");
            assert_eq!(status("GET /", &fields), 403, "{origin}");
        }
    }

    #[test]
    fn unknown_paths_and_methods_have_their_status() {
        assert_eq!(status("GET /nowhere", "Host: localhost\r\n"), 404);
        assert_eq!(status("DELETE /", "Host: localhost\r\n"), 405);
        assert_eq!(status("HEAD /?x=/nowhere", "Host: localhost\r\n"), 200);
    }
}
