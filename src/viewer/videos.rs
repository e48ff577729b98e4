//! Videos that are rendered while others look on: what was asked for, how far it is, and the file.

use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use tempfile::TempDir;
use weather_magician::Picture;
use wm_media::video::{FrameRate, VideoSink};

/// Videos that are kept: the oldest goes.
const KEPT: usize = 4;
/// Longest, frames.
pub const MOST_FRAMES: u32 = 20_000;

/// How it stands with a video.
#[derive(Clone, Debug, PartialEq)]
enum Fate {
    Running,
    Done,
    Failed(String),
}

/// A video.
pub struct Video {
    /// Its number.
    pub id: u32,
    /// Name of the file to give.
    pub name: String,
    /// Frames a second.
    pub rate: FrameRate,
    /// Frames in all.
    pub frames: u32,
    folder: TempDir,
    done: AtomicU32,
    is_stopped: AtomicBool,
    fate: Mutex<Fate>,
}

impl Video {
    /// Where it is written.
    pub fn path(&self) -> PathBuf {
        self.folder.path().join("video.mp4")
    }

    /// Whether somebody stopped it.
    pub fn is_stopped(&self) -> bool {
        self.is_stopped.load(Ordering::Relaxed)
    }

    /// Stops it.
    pub fn stop(&self) {
        self.is_stopped.store(true, Ordering::Relaxed);
    }

    /// Ends it.
    pub fn end(&self, outcome: Result<(), String>) {
        let fate = outcome.map_or_else(Fate::Failed, |()| Fate::Done);
        *self.fate.lock().unwrap_or_else(PoisonError::into_inner) = fate;
    }

    /// Whether the file is there.
    pub fn is_done(&self) -> bool {
        *self.fate.lock().unwrap_or_else(PoisonError::into_inner) == Fate::Done
    }

    fn is_running(&self) -> bool {
        *self.fate.lock().unwrap_or_else(PoisonError::into_inner) == Fate::Running
    }

    /// How it stands.
    pub fn json(&self) -> Value {
        let (state, error) = match &*self.fate.lock().unwrap_or_else(PoisonError::into_inner) {
            Fate::Running => ("running", None),
            Fate::Done => ("done", None),
            Fate::Failed(error) => ("failed", Some(error.clone())),
        };
        let done = self.done.load(Ordering::Relaxed);
        json!({ "id": self.id, "name": self.name, "frames": self.frames, "done": done, "state": state, "error": error })
    }
}

/// All videos.
#[derive(Default)]
pub struct Videos {
    all: Mutex<(u32, BTreeMap<u32, Arc<Video>>)>,
}

impl Videos {
    /// A new one, of which none may be running.
    ///
    /// # Errors
    /// One is running, or there is no room for its file.
    pub fn begin(&self, name: String, rate: FrameRate, frames: u32) -> Result<Arc<Video>, String> {
        let mut all = self.all.lock().unwrap_or_else(PoisonError::into_inner);
        if all.1.values().any(|video| video.is_running()) {
            return Err("a video is being rendered; wait for it or stop it".into());
        }
        let folder = tempfile::Builder::new().prefix("weather-magician-view-").tempdir();
        let folder = folder.map_err(|error| format!("no room for a video: {error}"))?;
        all.0 += 1;
        let id = all.0;
        let video = Arc::new(Video {
            id,
            name,
            rate,
            frames,
            folder,
            done: AtomicU32::new(0),
            is_stopped: AtomicBool::new(false),
            fate: Mutex::new(Fate::Running),
        });
        all.1.insert(id, Arc::clone(&video));
        while all.1.len() > KEPT {
            all.1.pop_first();
        }
        Ok(video)
    }

    /// Removes the files of all.
    pub fn clear(&self) {
        self.all.lock().unwrap_or_else(PoisonError::into_inner).1.clear();
    }

    /// That of a number.
    pub fn get(&self, id: u32) -> Option<Arc<Video>> {
        self.all.lock().unwrap_or_else(PoisonError::into_inner).1.get(&id).cloned()
    }
}

/// The writer of a video, on a thread of its own.
pub struct Writer {
    send: Option<SyncSender<Picture>>,
    returned: Receiver<Picture>,
    thread: Option<JoinHandle<Result<(), String>>>,
}

impl Writer {
    /// Starts it.
    pub fn new(mut sink: Box<dyn VideoSink>, video: &Arc<Video>) -> Self {
        let (send, receive) = sync_channel::<Picture>(2);
        let (give_back, returned) = channel();
        let video = Arc::clone(video);
        let thread = std::thread::spawn(move || {
            for picture in receive {
                sink.frame(&picture.frame.rgb).map_err(|error| error.to_string())?;
                video.done.fetch_add(1, Ordering::Relaxed);
                // Whoever renders may be done.
                let _ = give_back.send(picture);
            }
            if video.is_stopped() {
                return Err("stopped".into());
            }
            sink.finish().map(drop).map_err(|error| error.to_string())
        });
        Self { send: Some(send), returned, thread: Some(thread) }
    }

    /// A picture to draw into.
    pub fn blank(&self) -> Picture {
        self.returned.try_recv().unwrap_or_default()
    }

    /// Adds a frame; whether more are wanted.
    pub fn add(&self, picture: Picture) -> bool {
        self.send.as_ref().is_some_and(|send| send.send(picture).is_ok())
    }

    /// Completes the file.
    pub fn finish(mut self) -> Result<(), String> {
        drop(self.send.take());
        let thread = self.thread.take().map(JoinHandle::join);
        thread.unwrap_or(Ok(Ok(()))).unwrap_or_else(|_| Err("the writer of the video failed".into()))
    }
}
