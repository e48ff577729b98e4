//! `--blocks`: a place in several trainings, one a cell of the ground.

use super::console::TrainingConsole;
use super::{ReconstructArgs, explain::explain};
use anyhow::{Result, anyhow, bail};
use clap::Args;
use std::num::NonZero;
use std::path::Path;
use weather_magician::train::SessionOptions;
use weather_magician::train::blocks::{
    BlockCount, BlockError, BlockOptions, BlockRegion, BlockTraining, PLAN, TrainedBlock, remove,
    remove_block,
};
use weather_magician::train::session::CHECKPOINT;
use weather_magician::{CropBox, Scene};

/// The part of the place that is trained, and in how many blocks.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Blocks")]
pub(crate) struct BlockArgs {
    /// Cut the ground into this many cells, train each with the photos that show it, and join them;
    /// auto takes one for every 400 photos. What is done already is kept, so the same command
    /// continues
    #[arg(long, value_name = "N|auto", value_parser = parse_count)]
    blocks: Option<BlockCount>,
    /// Do one part of it, on any machine with the same folders: plan (write blocks.json), the
    /// number of a block from 0 (train it) or join (write the scene)
    #[arg(long, value_name = "plan|K|join", value_parser = parse_step, requires = "blocks")]
    block: Option<BlockStep>,
    /// Train only what is in this box, two corners in the axes of the capture, with the photos that
    /// show it
    #[arg(long, value_name = "X,Y,Z:X,Y,Z", value_parser = crate::commands::convert::parse_box, allow_hyphen_values = true)]
    region: Option<CropBox>,
}

/// A part of a training in blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum BlockStep {
    Plan,
    Train(usize),
    Join,
}

fn parse_count(text: &str) -> Result<BlockCount, String> {
    if text == "auto" {
        return Ok(BlockCount::Auto);
    }
    let count: Option<NonZero<u32>> = text.parse().ok();
    count.map(BlockCount::Number).ok_or_else(|| "write a number from 1, or auto".into())
}

fn parse_step(text: &str) -> Result<BlockStep, String> {
    match text {
        "plan" => Ok(BlockStep::Plan),
        "join" => Ok(BlockStep::Join),
        number => {
            let number = number.parse().map_err(|_| "write plan, join, or the number of a block from 0")?;
            Ok(BlockStep::Train(number))
        }
    }
}

impl BlockArgs {
    /// Returns true if the place is trained in blocks.
    pub(crate) fn is_given(&self) -> bool {
        self.blocks.is_some() || self.region.is_some()
    }

    /// Returns true if this run writes a scene.
    pub(crate) fn writes_scene(&self) -> bool {
        matches!(self.block, None | Some(BlockStep::Join))
    }

    fn options(&self) -> BlockOptions {
        let one = BlockCount::Number(NonZero::<u32>::MIN);
        let region = |CropBox { low, high }| BlockRegion { low: low.to_array(), high: high.to_array() };
        BlockOptions { count: self.blocks.unwrap_or(one), region: self.region.map(region) }
    }
}

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
    let mut console = TrainingConsole::new(args, folder);
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
        let mut console = TrainingConsole::new(args, &blocks.block_folder(block));
        let done = blocks.train(block, &mut console);
        console.clear();
        println!("{}", line(&blocks, &done.map_err(command_error)?, "is trained"));
    }
    if !args.blocks.writes_scene() {
        return Ok(None);
    }
    let mut console = TrainingConsole::new(args, folder);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_steps_are_read() {
        assert_eq!(parse_count("auto"), Ok(BlockCount::Auto));
        assert_eq!(parse_count("3"), Ok(BlockCount::Number(NonZero::new(3).unwrap())));
        assert!(parse_count("0").is_err() && parse_count("-1").is_err());
        assert_eq!(
            ["plan", "7", "join"].map(parse_step),
            [Ok(BlockStep::Plan), Ok(BlockStep::Train(7)), Ok(BlockStep::Join)]
        );
        assert!(parse_step("all").is_err());
    }
}
