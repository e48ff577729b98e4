use weather_magician::{Metadata, PlaceOptions, Renderer, Scene, Weather};
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let mut renderer = Renderer::cpu().unwrap();
    let scale: f64 = args[2].parse().unwrap();
    let facts = Metadata { metres_per_unit: Some(scale), ..Metadata::default() };
    let path = std::path::Path::new(&args[1]);
    let options = PlaceOptions { facts, assets: None };
    let mut place = renderer.load_with(Scene::open(path).unwrap(), &options).unwrap();
    let mut weather = Weather::clear();
    weather.set_text("wetness.rate_before=25").unwrap();
    let state = renderer.water_state(&mut place, &weather, 0.0, &mut ()).unwrap().unwrap();
    let n = state.ground.iter().filter(|v| v.is_finite()).count();
    let wet = state.level.iter().zip(&state.ground).filter(|(l, g)| **l > **g).count();
    eprintln!(
        "{} x {} step {} ground {n} under water {wet} budget {:?}",
        state.width, state.height, state.step, state.budget
    );
    let mut out = format!("P6\n{} {}\n255\n", state.width, state.height).into_bytes();
    let (lo, hi) = state
        .ground
        .iter()
        .filter(|v| v.is_finite())
        .fold((f32::MAX, f32::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
    for at in 0..state.ground.len() {
        let g = state.ground[at];
        let rgb = if g.is_nan() {
            [60, 0, 0]
        } else {
            let v = (255.0 * ((g - lo) / (hi - lo))) as u8;
            let v = v / 2 + (64.0 * state.pores[at]) as u8;
            if state.level[at] > g { [0, 60, 255] } else { [v, v, v] }
        };
        out.extend(rgb);
    }
    std::fs::write(&args[3], out).unwrap();
}
