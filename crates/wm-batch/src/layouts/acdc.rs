//! ACDC's names: photos in bad weather with the same view without it.
//!
//! `rgb_anon/CONDITION/SPLIT/SEQ/SEQ_frame_%06d_rgb_anon.png` and, without weather,
//! `rgb_anon/CONDITION/SPLIT_ref/SEQ/SEQ_frame_%06d_rgb_ref_anon.png`, both 8-bit RGB.
//!
//! - SEQ is the clip's name, with `-CAMERA` if the rig has more than one camera.
//! - CONDITION is what prevails: `fog`, `rain`, `snow`, `night`, which are ACDC's, and `clear` or
//!   `dust`, which readers of ACDC do not look into.
//! - ACDC's references were taken nearby on another day; these are the same view at the same
//!   instant, so a pair fits to the pixel.
//! - There is no calibration; lidars and radars are left out. `gt` is left out too: the scenes have
//!   no classes of Cityscapes.
//!
//! Source: acdc.vision.ee.ethz.ch and configurations of public models that read the set
//! (w1oves/Rein, `fog-acdc_1024x1024.py`).

use super::{BlockWriter, FileSink, LayerNeeds, Layout};
use crate::cameras::{cameras, check_cameras, layer, picture};
use crate::{BlockInfo, SensorReading, picture_files};

const NAME: &str = "acdc";

pub(super) const LAYOUT: Layout = Layout {
    name: NAME,
    about: "ACDC's names: PNG by condition, each with the same view without weather",
    needs: LayerNeeds { clean: true, ..LayerNeeds::NONE },
    needs_every_sensor: false,
    check: |set| check_cameras(NAME, set),
    block,
    tables: |_, _, _| Ok(()),
};

fn block(block: BlockInfo<'_>) -> Box<dyn BlockWriter + '_> {
    let BlockInfo { set, clip, .. } = block;
    Box::new(move |reading: &SensorReading<'_>, files: &mut dyn FileSink| {
        let Some((sensor, camera, picture)) = picture(set, reading) else { return Ok(()) };
        let sequence = match cameras(set).count() {
            1 => clip.name.clone(),
            _ => format!("{}-{}", clip.name, sensor.name),
        };
        let (condition, split, index) = (clip.weather.condition.name(), &clip.split, reading.info.index);
        let path = |folder: &str, end: &str| {
            format!("rgb_anon/{condition}/{folder}/{sequence}/{sequence}_frame_{index:06}_{end}_anon.png")
        };
        let clean = layer(sensor, camera, picture.clean, 3, "picture without weather")?;
        files.write(&path(split, "rgb"), &picture_files::png(sensor, camera, picture.rgb)?)?;
        files.write(&path(&format!("{split}_ref"), "rgb_ref"), &picture_files::png(sensor, camera, clean)?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    #[test]
    fn each_picture_has_its_reference() {
        let files = testing::written(&LAYOUT, 8);
        assert_eq!(files.len(), 2 * 2 * 3 * testing::FRAMES_PER_CLIP as usize);
        let name = "000000-bend-rain-front";
        let weathered = format!("rgb_anon/rain/train/{name}/{name}_frame_000007_rgb_anon.png");
        let clean = format!("rgb_anon/rain/train_ref/{name}/{name}_frame_000007_rgb_ref_anon.png");
        // The red spot is only in the weathered one.
        assert_ne!(files[&weathered], files[&clean]);
        assert!(files.keys().any(|path| path.starts_with("rgb_anon/snow/val/")));
    }
}
