//! Access to the server.
//!
//! On the loopback address every program of this computer has access, but a foreign web page in the same browser must not. Its
//! requests are recognised by their `Origin` and `Sec-Fetch-Site`. It may also map its own host name to this computer (DNS
//! rebinding), so that the browser takes it for the server's own page; then its name is in `Host`.
//!
//! On any other address a token is required: in the URL once, then in a cookie, or as `Authorization: Bearer`.

use axum::http::{HeaderMap, Method, StatusCode, Uri, header};
use std::net::IpAddr;

/// The cookie that holds the token.
const COOKIE: &str = "weather-magician-token";

/// Checks requests.
#[derive(Clone, Debug, Default)]
pub struct Guard {
    /// The token that requests must have; `None` on the loopback address.
    pub token: Option<String>,
}

/// Result of the check of a request.
#[derive(Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The request is answered.
    Pass,
    /// The browser is given this cookie and sent to the page, so that the token does not stay in the URL.
    Welcome(String),
    /// The request is refused with a status and a reason.
    Refuse(StatusCode, &'static str),
}

impl Guard {
    /// Checks a request.
    #[must_use]
    pub fn check(&self, method: &Method, uri: &Uri, headers: &HeaderMap) -> Verdict {
        let text = |name| headers.get(name).and_then(|value: &header::HeaderValue| value.to_str().ok());
        let Some(host) = text(header::HOST) else {
            return Verdict::Refuse(StatusCode::BAD_REQUEST, "a request must have a Host header");
        };
        if self.token.is_none() && !is_loopback(name_of(host)) {
            return Verdict::Refuse(
                StatusCode::FORBIDDEN,
                "this viewer only answers to localhost and 127.0.0.1",
            );
        }
        if headers.contains_key(header::ORIGIN) && text(header::ORIGIN).and_then(authority) != Some(host) {
            return Verdict::Refuse(StatusCode::FORBIDDEN, "pages of other origins are not answered");
        }
        // A link to the page is harmless; resources that a foreign page loads are not.
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

/// Returns a secret token: 128 random bits of the operating system.
///
/// # Errors
/// The system has no source of random numbers.
pub fn new_token() -> Result<String, getrandom::Error> {
    let mut bytes = [0u8; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Compares in a time that does not depend on the first difference.
fn is_same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}

/// Returns name and port of an origin.
fn authority(origin: &str) -> Option<&str> {
    origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"))
}

/// Returns the name of `name:port`.
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
    fn other_addresses_require_the_token() {
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
        // The browser's cookie does not help a foreign page.
        let cookie = ("cookie", "weather-magician-token=a-secret-of-some-length");
        assert!(!passes(&guard, &[host, cookie, ("origin", "http://evil.example")]));
    }

    #[test]
    fn tokens_differ() {
        let [a, b] = [new_token().unwrap(), new_token().unwrap()];
        assert!(a.len() == 32 && a != b);
    }
}
