//! The light of a place: how it fell when the place was captured, and how it falls under a weather.
//!
//! A captured colour is `c = rho E / pi`, with `rho` the reflectance and `E` the irradiance of its
//! surface. Under another light it is `c' = c E' / E`: reflectance cancels, and texture stays. So
//! what is found of a capture is not reflectance but how its light falls on each splat
//! ([`CaptureLight`]): openness to the sky, and the share of the sun that it sees. Any light over
//! the place ([`irradiance::SceneLight`]) then gives each splat a gain ([`LightGains`]), which does
//! not depend on the view.
//!
//! A gain is a factor per channel, which the shading applies before the air. Gains are found again
//! only if the light changes; headlamps, lightning and the shadows of drifting clouds are added in
//! each frame (`moving.rs`). The effect `light` says what light a weather has. A sun of the
//! weather's own brings its sky (`day.rs`), which is painted behind the scene by the same numbers,
//! and its shadows (`sun_shadows.rs`).
//!
//! [`SunPosition`] says from which direction a place gets the sun at a time;
//! [`clear_sky::ClearSky`] how much light comes from each direction of a clear sky then, and from
//! the sun, both in one unit.

mod capture;
pub(crate) mod change;
mod clear_sky;
mod clouds;
mod day;
mod flash;
mod gains;
mod headlamps;
mod irradiance;
mod lamp_glow;
mod lamp_shadows;
mod lamps;
mod moving;
mod openness;
mod placed;
mod places;
mod quantile;
mod shadow_casters;
mod shadow_edges;
mod sun_search;
mod sun_shadows;
mod unseen_casters;
mod white_card;
mod windows;

pub(crate) use capture::GREEN_EXCESS_RATIO;
pub use capture::{CaptureLight, KnownSun};
pub use change::LightChange;
pub(crate) use clouds::CloudShadows;
pub(crate) use day::OpenLight;
pub use flash::Flash;
pub(crate) use flash::{FlashLight, Storm};
pub(crate) use gains::apply_gains;
pub use gains::{FrameGains, LightCasts, LightGains, NewLight};
pub(crate) use headlamps::Headlamps;
pub(crate) use lamp_glow::LampGlow;
pub use lamp_glow::{LampsOn, ShadowedLight};
pub use lamp_shadows::LampShadows;
pub(crate) use lamps::SeenLight;
pub use lamps::{LampKind, LampLight, LampLights};
pub use moving::MovingLight;
pub use placed::{NearSplats, PlacedSurfaces};
pub use shadow_casters::ShadowCasters;
pub use sun_shadows::SunShadows;
pub use windows::window_splats;
pub(crate) use wm_scene::sun::SunPosition;

#[cfg(test)]
mod lamp_tests;
#[cfg(test)]
mod tests;
