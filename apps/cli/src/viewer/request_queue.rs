//! Requests and commands of all clients, between the server, which accepts them, and the render
//! worker.
//!
//! Only the latest request of each client is kept, and a client that has not displayed its last few
//! frames gets no new one. Clients take turns; those whose view is moving come first.

use super::client_queue::ClientQueue;
use super::download::Download;
use super::facts::{FactChange, FactError};
use super::locked::locked;
use glam::DVec3;
use serde_json::Value;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::oneshot;
use wm_viewer::View;
use wm_viewer::pace::Pace;

/// Maximum number of connected clients.
pub(crate) const MAX_CLIENTS: usize = 16;
/// Maximum number of frames that were sent to a client and not acknowledged.
const MAX_UNSEEN: usize = 3;
/// Maximum number of waiting commands.
const MAX_COMMANDS: usize = 32;
/// Time after which a frame that was not acknowledged counts as lost.
const LOST_AFTER: Duration = Duration::from_secs(10);

/// A view that a client asks to see.
#[derive(Clone)]
pub(crate) struct ViewRequest {
    /// The view to render.
    pub(crate) view: Arc<View>,
    /// The client's sequence number of the request.
    pub(crate) seq: u64,
    /// True while the view is changing: a draft is enough.
    pub(crate) is_moving: bool,
}

/// A request for something other than a client's next frame.
pub(crate) enum ViewerCommand {
    /// Renders a picture as a file.
    Picture {
        /// The view to render.
        view: Arc<View>,
        /// The file format.
        format: ResponseFormat,
        /// Receives the file.
        reply: oneshot::Sender<Result<Download, String>>,
    },
    /// Makes the points of the view's lidar as a file.
    Points {
        /// The view, which has a lidar.
        view: Arc<View>,
        /// Receives the PLY file that `scan` writes.
        reply: oneshot::Sender<Result<Download, String>>,
    },
    /// Finds the point of the scene that is seen at a point of the picture.
    Pick {
        /// The view that is displayed.
        view: Arc<View>,
        /// Position from the left and the top, as a fraction of the picture's sides, 0-1.
        at: [f64; 2],
        /// Receives the point.
        client_queue: Arc<ClientQueue>,
    },
    /// Finds the point of the nearest surface at a point of the picture.
    Surface {
        /// The view that is displayed.
        view: Arc<View>,
        /// Position from the left and the top, as a fraction of the picture's sides, 0-1.
        at: [f64; 2],
        /// Receives the point, scene units; `None` where there is only sky.
        reply: oneshot::Sender<Result<Option<DVec3>, String>>,
    },
    /// Changes the facts of the scene.
    Facts {
        /// The change.
        change: FactChange,
        /// Receives the facts as JSON.
        reply: oneshot::Sender<Result<Value, FactError>>,
    },
    /// Renders a video.
    Video {
        /// The view of its first frame.
        view: Arc<View>,
        /// The video to write.
        job: Arc<super::videos::ViewerVideo>,
    },
    /// Renders the thumbnail of the preset with this name.
    Thumbnail(String),
}

impl ViewerCommand {
    /// Returns true if nobody waits for the answer any more.
    pub(crate) fn is_abandoned(&self) -> bool {
        match self {
            Self::Picture { reply, .. } | Self::Points { reply, .. } => reply.is_closed(),
            Self::Surface { reply, .. } => reply.is_closed(),
            Self::Pick { .. } | Self::Facts { .. } | Self::Video { .. } | Self::Thumbnail(_) => false,
        }
    }

    /// Answers with the reason why the command is not carried out, in one line.
    pub(crate) fn refuse(self, why: String) {
        // The client may have disconnected.
        match self {
            Self::Picture { reply, .. } | Self::Points { reply, .. } => _ = reply.send(Err(why)),
            Self::Surface { reply, .. } => _ = reply.send(Err(why)),
            Self::Facts { reply, .. } => _ = reply.send(Err(FactError::Failed(why))),
            Self::Pick { client_queue, .. } => client_queue.push_error(&why),
            Self::Video { job, .. } => job.end(Err(why)),
            Self::Thumbnail(_) => {}
        }
    }
}

/// File format of a rendered picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ResponseFormat {
    /// The PNG file that `render` writes.
    Png,
    /// A JPEG of the state's quality.
    Jpeg,
}

/// The next frame of a client.
pub(crate) struct ClientTask {
    /// The client's id.
    pub(crate) client: u64,
    /// The client's latest request.
    pub(crate) request: ViewRequest,
    /// Receives the frame.
    pub(crate) client_queue: Arc<ClientQueue>,
    /// Size of a frame while the view is moving, px.
    pub(crate) small: (u32, u32),
}

/// The next thing for the render worker to do.
pub(crate) enum WorkerTask {
    /// Render a client's frame.
    Client(ClientTask),
    /// Carry out a command.
    Command(ViewerCommand),
}

struct Client {
    id: u64,
    client_queue: Arc<ClientQueue>,
    request: Option<ViewRequest>,
    /// True if a draft was sent and the assets for the complete frame are being made.
    waits: bool,
    pace: Pace,
    /// Sequence number and time of each frame that was sent and not acknowledged.
    unseen: VecDeque<(u64, Instant)>,
    /// Time from sending a frame to its acknowledgement, seconds.
    on_its_way: f64,
    moved: Option<Instant>,
}

impl Client {
    fn can_receive(&self) -> bool {
        self.unseen.len() < MAX_UNSEEN
            || self.unseen.front().is_some_and(|(_, sent)| sent.elapsed() > LOST_AFTER)
    }

    fn is_ready(&self, moving: bool) -> bool {
        self.can_receive()
            && !self.waits
            && self.request.as_ref().is_some_and(|request| request.is_moving == moving)
    }

    fn is_moving(&self) -> bool {
        self.moved.is_some_and(|at| at.elapsed() < Duration::from_millis(500))
    }
}

#[derive(Default)]
struct QueueState {
    clients: Vec<Client>,
    commands: VecDeque<ViewerCommand>,
    /// Names of presets whose thumbnails are rendered when idle.
    thumbnails: VecDeque<String>,
    last_id: u64,
    /// Id of the client that was served last.
    served: u64,
    /// True if the last task that was not moving was a client's.
    was_client: bool,
    /// Time of the last request or command.
    asked: Option<Instant>,
    /// True if the worker must return from waiting without a task.
    is_woken: bool,
}

/// Latest request of each client, and waiting commands.
#[derive(Default)]
pub(crate) struct RequestQueue {
    state: Mutex<QueueState>,
    changed: Condvar,
}

/// Time without requests after which thumbnails are rendered.
const IDLE_AFTER: Duration = Duration::from_millis(1500);

impl RequestQueue {
    /// Changes the state, and wakes the worker if it waits.
    fn change<T>(&self, change: impl FnOnce(&mut QueueState) -> T) -> T {
        let changed = change(&mut locked(&self.state));
        self.changed.notify_all();
        changed
    }

    /// Adds a client and returns its id; `None` if there are too many.
    pub(crate) fn add_client(&self, client_queue: Arc<ClientQueue>) -> Option<u64> {
        let mut state = locked(&self.state);
        if state.clients.len() >= MAX_CLIENTS {
            return None;
        }
        state.last_id += 1;
        let id = state.last_id;
        state.clients.push(Client {
            id,
            client_queue,
            request: None,
            waits: false,
            pace: Pace::default(),
            unseen: VecDeque::new(),
            on_its_way: 0.0,
            moved: None,
        });
        Some(id)
    }

    /// Removes a client.
    pub(crate) fn remove_client(&self, id: u64) {
        locked(&self.state).clients.retain(|client| client.id != id);
    }

    /// Sets the request of a client, in place of its previous one.
    pub(crate) fn set_request(&self, id: u64, request: ViewRequest) {
        self.change(|state| {
            state.asked = Some(Instant::now());
            if let Some(client) = state.client(id) {
                client.moved = request.is_moving.then(Instant::now);
                (client.request, client.waits) = (Some(request), false);
            }
        });
    }

    /// Records that a client displays the frame `seq`.
    pub(crate) fn acknowledge_frame(&self, id: u64, seq: u64) {
        self.change(|state| {
            let Some(client) = state.client(id) else { return };
            if let Some((_, sent)) = client.unseen.iter().find(|(sent, _)| *sent == seq) {
                client.on_its_way = sent.elapsed().as_secs_f64();
            }
            client.unseen.retain(|(sent, _)| *sent > seq);
        });
    }

    /// Appends a command.
    ///
    /// # Errors
    /// Gives the command back if too many are waiting.
    pub(crate) fn push_command(&self, command: ViewerCommand) -> Result<(), ViewerCommand> {
        self.change(|state| {
            if state.commands.len() >= MAX_COMMANDS {
                return Err(command);
            }
            state.asked = Some(Instant::now());
            state.commands.push_back(command);
            Ok(())
        })
    }

    /// Asks for thumbnails of presets, to be rendered when there is nothing else to do.
    pub(crate) fn request_thumbnails(&self, names: impl IntoIterator<Item = String>) {
        self.change(|state| {
            for name in names {
                if !state.thumbnails.contains(&name) {
                    state.thumbnails.push_back(name);
                }
            }
        });
    }

    /// Lets requests continue that waited for assets. The client that the assets were made for is
    /// served first, before others need different ones.
    pub(crate) fn resume_waiting(&self, client: Option<u64>) {
        self.change(|state| {
            state.clients.iter_mut().for_each(|client| client.waits = false);
            state.served = client.map_or(state.served, |id| id.saturating_sub(1));
        });
    }

    /// Returns true if a client waits for the rest of the frame that it was sent for its request
    /// `seq`.
    pub(crate) fn is_waiting(&self, id: u64, seq: u64) -> bool {
        let state = locked(&self.state);
        let client = state.clients.iter().find(|client| client.id == id);
        client.is_some_and(|client| {
            client.waits && client.request.as_ref().is_some_and(|request| request.seq == seq)
        })
    }

    /// Makes the current or next call of [`Self::next_task`] return without a task.
    pub(crate) fn wake_worker(&self) {
        self.change(|state| state.is_woken = true);
    }

    /// Sends a text message to every client.
    pub(crate) fn broadcast(&self, text: &str) {
        for client in &locked(&self.state).clients {
            client.client_queue.push_message(text.to_owned());
        }
    }

    /// The number of clients.
    pub(crate) fn client_count(&self) -> usize {
        locked(&self.state).clients.len()
    }

    /// Records that a frame was sent in answer to the request `seq` of a client.
    pub(crate) fn finish_request(&self, id: u64, seq: u64, outcome: RequestOutcome) {
        let mut state = locked(&self.state);
        let sharing = state.clients.iter().filter(|client| client.is_moving()).count();
        let Some(client) = state.client(id) else { return };
        client.unseen.push_back((seq, Instant::now()));
        if client.unseen.len() > MAX_UNSEEN {
            client.unseen.pop_front();
        }
        match outcome {
            RequestOutcome::Draft(seconds) => client.pace.learn(seconds, sharing, client.on_its_way),
            RequestOutcome::Incomplete => {
                let is_same = client.request.as_ref().is_none_or(|request| request.seq == seq);
                client.waits = is_same;
                return;
            }
            RequestOutcome::Complete => {}
        }
        // A newer request may have arrived meanwhile.
        if client.request.as_ref().is_some_and(|request| request.seq == seq) {
            client.request = None;
        }
    }

    /// Tells a client why it gets no frame for its request, or none but the draft that it has. A
    /// request that came since is kept if `seq` is given.
    pub(crate) fn fail_request(&self, id: u64, seq: Option<u64>, why: &str) {
        let mut state = locked(&self.state);
        let Some(client) = state.client(id) else { return };
        client.client_queue.push_error(why);
        client.waits = false;
        client.request.take_if(|request| seq.is_none_or(|seq| request.seq == seq));
    }

    /// Waits for the next task; `None` if there is none within `timeout`, or after
    /// [`Self::wake_worker`].
    pub(crate) fn next_task(&self, timeout: Duration) -> Option<WorkerTask> {
        let mut state = locked(&self.state);
        let end = Instant::now() + timeout;
        loop {
            if std::mem::take(&mut state.is_woken) {
                return None;
            }
            if let Some(task) = state.next_task() {
                return Some(task);
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return None;
            }
            state = self.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

/// Result of rendering a client's request.
pub(crate) enum RequestOutcome {
    /// A draft of a moving view, and the seconds that it took.
    Draft(f64),
    /// A draft, shown until missing assets are made.
    Incomplete,
    /// The complete frame.
    Complete,
}

impl QueueState {
    fn client(&mut self, id: u64) -> Option<&mut Client> {
        self.clients.iter_mut().find(|client| client.id == id)
    }

    fn next_task(&mut self) -> Option<WorkerTask> {
        if let Some(task) = self.next_client(true) {
            return Some(WorkerTask::Client(task));
        }
        // Commands and frames of views at rest take turns.
        if self.was_client
            && let Some(command) = self.commands.pop_front()
        {
            self.was_client = false;
            return Some(WorkerTask::Command(command));
        }
        if let Some(task) = self.next_client(false) {
            self.was_client = true;
            return Some(WorkerTask::Client(task));
        }
        let command = self.commands.pop_front().or_else(|| {
            let is_idle = self.asked.is_none_or(|asked| asked.elapsed() > IDLE_AFTER);
            self.thumbnails.pop_front_if(|_| is_idle).map(ViewerCommand::Thumbnail)
        });
        command.map(WorkerTask::Command)
    }

    /// Takes the request of the next client after the one served last, among those whose view is
    /// `moving` or not.
    fn next_client(&mut self, moving: bool) -> Option<ClientTask> {
        let served = self.served;
        let ready = || self.clients.iter().filter(|client| client.is_ready(moving));
        let client = ready().find(|client| client.id > served).or_else(|| ready().next())?;
        let request = client.request.clone()?;
        let task = ClientTask {
            client: client.id,
            client_queue: Arc::clone(&client.client_queue),
            small: client.pace.size(request.view.state.size),
            request,
        };
        self.served = task.client;
        Some(task)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_viewer::testing::view;

    fn queue(pages: usize) -> (RequestQueue, Vec<u64>) {
        let queue = RequestQueue::default();
        let ids = (0..pages).map(|_| queue.add_client(Arc::default()).unwrap()).collect();
        (queue, ids)
    }

    fn request(queue: &RequestQueue, id: u64, seq: u64, is_moving: bool) {
        queue.set_request(id, ViewRequest { view: view(), seq, is_moving });
    }

    /// Returns client and sequence number of the next task, zeros for a command.
    fn next(queue: &RequestQueue) -> Option<(u64, u64)> {
        match queue.next_task(Duration::ZERO)? {
            WorkerTask::Client(task) => Some((task.client, task.request.seq)),
            WorkerTask::Command(_) => Some((0, 0)),
        }
    }

    fn command(queue: &RequestQueue) {
        let (reply, _) = oneshot::channel();
        queue
            .push_command(ViewerCommand::Picture { view: view(), format: ResponseFormat::Jpeg, reply })
            .ok()
            .unwrap();
    }

    #[test]
    fn clients_take_turns_and_only_their_latest_request_counts() {
        let (queue, ids) = queue(3);
        for seq in 1..=5 {
            ids.iter().for_each(|id| request(&queue, *id, seq, true));
        }
        for id in &ids {
            assert_eq!(next(&queue), Some((*id, 5)));
            queue.finish_request(*id, 5, RequestOutcome::Draft(0.01));
        }
        assert_eq!(next(&queue), None);
        // The client that was just served comes last.
        for id in [ids[2], ids[0]] {
            request(&queue, id, 6, true);
        }
        assert_eq!(next(&queue), Some((ids[0], 6)));
    }

    #[test]
    fn a_newer_request_is_kept() {
        let (queue, ids) = queue(1);
        request(&queue, ids[0], 1, true);
        assert_eq!(next(&queue), Some((ids[0], 1)));
        request(&queue, ids[0], 2, false);
        queue.finish_request(ids[0], 1, RequestOutcome::Draft(0.01));
        assert_eq!(next(&queue), Some((ids[0], 2)));
        queue.finish_request(ids[0], 2, RequestOutcome::Complete);
        assert_eq!(next(&queue), None);
    }

    #[test]
    fn a_client_that_acknowledges_nothing_gets_no_more_frames() {
        let (queue, ids) = queue(1);
        for seq in 1..=MAX_UNSEEN as u64 {
            request(&queue, ids[0], seq, true);
            assert_eq!(next(&queue), Some((ids[0], seq)));
            queue.finish_request(ids[0], seq, RequestOutcome::Draft(0.01));
        }
        request(&queue, ids[0], 9, true);
        assert_eq!(next(&queue), None);
        queue.acknowledge_frame(ids[0], 1);
        assert_eq!(next(&queue), Some((ids[0], 9)));
        queue.remove_client(ids[0]);
        assert_eq!(next(&queue), None);
    }

    #[test]
    fn waiting_requests_are_resumed() {
        let (queue, ids) = queue(2);
        ids.iter().for_each(|id| request(&queue, *id, 1, false));
        for id in &ids {
            assert_eq!(next(&queue), Some((*id, 1)));
            queue.finish_request(*id, 1, RequestOutcome::Incomplete);
            queue.acknowledge_frame(*id, 1);
        }
        assert_eq!(next(&queue), None);
        // The client that the assets were made for comes first.
        queue.resume_waiting(Some(ids[1]));
        assert_eq!(next(&queue), Some((ids[1], 1)));
    }

    #[test]
    fn moving_views_come_first_and_commands_take_turns_with_the_rest() {
        let (queue, ids) = queue(2);
        (0..2).for_each(|_| command(&queue));
        request(&queue, ids[0], 1, false);
        request(&queue, ids[1], 1, true);
        assert_eq!(next(&queue), Some((ids[1], 1)));
        queue.finish_request(ids[1], 1, RequestOutcome::Draft(0.01));
        assert_eq!(next(&queue), Some((ids[0], 1)));
        queue.finish_request(ids[0], 1, RequestOutcome::Complete);
        request(&queue, ids[0], 2, false);
        assert_eq!(next(&queue), Some((0, 0)));
        assert_eq!(next(&queue), Some((ids[0], 2)));
    }

    #[test]
    fn a_request_that_fails_is_not_served_again() {
        let (queue, ids) = queue(1);
        request(&queue, ids[0], 1, false);
        assert_eq!(next(&queue), Some((ids[0], 1)));
        queue.fail_request(ids[0], Some(1), "why");
        assert_eq!(next(&queue), None);
        // A later one is, however many failed.
        for seq in 2..10 {
            request(&queue, ids[0], seq, false);
            queue.fail_request(ids[0], Some(seq - 1), "why");
            assert_eq!(next(&queue), Some((ids[0], seq)));
        }
        queue.fail_request(ids[0], None, "why");
        assert_eq!(next(&queue), None);
    }

    #[test]
    fn waking_the_worker_returns_at_once() {
        let (queue, ids) = queue(1);
        request(&queue, ids[0], 1, true);
        queue.wake_worker();
        assert_eq!(next(&queue), None);
        assert_eq!(next(&queue), Some((ids[0], 1)));
    }

    #[test]
    fn clients_and_commands_are_limited() {
        let (queue, _) = queue(MAX_CLIENTS);
        assert_eq!(queue.add_client(Arc::default()), None);
        (0..MAX_COMMANDS).for_each(|_| command(&queue));
        let (reply, _) = oneshot::channel();
        assert!(
            queue
                .push_command(ViewerCommand::Picture { view: view(), format: ResponseFormat::Png, reply })
                .is_err()
        );
    }
}
