//! Commands that run one after the other in the folder of a run, with their log and their progress.

use super::error::{ColmapError, file_error, make_folder};
use super::progress::{self, ColmapProgress, ColmapStep};
use crate::files::remove;
use std::fs::{self, File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// The file that says what was run.
pub(super) const LOG_FILE: &str = "colmap.log";
/// The file that says that a run is complete.
pub(super) const DONE_FILE: &str = "done";

/// The time between two looks at a running command.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// A run in its folder.
pub(super) struct Runner<'a> {
    program: PathBuf,
    pub(crate) folder: PathBuf,
    photos: usize,
    progress: &'a mut dyn FnMut(ColmapProgress),
    is_stopped: &'a dyn Fn() -> bool,
}

impl<'a> Runner<'a> {
    /// Opens the folder of a run for photos, of which `title` is a line that tells them from
    /// others. Keeps what an earlier run for the same photos found.
    pub(crate) fn new(
        program: PathBuf,
        folder: PathBuf,
        title: &str,
        photos: usize,
        progress: &'a mut dyn FnMut(ColmapProgress),
        is_stopped: &'a dyn Fn() -> bool,
    ) -> Result<Self, ColmapError> {
        let log = folder.join(LOG_FILE);
        if log.is_file() {
            // What an earlier run made: all of it is of our own making. Features and matches of the
            // same photos are kept.
            let old = fs::read(&log).map_err(|e| file_error(&log, e))?;
            let database = Some("database.db").filter(|_| !old.starts_with(title.as_bytes()));
            for part in [DONE_FILE, "models", "dataset"].into_iter().chain(database) {
                let part = folder.join(part);
                remove(&part).map_err(|e| file_error(&part, e))?;
            }
        } else if fs::read_dir(&folder).is_ok_and(|mut entries| entries.next().is_some()) {
            return Err(ColmapError::Occupied(folder));
        }
        make_folder(&folder)?;
        fs::write(&log, title).map_err(|e| file_error(&log, e))?;
        Ok(Self { program, folder, photos, progress, is_stopped })
    }

    /// Runs a command to its end; all it says goes to the log, from where progress is read.
    pub(crate) fn run(&mut self, step: ColmapStep, mut command: Command) -> Result<(), ColmapError> {
        let log = self.folder.join(LOG_FILE);
        let fault = |e| file_error(&log, e);
        let mut out = OpenOptions::new().append(true).open(&log).map_err(fault)?;
        writeln!(out, "\n$ {}", line_of(&command)).map_err(fault)?;
        let mut reader = File::open(&log).map_err(fault)?;
        reader.seek(SeekFrom::End(0)).map_err(fault)?;
        let said_by_both = out.try_clone().map_err(fault)?;
        command.stdin(Stdio::null()).stdout(out).stderr(said_by_both);
        let child = command.spawn();
        let child = child.map_err(|reason| ColmapError::Start { program: self.program.clone(), reason })?;
        let mut child = Running(child);
        let mut lines = progress::Lines::default();
        (self.progress)(ColmapProgress { step, done: 0, total: None });
        let status = loop {
            let ended = child.0.try_wait().map_err(fault)?;
            let mut said = Vec::new();
            reader.read_to_end(&mut said).map_err(fault)?;
            for at in lines.take(&said).filter_map(|line| progress::of(step, &line, self.photos)) {
                (self.progress)(at);
            }
            if let Some(status) = ended {
                break status;
            }
            if (self.is_stopped)() {
                drop(child);
                return Err(ColmapError::Stopped { step, folder: self.folder.clone() });
            }
            std::thread::sleep(POLL_INTERVAL);
        };
        if status.success() {
            return Ok(());
        }
        // An interrupt from the keyboard reaches the child as well, and it may end first.
        if (self.is_stopped)() {
            return Err(ColmapError::Stopped { step, folder: self.folder.clone() });
        }
        let said = lines.last_error().map(|line| format!(": {line}")).unwrap_or_default();
        Err(ColmapError::Failed { step, status, said, log })
    }
}

/// A command that does not outlive whoever started it.
pub(crate) struct Running(pub Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended by itself; there is nobody to tell.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The command as one would type it.
fn line_of(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args()).map(|word| {
        let word = word.to_string_lossy();
        if word.contains(' ') { format!("\"{word}\"") } else { word.into_owned() }
    });
    words.collect::<Vec<_>>().join(" ")
}
