//! `priors`: computes depth, normals and sky of photos before a training; one file per source.

mod data;
mod files;
mod network;
mod preview;
pub(crate) mod work;

use crate::interrupt;
use crate::overwrite::OverwriteArgs;
use crate::progress;
use crate::scene::threads;
use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};
use weather_magician::train::dataset::orientation;
use weather_magician::train::priors::folder::{INDEX, Index, PriorsError};
use weather_magician::train::priors::{FOLDER, PriorsWriter, photos};
use wm_base::FormatError;
use wm_base::statistics::median;
use wm_capture::folder_of;

/// Options of `priors`.
#[derive(Args, Clone, Debug)]
pub(crate) struct PriorsArgs {
    /// The data set: a folder with a COLMAP model or a transforms.json
    dataset: PathBuf,
    /// Output folder [default: priors in the data set, where `reconstruct` finds them]
    #[arg(short, long, value_name = "FOLDER", help_heading = "Output")]
    out: Option<PathBuf>,
    /// Continue stopped work, or add new photos; the other options must be the same
    #[arg(long, help_heading = "Output")]
    resume: bool,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Also write a preview of each photo with its depth, normals and sky; preview.png always shows
    /// six of them
    #[arg(long, help_heading = "Output")]
    preview: bool,
    /// Maximum number of pixels of a map that is written
    #[arg(long, value_name = "N", default_value_t = 300_000, value_parser = clap::value_parser!(u32).range(64..=64_000_000), help_heading = "Output")]
    map_pixels: u32,
    /// Source of the priors: photos (stereo and colours), network (relative depth of each photo,
    /// fitted to the points) or files (maps that you have) [default: files if --depth, --normal or
    /// --sky is given, network if --weights or --network is, else photos]
    #[arg(long, value_name = "SOURCE")]
    source: Option<SourceArg>,
    /// Number of threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024), help_heading = "Run")]
    threads: Option<u16>,
    #[command(flatten)]
    photos: data::PhotoArgs,
    #[command(flatten)]
    network: network::NetworkArgs,
    #[command(flatten)]
    files: files::FileArgs,
}

/// The source of priors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SourceArg {
    /// The photos.
    Photos,
    /// A network.
    Network,
    /// Maps.
    Files,
}

impl PriorsArgs {
    fn source(&self) -> Result<SourceArg> {
        let (files, network) = (self.files.given(), self.network.given());
        let usual = match (files, network) {
            (Some(_), _) => SourceArg::Files,
            (None, Some(_)) => SourceArg::Network,
            (None, None) => SourceArg::Photos,
        };
        let source = self.source.unwrap_or(usual);
        let wrong = match source {
            SourceArg::Photos => files.or(network),
            SourceArg::Network => files,
            SourceArg::Files => network,
        };
        if let Some(option) = wrong {
            let name =
                source.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default();
            bail!("{option} cannot be used with the source {name}; leave one of them out");
        }
        if source == SourceArg::Files && files.is_none() {
            bail!("--source files needs maps; name their folders with --depth, --normal or --sky");
        }
        Ok(source)
    }

    fn out(&self) -> PathBuf {
        self.out.clone().unwrap_or_else(|| folder_of(&self.dataset).join(FOLDER))
    }

    /// Returns the writer; its errors advise another folder if the folder is the default.
    fn writer(&self, source: String) -> Result<PriorsWriter> {
        let folder = self.out();
        let writer = match self.resume {
            true => PriorsWriter::resumed(&folder, &source),
            false => PriorsWriter::new(&folder, source).map_err(PriorsError::from),
        };
        let is_default = self.out.is_none();
        writer.map_err(|error| match error {
            PriorsError::File(FormatError { .. }) if is_default => {
                anyhow::anyhow!("{error}; give another folder with -o")
            }
            error => error.into(),
        })
    }
}

/// Runs the command.
pub(crate) fn run(args: &PriorsArgs) -> Result<()> {
    let source = args.source()?;
    if !args.resume {
        let other = "add new photos with --resume, give another folder with -o";
        args.overwrite.check(&args.out().join(INDEX), &[], other)?;
    }
    let threads = threads(args.threads)?;
    let index = match source {
        SourceArg::Photos => from_photos(args, &threads)?,
        SourceArg::Network => threads.install(|| -> Result<Index> {
            // Weights are checked before photos are read.
            let network = network::open(args)?;
            let data = data::open(&args.dataset, &args.photos)?;
            work::run(args, &data, network.as_ref())
        })?,
        SourceArg::Files => threads.install(|| -> Result<Index> {
            let data = data::open(&args.dataset, &args.photos)?;
            work::run(args, &data, &files::open(args, &data)?)
        })?,
    };
    report(&args.out(), &index);
    Ok(())
}

fn from_photos(args: &PriorsArgs, threads: &rayon::ThreadPool) -> Result<Index> {
    if args.resume {
        bail!("--resume: stereo is done for all photos at once; leave it out to start again");
    }
    let data = threads.install(|| data::open(&args.dataset, &args.photos))?;
    // The folder is checked before the work; stereo has a writer of its own.
    args.writer(photos::SOURCE.into())?.abandon();
    let out = args.out();
    let bar = progress::bar(2 * data.places.len() as u64, "passes of stereo");
    let (up, _) = orientation(&data.capture, &data.photos, None);
    let (capture, places, up) = (&data.capture, &data.places, up.as_ref());
    let written = photos::write_folder(capture, &data.photos, places, up, threads, &out, &mut |done| {
        bar.set_position(done as u64);
        interrupt::flow()
    })?;
    bar.finish_and_clear();
    let Some(index) = written else {
        return Err(interrupt::stopped(format!("{} holds no priors yet", out.display())));
    };
    preview::write(args, &data)?;
    Ok(index)
}

/// Prints the priors of each photo, and a summary.
fn report(folder: &Path, index: &Index) {
    let wide = index.photos.keys().map(|name| name.chars().count()).max().unwrap_or(0).max(5);
    let share = |share: f32| format!("{:8.1}", 100.0 * share);
    let fits = index.photos.values().any(|entry| entry.fit.is_some());
    let titles = if fits { "  points  follow %  residual %       scale       shift" } else { "" };
    println!("{:wide$}   known %     sky %{titles}", "photo");
    for (name, entry) in &index.photos {
        let fit = match &entry.fit {
            Some(fit) => format!(
                "{:8}  {:8.1}  {:10.2} {:11.4e} {:11.4e}",
                fit.points,
                100.0 * fit.follow,
                100.0 * fit.residual,
                fit.scale,
                fit.shift
            ),
            None => String::new(),
        };
        let line = format!("{name:wide$}  {}  {}{fit}", share(entry.known), share(entry.sky_share));
        println!("{}", line.trim_end());
    }
    let mut residuals: Vec<f64> =
        index.photos.values().filter_map(|entry| Some(entry.fit?.residual)).collect();
    let residual = median(&mut residuals)
        .map(|median| format!(", off the points by {:.2} % (the median photo's residual)", 100.0 * median));
    println!("{}: {}{}", folder.display(), index.summary(), residual.unwrap_or_default());
}
