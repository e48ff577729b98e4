//! Small made-up places for tests and benches: z up, metres, the ground at height 0.
//!
//! They have what makes real scenes hard to judge: walls as large as the ground, normals that
//! scatter, strays above and below, and surfaces only where a camera could have seen them.

use crate::{Group, Splats, quat, similarity::Similarity, splats::Splat, splats::logit, testing::Dice};
use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::{PI, TAU};
use wm_base::random::uniform;

/// Builds a place out of surfaces.
#[derive(Clone, Debug)]
pub struct Builder {
    splats: Splats,
    dice: Dice,
}

/// A display-referred colour, 0-1.
pub type Rgb = [f32; 3];

impl Builder {
    /// Nothing yet; equal seeds give equal places.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { splats: Splats::with_capacity(0, 0), dice: Dice::new(seed) }
    }

    /// Returns the splats that were built.
    #[must_use]
    pub fn build(self) -> Splats {
        self.splats
    }

    pub(crate) fn draw(&mut self, low: f64, high: f64) -> f64 {
        self.dice.draw(low, high)
    }

    pub(crate) fn anywhere(&mut self) -> DVec3 {
        let z = self.draw(-1.0, 1.0);
        let angle = self.draw(0.0, TAU);
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * angle.cos(), r * angle.sin(), z)
    }

    pub(crate) fn push(&mut self, at: DVec3, normal: DVec3, scales: [f64; 3], opacity: f64, rgb: Rgb) {
        let shade = self.draw(-0.04, 0.04) as f32;
        self.splats.push(&Splat {
            mean: at.to_array().map(|v| v as f32),
            quat: quat::from_z_to(normal.to_array()).map(|v| v as f32),
            log_scale: scales.map(|v| v.ln() as f32),
            logit_opacity: logit(opacity) as f32,
            rgb: rgb.map(|c| (c + shade).clamp(0.0, 1.0)),
            group: Group::Scene,
        });
    }

    /// One flat splat of about `spacing`, its place and normal scattered a little.
    pub(crate) fn fleck(&mut self, at: DVec3, normal: DVec3, spacing: f64, rgb: Rgb) {
        let at = at + self.anywhere() * (0.1 * spacing);
        let normal = (normal + self.anywhere() * self.draw(0.0, 0.25)).normalize();
        let size = spacing * self.draw(0.5, 0.8);
        let opacity = self.draw(0.85, 0.99);
        self.push(at, normal, [size, size, 0.1 * size], opacity, rgb);
    }

    /// The parallelogram `origin + a u + b v`, a and b in 0-1, in the colour that `paint(a, b)`
    /// says.
    pub fn surface(
        &mut self,
        origin: DVec3,
        u: DVec3,
        v: DVec3,
        spacing: f64,
        paint: impl Fn(f64, f64) -> Rgb,
    ) {
        let normal = u.cross(v).normalize();
        let counts = [u, v].map(|edge| (edge.length() / spacing).ceil().max(1.0) as usize);
        for i in 0..counts[0] {
            for j in 0..counts[1] {
                let [a, b] = [(i, counts[0]), (j, counts[1])].map(|(k, n)| (k as f64 + 0.5) / n as f64);
                self.fleck(origin + u * a + v * b, normal, spacing, paint(a, b));
            }
        }
    }

    /// The walls and the top of a box that stands on `base`, the middle of its floor.
    pub fn block(&mut self, base: DVec3, size: DVec3, spacing: f64, rgb: Rgb) {
        let (x, y, z) = (DVec3::X * size.x, DVec3::Y * size.y, DVec3::Z * size.z);
        let corner = base - 0.5 * (x + y);
        for (origin, u, v) in
            [(corner, x, z), (corner + y, x, z), (corner, y, z), (corner + x, y, z), (corner + z, x, y)]
        {
            self.surface(origin, u, v, spacing, |_, _| rgb);
        }
    }

    /// The surface of a ball.
    pub fn ball(&mut self, center: DVec3, radius: f64, spacing: f64, rgb: Rgb) {
        let count = (4.0 * PI * (radius / spacing).powi(2)) as usize;
        for _ in 0..count {
            let normal = self.anywhere();
            self.fleck(center + normal * radius, normal, spacing, rgb);
        }
    }

    /// Leaves: splats at random in a ball, facing anywhere.
    pub fn leaves(&mut self, center: DVec3, radius: f64, count: usize, rgb: Rgb) {
        for _ in 0..count {
            let offset = self.anywhere() * (radius * self.draw(0.0, 1.0).cbrt());
            let normal = self.anywhere();
            self.fleck(center + offset, normal, 0.25 * radius, rgb);
        }
    }

    /// A trunk with leaves on it.
    pub fn tree(&mut self, base: DVec3, height: f64, count: usize) {
        let trunk = DVec3::new(0.06 * height, 0.06 * height, 0.6 * height);
        self.block(base, trunk, 0.04 * height, [0.35, 0.27, 0.2]);
        self.leaves(base + DVec3::Z * (0.68 * height), 0.32 * height, count, [0.25, 0.4, 0.18]);
    }

    /// Faint splats at random in a box: what a reconstruction leaves in the air and under the
    /// ground.
    pub fn strays(&mut self, low: DVec3, high: DVec3, count: usize) {
        for _ in 0..count {
            let at = DVec3::from_array([0, 1, 2].map(|k| self.draw(low[k], high[k])));
            let normal = self.anywhere();
            let size = 0.003 * (high - low).length() * self.draw(0.5, 2.0);
            let opacity = self.draw(0.05, 0.6);
            self.push(at, normal, [size, 0.5 * size, 0.2 * size], opacity, [0.5; 3]);
        }
    }

    /// Half a shell of sky about `center`, from blue above to white at the horizon.
    pub fn sky(&mut self, center: DVec3, radius: f64, count: usize) {
        let size = radius * (TAU / count as f64).sqrt();
        for i in 0..count {
            let z = (i as f64 + 0.5) / count as f64;
            let (sin, cos) = (i as f64 * PI * (3.0 - 5f64.sqrt())).sin_cos();
            let r = (1.0 - z * z).sqrt();
            let normal = DVec3::new(r * cos, r * sin, z);
            let blend = (1.0 - z).powi(3) as f32;
            let rgb = [0.4 + 0.45 * blend, 0.58 + 0.3 * blend, 0.85 + 0.07 * blend];
            self.push(center + normal * radius, normal, [size, size, 0.05 * size], 0.95, rgb);
        }
    }
}

/// A straight street of 60 m between two rows of houses, seen from its middle: road, pavements,
/// cars, trees, no roofs. About 30,000 splats.
#[must_use]
pub fn street(seed: u64) -> Builder {
    let mut place = Builder::new(seed);
    let road = |a: f64, _: f64| if (a * 20.0).fract() < 0.5 { [0.38; 3] } else { [0.42, 0.41, 0.4] };
    place.surface(DVec3::new(-30.0, -4.0, 0.0), DVec3::X * 60.0, DVec3::Y * 8.0, 0.3, road);
    for side in [-1.0, 1.0] {
        let pavement = DVec3::new(-30.0, 4.0 * side, 0.12);
        place.surface(pavement, DVec3::X * 60.0, DVec3::Y * (2.0 * side), 0.3, |_, _| [0.55, 0.53, 0.5]);
        for house in 0..5 {
            let height = place.draw(6.0, 11.0);
            let tint = place.draw(0.0, 0.3) as f32;
            let paint = move |a: f64, b: f64| {
                let window = (a * 4.0).fract() > 0.6 && (b * 3.0).fract() > 0.5;
                if window { [0.2, 0.22, 0.26] } else { [0.75, 0.68 - tint, 0.6 - tint] }
            };
            let origin = DVec3::new(-30.0 + 12.0 * f64::from(house), 6.0 * side, 0.12);
            place.surface(origin, DVec3::X * 12.0, DVec3::Z * height, 0.25, paint);
        }
    }
    for (x, y) in [(-18.0, 3.0), (-2.0, -3.0), (12.0, 3.0)] {
        place.block(DVec3::new(x, y, 0.0), DVec3::new(4.2, 1.8, 1.4), 0.15, [0.5, 0.12, 0.1]);
        place.tree(DVec3::new(x + 6.0, 1.6 * y, 0.12), 5.0, 300);
    }
    place.strays(DVec3::new(-30.0, -8.0, -4.0), DVec3::new(30.0, 8.0, 14.0), 1500);
    place
}

/// A vase on a table in a corner of a room, seen from around the table; the floor only in parts.
/// About 20,000 splats; the ground is the floor.
#[must_use]
pub fn table(seed: u64) -> Builder {
    let mut place = Builder::new(seed);
    let wood = |a: f64, _: f64| if (a * 6.0).fract() < 0.5 { [0.55, 0.38, 0.22] } else { [0.6, 0.42, 0.25] };
    place.surface(DVec3::new(-0.8, -0.5, 0.75), DVec3::X * 1.6, DVec3::Y, 0.02, wood);
    for (x, y) in [(-0.7, -0.4), (0.7, -0.4), (-0.7, 0.4), (0.7, 0.4)] {
        place.block(DVec3::new(x, y, 0.0), DVec3::new(0.06, 0.06, 0.74), 0.03, [0.5, 0.35, 0.2]);
    }
    place.ball(DVec3::new(0.1, 0.0, 0.9), 0.15, 0.012, [0.2, 0.4, 0.6]);
    place.leaves(DVec3::new(0.1, 0.0, 1.2), 0.18, 1500, [0.7, 0.3, 0.3]);
    place.block(DVec3::new(-0.45, 0.15, 0.75), DVec3::new(0.25, 0.18, 0.05), 0.015, [0.7, 0.15, 0.12]);
    place
        .surface(DVec3::new(-2.0, -2.0, 0.0), DVec3::X * 4.0, DVec3::Y * 4.0, 0.05, |_, _| [0.5, 0.48, 0.45]);
    place.surface(DVec3::new(-2.0, 2.0, 0.0), DVec3::X * 4.0, DVec3::Z * 2.2, 0.06, |_, _| [0.8, 0.78, 0.7]);
    place
        .surface(DVec3::new(2.0, -2.0, 0.0), DVec3::Y * 4.0, DVec3::Z * 2.2, 0.06, |_, _| [0.78, 0.78, 0.72]);
    place.strays(DVec3::new(-2.0, -2.0, -0.8), DVec3::new(2.0, 2.0, 2.5), 600);
    place
}

/// A village from the air: 120 x 90 m of meadow, houses, trees, a road. About 75,000 splats.
#[must_use]
pub fn aerial(seed: u64) -> Builder {
    let mut place = Builder::new(seed);
    let meadow = |a: f64, b: f64| {
        let road = (b - 0.5 - 0.1 * (6.0 * a).sin()).abs() < 0.02;
        if road { [0.5, 0.48, 0.45] } else { [0.35, 0.45 + 0.05 * (40.0 * a).sin() as f32, 0.22] }
    };
    place.surface(DVec3::new(-60.0, -45.0, 0.0), DVec3::X * 120.0, DVec3::Y * 90.0, 0.6, meadow);
    for _ in 0..14 {
        let base = DVec3::new(place.draw(-50.0, 50.0), place.draw(-38.0, 38.0), 0.0);
        let size = DVec3::new(place.draw(8.0, 14.0), place.draw(7.0, 10.0), place.draw(4.0, 6.0));
        place.block(base, size, 0.5, [0.8, 0.75, 0.68]);
        for side in [-1.0, 1.0] {
            let eaves = base + DVec3::new(-0.5 * size.x, 0.5 * size.y * side, size.z);
            let slope = DVec3::new(0.0, -0.5 * size.y * side, 0.35 * size.y);
            place.surface(eaves, DVec3::X * size.x, slope, 0.4, |_, _| [0.55, 0.25, 0.18]);
        }
    }
    for _ in 0..60 {
        let base = DVec3::new(place.draw(-58.0, 58.0), place.draw(-43.0, 43.0), 0.0);
        let height = place.draw(4.0, 9.0);
        place.tree(base, height, 150);
    }
    place.strays(DVec3::new(-60.0, -45.0, -6.0), DVec3::new(60.0, 45.0, 20.0), 1200);
    place
}

/// Turns, scales and moves a place: `p -> rotation * (scale p) + shift`.
#[must_use]
pub fn moved(splats: &Splats, rotation: DQuat, scale: f64, shift: DVec3) -> Splats {
    let mut out = splats.clone();
    Similarity { scale, rotation: DMat3::from_quat(rotation), translation: shift }.apply_to(&mut out);
    out
}

/// Splats of values that do not repeat, for what does not look at them: files, and how fast they
/// are read.
#[must_use]
pub fn rippled(count: usize, sh_degree: u8) -> Splats {
    let mut splats = Splats::with_capacity(count, sh_degree);
    for index in 0..count {
        let value = (index as f32).sin();
        splats.push(&Splat {
            mean: [value, 2.0 * value, -value],
            quat: [1.0, value, 0.0, 0.5],
            log_scale: [-3.0, value, -2.0],
            logit_opacity: value,
            rgb: [0.2, 0.5, value],
            group: Group::Scene,
        });
    }
    splats
}

/// The `index`-th of the random rotations of `seed`, uniform over all.
#[must_use]
pub fn rotation(seed: u64, index: u64) -> DQuat {
    let [a, b, c] = [0, 1, 2].map(|k| uniform(seed, 3 * index + k));
    let (r, s) = ((1.0 - a).sqrt(), a.sqrt());
    let ((sin_b, cos_b), (sin_c, cos_c)) = ((TAU * b).sin_cos(), (TAU * c).sin_cos());
    DQuat::from_xyzw(r * sin_b, r * cos_b, s * sin_c, s * cos_c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_sound_and_repeat() {
        for place in [street, table, aerial] {
            let splats = place(3).build();
            assert_eq!(splats.check(), Ok(()));
            assert!((0..splats.len()).all(|index| splats.is_sound(index)) && splats.len() > 5000);
            assert!(splats == place(3).build() && splats != place(4).build());
        }
    }

    #[test]
    fn normals_turn_with_the_place() {
        let (splats, turn) = (table(1).build(), rotation(2, 3));
        let turned = moved(&splats, turn, 2.0, DVec3::X);
        for index in (0..splats.len()).step_by(97) {
            let (before, after) = (splats.normal(index), turned.normal(index));
            assert!((turn * DVec3::from_array(before)).dot(DVec3::from_array(after)).abs() > 0.999_99);
        }
    }
}
