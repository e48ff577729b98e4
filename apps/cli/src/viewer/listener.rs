//! Connections: how many there may be, and for how long.
//!
//! A connection is a stranger until one of its requests had the token. There is room for a few
//! strangers of each address, and when it is taken the oldest of them has to leave: whoever opens
//! connections and says nothing keeps nobody out.

use super::locked::locked;
use std::collections::{BTreeMap, VecDeque};
use std::future::Future;
use std::io;
use std::net::{IpAddr, Ipv6Addr};
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::sync::Notify;
use tokio::time::{Instant, Sleep, sleep};

/// Most connections that showed the token. A browser opens six and a WebSocket.
const MAX_MEMBERS: usize = 128;
/// Most strangers, of all addresses and of one.
const MAX_STRANGERS: usize = 64;
const MAX_OF_ADDRESS: usize = 16;
/// Idle time after which a connection is closed.
const IDLE_TIMEOUT: Duration = Duration::from_secs(120);

/// All connections.
#[derive(Default)]
pub(crate) struct Connections(Mutex<Counts>);

#[derive(Default)]
struct Counts {
    last_id: u64,
    /// The oldest comes first.
    strangers: VecDeque<Stranger>,
    members: usize,
}

struct Stranger {
    id: u64,
    address: IpAddr,
    has_to_leave: Arc<Notify>,
}

impl Connections {
    /// Adds a connection from an address, as a stranger.
    pub(crate) fn add(self: &Arc<Self>, address: IpAddr) -> Arc<Connection> {
        let address = network_of(address);
        let has_to_leave = Arc::<Notify>::default();
        let mut counts = self.lock();
        counts.last_id += 1;
        let id = counts.last_id;
        if let Some(crowded) = counts.crowded(address) {
            let oldest = counts.strangers.iter().position(|stranger| stranger.address == crowded);
            if let Some(stranger) = oldest.and_then(|at| counts.strangers.remove(at)) {
                stranger.has_to_leave.notify_one();
            }
        }
        counts.strangers.push_back(Stranger { id, address, has_to_leave: Arc::clone(&has_to_leave) });
        drop(counts);
        Arc::new(Connection { all: Arc::clone(self), id, has_to_leave, is_member: AtomicBool::new(false) })
    }

    fn lock(&self) -> MutexGuard<'_, Counts> {
        // No critical section leaves the counts half changed when it panics.
        locked(&self.0)
    }
}

impl Counts {
    /// Returns the address of which a stranger has to leave before one of `address` may come, if
    /// any.
    fn crowded(&self, address: IpAddr) -> Option<IpAddr> {
        let mut of_address = BTreeMap::<IpAddr, usize>::new();
        for stranger in &self.strangers {
            *of_address.entry(stranger.address).or_default() += 1;
        }
        if self.strangers.len() >= MAX_STRANGERS {
            return of_address.into_iter().max_by_key(|(_, count)| *count).map(|(address, _)| address);
        }
        of_address.get(&address).is_some_and(|count| *count >= MAX_OF_ADDRESS).then_some(address)
    }
}

/// Returns the part of an address that one customer of a network has: all of IPv4, 64 bits of IPv6.
fn network_of(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => Ipv6Addr::from_bits(address.to_bits() >> 64 << 64).into(),
        address => address,
    }
}

/// A connection; it is counted until the value is dropped.
pub(crate) struct Connection {
    all: Arc<Connections>,
    id: u64,
    has_to_leave: Arc<Notify>,
    is_member: AtomicBool,
}

impl Connection {
    /// Waits until another connection needs the place of this one.
    pub(crate) async fn has_to_leave(&self) {
        self.has_to_leave.notified().await;
    }

    /// Takes a connection that showed the token for a member; returns false if there are too many
    /// of them.
    pub(crate) fn admit(&self) -> bool {
        let mut counts = self.all.lock();
        if self.is_member.load(Ordering::Relaxed) {
            return true;
        }
        if counts.members >= MAX_MEMBERS {
            return false;
        }
        counts.strangers.retain(|stranger| stranger.id != self.id);
        counts.members += 1;
        self.is_member.store(true, Ordering::Relaxed);
        true
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        let mut counts = self.all.lock();
        if self.is_member.load(Ordering::Relaxed) {
            counts.members -= 1;
        } else {
            counts.strangers.retain(|stranger| stranger.id != self.id);
        }
    }
}

/// The stream of a connection, with an idle timeout.
pub(crate) struct TimedStream {
    stream: TcpStream,
    alarm: Pin<Box<Sleep>>,
    _connection: Arc<Connection>,
}

impl TimedStream {
    /// Wraps the stream of a connection.
    pub(crate) fn new(stream: TcpStream, connection: Arc<Connection>) -> Self {
        Self { stream, alarm: Box::pin(sleep(IDLE_TIMEOUT)), _connection: connection }
    }

    fn restart_timeout(&mut self) {
        self.alarm.as_mut().reset(Instant::now() + IDLE_TIMEOUT);
    }

    /// Passes a result on and restarts the timeout; returns an error if nothing happened for too
    /// long.
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
    use super::*;
    use std::net::Ipv4Addr;

    fn address(number: u8) -> IpAddr {
        Ipv4Addr::new(192, 0, 2, number).into()
    }

    fn is_leaving(connection: &Connection) -> bool {
        let mut context = Context::from_waker(std::task::Waker::noop());
        std::pin::pin!(connection.has_to_leave()).poll(&mut context).is_ready()
    }

    #[test]
    fn the_oldest_stranger_of_an_address_makes_room() {
        let all = Arc::<Connections>::default();
        let other = all.add(address(2));
        let member = all.add(address(1));
        assert!(member.admit() && member.admit());
        let strangers: Vec<_> = (0..MAX_OF_ADDRESS + 3).map(|_| all.add(address(1))).collect();
        let leaving: Vec<bool> = strangers.iter().map(|stranger| is_leaving(stranger)).collect();
        assert!(leaving[..3].iter().all(|leaves| *leaves) && !leaving[3..].iter().any(|leaves| *leaves));
        assert!(!is_leaving(&other) && !is_leaving(&member));
        drop((strangers, other));
        assert!(all.lock().strangers.is_empty() && all.lock().members == 1);
        drop(member);
        assert_eq!(all.lock().members, 0);
    }

    #[test]
    fn of_many_addresses_the_one_with_most_strangers_makes_room() {
        let all = Arc::<Connections>::default();
        let crowd: Vec<_> = (0..MAX_OF_ADDRESS).map(|_| all.add(address(1))).collect();
        let others: Vec<_> = (2..200).map(|number| all.add(address(number))).collect();
        assert_eq!(all.lock().strangers.len(), MAX_STRANGERS);
        assert!(is_leaving(&crowd[0]) && !is_leaving(others.last().unwrap()));
    }

    #[test]
    fn members_are_limited() {
        let all = Arc::<Connections>::default();
        let members: Vec<_> = (0..MAX_MEMBERS).map(|_| all.add(address(1))).collect();
        assert!(members.iter().all(|connection| connection.admit()));
        assert!(!all.add(address(1)).admit());
        drop(members);
        assert!(all.add(address(1)).admit());
    }

    #[test]
    fn a_customer_has_many_addresses_of_ipv6() {
        let network = |text: &str| network_of(text.parse().unwrap());
        assert_eq!(network("2001:db8:1:2:3::4"), network("2001:db8:1:2:ffff::"));
        assert_ne!(network("2001:db8:1:2::"), network("2001:db8:1:3::"));
        assert_eq!(network("::ffff:192.0.2.1"), address(1));
    }
}
