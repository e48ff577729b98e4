//! `priors`: computes depth, normals and sky of photos before a training; one file per source.

mod args;
mod data;
mod files;
mod network;
mod preview;
mod source;
pub(crate) mod work;

pub(crate) use args::PriorsArgs;

use crate::interrupt;
use crate::progress;
use crate::scene::threads;
use anyhow::{Result, bail};
use args::SourceArg;
use std::path::Path;
use weather_magician::train::dataset::orientation;
use weather_magician::train::priors::folder::{INDEX, Index};
use weather_magician::train::priors::photos;
use wm_base::statistics::median;

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
            let network = network::open(&args.network, args.map_pixels)?;
            let data = data::open(&args.dataset, &args.photos)?;
            work::run(args, &data, network.as_ref())
        })?,
        SourceArg::Files => threads.install(|| -> Result<Index> {
            let data = data::open(&args.dataset, &args.photos)?;
            work::run(args, &data, &files::open(&args.files, args.map_pixels, &data)?)
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
