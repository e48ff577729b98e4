//! Thumbnails of the presets.

use crate::catalog::Catalog;
use crate::state::{ViewState, weather_to_json};
use crate::view::View;
use std::sync::Arc;
use wm_weather::{EffectRole, Weather};

/// Width of a thumbnail.
pub const WIDTH_PX: u32 = 224;
/// JPEG quality of a thumbnail.
pub const JPEG_QUALITY: u8 = 80;

/// The picture of a thumbnail.
#[derive(Clone, Debug)]
pub struct ThumbnailShot {
    /// The view, of the scene's size.
    pub view: Arc<View>,
    /// Width and height of the thumbnail, px.
    pub size: (u32, u32),
}

/// Returns the weather of the thumbnail of a preset, and its time in seconds; `None` if there is no
/// such preset.
///
/// # Errors
/// The wind of the preset cannot be turned off.
pub fn thumbnail_weather(name: &str) -> Result<Option<(Weather, f64)>, String> {
    let Ok(mut weather) = Weather::preset(name) else { return Ok(None) };
    if weather.has(EffectRole::Lies) {
        // All presets share one cover, that of still air.
        weather.set_text("wind=off").map_err(|error| error.to_string())?;
    }
    let breaks = weather.effects().flat_map(|(_, tracks)| tracks).flat_map(wm_weather::Track::breaks);
    // Most of it has happened by then.
    let time = 0.8 * breaks.fold(0.0, f64::max);
    Ok(Some((weather, time)))
}

/// Returns the thumbnail of a preset for a scene that starts with the state `start`; `None` if
/// there is no such preset.
///
/// # Errors
/// As [`thumbnail_weather`], or the start makes no view.
pub fn thumbnail_view(
    name: &str,
    catalog: &Catalog,
    start: ViewState,
) -> Result<Option<ThumbnailShot>, String> {
    let Some((weather, time)) = thumbnail_weather(name)? else { return Ok(None) };
    let [width, height] = start.size;
    let height = (f64::from(WIDTH_PX * height) / f64::from(width)).round().clamp(1.0, 1024.0) as u32;
    let state = ViewState { weather: weather_to_json(&weather), time, divider: None, ..start };
    let view = Arc::new(View::new(state, catalog, None)?);
    Ok(Some(ThumbnailShot { view, size: (WIDTH_PX, height) }))
}
