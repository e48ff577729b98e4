//! Rain and snow in front of a camera: drops and flakes of true sizes, numbers and speeds.

use glam::DVec3;
use std::f64::consts::PI;
use wm_base::random::RandomStream;
use wm_scene::Camera;

/// Exposure, s.
const EXPOSURE_S: f64 = 0.004;
/// Particles nearer to the lens are not drawn, m: they would be a blur over everything.
const MIN_DISTANCE_M: f64 = 0.25;
/// Smallest coverage of a pixel that is drawn.
const MIN_PIXEL_COVERAGE: f64 = 0.02;

/// A kind of precipitation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fall {
    Rain,
    Snow,
}

/// Precipitation at a rate: sizes above `least` in an exponential distribution.
struct SizeDistribution {
    /// Pieces in a cubic metre that are larger than `least`.
    number: f64,
    /// Diameters, mm.
    least: f64,
    /// Decay of their distribution, 1/mm.
    slope: f64,
}

impl Fall {
    fn law(self, rate: f64) -> SizeDistribution {
        match self {
            // Marshall and Palmer 1948; drops below 0.8 mm are too fine for a photo.
            Self::Rain => {
                let (least, slope) = (0.8, 4.1 * rate.powf(-0.21));
                SizeDistribution { number: 8000.0 / slope * (-slope * least).exp(), least, slope }
            }
            // Flakes of 2 mm and above, 0.05 g/cm^3 at 2 mm: numbers that carry the rate at 1.1
            // m/s.
            Self::Snow => SizeDistribution { number: 220.0 * rate.powf(0.8), least: 2.0, slope: 0.55 },
        }
    }

    /// Fall speed of a diameter, m/s (rain: Atlas and others 1973).
    fn speed(self, diameter: f64) -> f64 {
        match self {
            Self::Rain => (9.65 - 10.3 * (-0.6 * diameter).exp()).max(0.5),
            Self::Snow => 0.9 + 0.06 * diameter,
        }
    }

    /// Adds what falls to linear light `[H, W]` with the view depth of each pixel (0 in the sky),
    /// m.
    pub(super) fn draw(
        self,
        light: &mut [DVec3],
        camera: &Camera,
        depth: &[f64],
        rate: f64,
        horizon: DVec3,
        random: RandomStream,
    ) {
        let law = self.law(rate);
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        // As far as pieces of twice the least size cover enough of a pixel.
        let farthest = 2.0e-3 * law.least * camera.fx / MIN_PIXEL_COVERAGE.sqrt();
        let farthest = farthest.clamp(2.0, 14.0);
        // The view's pyramid, a fifth wider: pieces fall into the picture.
        const VIEW_MARGIN: f64 = 1.2;
        let volume =
            VIEW_MARGIN * VIEW_MARGIN * (width / camera.fx) * (height / camera.fy) * farthest.powi(3) / 3.0;
        let count = (law.number * volume).min(2e6) as u64;
        let inverse = camera.viewmat.inverse();
        // A light wind, the same for all photos.
        let wind = DVec3::new(1.2, 0.5, 0.0);
        let mut cover = vec![0.0; light.len()];
        for index in 0..count {
            let number = |which: u64| random.uniform(5 * index + which);
            let z = farthest * number(0).cbrt();
            if z < MIN_DISTANCE_M {
                continue;
            }
            let (x, y) = ((number(1) - 0.5) * VIEW_MARGIN * width, (number(2) - 0.5) * VIEW_MARGIN * height);
            let from = DVec3::new(x / camera.fx * z, y / camera.fy * z, z);
            let diameter = (law.least - (1.0 - number(3)).ln() / law.slope).min(3.0 * law.least + 3.0);
            let gust = if self == Self::Snow { 0.6 * (number(4) - 0.5) } else { 0.0 };
            let speed = wind * (1.0 + gust) - DVec3::Z * self.speed(diameter);
            let world = inverse.transform_point3(from) + speed * EXPOSURE_S;
            let to = camera.viewmat.transform_point3(world);
            if to.z > 0.5 * MIN_DISTANCE_M {
                streak(&mut cover, camera, depth, from, to, 1e-3 * diameter);
            }
        }
        // Drops show the sky behind them upside down; flakes are white in the light from all
        // around.
        let color = match self {
            Self::Rain => horizon * 0.92,
            Self::Snow => horizon * 0.98 + 0.12,
        };
        for (light, cover) in light.iter_mut().zip(cover) {
            *light = light.lerp(color, 1.0 - f64::exp(-cover));
        }
    }
}

/// Adds the time that a ball of `diameter` m covers each pixel on its way, as a share of the
/// exposure.
fn streak(cover: &mut [f64], camera: &Camera, depth: &[f64], from: DVec3, to: DVec3, diameter: f64) {
    let project = |p: DVec3| (camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy);
    let ((x0, y0), (x1, y1)) = (project(from), project(to));
    let wide = diameter * camera.fx / from.z;
    let steps = ((x1 - x0).hypot(y1 - y0) / 0.5f64.max(0.3 * wide)).ceil().max(1.0) as usize;
    // Pixels that it covers, shared out over the steps.
    let share = 0.25 * PI * wide * wide / steps as f64;
    let (width, height) = (camera.width as i64, camera.height as i64);
    let mut add = |x: i64, y: i64, amount: f64| {
        if (0..width).contains(&x) && (0..height).contains(&y) {
            let index = (y * width + x) as usize;
            if depth[index] == 0.0 || depth[index] > from.z {
                cover[index] += amount;
            }
        }
    };
    for step in 0..steps {
        let t = (step as f64 + 0.5) / steps as f64;
        let (x, y) = (x0 + (x1 - x0) * t - 0.5, y0 + (y1 - y0) * t - 0.5);
        let (left, top) = (x.floor(), y.floor());
        if wide <= 1.5 {
            let (fx, fy) = (x - left, y - top);
            for (dx, dy, part) in [
                (0, 0, (1.0 - fx) * (1.0 - fy)),
                (1, 0, fx * (1.0 - fy)),
                (0, 1, (1.0 - fx) * fy),
                (1, 1, fx * fy),
            ] {
                add(left as i64 + dx, top as i64 + dy, share * part);
            }
            continue;
        }
        let radius = 0.5 * wide;
        let reach = radius.ceil() as i64 + 1;
        let even = share / (PI * radius * radius);
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let off = (left as i64 + dx) as f64 - x;
                let edge = radius + 0.5 - off.hypot((top as i64 + dy) as f64 - y);
                add(left as i64 + dx, top as i64 + dy, even * edge.clamp(0.0, 1.0));
            }
        }
    }
}
