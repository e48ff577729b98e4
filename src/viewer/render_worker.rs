//! The render worker: the only owner of the scene, which carries out one task after the other. A
//! task that fails, also by a panic, is answered with the reason, and the next one follows.
//!
//! Assets that take seconds to make (snow covers, shelter maps) are made on a second thread; until
//! then frames are rendered without them.

use super::context::ViewerContext;
use super::download::Download;
use super::facts::{FactChange, FactEditor, FactError};
use super::request_queue::{
    ClientTask, RequestOutcome, ResponseFormat, ViewRequest, ViewerCommand, WorkerTask,
};
use super::videos::{VideoWriter, ViewerVideo};
use crate::interrupt;
use anyhow::{Context, Result, anyhow, bail};
use axum::body::Bytes;
use glam::DVec3;
use serde_json::{Value, json};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};
use weather_magician::assets::{Assets, MissingAssets};
use weather_magician::output::{PictureFormat, PictureStyle};
use weather_magician::{
    CameraMotion, FrameRequest, Patience, PictureLayer, PlaceFacts, PreparedPlace, Progress, Renderer,
    picture_tags,
};
use wm_media::color::Dither;
use wm_media::{PictureSize, video};
#[cfg(feature = "gpu")]
use wm_render::{RenderError, gpu::GpuError};
use wm_render::{Stats, at_once};
use wm_scene::Camera;
use wm_viewer::encode::jpeg;
use wm_viewer::lidar::SweepMemory;
use wm_viewer::paint::{FrameReport, PaintOptions};
use wm_viewer::thumbnail::{self, ThumbnailShot, thumbnail_view};
use wm_viewer::{View, ViewPainter};
use wm_weather::Weather;

/// Longest wait for a task before the worker checks for Ctrl-C and for finished assets.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Longest time between two frames of a video while other requests are waiting.
const VIDEO_FRAME_EVERY: Duration = Duration::from_millis(500);
/// Least and greatest time from a frame without its points to the sweep that makes them: a hand may
/// pause, and other pages may not.
const SWEEP_WITHIN: [Duration; 2] = [Duration::from_millis(150), Duration::from_millis(1000)];
/// Most commands that wait for assets.
const MAX_WAITING: usize = 64;
/// JPEG quality of drafts.
const DRAFT_QUALITY: u8 = 72;

/// Renders for all clients.
pub(crate) struct RenderWorker {
    context: Arc<ViewerContext>,
    renderer: Renderer,
    place: PreparedPlace,
    facts: FactEditor,
    pending: Option<PendingAssets>,
    /// Commands that wait for assets.
    waiting: Vec<ViewerCommand>,
    video: Option<ActiveVideo>,
    sweeps: SweepMemory,
    due: Vec<DueSweep>,
    painter: ViewPainter,
    /// The facts in use, with which the place is made anew after a panic.
    sound_facts: PlaceFacts,
    /// The failure that ends the program.
    broken: Option<anyhow::Error>,
}

/// The owner that is told if assets cannot be made.
#[derive(Clone, Copy, Debug)]
enum AssetOwner {
    /// A client, by its id.
    Client(u64),
    /// A command that waits for them, by its place among those that wait.
    Waiting(usize),
    /// The running video.
    Video,
    /// Nobody: a view that moves asks again.
    Nobody,
}

/// A frame for a client.
struct ServedFrame {
    message: Bytes,
    is_whole: bool,
    lacks_sweep: bool,
}

/// A sweep that a client's frame waits for.
struct DueSweep {
    client: u64,
    seq: u64,
    view: Arc<View>,
    since: Instant,
}

/// Missing assets while they are being made.
struct PendingAssets {
    receive: Receiver<Result<Assets, weather_magician::Error>>,
    owner: AssetOwner,
    is_stopped: Arc<AtomicBool>,
}

/// Stops the work of the second thread when its assets are not needed any more.
struct Stop(Arc<AtomicBool>);

impl Progress for Stop {
    fn is_stopped(&mut self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// A video that is being rendered.
struct ActiveVideo {
    view: Arc<View>,
    motion: CameraMotion,
    video: Arc<ViewerVideo>,
    writer: VideoWriter,
    next: u32,
    last: Instant,
}

impl RenderWorker {
    /// Returns a worker for a loaded scene.
    pub(crate) fn new(
        context: Arc<ViewerContext>,
        renderer: Renderer,
        place: PreparedPlace,
        facts: FactEditor,
    ) -> Self {
        Self {
            sound_facts: place.facts(),
            broken: None,
            context,
            renderer,
            place,
            facts,
            pending: None,
            waiting: Vec::new(),
            video: None,
            sweeps: SweepMemory::default(),
            due: Vec::new(),
            painter: ViewPainter::default(),
        }
    }

    /// Works until Ctrl-C.
    ///
    /// # Errors
    /// The renderer fails for all clients: the GPU is lost, or the place cannot be made anew.
    pub(crate) fn run(&mut self) -> Result<()> {
        while !interrupt::asked() {
            if let Some(error) = self.broken.take() {
                return Err(error);
            }
            self.collect_assets();
            if self.pending.is_none() {
                std::mem::take(&mut self.waiting).into_iter().for_each(|command| self.execute(command));
            }
            let is_due = self.video.as_ref().is_some_and(|video| video.last.elapsed() > VIDEO_FRAME_EVERY);
            if is_due {
                self.render_video_frame();
                continue;
            }
            let waited = self.due.first().map(|due| due.since.elapsed());
            if waited.is_some_and(|waited| waited > SWEEP_WITHIN[1]) {
                self.make_due_sweep();
                continue;
            }
            let patience = match waited {
                _ if self.video.is_some() && self.pending.is_none() => Duration::ZERO,
                Some(waited) => SWEEP_WITHIN[0].saturating_sub(waited),
                None => POLL_INTERVAL,
            };
            match self.context.queue.next_task(patience) {
                Some(WorkerTask::Client(task)) => self.serve_client(task),
                Some(WorkerTask::Command(command)) => self.execute(command),
                None if waited.is_some_and(|waited| waited >= SWEEP_WITHIN[0]) => self.make_due_sweep(),
                None => self.render_video_frame(),
            }
        }
        Ok(())
    }

    /// Does the work of one task. A panic in it is an error of this task; what it may have left
    /// half made is made anew.
    ///
    /// # Errors
    /// The error of the work, or its panic in words.
    fn attempt<T>(&mut self, work: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        let outcome = catch_unwind(AssertUnwindSafe(|| work(self))).unwrap_or_else(|panic| {
            self.recover();
            Err(anyhow!("the program failed at this: {}", words_of(&*panic)))
        });
        outcome.inspect_err(|error| {
            if is_lost(error) {
                self.broken = Some(anyhow!("{error:#}"));
            }
        })
    }

    /// Makes anew all that a panic may have left half made: what was derived from the scene by its
    /// facts, and the memory of frames.
    fn recover(&mut self) {
        self.stop_pending();
        self.painter = ViewPainter::default();
        self.sweeps.clear();
        let Self { renderer, place, sound_facts, .. } = self;
        let renewed = catch_unwind(AssertUnwindSafe(|| renderer.set_facts(place, sound_facts.clone())));
        self.broken = match renewed {
            Ok(Ok(())) => None,
            Ok(Err(error)) => Some(error.into()),
            Err(panic) => Some(anyhow!("the scene cannot be made anew: {}", words_of(&*panic))),
        };
    }

    /// Stops making assets. Others are made once the thread has ended, so that there is never more
    /// than one with its memory; whoever waits for them asks again.
    fn stop_pending(&mut self) {
        if let Some(pending) = &self.pending {
            pending.is_stopped.store(true, Ordering::Relaxed);
            self.context.queue.broadcast(&json!({ "type": "status", "text": "" }).to_string());
        }
        self.context.queue.resume_waiting(None);
    }

    /// Inserts the assets that the second thread has finished.
    fn collect_assets(&mut self) {
        let Some(PendingAssets { receive, owner, is_stopped }) = &self.pending else { return };
        let (owner, is_stopped) = (*owner, is_stopped.load(Ordering::Relaxed));
        let made = match receive.try_recv() {
            Err(TryRecvError::Empty) => return,
            Err(TryRecvError::Disconnected) => {
                Err(anyhow!("the program failed while it prepared the scene for this weather"))
            }
            Ok(made) => made.map_err(anyhow::Error::from),
        };
        self.pending = None;
        if is_stopped {
            return self.context.queue.resume_waiting(None);
        }
        let insert =
            |worker: &mut Self, assets| Ok(worker.renderer.insert_assets(&mut worker.place, assets)?);
        let inserted = made.and_then(|assets| self.attempt(|worker| insert(worker, assets)));
        if let Err(error) = inserted {
            self.refuse(owner, &format!("{error:#}"));
        }
        self.context.queue.broadcast(&json!({ "type": "status", "text": "" }).to_string());
        let client = if let AssetOwner::Client(client) = owner { Some(client) } else { None };
        self.context.queue.resume_waiting(client);
    }

    /// Tells the owner of assets why there are none.
    fn refuse(&mut self, owner: AssetOwner, why: &str) {
        match owner {
            AssetOwner::Client(client) => self.context.queue.fail_request(client, None, why),
            AssetOwner::Waiting(index) if index < self.waiting.len() => {
                self.waiting.remove(index).refuse(why.into());
            }
            AssetOwner::Video => {
                self.video.take().iter().for_each(|active| active.video.end(Err(why.into())));
            }
            AssetOwner::Waiting(_) | AssetOwner::Nobody => {}
        }
    }

    /// Returns true if all assets for a weather at `time` exist; otherwise starts to make them.
    fn ensure_assets(
        &mut self,
        weather: &Weather,
        camera: &Camera,
        time: f64,
        owner: AssetOwner,
    ) -> Result<bool> {
        // What is being made is of the place that the last camera was in.
        if self.pending.is_some() && !self.place.is_focused(weather, camera) {
            return Ok(false);
        }
        self.renderer.focus(&mut self.place, weather, camera)?;
        let missing = self.place.missing_assets(weather, time);
        let is_ready = missing.is_empty();
        if !is_ready && self.pending.is_none() {
            self.start_assets(missing, owner)?;
        }
        Ok(is_ready)
    }

    /// Starts to make missing assets, and tells the clients.
    fn start_assets(&mut self, missing: MissingAssets, owner: AssetOwner) -> Result<()> {
        self.context.queue.broadcast(&json!({ "type": "status", "text": missing.description() }).to_string());
        self.spawn_assets(missing, owner)
    }

    fn spawn_assets(&mut self, mut missing: MissingAssets, owner: AssetOwner) -> Result<()> {
        let source = self.renderer.asset_source(&mut self.place, &mut missing)?;
        let (send, receive) = channel();
        let (context, is_stopped) = (Arc::clone(&self.context), Arc::<AtomicBool>::default());
        let mut stop = Stop(Arc::clone(&is_stopped));
        std::thread::Builder::new().name("prepare".into()).spawn(move || {
            // The worker may have ended, or the facts may be others.
            let _ = send.send(missing.make(source, &mut stop));
            context.queue.wake_worker();
        })?;
        self.pending = Some(PendingAssets { receive, owner, is_stopped });
        Ok(())
    }

    /// Renders the frame of a client.
    fn serve_client(&mut self, task: ClientTask) {
        let ClientTask { client, request, client_queue, small } = task;
        let started = Instant::now();
        let served = self.attempt(|worker| worker.client_frame(client, &request, small));
        self.due.retain(|due| due.client != client);
        let ServedFrame { message, is_whole, lacks_sweep } = match served {
            Ok(frame) => frame,
            Err(error) => {
                return self.context.queue.fail_request(client, Some(request.seq), &format!("{error:#}"));
            }
        };
        client_queue.set_picture(message);
        let outcome = match (request.is_moving, is_whole) {
            (true, _) => RequestOutcome::Draft(started.elapsed().as_secs_f64()),
            (false, false) => RequestOutcome::Incomplete,
            (false, true) => RequestOutcome::Complete,
        };
        self.context.queue.finish_request(client, request.seq, outcome);
        if lacks_sweep {
            self.due.push(DueSweep { client, seq: request.seq, view: request.view, since: Instant::now() });
        }
    }

    /// Returns the frame of a client's request, a draft if it moves or if assets are missing.
    fn client_frame(&mut self, client: u64, request: &ViewRequest, small: (u32, u32)) -> Result<ServedFrame> {
        let (view, started) = (&request.view, Instant::now());
        let (weather, time) = (&view.weather, view.state.time);
        let is_ready = if request.is_moving {
            // Assets that are made quickly are made for moving views too.
            let missing = self.place.missing_assets(weather, time);
            if missing.is_quick() && self.pending.is_none() {
                self.start_assets(missing, AssetOwner::Nobody)?;
            }
            false
        } else {
            self.ensure_assets(weather, &view.camera(), time, AssetOwner::Client(client))?
        };
        let full = view.size();
        let (size, patience, quality, dither) = match (request.is_moving, is_ready) {
            (true, _) => (small, Patience::Draft, DRAFT_QUALITY, Dither::Off),
            (false, false) => (full, Patience::Draft, view.state.quality, Dither::Ordered),
            (false, true) => (full, Patience::Whole, view.state.quality, Dither::Ordered),
        };
        // The picture does not wait for its points.
        let lacks_sweep = is_ready && view.lidar.is_some() && self.sweeps.get(view).is_none();
        let is_whole = is_ready && !lacks_sweep;
        let (rgb, stats) = self.draw(view, PaintOptions { size, patience, dither })?;
        let drew = started.elapsed().as_secs_f64();
        let jpeg = jpeg(&rgb, size, quality)?;
        let took = started.elapsed().as_secs_f64();
        let report =
            FrameReport { seq: request.seq, size, is_whole, stats: &stats, seconds: [drew, took - drew] };
        let head = report.header(view, self.place.site(), self.sweeps.report(view));
        Ok(ServedFrame { message: join_message(&head.to_string(), &jpeg), is_whole, lacks_sweep })
    }

    /// Makes the sweep that a client has waited for the longest, unless it asks for something else
    /// by now.
    fn make_due_sweep(&mut self) {
        if self.due.is_empty() {
            return;
        }
        let DueSweep { client, seq, view, .. } = self.due.remove(0);
        if !self.context.queue.is_waiting(client, seq) {
            return;
        }
        // The words of assets that are being made stay.
        let says = self.pending.is_none();
        let status = |text: &str| says.then(|| json!({ "type": "status", "text": text }).to_string());
        status("scanning").iter().for_each(|text| self.context.queue.broadcast(text));
        let made = self.attempt(|worker| {
            worker.ensure_sweep(&view);
            Ok(())
        });
        status("").iter().for_each(|text| self.context.queue.broadcast(text));
        match made {
            Ok(()) => self.context.queue.resume_waiting(Some(client)),
            Err(error) => self.context.queue.fail_request(client, Some(seq), &format!("{error:#}")),
        }
    }

    /// Makes the sweep of a view that has a lidar, unless it was made.
    fn ensure_sweep(&mut self, view: &Arc<View>) {
        let (Some(lidar), Some(motion)) = (&view.lidar, view.sensor_motion()) else { return };
        if self.sweeps.get(view).is_some() {
            return;
        }
        let (options, started) = (lidar.options(view.state.time), Instant::now());
        let Self { renderer, place, .. } = self;
        let made = renderer.scan_once(place, &view.weather, &lidar.model, &motion, &options);
        self.sweeps.insert(view, made.map_err(|error| error.to_string()), started.elapsed().as_secs_f64());
    }

    /// Renders a view as bytes `[H, W, 3]`, without weather left of its divider, and with the
    /// points of its lidar.
    fn draw(&mut self, view: &View, options: PaintOptions) -> Result<(Vec<u8>, Stats)> {
        let overlay = self.sweeps.overlay(view);
        let Self { renderer, place, painter, .. } = self;
        Ok(at_once(painter.draw(renderer, place, view, overlay.as_deref(), options))?)
    }

    /// Carries out a command, or keeps it until its assets exist.
    fn execute(&mut self, command: ViewerCommand) {
        if command.is_abandoned() {
            return;
        }
        if let ViewerCommand::Picture { view, .. } | ViewerCommand::Points { view, .. } = &command {
            let (view, owner) = (Arc::clone(view), AssetOwner::Waiting(self.waiting.len()));
            let ready = self.attempt(|worker| {
                worker.ensure_assets(&view.weather, &view.camera(), view.state.time, owner)
            });
            match ready {
                Ok(true) => {}
                Ok(false) => return self.wait(command),
                Err(error) => return command.refuse(format!("{error:#}")),
            }
        }
        // Clients may have disconnected.
        match command {
            ViewerCommand::Picture { view, format, reply } => {
                let picture = self.attempt(|worker| match format {
                    ResponseFormat::Png => worker.encode_png(&view),
                    ResponseFormat::Jpeg => worker.encode_jpeg(&view),
                });
                let _ = reply.send(picture.map_err(|error| format!("{error:#}")));
            }
            ViewerCommand::Points { view, reply } => {
                let points = self.attempt(|worker| worker.encode_points(&view));
                let _ = reply.send(points.map_err(|error| format!("{error:#}")));
            }
            ViewerCommand::Pick { view, at, client_queue } => {
                let point = self.attempt(|worker| {
                    let Self { renderer, place, painter, .. } = worker;
                    Ok(at_once(painter.pick(renderer, place, &view, at))?)
                });
                match point {
                    Ok(point) => {
                        client_queue.push_message(json!({ "type": "picked", "point": point }).to_string());
                    }
                    Err(error) => client_queue.push_error(&format!("{error:#}")),
                }
            }
            ViewerCommand::Surface { view, at, reply } => {
                let point = self.attempt(|worker| worker.surface_at(&view, at));
                let _ = reply.send(point.map_err(|error| format!("{error:#}")));
            }
            ViewerCommand::Facts { change, reply } => {
                let _ = reply.send(self.change_facts(change));
            }
            ViewerCommand::Video { view, job } => {
                if let Err(error) = self.attempt(|worker| worker.start_video(&view, &job)) {
                    job.end(Err(format!("{error:#}")));
                }
            }
            ViewerCommand::Thumbnail(name) => {
                // A preset without its picture is no harm.
                if let Ok(Some(waits)) = self.attempt(|worker| worker.render_thumbnail(name)) {
                    self.wait(waits);
                }
            }
        }
    }

    /// Keeps a command until the assets that are being made exist.
    fn wait(&mut self, command: ViewerCommand) {
        if self.waiting.len() < MAX_WAITING {
            self.waiting.push(command);
        } else {
            command.refuse("too many requests at once".into());
        }
    }

    /// Returns the PLY file that `scan` writes.
    fn encode_points(&mut self, view: &Arc<View>) -> Result<Download> {
        self.ensure_sweep(view);
        let sweep = self.sweeps.get(view).context("a view without a lidar has no points")?;
        let sweep = sweep.as_ref().map_err(|error| anyhow!("{error}"))?;
        let folder = self.context.workshop.subfolder().map_err(anyhow::Error::msg)?;
        let path = folder.path().join("points.ply");
        sweep.save(&path)?;
        Ok(Download::open(&path, folder)?)
    }

    fn encode_jpeg(&mut self, view: &Arc<View>) -> Result<Download> {
        self.ensure_sweep(view);
        if let Some(Err(error)) = self.sweeps.get(view) {
            bail!("{error}");
        }
        let size = view.size();
        let (rgb, _) =
            self.draw(view, PaintOptions { size, patience: Patience::Whole, dither: Dither::Ordered })?;
        let folder = self.context.workshop.subfolder().map_err(anyhow::Error::msg)?;
        Ok(Download::of_bytes(jpeg(&rgb, size, view.state.quality)?, folder.path())?)
    }

    /// Returns the PNG file that `render` writes.
    fn encode_png(&mut self, view: &View) -> Result<Download> {
        let style = self.style(view, &view.camera(), view.state.time);
        let folder = self.context.workshop.subfolder().map_err(anyhow::Error::msg)?;
        let Self { renderer, place, painter, .. } = self;
        let picture = at_once(painter.render(renderer, place, view))?;
        let path = folder.path().join("picture.png");
        match view.state.output.layer() {
            PictureLayer::Color => _ = style.write(picture, &path)?,
            layer => _ = style.write_layer(layer, PictureFormat::Png, picture, &path)?,
        }
        Ok(Download::open(&path, folder)?)
    }

    fn style(&self, view: &View, camera: &Camera, time: f64) -> PictureStyle {
        let (catalog, site) = (self.context.catalog(), self.place.site());
        let scene = catalog.words[0].to_string_lossy();
        PictureStyle {
            tags: picture_tags(&scene, site, self.renderer.backend(), &view.weather, time, camera),
            ..PictureStyle::default()
        }
    }

    /// Returns the point of the nearest surface at `at` (x and y, 0-1) of the picture; `None` where
    /// there is only sky.
    fn surface_at(&mut self, view: &View, at: [f64; 2]) -> Result<Option<DVec3>> {
        let camera = view.camera();
        let at = [at[0] * f64::from(camera.width), at[1] * f64::from(camera.height)];
        Ok(self.renderer.surface_at(&self.place, &camera, at)?)
    }

    /// Changes the facts of the scene: everything after it is rendered with the new ones. Returns
    /// what clients are told.
    fn change_facts(&mut self, change: FactChange) -> Result<Value, FactError> {
        if self.video.as_ref().is_some_and(|active| active.video.is_stopped()) {
            // Ends it.
            self.render_video_frame();
        }
        if self.video.is_some() {
            let why = "a video is being rendered: wait until it is done, or stop it";
            return Err(FactError::Busy(why.into()));
        }
        let before = self.place.facts();
        let changed = self.attempt(|worker| {
            let Self { facts, renderer, place, .. } = worker;
            Ok(facts.apply(renderer, place, change))
        });
        let text = changed.unwrap_or_else(|error| Err(FactError::Failed(format!("{error:#}"))))?;
        let (words, is_unsaved) = (self.facts.words(&self.place), self.facts.is_unsaved());
        let mut message = self.context.set_facts(self.place.survey(), words, is_unsaved);
        self.sound_facts = self.place.facts();
        self.context.queue.broadcast(&message.to_string());
        if self.sound_facts != before {
            // What is being made is of the old facts.
            self.stop_pending();
            self.sweeps.clear();
        }
        message["text"] = text.into();
        Ok(message)
    }

    /// Renders the thumbnail of a preset; returns the command to try again if it has to wait for
    /// assets.
    fn render_thumbnail(&mut self, name: String) -> Result<Option<ViewerCommand>> {
        let (catalog, start) = (self.context.catalog(), self.context.initial_state());
        let shot = thumbnail_view(&name, &catalog, start).map_err(|error| anyhow!(error))?;
        let Some(ThumbnailShot { view, size }) = shot else { return Ok(None) };
        let missing = self.place.missing_assets(&view.weather, view.state.time);
        let is_whole = missing.is_empty();
        if !is_whole && !self.place.has_similar(&missing) {
            if self.pending.is_none() {
                self.spawn_assets(missing, AssetOwner::Waiting(self.waiting.len()))?;
            }
            return Ok(Some(ViewerCommand::Thumbnail(name)));
        }
        let patience = if is_whole { Patience::Whole } else { Patience::Draft };
        let (rgb, _) = self.draw(&view, PaintOptions { size, patience, dither: Dither::Ordered })?;
        let bytes = jpeg(&rgb, size, thumbnail::QUALITY)?;
        self.context.set_thumbnail(name.clone(), bytes.into());
        self.context.queue.broadcast(&json!({ "type": "thumbnail", "name": name }).to_string());
        Ok(None)
    }

    fn start_video(&mut self, view: &Arc<View>, video: &Arc<ViewerVideo>) -> Result<()> {
        let motion = view.motion();
        let (width, height) = view.size();
        let mut settings = video::VideoSettings::new(PictureSize::new(width, height), video.rate);
        settings.tags = self.style(view, &motion.camera(0.0), 0.0).tags;
        let writer = VideoWriter::new(video::create_video(&video.path(), settings)?, video);
        let mut view = (**view).clone();
        view.weather = Arc::new(self.place.weather_of_shot(&view.weather, &motion.camera(0.0)));
        let (view, video) = (Arc::new(view), Arc::clone(video));
        self.video = Some(ActiveVideo { view, motion, video, writer, next: 0, last: Instant::now() });
        Ok(())
    }

    /// Renders the next frame of the running video, if any.
    fn render_video_frame(&mut self) {
        let Some(mut active) = self.video.take() else { return };
        active.last = Instant::now();
        if !active.video.is_stopped() && active.next < active.video.frames {
            match self.attempt(|worker| worker.try_video_frame(&mut active)) {
                Ok(true) => return self.video = Some(active),
                // The writer ended, and says why.
                Ok(false) => {}
                Err(error) => return active.video.end(Err(format!("{error:#}"))),
            }
        }
        active.video.end(active.writer.finish());
    }

    /// Renders a frame of the video once its assets exist; returns false if the writer has stopped.
    fn try_video_frame(&mut self, active: &mut ActiveVideo) -> Result<bool> {
        let time = active.video.rate.seconds(u64::from(active.next));
        let camera = active.motion.camera(time);
        if !self.ensure_assets(&active.view.weather, &camera, time, AssetOwner::Video)? {
            return Ok(true);
        }
        let mut picture = active.writer.blank_picture();
        let camera = active.motion.at(time, self.place.site().metres_per_unit);
        let request = FrameRequest::new(&active.view.weather, camera, time);
        let Self { renderer, place, .. } = self;
        renderer.render_into(place, &request, &mut picture, &mut ())?;
        active.next += 1;
        Ok(active.writer.push_frame(picture))
    }
}

/// Returns the words of a panic.
fn words_of(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str)).unwrap_or("it gave no reason")
}

/// Returns true if an error says that the GPU is lost, so that nothing can be rendered any more.
fn is_lost(error: &anyhow::Error) -> bool {
    #[cfg(feature = "gpu")]
    if let Some(weather_magician::Error::Render(error)) = error.downcast_ref() {
        return matches!(**error, RenderError::Gpu(GpuError::Lost(_)));
    }
    // Every build has the error.
    let _ = error;
    false
}

/// Joins a message: the length of its header, the header, the picture.
fn join_message(head: &str, jpeg: &[u8]) -> Bytes {
    let length = u32::try_from(head.len()).unwrap_or(0).to_le_bytes();
    Bytes::from([&length, head.as_bytes(), jpeg].concat())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::choices::SkyChoice;
    use crate::scene::RunArgs;
    use crate::viewer::client_queue::ClientQueue;
    use crate::viewer::context::Loaded;
    use tokio::sync::oneshot;
    use weather_magician::PlaceOptions;
    use wm_scene::{Metadata, Scene, synthetic};
    use wm_viewer::testing::{catalog, state};

    fn worker() -> RenderWorker {
        let run = RunArgs { device: "cpu".parse().unwrap(), ..RunArgs::default() };
        let mut renderer = run.renderer().unwrap();
        let metadata = Metadata { up: Some(DVec3::Z), metres_per_unit: Some(1.0), ..Metadata::default() };
        let scene = Scene { splats: synthetic::table(1).build(), metadata, ..Scene::default() };
        let place = renderer.load_with(scene, &PlaceOptions::default()).unwrap();
        let facts = FactEditor::new("no/such/folder/table.ply".into(), SkyChoice::Keep, &place, Vec::new());
        let context = Arc::<ViewerContext>::default();
        let catalog = wm_viewer::Catalog { survey: place.survey().clone(), ..catalog() };
        context.set_loaded(Loaded { catalog: Arc::new(catalog), start: state() });
        RenderWorker::new(context, renderer, place, facts)
    }

    /// Returns a view from above, in which rain falls.
    fn view_of(worker: &RenderWorker) -> Arc<View> {
        let weather = json!({ "rain": { "rate": 10 }, "wetness": {} });
        let eye = DVec3::new(0.0, -6.0, 3.0);
        let camera = Camera::looking((32, 24), 50.0, eye, DVec3::ZERO, DVec3::Z).unwrap();
        let state = wm_viewer::ViewState {
            weather,
            camera: wm_viewer::state::Pose::of(&camera),
            size: [32, 24],
            ..state()
        };
        Arc::new(View::new(state, &worker.context.catalog(), None).unwrap())
    }

    fn drawn(worker: &mut RenderWorker, view: &View) -> Vec<u8> {
        let options = PaintOptions { size: view.size(), patience: Patience::Whole, dither: Dither::Ordered };
        worker.draw(view, options).unwrap().0
    }

    #[test]
    fn after_a_panic_the_next_task_is_done_as_before() {
        let mut worker = worker();
        let view = view_of(&worker);
        let before = drawn(&mut worker, &view);
        assert!(before.iter().any(|byte| *byte != before[0]));
        let outcome: Result<()> = worker.attempt(|worker| {
            // Half of a change.
            let mut facts = worker.place.facts();
            facts.scene.up = Some(DVec3::X);
            worker.renderer.set_facts(&mut worker.place, facts)?;
            panic!("a fault of {}", "the program");
        });
        let error = outcome.unwrap_err().to_string();
        assert_eq!(error, "the program failed at this: a fault of the program");
        assert!(worker.broken.is_none());
        assert!(drawn(&mut worker, &view) == before, "the place is not as it was");
    }

    #[test]
    fn who_waits_for_what_cannot_be_made_is_told() {
        let mut worker = worker();
        let view = view_of(&worker);
        let client_queue = Arc::<ClientQueue>::default();
        let client = worker.context.queue.add_client(Arc::clone(&client_queue)).unwrap();
        let request = ViewRequest { view: Arc::clone(&view), seq: 3, is_moving: false };
        worker.context.queue.set_request(client, request);
        let (reply, mut answer) = oneshot::channel();
        let picture =
            |reply| ViewerCommand::Picture { view: Arc::clone(&view), format: ResponseFormat::Jpeg, reply };
        worker.wait(picture(reply));
        for owner in [AssetOwner::Client(client), AssetOwner::Waiting(0), AssetOwner::Video] {
            // The thread that made them is gone.
            let (_, receive) = channel();
            worker.pending = Some(PendingAssets { receive, owner, is_stopped: Arc::default() });
            worker.collect_assets();
            assert!(worker.pending.is_none(), "{owner:?}");
        }
        let why = "the program failed while it prepared the scene for this weather";
        let (texts, _) = client_queue.take_all();
        assert_eq!(texts.iter().filter(|text| text.contains(why)).count(), 1, "{texts:?}");
        assert!(worker.context.queue.next_task(Duration::ZERO).is_none(), "it is served again and again");
        assert_eq!(answer.try_recv().unwrap().err().as_deref(), Some(why));
        // Nobody waits for what was abandoned.
        let (reply, answer) = oneshot::channel();
        drop(answer);
        worker.execute(picture(reply));
        assert!(worker.pending.is_none() && worker.waiting.is_empty());
    }
}
