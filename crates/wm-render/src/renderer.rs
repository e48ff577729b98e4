//! The interface that every back end offers: sets of splats, plans, and the settings of a render.

use crate::cpu::model::{CLUSTER, Cluster, GROUPS, SplatGroup};
use crate::frame::Frame;
use crate::hooks::{Backdrop, GROUP, ShadeGroup};
use crate::plan::{DrawPass, FramePlan, Pictures};
use crate::simd::SimdChoice;
use serde::{Deserialize, Serialize};
use std::future::Future;
use std::ops::{Add, AddAssign};
use std::pin::Pin;
use thiserror::Error;
use wm_scene::{CameraError, Rasterization, Splats, SplatsError};

/// A back end. Splat sets are loaded once and drawn many times.
pub trait RenderBackend {
    /// Describes the back end for reports: device, SIMD path, threads.
    fn describe(&self) -> String;

    /// Prepares splats for drawing and keeps them.
    ///
    /// # Errors
    /// [`RenderError`] if the arrays do not fit each other or memory is short.
    fn load(&mut self, splats: &Splats) -> Result<SetId, RenderError>;

    /// Forgets a set. Its id is not used again.
    fn unload(&mut self, set: SetId);

    /// Carries out a plan; its pictures are in `pictures` afterwards, whose memory is re-used where
    /// it fits.
    ///
    /// # Errors
    /// [`RenderError`] if a camera cannot be rendered with, a set is not loaded or memory is short.
    /// What `pictures` holds then is of no use.
    fn execute(&mut self, plan: &FramePlan<'_>, pictures: &mut Pictures) -> Result<Stats, RenderError>;

    /// Carries out a plan like [`Self::execute`]. In a browser the page goes on while a GPU draws;
    /// elsewhere the future is ready when it is first polled.
    ///
    /// # Errors
    /// As of [`Self::execute`].
    fn execute_async<'a>(
        &'a mut self,
        plan: &'a FramePlan<'_>,
        pictures: &'a mut Pictures,
    ) -> ExecuteFuture<'a> {
        Box::pin(std::future::ready(self.execute(plan, pictures)))
    }

    /// Finds the weight of each splat of a pass in its picture: alpha times the transmittance
    /// before it, summed over the pixels, px, in steps of 1/1024 a tile. `weights` has those of the
    /// sets one after the other, each in the order in which it was loaded. The weather of the pass
    /// and the rest of its outputs do not count.
    ///
    /// # Errors
    /// As of [`Self::execute`], and if the picture has more than 4 million pixels.
    fn weigh(&mut self, pass: &DrawPass<'_>, weights: &mut Vec<f32>) -> Result<Stats, RenderError>;

    /// Carries out a plan of one draw pass: renders one view into `frame`, whose arrays are re-used
    /// where they fit.
    ///
    /// # Errors
    /// As of [`Self::execute`].
    fn render(&mut self, pass: &DrawPass<'_>, frame: &mut Frame) -> Result<Stats, RenderError> {
        let (mut plan, mut pictures) = (FramePlan::new(), Pictures::default());
        let picture = plan.draw(pass.clone());
        pictures.put(picture, std::mem::take(frame));
        let done = self.execute(&plan, &mut pictures);
        *frame = pictures.take(picture);
        done
    }

    /// [`Self::render`] as [`Self::execute_async`] does it.
    ///
    /// # Errors
    /// As of [`Self::execute`].
    fn render_async<'a>(&'a mut self, pass: &'a DrawPass<'_>, frame: &'a mut Frame) -> ExecuteFuture<'a> {
        Box::pin(async move {
            let (mut plan, mut pictures) = (FramePlan::new(), Pictures::default());
            let picture = plan.draw(pass.clone());
            pictures.put(picture, std::mem::take(frame));
            let done = self.execute_async(&plan, &mut pictures).await;
            *frame = pictures.take(picture);
            done
        })
    }
}

/// A plan that is being carried out.
pub type ExecuteFuture<'a> = Pin<Box<dyn Future<Output = Result<Stats, RenderError>> + 'a>>;

/// Steps of a weight of one pixel, see [`RenderBackend::weigh`].
pub(crate) const WEIGHT_UNITS: f32 = 1024.0;

/// Checks that weights of a camera's picture can be counted.
pub(crate) fn check_weighed(camera: &wm_scene::Camera) -> Result<(), RenderError> {
    let most = u64::from(u32::MAX) / WEIGHT_UNITS as u64;
    let (width, height) = (camera.width, camera.height);
    match u64::from(width) * u64::from(height) <= most {
        true => Ok(()),
        false => Err(RenderError::Memory { width, height }),
    }
}

/// Names a loaded set of splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SetId(pub(crate) usize);

/// The sets that a renderer holds, in the form of its back end.
pub(crate) struct Models<M>(Vec<Option<M>>);

impl<M> Default for Models<M> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<M> Models<M> {
    /// Adds a set under the first free id.
    pub(crate) fn add(&mut self, model: M) -> SetId {
        let free = self.0.iter().position(Option::is_none).unwrap_or(self.0.len());
        if free == self.0.len() {
            self.0.push(None);
        }
        self.0[free] = Some(model);
        SetId(free)
    }

    /// Removes a set, if it is loaded.
    pub(crate) fn remove(&mut self, set: SetId) {
        if let Some(model) = self.0.get_mut(set.0) {
            *model = None;
        }
    }

    /// Returns a loaded set.
    pub(crate) fn get(&self, set: SetId) -> Result<&M, RenderError> {
        self.0.get(set.0).and_then(Option::as_ref).ok_or(RenderError::UnknownSet(set.0))
    }
}

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

/// The output of particles as a picture of their own beside the colour, see [`Frame::particles`].
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

/// The counts and times of one or more renders. Times are summed over threads, in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Stats {
    /// Splats that passed culling.
    pub visible: u64,
    /// Pairs of a splat and a tile that it touches.
    pub intersections: u64,
    /// Pairs of a splat and a pixel that were evaluated.
    pub evaluated_pairs: u64,
    /// Falling particles in the picture.
    pub particles: u64,
    /// Time in projection (culling, 2D Gaussians) and shading (colour, normals).
    pub project: f64,
    /// Time in the air's effect on the splats.
    pub medium: f64,
    /// Time in finding tiles and in scattering the pairs to them.
    pub intersect: f64,
    /// Time in depth sorting.
    pub sort: f64,
    /// Time in blending.
    pub rasterize: f64,
    /// Time in finding the particles and laying them out; on a GPU, in laying them out.
    pub fall: f64,
    /// Time in which the CPU finds the particles of a GPU's frame, while the GPU draws splats.
    pub gather: f64,
    /// Time in background, particles, pixel effects and output.
    pub composite: f64,
    /// Wall time of the whole frame.
    pub wall: f64,
    /// The work of a GPU; nothing on the CPU.
    pub device: DeviceWork,
}

/// The work that a GPU is given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DeviceWork {
    /// Programs that were started.
    pub dispatches: u64,
    /// Lists of commands that were handed over.
    pub submissions: u64,
    /// Bytes that were sent to it.
    pub sent: u64,
    /// Bytes that were read back.
    pub returned: u64,
}

impl DeviceWork {
    /// The work since `before`.
    #[cfg(feature = "gpu")]
    pub(crate) fn since(self, before: Self) -> Self {
        Self {
            dispatches: self.dispatches - before.dispatches,
            submissions: self.submissions - before.submissions,
            sent: self.sent - before.sent,
            returned: self.returned - before.returned,
        }
    }
}

impl AddAssign for DeviceWork {
    fn add_assign(&mut self, other: Self) {
        let Self { dispatches, submissions, sent, returned } = other;
        self.dispatches += dispatches;
        self.submissions += submissions;
        self.sent += sent;
        self.returned += returned;
    }
}

impl AddAssign for Stats {
    fn add_assign(&mut self, other: Self) {
        // Whole, so that a field cannot be forgotten.
        let Self {
            visible,
            intersections,
            evaluated_pairs,
            particles,
            project,
            medium,
            intersect,
            sort,
            rasterize,
            fall,
            gather,
            composite,
            wall,
            device,
        } = other;
        self.visible += visible;
        self.intersections += intersections;
        self.evaluated_pairs += evaluated_pairs;
        self.particles += particles;
        self.project += project;
        self.medium += medium;
        self.intersect += intersect;
        self.sort += sort;
        self.rasterize += rasterize;
        self.fall += fall;
        self.gather += gather;
        self.composite += composite;
        self.wall += wall;
        self.device += device;
    }
}

impl Add for Stats {
    type Output = Self;

    fn add(mut self, other: Self) -> Self {
        self += other;
        self
    }
}

/// Why a render failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RenderError {
    /// The camera cannot be rendered with.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The splats do not fit each other.
    #[error(transparent)]
    Splats(#[from] SplatsError),
    /// A splat holds a number that cannot be rendered.
    #[error("splat {index} holds {value}, which is no finite number: repair the scene first")]
    NotFinite {
        /// The index of the splat.
        index: usize,
        /// The name of the field.
        value: &'static str,
    },
    /// More splats than indices.
    #[error("{0} splats are too many for one set: the most is {max}", max = MAX_SPLATS)]
    TooMany(usize),
    /// The set was never loaded or is unloaded.
    #[error("splat set {0} is not loaded")]
    UnknownSet(usize),
    /// The processor lacks the SIMD path.
    #[error("this processor has no {0}: use --simd auto")]
    NoSimd(&'static str),
    /// The lists of a frame would take too much memory.
    #[error("a picture's lists would take more than {mebibytes} MiB: {}", listed.advice())]
    TooMuch {
        /// The things that are listed.
        listed: crate::Listed,
        /// The most that the lists of such a picture may take, MiB.
        mebibytes: u64,
    },
    /// Too many cells of space would be searched for rain, snow or hail.
    #[error("{cells:.0} cells of space would have to be searched: {}", crate::Listed::Falling.advice())]
    TooManyCells {
        /// Their number.
        cells: f64,
    },
    /// Memory for the picture could not be had.
    #[error("no memory for a picture of {width}x{height} px")]
    Memory {
        /// Picture width, px.
        width: u32,
        /// Picture height, px.
        height: u32,
    },
    /// The thread pool could not be started.
    #[error("cannot start {threads} threads: {reason}")]
    Threads {
        /// The number of threads.
        threads: usize,
        /// The system's words.
        reason: String,
    },
    /// A GPU was asked for, and the program has no GPU back end.
    #[cfg(not(feature = "gpu"))]
    #[error("this program was built without the feature `gpu`: use --device cpu")]
    NoGpu,
    /// The GPU cannot be used, or failed.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Gpu(#[from] crate::gpu::GpuError),
}

impl RenderError {
    /// Returns true if the GPU failed: another device may succeed.
    #[must_use]
    pub fn is_of_gpu(&self) -> bool {
        #[cfg(feature = "gpu")]
        return matches!(self, Self::Gpu(_));
        #[cfg(not(feature = "gpu"))]
        return false;
    }
}

/// Bytes that a back end takes to keep a set of `splats` of an SH degree: on the CPU in the
/// computer's memory, on a GPU in its own.
#[must_use]
pub fn bytes_of_set(splats: usize, sh_degree: u8) -> u64 {
    let clusters = splats.div_ceil(CLUSTER);
    let rest = (wm_scene::sh::coefficients(sh_degree) - 1) * 3;
    let group = size_of::<SplatGroup>()
        + rest * size_of::<[f32; GROUP]>()
        + GROUP * size_of::<u32>()
        + size_of::<u16>();
    (clusters * (GROUPS * group + size_of::<Cluster>())) as u64
}

/// Most splats in one frame: a key of the tile lists has no more bits for them.
pub(crate) const MAX_SPLATS: usize = 1 << crate::stages::intersect::RECORD_BITS;

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
