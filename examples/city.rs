//! Makes a city in levels of detail: a scene, repeated on a grid with half turns and other colours,
//! written block by block.
//!
//! ```text
//! cargo run --release --example city -- SCENE N OUT/lod-meta.json
//! ```
//!
//! N is the number of blocks to a side: a scene of 850,000 splats and N = 12 make more than 100
//! million. Memory is that of a block or two. The sky of the scene is kept once, about the middle.

use glam::{DMat3, DVec3};
use std::error::Error;
use std::path::Path;
use std::time::Instant;
use weather_magician::levels::{LevelBuilder, LevelOptions};
use weather_magician::{Metadata, Scene};
use wm_base::random::uniform;
use wm_scene::similarity::Similarity;
use wm_scene::survey::{Survey, label_sky};
use wm_scene::{Group, Splats, sh};

/// Share of the splats, on each side, beyond which a block does not reach: what is far out is
/// seldom sharp.
const FAR: f64 = 0.03;
/// Largest change of a colour channel's gain.
const TINT: f64 = 0.06;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().collect();
    let [_, scene, side, out] = &args[..] else {
        return Err("usage: city SCENE N OUT/lod-meta.json".into());
    };
    let side: u32 = side.parse()?;
    let mut scene = Scene::open(scene)?;
    label_sky(&mut scene.splats);
    let survey = Survey::of(&scene, &Metadata::default());
    // Up becomes z, and the ground 0.
    Similarity::turning(survey.up.value, DVec3::Z).apply(&mut scene);
    let ground = survey.ground.value;
    let sky = part(&scene.splats, |index| scene.splats.groups[index] == Group::Sky);
    let rest = part(&scene.splats, |index| scene.splats.groups[index] != Group::Sky);
    let ends = [0, 1].map(|axis| {
        let mut along: Vec<f32> = rest.means.iter().map(|mean| mean[axis]).collect();
        along.sort_unstable_by(f32::total_cmp);
        [FAR, 1.0 - FAR].map(|share| f64::from(along[(share * (along.len() - 1) as f64) as usize]))
    });
    let middle = DVec3::new(0.5 * (ends[0][0] + ends[0][1]), 0.5 * (ends[1][0] + ends[1][1]), ground);
    let sides = ends.map(|[low, high]| high - low);
    let inside = |index: usize| {
        (0..2).all(|axis| (f64::from(rest.means[index][axis]) - middle[axis]).abs() <= 0.5 * sides[axis])
    };
    let tile = part(&rest, inside);

    let started = Instant::now();
    let all = u64::from(side * side) * tile.len() as u64;
    let options =
        LevelOptions { rasterization: scene.metadata.rasterization, ..LevelOptions::for_splats(all) };
    let mut builder = LevelBuilder::create(Path::new(out), options)?;
    for number in 0..side * side {
        let at = |axis: usize, cell: u32| sides[axis] * (f64::from(cell) - 0.5 * f64::from(side - 1));
        let place = DVec3::new(at(0, number % side), at(1, number / side), 0.0);
        // Neighbours in a row and in a column are turned against each other.
        let mut block = placed(&tile, middle, 2 * ((number + number / side) % 2), place);
        for channel in 0..3 {
            let gain = 1.0 + TINT * (2.0 * uniform(30, u64::from(3 * number + channel)) - 1.0);
            tint(&mut block, channel as usize, gain);
        }
        builder.add(&block, &mut ())?;
        let splats = (u64::from(number) + 1) * tile.len() as u64;
        let seconds = started.elapsed().as_secs_f64();
        println!("{} of {}: {:.0} splats a second", number + 1, side * side, splats as f64 / seconds);
    }
    builder.add(&placed(&sky, middle, 0, DVec3::ZERO), &mut ())?;
    let metadata = Metadata {
        up: Some(DVec3::Z),
        ground: Some(0.0),
        metres_per_unit: scene.metadata.metres_per_unit,
        rasterization: scene.metadata.rasterization,
        ..Metadata::default()
    };
    let summary = builder.finish(&metadata, &mut ())?;
    println!("{summary:?} in {:.0} s", started.elapsed().as_secs_f64());
    Ok(())
}

fn part(splats: &Splats, is_in: impl Fn(usize) -> bool) -> Splats {
    splats.select(&(0..splats.len()).filter(|index| is_in(*index)).collect::<Vec<_>>())
}

/// Splats about `middle`, after quarter turns about z, about `place`.
fn placed(splats: &Splats, middle: DVec3, turns: u32, place: DVec3) -> Splats {
    let rotation = DMat3::from_rotation_z(f64::from(turns) * std::f64::consts::FRAC_PI_2);
    let by = Similarity { rotation, translation: place - rotation * middle, ..Similarity::IDENTITY };
    let mut placed = splats.clone();
    by.apply_to(&mut placed);
    placed
}

/// Multiplies a channel of the colours.
fn tint(splats: &mut Splats, channel: usize, gain: f64) {
    let stride = splats.sh_stride();
    for sh in splats.sh.chunks_exact_mut(stride) {
        sh.iter_mut().skip(channel).step_by(3).for_each(|v| *v *= gain as f32);
        // The colour is 0.5 more than the sum.
        sh[channel] += (0.5 * (gain - 1.0) / sh::C0) as f32;
    }
}
