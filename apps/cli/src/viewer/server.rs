//! The HTTP server, on one thread.

use super::guard::Guard;
use super::listener::{Connection, Connections, TimedStream};
use anyhow::{Context, Result, bail};
use axum::body::{Body, to_bytes};
use axum::extract::{DefaultBodyLimit, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::{Next, from_fn, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Extension, Router};
use clap::Args;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::io::Read;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};
use wm_viewer::page::{PageKind, files_of};

/// Longest body of a request, and longest message of a WebSocket, bytes.
pub(crate) const MAX_BODY_BYTES: usize = 1 << 18;
/// Longest text that is taken for a token, bytes.
const MAX_TOKEN_BYTES: usize = 256;
/// Longest time for the head of a request, or for a login, to arrive, and between two requests of a
/// connection.
const HEAD_TIMEOUT: Duration = Duration::from_secs(10);
/// Most bytes of a connection that wait in memory to be sent, and of a request's head.
const MAX_BUFFER: usize = 1 << 16;
/// Pause after a failure to accept, such as when file handles run out.
const RETRY_AFTER: Duration = Duration::from_millis(100);
/// The port that is tried first.
const FIRST_PORT: u16 = 8787;
/// Number of ports that are tried after it.
const MORE_PORT_COUNT: u16 = 20;
/// Shortest token that a user may choose.
const MIN_TOKEN_BYTES: usize = 16;
/// The environment variable that holds a token.
const TOKEN_VARIABLE: &str = "WEATHER_MAGICIAN_TOKEN";

/// Address, port and token of the page.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Server")]
pub(crate) struct ServerArgs {
    /// Port of the page; 0 for any free port [default: 8787, or the next free one]
    #[arg(long, value_name = "PORT")]
    pub(crate) port: Option<u16>,
    /// Address to listen on. Connections are not encrypted, so prefer to forward the port with ssh
    /// to listening on another address than this computer's own (127.0.0.1)
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    pub(crate) host: IpAddr,
    /// File whose first line is the token that the page needs, at least 16 letters or digits; the
    /// environment variable WEATHER_MAGICIAN_TOKEN gives it too [default: a new one, which is
    /// printed]
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// An option of old versions, which other users of the computer could read; refused.
    #[arg(long, value_name = "TOKEN", hide = true)]
    pub(crate) token: Option<String>,
}

impl ServerArgs {
    /// Returns the access rules.
    ///
    /// # Errors
    /// The token is too short or too long, or has other characters; its file cannot be read.
    pub(crate) fn guard(&self) -> Result<Guard> {
        self.guard_with(std::env::var_os(TOKEN_VARIABLE).map(|token| token.to_string_lossy().into_owned()))
    }

    /// Returns the access rules with the token of the environment.
    fn guard_with(&self, variable: Option<String>) -> Result<Guard> {
        if self.token.is_some() {
            bail!(
                "--token: every user of this computer could read it in the list of processes; set {TOKEN_VARIABLE} or give --token-file"
            );
        }
        let chosen = match &self.token_file {
            Some(path) => Some((format!("--token-file {}", path.display()), read_token(path)?)),
            None => variable.map(|token| (TOKEN_VARIABLE.to_owned(), token)),
        };
        if let Some((origin, token)) = &chosen {
            let is_plain = token.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-_.~".contains(&byte));
            if token.len() < MIN_TOKEN_BYTES || token.len() > MAX_TOKEN_BYTES || !is_plain {
                bail!("{origin}: a token is {MIN_TOKEN_BYTES} to {MAX_TOKEN_BYTES} letters, digits and -_.~");
            }
        }
        // Who chooses the token may have put a server in front that is called otherwise.
        let is_local = chosen.is_none() && self.host.is_loopback();
        let token = match chosen {
            Some((_, token)) => token,
            None => super::guard::new_token().context("cannot create a token")?,
        };
        Ok(Guard { token, is_local })
    }

    fn listen(&self) -> Result<TcpListener> {
        let at = |port: u16| TcpListener::bind(SocketAddr::new(self.host, port));
        let ports = match self.port {
            Some(port) => port..=port,
            None => FIRST_PORT..=FIRST_PORT + MORE_PORT_COUNT,
        };
        let first = *ports.start();
        let mut tried = ports.map(at);
        let bound = tried.find(Result::is_ok).unwrap_or_else(|| at(first));
        bound.with_context(|| {
            format!("cannot listen on {}; give another --port or --host", SocketAddr::new(self.host, first))
        })
    }
}

/// Returns the first line of a file that holds a token.
fn read_token(path: &std::path::Path) -> Result<String> {
    let mut text = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| {
        // A pipe is read as far as a token may go.
        file.take(MAX_TOKEN_BYTES as u64 + 2).read_to_end(&mut text)
    });
    read.with_context(|| format!("--token-file {}: cannot be read", path.display()))?;
    let text = String::from_utf8_lossy(&text);
    Ok(text.lines().next().unwrap_or_default().trim().to_owned())
}

/// Serves a page on a thread of its own until the program ends; `router` answers what needs the
/// token. Returns the address of the page with the token.
///
/// # Errors
/// No port is free, or the token cannot be used.
pub(crate) fn serve(args: &ServerArgs, page: PageKind, router: Router) -> Result<String> {
    let guard = args.guard()?;
    let listener = args.listen()?;
    listener.set_nonblocking(true)?;
    let address = listener.local_addr()?;
    let page_address = format!("http://{address}/#token={}", guard.token);
    let router = guarded(page, router, guard);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    std::thread::Builder::new().name("server".into()).spawn(move || {
        runtime.block_on(async {
            match tokio::net::TcpListener::from_std(listener) {
                Ok(listener) => accept(listener, router).await,
                Err(error) => eprintln!("error: cannot serve the page: {error}"),
            }
        });
    })?;
    Ok(page_address)
}

/// Accepts connections for ever.
async fn accept(listener: tokio::net::TcpListener, router: Router) {
    let connections = Arc::<Connections>::default();
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(HEAD_TIMEOUT).max_buf_size(MAX_BUFFER);
    loop {
        let Ok((stream, address)) = listener.accept().await else {
            sleep(RETRY_AFTER).await;
            continue;
        };
        // Frames are sent in one piece; small responses must not wait for more data.
        let _ = stream.set_nodelay(true);
        let connection = connections.add(address.ip());
        let service = TowerToHyperService::new(router.clone().layer(Extension(Arc::clone(&connection))));
        let stream = TokioIo::new(TimedStream::new(stream, Arc::clone(&connection)));
        let served = http.serve_connection(stream, service).with_upgrades();
        tokio::spawn(async move {
            tokio::select! {
                // What is wrong with a connection is for its client to see.
                _ = served => {}
                () = connection.has_to_leave() => {}
            }
        });
    }
}

/// Returns the routes of a page: its files and the login for everybody, those of `router` for
/// requests with the token; none for foreign pages. All responses have the common headers.
fn guarded(page: PageKind, router: Router, guard: Guard) -> Router {
    let guard = Arc::new(guard);
    let inside = router
        .fallback(get(|| async { refusal(StatusCode::NOT_FOUND, "there is no such page") }))
        .layer(DefaultBodyLimit::max(MAX_BODY_BYTES))
        .layer(from_fn_with_state(Arc::clone(&guard), check_token));
    let login = Router::new().route("/login", get(is_logged_in).post(log_in)).with_state(Arc::clone(&guard));
    let check_origin = from_fn(move |request: Request, next: Next| {
        let verdict = guard.check_origin(request.method(), request.uri(), request.headers());
        async move {
            let mut response = match verdict {
                Ok(()) => next.run(request).await,
                Err((status, why)) => refusal(status, why),
            };
            let headers = response.headers_mut();
            for (name, value) in HEADERS {
                headers.insert(name, HeaderValue::from_static(value));
            }
            response
        }
    });
    page_files(page).merge(login).merge(inside).layer(check_origin)
}

type SharedGuard = State<Arc<Guard>>;

/// Answers a request with the token. A panic ends this request alone.
async fn check_token(State(guard): SharedGuard, request: Request, next: Next) -> Response {
    if !guard.is_admitted(request.headers()) {
        let why = "the token is missing: open the address that the program printed, or send `Authorization: Bearer TOKEN`";
        return refusal(StatusCode::UNAUTHORIZED, why);
    }
    let connection = request.extensions().get::<Arc<Connection>>();
    if connection.is_some_and(|connection| !connection.admit()) {
        let why = "too many connections at once; close some and try it again";
        return refusal(StatusCode::SERVICE_UNAVAILABLE, why);
    }
    // The task ends with this future, when the client is gone.
    let mut task = JoinSet::new();
    task.spawn(next.run(request));
    match task.join_next().await {
        Some(Ok(response)) => response,
        _ => refusal(StatusCode::INTERNAL_SERVER_ERROR, "the program failed at this request"),
    }
}

/// Tells a page if it has to log in.
async fn is_logged_in(State(guard): SharedGuard, headers: HeaderMap) -> Response {
    let answer = if guard.is_admitted(&headers) { "true" } else { "false" };
    ([(header::CONTENT_TYPE, "application/json")], answer).into_response()
}

/// Gives the cookie to a page that sends the token.
async fn log_in(State(guard): SharedGuard, headers: HeaderMap, body: Body) -> Response {
    let body = match timeout(HEAD_TIMEOUT, to_bytes(body, MAX_TOKEN_BYTES)).await {
        Ok(Ok(body)) => body,
        Ok(Err(_)) => return refusal(StatusCode::PAYLOAD_TOO_LARGE, "This is too long for a token"),
        Err(_) => return refusal(StatusCode::REQUEST_TIMEOUT, "The token did not arrive in time"),
    };
    if std::str::from_utf8(&body).is_ok_and(|shown| guard.is_token(shown)) {
        (StatusCode::NO_CONTENT, [(header::SET_COOKIE, guard.cookie(&headers))]).into_response()
    } else {
        refusal(StatusCode::FORBIDDEN, "This is not the token that the program printed")
    }
}

/// Headers of every response: nothing is loaded from other origins, nothing is cached, no other
/// page can frame this one or learn its address.
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
pub(crate) fn refusal(status: StatusCode, why: impl AsRef<str>) -> Response {
    (status, [(header::CONTENT_TYPE, "text/plain; charset=utf-8")], format!("{}\n", why.as_ref()))
        .into_response()
}

/// Returns the routes of a page's files, which are built into the program.
fn page_files(page: PageKind) -> Router {
    files_of(page).fold(Router::new(), |router, file| {
        let path = if file.path == "index.html" { "/".into() } else { format!("/{}", file.path) };
        router.route(&path, get(async || ([(header::CONTENT_TYPE, file.kind)], file.text).into_response()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(host: &str) -> ServerArgs {
        ServerArgs { port: Some(0), host: host.parse().unwrap(), token_file: None, token: None }
    }

    #[test]
    fn every_address_needs_a_token() {
        for (host, is_local) in [("127.0.0.1", true), ("::1", true), ("0.0.0.0", false)] {
            let guard = args(host).guard_with(None).unwrap();
            assert_eq!((guard.token.len(), guard.is_local), (32, is_local), "{host}");
        }
    }

    #[test]
    fn a_token_is_chosen_where_no_list_of_processes_shows_it() {
        let chosen = "0123456789abcdef";
        let guard = args("127.0.0.1").guard_with(Some(chosen.into())).unwrap();
        assert_eq!((guard.token.as_str(), guard.is_local), (chosen, false));
        for bad in ["", "short", "0123456789abcde\"", "0123456789abcdef;", &"a".repeat(300)] {
            let error = args("0.0.0.0").guard_with(Some(bad.into())).unwrap_err().to_string();
            assert!(error.starts_with("WEATHER_MAGICIAN_TOKEN: a token is 16 to 256 "), "{bad}: {error}");
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("token");
        let with_file = ServerArgs { token_file: Some(path.clone()), ..args("::1") };
        assert!(with_file.guard_with(None).unwrap_err().to_string().ends_with("token: cannot be read"));
        std::fs::write(&path, "fedcba9876543210\r\n").unwrap();
        assert_eq!(with_file.guard_with(Some(chosen.into())).unwrap().token, "fedcba9876543210");
        std::fs::write(&path, "a".repeat(100_000)).unwrap();
        assert!(with_file.guard_with(None).unwrap_err().to_string().contains("16 to 256"));
        let shown = ServerArgs { token: Some(chosen.into()), ..args("::1") };
        assert!(shown.guard_with(None).unwrap_err().to_string().contains("list of processes"));
    }
}
