//! The pictures of one view, each in its own array.

use crate::error::RenderError;
use crate::sizes::GROUP;
pub use wm_base::color::{srgb_decode, srgb_encode};

/// The encoding of `Frame::rgb`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColorEncoding {
    /// sRGB-encoded, display-referred: what scenes are trained on and screens show.
    #[default]
    Srgb,
    /// Proportional to light, 1 = display white.
    Linear,
}

/// Pictures of one view. H rows of W pixels, the top row first. Arrays that were not asked for are
/// empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// The encoding of `rgb`.
    pub encoding: ColorEncoding,
    /// Colour with the background behind it, `[H, W, 3]`, nominally 0-1, not clamped.
    pub rgb: Vec<f32>,
    /// Coverage by splats, 1 - transmittance, 0-1, `[H, W]`.
    pub alpha: Vec<f32>,
    /// Expected depth: mean view z of the splats, weighted, scene units, `[H, W]`; 0 where `alpha`
    /// is below [`MIN_ALPHA`].
    pub depth: Vec<f32>,
    /// Median depth: view z of the splat at which the transmittance falls to one half, scene units,
    /// `[H, W]`; 0 where it never does.
    pub median_depth: Vec<f32>,
    /// Mean normal (shortest axis, towards the camera) in world axes, weighted, at length 1,
    /// `[H, W, 3]`; 0 where `alpha` is below [`MIN_ALPHA`].
    pub normal: Vec<f32>,
    /// The particles before the scene: linear light that comes from them, not below 0, and their
    /// coverage `1 - e^-tau`, 0-1, `[H, W, 4]`. With it the colour before the pixel effects is, in
    /// linear light, `c (1 - coverage) + light`, where `c` is the colour of the scene without what
    /// falls.
    pub particles: Vec<f32>,
    /// Sums that the surface of the pass ([`crate::DrawPass::surface`]) splits, five a pixel. Over
    /// the splats before it: red, green and blue as sums of weights times values, without
    /// background, particles and pixel effects, and last their coverage. Fourth, over the splats
    /// behind it: the sum of weights over view z, 1/scene units. In a pixel without a surface all
    /// splats are before it.
    ///
    /// They lie as vectors read them: a row is a sequence of groups of [`crate::hooks::GROUP`]
    /// pixels, the last one maybe narrower, and a group is `[5, pixels]`. [`Self::front_sums`] has
    /// one of the five as `[H, W]`.
    pub front: Vec<f32>,
}

/// Channels of [`Frame::front`].
pub const FRONT_CHANNELS: usize = 5;

/// Channels of the arrays of a [`Frame`]: colour, alpha, depth, median depth, normal, particles,
/// what is before a surface.
pub(crate) const CHANNEL_COUNTS: [usize; 7] = [3, 1, 1, 1, 3, 4, FRONT_CHANNELS];

/// The arrays of a [`Frame`] that are filled, beside alpha, which always is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arrays {
    pub(crate) rgb: bool,
    pub(crate) depth: bool,
    pub(crate) median_depth: bool,
    pub(crate) normal: bool,
    pub(crate) particles: bool,
    pub(crate) front: bool,
}

/// Offset of splat indices that are stored as the bits of depths: these bits are normal numbers,
/// which no device flushes or changes, and never 0.
pub(crate) const SPLAT_NAME: u32 = 1 << 30;

/// Returns the depth that encodes a splat index, see [`Frame::median_splat`].
pub(crate) fn splat_name(index: u32) -> f32 {
    f32::from_bits(SPLAT_NAME + index)
}

/// Coverage below which depth and normal are noise and given as 0: one step of 8 bits.
pub const MIN_ALPHA: f32 = 1.0 / 255.0;

impl Arrays {
    /// Returns the channels of each array, in the order of [`CHANNEL_COUNTS`]; 0 for an array that
    /// is not filled.
    fn array_channels(self) -> [usize; 7] {
        let Self { rgb, depth, median_depth, normal, particles, front } = self;
        let wanted = [rgb, true, depth, median_depth, normal, particles, front];
        std::array::from_fn(|array| if wanted[array] { CHANNEL_COUNTS[array] } else { 0 })
    }

    /// Returns how many numbers a pixel has in all arrays.
    #[cfg(feature = "gpu")]
    pub(crate) fn channels(self) -> usize {
        self.array_channels().iter().sum()
    }
}

impl Frame {
    /// Returns all arrays, in the order of [`CHANNEL_COUNTS`].
    pub(crate) fn arrays_mut(&mut self) -> [&mut Vec<f32>; 7] {
        let Self { rgb, alpha, depth, median_depth, normal, particles, front, .. } = self;
        [rgb, alpha, depth, median_depth, normal, particles, front]
    }

    /// Sizes the arrays for a picture; memory that fits is kept with what is in it.
    ///
    /// # Errors
    /// [`RenderError::Memory`] if there is too little.
    pub(crate) fn prepare(
        &mut self,
        width: u32,
        height: u32,
        encoding: ColorEncoding,
        arrays: Arrays,
    ) -> Result<(), RenderError> {
        let pixels = width as usize * height as usize;
        for (array, channels) in self.arrays_mut().into_iter().zip(arrays.array_channels()) {
            let length = pixels * channels;
            if array.len() != length {
                array.clear();
                array.try_reserve_exact(length).map_err(|_| RenderError::Memory { width, height })?;
                array.resize(length, 0.0);
            }
        }
        (self.width, self.height, self.encoding) = (width, height, encoding);
        Ok(())
    }

    /// The index of the splat at which the transmittance of a pixel falls to one half, in the set
    /// that was drawn with [`crate::MedianDepth::Splat`]; `None` where it never does.
    #[must_use]
    pub fn median_splat(&self, pixel: usize) -> Option<u32> {
        self.median_depth[pixel].to_bits().checked_sub(SPLAT_NAME)
    }

    /// One of the five sums of [`Self::front`], `[H, W]`; empty without them.
    ///
    /// # Panics
    /// If `part` is not below [`FRONT_CHANNELS`].
    #[must_use]
    pub fn front_sums(&self, part: usize) -> Vec<f32> {
        assert!(part < FRONT_CHANNELS, "five sums a pixel");
        let rows = self.front.chunks(FRONT_CHANNELS * self.width.max(1) as usize);
        let groups = rows.flat_map(|row| row.chunks(FRONT_CHANNELS * GROUP));
        groups
            .flat_map(|group| {
                &group[part * group.len() / FRONT_CHANNELS..(part + 1) * group.len() / FRONT_CHANNELS]
            })
            .copied()
            .collect()
    }

    /// Number of pixels.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Index of pixel `(x, y)` in a one-channel array.
    #[must_use]
    pub fn index(&self, x: u32, y: u32) -> usize {
        y as usize * self.width as usize + x as usize
    }

    /// The colour of pixel `(x, y)`.
    #[must_use]
    pub fn rgb_at(&self, x: u32, y: u32) -> [f32; 3] {
        let i = 3 * self.index(x, y);
        [self.rgb[i], self.rgb[i + 1], self.rgb[i + 2]]
    }

    /// The colour in linear light, `[H, W, 3]`.
    #[must_use]
    pub fn rgb_linear(&self) -> Vec<f32> {
        match self.encoding {
            ColorEncoding::Linear => self.rgb.clone(),
            ColorEncoding::Srgb => self.rgb.iter().map(|v| srgb_decode(f64::from(*v)) as f32).collect(),
        }
    }
}
