//! The HTTP server, on one thread.

use super::guard::{Guard, Verdict};
use super::listener::LimitedListener;
use anyhow::{Context, Result, anyhow};
use axum::Router;
use axum::extract::{DefaultBodyLimit, Request};
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::{Next, from_fn};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use clap::Args;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use wm_viewer::page::{PageKind, files_of};

/// Longest body of a request, and longest message of a WebSocket, bytes.
pub const MAX_BODY_BYTES: usize = 1 << 18;
/// The port that is tried first.
const PORT: u16 = 8787;
/// Number of ports that are tried after it.
const PORTS: u16 = 20;
/// Shortest token that a user may choose.
const SHORTEST: usize = 16;

/// Address, port and token of the page.
#[derive(Args, Clone, Debug)]
pub struct ServerArgs {
    /// Port of the page; 0 for any free port [default: 8787, or the next free one]
    #[arg(long, value_name = "PORT", help_heading = "Server")]
    pub port: Option<u16>,
    /// Address to listen on. On any address but this computer's own (127.0.0.1) the page needs the token that is printed;
    /// connections are not encrypted, so prefer to forward the port with ssh
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST), help_heading = "Server")]
    pub host: IpAddr,
    /// Token, at least 16 letters or digits [default: a new one if one is needed]
    #[arg(long, value_name = "TOKEN", help_heading = "Server")]
    pub token: Option<String>,
}

impl ServerArgs {
    /// Returns the access rules.
    ///
    /// # Errors
    /// The token is too short or too long, or has other characters.
    pub fn guard(&self) -> Result<Guard> {
        if let Some(token) = &self.token {
            let is_plain = token.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-_.~".contains(&byte));
            if token.len() < SHORTEST || token.len() > 256 || !is_plain {
                return Err(anyhow!("--token: must be {SHORTEST} to 256 letters, digits and -_.~"));
            }
        }
        let is_needed = self.token.is_none() && !self.host.is_loopback();
        let new =
            if is_needed { Some(super::guard::new_token().context("cannot create a token")?) } else { None };
        Ok(Guard { token: self.token.clone().or(new) })
    }

    fn listen(&self) -> Result<TcpListener> {
        let at = |port: u16| TcpListener::bind(SocketAddr::new(self.host, port));
        let ports = match self.port {
            Some(port) => port..=port,
            None => PORT..=PORT + PORTS,
        };
        let first = *ports.start();
        let mut tried = ports.map(at);
        let bound = tried.find(Result::is_ok).unwrap_or_else(|| at(first));
        bound.with_context(|| {
            format!("cannot listen on {}; give another --port or --host", SocketAddr::new(self.host, first))
        })
    }
}

/// Serves `router` on a thread of its own until the program ends; returns the address of the page.
///
/// # Errors
/// No port is free.
pub fn serve(args: &ServerArgs, router: Router) -> Result<String> {
    let guard = args.guard()?;
    let listener = args.listen()?;
    listener.set_nonblocking(true)?;
    let address = listener.local_addr()?;
    let query = guard.token.as_ref().map_or_else(String::new, |token| format!("?token={token}"));
    let router = guarded(router, guard);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    std::thread::Builder::new().name("server".into()).spawn(move || {
        runtime.block_on(async {
            match tokio::net::TcpListener::from_std(listener) {
                // Serving never ends by itself.
                Ok(listener) => _ = axum::serve(LimitedListener::new(listener), router).await,
                Err(error) => eprintln!("error: cannot serve the page: {error}"),
            }
        });
    })?;
    Ok(format!("http://{address}/{query}"))
}

/// Adds the guard and the common headers to the routes.
fn guarded(router: Router, guard: Guard) -> Router {
    let router = router.fallback(get(|| async { refusal(StatusCode::NOT_FOUND, "there is no such page") }));
    router.layer(DefaultBodyLimit::max(MAX_BODY_BYTES)).layer(from_fn(move |request: Request, next: Next| {
        let verdict = guard.check(request.method(), request.uri(), request.headers());
        async move {
            let mut response = match verdict {
                Verdict::Pass => next.run(request).await,
                Verdict::Welcome(cookie) => {
                    let headers = [(header::SET_COOKIE, cookie), (header::LOCATION, "/".to_owned())];
                    (StatusCode::SEE_OTHER, headers).into_response()
                }
                Verdict::Refuse(status, why) => refusal(status, why),
            };
            let headers = response.headers_mut();
            for (name, value) in HEADERS {
                headers.insert(name, HeaderValue::from_static(value));
            }
            response
        }
    }))
}

/// Headers of every response: nothing is loaded from other origins, nothing is cached, no other page can frame this one or learn
/// its address.
const HEADERS: [(header::HeaderName, &str); 5] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
    (header::X_FRAME_OPTIONS, "DENY"),
];

/// Returns a response with one line of text.
pub fn refusal(status: StatusCode, why: impl AsRef<str>) -> Response {
    (status, [(header::CONTENT_TYPE, "text/plain; charset=utf-8")], format!("{}\n", why.as_ref()))
        .into_response()
}

/// Returns the routes of a page's files, which are built into the program.
pub fn page_routes<S: Clone + Send + Sync + 'static>(page: PageKind) -> Router<S> {
    files_of(page).fold(Router::new(), |router, file| {
        let path = if file.path == "index.html" { "/".into() } else { format!("/{}", file.path) };
        router.route(&path, get(async || ([(header::CONTENT_TYPE, file.kind)], file.text).into_response()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(host: &str, token: Option<&str>) -> ServerArgs {
        ServerArgs { port: Some(0), host: host.parse().unwrap(), token: token.map(str::to_owned) }
    }

    #[test]
    fn other_addresses_need_a_token() {
        assert_eq!(args("127.0.0.1", None).guard().unwrap().token, None);
        assert_eq!(args("::1", None).guard().unwrap().token, None);
        assert_eq!(args("0.0.0.0", None).guard().unwrap().token.unwrap().len(), 32);
        assert_eq!(args("127.0.0.1", Some("0123456789abcdef")).guard().unwrap().token.unwrap().len(), 16);
        for bad in ["", "short", "0123456789abcde\"", "0123456789abcdef;"] {
            assert!(args("0.0.0.0", Some(bad)).guard().is_err(), "{bad}");
        }
    }
}
