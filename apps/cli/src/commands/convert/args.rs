//! Options of `convert`.

use crate::choices::{Choice, SKIES, one_of};
use crate::overwrite::OverwriteArgs;
use crate::scene::RunArgs;
use clap::Args;
use glam::DVec3;
use std::path::PathBuf;
use std::str::FromStr;
use weather_magician::formats::{GltfSplats, SpzVersion};
use weather_magician::view::spec;
use weather_magician::{CropBox, LengthScale, Metadata};
use wm_scene::levels::MAX_LEVELS;
use wm_scene::survey::OwnSky;

/// Options of `convert`.
#[derive(Args, Debug)]
#[command(
    after_help = "Formats: .ply, .compressed.ply, .spz, .sog, FOLDER/meta.json (SOG), FOLDER/lod-meta.json (levels of detail), .glb, \
                        .splat, .ksplat; of a scene in levels of detail also FOLDER/tileset.json (3D Tiles). \
                        docs/guide/formats.md says what each loses.\n\n\
                        weather-magician convert garden.ply garden.spz\n\
                        weather-magician convert scans/*.ply --to sog --folder web/\n\
                        weather-magician convert town.sog small.glb --max-splats 500000 --up 0,1,0\n\
                        weather-magician convert town.ply town/lod-meta.json\n\
                        weather-magician convert city/lod-meta.json city-tiles/tileset.json"
)]
pub(crate) struct ConvertArgs {
    /// Input and output scene; with --to any number of input scenes
    #[arg(required = true, value_name = "PATH")]
    pub(super) paths: Vec<PathBuf>,
    /// Convert every given scene to the format with this extension, such as spz
    #[arg(long, value_name = "ENDING")]
    pub(super) to: Option<String>,
    /// Output folder, with --to; it is made if it is not there [default: beside each scene]
    #[arg(long, value_name = "FOLDER", requires = "to")]
    pub(super) folder: Option<PathBuf>,
    #[command(flatten)]
    pub(super) overwrite: OverwriteArgs,
    /// Remove splats that cannot be drawn (NaN, infinite or absurd numbers, rows of zeros), and
    /// continue
    #[arg(long)]
    pub(super) repair: bool,
    /// Level of a scene with several levels of detail; 0 is the finest [default: the finest, or the
    /// finest that fits --max-splats]
    #[arg(long, value_name = "N")]
    pub(super) level: Option<u32>,
    #[command(flatten)]
    pub(super) change: ChangeArgs,
    /// Number of levels of a lod-meta.json, each with half the splats of the one before, or auto:
    /// down to a 128th, of large scenes a 512th
    #[arg(long, value_name = "N|auto", default_value = "auto", help_heading = "Format")]
    pub(super) lod: LevelCount,
    /// Version of SPZ: 3 (gzip, read by most programs) or 4 (Zstandard)
    #[arg(long, value_name = "N", value_parser = one_of(SPZ_VERSIONS), default_value = "3", help_heading = "Format")]
    pub(super) spz_version: SpzVersion,
    /// Encoding of splats in a glTF: floats or SPZ
    #[arg(long, value_name = "HOW", value_parser = one_of(GLTF_SPLATS), default_value = "floats", help_heading = "Format")]
    pub(super) gltf: GltfSplats,
    #[command(flatten)]
    pub(super) run: RunArgs,
}

/// Changes to apply, in this order.
#[derive(Args, Debug)]
#[command(next_help_heading = "Change")]
pub(super) struct ChangeArgs {
    /// Keep only splats in this box, two corners in the axes of the input scene
    #[arg(long, value_name = "X,Y,Z:X,Y,Z", value_parser = parse_box, allow_hyphen_values = true)]
    pub(super) crop: Option<CropBox>,
    /// Rotate the scene so that up becomes this direction, such as 0,1,0
    #[arg(long, value_name = "X,Y,Z", value_parser = spec::parse_direction, allow_hyphen_values = true)]
    pub(super) up: Option<DVec3>,
    /// Up direction in the input scene, for --up [default: from the file, the photos or the splats]
    #[arg(long, value_name = "X,Y,Z", value_parser = spec::parse_direction, allow_hyphen_values = true)]
    pub(super) up_now: Option<DVec3>,
    /// The scene's own sky: keep it, drop it, or rebuild it from what is far and above the horizon
    #[arg(long, value_name = "HOW", value_parser = one_of(SKIES), default_value = "keep")]
    pub(super) sky: OwnSky,
    /// Multiply all lengths by this factor; `metres` makes a unit a metre if the scene's scale is
    /// known
    #[arg(long, value_name = "FACTOR", value_parser = parse_scale)]
    pub(super) scale: Option<LengthScale>,
    /// Keep positions relative to this point of the world, or to none [default: the origin of the
    /// input scene; one is chosen if its coordinates are far from zero]
    #[arg(long, value_name = "X,Y,Z|none", allow_hyphen_values = true)]
    pub(super) origin: Option<GivenOrigin>,
    /// Remove SH above this degree, 0 to 3
    #[arg(long, value_name = "D", value_parser = clap::value_parser!(u8).range(0..=3))]
    pub(super) sh_degree: Option<u8>,
    /// Reduce to this many splats; keeps those that contribute most to views around the scene
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(super) max_splats: Option<u64>,
}

/// An origin as users give it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GivenOrigin(pub(super) DVec3);

impl FromStr for GivenOrigin {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let origin = if text == "none" { DVec3::ZERO } else { spec::parse_point(text)? };
        match (Metadata { origin: Some(origin), ..Metadata::default() }).fault() {
            None => Ok(Self(origin)),
            Some(fault) => Err(fault),
        }
    }
}

/// Number of levels of detail.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum LevelCount {
    Auto,
    Number(u32),
}

impl FromStr for LevelCount {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let number = text.parse().ok().filter(|number| (1..=MAX_LEVELS).contains(number));
        number.map(Self::Number).ok_or_else(|| format!("give a number from 1 to {MAX_LEVELS}, or auto"))
    }
}

/// Versions of SPZ.
const SPZ_VERSIONS: &[Choice<SpzVersion>] = &[("3", "", SpzVersion::V3), ("4", "", SpzVersion::V4)];
/// Encodings of splats in a glTF.
const GLTF_SPLATS: &[Choice<GltfSplats>] =
    &[("floats", "", GltfSplats::Floats), ("spz", "", GltfSplats::Spz)];

/// Reads a box, as two opposite corners.
pub(crate) fn parse_box(text: &str) -> Result<CropBox, String> {
    let (a, b) = text.split_once(':').ok_or("write two corners, such as -5,-5,0:5,5,3")?;
    Ok(CropBox::between(spec::parse_point(a)?, spec::parse_point(b)?))
}

fn parse_scale(text: &str) -> Result<LengthScale, String> {
    if text == "metres" {
        return Ok(LengthScale::Metres);
    }
    let factor = text.parse().ok().filter(|f: &f64| f.is_finite() && *f > 0.0);
    factor.map(LengthScale::Factor).ok_or_else(|| "give a number above 0, or metres".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_and_scales_are_read() {
        let kept = parse_box("1,2,3:-1,0,5").unwrap();
        assert!(
            kept.holds([0.0, 1.0, 4.0]) && !kept.holds([0.0, 1.0, 5.5]) && !kept.holds([f32::NAN, 1.0, 4.0])
        );
        for bad in ["", "1,2,3", "1,2:3,4", "a,b,c:1,2,3"] {
            assert!(parse_box(bad).is_err(), "{bad}");
        }
        assert_eq!("auto".parse(), Ok(LevelCount::Auto));
        assert_eq!("5".parse(), Ok(LevelCount::Number(5)));
        assert!(["0", "65", "-1", "all"].iter().all(|bad| bad.parse::<LevelCount>().is_err()));
        assert_eq!(parse_scale("metres"), Ok(LengthScale::Metres));
        assert!(parse_scale("0").is_err() && parse_scale("-1").is_err() && parse_scale("m").is_err());
    }
}
