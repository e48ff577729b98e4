//! Numbers of the paper.

use super::layout::WeatherClass;
use WeatherClass::{Fog, Rain, Snow};

/// The name of the paper's own method.
const OURS: &str = "Weather-Magician";

/// Table II: CMMD against photographs of real weather; lower is nearer.
#[allow(clippy::approx_constant)] // 3.14 is a distance.
pub(crate) const CMMD: [(&str, [Option<f64>; 3]); 5] = [
    ("ClimateGAN", [Some(1.84), None, None]),
    ("DID-MDN", [None, Some(3.14), None]),
    ("Stable Diffusion", [Some(2.32), Some(3.12), Some(2.66)]),
    ("ClimateNeRF", [Some(2.11), None, Some(2.96)]),
    (OURS, [Some(1.40), Some(2.79), Some(3.30)]),
];

/// Table III: the methods in each weather's columns.
const UVQ_METHODS: [(WeatherClass, &[&str]); 3] = [
    (Fog, &["Stable Diffusion", "ClimateGAN", "ClimateNeRF", OURS]),
    (Rain, &["Stable Diffusion", OURS]),
    (Snow, &["Stable Diffusion", "ClimateNeRF", OURS]),
];

/// Table III: `compression_content_distortion` of UVQ 1.0 by scene, in the order of
/// [`UVQ_METHODS`]; higher is better.
pub(crate) const UVQ: [(&str, [f64; 9]); 6] = [
    ("Stump", [3.41, 3.56, 3.23, 4.43, 3.60, 3.81, 3.47, 3.62, 3.79]),
    ("Bicycle", [3.97, 4.12, 4.10, 4.23, 3.96, 4.20, 3.81, 3.94, 3.79]),
    ("Garden", [3.75, 4.10, 4.17, 3.87, 3.77, 3.97, 3.66, 3.85, 3.74]),
    ("Treehill", [3.43, 3.65, 3.41, 3.96, 3.33, 3.75, 3.32, 3.60, 3.62]),
    ("SJTU road driving", [3.76, 3.85, 3.74, 4.12, 3.72, 4.21, 3.74, 4.41, 4.49]),
    ("SJTU main gate", [3.45, 4.14, 3.37, 3.96, 3.29, 3.82, 3.63, 3.91, 3.95]),
];

/// Table III as rows: scene, weather, method, score.
pub(crate) fn uvq() -> impl Iterator<Item = (&'static str, WeatherClass, &'static str, f64)> {
    let columns =
        || UVQ_METHODS.iter().flat_map(|(weather, methods)| methods.iter().map(|method| (*weather, *method)));
    UVQ.iter().flat_map(move |(scene, scores)| {
        columns().zip(scores).map(|((weather, method), score)| (*scene, weather, method, *score))
    })
}

/// Table II as rows: method, weather, distance.
pub(crate) fn cmmd() -> impl Iterator<Item = (&'static str, WeatherClass, f64)> {
    CMMD.iter().flat_map(|(method, row)| {
        WeatherClass::ALL
            .into_iter()
            .zip(row)
            .filter_map(|(weather, value)| Some((*method, weather, (*value)?)))
    })
}
