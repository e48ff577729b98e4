//! The interface that every back end offers: sets of splats, plans, and the settings of a render.

use crate::config::SetId;
use crate::cpu::model::{Cluster, SplatGroup};
use crate::error::RenderError;
use crate::frame::Frame;
use crate::plan::{DrawPass, FramePlan, Pictures, SetView, SplatSource};
use crate::sizes::{CLUSTER, GROUP, GROUPS_PER_CLUSTER};
use crate::stages::intersect::MAX_SPLATS;
use serde::Serialize;
use std::future::Future;
use std::ops::{Add, AddAssign};
use std::pin::Pin;
use wm_scene::Splats;

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

    /// Returns the set that a view draws: a loaded one, or `own`, which was made for the pass.
    pub(crate) fn drawn<'a>(&'a self, view: &SetView<'_>, own: Option<&'a M>) -> Result<&'a M, RenderError> {
        match view.splats {
            SplatSource::Loaded(SetId(set)) => {
                self.0.get(set).and_then(Option::as_ref).ok_or(RenderError::UnknownSet(set))
            }
            SplatSource::Transient(_) => Ok(own.expect("it was made for this pass")),
        }
    }
}

/// Makes the sets of a pass that are not loaded; an element for each set.
pub(crate) fn transient<M, E>(
    pass: &DrawPass<'_>,
    load: impl Fn(&Splats) -> Result<M, E>,
) -> Result<Vec<Option<M>>, E> {
    let made = pass.sets.iter().map(|view| match view.splats {
        SplatSource::Loaded(_) => Ok(None),
        SplatSource::Transient(splats) => load(splats).map(Some),
    });
    made.collect()
}

/// Checks that so many splats can be drawn together.
pub(crate) fn check_count(splats: usize) -> Result<(), RenderError> {
    if splats > MAX_SPLATS { Err(RenderError::TooMany(splats)) } else { Ok(()) }
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

/// Adds structures field by field.
macro_rules! add_fields {
    ($name:ident { $($field:ident),* $(,)? }) => {
        impl AddAssign for $name {
            fn add_assign(&mut self, other: Self) {
                // Whole, so that a field cannot be forgotten.
                let Self { $($field),* } = other;
                $(self.$field += $field;)*
            }
        }
    };
}

add_fields!(DeviceWork { dispatches, submissions, sent, returned });
add_fields!(Stats {
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
});

impl Add for Stats {
    type Output = Self;

    fn add(mut self, other: Self) -> Self {
        self += other;
        self
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
    (clusters * (GROUPS_PER_CLUSTER * group + size_of::<Cluster>())) as u64
}
