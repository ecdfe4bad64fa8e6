//! Who may see the page: what a request must look like, and what is said to those that do not.
//!
//! A page of the same machine is reachable by every page that its user opens elsewhere. So a request needs the token; a browser's
//! must come from the page itself (`Origin`); and `Host` must be an address or a name that is ours, or a foreign name that was made to
//! resolve to this machine would do (DNS rebinding).

use std::net::IpAddr;

use httparse::{EMPTY_HEADER, Request, Status};

/// A request line and its headers are at most so long, bytes.
pub const HEAD_MAX: usize = 8 << 10;
/// So many headers at most.
const HEADERS_MAX: usize = 48;

/// What is asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Route {
    /// The page.
    Page,
    /// The style sheet of the page.
    Style,
    /// The script of the page.
    Script,
    /// The stream of what is shown, over a WebSocket with this key.
    Socket(String),
}

/// Why a request is not answered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// HTTP status code.
    pub status: u16,
    /// What the reader should know.
    pub text: &'static str,
}

impl Refusal {
    const fn new(status: u16, text: &'static str) -> Self {
        Self { status, text }
    }

    /// The reason phrase of the status.
    #[must_use]
    pub fn reason(&self) -> &'static str {
        match self.status {
            400 => "Bad Request",
            403 => "Forbidden",
            404 => "Not Found",
            405 => "Method Not Allowed",
            408 => "Request Timeout",
            413 => "Content Too Large",
            426 => "Upgrade Required",
            431 => "Request Header Fields Too Large",
            _ => "Service Unavailable",
        }
    }
}

/// A request head that is longer than [`HEAD_MAX`].
pub const TOO_LARGE: Refusal = Refusal::new(431, "the request is too large");
/// A request that did not come in time.
pub const TOO_SLOW: Refusal = Refusal::new(408, "the request did not come in time");
/// One viewer more than is allowed.
pub const TOO_MANY: Refusal = Refusal::new(503, "there are as many viewers as are allowed (live.viewers_max)");

/// What is asked of every request.
#[derive(Debug, Clone)]
pub struct Access {
    /// The word that a request must know.
    pub token: String,
    /// Names of this machine, besides its addresses and `localhost`.
    pub hosts: Vec<String>,
}

impl Access {
    /// What a request head (up to and with its empty line) asks for.
    ///
    /// # Errors
    /// It is no request that is answered here.
    pub fn judge(&self, head: &[u8]) -> Result<Route, Refusal> {
        let mut headers = [EMPTY_HEADER; HEADERS_MAX];
        let mut request = Request::new(&mut headers);
        match request.parse(head) {
            Ok(Status::Complete(_)) => {}
            Err(httparse::Error::TooManyHeaders) => return Err(TOO_LARGE),
            Ok(Status::Partial) | Err(_) => return Err(Refusal::new(400, "this is no HTTP request")),
        }
        let method = request.method.unwrap_or_default();
        let (path, query) =
            request.path.unwrap_or_default().split_once('?').unwrap_or((request.path.unwrap_or(""), ""));
        let headers = Headers(request.headers);
        let host = headers.one("host").ok_or(Refusal::new(400, "a request names its host, once"))?;
        if !self.is_ours(host) {
            return Err(Refusal::new(403, "this host is not ours: an address, localhost, or a name in live.hosts"));
        }
        let is_foreign = |origin: &str| {
            origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://")).is_none_or(|of| of != host)
        };
        if headers.all("origin").any(is_foreign) {
            return Err(Refusal::new(403, "the page of another origin asks"));
        }
        if method != "GET" {
            return Err(Refusal::new(405, "only GET is answered here"));
        }
        if headers.all("content-length").any(|length| length.trim() != "0")
            || headers.one("transfer-encoding").is_some()
        {
            return Err(Refusal::new(413, "a request has no body here"));
        }
        match path {
            "/live.css" => return Ok(Route::Style),
            "/live.js" => return Ok(Route::Script),
            "/" | "/socket" => {}
            _ => return Err(Refusal::new(404, "there is no such page")),
        }
        let token = query.split('&').find_map(|pair| pair.strip_prefix("token="));
        if !token.is_some_and(|token| is_same(token, &self.token)) {
            return Err(Refusal::new(403, "the token is missing or wrong: open the address that echogrid printed"));
        }
        if path == "/" {
            return Ok(Route::Page);
        }
        let upgrades = headers.all("upgrade").any(|word| word.eq_ignore_ascii_case("websocket"))
            && headers
                .all("connection")
                .any(|words| words.split(',').any(|word| word.trim().eq_ignore_ascii_case("upgrade")))
            && headers.one("sec-websocket-version") == Some("13");
        let key = headers.one("sec-websocket-key").filter(|key| upgrades && key.len() == 24);
        key.map(|key| Route::Socket(key.to_owned())).ok_or(Refusal::new(426, "a WebSocket is served here"))
    }

    /// An address can't be made to resolve to another; of names only those that are known to be ours count.
    fn is_ours(&self, host: &str) -> bool {
        let name = match host.strip_prefix('[') {
            Some(rest) => rest.split(']').next().unwrap_or_default(),
            None => host.rsplit_once(':').map_or(host, |(name, _)| name),
        };
        name.parse::<IpAddr>().is_ok()
            || name.eq_ignore_ascii_case("localhost")
            || self.hosts.iter().any(|ours| ours.eq_ignore_ascii_case(name))
    }
}

/// The headers of a request.
struct Headers<'a>(&'a [httparse::Header<'a>]);

impl<'a> Headers<'a> {
    fn all(&self, name: &'static str) -> impl Iterator<Item = &'a str> {
        let named = self.0.iter().filter(move |header| header.name.eq_ignore_ascii_case(name));
        // What is no text is nobody's.
        named.map(|header| std::str::from_utf8(header.value).unwrap_or("\u{fffd}"))
    }

    fn one(&self, name: &'static str) -> Option<&'a str> {
        let mut all = self.all(name);
        all.next().filter(|_| all.next().is_none())
    }
}

/// Takes as long wherever the first difference is.
fn is_same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |differs, (a, b)| differs | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEY: &str = "dGhlIHNhbXBsZSBub25jZQ==";

    fn judge(line: &str, headers: &[&str]) -> Result<Route, u16> {
        let access = Access { token: "secret".into(), hosts: vec!["rover.local".into()] };
        let head = format!("{line} HTTP/1.1\r\n{}\r\n\r\n", headers.join("\r\n"));
        access.judge(head.as_bytes()).map_err(|refusal| refusal.status)
    }

    #[test]
    fn the_page_is_shown_to_who_knows_the_token_under_a_name_of_ours() {
        for host in ["127.0.0.1:80", "[::1]:80", "localhost", "LOCALHOST:1", "192.168.1.7:8750", "rover.local:8750"] {
            assert_eq!(judge("GET /?token=secret", &[&format!("Host: {host}")]), Ok(Route::Page), "{host}");
        }
        assert_eq!(judge("GET /?a=b&token=secret", &["Host: localhost"]), Ok(Route::Page));
        assert_eq!(judge("GET /live.js", &["Host: localhost"]), Ok(Route::Script));
    }

    #[test]
    fn a_wrong_token_host_or_origin_is_refused() {
        for query in ["", "?token=", "?token=secre", "?token=secret1", "?xtoken=secret", "?token=Secret"] {
            assert_eq!(judge(&format!("GET /{query}"), &["Host: localhost"]), Err(403), "{query}");
            assert_eq!(judge(&format!("GET /socket{query}"), &["Host: localhost"]), Err(403), "{query}");
        }
        for host in ["evil.example", "evil.example:8750", "localhost.evil.example", "127.0.0.1.evil.example", ""] {
            assert_eq!(judge("GET /?token=secret", &[&format!("Host: {host}")]), Err(403), "{host}");
        }
        assert_eq!(judge("GET /?token=secret", &["Host: localhost", "Host: localhost"]), Err(400));
        for origin in ["http://evil.example", "null", "http://localhost:81", "file://", "localhost:80"] {
            let headers = ["Host: localhost:80", &format!("Origin: {origin}")];
            assert_eq!(judge("GET /?token=secret", &headers), Err(403), "{origin}");
        }
        assert_eq!(
            judge("GET /?token=secret", &["Host: localhost:80", "Origin: http://localhost:80"]),
            Ok(Route::Page)
        );
    }

    #[test]
    fn a_socket_is_asked_for_in_the_way_of_the_protocol() {
        let key = format!("Sec-WebSocket-Key: {KEY}");
        let headers = [
            "Host: localhost",
            "Upgrade: WebSocket",
            "Connection: keep-alive, Upgrade",
            "Sec-WebSocket-Version: 13",
            &key,
        ];
        assert_eq!(judge("GET /socket?token=secret", &headers), Ok(Route::Socket(KEY.into())));
        for missing in 1..headers.len() {
            let fewer: Vec<&str> =
                headers.iter().enumerate().filter(|(at, _)| *at != missing).map(|(_, h)| *h).collect();
            assert_eq!(judge("GET /socket?token=secret", &fewer), Err(426), "without {}", headers[missing]);
        }
    }

    #[test]
    fn what_is_not_served_is_told() {
        assert_eq!(judge("GET /etc/passwd?token=secret", &["Host: localhost"]), Err(404));
        assert_eq!(judge("POST /?token=secret", &["Host: localhost"]), Err(405));
        assert_eq!(judge("GET /?token=secret", &["Host: localhost", "Content-Length: 5"]), Err(413));
        let many: Vec<String> = (0..100).map(|at| format!("X-{at}: y")).collect();
        let many: Vec<&str> = many.iter().map(String::as_str).collect();
        assert_eq!(judge("GET /?token=secret", &many), Err(431));
        assert_eq!(judge("\u{1}", &[]), Err(400));
    }
}
