//! The kinds of assets, a file each.

mod casters;
mod cover;
mod lamps;
mod light;
mod lying;
mod occluders;
mod open_water;
mod shelter;
mod standing;
mod sun_shadows;
mod surfaces;
mod wet;

pub(crate) use cover::lock;
pub(crate) use lying::LyingKey;
pub(crate) use standing::StandingOccluders;
pub(crate) use surfaces::SceneSurfaces;

use super::cache::AssetCache;
use super::kind::{Asset, AssetFile, AssetKey, Cost, Keep};
use super::make::Workshop;
use crate::Result;
