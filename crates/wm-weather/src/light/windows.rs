//! Lit windows as surfaces.

use super::lamps::black_body;
use crate::optics::Site;
use crate::surfel::surfel;
use glam::DVec3;
use std::f64::consts::PI;
use wm_base::color::srgb_encode;
use wm_base::random::uniform;
use wm_scene::{Group, LitWindow, Splats, splats::Splat};

/// Splats along the longer edge of a window.
const LONG_EDGE_SPLATS: f64 = 16.0;
/// Standard deviation of a splat over the spacing.
const SIGMA_SPACINGS: f64 = 0.42;
/// Distance from the wall, m.
const WALL_DISTANCE_M: f64 = 0.03;

/// Splats of lit windows, `display` the value of a white surface in a lux. Each room is a little
/// brighter or darker, and lighter at the top, where its lamp hangs.
#[must_use]
pub fn window_splats(windows: &[LitWindow], display: f64, site: &Site) -> Splats {
    let mut splats = Splats::with_capacity(0, 0);
    let up = DVec3::from_array(site.up);
    for (number, window) in windows.iter().enumerate() {
        let [corner, across, upwards] = [window.corner, window.across, window.upwards].map(DVec3::from_array);
        let out = across.cross(upwards).normalize_or_zero();
        let step = across.length().max(upwards.length()) / LONG_EDGE_SPLATS;
        let [columns, rows] = [across, upwards].map(|edge| (edge.length() / step).round().max(1.0) as usize);
        // Luminance L is shown as pi L.
        let light = black_body(window.kelvin).map(|v| v * window.luminance * PI * display);
        for cell in 0..columns * rows {
            let (u, v) = ((cell % columns) as f64 + 0.5, (cell / columns) as f64 + 0.5);
            let (u, v) = (u / columns as f64, v / rows as f64);
            let own = 0.85 + 0.3 * uniform(number as u64, cell as u64);
            let share = own * (0.7 + 0.6 * v);
            let at = corner + across * u + upwards * v + out * (WALL_DISTANCE_M / site.metres_per_unit);
            let wide = [
                SIGMA_SPACINGS * across.length() / columns as f64,
                SIGMA_SPACINGS * upwards.length() / rows as f64,
            ];
            let scales = [wide[0].min(wide[1]), wide[0].min(wide[1]), 0.05 * step];
            let rgb = light.map(|v| srgb_encode(v * share) as f32);
            splats.push(&Splat { group: Group::Scene, ..surfel(at.to_array(), out, up, scales, rgb, 0.97) });
        }
    }
    splats
}
