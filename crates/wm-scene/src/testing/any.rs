//! Scenes of any values, for properties.

use crate::reflectance::LabelReflectance;
use crate::survey::Confidence;
use crate::{
    Group, Lamp, LitWindow, Metadata, PhotoSun, Rasterization, Scene, Splats, origin, sh, splats::Splat,
};
use glam::DVec3;
use proptest::prelude::*;

/// A grey ball at the origin, as something to change.
pub const SPLAT: Splat = Splat {
    mean: [0.0; 3],
    quat: [1.0, 0.0, 0.0, 0.0],
    log_scale: [0.0; 3],
    logit_opacity: 0.0,
    rgb: [0.5; 3],
    group: Group::Scene,
};

/// Any bit pattern that ASCII can carry: all but NaNs with a payload.
pub fn any_f32() -> impl Strategy<Value = f32> {
    any::<u32>().prop_map(|bits| {
        let value = f32::from_bits(bits);
        if value.is_nan() { f32::NAN } else { value }
    })
}

/// Scenes of 1 to `most` splats of any values, groups and metadata.
pub fn any_scene(most: usize) -> impl Strategy<Value = Scene> {
    let shape = (1..=most, 0..=sh::MAX_DEGREE, any::<bool>());
    shape.prop_flat_map(|(count, degree, grouped)| {
        let width = 11 + sh::coefficients(degree) * 3;
        let values = prop::collection::vec(any_f32(), count * width);
        let groups = prop::collection::vec(0..if grouped { 3u8 } else { 1 }, count);
        (values, groups, any_metadata()).prop_map(move |(values, groups, metadata)| {
            let mut splats = Splats::with_capacity(count, degree);
            for (row, group) in values.chunks_exact(width).zip(groups) {
                push_row(&mut splats, row, Group::from_number(group).unwrap());
            }
            let mut scene = Scene { splats, metadata, ..Scene::default() };
            // One that is far from zero is read relative to an origin, if it states none.
            if origin::is_far(&scene.splats) {
                scene.metadata.origin = Some(DVec3::new(4e6, -0.125, 7.0));
            }
            scene
        })
    })
}

/// Appends a splat of the numbers of its mean, quaternion, scales, opacity and SH.
pub fn push_row(splats: &mut Splats, row: &[f32], group: Group) {
    splats.means.push([row[0], row[1], row[2]]);
    splats.quats.push([row[3], row[4], row[5], row[6]]);
    splats.log_scales.push([row[7], row[8], row[9]]);
    splats.logit_opacities.push(row[10]);
    splats.sh.extend(&row[11..]);
    splats.groups.push(group);
}

/// Metadata that state everything.
pub fn full() -> Metadata {
    Metadata {
        origin: Some(DVec3::new(5e5, -0.1, 4e6)),
        metres_per_unit: Some(16.4),
        scale_source: Some("a tape".into()),
        scale_confidence: Some(Confidence::Likely),
        up: Some(DVec3::new(0.6, -0.8, 0.0)),
        up_source: Some("a plumb line".into()),
        up_confidence: Some(Confidence::Guess),
        north: Some(DVec3::new(0.8, 0.6, 0.0)),
        north_source: Some("a compass".into()),
        location: Some([-33.5, 151.25]),
        captured: Some(1_717_059_360.5),
        captured_span: Some(95.25),
        sun: Some(PhotoSun::Towards(DVec3::new(0.8, 0.0, -0.6))),
        ground: Some(-1.5),
        ground_confidence: Some(Confidence::Likely),
        camera_height: Some(0.1),
        airlight: Some([0.7, 0.75, 0.8]),
        white_card: Some(1.5),
        haze_extinction: Some(0.4),
        haze_extinction_error: Some(0.03),
        haze_shown_extinction: Some(0.42),
        haze_airlight: Some([0.5, 0.55, 0.6]),
        water: Some(vec![vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 2.0, 0.5]]]),
        water_labels: Some(vec![3, 21]),
        lamps: Some(vec![
            Lamp::new([0.5, -1.5, 6.0]),
            Lamp { aim: Some([0.0, 0.5, -1.0]), beam: 90.0, ..Lamp::new([1.5, 2.0, 6.0]) },
        ]),
        windows: Some(vec![LitWindow {
            corner: [0.0, 1.0, 2.0],
            across: [1.5, 0.0, 0.0],
            upwards: [0.0, 0.25, 1.0],
            luminance: 20.0,
            kelvin: 2700.0,
        }]),
        reflectances: Some(vec![
            LabelReflectance { label: 7, reflectance: 0.25, wavelength: None },
            LabelReflectance { label: 7, reflectance: 0.5, wavelength: Some(905.0) },
        ]),
        rasterization: Some(Rasterization::Antialiased),
        provenance: Some("a test".into()),
    }
}

fn any_metadata() -> impl Strategy<Value = Metadata> {
    let numbers = prop::option::of((1e-9..1e9f64, -1e9..1e9f64));
    (numbers, prop::option::of("[^\\p{C}]{0,30}"), any::<bool>()).prop_map(|(numbers, provenance, some)| {
        let others = if some { full() } else { Metadata::default() };
        Metadata {
            metres_per_unit: numbers.map(|n| n.0.clamp(1e-6, 1e6)),
            scale_source: numbers.is_some().then(|| provenance.clone()).flatten(),
            scale_confidence: numbers.map(|_| Confidence::Likely),
            ground: numbers.map(|n| n.1),
            ground_confidence: others.ground_confidence.filter(|_| numbers.is_some()),
            camera_height: numbers.map(|n| n.0),
            airlight: numbers.map(|n| [n.0, 0.0, 0.5]),
            white_card: numbers.map(|n| n.0.clamp(0.1, 20.0)),
            haze_extinction: numbers.map(|n| n.0),
            haze_extinction_error: numbers.filter(|_| some).map(|n| n.0),
            haze_shown_extinction: numbers.filter(|_| some).map(|n| n.0),
            haze_airlight: numbers.map(|n| [n.0, 0.0, 0.5]),
            provenance,
            ..others
        }
    })
}

/// The bits of every value: NaNs compare equal, zeros of other sign do not.
pub fn bits(splats: &Splats) -> Vec<u32> {
    let arrays = [
        splats.means.as_flattened(),
        splats.quats.as_flattened(),
        splats.log_scales.as_flattened(),
        &splats.logit_opacities,
        &splats.sh,
    ];
    let values = arrays.into_iter().flatten().map(|v| v.to_bits());
    values.chain(splats.groups.iter().map(|g| *g as u32)).chain([u32::from(splats.sh_degree)]).collect()
}
