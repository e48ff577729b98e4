//! The render worker: the only owner of the scene, which carries out one task after the other. A
//! task that fails, also by a panic, is answered with the reason, and the next one follows.
//!
//! Assets that take seconds to make (snow covers, shelter maps) are made on a second thread; until
//! then frames are rendered without them.
//!
//! Only one such asset is made at a time. One whose facts are gone stops between two parts. After a
//! panic all that was derived from the scene is made anew from the last facts that held. Sweeps of
//! a lidar are made when the queue is empty, after the picture that waits for them, or at the
//! latest after a second.

mod assets;
mod video;
mod worker;

pub(crate) use worker::RenderWorker;

use super::download::Download;
use super::facts::{FactChange, FactError};
use super::request_queue::{
    ClientTask, RequestOutcome, ResponseFormat, ViewRequest, ViewerCommand, WorkerTask,
};
use crate::interrupt;
use anyhow::{Context, Result, anyhow, bail};
use assets::AssetOwner;
use axum::body::Bytes;
use glam::DVec3;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::{Duration, Instant};
use weather_magician::output::PictureFormat;
use weather_magician::{Patience, PictureLayer};
use wm_image::color::Dither;
use wm_render::{Stats, at_once};
use wm_viewer::View;
use wm_viewer::encode::jpeg;
use wm_viewer::paint::{FrameReport, PaintOptions};
use wm_viewer::thumbnail::{self, ThumbnailShot, thumbnail_view};
use worker::DueSweep;

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

/// A frame for a client.
struct ServedFrame {
    message: Bytes,
    is_whole: bool,
    lacks_sweep: bool,
}

impl RenderWorker {
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

    /// Renders the frame of a client.
    fn serve_client(&mut self, task: ClientTask) {
        let ClientTask { client, request, client_queue, small } = task;
        let started = Instant::now();
        let served = self.attempt(|worker| worker.client_frame(client, &request, small));
        self.due.retain(|due| due.client != client);
        let ServedFrame { message, is_whole, lacks_sweep } = match served {
            Ok(frame) => frame,
            Err(why) => return self.context.queue.fail_request(client, Some(request.seq), &why),
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
            Err(why) => self.context.queue.fail_request(client, Some(seq), &why),
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
                Err(why) => return command.refuse(why),
            }
        }
        // Clients may have disconnected.
        match command {
            ViewerCommand::Picture { view, format, reply } => {
                let picture = self.attempt(|worker| match format {
                    ResponseFormat::Png => worker.encode_png(&view),
                    ResponseFormat::Jpeg => worker.encode_jpeg(&view),
                });
                let _ = reply.send(picture);
            }
            ViewerCommand::Points { view, reply } => {
                let _ = reply.send(self.attempt(|worker| worker.encode_points(&view)));
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
                    Err(why) => client_queue.push_error(&why),
                }
            }
            ViewerCommand::Surface { view, at, reply } => {
                let _ = reply.send(self.attempt(|worker| worker.surface_at(&view, at)));
            }
            ViewerCommand::Facts { change, reply } => {
                let _ = reply.send(self.change_facts(change));
            }
            ViewerCommand::Video { view, job } => {
                if let Err(why) = self.attempt(|worker| worker.start_video(&view, &job)) {
                    job.end(Err(why));
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
        let text = changed.unwrap_or_else(|why| Err(FactError::Failed(why)))?;
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
        let bytes = jpeg(&rgb, size, thumbnail::JPEG_QUALITY)?;
        self.context.set_thumbnail(name.clone(), bytes.into());
        self.context.queue.broadcast(&json!({ "type": "thumbnail", "name": name }).to_string());
        Ok(None)
    }
}

/// Joins a message: the length of its header, the header, the picture.
fn join_message(head: &str, jpeg: &[u8]) -> Bytes {
    let length = u32::try_from(head.len()).unwrap_or(0).to_le_bytes();
    Bytes::from([&length, head.as_bytes(), jpeg].concat())
}

#[cfg(test)]
mod tests;
