//! The settings of renders and back ends.

use crate::hooks::{Backdrop, ShadeGroup};
use crate::simd::SimdChoice;
use crate::sizes::GROUP;
use serde::{Deserialize, Serialize};
use wm_scene::Rasterization;

/// Names a loaded set of splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SetId(pub(crate) usize);

/// The settings of a render.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RenderConfig {
    /// The arrays of the frame that are filled beside the colour.
    pub outputs: Outputs,
    /// The background behind all splats.
    pub background: Background,
    /// The drawing of splats smaller than a pixel.
    pub rasterization: Rasterization,
}

/// The outputs beside the colour. Alpha is always rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Outputs {
    /// Expected depth and normals.
    pub geometry: Geometry,
    /// Median depth.
    pub median_depth: MedianDepth,
    /// Particles as a picture of their own.
    #[serde(default)]
    pub particles: ParticlePass,
    /// The water that a picture shows.
    #[serde(default)]
    pub water: WaterPass,
}

/// Geometry that is blended like the colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Geometry {
    /// Colour and alpha alone.
    #[default]
    None,
    /// Expected depth.
    Depth,
    /// Expected depth and normals.
    DepthNormal,
}

/// The output of median depth, or of the splat that has it; it costs two more operations a pixel
/// and splat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum MedianDepth {
    /// Not rendered.
    #[default]
    Off,
    /// Rendered.
    On,
    /// Renders the index of that splat instead, which [`crate::Frame::median_splat`] reads. For
    /// passes of one set without other geometry, surface, particles and pixel effects.
    Splat,
}

/// The output of particles as a picture of their own beside the colour, see
/// [`crate::Frame::particles`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ParticlePass {
    /// In the colour alone.
    #[default]
    Off,
    /// Apart as well.
    On,
}

/// The layers of the water that a picture shows: its share of each pixel, the light that it
/// reflects, and its depth. The builder of frames makes them, not the back ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum WaterPass {
    /// Not kept.
    #[default]
    Off,
    /// Kept.
    On,
}

/// A background behind all splats, at infinity. Weather acts on it as on everything else.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Background {
    /// One colour, display-referred, 0-1.
    Color([f32; 3]),
    /// A sky.
    Sky(SkyGradient),
}

impl Default for Background {
    fn default() -> Self {
        Self::Color([0.0; 3])
    }
}

/// A clear sky over a plain: three display-referred colours, 0-1, by elevation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkyGradient {
    /// Straight up.
    pub zenith: [f32; 3],
    /// At the horizon.
    pub horizon: [f32; 3],
    /// Well below the horizon.
    pub ground: [f32; 3],
    /// Up in world axes, length 1.
    pub up: [f32; 3],
}

impl SkyGradient {
    /// A neutral daylight sky for scenes that have none.
    #[must_use]
    pub fn daylight(up: [f32; 3]) -> Self {
        Self { zenith: [0.36, 0.54, 0.80], horizon: [0.80, 0.86, 0.91], ground: [0.58, 0.59, 0.57], up }
    }
}

impl Background {
    /// The display-referred colour in the unit direction `direction` (world axes).
    #[must_use]
    pub fn color(&self, direction: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Color(color) => color.map(f64::from),
            Self::Sky(sky) => {
                let elevation: f64 = (0..3).map(|k| direction[k] * f64::from(sky.up[k])).sum();
                // Most of the change is near the horizon, as in a clear sky. Below it lies a hazy
                // distance: a scene seen from the air ends before the horizon, and a hard line
                // there would look like a wall.
                let height = 1.0 - (1.0 - elevation.clamp(0.0, 1.0)).powi(3);
                let below = (-elevation / 0.5).clamp(0.0, 1.0);
                let below = below * below * (3.0 - 2.0 * below);
                std::array::from_fn(|k| {
                    let above =
                        f64::from(sky.horizon[k]) * (1.0 - height) + f64::from(sky.zenith[k]) * height;
                    above * (1.0 - below) + f64::from(sky.ground[k]) * below
                })
            }
        }
    }
}

impl Backdrop for Background {
    fn paint(&self, _: f64, groups: &mut [ShadeGroup]) {
        for group in groups {
            for lane in 0..GROUP {
                let color = self.color([0, 1, 2].map(|k| f64::from(group.direction[k][lane])));
                for k in 0..3 {
                    group.rgb[k][lane] = color[k] as f32;
                }
            }
        }
    }

    fn reference(&self, _: f64, direction: [f64; 3]) -> [f64; 3] {
        self.color(direction)
    }

    fn uniform(&self) -> Option<[f32; 3]> {
        match self {
            Self::Color(color) => Some(*color),
            Self::Sky(_) => None,
        }
    }
}

/// The settings of the CPU back end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CpuConfig {
    /// Number of threads; `None` for one a core.
    pub threads: Option<usize>,
    /// SIMD path.
    pub simd: SimdChoice,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sky_is_continuous_and_has_its_colors() {
        let sky = SkyGradient::daylight([0.0, 0.0, 1.0]);
        let background = Background::Sky(sky);
        for k in 0..3 {
            assert!((background.color([0.0, 0.0, 1.0])[k] - f64::from(sky.zenith[k])).abs() < 1e-6);
            assert!((background.color([1.0, 0.0, 0.0])[k] - f64::from(sky.horizon[k])).abs() < 1e-6);
            assert!((background.color([0.0, 0.0, -1.0])[k] - f64::from(sky.ground[k])).abs() < 1e-6);
        }
        let mut last = background.color([-1.0, 0.0, -0.1]);
        for i in 1..=2000 {
            let color = background.color([-1.0, 0.0, -0.1 + 0.0001 * f64::from(i)]);
            assert!((0..3).all(|k| (color[k] - last[k]).abs() < 1e-3));
            last = color;
        }
    }
}
