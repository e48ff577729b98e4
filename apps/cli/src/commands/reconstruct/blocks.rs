//! `--blocks`: a place in several trainings, one a cell of the ground.

use super::args::ReconstructArgs;
use super::block_args::BlockStep;
use super::console::TrainingConsole;
use super::explain::explain;
use anyhow::{Result, anyhow, bail};
use std::path::Path;
use weather_magician::Scene;
use weather_magician::train::SessionOptions;
use weather_magician::train::blocks::{BlockError, BlockTraining, PLAN, TrainedBlock, remove, remove_block};
use weather_magician::train::session::CHECKPOINT;

/// Does the part of a training in blocks that the options name, or all; returns the scene if there
/// is one now.
pub(crate) fn train(
    args: &ReconstructArgs,
    dataset: &Path,
    options: &SessionOptions,
    folder: &Path,
) -> Result<Option<Scene>> {
    let step = args.blocks.block;
    if !args.photos.lpips.is_empty() {
        bail!(
            "--lpips measures one training; leave it out, and measure the scene with `weather-magician evaluate`"
        );
    }
    if args.watch.is_asked() && !matches!(step, Some(BlockStep::Train(_))) {
        bail!("--view shows one training; leave it out, or give it with --block K");
    }
    if folder.join(CHECKPOINT).is_file() {
        bail!(
            "{}: it holds a training of the whole place; choose another --run-folder, or remove it",
            folder.display()
        );
    }
    if args.overwrite.overwrite {
        match step {
            None | Some(BlockStep::Plan) => remove(folder).map_err(command_error)?,
            Some(BlockStep::Train(block)) => remove_block(folder, block).map_err(command_error)?,
            Some(BlockStep::Join) => {}
        }
    }
    let is_planned = folder.join(PLAN).is_file();
    let mut console = TrainingConsole::new(&args.dataset, &args.watch, folder);
    let opened = BlockTraining::open(dataset, options, &args.blocks.options(), folder, &mut console);
    console.clear();
    let mut blocks = opened.map_err(command_error)?;
    let count = blocks.plan().blocks.len();
    if !is_planned {
        for (index, block) in blocks.plan().blocks.iter().enumerate() {
            let (photos, points) = (block.cameras.len(), block.points);
            println!("block {index}: {photos} of {} photos, {points} points", blocks.plan().photos);
        }
        println!("{}: {count} blocks", folder.join(PLAN).display());
    }
    let chosen = match step {
        Some(BlockStep::Train(block)) => block..block + 1,
        None => 0..count,
        Some(BlockStep::Plan | BlockStep::Join) => 0..0,
    };
    for block in chosen {
        if let Some(done) = blocks.trained(block) {
            println!("{}", line(&blocks, &done, "is trained already"));
            continue;
        }
        eprintln!("block {block} of 0 to {}", count - 1);
        let mut console = TrainingConsole::new(&args.dataset, &args.watch, &blocks.block_folder(block));
        let done = blocks.train(block, &mut console);
        console.clear();
        println!("{}", line(&blocks, &done.map_err(command_error)?, "is trained"));
    }
    if !args.blocks.writes_scene() {
        return Ok(None);
    }
    let mut console = TrainingConsole::new(&args.dataset, &args.watch, folder);
    let scene = blocks.join(&mut console);
    console.clear();
    Ok(Some(scene.map_err(command_error)?))
}

fn line(blocks: &BlockTraining, done: &TrainedBlock, said: &str) -> String {
    let TrainedBlock { block, splats, trained, .. } = done;
    format!("{}: {said}, {splats} of {trained} splats are its own", blocks.block_folder(*block).display())
}

/// The error as the command prints it.
fn command_error(error: BlockError) -> anyhow::Error {
    match error {
        BlockError::Session(error) => explain(*error),
        BlockError::NotTrained { .. } => anyhow!("{error}, each with --block K, or all without --block"),
        error => error.into(),
    }
}
