//! Access to the server.
//!
//! Every request but those for the files of the page, which are the same in every program, needs
//! the token: other users of this computer reach its loopback address too. A page gets the token in
//! the fragment of its address, which no server sees, and logs in with it; from then on a cookie
//! has it. Scripts send `Authorization: Bearer`.
//!
//! A foreign page in the same browser must not act with that cookie. Its requests are recognised by
//! their `Origin` and `Sec-Fetch-Site`. It may also map its own host name to this computer (DNS
//! rebinding), so that the browser takes it for the server's own page; then its name is in `Host`.

use axum::http::{HeaderMap, Method, StatusCode, Uri, header};
use std::net::IpAddr;

/// The start of the name of the cookie that holds the token. The port follows: a browser gives all
/// cookies of a computer to each of its ports.
const COOKIE: &str = "weather-magician-token";

/// Checks requests.
#[derive(Clone, Debug)]
pub(crate) struct Guard {
    /// The token.
    pub(crate) token: String,
    /// True if requests must name this computer by a name of its loopback address.
    pub(crate) is_local: bool,
}

/// A request that is refused: the status and the reason.
pub(crate) type Refusal = (StatusCode, &'static str);

impl Guard {
    /// Checks that a request is not that of a foreign page.
    ///
    /// # Errors
    /// [`Refusal`].
    pub(crate) fn check_origin(
        &self,
        method: &Method,
        uri: &Uri,
        headers: &HeaderMap,
    ) -> Result<(), Refusal> {
        let Some(host) = text(headers, header::HOST) else {
            return Err((StatusCode::BAD_REQUEST, "a request must have a Host header"));
        };
        if self.is_local && !is_loopback(split_host(host).0) {
            return Err((StatusCode::FORBIDDEN, "this viewer only answers to localhost and 127.0.0.1"));
        }
        if headers.contains_key(header::ORIGIN)
            && text(headers, header::ORIGIN).and_then(authority) != Some(host)
        {
            return Err((StatusCode::FORBIDDEN, "pages of other origins are not answered"));
        }
        // A link to the page is harmless; resources that a foreign page loads are not.
        let is_page = method == Method::GET && uri.path() == "/";
        let site = headers.get("sec-fetch-site").and_then(|value| value.to_str().ok());
        if matches!(site, Some("cross-site" | "same-site")) && !is_page {
            return Err((StatusCode::FORBIDDEN, "pages of other sites are not answered"));
        }
        Ok(())
    }

    /// Returns true if a request has the token.
    #[must_use]
    pub(crate) fn is_admitted(&self, headers: &HeaderMap) -> bool {
        let bearer = text(headers, header::AUTHORIZATION).and_then(|text| text.strip_prefix("Bearer "));
        let name = cookie_name(headers);
        let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
        let mut cookies =
            cookies.flat_map(|text| text.split(';')).filter_map(|pair| pair.trim().split_once('='));
        bearer.is_some_and(|shown| self.is_token(shown))
            || cookies.any(|(known, shown)| known == name && self.is_token(shown))
    }

    /// Returns true if a text is the token.
    #[must_use]
    pub(crate) fn is_token(&self, shown: &str) -> bool {
        is_same(shown.as_bytes(), self.token.as_bytes())
    }

    /// Returns the cookie for the browser of a request with the token.
    #[must_use]
    pub(crate) fn cookie(&self, headers: &HeaderMap) -> String {
        format!("{}={}; HttpOnly; SameSite=Strict; Path=/", cookie_name(headers), self.token)
    }
}

/// Returns a secret token: 128 random bits of the operating system.
///
/// # Errors
/// The system has no source of random numbers.
pub(crate) fn new_token() -> Result<String, getrandom::Error> {
    let mut bytes = [0u8; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Compares in a time that does not depend on the first difference.
fn is_same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}

fn text(headers: &HeaderMap, name: header::HeaderName) -> Option<&str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}

/// Returns the name of the cookie by the port that the browser knows, which a forwarded connection
/// may change.
fn cookie_name(headers: &HeaderMap) -> String {
    let port = text(headers, header::HOST).map_or("", |host| split_host(host).1);
    format!("{COOKIE}-{port}")
}

/// Returns name and port of an origin.
fn authority(origin: &str) -> Option<&str> {
    origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"))
}

/// Splits `name:port`; the port may be empty.
fn split_host(host: &str) -> (&str, &str) {
    let (name, rest) = match host.strip_prefix('[') {
        Some(rest) => rest.split_once(']').unwrap_or((rest, "")),
        None => host.find(':').map_or((host, ""), |at| host.split_at(at)),
    };
    (name, rest.strip_prefix(':').unwrap_or_default())
}

fn is_loopback(name: &str) -> bool {
    name.eq_ignore_ascii_case("localhost") || name.parse().is_ok_and(|address: IpAddr| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKEN: &str = "a-secret-of-some-length";

    fn guard(is_local: bool) -> Guard {
        Guard { token: TOKEN.into(), is_local }
    }

    fn map(headers: &[(&'static str, &str)]) -> HeaderMap {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(*name, value.parse().unwrap());
        }
        map
    }

    fn check(guard: &Guard, method: &str, uri: &str, headers: &[(&'static str, &str)]) -> bool {
        guard.check_origin(&method.parse().unwrap(), &uri.parse().unwrap(), &map(headers)).is_ok()
    }

    fn passes(guard: &Guard, headers: &[(&'static str, &str)]) -> bool {
        check(guard, "GET", "/state", headers)
    }

    #[test]
    fn this_computer_is_answered_by_any_of_its_names() {
        let guard = guard(true);
        for host in ["localhost", "localhost:8787", "127.0.0.1:1", "127.8.0.1", "[::1]:8787", "LOCALHOST:2"] {
            assert!(passes(&guard, &[("host", host)]), "{host}");
            assert!(passes(&guard, &[("host", host), ("origin", &format!("http://{host}"))]), "{host}");
        }
    }

    #[test]
    fn foreign_names_and_origins_are_refused() {
        let local = guard(true);
        for host in [
            "evil.example",
            "evil.example:8787",
            "192.168.0.7",
            "localhost.evil.example",
            "",
            "[::2]",
            "127.0.0.1.nip.io",
        ] {
            assert!(!passes(&local, &[("host", host)]), "{host}");
        }
        assert!(!passes(&local, &[]));
        assert!(passes(&guard(false), &[("host", "gpu.example:8787")]));
        let host = ("host", "localhost:8787");
        for guard in [local, guard(false)] {
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
            assert!(check(&guard, "GET", "/", &[host, ("sec-fetch-site", "cross-site")]));
            assert!(!check(&guard, "POST", "/", &[host, ("sec-fetch-site", "cross-site")]));
        }
    }

    #[test]
    fn the_token_admits_by_header_and_by_cookie_of_the_same_port() {
        let guard = guard(true);
        let host = ("host", "localhost:8787");
        let is_admitted = |headers: &[_]| guard.is_admitted(&map(headers));
        let cookie = guard.cookie(&map(&[host]));
        assert!(cookie.contains("; HttpOnly; SameSite=Strict;"), "{cookie}");
        let pair = cookie.split(';').next().unwrap();
        assert_eq!(pair, "weather-magician-token-8787=a-secret-of-some-length");
        let with_another = format!("a=b; {pair}");
        assert!(is_admitted(&[host, ("cookie", &with_another)]));
        assert!(is_admitted(&[host, ("cookie", "a=b"), ("cookie", pair)]));
        assert!(is_admitted(&[host, ("authorization", "Bearer a-secret-of-some-length")]));
        for bad in [
            vec![host],
            vec![host, ("cookie", "weather-magician-token-8787=")],
            vec![host, ("cookie", "weather-magician-token-8787=a-secret-of-some-lengtH")],
            vec![("host", "localhost:8788"), ("cookie", pair)],
            vec![host, ("authorization", "Bearer a-secret")],
            vec![host, ("authorization", "Bearer ")],
            vec![host, ("authorization", "a-secret-of-some-length")],
        ] {
            assert!(!is_admitted(&bad), "{bad:?}");
        }
        assert_eq!(split_host("[::1]:80"), ("::1", "80"));
        assert_eq!(split_host("[::1]"), ("::1", ""));
        assert_eq!(split_host("localhost"), ("localhost", ""));
    }

    #[test]
    fn tokens_differ() {
        let [a, b] = [new_token().unwrap(), new_token().unwrap()];
        assert!(a.len() == 32 && a != b);
    }
}
