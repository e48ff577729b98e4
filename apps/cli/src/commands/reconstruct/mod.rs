//! `reconstruct`: makes a scene from photos.

mod args;
mod block_args;
mod blocks;
mod console;
mod explain;
mod log;
mod lpips;
mod prepare;
mod training_args;
mod watch;

pub(crate) use args::ReconstructArgs;
pub(crate) use weather_magician::train::session::CHECKPOINT;

use crate::commands::convert::levels::{self, is_levels};
use crate::names::{stem_of, with_behind};
use anyhow::{Context, Result, bail};
use console::TrainingConsole;
use explain::explain;
use std::path::PathBuf;
use weather_magician::train::blocks::PLAN;
use weather_magician::train::{Session, TrainConfig};
use wm_base::files::check_writable;
use wm_scene::formats;

/// Runs the command.
pub(crate) fn run(args: &ReconstructArgs) -> Result<()> {
    if !(args.checkpoint_every.is_finite() && args.checkpoint_every > 0.0) {
        bail!("--checkpoint-every {}: must be a number of seconds above 0", args.checkpoint_every);
    }
    args.watch.check()?;
    let facts = args.facts.metadata()?;
    let lpips = lpips::read(args)?;
    let config = args.training.config.as_deref().map(TrainConfig::read).transpose()?;
    let out = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("{}.ply", stem_of(&args.dataset))));
    let beside = if is_levels(&out) {
        let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty());
        folder.with_context(|| format!("{}: give it a folder of its own", out.display()))?.to_path_buf()
    } else {
        formats::format_for(&out)?;
        out.clone()
    };
    check_writable(&beside)?;
    // The scene of the training that is continued may be written again.
    if args.blocks.writes_scene() && (!args.resume || args.run_folder.is_some()) {
        let other = "continue its training with --resume, give another name with --out";
        let other = if args.resume { "give another name with --out" } else { other };
        args.overwrite.check(&out, &[&args.dataset], other)?;
    }
    let run_folder = args.run_folder.clone().unwrap_or_else(|| with_behind(&beside, ".run"));
    let (dataset, facts) = match args.log.open(&args.dataset, args.photos.set.skip_bad)? {
        None => (args.dataset.clone(), facts),
        Some(log) => {
            args.check_run_folder(&run_folder)?;
            let keeps = args.resume || (args.blocks.is_given() && !args.overwrite.overwrite);
            let with_priors = args.geometry.priors.is_none();
            let (photos, held_out) = (&args.photos.set, args.photos.held_out.held_out());
            let made = log::prepare(&log, &run_folder, keeps, with_priors, photos, held_out)?;
            (made.folder, facts.or(made.facts))
        }
    };
    let options = args.options(facts, config, &run_folder);
    let mut console = TrainingConsole::new(&args.dataset, &args.watch, &run_folder);
    let scene = if args.blocks.is_given() {
        let Some(scene) = blocks::train(args, &dataset, &options, &run_folder)? else { return Ok(()) };
        scene
    } else {
        if run_folder.join(PLAN).is_file() {
            bail!(
                "{}: it holds a training in blocks; continue it with --blocks, or choose another --run-folder",
                run_folder.display()
            );
        }
        let mut session = Session::new(&dataset).options(options);
        if let Some(lpips) = lpips {
            session = session.metric(lpips);
        }
        let done = session.run(&mut console);
        console.clear();
        done.map_err(explain)?
    };
    if is_levels(&out) {
        println!("{}", levels::write(&out, scene, Vec::new(), None, &args.run)?);
    } else {
        scene.save(&out)?;
        println!("{}: {} splats", out.display(), scene.splats.len());
    }
    console.end(&out);
    if !args.no_assets
        && let Err(error) = prepare::prepare(&out, &args.run)
    {
        eprintln!("warning: {}: weather is not prepared: {error:#}", out.display());
    }
    Ok(())
}
