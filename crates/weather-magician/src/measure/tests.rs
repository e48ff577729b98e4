//! Planted errors: a renderer that draws each effect wrongly by a tenth, and the instruments that find it.
//!
//! A fault changes what is drawn, never what is asked. Instruments draw what they draw whatever they find, so that those of whose
//! pictures a fault changes none need not look again: their readings are those of the faultless rig, byte for byte.

use super::place_renderer::PlaceRenderer;
use super::{
    Finding, INSTRUMENTS, InstrumentRenderer, InstrumentShot, MeasureRequest, ShotSubject, expected,
};
use crate::{Picture, Renderer, Result};
use wm_scene::{Camera, Splats};
use wm_street::Street;
use wm_weather::{Site, Weather};

/// A planted error.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    None,
    /// The air dims a tenth more.
    Extinction,
    /// A tenth more falls, at its own sizes and speeds.
    Rate,
    /// Drops fall a tenth faster, and streak as they fall.
    Speed,
    /// Drops fall and drift a tenth faster than their streaks are long.
    Pace,
    /// Drops are a tenth wider.
    Diameter,
    /// The shutter is open a tenth longer.
    Exposure,
    /// The wind carries drops a tenth faster.
    Drift,
    /// Snow lies a tenth deeper.
    Depth,
    /// Wind blows snow under the roof.
    Shelter,
    /// A tenth more snow has fallen.
    Fallen,
    /// The place is not drawn twice where it stands.
    Jitter,
}

/// Each fault, and which readings find it: the instrument and a part of the quantity.
const FINDS: [(Fault, &[[&str; 2]]); 12] = [
    (Fault::None, &[]),
    // The same air, seen on boards and on the place.
    (Fault::Extinction, &[["visibility", "MOR"], ["rays", "optical depth"], ["rays", "single rays"]]),
    (Fault::Rate, &[["gauge", "rate"]]),
    // What falls faster fills a gauge faster.
    (Fault::Speed, &[["gauge", "rate"], ["gauge", "fall speed"], ["streaks", "fall"]]),
    (Fault::Pace, &[["gauge", "rate"], ["gauge", "fall speed"], ["streaks", "length"], ["streaks", "drift"]]),
    // Wider drops are more water, and are too slow for their size.
    (
        Fault::Diameter,
        &[["gauge", "rate"], ["gauge", "diameter"], ["gauge", "fall speed"], ["streaks", "fall"]],
    ),
    (Fault::Exposure, &[["streaks", "length"], ["streaks", "fall"]]),
    (Fault::Drift, &[["streaks", "drift"]]),
    (Fault::Depth, &[["stake", "in the open"], ["stake", "on the roof"]]),
    (Fault::Shelter, &[["stake", ""]]),
    (Fault::Fallen, &[["budget", "water"]]),
    (Fault::Jitter, &[["consistency", ""]]),
];

/// The weather that an instrument is tested in.
fn weather(instrument: &str) -> Weather {
    let sets: &[&str] = match instrument {
        "visibility" | "rays" => &["fog.mor=60"],
        "gauge" => &["rain.rate=5"],
        "streaks" => &["rain.rate=2.5", "rain.exposure=0.004", "wind.speed=5"],
        "budget" => &["snowfall.rate=3", "snow_cover.depth=auto", "snow_cover.hours=30"],
        "stake" => &["snow_cover.depth=0.1"],
        _ => &["fog.mor=150", "snow_cover.depth=0.1"],
    };
    let mut weather = Weather::clear();
    sets.iter().for_each(|set| weather.set_text(set).unwrap());
    weather
}

/// A shot by itself.
#[derive(Clone, PartialEq)]
struct OwnedShot {
    subject: ShotSubject,
    camera: Camera,
    weather: Weather,
    time: f64,
}

impl Fault {
    /// Returns the picture that is drawn in place of the `index`-th of an instrument.
    fn falsified(self, index: usize, shot: &OwnedShot) -> OwnedShot {
        let mut drawn = shot.clone();
        let mut scale = |effect: &str, param: &str, factor: f64| {
            if let Some(value) = expected::number(&shot.weather, shot.time, effect, param) {
                drawn.weather.set_text(&format!("{effect}.{param}={}", value * factor)).unwrap();
            }
        };
        match self {
            Self::None => {}
            Self::Extinction => scale("fog", "mor", 1.0 / 1.1),
            Self::Rate => scale("rain", "rate", 1.1),
            Self::Speed => {
                // Time runs faster; what is not to goes slower in it.
                scale("rain", "exposure", 1.1);
                scale("wind", "speed", 1.0 / 1.1);
                drawn.time *= 1.1;
            }
            Self::Pace => drawn.time *= 1.1,
            Self::Diameter => scale("rain", "size", 1.1),
            Self::Exposure => scale("rain", "exposure", 1.1),
            Self::Drift => scale("wind", "speed", 1.1),
            Self::Depth => scale("snow_cover", "depth", 1.1),
            Self::Shelter => {
                if expected::is_on(&shot.weather, "snow_cover")
                    && expected::number(&shot.weather, 0.0, "snow_cover", "depth").is_some()
                {
                    drawn.weather.set_text("wind.speed=20").unwrap();
                }
            }
            Self::Fallen => scale("snow_cover", "hours", 1.1),
            Self::Jitter => {
                if shot.subject == ShotSubject::Place
                    && shot.weather.effects().next().is_some()
                    && index % 2 == 1
                {
                    drawn.camera.cx += 4.0;
                }
            }
        }
        drawn
    }

    /// The instruments that this is about.
    fn is_for(self, instrument: &str) -> bool {
        self != Self::Shelter || instrument == "stake"
    }
}

/// A rig with a fault, that remembers what it was asked for.
struct Faulty {
    field: PlaceRenderer,
    fault: Fault,
    shots: Vec<OwnedShot>,
}

impl InstrumentRenderer for Faulty {
    fn site(&self) -> Site {
        self.field.site()
    }

    fn views(&mut self) -> Result<[Camera; 2]> {
        self.field.views()
    }

    fn set_up(&mut self, splats: Splats) -> Result<ShotSubject> {
        self.field.set_up(splats)
    }

    fn clear_away(&mut self) {
        self.field.clear_away();
    }

    fn draw(&mut self, shot: &InstrumentShot<'_>, picture: &mut Picture) -> Result<()> {
        let InstrumentShot { subject, camera, weather, time, .. } = *shot;
        let requested = OwnedShot { subject, camera: *camera, weather: weather.clone(), time };
        let drawn = self.fault.falsified(self.shots.len(), &requested);
        self.shots.push(requested);
        let (camera, weather, time) = (&drawn.camera, &drawn.weather, drawn.time);
        self.field.draw(&InstrumentShot { camera, weather, time, ..*shot }, picture)
    }
}

fn rig() -> Faulty {
    let scene = Street::builtin().sampling(0.5).scene(&|_| true).unwrap();
    let mut renderer = Renderer::cpu().unwrap();
    let place = renderer.load(scene).unwrap();
    let camera = Street::views()[0].camera((240, 160)).unwrap();
    let field = PlaceRenderer::new(renderer, place, camera);
    Faulty { field, fault: Fault::None, shots: Vec::new() }
}

#[test]
fn each_instrument_finds_its_own_error_and_no_other() {
    let mut rig = rig();
    let instruments: Vec<_> = INSTRUMENTS.iter().filter(|instrument| instrument.name != "controls").collect();
    let read = |rig: &mut Faulty, fault: Fault, index: usize| -> (Finding, Vec<OwnedShot>) {
        let instrument = instruments[index];
        rig.fault = fault;
        let weather = weather(instrument.name);
        assert!((instrument.applies)(&weather, 0.0), "{}", instrument.name);
        let finding =
            (instrument.read)(rig, &MeasureRequest { weather: &weather, time: 0.0, setting: "test" })
                .unwrap();
        rig.clear_away();
        (finding, std::mem::take(&mut rig.shots))
    };
    let faultless: Vec<_> = (0..instruments.len()).map(|index| read(&mut rig, Fault::None, index)).collect();
    for (fault, finds) in FINDS {
        let mut found: Vec<&[&str; 2]> = Vec::new();
        for (index, instrument) in instruments.iter().enumerate() {
            let (own, shots) = &faultless[index];
            let is_touched = fault.is_for(instrument.name)
                && shots.iter().enumerate().any(|(k, shot)| fault.falsified(k, shot) != *shot);
            let finding = if is_touched { read(&mut rig, fault, index).0 } else { own.clone() };
            for reading in finding.readings.iter().filter(|reading| !reading.passes()) {
                println!("{fault:?}: {} finds {reading:?}", instrument.name);
                let is_its =
                    |find: &&[&str; 2]| find[0] == instrument.name && reading.quantity.contains(find[1]);
                let find = finds.iter().find(is_its);
                assert!(find.is_some(), "{fault:?} is no error of {}: {reading:?}", instrument.name);
                found.extend(find);
            }
        }
        for find in finds {
            assert!(found.contains(&find), "{fault:?} is not found by {find:?}");
        }
    }
}
