//! Lit targets: cards with the colours that photos of an overcast day show, and pictures of their
//! light.

use super::LevelFrame;
use glam::{DMat3, DQuat};
use wm_base::color::{luminance, srgb_encode};
use wm_base::random;
use wm_place::Picture;
use wm_scene::splats::{Splat, logit};
use wm_scene::{Group, Splats};

/// Changes that leave nothing in a weather but light: no air, nothing that falls or lies.
pub(crate) const LIGHT_ALONE: &str = "rain=off, snowfall=off, hail=off, look=off, snow_cover=off, \
    dust_cover=off, flood=off, wind=off, fog=off, haze=off, smog=off, sky=off, lightning=off, wetness=off";

/// Changes of light that leave the sky and the sun over a lit target.
pub(crate) const OPEN_SKY: &str =
    "light.photos=diffuse, light.lamps=off, light.headlamps=off, light.cloud_shadows=off";

/// The reflectance that surfaces have in the mean: of the ground that upright cards see, too.
pub(crate) const GROUND_REFLECTANCE: f64 = 0.25;
/// Share of the level irradiance under the CIE's overcast sky that an upright plane gets from the
/// sky, whose radiance goes as `1 + 2 sin h`: `(pi / 2 + 4 / 3) / (7 pi / 3)`.
pub(crate) const OVERCAST_UPRIGHT: f64 = 0.396_2;

/// The linear light of a card of some reflectance in the photos of an overcast day, where a level
/// white one shows as 1: `upright` is 0 of a level card and 1 of one that stands on open ground.
pub(crate) fn overcast_card(reflectance: f64, upright: f64) -> f64 {
    reflectance * (1.0 - upright + upright * (OVERCAST_UPRIGHT + 0.5 * GROUND_REFLECTANCE))
}

/// Half the sides of a level square, by half its side.
pub(crate) fn level_square(half: f64) -> [[f64; 3]; 2] {
    [[half, 0.0, 0.0], [0.0, half, 0.0]]
}

/// Paints a card about a point (level coordinates) in a linear grey, as scenes are made: with one
/// layer of flat splats, in rows `grain` m apart and as many between them. 0.2 % of what is behind
/// it shines through.
pub(crate) fn paint_card(
    level: &LevelFrame,
    center: [f64; 3],
    halves: [[f64; 3]; 2],
    grain: f64,
    light: f64,
    splats: &mut Splats,
) {
    let [u, v] = halves.map(|half| level.vector(half) / level.metres(1.0));
    let [across, down] =
        [u, v].map(|half| ((2.0 * level.metres(half.length()) / grain).round() as usize).max(1));
    let spacing = [(u, across), (v, down)].map(|(half, count)| 2.0 * half.length() / count as f64);
    let (x, z) = (u.normalize(), u.cross(v).normalize());
    let turn = DQuat::from_mat3(&DMat3::from_cols(x, z.cross(x), z));
    let wide = 0.6 * spacing[0].max(spacing[1]);
    let center = level.point(center);
    let first = splats.len() as u64;
    for index in 0..2 * across * down {
        // A little off the plane: of splats that overlap in one plane each would hide those to one
        // side of it, which moves what is seen.
        let off = z * (0.1 * wide * (random::uniform(first, index as u64) - 0.5));
        let (at, shift) = (index / 2, 0.25 + 0.5 * (index % 2) as f64);
        let [a, b] = [(at % across, across), (at / across, down)]
            .map(|(k, count)| 2.0 * (k as f64 + shift) / count as f64 - 1.0);
        splats.push(&Splat {
            mean: (center + a * u + b * v + off).to_array().map(|v| v as f32),
            quat: [turn.w, turn.x, turn.y, turn.z].map(|v| v as f32),
            log_scale: [wide, wide, 0.02 * wide].map(|v| v.ln() as f32),
            logit_opacity: logit(0.99) as f32,
            rgb: [srgb_encode(light) as f32; 3],
            group: Group::Scene,
        });
    }
}

/// A picture in linear light.
pub(crate) struct LightPicture {
    /// `[H, W, 3]`.
    pub(crate) rgb: Vec<f32>,
    /// Coverage by splats, `[H, W]`.
    pub(crate) alpha: Vec<f32>,
    /// Width and height, px.
    pub(crate) size: (usize, usize),
    /// The picture as displayed.
    pub(crate) picture: Picture,
}

impl LightPicture {
    /// Returns the light of a picture.
    pub(crate) fn of(picture: Picture) -> Self {
        let frame = &picture.frame;
        let size = (frame.width as usize, frame.height as usize);
        Self { rgb: frame.rgb_linear(), alpha: frame.alpha.clone(), size, picture }
    }

    /// The light of a pixel, linear RGB.
    pub(crate) fn rgb(&self, x: usize, y: usize) -> [f64; 3] {
        std::array::from_fn(|k| f64::from(self.rgb[3 * (y * self.size.0 + x) + k]))
    }

    /// The luminance of a pixel.
    pub(crate) fn light(&self, x: usize, y: usize) -> f64 {
        luminance(self.rgb(x, y))
    }

    /// Mean luminance of the pixels within `half` of a point of the picture, px.
    pub(crate) fn patch(&self, x: f64, y: f64, half: usize) -> f64 {
        let within = |at: f64, side: usize| {
            let at = at as usize;
            at.saturating_sub(half)..(at + half + 1).min(side)
        };
        super::mean(
            within(y, self.size.1).flat_map(|y| within(x, self.size.0).map(move |x| self.light(x, y))),
        )
    }

    /// The brightest channel of any pixel.
    pub(crate) fn brightest(&self) -> f64 {
        f64::from(self.rgb.iter().copied().fold(0.0, f32::max))
    }
}
