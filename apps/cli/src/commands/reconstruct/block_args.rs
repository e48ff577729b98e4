//! Options of a training in blocks.

use clap::Args;
use std::num::NonZero;
use weather_magician::CropBox;
use weather_magician::train::blocks::{BlockCount, BlockOptions, BlockRegion};

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
    pub(super) block: Option<BlockStep>,
    /// Train only what is in this box, two corners in the axes of the capture, with the photos that
    /// show it
    #[arg(long, value_name = "X,Y,Z:X,Y,Z", value_parser = crate::commands::convert::parse_box, allow_hyphen_values = true)]
    region: Option<CropBox>,
}

/// A part of a training in blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BlockStep {
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

    /// Returns the options of the library.
    pub(super) fn options(&self) -> BlockOptions {
        let one = BlockCount::Number(NonZero::<u32>::MIN);
        let region = |CropBox { low, high }| BlockRegion { low: low.to_array(), high: high.to_array() };
        BlockOptions { count: self.blocks.unwrap_or(one), region: self.region.map(region) }
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
