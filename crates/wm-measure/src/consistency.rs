//! Consistency: what belongs to the place stays at its place, from frame to frame and from view to
//! view.
//!
//! Every pixel of a frame is carried into the next by its own depth and the two poses, exactly;
//! where the same point is seen again the colours are compared, in linear light, hidden and edge
//! pixels left out. That is the warping error of the static layer: of the place in clear air, which
//! it has from its own splats, and of the place in fog and under snow. Fog takes contrast, and so
//! error, away: what is asked is the clear error times the transmittance of each pixel. At one
//! instant, two views must agree on how thick the air is and on where snow lies.
//!
//! Weather that is painted on the clear frames one by one ([`super::painted`]) is measured alike,
//! to show what is measured here.
//!
//! Tolerances: the error may be above that of clear air by 0.5 % of white; the extinction of two
//! views apart by 3 %; nine tenths of the snow agree (cells of the cover are 6 cm and wider, and a
//! pixel far away holds several).

use super::{
    AIR, Bench, Instrument, MeasuredPicture, ShotSubject, Tolerance, clear, expected, mean, median, painted,
};
use wm_place::Picture;
use wm_place::Result;
use wm_scene::Camera;
use wm_weather::{EffectRole, Weather};

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "consistency",
    title: "Consistency",
    about: "Two views of the place, a step apart. Pixels of one are carried into the other by exact depth and pose, and compared: the \
            warping error of what stands still, in percent of white, beside that of clear air. Two views must also agree on the extinction \
            of the air and on where snow lies. Beside them the same for weather that is painted on the clear frames, one by one, \
            without geometry.",
    applies: |weather, time| !expected::airs(weather, time).is_empty() || weather.has(EffectRole::Lies),
    measure,
    sweep: &[
        "fog.mor=50",
        "fog.mor=100",
        "fog.mor=200",
        "fog.mor=500",
        "haze.mor=1000",
        "snow_cover.depth=0.05",
        "snow_cover.depth=0.1",
        "snow_cover.depth=0.2",
        "snow_cover.depth=0.3",
        "snow_cover.depth=0.5",
    ],
};

/// Largest relative difference of two depths of the same point.
const DEPTH_TOLERANCE: f64 = 0.02;
/// Change of linear light that tells snow.
const SNOW_LIGHT_CHANGE: f32 = 0.03;

/// One view of the place in one weather.
struct View {
    camera: Camera,
    /// Linear light, at most 1.
    rgb: Vec<f32>,
    /// View z, scene units, where it is sharp; else 0.
    depth: Vec<f64>,
    /// Green.
    share: Vec<f32>,
    picture: Picture,
}

/// A pixel of one view and where its point is in another: the four pixels about that, with weights.
struct Pair {
    here: usize,
    there: [(usize, f32); 4],
}

impl View {
    fn new(bench: &mut Bench<'_>, camera: Camera, weather: &Weather) -> Result<Self> {
        let picture = bench.draw(ShotSubject::Place, &camera, weather, AIR)?;
        let frame = &picture.frame;
        let sharp = |at: usize| {
            let (z, other) = (f64::from(frame.depth[at]), f64::from(frame.median_depth[at]));
            if frame.alpha[at] > 0.98 && (other / z - 1.0).abs() < DEPTH_TOLERANCE { other } else { 0.0 }
        };
        let depth = (0..frame.pixels()).map(sharp).collect();
        let share = picture.parts.transmittance.iter().skip(1).step_by(3).copied().collect();
        // What is brighter than white is white in a picture: lamps and lit windows would outweigh
        // all else.
        let rgb = frame.rgb_linear().into_iter().map(|value| value.min(1.0)).collect();
        Ok(Self { camera, rgb, depth, share, picture })
    }

    fn size(&self) -> (usize, usize) {
        (self.camera.width as usize, self.camera.height as usize)
    }

    /// Metres of the ray to a pixel's point, in scene units.
    fn length(&self, at: usize) -> f64 {
        let width = self.camera.width as usize;
        let ray = self.camera.ray((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
        self.depth[at] / ray.dot(self.camera.forward())
    }

    /// Pixels whose point another view sees as well.
    fn pairs(&self, other: &Self) -> Vec<Pair> {
        let (width, height) = self.size();
        let pair = |here: usize| {
            let z = self.depth[here];
            if z <= 0.0 {
                return None;
            }
            let ray = self.camera.ray((here % width) as f64 + 0.5, (here / width) as f64 + 0.5);
            let point = self.camera.center() + ray * (z / ray.dot(self.camera.forward()));
            let (x, y, there) = other.camera.project(point)?;
            let (x, y) = (x - 0.5, y - 0.5);
            if x < 0.0 || y < 0.0 || x >= (width - 1) as f64 || y >= (height - 1) as f64 {
                return None;
            }
            let corner = y as usize * width + x as usize;
            let (a, b) = (x.fract() as f32, y.fract() as f32);
            let four =
                [(0, (1.0 - a) * (1.0 - b)), (1, a * (1.0 - b)), (width, (1.0 - a) * b), (width + 1, a * b)];
            let four = four.map(|(off, weight)| (corner + off, weight));
            // Not hidden by something else, and on no edge.
            let is_same = |at: usize| (other.depth[at] / there - 1.0).abs() < DEPTH_TOLERANCE;
            four.iter().all(|(at, _)| is_same(*at)).then_some(Pair { here, there: four })
        };
        (0..width * height).filter_map(pair).collect()
    }
}

/// Differences of linear light of pairs, mean over the channels.
fn differences(pairs: &[Pair], here: &[f32], there: &[f32]) -> Vec<f64> {
    let difference = |pair: &Pair| {
        let channel = |k: usize| {
            let seen: f32 = pair.there.iter().map(|(at, weight)| weight * there[3 * at + k]).sum();
            f64::from((here[3 * pair.here + k] - seen).abs())
        };
        (0..3).map(channel).sum::<f64>() / 3.0
    };
    pairs.iter().map(difference).collect()
}

/// The median over pairs of the relative difference of two views' extinction.
fn disagreement(pairs: &[Pair], views: [&View; 2], shares: [&[f32]; 2]) -> f64 {
    let apart = pairs.iter().filter_map(|pair| {
        let there = pair.there.iter().max_by(|a, b| a.1.total_cmp(&b.1))?.0;
        let sigma = |k: usize, at: usize| -f64::from(shares[k][at]).ln() / views[k].length(at);
        let [a, b] = [sigma(0, pair.here), sigma(1, there)];
        let is_told = |k: usize, at: usize| (0.02..0.97).contains(&shares[k][at]);
        (is_told(0, pair.here) && is_told(1, there)).then(|| 2.0 * (a - b).abs() / (a + b))
    });
    median(apart.collect())
}

/// Overlap of two masks: what both have of what either has.
fn overlap(pairs: &[Pair], masks: [&[bool]; 2]) -> f64 {
    let (mut both, mut either) = (0usize, 0usize);
    for pair in pairs {
        let there: f32 =
            pair.there.iter().map(|(at, weight)| weight * f32::from(u8::from(masks[1][*at]))).sum();
        let (here, there) = (masks[0][pair.here], there > 0.5);
        both += usize::from(here && there);
        either += usize::from(here || there);
    }
    both as f64 / either as f64
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let [a, b] = bench.rig.views()?;
    let weather = bench.with("rain=off, snowfall=off")?;
    let mut look = |weather: &Weather| -> Result<[View; 2]> {
        Ok([View::new(bench, a, weather)?, View::new(bench, b, weather)?])
    };
    let (bare, seen) = (look(&clear())?, look(&weather)?);
    let (bare_pairs, pairs) = (bare[0].pairs(&bare[1]), seen[0].pairs(&seen[1]));
    let size = seen[0].size();
    let percent = |values: Vec<f64>| 100.0 * mean(values);
    let own = percent(differences(&pairs, &seen[0].rgb, &seen[1].rgb));
    let clear_error = differences(&bare_pairs, &bare[0].rgb, &bare[1].rgb);
    let has_air = !expected::airs(&weather, bench.time).is_empty();
    let lies = weather.has(EffectRole::Lies);
    let dimmed = |share: &[f32]| -> Vec<f64> {
        clear_error.iter().zip(&bare_pairs).map(|(e, pair)| e * f64::from(share[pair.here])).collect()
    };
    let above = Tolerance::Above(0.5);
    bench.add(
        "warping error of what stands still",
        "% of white",
        [percent(dimmed(&seen[0].share)), own],
        above,
    );
    if has_air {
        let views = [&seen[0], &seen[1]];
        let apart = disagreement(&pairs, views, [&seen[0].share, &seen[1].share]);
        bench.add(
            "two views' extinction is apart by, median",
            "%",
            [0.0, 100.0 * apart],
            Tolerance::Absolute(3.0),
        );
        let paint = [0, 1].map(|k| painted::fog(&bare[k].rgb, size.0, size.1, k as u64 + 1));
        let error = percent(differences(&bare_pairs, &paint[0].rgb, &paint[1].rgb));
        let none = Tolerance::None;
        bench.add(
            "painted a frame: warping error",
            "% of white",
            [percent(dimmed(&paint[0].share)), error],
            none,
        );
        let apart = disagreement(&bare_pairs, [&bare[0], &bare[1]], [&paint[0].share, &paint[1].share]);
        bench.add("painted a frame: extinction apart by", "%", [0.0, 100.0 * apart], none);
    }
    if lies {
        let covered = |k: usize| -> Vec<bool> {
            let light = |rgb: &[f32], at: usize| rgb[3 * at..3 * at + 3].iter().sum::<f32>() / 3.0;
            (0..size.0 * size.1)
                .map(|at| (light(&seen[k].rgb, at) - light(&bare[k].rgb, at)).abs() > SNOW_LIGHT_CHANGE)
                .collect()
        };
        let masks = [covered(0), covered(1)];
        let same = overlap(&pairs, [&masks[0], &masks[1]]);
        bench.add(
            "snow that both views show, of what either does",
            "",
            [1.0, same],
            Tolerance::Absolute(0.1),
        );
        let paint = [0, 1].map(|k| painted::snow(&bare[k].rgb, size.0, size.1, k as u64 + 1));
        let same = overlap(&bare_pairs, [&paint[0], &paint[1]]);
        bench.add("painted a frame: the same", "", [1.0, same], Tolerance::None);
    }
    bench.show("the first of the two views", &seen[0].picture);
    let mut error = vec![0.0f32; size.0 * size.1];
    for (pair, value) in pairs.iter().zip(differences(&pairs, &seen[0].rgb, &seen[1].rgb)) {
        error[pair.here] = (5.0 * value) as f32;
    }
    let caption = "its warping error, five times; black is none or not seen twice";
    bench.show_picture(MeasuredPicture::grey(caption, error.into_iter(), (size.0 as u32, size.1 as u32)));
    Ok(())
}
