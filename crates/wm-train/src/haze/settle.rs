//! Colours of splats that the haze hides from the photos.
//!
//! If the air lets a hundredth of a surface's light through, its clear colour is the photos' noise
//! times a hundred, and the steps of the optimiser, whose length does not depend on that of
//! gradients, make a random walk of it. Such colours are drawn towards the mean of those that are
//! known, as far as noise outweighs what colours differ by.

use glam::DVec3;
use rayon::prelude::*;
use wm_render::EvenAir;
use wm_scene::sh::C0;
use wm_scene::{Camera, Group, Splats};

/// Ratio of the noise of photos to the spread of clear colours: the transmittance at which a
/// splat's own colour and the mean weigh the same.
const NOISE_TO_SPREAD: f64 = 0.2;
/// Least transmittance at which the colour of a splat is known.
const MIN_KNOWN_TRANSMITTANCE: f64 = 0.3;

/// Draws the colours of splats that all of `cameras` see through much air towards the mean of the
/// others.
pub(crate) fn settle(splats: &mut Splats, cameras: &[Camera], air: &EvenAir) {
    let shown = transmittances(splats, cameras, air);
    let Some(mean) = mean_of_known(splats, &shown, &|_| true) else { return };
    let stride = splats.sh_stride();
    for (index, shown) in shown.iter().enumerate() {
        if splats.groups[index] == Group::Sky {
            continue;
        }
        let share = shown * shown / (shown * shown + NOISE_TO_SPREAD * NOISE_TO_SPREAD);
        let own = &mut splats.sh[index * stride..(index + 1) * stride];
        for (k, value) in own.iter_mut().enumerate() {
            let rest = if k < 3 { mean[k] } else { 0.0 };
            *value = (rest + share * (f64::from(*value) - rest)) as f32;
        }
    }
}

/// Returns the mean colour (display-referred) of the splats that `cameras` show well and whose
/// place counts; `None` if there are none.
pub(crate) fn mean_color(
    splats: &Splats,
    cameras: &[Camera],
    air: &EvenAir,
    counts: &dyn Fn(DVec3) -> bool,
) -> Option<[f32; 3]> {
    let mean = mean_of_known(splats, &transmittances(splats, cameras, air), counts)?;
    Some(mean.map(|coefficient| (coefficient * C0 + 0.5) as f32))
}

/// Returns the mean of the first SH coefficients of the splats that are shown well.
fn mean_of_known(splats: &Splats, shown: &[f64], counts: &dyn Fn(DVec3) -> bool) -> Option<[f64; 3]> {
    let stride = splats.sh_stride();
    let (mut sum, mut weights) = ([0.0f64; 3], 0.0f64);
    for (index, shown) in shown.iter().enumerate() {
        if splats.groups[index] != Group::Sky
            && *shown > MIN_KNOWN_TRANSMITTANCE
            && counts(place(splats, index))
        {
            let [x, y, z] = splats.log_scales[index].map(f64::from);
            // The approximate area of the splat.
            let weight = (x + y + z - x.min(y).min(z)).exp() * splats.opacity(index);
            let own = &splats.sh[index * stride..];
            (0..3).for_each(|c| sum[c] += weight * f64::from(own[c]));
            weights += weight;
        }
    }
    (weights > 0.0).then(|| sum.map(|sum| sum / weights))
}

/// Returns the transmittance from each splat to the nearest camera that has it in view, or to the
/// nearest camera if none has.
fn transmittances(splats: &Splats, cameras: &[Camera], air: &EvenAir) -> Vec<f64> {
    let of = |index: usize| {
        let at = place(splats, index);
        let in_view = |camera: &Camera| {
            camera.project(at).is_some_and(|(x, y, z)| {
                z > camera.near
                    && (0.0..f64::from(camera.width)).contains(&x)
                    && (0.0..f64::from(camera.height)).contains(&y)
            })
        };
        let distance = Some(nearest(cameras, at, in_view)).filter(|distance| distance.is_finite());
        air.transmittance(distance.unwrap_or_else(|| nearest(cameras, at, |_| true)))
    };
    (0..splats.len()).into_par_iter().map(of).collect()
}

/// Returns the distance of a place from the nearest camera that counts; infinity if none does.
pub(crate) fn nearest(cameras: &[Camera], at: DVec3, counts: impl Fn(&Camera) -> bool) -> f64 {
    let distances = cameras.iter().filter(|camera| counts(camera)).map(|camera| camera.center().distance(at));
    distances.fold(f64::INFINITY, f64::min)
}

fn place(splats: &Splats, index: usize) -> DVec3 {
    DVec3::from_array(splats.means[index].map(f64::from))
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_scene::splats::Splat;

    #[test]
    fn what_the_haze_hides_takes_the_mean_of_the_rest() {
        let camera = Camera::looking((64, 48), 60.0, DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap();
        let mut splats = Splats::with_capacity(4, 1);
        for (distance, rgb, group) in [
            (1.0, [0.2, 0.4, 0.6], Group::Scene),
            (10.0, [0.9, 0.1, 0.5], Group::Scene),
            (200.0, [5.0, 0.0, 0.0], Group::Scene),
            (200.0, [0.3, 0.5, 0.9], Group::Sky),
        ] {
            splats.push(&Splat {
                mean: [0.0, distance, 0.0],
                quat: [1.0, 0.0, 0.0, 0.0],
                log_scale: [-2.0; 3],
                logit_opacity: 2.0,
                rgb,
                group,
            });
        }
        splats.sh.iter_mut().for_each(|value| *value += 0.01);
        let before = splats.clone();
        settle(&mut splats, &[camera], &EvenAir { extinction: 0.1, airlight: [0.5; 3] });
        let stride = splats.sh_stride();
        let rows = |splats: &Splats, i: usize| splats.sh[i * stride..(i + 1) * stride].to_vec();
        let close = |a: &[f32], b: &[f32], by: f32| a.iter().zip(b).all(|(a, b)| (a - b).abs() < by);
        let (near, next) = (rows(&before, 0), rows(&before, 1));
        let mean: Vec<f32> = (0..3).map(|c| 0.5 * (near[c] + next[c])).collect();
        // The nearer, the more of a splat's own colour is left.
        for (index, distance) in [(0, 1.0f64), (1, 10.0)] {
            let kept = (-0.2 * distance).exp();
            let share = (kept / (kept + NOISE_TO_SPREAD * NOISE_TO_SPREAD)) as f32;
            let own = rows(&before, index);
            let wanted: Vec<f32> = (0..3).map(|c| mean[c] + share * (own[c] - mean[c])).collect();
            assert!(close(&rows(&splats, index)[..3], &wanted, 1e-3), "{index}");
        }
        let hidden = rows(&splats, 2);
        assert!(close(&hidden[..3], &mean, 1e-3) && hidden[3..].iter().all(|v| v.abs() < 1e-3));
        assert_eq!(rows(&splats, 3), rows(&before, 3));
    }
}
