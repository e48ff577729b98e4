//! Who may talk to the server.
//!
//! On this computer alone any program may; but a web page of somebody else, open in the same browser, must not. It can send
//! requests here, so those that it sends are told by their `Origin` and `Sec-Fetch-Site`. And it can give its own name the address
//! of this computer (DNS rebinding): then the browser takes it for the server's own page, but the name stands in `Host`.
//!
//! On any other address a token is asked for: in the URL once, then in a cookie, or as `Authorization: Bearer`.

use axum::http::{HeaderMap, Method, StatusCode, Uri, header};
use std::net::IpAddr;

/// The cookie that holds the token.
const COOKIE: &str = "weather-magician-token";

/// The door.
#[derive(Clone, Debug, Default)]
pub struct Guard {
    /// What must be shown; `None` on the loopback address.
    pub token: Option<String>,
}

/// What becomes of a request.
#[derive(Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It is answered.
    Pass,
    /// The browser is given this cookie and sent to the page, so that the token does not stay in the URL.
    Welcome(String),
    /// It is not answered, and why.
    Refuse(StatusCode, &'static str),
}

impl Guard {
    /// What becomes of a request.
    #[must_use]
    pub fn check(&self, method: &Method, uri: &Uri, headers: &HeaderMap) -> Verdict {
        let text = |name| headers.get(name).and_then(|value: &header::HeaderValue| value.to_str().ok());
        let Some(host) = text(header::HOST) else {
            return Verdict::Refuse(StatusCode::BAD_REQUEST, "a request must say its Host");
        };
        if self.token.is_none() && !is_loopback(name_of(host)) {
            return Verdict::Refuse(
                StatusCode::FORBIDDEN,
                "this viewer answers to localhost and 127.0.0.1 alone",
            );
        }
        if headers.contains_key(header::ORIGIN) && text(header::ORIGIN).and_then(authority) != Some(host) {
            return Verdict::Refuse(StatusCode::FORBIDDEN, "pages of other origins are not answered");
        }
        // A link that leads to the page is no harm; what a foreign page loads is.
        let is_page = method == Method::GET && uri.path() == "/";
        let site = headers.get("sec-fetch-site").and_then(|value| value.to_str().ok());
        if matches!(site, Some("cross-site" | "same-site")) && !is_page {
            return Verdict::Refuse(StatusCode::FORBIDDEN, "pages of other sites are not answered");
        }
        let Some(token) = &self.token else { return Verdict::Pass };
        let is_it = |shown: &str| is_same(shown.as_bytes(), token.as_bytes());
        let in_query = uri.query().into_iter().flat_map(|query| query.split('&'));
        if is_page && in_query.filter_map(|pair| pair.strip_prefix("token=")).any(is_it) {
            return Verdict::Welcome(format!("{COOKIE}={token}; HttpOnly; SameSite=Strict; Path=/"));
        }
        let bearer = text(header::AUTHORIZATION).and_then(|text| text.strip_prefix("Bearer "));
        let cookies = text(header::COOKIE).into_iter().flat_map(|text| text.split(';'));
        let mut cookies = cookies.filter_map(|pair| pair.trim().strip_prefix(COOKIE)?.strip_prefix('='));
        if bearer.is_some_and(is_it) || cookies.any(is_it) {
            return Verdict::Pass;
        }
        Verdict::Refuse(StatusCode::UNAUTHORIZED, "open the address that the program printed, with its token")
    }
}

/// A secret that nobody guesses: 128 bits of the system's.
///
/// # Errors
/// The system gives none.
pub fn new_token() -> Result<String, getrandom::Error> {
    let mut bytes = [0u8; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Equal, in a time that does not tell how far.
fn is_same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}

/// Name and port of an origin.
fn authority(origin: &str) -> Option<&str> {
    origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"))
}

/// The name of `name:port`.
fn name_of(host: &str) -> &str {
    match host.strip_prefix('[') {
        Some(rest) => rest.split_once(']').map_or(rest, |(name, _)| name),
        None => host.split_once(':').map_or(host, |(name, _)| name),
    }
}

fn is_loopback(name: &str) -> bool {
    name.eq_ignore_ascii_case("localhost") || name.parse().is_ok_and(|address: IpAddr| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(guard: &Guard, method: &str, uri: &str, headers: &[(&'static str, &str)]) -> Verdict {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(*name, value.parse().unwrap());
        }
        guard.check(&method.parse().unwrap(), &uri.parse().unwrap(), &map)
    }

    fn passes(guard: &Guard, headers: &[(&'static str, &str)]) -> bool {
        verdict(guard, "GET", "/state", headers) == Verdict::Pass
    }

    #[test]
    fn this_computer_is_answered_by_any_of_its_names() {
        let guard = Guard::default();
        for host in ["localhost", "localhost:8787", "127.0.0.1:1", "127.8.0.1", "[::1]:8787", "LOCALHOST:2"] {
            assert!(passes(&guard, &[("host", host)]), "{host}");
            assert!(passes(&guard, &[("host", host), ("origin", &format!("http://{host}"))]), "{host}");
        }
    }

    #[test]
    fn foreign_names_and_origins_are_refused() {
        let guard = Guard::default();
        for host in [
            "evil.example",
            "evil.example:8787",
            "192.168.0.7",
            "localhost.evil.example",
            "",
            "[::2]",
            "127.0.0.1.nip.io",
        ] {
            assert!(!passes(&guard, &[("host", host)]), "{host}");
        }
        assert!(!passes(&guard, &[]));
        let host = ("host", "localhost:8787");
        for origin in [
            "http://evil.example",
            "null",
            "http://localhost:9999",
            "file://",
            "http://localhost:8787.evil.example",
        ] {
            assert!(!passes(&guard, &[host, ("origin", origin)]), "{origin}");
        }
        assert!(!passes(&guard, &[host, ("sec-fetch-site", "cross-site")]));
        assert!(!passes(&guard, &[host, ("sec-fetch-site", "same-site")]));
        // A link to the page.
        assert_eq!(verdict(&guard, "GET", "/", &[host, ("sec-fetch-site", "cross-site")]), Verdict::Pass);
        assert_ne!(verdict(&guard, "POST", "/", &[host, ("sec-fetch-site", "cross-site")]), Verdict::Pass);
    }

    #[test]
    fn elsewhere_the_token_is_asked_for() {
        let guard = Guard { token: Some("a-secret-of-some-length".into()) };
        let host = ("host", "gpu.example:8787");
        let refused = |headers: &[_]| {
            matches!(verdict(&guard, "GET", "/state", headers), Verdict::Refuse(StatusCode::UNAUTHORIZED, _))
        };
        assert!(refused(&[host]));
        assert!(refused(&[host, ("cookie", "weather-magician-token=")]));
        assert!(refused(&[host, ("cookie", "weather-magician-token=a-secret-of-some-lengtH")]));
        assert!(refused(&[host, ("authorization", "Bearer a-secret")]));
        assert!(passes(&guard, &[host, ("cookie", "a=b; weather-magician-token=a-secret-of-some-length")]));
        assert!(passes(&guard, &[host, ("authorization", "Bearer a-secret-of-some-length")]));
        let Verdict::Welcome(cookie) = verdict(&guard, "GET", "/?token=a-secret-of-some-length", &[host])
        else {
            panic!("no welcome")
        };
        assert!(cookie.contains("HttpOnly") && cookie.contains("SameSite=Strict"));
        // The cookie of one's own browser helps a foreign page nothing.
        let cookie = ("cookie", "weather-magician-token=a-secret-of-some-length");
        assert!(!passes(&guard, &[host, cookie, ("origin", "http://evil.example")]));
    }

    #[test]
    fn tokens_differ() {
        let [a, b] = [new_token().unwrap(), new_token().unwrap()];
        assert!(a.len() == 32 && a != b);
    }
}
