//! A TCP listener with a limited number of connections, each with an idle timeout.

use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, Sleep, sleep};

/// Maximum number of connections. A browser opens six and a WebSocket.
pub const MAX_CONNECTIONS: usize = 128;
/// Idle time after which a connection is closed.
const IDLE_TIMEOUT: Duration = Duration::from_secs(120);
/// Pause after a failure to accept, such as when file handles run out.
const RETRY_AFTER: Duration = Duration::from_millis(100);

/// Response when all connections are in use.
const BUSY: &[u8] = b"HTTP/1.1 503 Service Unavailable\r\ncontent-type: text/plain\r\ncontent-length: 58\r\n\
    connection: close\r\nretry-after: 1\r\n\r\ntoo many connections at once; close some and try it again\n";

/// Accepts connections up to a maximum number.
pub struct LimitedListener {
    listener: TcpListener,
    free: Arc<Semaphore>,
}

impl LimitedListener {
    /// Wraps a listener.
    pub fn new(listener: TcpListener) -> Self {
        Self { listener, free: Arc::new(Semaphore::new(MAX_CONNECTIONS)) }
    }
}

impl axum::serve::Listener for LimitedListener {
    type Io = TimedStream;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Self::Io, Self::Addr) {
        loop {
            let Ok((stream, address)) = self.listener.accept().await else {
                sleep(RETRY_AFTER).await;
                continue;
            };
            // Frames are sent in one piece; small responses must not wait for more data.
            let _ = stream.set_nodelay(true);
            match Arc::clone(&self.free).try_acquire_owned() {
                Ok(permit) => {
                    return (
                        TimedStream { stream, alarm: Box::pin(sleep(IDLE_TIMEOUT)), _permit: permit },
                        address,
                    );
                }
                Err(_) => refuse(&stream),
            }
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// Sends the reason, if that is possible without waiting.
fn refuse(stream: &TcpStream) {
    let _ = stream.try_write(BUSY);
    // Unread data would make the system discard the response (RST).
    let mut asked = [0; 4096];
    let _ = stream.try_read(&mut asked);
}

/// A connection with an idle timeout.
pub struct TimedStream {
    stream: TcpStream,
    alarm: Pin<Box<Sleep>>,
    _permit: OwnedSemaphorePermit,
}

impl TimedStream {
    fn restart_timeout(&mut self) {
        self.alarm.as_mut().reset(Instant::now() + IDLE_TIMEOUT);
    }

    /// Passes a result on and restarts the timeout; returns an error if nothing happened for too long.
    fn or_timeout<T>(
        &mut self,
        context: &mut Context<'_>,
        polled: Poll<io::Result<T>>,
    ) -> Poll<io::Result<T>> {
        if polled.is_ready() {
            self.restart_timeout();
            return polled;
        }
        ready!(self.alarm.as_mut().poll(context));
        Poll::Ready(Err(io::ErrorKind::TimedOut.into()))
    }
}

impl AsyncRead for TimedStream {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let polled = Pin::new(&mut self.stream).poll_read(context, buffer);
        self.or_timeout(context, polled)
    }
}

impl AsyncWrite for TimedStream {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let polled = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.or_timeout(context, polled)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use super::BUSY;

    #[test]
    fn the_refusal_has_its_content_length() {
        let text = std::str::from_utf8(BUSY).unwrap();
        let (head, body) = text.split_once("\r\n\r\n").unwrap();
        assert!(head.contains(&format!("content-length: {}\r\n", body.len())), "{}", body.len());
    }
}
