//! The render worker: the only owner of the scene, which carries out one task after the other.
//!
//! Assets that take seconds to make (snow covers, shelter maps) are made on a second thread; until then frames are rendered
//! without them.

use super::ViewerContext;
use super::facts::{FactChange, FactEditor, FactError};
use super::request_queue::{ClientTask, RequestOutcome, ResponseFormat, ViewerCommand, WorkerTask};
use super::videos::{VideoWriter, ViewerVideo};
use crate::interrupt;
use anyhow::{Context, Result, anyhow, bail};
use axum::body::Bytes;
use glam::DVec3;
use serde_json::{Value, json};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};
use weather_magician::assets::{Assets, MissingAssets};
use weather_magician::output::{ExtraPicture, PictureFormat, PictureStyle, outputs};
use weather_magician::{
    CameraMotion, FrameOptions, Patience, PreparedPlace, Progress, Renderer, picture_tags,
};
use wm_media::color::Dither;
use wm_media::{PictureSize, video};
use wm_render::{Stats, at_once};
use wm_scene::Camera;
use wm_viewer::encode::jpeg;
use wm_viewer::lidar::SweepMemory;
use wm_viewer::paint::{FrameReport, PaintOptions};
use wm_viewer::state::ViewOutput;
use wm_viewer::thumbnail::{self, ThumbnailShot, thumbnail_view};
use wm_viewer::{View, ViewPainter};
use wm_weather::Weather;

/// Longest wait for a task before the worker checks for Ctrl-C and for finished assets.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Longest time between two frames of a video while other requests are waiting.
const VIDEO_FRAME_EVERY: Duration = Duration::from_millis(500);
/// Least and greatest time from a frame without its points to the sweep that makes them: a hand may pause, and other pages may not.
const SWEEP_WITHIN: [Duration; 2] = [Duration::from_millis(150), Duration::from_millis(1000)];
/// JPEG quality of drafts.
const DRAFT_QUALITY: u8 = 72;

/// Renders for all clients.
pub struct RenderWorker {
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
    /// The client that needs them first, if any.
    client: Option<u64>,
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
    pub fn new(
        context: Arc<ViewerContext>,
        renderer: Renderer,
        place: PreparedPlace,
        facts: FactEditor,
    ) -> Self {
        Self {
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
    /// The renderer fails, such as when the GPU is lost.
    pub fn run(&mut self) -> Result<()> {
        while !interrupt::asked() {
            self.collect_assets()?;
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
                Some(WorkerTask::Client(task)) => self.serve_client(task)?,
                Some(WorkerTask::Command(command)) => self.execute(command)?,
                None if waited.is_some_and(|waited| waited >= SWEEP_WITHIN[0]) => self.make_due_sweep(),
                None => self.render_video_frame(),
            }
        }
        Ok(())
    }

    /// Inserts the assets that the second thread has finished.
    fn collect_assets(&mut self) -> Result<()> {
        let Some(pending) = &self.pending else { return Ok(()) };
        match pending.receive.try_recv() {
            Err(TryRecvError::Empty) => return Ok(()),
            Err(TryRecvError::Disconnected) => {
                bail!("the thread that makes the assets of the weather failed")
            }
            Ok(made) => self.renderer.insert_assets(&mut self.place, made?)?,
        }
        let client = self.pending.take().and_then(|pending| pending.client);
        self.context.queue.broadcast(&json!({ "type": "status", "text": "" }).to_string());
        self.context.queue.resume_waiting(client);
        for command in std::mem::take(&mut self.waiting) {
            self.execute(command)?;
        }
        Ok(())
    }

    /// Returns true if all assets for a weather at `time` exist; otherwise starts to make them.
    fn ensure_assets(
        &mut self,
        weather: &Weather,
        camera: &Camera,
        time: f64,
        client: Option<u64>,
    ) -> Result<bool> {
        // What is being made is of the place that the last camera was in.
        if self.pending.is_some() && !self.place.is_focused(weather, camera) {
            return Ok(false);
        }
        self.renderer.focus(&mut self.place, weather, camera)?;
        let missing = self.place.missing_assets(weather, time);
        let is_ready = missing.is_empty();
        if !is_ready && self.pending.is_none() {
            self.start_assets(missing, client)?;
        }
        Ok(is_ready)
    }

    /// Starts to make missing assets, and tells the clients.
    fn start_assets(&mut self, missing: MissingAssets, client: Option<u64>) -> Result<()> {
        self.context.queue.broadcast(&json!({ "type": "status", "text": missing.description() }).to_string());
        self.spawn_assets(missing, client)
    }

    fn spawn_assets(&mut self, mut missing: MissingAssets, client: Option<u64>) -> Result<()> {
        let source = self.renderer.asset_source(&mut self.place, &mut missing)?;
        let (send, receive) = channel();
        let (context, is_stopped) = (Arc::clone(&self.context), Arc::<AtomicBool>::default());
        let mut stop = Stop(Arc::clone(&is_stopped));
        std::thread::Builder::new().name("prepare".into()).spawn(move || {
            // The worker may have ended, or the facts may be others.
            let _ = send.send(missing.make(source, &mut stop));
            context.queue.wake_worker();
        })?;
        self.pending = Some(PendingAssets { receive, client, is_stopped });
        Ok(())
    }

    /// Renders the frame of a client.
    fn serve_client(&mut self, task: ClientTask) -> Result<()> {
        let ClientTask { client, request, client_queue, small } = task;
        let (view, started) = (&request.view, Instant::now());
        let (weather, time) = (&view.weather, view.state.time);
        let is_ready = if request.is_moving {
            // Assets that are made quickly are made for moving views too.
            let missing = self.place.missing_assets(weather, time);
            if missing.is_quick() && self.pending.is_none() {
                self.start_assets(missing, None)?;
            }
            false
        } else {
            self.ensure_assets(weather, &view.camera(), time, Some(client))?
        };
        let full = view.size();
        let (size, patience, quality, dither) = match (request.is_moving, is_ready) {
            (true, _) => (small, Patience::Draft, DRAFT_QUALITY, Dither::Off),
            (false, false) => (full, Patience::Draft, view.state.quality, Dither::Ordered),
            (false, true) => (full, Patience::Whole, view.state.quality, Dither::Ordered),
        };
        // The picture does not wait for its points.
        let lacks_sweep = is_ready && view.lidar.is_some() && self.sweeps.get(view).is_none();
        let is_ready = is_ready && !lacks_sweep;
        let drawn = self.draw(view, PaintOptions { size, patience, dither });
        let message = drawn.and_then(|(rgb, stats)| {
            let drew = started.elapsed().as_secs_f64();
            let jpeg = jpeg(&rgb, size, quality)?;
            let took = started.elapsed().as_secs_f64();
            let report = FrameReport {
                seq: request.seq,
                size,
                is_whole: is_ready,
                stats: &stats,
                seconds: [drew, took - drew],
            };
            let head = report.header(view, self.place.site(), self.sweeps.report(view));
            Ok(join_message(&head.to_string(), &jpeg))
        });
        match message {
            Ok(message) => client_queue.set_picture(message),
            Err(error) => client_queue
                .push_message(json!({ "type": "error", "text": format!("{error:#}") }).to_string()),
        }
        let outcome = match (request.is_moving, is_ready) {
            (true, _) => RequestOutcome::Draft(started.elapsed().as_secs_f64()),
            (false, false) => RequestOutcome::Incomplete,
            (false, true) => RequestOutcome::Complete,
        };
        self.context.queue.finish_request(client, request.seq, outcome);
        self.due.retain(|due| due.client != client);
        if lacks_sweep {
            let view = Arc::clone(view);
            self.due.push(DueSweep { client, seq: request.seq, view, since: Instant::now() });
        }
        Ok(())
    }

    /// Makes the sweep that a client has waited for the longest, unless it asks for something else by now.
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
        self.ensure_sweep(&view);
        status("").iter().for_each(|text| self.context.queue.broadcast(text));
        self.context.queue.resume_waiting(Some(client));
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

    /// Renders a view as bytes `[H, W, 3]`, without weather left of its divider, and with the points of its lidar.
    fn draw(&mut self, view: &View, options: PaintOptions) -> Result<(Vec<u8>, Stats)> {
        let overlay = self.sweeps.overlay(view);
        let Self { renderer, place, painter, .. } = self;
        Ok(at_once(painter.draw(renderer, place, view, overlay.as_deref(), options))?)
    }

    /// Carries out a command, or keeps it until its assets exist.
    fn execute(&mut self, command: ViewerCommand) -> Result<()> {
        let waits = match &command {
            ViewerCommand::Picture { view, .. } | ViewerCommand::Points { view, .. } => {
                let time = view.state.time;
                !self.ensure_assets(&view.weather, &view.camera(), time, None)?
            }
            ViewerCommand::Pick { .. }
            | ViewerCommand::Surface { .. }
            | ViewerCommand::Facts { .. }
            | ViewerCommand::Video { .. }
            | ViewerCommand::Thumbnail(_) => false,
        };
        if waits {
            self.waiting.push(command);
            return Ok(());
        }
        match command {
            ViewerCommand::Picture { view, format, reply } => {
                let bytes = match format {
                    ResponseFormat::Png => self.encode_png(&view),
                    ResponseFormat::Jpeg => self.encode_jpeg(&view),
                };
                // The client may have disconnected.
                let _ = reply.send(bytes.map(Bytes::from).map_err(|error| format!("{error:#}")));
            }
            ViewerCommand::Points { view, reply } => {
                let _ = reply.send(self.encode_points(&view).map_err(|error| format!("{error:#}")));
            }
            ViewerCommand::Pick { view, at, client_queue } => {
                let Self { renderer, place, painter, .. } = self;
                let point = at_once(painter.pick(renderer, place, &view, at))?;
                client_queue.push_message(json!({ "type": "picked", "point": point }).to_string());
            }
            ViewerCommand::Surface { view, at, reply } => {
                let point = self.surface_at(&view, at);
                let _ = reply.send(point.map_err(|error| format!("{error:#}")));
            }
            ViewerCommand::Facts { change, reply } => {
                let answer = self.change_facts(change)?;
                let _ = reply.send(answer);
            }
            ViewerCommand::Video { view, job } => {
                if let Err(error) = self.start_video(&view, &job) {
                    job.end(Err(format!("{error:#}")));
                }
            }
            ViewerCommand::Thumbnail(name) => self.render_thumbnail(name)?,
        }
        Ok(())
    }

    /// Returns the bytes of the PLY file that `scan` writes.
    fn encode_points(&mut self, view: &Arc<View>) -> Result<Bytes> {
        self.ensure_sweep(view);
        let sweep = self.sweeps.get(view).context("a view without a lidar has no points")?;
        let sweep = sweep.as_ref().map_err(|error| anyhow!("{error}"))?;
        let folder = tempfile::tempdir().context("cannot create a temporary folder for the points")?;
        let path = folder.path().join("points.ply");
        sweep.save(&path)?;
        Ok(std::fs::read(&path)?.into())
    }

    fn encode_jpeg(&mut self, view: &Arc<View>) -> Result<Vec<u8>> {
        self.ensure_sweep(view);
        if let Some(Err(error)) = self.sweeps.get(view) {
            bail!("{error}");
        }
        let size = view.size();
        let (rgb, _) =
            self.draw(view, PaintOptions { size, patience: Patience::Whole, dither: Dither::Ordered })?;
        Ok(jpeg(&rgb, size, view.state.quality)?)
    }

    /// Returns the bytes of the PNG file that `render` writes.
    fn encode_png(&mut self, view: &View) -> Result<Vec<u8>> {
        let style = self.style(view, &view.camera(), view.state.time);
        let Self { renderer, place, painter, .. } = self;
        let picture = at_once(painter.render(renderer, place, view))?;
        let folder = tempfile::tempdir().context("cannot create a temporary folder for the picture")?;
        let path = folder.path().join("picture.png");
        match view.state.output.also() {
            None => _ = style.write(picture, &path)?,
            Some(ExtraPicture { kind, .. }) => {
                let (width, height) = view.size();
                let size = PictureSize::new(width, height);
                style.write_one(kind, PictureFormat::Png, picture, size, &path)?;
            }
        }
        Ok(std::fs::read(&path)?)
    }

    fn style(&self, view: &View, camera: &Camera, time: f64) -> PictureStyle {
        let (catalog, site) = (self.context.catalog(), self.place.site());
        PictureStyle {
            metres_per_unit: site.metres_per_unit,
            tags: picture_tags(&catalog.words[0], site, self.renderer.backend(), &view.weather, time, camera),
            ..PictureStyle::default()
        }
    }

    /// Returns the point of the nearest surface at `[x, y]`, 0-1, of the picture; `None` where there is only sky.
    fn surface_at(&mut self, view: &View, [x, y]: [f64; 2]) -> Result<Option<DVec3>> {
        let camera = view.camera();
        let at = (x * f64::from(camera.width), y * f64::from(camera.height));
        Ok(self.renderer.surface_at(&self.place, &camera, at)?)
    }

    /// Changes the facts of the scene: everything after it is rendered with the new ones. Returns what clients are told.
    fn change_facts(&mut self, change: FactChange) -> Result<Result<Value, FactError>> {
        if self.video.is_some() {
            let why = "a video is being rendered: wait until it is done, or stop it";
            return Ok(Err(FactError::Busy(why.into())));
        }
        let before = self.place.facts();
        let text = match self.facts.apply(&mut self.renderer, &mut self.place, change) {
            Ok(text) => text,
            Err(error) => return Ok(Err(error)),
        };
        let (words, is_unsaved) = (self.facts.words(&self.place), self.facts.is_unsaved());
        let mut message = self.context.set_facts(self.place.survey(), words, is_unsaved);
        let is_same = self.place.facts() == before;
        if let Some(pending) = self.pending.take_if(|_| !is_same) {
            // These are assets of the old facts.
            pending.is_stopped.store(true, Ordering::Relaxed);
            self.context.queue.broadcast(&json!({ "type": "status", "text": "" }).to_string());
        }
        self.context.queue.broadcast(&message.to_string());
        if !is_same {
            self.sweeps.clear();
            self.context.queue.resume_waiting(None);
            for command in std::mem::take(&mut self.waiting) {
                self.execute(command)?;
            }
        }
        message["text"] = text.into();
        Ok(Ok(message))
    }

    fn render_thumbnail(&mut self, name: String) -> Result<()> {
        let (catalog, start) = (self.context.catalog(), self.context.initial_state());
        let shot = thumbnail_view(&name, &catalog, start).map_err(|error| anyhow!(error))?;
        let Some(ThumbnailShot { view, size }) = shot else { return Ok(()) };
        let missing = self.place.missing_assets(&view.weather, view.state.time);
        let is_whole = missing.is_empty();
        if !is_whole && !self.place.has_similar(&missing) {
            if self.pending.is_none() {
                self.spawn_assets(missing, None)?;
            }
            self.waiting.push(ViewerCommand::Thumbnail(name));
            return Ok(());
        }
        let patience = if is_whole { Patience::Whole } else { Patience::Draft };
        let (rgb, _) = self.draw(&view, PaintOptions { size, patience, dither: Dither::Ordered })?;
        let bytes = jpeg(&rgb, size, thumbnail::QUALITY)?;
        self.context.set_thumbnail(name.clone(), bytes.into());
        self.context.queue.broadcast(&json!({ "type": "thumbnail", "name": name }).to_string());
        Ok(())
    }

    fn start_video(&mut self, view: &Arc<View>, video: &Arc<ViewerVideo>) -> Result<()> {
        let motion = view.motion();
        let (width, height) = view.size();
        let mut settings = video::VideoSettings::new(PictureSize::new(width, height), video.rate);
        settings.tags = self.style(view, &motion.camera(0.0), 0.0).tags;
        let writer = VideoWriter::new(video::create_video(&video.path(), settings)?, video);
        let (view, video) = (Arc::clone(view), Arc::clone(video));
        self.video = Some(ActiveVideo { view, motion, video, writer, next: 0, last: Instant::now() });
        Ok(())
    }

    /// Renders the next frame of the running video, if any.
    fn render_video_frame(&mut self) {
        let Some(mut active) = self.video.take() else { return };
        active.last = Instant::now();
        if !active.video.is_stopped() && active.next < active.video.frames {
            match self.try_video_frame(&mut active) {
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
        if !self.ensure_assets(&active.view.weather, &active.motion.camera(time), time, None)? {
            return Ok(true);
        }
        self.place.config.outputs = outputs(ViewOutput::Rgb.also().as_slice());
        let mut picture = active.writer.blank_picture();
        let camera = active.motion.at(time, self.place.site().metres_per_unit);
        let options = FrameOptions::new(time, camera);
        let Self { renderer, place, .. } = self;
        renderer.render_into(place, &active.view.weather, &options, &mut picture, &mut ())?;
        active.next += 1;
        Ok(active.writer.push_frame(picture))
    }
}

/// Joins a message: the length of its header, the header, the picture.
fn join_message(head: &str, jpeg: &[u8]) -> Bytes {
    let length = u32::try_from(head.len()).unwrap_or(0).to_le_bytes();
    Bytes::from([&length, head.as_bytes(), jpeg].concat())
}
