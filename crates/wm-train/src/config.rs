//! The configuration of a training: everything that its result depends on, beside the photos.

pub use crate::check::ConfigError;
use crate::check::{COUNT_RANGE, ConfigValue, MAX_WEIGHT, SHARE_RANGE, WEIGHT_RANGE};
pub use crate::densify::Densify;
pub use crate::densify::adaptive::AdaptiveConfig;
pub use crate::densify::fixed::FixedConfig;
pub use crate::densify::mcmc::McmcConfig;
use serde::{Deserialize, Serialize};
use wm_scene::{Rasterization, sh};

/// Most steps.
const MAX_STEPS: u32 = 1_000_000;
/// Most splats of the sky: more of them would be smaller than pixels.
const MAX_SKY_SPLATS: f64 = 1e6;

/// A training. Two of equal configuration, photos and SIMD path give the same scene, byte for byte.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Steps; each sees one photo.
    pub steps: u32,
    /// The seed of the order of photos, of samples and of starting points.
    pub seed: u64,
    /// Highest degree of the spherical harmonics.
    pub sh_degree: u8,
    /// Steps from one degree to the next.
    pub sh_every: u32,
    /// The way in which splats smaller than a pixel are drawn.
    pub rasterization: Rasterization,
    /// The background behind the splats during training.
    pub background: BackgroundKind,
    /// Coarse to fine, or not.
    pub resolution: Resolution,
    /// The exposures of photos: one each, or one for all.
    pub exposure: ExposureMode,
    /// The treatment of what moves in the photos.
    pub movers: MoverMode,
    /// The haze in which the photos were taken.
    pub haze: HazeMode,
    /// Weights of the loss.
    pub loss: LossConfig,
    /// Step lengths.
    pub rates: RateConfig,
    /// The densification strategy.
    pub densify: Densify,
    /// Opacity that splats begin with, 0-1.
    pub start_opacity: f64,
    /// Standard deviation that splats begin with, in distances to their neighbours.
    pub start_scale: f64,
    /// Share of the budget of splats up to which points of known depth are added at the start,
    /// where the reconstruction has none.
    pub start_fill: f64,
    /// Splats of the sky: how many on its half sphere, where photos show it.
    pub sky_splats: u32,
}

/// The background behind the splats during training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BackgroundKind {
    /// Black.
    Black,
    /// Another colour each step, so that what is bright or dark is covered, the sky above all.
    #[default]
    Random,
}

/// Sizes of photos over time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Resolution {
    /// Photos have their full size from the start.
    Full,
    /// A quarter, then half, then as they are; see `schedule::level`.
    Coarse,
}

/// The exposures of photos: one each, or one for all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ExposureMode {
    /// All photos are alike.
    Shared,
    /// An affine change of colour a photo, learnt with the scene and left out of it.
    Photo,
    /// [`Self::Photo`] if the points of the reconstruction are brighter in some photos than in
    /// others, else [`Self::Shared`].
    #[default]
    Auto,
}

/// The treatment of what moves in the photos.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MoverMode {
    /// Pixels that show movers are found and left out; see the module `movers`.
    #[default]
    Auto,
    /// All pixels count.
    Keep,
}

/// The haze in which photos were taken, if any.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HazeMode {
    /// It is looked for, measured and taken out; see the module `haze`.
    #[default]
    Auto,
    /// It is a part of the scene.
    Keep,
    /// It has this meteorological optical range, metres (scene units where the scale is not known),
    /// and is taken out.
    Mor(f64),
}

/// Weights of the loss.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LossConfig {
    /// The weight of the mean absolute difference.
    pub l1: f64,
    /// The weight of 1 minus structural similarity.
    pub ssim: f64,
    /// Depth, normals and sky, where something is believed of them.
    pub geometry: GeometryConfig,
}

/// Weights of the terms that make surfaces of splats; 0 switches one off.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GeometryConfig {
    /// The weight of depth in the scene's units; see `losses::DepthTerm`.
    pub depth: f64,
    /// The weight of the relative depth of patches, by moving means; see `losses::PatchDepthTerm`.
    pub depth_hard: f64,
    /// The weight of the relative depth of patches, by changing opacities.
    pub depth_soft: f64,
    /// The share of the patches' own deviation beside the photo's, in both.
    pub depth_local: f64,
    /// Differences of normalised depth up to this are none.
    pub depth_margin: f64,
    /// Share of the steps after which depth changes more than means.
    pub depth_from: f64,
    /// Share of the weights of depth that is left at the last step; they fall log-linearly.
    pub depth_last: f64,
    /// Steps between two that have renders of their own for `depth_hard`, `depth_soft` and
    /// `surface`.
    pub every: u32,
    /// The weight of coverage in front of the sky; see `losses::SurfaceTerm`.
    pub surface: f64,
    /// The weight of normals; see `losses::NormalTerm`.
    pub normal: f64,
    /// Share of the steps after which normals count: 6,000 of 30,000 in the paper.
    pub normal_from: f64,
    /// The weight of flatness; see `losses::FlatTerm`.
    pub flat: f64,
    /// The weight of smooth depth where the photo is smooth; see `losses::SmoothTerm`.
    pub smooth: f64,
}

impl GeometryConfig {
    /// No term at all.
    pub const NONE: Self = Self {
        depth: 0.0,
        depth_hard: 0.0,
        depth_soft: 0.0,
        depth_local: 0.1,
        depth_margin: 0.01,
        depth_from: 1.0 / 30.0,
        depth_last: 0.1,
        every: 1,
        surface: 0.0,
        normal: 0.0,
        normal_from: 0.2,
        flat: 0.0,
        smooth: 0.0,
    };

    /// The first step at which depth changes more than means.
    pub(crate) fn depth_from(&self, steps: u32) -> u32 {
        (self.depth_from * f64::from(steps)) as u32
    }

    /// Returns the share of the weights of depth that counts at a step: 1 at the first,
    /// [`Self::depth_last`] at the last.
    pub(crate) fn depth_share(&self, step: u32, steps: u32) -> f64 {
        self.depth_last.powf(f64::from(step) / f64::from(steps.max(1)))
    }

    /// The first step at which normals count.
    pub(crate) fn normal_from(&self, steps: u32) -> u32 {
        (self.normal_from * f64::from(steps)) as u32
    }
}

impl Default for GeometryConfig {
    fn default() -> Self {
        // The paper's normals weigh 0.05. With a quarter of it normals of the made-up street are
        // off by 11 degrees (median) where a training without has 41, and its pictures lose 0.1 dB;
        // with half of it 9 degrees and 0.2 dB.
        Self {
            depth: 0.02,
            depth_hard: 0.02,
            every: 4,
            surface: 0.02,
            normal: 0.012,
            flat: 0.002,
            ..Self::NONE
        }
    }
}

/// Step lengths; those of means in units of the scene's extent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RateConfig {
    /// Means at the first step.
    pub means_first: f64,
    /// Means at the last; log-linear between.
    pub means_last: f64,
    /// Quaternions.
    pub quats: f64,
    /// Logarithms of scales.
    pub log_scales: f64,
    /// Logits of opacities.
    pub logit_opacities: f64,
    /// First SH coefficient.
    pub sh_dc: f64,
    /// Other SH coefficients.
    pub sh_rest: f64,
    /// Exposure of photos.
    pub exposure: f64,
}

/// A choice between speed and quality.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Preset {
    /// 600 steps, 50,000 splats at most, coarse to fine: a first look.
    Draft,
    /// 2,000 steps, 100,000 splats at most, coarse to fine.
    Quick,
    /// 7,000 steps, 300,000 splats at most, coarse to fine.
    #[default]
    Standard,
    /// 30,000 steps, 1,000,000 splats at most.
    Best,
}

impl TrainConfig {
    /// The configuration of a preset.
    #[must_use]
    pub fn preset(preset: Preset) -> Self {
        let steps = preset.steps();
        let max_splats = preset.max_splats();
        Self {
            steps,
            seed: 0,
            sh_degree: 3,
            sh_every: sh_every(steps),
            rasterization: Rasterization::Classic,
            background: BackgroundKind::Random,
            resolution: if preset == Preset::Best { Resolution::Full } else { Resolution::Coarse },
            exposure: ExposureMode::Auto,
            movers: MoverMode::Auto,
            haze: HazeMode::Auto,
            loss: LossConfig { l1: 0.8, ssim: 0.2, geometry: GeometryConfig::default() },
            rates: RateConfig::for_steps(steps),
            densify: Densify::Mcmc(McmcConfig::for_steps(steps, max_splats)),
            start_opacity: 0.1,
            start_scale: 1.0,
            start_fill: 0.5,
            sky_splats: 20_000,
        }
    }

    /// Another number of steps, and the growth of the spherical harmonics in proportion.
    pub fn set_steps(&mut self, steps: u32) {
        self.steps = steps;
        self.sh_every = sh_every(steps);
        self.rates = RateConfig::for_steps(steps);
    }
}

/// Returns the steps from one degree to the next: one each 1,000 of 30,000 as published, but all
/// degrees in a short training too.
fn sh_every(steps: u32) -> u32 {
    (steps / 8).clamp(1, 1000)
}

impl RateConfig {
    /// The published step lengths for 30,000 steps, and longer ones for fewer: Adam moves a
    /// parameter by at most about its step length each time, so that a short training of short
    /// steps never arrives. They grow as the square root of the missing steps (of opacities, as its
    /// root again), up to eight times.
    #[must_use]
    pub fn for_steps(steps: u32) -> Self {
        let longer = (30_000.0 / f64::from(steps.max(1))).sqrt().clamp(1.0, 8.0);
        Self {
            means_first: 1.6e-4 * longer,
            means_last: 1.6e-6 * longer,
            quats: 1e-3 * longer,
            log_scales: 5e-3 * longer,
            logit_opacities: 0.05 * longer.sqrt(),
            sh_dc: 2.5e-3 * longer,
            // Longer ones learn the exposure of single photos as a change of colour with direction.
            sh_rest: 2.5e-3 / 20.0,
            exposure: 1e-3,
        }
    }
}

/// Pixels that confirm what two other photos show, for each splat, at least: more splats than that
/// learn single photos by heart.
const PIXELS_PER_SPLAT: u64 = 15;
/// Most steps for each photo: published trainings take 30,000 steps with 100 to 300 photos, and
/// more learn few photos by heart.
const STEPS_PER_PHOTO: u32 = 100;

impl Preset {
    /// The number of steps where there are enough photos.
    #[must_use]
    pub fn steps(self) -> u32 {
        match self {
            Self::Draft => 600,
            Self::Quick => 2_000,
            Self::Standard => 7_000,
            Self::Best => 30_000,
        }
    }

    /// The number of steps for so many photos: at most 100 a photo, but those of [`Preset::Quick`]
    /// in any case.
    pub(crate) fn steps_for(self, photos: usize) -> u32 {
        let most = u32::try_from(photos).unwrap_or(u32::MAX).saturating_mul(STEPS_PER_PHOTO);
        self.steps().min(most.max(Self::Quick.steps()))
    }

    /// Most splats for photos of which so many pixels confirm what two others show; see
    /// the module `overlap`.
    pub(crate) fn max_splats_for(self, confirmed: u64) -> usize {
        let told_apart = usize::try_from(confirmed / PIXELS_PER_SPLAT).unwrap_or(usize::MAX);
        self.max_splats().min(told_apart.max(1000))
    }

    /// Longest side, px, that photos are best reduced to.
    #[must_use]
    pub fn longest_side(self) -> u32 {
        match self {
            Self::Draft => 500,
            Self::Quick | Self::Standard | Self::Best => 1600,
        }
    }

    /// Most splats.
    #[must_use]
    pub fn max_splats(self) -> usize {
        match self {
            Self::Draft => 50_000,
            Self::Quick => 100_000,
            Self::Standard => 300_000,
            Self::Best => 1_000_000,
        }
    }
}

impl TrainConfig {
    /// Checks every value that steps divide by, index with or take the logarithm of.
    ///
    /// # Errors
    /// [`ConfigError`] names the first value that makes no training, and what it may be.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        let (loss, rates) = (&self.loss, &self.rates);
        let geometry = &loss.geometry;
        let mor = if let HazeMode::Mor(mor) = self.haze { mor } else { 1.0 };
        let weight = |name, value: f64| ConfigValue::new(name, value, WEIGHT_RANGE);
        let count = |name, value: u32| ConfigValue::new(name, value, COUNT_RANGE);
        let values = [
            ConfigValue::new("steps", self.steps, 1.0..=f64::from(MAX_STEPS)),
            ConfigValue::new("sh_degree", self.sh_degree, 0.0..=f64::from(sh::MAX_DEGREE)),
            count("sh_every", self.sh_every),
            ConfigValue::new("start_opacity", self.start_opacity, SHARE_RANGE),
            ConfigValue::new("start_scale", self.start_scale, 1e-6..=MAX_WEIGHT),
            ConfigValue::new("start_fill", self.start_fill, 0.0..=1.0),
            ConfigValue::new("sky_splats", self.sky_splats, 0.0..=MAX_SKY_SPLATS),
            ConfigValue::new("haze.mor", mor, 1e-6..=MAX_WEIGHT),
            weight("loss.l1", loss.l1),
            weight("loss.ssim", loss.ssim),
            weight("loss.geometry.depth", geometry.depth),
            weight("loss.geometry.depth_hard", geometry.depth_hard),
            weight("loss.geometry.depth_soft", geometry.depth_soft),
            weight("loss.geometry.depth_local", geometry.depth_local),
            weight("loss.geometry.depth_margin", geometry.depth_margin),
            ConfigValue::new("loss.geometry.depth_from", geometry.depth_from, 0.0..=1.0),
            ConfigValue::new("loss.geometry.depth_last", geometry.depth_last, f64::MIN_POSITIVE..=1.0),
            count("loss.geometry.every", geometry.every),
            weight("loss.geometry.surface", geometry.surface),
            weight("loss.geometry.normal", geometry.normal),
            ConfigValue::new("loss.geometry.normal_from", geometry.normal_from, 0.0..=1.0),
            weight("loss.geometry.flat", geometry.flat),
            weight("loss.geometry.smooth", geometry.smooth),
            ConfigValue::new("rates.means_first", rates.means_first, f64::MIN_POSITIVE..=MAX_WEIGHT),
            ConfigValue::new("rates.means_last", rates.means_last, f64::MIN_POSITIVE..=MAX_WEIGHT),
            weight("rates.quats", rates.quats),
            weight("rates.log_scales", rates.log_scales),
            weight("rates.logit_opacities", rates.logit_opacities),
            weight("rates.sh_dc", rates.sh_dc),
            weight("rates.sh_rest", rates.sh_rest),
            weight("rates.exposure", rates.exposure),
        ];
        let mut values = values.into_iter().chain(self.densify.strategy().values());
        match values.find(|value| !value.range.contains(&value.value)) {
            None => Ok(()),
            Some(ConfigValue { name, value, range }) => {
                Err(ConfigError { name, value, least: *range.start(), most: *range.end() })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_pixels_make_few_splats() {
        // Nine photos of 320x237, of which six tenths are confirmed.
        assert_eq!(Preset::Quick.max_splats_for(9 * 320 * 237 * 6 / 10), 27_302);
        assert_eq!(Preset::Quick.max_splats_for(100), 1000);
        // Few photos get fewer steps, but those of `quick` in any case.
        assert_eq!([8, 40, 300].map(|photos| Preset::Best.steps_for(photos)), [2000, 4000, 30_000]);
        assert_eq!([Preset::Draft, Preset::Standard].map(|preset| preset.steps_for(40)), [600, 4000]);
        assert_eq!([Preset::Quick, Preset::Best].map(|p| p.max_splats_for(u64::MAX)), [100_000, 1_000_000]);
    }

    #[test]
    fn presets_are_sound_and_nonsense_is_named() {
        for preset in [Preset::Draft, Preset::Quick, Preset::Standard, Preset::Best] {
            let mut config = TrainConfig::preset(preset);
            assert_eq!(config.check(), Ok(()));
            config.densify = Densify::Adaptive(AdaptiveConfig::for_steps(config.steps, 1000));
            assert_eq!(config.check(), Ok(()));
            config.set_steps(1);
            assert_eq!(config.check(), Ok(()));
        }
        let say = |change: fn(&mut TrainConfig)| {
            let mut config = TrainConfig::preset(Preset::Quick);
            change(&mut config);
            config.check().unwrap_err().to_string()
        };
        assert_eq!(say(|c| c.steps = 0), "steps is 0; it must be 1 to 1000000");
        assert_eq!(say(|c| c.sh_degree = 9), "sh_degree is 9; it must be 0 to 3");
        assert!(say(|c| c.rates.means_last = 0.0).starts_with("rates.means_last is 0; "));
        assert_eq!(say(|c| c.sky_splats = u32::MAX), "sky_splats is 4294967295; it must be 0 to 1000000");
        assert!(say(|c| c.loss.l1 = f64::NAN).starts_with("loss.l1 is NaN; "));
    }
}
