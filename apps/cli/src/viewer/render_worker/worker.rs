//! The state of the worker: how it goes on after a task that failed, and the assets and the video
//! that it makes beside its tasks.

use super::assets::{AssetOwner, PendingAssets};
use super::video::ActiveVideo;
use crate::viewer::context::ViewerContext;
use crate::viewer::facts::FactEditor;
use crate::viewer::request_queue::ViewerCommand;
use crate::viewer::videos::ViewerVideo;
use anyhow::{Result, anyhow};
use serde_json::json;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Instant;
use weather_magician::assets::MissingAssets;
use weather_magician::output::PictureStyle;
use weather_magician::{Camera, PlaceFacts, PreparedPlace, Renderer, Weather, picture_tags};
#[cfg(feature = "gpu")]
use wm_render::{RenderError, gpu::GpuError};
use wm_viewer::sweeps::SweepMemory;
use wm_viewer::{View, ViewPainter};

/// Renders for all clients.
pub(crate) struct RenderWorker {
    pub(super) context: Arc<ViewerContext>,
    pub(super) renderer: Renderer,
    pub(super) place: PreparedPlace,
    pub(super) facts: FactEditor,
    pub(super) pending: Option<PendingAssets>,
    /// Commands that wait for assets.
    pub(super) waiting: Vec<ViewerCommand>,
    pub(super) video: Option<ActiveVideo>,
    pub(super) sweeps: SweepMemory,
    pub(super) due: Vec<DueSweep>,
    pub(super) painter: ViewPainter,
    /// The facts in use, with which the place is made anew after a panic.
    pub(super) sound_facts: PlaceFacts,
    /// The failure that ends the program.
    pub(super) broken: Option<anyhow::Error>,
}

/// A sweep that a client's frame waits for.
pub(super) struct DueSweep {
    pub(super) client: u64,
    pub(super) seq: u64,
    pub(super) view: Arc<View>,
    pub(super) since: Instant,
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

    /// Does the work of one task. A panic in it is an error of this task; what it may have left
    /// half made is made anew.
    ///
    /// # Errors
    /// The error of the work, or its panic, in one line.
    pub(super) fn attempt<T>(&mut self, work: impl FnOnce(&mut Self) -> Result<T>) -> Result<T, String> {
        let outcome = catch_unwind(AssertUnwindSafe(|| work(self))).unwrap_or_else(|panic| {
            self.recover();
            Err(anyhow!("the program failed at this: {}", words_of(&*panic)))
        });
        outcome.map_err(|error| {
            let text = format!("{error:#}");
            if is_lost(&error) {
                self.broken = Some(anyhow!("{text}"));
            }
            text
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

    /// Returns how a picture of a view is written, with the words that describe it.
    pub(super) fn style(&self, view: &View, camera: &Camera, time: f64) -> PictureStyle {
        let (catalog, site) = (self.context.catalog(), self.place.site());
        let scene = catalog.words[0].to_string_lossy();
        PictureStyle {
            tags: picture_tags(&scene, site, self.renderer.backend(), &view.weather, time, camera),
            ..PictureStyle::default()
        }
    }

    /// Stops making assets. Others are made once the thread has ended, so that there is never more
    /// than one with its memory; whoever waits for them asks again.
    pub(super) fn stop_pending(&mut self) {
        if let Some(pending) = &self.pending {
            pending.stop();
            self.context.queue.broadcast(&json!({ "type": "status", "text": "" }).to_string());
        }
        self.context.queue.resume_waiting(None);
    }

    /// Inserts the assets that the second thread has finished.
    pub(super) fn collect_assets(&mut self) {
        let Some(pending) = &self.pending else { return };
        let (owner, is_stopped) = (pending.owner, pending.was_stopped());
        let Some(made) = pending.made() else { return };
        self.pending = None;
        if is_stopped {
            return self.context.queue.resume_waiting(None);
        }
        let insert =
            |worker: &mut Self, assets| Ok(worker.renderer.insert_assets(&mut worker.place, assets)?);
        let inserted = self.attempt(|worker| insert(worker, made?));
        if let Err(why) = inserted {
            self.refuse(owner, &why);
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
    pub(super) fn ensure_assets(
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
    pub(super) fn start_assets(&mut self, missing: MissingAssets, owner: AssetOwner) -> Result<()> {
        self.context.queue.broadcast(&json!({ "type": "status", "text": missing.description() }).to_string());
        self.spawn_assets(missing, owner)
    }

    /// Starts to make missing assets.
    pub(super) fn spawn_assets(&mut self, missing: MissingAssets, owner: AssetOwner) -> Result<()> {
        let Self { context, renderer, place, .. } = self;
        self.pending = Some(PendingAssets::start(context, renderer, place, missing, owner)?);
        Ok(())
    }

    /// Starts to render a video.
    pub(super) fn start_video(&mut self, view: &Arc<View>, video: &Arc<ViewerVideo>) -> Result<()> {
        let motion = view.motion();
        let tags = self.style(view, &motion.camera(0.0), 0.0).tags;
        self.video = Some(ActiveVideo::begin(view, motion, video, &mut self.place, tags)?);
        Ok(())
    }

    /// Renders the next frame of the running video, if any.
    pub(super) fn render_video_frame(&mut self) {
        let Some(mut active) = self.video.take() else { return };
        active.last = Instant::now();
        if active.has_next() {
            match self.attempt(|worker| worker.try_video_frame(&mut active)) {
                Ok(true) => return self.video = Some(active),
                // The writer ended, and says why.
                Ok(false) => {}
                Err(why) => return active.video.end(Err(why)),
            }
        }
        active.finish();
    }

    /// Renders a frame of the video once its assets exist; returns false if the writer has stopped.
    fn try_video_frame(&mut self, active: &mut ActiveVideo) -> Result<bool> {
        if !self.ensure_assets(&active.view.weather, &active.camera(), active.time(), AssetOwner::Video)? {
            return Ok(true);
        }
        active.render_next(&mut self.renderer, &mut self.place)
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
