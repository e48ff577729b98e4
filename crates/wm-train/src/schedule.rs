//! Values that change over a training.

use crate::config::{RateConfig, Resolution, TrainConfig};
use wm_render::training::Rates;

/// Returns the step lengths at a step, for a scene of `extent` units.
pub(crate) fn rates(config: &RateConfig, step: u32, steps: u32, extent: f64) -> Rates {
    let at = f64::from(step) / f64::from(steps.max(1));
    let means = (config.means_first.ln() * (1.0 - at) + config.means_last.ln() * at).exp();
    Rates {
        means: means * extent,
        quats: config.quats,
        log_scales: config.log_scales,
        logit_opacities: config.logit_opacities,
        sh_dc: config.sh_dc,
        sh_rest: config.sh_rest,
    }
}

/// Returns the factor on the step lengths of colours for photos in haze: 0.5 at the first step,
/// 0.05 at the last, log-linear between.
///
/// Through haze the gradients of colours are small, but Adam's steps have the same length: colours
/// that the haze hides would be noisy.
pub(crate) fn colors_in_haze(step: u32, steps: u32) -> f64 {
    0.5 * 0.1f64.powf(f64::from(step) / f64::from(steps.max(1)))
}

/// Returns the degree of the spherical harmonics in use at a step.
pub(crate) fn sh_degree(config: &TrainConfig, step: u32) -> u8 {
    let grown = step / config.sh_every.max(1);
    config.sh_degree.min(u8::try_from(grown).unwrap_or(u8::MAX))
}

/// Returns how often the sides of photos are halved at a step: twice in the first tenth of the
/// steps, once in the next two, but never below `last_level`.
pub(crate) fn level(config: &TrainConfig, step: u32, last_level: u8) -> u8 {
    let at = f64::from(step) / f64::from(config.steps.max(1));
    let wanted = match config.resolution {
        Resolution::Full => 0,
        Resolution::Coarse if at < 0.1 => 2,
        Resolution::Coarse if at < 0.3 => 1,
        Resolution::Coarse => 0,
    };
    wanted.min(last_level)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Preset;

    #[test]
    fn rates_fall_and_degrees_and_sizes_grow() {
        let config = TrainConfig::preset(Preset::Standard);
        let published = RateConfig::for_steps(30_000);
        let at = |step| rates(&published, step, 7000, 2.0).means;
        assert!((at(0) - 3.2e-4).abs() < 1e-12 && (at(7000) - 3.2e-6).abs() < 1e-12);
        assert!((at(3500) - 3.2e-5).abs() < 1e-12);
        assert!((RateConfig::for_steps(7500).sh_dc - 0.005).abs() < 1e-12);
        assert!((RateConfig::for_steps(10).sh_dc - 0.02).abs() < 1e-12);
        let shares = [0, 3500, 7000].map(|step| colors_in_haze(step, 7000));
        assert!(shares[0] == 0.5 && shares[0] > shares[1] && (shares[2] - 0.05).abs() < 1e-12);
        let degrees: Vec<u8> = [0, 874, 875, 1750, 2625, 6999].map(|step| sh_degree(&config, step)).into();
        assert_eq!(degrees, [0, 0, 1, 2, 3, 3]);
        assert_eq!([0, 699, 700, 2099, 2100].map(|step| level(&config, step, 5)), [2, 2, 1, 1, 0]);
        assert_eq!(level(&config, 0, 1), 1);
    }
}
