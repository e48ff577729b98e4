//! What is asked for and by whom: between the server, which takes orders, and the thread that draws.
//!
//! Of a client only the last wish counts, and none is drawn while pictures before it are on their way. Clients take turns; those
//! whose picture moves come first.

use super::pace::Pace;
use super::state::View;
use axum::body::Bytes;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{Notify, oneshot};

/// Clients at one time.
pub const MOST_CLIENTS: usize = 16;
/// Pictures on their way to a client.
const MOST_UNSEEN: usize = 3;
/// Words that wait for a client.
const MOST_NOTES: usize = 64;
/// Orders that wait.
const MOST_ORDERS: usize = 32;
/// A picture that was on its way for so long counts as lost.
const LOST: Duration = Duration::from_secs(10);

/// What goes to a client: the last picture, and words.
#[derive(Default)]
pub struct Outbox {
    inside: Mutex<(VecDeque<String>, Option<Bytes>)>,
    /// Rung when there is something.
    pub bell: Notify,
}

impl Outbox {
    /// Puts words in; the oldest go where there are too many.
    pub fn note(&self, text: String) {
        let mut inside = locked(&self.inside);
        if inside.0.len() == MOST_NOTES {
            inside.0.pop_front();
        }
        inside.0.push_back(text);
        drop(inside);
        self.bell.notify_one();
    }

    /// Puts a picture in the place of one that waits.
    pub fn picture(&self, bytes: Bytes) {
        locked(&self.inside).1 = Some(bytes);
        self.bell.notify_one();
    }

    /// Takes what is in it.
    pub fn take(&self) -> (VecDeque<String>, Option<Bytes>) {
        std::mem::take(&mut *locked(&self.inside))
    }
}

/// What a client wants to see.
#[derive(Clone)]
pub struct Wish {
    /// What.
    pub view: Arc<View>,
    /// The client's own number of it.
    pub seq: u64,
    /// Whether more follows at once: it need not be perfect.
    pub is_moving: bool,
}

/// What an order is for.
pub enum Order {
    /// A picture as a file.
    Picture {
        /// What.
        view: Arc<View>,
        /// In which format.
        form: Form,
        /// Where to.
        reply: oneshot::Sender<Result<Bytes, String>>,
    },
    /// Where the scene is in the middle of a small window about a point of the picture, shares of its sides.
    Pick {
        /// What.
        view: Arc<View>,
        /// From the left and the top, 0-1.
        at: [f64; 2],
        /// Where to.
        outbox: Arc<Outbox>,
    },
    /// A video.
    Video {
        /// Its first frame.
        view: Arc<View>,
        /// What it is.
        job: Arc<super::videos::Video>,
    },
    /// The picture of a preset.
    Thumbnail(String),
}

/// How a picture is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// As `render` writes it.
    Png,
    /// Of the state's quality.
    Jpeg,
}

/// A client's wish as a task.
pub struct Turn {
    /// Who.
    pub client: u64,
    /// What.
    pub wish: Wish,
    /// Where to.
    pub outbox: Arc<Outbox>,
    /// Size of a picture that moves.
    pub small: (u32, u32),
}

/// What is to be done next.
pub enum Task {
    /// A picture for a client.
    Turn(Turn),
    /// Somebody's order.
    Order(Order),
}

struct Client {
    id: u64,
    outbox: Arc<Outbox>,
    wish: Option<Wish>,
    /// What the wish takes is being made, and a draft of it is out.
    waits: bool,
    pace: Pace,
    /// When pictures went out that were not seen yet.
    unseen: VecDeque<(u64, Instant)>,
    on_its_way: f64,
    moved: Option<Instant>,
}

impl Client {
    fn may_have(&self) -> bool {
        self.unseen.len() < MOST_UNSEEN || self.unseen.front().is_some_and(|(_, sent)| sent.elapsed() > LOST)
    }

    fn is_ready(&self, moving: bool) -> bool {
        self.may_have() && !self.waits && self.wish.as_ref().is_some_and(|wish| wish.is_moving == moving)
    }

    fn is_moving(&self) -> bool {
        self.moved.is_some_and(|at| at.elapsed() < Duration::from_millis(500))
    }
}

#[derive(Default)]
struct Inside {
    clients: Vec<Client>,
    orders: VecDeque<Order>,
    /// Idle work.
    thumbnails: VecDeque<String>,
    last_id: u64,
    /// Who was served last.
    served: u64,
    /// Whether the last that did not move was a client.
    was_client: bool,
    /// When somebody last wanted something.
    asked: Option<Instant>,
    /// Whether who waits for a task has something else to look after.
    is_woken: bool,
}

/// See above.
#[derive(Default)]
pub struct Desk {
    inside: Mutex<Inside>,
    bell: Condvar,
}

/// How long nobody must want anything before presets are drawn.
const IDLE: Duration = Duration::from_millis(1500);

impl Desk {
    /// A new client; `None` if there are too many.
    pub fn join(&self, outbox: Arc<Outbox>) -> Option<u64> {
        let mut inside = locked(&self.inside);
        if inside.clients.len() >= MOST_CLIENTS {
            return None;
        }
        inside.last_id += 1;
        let id = inside.last_id;
        inside.clients.push(Client {
            id,
            outbox,
            wish: None,
            waits: false,
            pace: Pace::default(),
            unseen: VecDeque::new(),
            on_its_way: 0.0,
            moved: None,
        });
        Some(id)
    }

    /// A client is gone.
    pub fn leave(&self, id: u64) {
        locked(&self.inside).clients.retain(|client| client.id != id);
    }

    /// What a client wants from now on.
    pub fn wish(&self, id: u64, wish: Wish) {
        let mut inside = locked(&self.inside);
        inside.asked = Some(Instant::now());
        if let Some(client) = inside.clients.iter_mut().find(|client| client.id == id) {
            client.moved = wish.is_moving.then(Instant::now);
            (client.wish, client.waits) = (Some(wish), false);
        }
        drop(inside);
        self.bell.notify_all();
    }

    /// A client shows the picture `seq`.
    pub fn seen(&self, id: u64, seq: u64) {
        let mut inside = locked(&self.inside);
        if let Some(client) = inside.clients.iter_mut().find(|client| client.id == id) {
            if let Some((_, sent)) = client.unseen.iter().find(|(sent, _)| *sent == seq) {
                client.on_its_way = sent.elapsed().as_secs_f64();
            }
            client.unseen.retain(|(sent, _)| *sent > seq);
        }
        drop(inside);
        self.bell.notify_all();
    }

    /// Takes an order; gives it back if there are too many.
    pub fn order(&self, order: Order) -> Result<(), Order> {
        let mut inside = locked(&self.inside);
        if inside.orders.len() >= MOST_ORDERS {
            return Err(order);
        }
        inside.asked = Some(Instant::now());
        inside.orders.push_back(order);
        drop(inside);
        self.bell.notify_all();
        Ok(())
    }

    /// Asks for pictures of presets, when there is nothing else to do.
    pub fn thumbnails(&self, names: impl IntoIterator<Item = String>) {
        let mut inside = locked(&self.inside);
        for name in names {
            if !inside.thumbnails.contains(&name) {
                inside.thumbnails.push_back(name);
            }
        }
        drop(inside);
        self.bell.notify_all();
    }

    /// What was being made is there, for a client: its turn is next, before others want something else made.
    pub fn go_on(&self, client: Option<u64>) {
        let mut inside = locked(&self.inside);
        inside.clients.iter_mut().for_each(|client| client.waits = false);
        if let Some(id) = client {
            inside.served = id.saturating_sub(1);
        }
        drop(inside);
        self.bell.notify_all();
    }

    /// Lets who waits for a task, or will, look after something else first.
    pub fn wake(&self) {
        locked(&self.inside).is_woken = true;
        self.bell.notify_all();
    }

    /// Says something to every client.
    pub fn tell_all(&self, text: &str) {
        for client in &locked(&self.inside).clients {
            client.outbox.note(text.to_owned());
        }
    }

    /// How many clients there are.
    pub fn clients(&self) -> usize {
        locked(&self.inside).clients.len()
    }

    /// A picture went out to a client: it took `seconds` of drawing, for a wish that moves. Or what it takes is being made.
    pub fn drawn(&self, id: u64, seq: u64, drawn: Drawn) {
        let mut inside = locked(&self.inside);
        let sharing = inside.clients.iter().filter(|client| client.is_moving()).count();
        let Some(client) = inside.clients.iter_mut().find(|client| client.id == id) else { return };
        client.unseen.push_back((seq, Instant::now()));
        if client.unseen.len() > MOST_UNSEEN {
            client.unseen.pop_front();
        }
        match drawn {
            Drawn::Moving(seconds) => client.pace.learn(seconds, sharing, client.on_its_way),
            Drawn::Waiting => {
                let is_same = client.wish.as_ref().is_none_or(|wish| wish.seq == seq);
                client.waits = is_same;
                return;
            }
            Drawn::Whole => {}
        }
        // A newer wish may have come meanwhile.
        if client.wish.as_ref().is_some_and(|wish| wish.seq == seq) {
            client.wish = None;
        }
    }

    /// What is to be done; `None` if nothing is within `patience`, or after [`Self::wake`].
    pub fn next(&self, patience: Duration) -> Option<Task> {
        let mut inside = locked(&self.inside);
        let end = Instant::now() + patience;
        loop {
            if std::mem::take(&mut inside.is_woken) {
                return None;
            }
            if let Some(task) = inside.next() {
                return Some(task);
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return None;
            }
            inside = self.bell.wait_timeout(inside, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

/// What became of a wish.
pub enum Drawn {
    /// A draft of a picture that moves, and how long it took, s.
    Moving(f64),
    /// A draft, until what is missing is made.
    Waiting,
    /// All of it.
    Whole,
}

impl Inside {
    fn next(&mut self) -> Option<Task> {
        if let Some(turn) = self.turn(true) {
            return Some(Task::Turn(turn));
        }
        // Orders and pictures that stand still take turns.
        if self.was_client
            && let Some(order) = self.orders.pop_front()
        {
            self.was_client = false;
            return Some(Task::Order(order));
        }
        if let Some(turn) = self.turn(false) {
            self.was_client = true;
            return Some(Task::Turn(turn));
        }
        let order = self.orders.pop_front().or_else(|| {
            let is_idle = self.asked.is_none_or(|asked| asked.elapsed() > IDLE);
            self.thumbnails.pop_front_if(|_| is_idle).map(Order::Thumbnail)
        });
        order.map(Task::Order)
    }

    /// The wish of the client behind the one that was served last, of those whose picture moves or not.
    fn turn(&mut self, moving: bool) -> Option<Turn> {
        let served = self.served;
        let ready = || self.clients.iter().filter(|client| client.is_ready(moving));
        let client = ready().find(|client| client.id > served).or_else(|| ready().next())?;
        let wish = client.wish.clone()?;
        let turn = Turn {
            client: client.id,
            outbox: Arc::clone(&client.outbox),
            small: client.pace.size(wish.view.state.size),
            wish,
        };
        self.served = turn.client;
        Some(turn)
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Nothing that is held here is left half done by a panic.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::super::state::testing::view;
    use super::*;

    fn desk(pages: usize) -> (Desk, Vec<u64>) {
        let desk = Desk::default();
        let ids = (0..pages).map(|_| desk.join(Arc::default()).unwrap()).collect();
        (desk, ids)
    }

    fn wish(desk: &Desk, id: u64, seq: u64, is_moving: bool) {
        desk.wish(id, Wish { view: view(), seq, is_moving });
    }

    /// Who is served with what.
    fn next(desk: &Desk) -> Option<(u64, u64)> {
        match desk.next(Duration::ZERO)? {
            Task::Turn(turn) => Some((turn.client, turn.wish.seq)),
            Task::Order(_) => Some((0, 0)),
        }
    }

    fn order(desk: &Desk) {
        let (reply, _) = oneshot::channel();
        desk.order(Order::Picture { view: view(), form: Form::Jpeg, reply }).ok().unwrap();
    }

    #[test]
    fn pages_take_turns_and_only_their_last_wish_counts() {
        let (desk, ids) = desk(3);
        for seq in 1..=5 {
            ids.iter().for_each(|id| wish(&desk, *id, seq, true));
        }
        for id in &ids {
            assert_eq!(next(&desk), Some((*id, 5)));
            desk.drawn(*id, 5, Drawn::Moving(0.01));
        }
        assert_eq!(next(&desk), None);
        // The one that was just served comes last.
        for id in [ids[2], ids[0]] {
            wish(&desk, id, 6, true);
        }
        assert_eq!(next(&desk), Some((ids[0], 6)));
    }

    #[test]
    fn a_wish_that_came_meanwhile_is_kept() {
        let (desk, ids) = desk(1);
        wish(&desk, ids[0], 1, true);
        assert_eq!(next(&desk), Some((ids[0], 1)));
        wish(&desk, ids[0], 2, false);
        desk.drawn(ids[0], 1, Drawn::Moving(0.01));
        assert_eq!(next(&desk), Some((ids[0], 2)));
        desk.drawn(ids[0], 2, Drawn::Whole);
        assert_eq!(next(&desk), None);
    }

    #[test]
    fn who_does_not_look_gets_no_more() {
        let (desk, ids) = desk(1);
        for seq in 1..=MOST_UNSEEN as u64 {
            wish(&desk, ids[0], seq, true);
            assert_eq!(next(&desk), Some((ids[0], seq)));
            desk.drawn(ids[0], seq, Drawn::Moving(0.01));
        }
        wish(&desk, ids[0], 9, true);
        assert_eq!(next(&desk), None);
        desk.seen(ids[0], 1);
        assert_eq!(next(&desk), Some((ids[0], 9)));
        desk.leave(ids[0]);
        assert_eq!(next(&desk), None);
    }

    #[test]
    fn what_waits_is_drawn_when_it_can_be() {
        let (desk, ids) = desk(2);
        ids.iter().for_each(|id| wish(&desk, *id, 1, false));
        for id in &ids {
            assert_eq!(next(&desk), Some((*id, 1)));
            desk.drawn(*id, 1, Drawn::Waiting);
            desk.seen(*id, 1);
        }
        assert_eq!(next(&desk), None);
        // First the one that it was made for.
        desk.go_on(Some(ids[1]));
        assert_eq!(next(&desk), Some((ids[1], 1)));
    }

    #[test]
    fn what_moves_comes_first_and_orders_take_turns_with_the_rest() {
        let (desk, ids) = desk(2);
        (0..2).for_each(|_| order(&desk));
        wish(&desk, ids[0], 1, false);
        wish(&desk, ids[1], 1, true);
        assert_eq!(next(&desk), Some((ids[1], 1)));
        desk.drawn(ids[1], 1, Drawn::Moving(0.01));
        assert_eq!(next(&desk), Some((ids[0], 1)));
        desk.drawn(ids[0], 1, Drawn::Whole);
        wish(&desk, ids[0], 2, false);
        assert_eq!(next(&desk), Some((0, 0)));
        assert_eq!(next(&desk), Some((ids[0], 2)));
    }

    #[test]
    fn who_is_woken_comes_back_at_once() {
        let (desk, ids) = desk(1);
        wish(&desk, ids[0], 1, true);
        desk.wake();
        assert_eq!(next(&desk), None);
        assert_eq!(next(&desk), Some((ids[0], 1)));
    }

    #[test]
    fn there_is_an_end_to_pages_and_orders() {
        let (desk, _) = desk(MOST_CLIENTS);
        assert_eq!(desk.join(Arc::default()), None);
        (0..MOST_ORDERS).for_each(|_| order(&desk));
        let (reply, _) = oneshot::channel();
        assert!(desk.order(Order::Picture { view: view(), form: Form::Png, reply }).is_err());
        let outbox = Outbox::default();
        (0..1000).for_each(|i| outbox.note(i.to_string()));
        assert_eq!(outbox.take().0.len(), MOST_NOTES);
    }
}
