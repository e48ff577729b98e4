//! SOG in several levels of detail, read by its `lod-meta.json`.

use super::axes::Axes;
use super::format::{ReadOptions, SceneFormat, Writer, has_ending};
use super::sog::LOSES;
use crate::Scene;
use crate::levels::LevelIndex;
use wm_base::error::FormatError;
use wm_base::source::Source;

/// The entry of [`FORMATS`](crate::formats::FORMATS).
pub(super) const FORMAT: SceneFormat = SceneFormat {
    name: "streamed SOG",
    extensions: &[],
    about: "PlayCanvas SOG with several levels of detail, as a folder: its lod-meta.json",
    axes: Axes::Ply,
    loses: LOSES,
    sniff: |start| has_ending(start.path, "lod-meta.json"),
    read,
    write: Writer::Nothing,
};

fn read(source: &mut Source, options: &ReadOptions) -> Result<Scene, FormatError> {
    let index = source.parsed(|text, main| LevelIndex::parse(main, text))?;
    index.read_level(options.level)
}
