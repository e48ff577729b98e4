//! Videos rendered in the background: their options, progress and files.

use super::locked::locked;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use tempfile::TempDir;
use weather_magician::Picture;
use weather_magician::video::{FrameRate, VideoSink};

/// Number of videos that are kept; the oldest is removed.
const MAX_VIDEOS: usize = 4;
/// Maximum length of a video, frames.
pub(crate) const MAX_FRAMES: u32 = 20_000;

/// A video that is or was rendered.
pub(crate) struct ViewerVideo {
    /// Number of the video.
    pub(crate) id: u32,
    /// File name for the download.
    pub(crate) name: String,
    /// Frame rate.
    pub(crate) rate: FrameRate,
    /// Number of frames.
    pub(crate) frames: u32,
    folder: TempDir,
    done: AtomicU32,
    is_stopped: AtomicBool,
    /// The outcome; `None` while it is rendered.
    outcome: Mutex<Option<Result<(), String>>>,
}

impl ViewerVideo {
    /// The path of the file.
    pub(crate) fn path(&self) -> PathBuf {
        self.folder.path().join("video.mp4")
    }

    /// Returns true if it was stopped by a client.
    pub(crate) fn is_stopped(&self) -> bool {
        self.is_stopped.load(Ordering::Relaxed)
    }

    /// Stops rendering.
    pub(crate) fn stop(&self) {
        self.is_stopped.store(true, Ordering::Relaxed);
    }

    /// Sets the outcome.
    pub(crate) fn end(&self, outcome: Result<(), String>) {
        *locked(&self.outcome) = Some(outcome);
    }

    /// Returns true if the file is complete.
    pub(crate) fn is_done(&self) -> bool {
        *locked(&self.outcome) == Some(Ok(()))
    }

    /// The status and progress as JSON.
    pub(crate) fn json(&self) -> Value {
        let (state, error) = match &*locked(&self.outcome) {
            None => ("running", None),
            Some(Ok(())) => ("done", None),
            Some(Err(error)) => ("failed", Some(error.clone())),
        };
        let done = self.done.load(Ordering::Relaxed);
        json!({ "id": self.id, "name": self.name, "frames": self.frames, "done": done, "state": state, "error": error })
    }
}

/// All videos of the viewer.
#[derive(Default)]
pub(crate) struct VideoList {
    all: Mutex<(u32, BTreeMap<u32, Arc<ViewerVideo>>)>,
}

impl VideoList {
    /// Adds a video whose file will be in `folder`; only one may be running.
    ///
    /// # Errors
    /// A video is running.
    pub(crate) fn add(
        &self,
        name: String,
        rate: FrameRate,
        frames: u32,
        folder: TempDir,
    ) -> Result<Arc<ViewerVideo>, String> {
        let mut all = locked(&self.all);
        if all.1.values().any(|video| locked(&video.outcome).is_none()) {
            return Err("a video is being rendered; wait for it or stop it".into());
        }
        all.0 += 1;
        let id = all.0;
        let video = Arc::new(ViewerVideo {
            id,
            name,
            rate,
            frames,
            folder,
            done: AtomicU32::new(0),
            is_stopped: AtomicBool::new(false),
            outcome: Mutex::default(),
        });
        all.1.insert(id, Arc::clone(&video));
        while all.1.len() > MAX_VIDEOS {
            all.1.pop_first();
        }
        Ok(video)
    }

    /// Returns the video with a number.
    pub(crate) fn get(&self, id: u32) -> Option<Arc<ViewerVideo>> {
        locked(&self.all).1.get(&id).cloned()
    }
}

/// Writes the frames of a video on a thread of its own.
pub(crate) struct VideoWriter {
    send: Option<SyncSender<Picture>>,
    returned: Receiver<Picture>,
    thread: Option<JoinHandle<Result<(), String>>>,
}

impl VideoWriter {
    /// Starts the thread.
    pub(crate) fn new(mut sink: Box<dyn VideoSink>, video: &Arc<ViewerVideo>) -> Self {
        let (send, receive) = sync_channel::<Picture>(2);
        let (give_back, returned) = channel();
        let video = Arc::clone(video);
        let thread = std::thread::spawn(move || {
            for picture in receive {
                sink.frame(&picture.frame.rgb).map_err(|error| error.to_string())?;
                video.done.fetch_add(1, Ordering::Relaxed);
                // The renderer may have finished.
                let _ = give_back.send(picture);
            }
            if video.is_stopped() {
                return Err("stopped".into());
            }
            sink.finish().map(drop).map_err(|error| error.to_string())
        });
        Self { send: Some(send), returned, thread: Some(thread) }
    }

    /// Returns a picture to render into, reused if possible.
    pub(crate) fn blank_picture(&self) -> Picture {
        self.returned.try_recv().unwrap_or_default()
    }

    /// Adds a frame; returns true if more frames are accepted.
    pub(crate) fn push_frame(&self, picture: Picture) -> bool {
        self.send.as_ref().is_some_and(|send| send.send(picture).is_ok())
    }

    /// Completes the file.
    pub(crate) fn finish(mut self) -> Result<(), String> {
        drop(self.send.take());
        let thread = self.thread.take().map(JoinHandle::join);
        thread.unwrap_or(Ok(Ok(()))).unwrap_or_else(|_| Err("the writer of the video failed".into()))
    }
}
