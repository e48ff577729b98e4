//! The light of lamps, with the shadows that things cast in it.

use crate::Result;
use crate::assets::AssetKey;
use crate::assets::cache::AssetFile;
use crate::assets::kind::{Asset, AssetFiles, Keep, Workshop};
use wm_weather::light::{CaptureLight, LampLights, LampShadows};

/// Lamps whose light is kept: those of the scene, and those that are guessed along the path.
const MAX_LAMP_SOURCES: usize = 2;

impl Asset for LampShadows {
    const WORK: &'static str = "casting the shadows of the lamps";
    // They are of single precision: four digits name them, and who reads them compares the others.
    const FILES: Option<AssetFiles<Self>> = Some(AssetFiles {
        name: |lamps| AssetFile {
            word: "lamps",
            numbers: lamps.numbers().into_iter().map(four_digits).collect(),
        },
        read: |lamps, cache, file, splats| {
            let is_it = |found: &Self| found.is_consistent(splats) && are_same(found.lamps(), lamps);
            cache.get(file).filter(is_it)
        },
        write: |asset, cache, file| cache.put(file, asset),
    });
    const KEEP: Keep = Keep::Last(MAX_LAMP_SOURCES);
    const DRAFTS_DO_WITHOUT: bool = true;

    fn needs(_: &LampLights) -> Vec<AssetKey> {
        vec![AssetKey::Light(()), AssetKey::Surfaces(())]
    }

    fn make(lamps: &LampLights, workshop: &Workshop<'_>) -> Result<Self> {
        let source = workshop.source;
        let found = workshop.surfaces()?;
        let capture = workshop.get::<CaptureLight>(());
        let points = found.places(source.splats()?);
        Ok(Self::of(lamps, &found.casters(), capture, points, &source.site)?)
    }
}

/// Returns true if lamps are the same but for their last digits, which differ from system to
/// system.
fn are_same(a: &LampLights, b: &LampLights) -> bool {
    let (a, b) = (a.numbers(), b.numbers());
    let is_near = |(a, b): (f64, f64)| (a - b).abs() <= 1e-5 * a.abs().max(1e-3);
    a.len() == b.len() && a.into_iter().zip(b).all(is_near)
}

/// A number with the upper 13 bits of its mantissa.
fn four_digits(number: f64) -> f64 {
    f64::from_bits((number.to_bits() + (1 << 38)) & !((1 << 39) - 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn last_digits_do_not_matter() {
        for number in [0.0, 1.0, -1234.567, 3e-5] {
            let near = f64::from((number as f32).next_down());
            let is_near = |a: f64| (a - number).abs() <= 1.3e-4 * number.abs() + 1e-30;
            assert!(is_near(four_digits(number)) && is_near(four_digits(near)), "{number}");
        }
        assert_eq!(four_digits(1.0f64.next_down()), 1.0);
    }
}
