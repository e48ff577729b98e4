//! Planted errors: a rig that draws each effect wrongly by a tenth, and who finds it.
//!
//! A fault changes what is drawn, never what is asked. Instruments draw what they draw whatever they find, so that those of whose
//! pictures a fault changes none need not look again: their readings are those of the faultless rig, byte for byte.

use super::field::Field;
use super::{Finding, INSTRUMENTS, Probe, Rig, Shot, Subject, asked};
use crate::commands::demo::street;
use crate::scene::{OpenScene, RunArgs};
use anyhow::Result;
use weather_magician::Picture;
use wm_render::Device;
use wm_scene::{Camera, Metadata, Splats};
use wm_street::Street;
use wm_weather::{Site, Weather};

/// What is drawn wrongly.
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
    /// What has fallen is a tenth more.
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

/// Under which weather an instrument looks.
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
struct Asked {
    subject: Subject,
    camera: Camera,
    weather: Weather,
    time: f64,
}

impl Fault {
    /// What is drawn for the `index`-th shot of an instrument.
    fn falsified(self, index: usize, shot: &Asked) -> Asked {
        let mut drawn = shot.clone();
        let mut scale = |effect: &str, param: &str, factor: f64| {
            if let Some(value) = asked::number(&shot.weather, shot.time, effect, param) {
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
                if asked::is_on(&shot.weather, "snow_cover")
                    && asked::number(&shot.weather, 0.0, "snow_cover", "depth").is_some()
                {
                    drawn.weather.set_text("wind.speed=20").unwrap();
                }
            }
            Self::Fallen => scale("snow_cover", "hours", 1.1),
            Self::Jitter => {
                if shot.subject == Subject::Place && shot.weather.effects().next().is_some() && index % 2 == 1
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
    field: Field,
    fault: Fault,
    shots: Vec<Asked>,
}

impl Rig for Faulty {
    fn site(&self) -> Site {
        self.field.site()
    }

    fn views(&mut self) -> Result<[Camera; 2]> {
        self.field.views()
    }

    fn set_up(&mut self, splats: Splats) -> Result<Subject> {
        self.field.set_up(splats)
    }

    fn clear_away(&mut self) {
        self.field.clear_away();
    }

    fn draw(&mut self, shot: &Shot<'_>, picture: &mut Picture) -> Result<()> {
        let Shot { subject, camera, weather, time, .. } = *shot;
        let asked = Asked { subject, camera: *camera, weather: weather.clone(), time };
        let drawn = self.fault.falsified(self.shots.len(), &asked);
        self.shots.push(asked);
        let (camera, weather, time) = (&drawn.camera, &drawn.weather, drawn.time);
        self.field.draw(&Shot { camera, weather, time, ..*shot }, picture)
    }
}

fn rig() -> Faulty {
    let run = RunArgs { device: Device::Cpu, ..RunArgs::default() };
    let scene = street::scene(0.5, None).unwrap();
    let loaded = OpenScene::of(scene, &Metadata::default(), &run).unwrap();
    let camera = Street::views()[0].camera((240, 160)).unwrap();
    let field = Field::new(loaded.renderer, loaded.place, camera);
    Faulty { field, fault: Fault::None, shots: Vec::new() }
}

#[test]
fn each_instrument_finds_its_own_error_and_no_other() {
    let mut rig = rig();
    let instruments: Vec<_> = INSTRUMENTS.iter().filter(|instrument| instrument.name != "controls").collect();
    let read = |rig: &mut Faulty, fault: Fault, index: usize| -> (Finding, Vec<Asked>) {
        let instrument = instruments[index];
        rig.fault = fault;
        let weather = weather(instrument.name);
        assert!((instrument.applies)(&weather, 0.0), "{}", instrument.name);
        let finding =
            (instrument.read)(rig, &Probe { weather: &weather, time: 0.0, setting: "test" }).unwrap();
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
