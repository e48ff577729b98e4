//! Numbers from the edges of their ranges.

use crate::damage::Draws;
use weather_magician::{EFFECTS, Weather};

/// Returns a weather with three parameters of effects at edges of their ranges.
pub fn weather_at_edges(draws: &mut Draws) -> Result<Weather, String> {
    let mut weather = Weather::default();
    for _ in 0..3 {
        let effect = draws.pick(&EFFECTS.iter().collect::<Vec<_>>());
        let Some(param) = effect.params.get(draws.below(effect.params.len())) else { continue };
        let (least, greatest) = param.range;
        let middle = 0.5 * (least + greatest.min(1e6));
        let values = [least, greatest.min(1e300), middle, least.next_up(), greatest.next_down(), 0.0, 1.0];
        // Words, colours and images refuse a number, which is an answer too.
        let set = weather.set_text(&format!("{}.{}={}", effect.name, param.name, draws.pick(&values)));
        if set.is_err() {
            weather.set_text(&format!("{}=on", effect.name)).map_err(|error| error.to_string())?;
        }
    }
    Ok(weather)
}
