//! A preset with changes: the short way to a [`TrainConfig`].

use crate::check::ConfigError;
use crate::config::{
    BackgroundKind, Densify, ExposureMode, HazeMode, LossConfig, MoverMode, Preset, Resolution, TrainConfig,
};
use serde_json::Value;
use thiserror::Error;
use wm_scene::Rasterization;

/// A preset and what is changed of it.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainPlan {
    /// The preset.
    pub preset: Preset,
    /// The number of steps; `None` takes the preset's, or 100 a photo if that is less.
    pub steps: Option<u32>,
    /// The largest number of splats; `None` takes the preset's, or one for every 15 pixels that
    /// confirm what two others show if that is less.
    pub max_splats: Option<usize>,
    /// The densification strategy, one of [`Densify::NAMES`].
    pub densify: String,
    /// Highest degree of the spherical harmonics, 0-3.
    pub sh_degree: u8,
    /// Sizes of photos over time; `None` keeps the preset's.
    pub resolution: Option<Resolution>,
    /// The exposures of photos: one each, or one for all.
    pub exposure: ExposureMode,
    /// The treatment of what moves in the photos.
    pub movers: MoverMode,
    /// The haze in which the photos were taken.
    pub haze: HazeMode,
    /// The background behind the splats during training.
    pub background: BackgroundKind,
    /// The way in which splats smaller than a pixel are drawn.
    pub rasterization: Rasterization,
    /// The number of splats on the sky's half sphere; 0 for no sky.
    pub sky_splats: u32,
    /// Weights and other numbers of loss terms by their names in [`LossConfig`] and
    /// [`GeometryConfig`](crate::config::GeometryConfig), such as `("depth", 0.1)`.
    pub loss: Vec<(String, f64)>,
    /// The seed of all random choices.
    pub seed: u64,
}

impl Default for TrainPlan {
    fn default() -> Self {
        Self {
            preset: Preset::Standard,
            steps: None,
            max_splats: None,
            densify: "mcmc".into(),
            sh_degree: 3,
            resolution: None,
            exposure: ExposureMode::Auto,
            movers: MoverMode::Auto,
            haze: HazeMode::Auto,
            background: BackgroundKind::Random,
            rasterization: Rasterization::Classic,
            sky_splats: 20_000,
            loss: Vec::new(),
            seed: 0,
        }
    }
}

/// A reason why a plan makes no configuration.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum PlanError {
    /// There is no such strategy.
    #[error("there is no densification strategy `{0}`; choose one of {known}", known = Densify::NAMES.join(", "))]
    Strategy(String),
    /// There is no loss term, or number of one, of that name.
    #[error("{name}: no term of that name; there are l1, ssim and {}", known.join(", "))]
    Term {
        /// The name that was given.
        name: String,
        /// The names of the geometry terms and their numbers.
        known: Vec<String>,
    },
    /// A number of steps is not a whole number from 1 to 1,000,000.
    #[error("{name}={value}: must be a whole number of steps, 1 or more")]
    Steps {
        /// The name of the value.
        name: String,
        /// The value.
        value: f64,
    },
    /// A number is NaN or infinite.
    #[error("{name} is {value}; it must be finite")]
    NotFinite {
        /// The name of the value.
        name: String,
        /// The value.
        value: f64,
    },
    /// A value is out of range.
    #[error(transparent)]
    Value(#[from] ConfigError),
}

impl TrainPlan {
    /// Returns the configuration for so many photos, of which `confirmed` pixels confirm what two
    /// others show.
    ///
    /// # Errors
    /// [`PlanError`] names what is unknown or out of range.
    pub fn config(&self, photos: usize, confirmed: u64) -> Result<TrainConfig, PlanError> {
        let mut config = TrainConfig::preset(self.preset);
        config.set_steps(self.steps.unwrap_or_else(|| self.preset.steps_for(photos)));
        let most = self.max_splats.unwrap_or_else(|| self.preset.max_splats_for(confirmed));
        let strategy = Densify::named(&self.densify, config.steps, most);
        config.densify = strategy.ok_or_else(|| PlanError::Strategy(self.densify.clone()))?;
        config.sh_degree = self.sh_degree;
        config.resolution = self.resolution.unwrap_or(config.resolution);
        config.exposure = self.exposure;
        config.movers = self.movers;
        config.haze = self.haze;
        config.background = self.background;
        config.rasterization = self.rasterization;
        config.seed = self.seed;
        config.sky_splats = self.sky_splats;
        for (name, value) in &self.loss {
            config.loss = config.loss.with(name, *value)?;
        }
        config.check()?;
        Ok(config)
    }
}

impl LossConfig {
    /// Returns the configuration with another value for the weight or number called `name`.
    ///
    /// # Errors
    /// [`PlanError`] if there is none of that name, or a number of steps is not whole.
    pub fn with(self, name: &str, value: f64) -> Result<Self, PlanError> {
        let unknown = |loss: &Value| {
            let known = loss["geometry"].as_object().into_iter().flat_map(|map| map.keys().cloned());
            PlanError::Term { name: name.to_owned(), known: known.collect() }
        };
        if !value.is_finite() {
            return Err(PlanError::NotFinite { name: name.to_owned(), value });
        }
        let Ok(mut loss) = serde_json::to_value(self) else { return Err(unknown(&Value::Null)) };
        let table = match loss.get(name).is_some_and(Value::is_number) {
            true => Some(&mut loss),
            false => loss.get_mut("geometry").filter(|geometry| geometry.get(name).is_some()),
        };
        let Some(table) = table else { return Err(unknown(&loss)) };
        // Numbers of steps are whole.
        table[name] = match name {
            "every" if value.fract() != 0.0 || !(1.0..=1e6).contains(&value) => {
                return Err(PlanError::Steps { name: name.to_owned(), value });
            }
            "every" => (value as u32).into(),
            _ => value.into(),
        };
        serde_json::from_value(loss).map_err(|_| unknown(&Value::Null))
    }
}
