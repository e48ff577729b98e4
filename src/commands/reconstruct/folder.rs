//! The folder of a run: what is there to go on with, to look at and to plot.

use anyhow::{Context, Result, bail};
use serde_json::Value;
use std::fs::{self, File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use wm_scene::files::write_atomically;
use wm_train::TrainConfig;
use wm_train::checkpoint::{self, Head};
use wm_train::trainer::TrainState;

/// The checkpoint's name in it.
pub const CHECKPOINT: &str = "checkpoint.wmtrain";

/// The folder of a run.
pub struct RunFolder {
    path: PathBuf,
    resume: bool,
}

impl RunFolder {
    /// Looks what is there. A training that is there is only gone on with if that is asked for.
    pub fn open(path: &Path, resume: bool) -> Result<Self> {
        let folder = Self { path: path.to_owned(), resume };
        if resume && !folder.checkpoint().is_file() {
            bail!("{}: there is no training to go on with; leave out --resume", path.display());
        }
        if !resume && folder.checkpoint().is_file() {
            let (head, _) = checkpoint::read(&folder.checkpoint())
                .with_context(|| format!("{} holds a training", path.display()))?;
            if head.step() < head.config.steps {
                bail!(
                    "{}: holds a training that is not done; --resume goes on with it, --run-folder takes another, or \
                     remove it",
                    path.display()
                );
            }
        }
        Ok(folder)
    }

    /// Makes it, if it is not there.
    pub fn make(&self) -> Result<()> {
        let path = &self.path;
        fs::create_dir_all(path).with_context(|| format!("cannot make the folder {}", path.display()))
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The checkpoint's place.
    pub fn checkpoint(&self) -> PathBuf {
        self.path.join(CHECKPOINT)
    }

    /// The training to go on with, if that is asked for.
    pub fn resumed(&self) -> Result<Option<(Head, TrainState)>> {
        if !self.resume {
            return Ok(None);
        }
        Ok(Some(checkpoint::read(&self.checkpoint())?))
    }

    /// Writes down what the training is.
    pub fn write_config(&self, config: &TrainConfig) -> Result<()> {
        let text = serde_json::to_string_pretty(config)?;
        Ok(write_atomically(&self.path.join("config.json"), |out| Ok(writeln!(out, "{text}")?))?)
    }

    /// Opens the metrics: anew, or behind the lines up to `step`. Of a training that is done (`steps`) the
    /// last measurement is left out, since it is made again.
    pub fn metrics(&self, step: u32, steps: u32) -> Result<Metrics> {
        let path = self.path.join("metrics.jsonl");
        let cannot = || format!("cannot write {}", path.display());
        let mut kept = Vec::new();
        if step > 0 && path.exists() {
            for line in BufReader::new(File::open(&path).with_context(cannot)?).lines() {
                let line = line.with_context(cannot)?;
                // A line that was cut off by a crash is no JSON.
                let Ok(value) = serde_json::from_str::<Value>(&line) else { continue };
                let is_last = |at| at == u64::from(steps) && value.get("held_out").is_some();
                if value["step"].as_u64().is_some_and(|at| at <= u64::from(step) && !is_last(at)) {
                    kept.push(line);
                }
            }
        }
        let file =
            OpenOptions::new().create(true).write(true).truncate(true).open(&path).with_context(cannot)?;
        let mut metrics = Metrics { file, path };
        for line in kept {
            metrics.line(&line)?;
        }
        Ok(metrics)
    }
}

/// Reads a training's configuration.
pub fn read_config(path: &Path) -> Result<TrainConfig> {
    let text = fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let config: TrainConfig = serde_json::from_str(&text)
        .with_context(|| format!("{}: is no configuration of a training", path.display()))?;
    config.check().with_context(|| path.display().to_string())?;
    Ok(config)
}

/// One JSON object a line.
pub struct Metrics {
    file: File,
    path: PathBuf,
}

impl Metrics {
    /// Appends an object.
    pub fn add(&mut self, value: &Value) -> Result<()> {
        self.line(&value.to_string())
    }

    fn line(&mut self, line: &str) -> Result<()> {
        writeln!(self.file, "{line}").with_context(|| format!("cannot write {}", self.path.display()))
    }
}
