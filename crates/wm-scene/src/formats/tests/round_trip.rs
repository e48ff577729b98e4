//! Scenes come back from every format within the rounding that it states.

use super::*;
use crate::formats::pack::unit;
use crate::splats::sigmoid;
use crate::testing::Dice;
use crate::{Group, Rasterization, morton, sh};

/// A random whole number below `most`.
pub fn below(dice: &mut Dice, most: usize) -> usize {
    dice.draw(0.0, most as f64) as usize % most
}

/// A scene as trainings make them: means within 30 units, scales of e^-7 to e^-1, SH within 1.
pub fn plausible(count: usize, degree: u8) -> Scene {
    let mut dice = Dice::new(count as u64);
    let mut next = || dice.draw(-1.0, 1.0) as f32;
    let mut splats = Splats::with_capacity(count, degree);
    for _ in 0..count {
        splats.means.push([(); 3].map(|()| 30.0 * next()));
        splats.quats.push(unit([(); 4].map(|()| next())));
        splats.log_scales.push([(); 3].map(|()| 3.0 * next() - 4.0));
        splats.logit_opacities.push(4.0 * next());
        splats.sh.extend((0..3).map(|_| 1.7 * next()));
        splats.sh.extend((3..sh::coefficients(degree) * 3).map(|_| 0.9 * next()));
        splats.groups.push(Group::Scene);
    }
    let metadata = Metadata {
        metres_per_unit: Some(0.5),
        up: Some(DVec3::new(0.6, -0.8, 0.0)),
        rasterization: Some(Rasterization::Antialiased),
        ..Metadata::default()
    };
    Scene { splats, metadata, ..Scene::default() }
}

/// Largest errors.
#[derive(Clone, Copy, Debug)]
struct Errors {
    mean: f32,
    log_scale: f32,
    /// Degrees.
    rotation: f32,
    opacity: f64,
    /// Tolerance of the colour of degree 0 as it is shown.
    color: f32,
    sh: f32,
}

impl Errors {
    fn of(a: &Splats, b: &Splats, order: &[u32], names: Names) -> Self {
        let mut worst = Self { mean: 0.0, log_scale: 0.0, rotation: 0.0, opacity: 0.0, color: 0.0, sh: 0.0 };
        let far = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        for (there, here) in order.iter().enumerate().map(|(i, o)| (i, *o as usize)) {
            worst.mean = worst.mean.max(far(&a.means[here], &b.means[there]));
            let (rotation, axes) = names.turn(unit(a.quats[here]), unit(b.quats[there]));
            worst.rotation = worst.rotation.max(rotation);
            let renamed = axes.map(|axis| a.log_scales[here][axis]);
            worst.log_scale = worst.log_scale.max(far(&renamed, &b.log_scales[there]));
            let opacity = |splats: &Splats, i: usize| sigmoid(f64::from(splats.logit_opacities[i]));
            worst.opacity = worst.opacity.max((opacity(a, here) - opacity(b, there)).abs());
            let (x, y) = (a.sh_of(here), b.sh_of(there));
            worst.color = worst.color.max(far(&x[..3], &y[..3]) * sh::C0 as f32);
            worst.sh = worst.sh.max(far(&x[3..], &y[3..]));
        }
        worst
    }

    fn within(&self, most: &Self) -> bool {
        self.mean <= most.mean
            && self.log_scale <= most.log_scale
            && self.rotation <= most.rotation
            && self.opacity <= most.opacity
            && self.color <= most.color
            && self.sh <= most.sh
    }
}

/// The order of an ellipsoid's axes in a format: kept, or lost.
#[derive(Clone, Copy, PartialEq)]
enum Names {
    Kept,
    Lost,
}

impl Names {
    /// The turn from one unit quaternion to another, degrees, and which axis of the first each of
    /// the second is.
    fn turn(self, p: [f32; 4], q: [f32; 4]) -> (f32, [usize; 3]) {
        let namings = if self == Self::Kept { &sog::NAMINGS[..1] } else { &sog::NAMINGS };
        let turns = namings.iter().map(|(turn, axes)| {
            let [w, x, y, z] = sog::product(p, *turn);
            let mut parts = sog::product([w, -x, -y, -z], q).map(f32::abs);
            // Half turns about an axis change no name.
            if self == Self::Lost {
                parts.sort_by(|a, b| b.total_cmp(a));
            }
            let sine = parts[1..].iter().map(|v| v * v).sum::<f32>().sqrt();
            (2.0 * sine.min(1.0).asin().to_degrees(), *axes)
        });
        turns.reduce(|a, b| if b.0 < a.0 { b } else { a }).expect("a naming")
    }
}

/// The rounding of each format over [`plausible`]: half a step of what it stores, from the ranges
/// there.
fn rounding(name: &str) -> Errors {
    // Colours of 1.7 clip at 0 and 1 where they are stored as shown.
    let byte = 0.5 / 255.0 + 1e-6;
    match name {
        "PLY" => Errors { mean: 0.0, log_scale: 0.0, rotation: 1e-2, opacity: 0.0, color: 0.0, sh: 0.0 },
        "glTF" => Errors { mean: 0.0, log_scale: 1e-6, rotation: 1e-2, opacity: 1e-6, color: 0.0, sh: 0.0 },
        // 1/2 step of a chunk's range, which is up to the scene's 60 units; colours by a chunk's
        // range of up to 3.4.
        "compressed PLY" => Errors {
            mean: 30.0 / 1023.0,
            log_scale: 3.0 / 1023.0,
            rotation: 0.25,
            opacity: byte,
            color: 0.002,
            sh: 1.0 / 64.0,
        },
        // Steps of 2^-17; SH in steps of 2 and 4 of 128.
        "SPZ" => Errors {
            mean: 0.5f32.powi(18),
            log_scale: 1.0 / 32.0,
            rotation: 0.25,
            opacity: byte,
            color: 0.004,
            sh: 1.0 / 64.0,
        },
        // Logarithm of 31 over 65535, times 31; codebooks of even values, that of scales coarser
        // where they are small: density by the cube root of e^v over 6 units gives steps of 0.075
        // there, 0.1 with as few values; SH of few splats are an entry each.
        "SOG" | "SOG folder" => {
            Errors { mean: 0.0033, log_scale: 0.05, rotation: 1.1, opacity: byte, color: 0.008, sh: 0.02 }
        }
        "splat" => Errors { mean: 0.0, log_scale: 1e-6, rotation: 1.0, opacity: byte, color: 0.002, sh: 0.0 },
        "ksplat" => Errors {
            mean: 60.0 / 65_534.0,
            log_scale: 1.0 / 2000.0,
            rotation: 0.1,
            opacity: byte,
            color: 0.002,
            sh: 1.0 / 2048.0,
        },
        _ => panic!("{name} states no rounding here"),
    }
}

#[test]
fn every_format_gives_back_what_it_states() {
    let folder = tempdir().unwrap();
    for format in FORMATS.iter().filter(|f| !f.extensions.is_empty()) {
        for degree in 0..=3 {
            let scene = plausible(700, degree);
            let path = values::path_of(&folder, format.extensions[0]);
            write_scene(&path, &scene).unwrap();
            let (back, found) = read_scene_and_format(&path, &ReadOptions::default()).unwrap();
            assert_eq!(back.metadata, scene.metadata, "{}", format.name);
            assert_eq!(back.splats.len(), 700);
            assert_eq!(back.splats.sh_degree, degree.min(format.loses.sh_degree));
            let order = match format.loses.order {
                Retention::Not if format.name == "ksplat" => ksplat::order(&scene.splats),
                Retention::Not if format.name.starts_with("SOG") => {
                    let steps = sog::Steps::for_means(&scene.splats.means);
                    sog::order(&scene.splats.means.iter().map(|mean| steps.of(*mean)).collect::<Vec<_>>())
                }
                Retention::Not => morton::order(&scene.splats.means),
                _ => (0..700).collect(),
            };
            let names = if format.name.starts_with("SOG") { Names::Lost } else { Names::Kept };
            let errors = Errors::of(&scene.splats, &back.splats, &order, names);
            assert!(errors.within(&rounding(format.name)), "{} degree {degree}: {errors:?}", format.name);
            assert_eq!(found.name, format.name);
        }
    }
}

#[test]
fn choices_of_a_format_are_read_back() {
    let folder = tempdir().unwrap();
    let scene = plausible(300, 3);
    let usual = WriteOptions::default();
    for (name, options) in [
        ("a.spz", WriteOptions { spz: SpzVersion::V4, ..usual }),
        ("a.glb", WriteOptions { gltf: GltfSplats::Spz, ..usual }),
        ("a.glb", WriteOptions { gltf: GltfSplats::SpzCesium, ..usual }),
    ] {
        let path = folder.path().join(name);
        write_scene_with(&path, &scene, &options).unwrap();
        let order: Vec<u32> = (0..300).collect();
        let errors = Errors::of(&scene.splats, &read(&path).unwrap().splats, &order, Names::Kept);
        assert!(errors.within(&rounding("SPZ")), "{name}: {errors:?}");
    }
}

#[test]
fn groups_are_kept_or_named_as_lost() {
    let folder = tempdir().unwrap();
    let mut scene = plausible(10, 1);
    scene.splats.groups[3] = Group::Sky;
    for (ending, kept) in [("glb", true), ("ply", true), ("spz", false)] {
        let path = folder.path().join(format!("a.{ending}"));
        write_scene(&path, &scene).unwrap();
        let (back, format) = read_scene_and_format(&path, &ReadOptions::default()).unwrap();
        assert_eq!(back.splats.groups[3] == Group::Sky, kept);
        let lines = lost(&format.loses, &scene);
        assert_eq!(lines.iter().any(|line| line.starts_with("the label of 1 splats")), !kept, "{lines:?}");
    }
    let lines = lost(&splat::FORMAT.loses, &scene);
    assert_eq!(lines[0], "colour by direction: SH degree 1 becomes 0");
}

#[test]
fn numbers_that_cannot_be_packed_do_no_harm() {
    let folder = tempdir().unwrap();
    let mut scene = plausible(300, 1);
    scene.splats.means[7] = [f32::NAN, f32::INFINITY, -1e30];
    scene.splats.log_scales[8] = [f32::NEG_INFINITY, f32::NAN, 1e30];
    scene.splats.quats[9] = [0.0; 4];
    scene.splats.sh[60] = f32::NAN;
    scene.splats.logit_opacities[10] = f32::INFINITY;
    for format in FORMATS.iter().filter(|f| !f.extensions.is_empty() && !f.extensions[0].contains(".json")) {
        let path = folder.path().join(format!("a.{}", format.extensions[0]));
        write_scene(&path, &scene).unwrap();
        // JSON has no infinity: the bounds of such a glTF are null.
        assert_eq!(read(&path).unwrap().splats.len(), 300);
    }
}
