//! Driving logs: the capture and the priors that are made of them before the training.

use crate::choices::first_given;
use crate::commands::priors::work::{PriorResult, make_part};
use crate::dataset::DatasetArgs;
use crate::interrupt;
use crate::progress;
use crate::scene::print_remarks;
use anyhow::{Result, bail};
use clap::Args;
use indicatif::ProgressBar;
use std::path::{Path, PathBuf};
use weather_magician::Metadata;
use weather_magician::train::HeldOut;
use weather_magician::train::photos::Check;
use weather_magician::train::priors::files::{DepthFiles, FileMaps, MapsOf};
use weather_magician::train::priors::fit::Freedom;
use weather_magician::train::priors::folder::INDEX;
use weather_magician::train::priors::{FOLDER, PriorsWriter};
use weather_magician::wm_image::maps::{DepthForm, DepthUnit, MapFolder};
use wm_capture::CaptureUp;
use wm_capture::logs::LogCaptureStep;
use wm_capture::up::UpEvidence;
use wm_capture::{DrivingLog, LogCaptureOptions, LogOptions};

/// The folder of the capture in the run folder.
const CAPTURE: &str = "capture";
/// The file without which a folder is no capture; it is written last.
const COMPLETE: &str = "transforms.json";
const MAX_PRIOR_PIXELS: u32 = 300_000;
/// Photos whose priors are made at once.
const PHOTOS_PER_BATCH: usize = 64;

/// The part of a driving log that is read.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Driving log")]
pub(crate) struct LogArgs {
    /// The log among several in the folder: a scene, a drive or a sequence [default: the first
    /// whose files are there]
    #[arg(long, value_name = "NAME")]
    log_scene: Option<String>,
    /// Cameras of the log, by its names for them, separated by commas [default: all that take
    /// colour pictures]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    log_cameras: Vec<String>,
    /// Take every N-th picture of each camera [default: as needed for at most 600 pictures]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    log_every: Option<u32>,
    /// Seconds of the log to read, from its start [default: all]
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u32).range(1..))]
    log_seconds: Option<u32>,
}

/// A log that has become a data set.
pub(crate) struct LogDataset {
    /// The folder of the capture.
    pub(crate) folder: PathBuf,
    /// Up, scale, north, place and time.
    pub(crate) facts: Metadata,
}

impl LogArgs {
    fn options(&self, skip_bad: bool) -> LogOptions {
        LogOptions {
            scene: self.log_scene.clone(),
            cameras: self.log_cameras.clone(),
            stride: self.log_every.unwrap_or(0) as usize,
            seconds: self.log_seconds,
            skip_bad,
            ..LogOptions::default()
        }
    }

    /// The name of the first option that was given.
    fn given(&self) -> Option<&'static str> {
        first_given([
            (self.log_scene.is_some(), "--log-scene"),
            (!self.log_cameras.is_empty(), "--log-cameras"),
            (self.log_every.is_some(), "--log-every"),
            (self.log_seconds.is_some(), "--log-seconds"),
        ])
    }

    /// Opens the log in a folder; `None` if it holds none. Prints warnings on the error stream.
    /// Damaged records are left out if `skip_bad`.
    ///
    /// # Errors
    /// The log is damaged, or options of logs were given and there is none.
    pub(crate) fn open(&self, dataset: &Path, skip_bad: bool) -> Result<Option<DrivingLog>> {
        let Some(log) = DrivingLog::open(dataset, &self.options(skip_bad))? else {
            if let Some(option) = self.given() {
                bail!("{}: no driving log, which {option} is for; leave it out", dataset.display());
            }
            return Ok(None);
        };
        let (cameras, pictures, sweeps) = (log.cameras.len(), log.pictures.len(), log.sweeps.len());
        println!(
            "{} log {}: {pictures} pictures of {cameras} cameras, {sweeps} sweeps",
            log.format, log.name
        );
        for warning in &log.warnings {
            eprintln!("warning: {}: {warning}", dataset.display());
        }
        Ok(Some(log))
    }
}

/// Makes the capture of a log in the run folder, and its priors if `with_priors`. What is complete
/// is kept if `keeps`.
///
/// # Errors
/// A file of the log is damaged, the run folder cannot be written to, or Ctrl-C was pressed.
pub(crate) fn prepare(
    log: &DrivingLog,
    run_folder: &Path,
    keeps: bool,
    with_priors: bool,
    photos: &DatasetArgs,
    held_out: HeldOut,
) -> Result<LogDataset> {
    let folder = run_folder.join(CAPTURE);
    let facts = log.facts();
    if !(keeps && folder.join(COMPLETE).is_file()) {
        write(log, &folder, photos.skip_bad)?;
    }
    let is_made = keeps && folder.join(FOLDER).join(INDEX).is_file();
    if with_priors && !is_made && folder.join("depth").is_dir() {
        priors(&folder, photos, held_out, &facts)?;
    }
    Ok(LogDataset { folder, facts })
}

fn write(log: &DrivingLog, folder: &Path, skip_bad: bool) -> Result<()> {
    let mut bar: Option<(&'static str, ProgressBar)> = None;
    let mut show = |step: LogCaptureStep| {
        let (what, done, total) = match step {
            LogCaptureStep::Sweeps { done, total } => ("sweeps", done, total),
            LogCaptureStep::Pictures { done, total } => ("pictures", done, total),
        };
        if bar.as_ref().is_none_or(|(own, _)| *own != what) {
            bar.iter().for_each(|(_, bar)| bar.finish_and_clear());
            bar = Some((what, progress::bar(total as u64, what)));
        }
        bar.iter().for_each(|(_, bar)| bar.set_position(done as u64));
        interrupt::flow()
    };
    let written =
        log.write_capture(folder, &LogCaptureOptions { skip_bad, ..LogCaptureOptions::default() }, &mut show);
    bar.iter().for_each(|(_, bar)| bar.finish_and_clear());
    let Some(written) = written? else {
        return Err(interrupt::stopped("the log is not read yet"));
    };
    for warning in written.warnings.iter().filter(|warning| !log.warnings.contains(warning)) {
        eprintln!("warning: {}: {warning}", log.source.display());
    }
    println!(
        "{}: {} points, {} depth maps, {} masks of {} movers",
        folder.display(),
        written.points,
        written.depth_maps,
        written.masks,
        written.movers
    );
    Ok(())
}

/// Makes the priors of the depth that the lidar measured. It is not held against the points: these
/// are seen through walls.
fn priors(folder: &Path, photos: &DatasetArgs, held_out: HeldOut, facts: &Metadata) -> Result<()> {
    let options = photos.options();
    let capture = options.capture(folder)?;
    print_remarks(&capture.remarks);
    let photos = options.photos(folder, &capture, Check::default())?;
    let (_, places) = held_out.split(&photos);
    let depth = DepthFiles {
        folder: MapFolder::new(folder.join("depth")),
        form: DepthForm::Z,
        unit: Some(DepthUnit::Metres(1.0)),
        freedom: Freedom::Known(1.0),
    };
    let sky = folder.join("sky");
    let maps = FileMaps {
        depth: Some(depth),
        normal: None,
        sky: sky.is_dir().then(|| MapFolder::new(sky)),
        of: MapsOf::Pinhole,
        pixels: MAX_PRIOR_PIXELS,
    };
    let up = facts.up.map(|up| CaptureUp { up, error: 0.0, evidence: UpEvidence::Given });
    let mut writer = PriorsWriter::new(&folder.join(FOLDER), "the lidar of a driving log".into())?;
    let name = |place: usize| capture.views[photos.view(place)].name.as_str();
    let bar = progress::bar(places.len() as u64, "priors");
    for part in places.chunks(PHOTOS_PER_BATCH) {
        if interrupt::asked() {
            bar.finish_and_clear();
            writer.abandon();
            return Err(interrupt::stopped("the priors of the log are not made yet"));
        }
        let make = |place: &usize| -> Result<PriorResult> {
            let photo = match photos.get(*place, 0) {
                Ok(photo) => photo,
                Err(error) => return Ok(Err(error.to_string())),
            };
            let Some(given) = maps.look(&photos, *place, name(*place))? else {
                return Ok(Err("no sweep is near it in time".into()));
            };
            let seed = photos.view(*place) as u64;
            Ok(given.prior(&photo, &[], up.as_ref(), seed).map_err(|reason| reason.to_string()))
        };
        make_part(part, &make, &|place| name(*place), &mut writer, &bar)?;
    }
    bar.finish_and_clear();
    if writer.index().photos.is_empty() {
        eprintln!("warning: {}: no picture has a prior from the lidar", folder.display());
        writer.abandon();
        return Ok(());
    }
    let index = writer.finish()?;
    println!("{}: {}", folder.join(FOLDER).display(), index.summary());
    Ok(())
}
