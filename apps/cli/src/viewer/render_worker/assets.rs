//! Assets that are made on a second thread.

use crate::viewer::context::ViewerContext;
use anyhow::{Result, anyhow};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use weather_magician::assets::{Assets, MissingAssets};
use weather_magician::{PreparedPlace, Progress, Renderer};

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

impl PendingAssets {
    /// Starts to make assets that a place lacks. The worker is woken when they are made.
    pub(super) fn start(
        context: &Arc<ViewerContext>,
        renderer: &mut Renderer,
        place: &mut PreparedPlace,
        mut missing: MissingAssets,
        owner: AssetOwner,
    ) -> Result<Self> {
        let source = renderer.asset_source(place, &mut missing)?;
        let (send, receive) = channel();
        let (context, is_stopped) = (Arc::clone(context), Arc::<AtomicBool>::default());
        let mut stop = Stop(Arc::clone(&is_stopped));
        std::thread::Builder::new().name("prepare".into()).spawn(move || {
            // The worker may have ended, or the facts may be others.
            let _ = send.send(missing.make(source, &mut stop));
            context.queue.wake_worker();
        })?;
        Ok(Self { receive, owner, is_stopped })
    }

    /// Stops making the assets; the thread ends between two parts.
    pub(super) fn stop(&self) {
        self.is_stopped.store(true, Ordering::Relaxed);
    }

    /// Returns true if the assets are not needed any more.
    pub(super) fn was_stopped(&self) -> bool {
        self.is_stopped.load(Ordering::Relaxed)
    }

    /// Returns what the thread has made, or why it made nothing; `None` while it works.
    pub(super) fn made(&self) -> Option<Result<Assets>> {
        match self.receive.try_recv() {
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                Some(Err(anyhow!("the program failed while it prepared the scene for this weather")))
            }
            Ok(made) => Some(made.map_err(anyhow::Error::from)),
        }
    }
}
