//! Assets that are made on a second thread.

use super::RenderWorker;
use anyhow::{Result, anyhow};
use serde_json::json;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use weather_magician::assets::{Assets, MissingAssets};
use weather_magician::{Camera, Progress, Weather};

/// The owner that is told if assets cannot be made.
#[derive(Clone, Copy, Debug)]
pub(super) enum AssetOwner {
    /// A client, by its id.
    Client(u64),
    /// A command that waits for them, by its place among those that wait.
    Waiting(usize),
    /// The running video.
    Video,
    /// Nobody: a view that moves asks again.
    Nobody,
}

/// Missing assets while they are being made.
pub(super) struct PendingAssets {
    pub(super) receive: Receiver<Result<Assets, weather_magician::Error>>,
    pub(super) owner: AssetOwner,
    pub(super) is_stopped: Arc<AtomicBool>,
}

/// Stops the work of the second thread when its assets are not needed any more.
struct Stop(Arc<AtomicBool>);

impl Progress for Stop {
    fn is_stopped(&mut self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

impl RenderWorker {
    /// Stops making assets. Others are made once the thread has ended, so that there is never more
    /// than one with its memory; whoever waits for them asks again.
    pub(super) fn stop_pending(&mut self) {
        if let Some(pending) = &self.pending {
            pending.is_stopped.store(true, Ordering::Relaxed);
            self.context.queue.broadcast(&json!({ "type": "status", "text": "" }).to_string());
        }
        self.context.queue.resume_waiting(None);
    }

    /// Inserts the assets that the second thread has finished.
    pub(super) fn collect_assets(&mut self) {
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
        let inserted = self.attempt(|worker| insert(worker, made?));
        if let Err(why) = inserted {
            self.refuse(owner, &why);
        }
        self.context.queue.broadcast(&json!({ "type": "status", "text": "" }).to_string());
        let client = if let AssetOwner::Client(client) = owner { Some(client) } else { None };
        self.context.queue.resume_waiting(client);
    }

    /// Tells the owner of assets why there are none.
    pub(super) fn refuse(&mut self, owner: AssetOwner, why: &str) {
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

    pub(super) fn spawn_assets(&mut self, mut missing: MissingAssets, owner: AssetOwner) -> Result<()> {
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
}
