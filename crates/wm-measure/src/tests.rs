//! Planted errors: a renderer that draws each effect wrongly by a tenth, and the instruments that
//! find it.
//!
//! A fault changes what is drawn, never what is asked. Instruments draw what they draw whatever
//! they find, so that those of whose pictures a fault changes none need not look again: their
//! readings are those of the faultless rig, byte for byte.

use super::place_renderer::PlaceRenderer;
use super::{
    Finding, INSTRUMENTS, Instrument, InstrumentRenderer, InstrumentScan, MeasureRequest, ShadowReport,
    ShotSubject, changed, expected,
};
use glam::DVec3;
use std::sync::Mutex;
use wm_base::color::{srgb_decode, srgb_encode};
use wm_place::lidar::LidarSweep;
use wm_place::{FrameCamera, FrameRequest, Picture, Renderer, Result};
use wm_render::{CpuConfig, Device};
use wm_scene::{Camera, Lamp, Scene, Splats, quat, sh};
use wm_street::Street;
use wm_weather::wetness::WaterState;
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
    /// Upright surfaces get a tenth more light.
    Upright,
    /// The sky is a tenth brighter than the light that it gives.
    Sky,
    /// The sun stands a tenth lower.
    SunLow,
    /// The sun stands 2 degrees aside.
    SunAside,
    /// The edges of shadows are a fifth wider.
    Edges,
    /// Three tenths of the shadows of the capture are left.
    Shadows,
    /// Lamps make a tenth more light in the air.
    Glow,
    /// Lamps get a tenth brighter with every 50 m.
    Far,
    /// Lightning is a tenth brighter.
    Flash,
    /// Lightning is exposed for a tenth of a frame.
    Shutter,
    /// Wet surfaces darken a tenth less.
    Darkening,
    /// It has rained a tenth longer.
    Rained,
    /// Snow melts a tenth faster.
    Melt,
    /// Water stands a tenth deeper than has come to it.
    Puddles,
    /// Films are a tenth rougher.
    Rough,
    /// Water reflects a tenth more.
    Reflectance,
    /// The water stands a tenth higher.
    Level,
    /// The water is a tenth clearer.
    Clearness,
    /// The lidar's ranges are a tenth longer.
    Ranges,
    /// The lidar's echoes are a tenth stronger.
    Echoes,
    /// Wet surfaces send a tenth more back to a lidar.
    WetEchoes,
    /// The lidar sees a tenth of its points less.
    Points,
}

/// Each fault with the readings that find it, separated by `"; "`. A reading is an instrument and a
/// part of the quantity; an instrument alone is any reading of it.
const FINDS: [(Fault, &str); 34] = [
    (Fault::None, ""),
    // The same air, seen on boards and on the place.
    (
        Fault::Extinction,
        "visibility: MOR; rays: optical depth; rays: single rays; allard: extinction; \
         halo: light; lidar-board: extinction; lidar-board: board of 10 %",
    ),
    // A tenth more rain brings a tenth more energy, which is the square of slopes.
    (Fault::Rate, "gauge: rate; water-budget: rain on the ground; ripples: slopes; lidar-drops: drops"),
    // What falls faster fills a gauge faster.
    (Fault::Speed, "gauge: rate; gauge: fall speed; streaks: fall; ripples: frequency"),
    (Fault::Pace, "gauge: rate; gauge: fall speed; streaks: length; streaks: drift; ripples: frequency"),
    // Wider drops are more water, and are too slow for their size.
    (Fault::Diameter, "gauge: rate; gauge: diameter; gauge: fall speed; streaks: fall"),
    (Fault::Exposure, "streaks: length; streaks: fall"),
    (Fault::Drift, "streaks: drift"),
    (Fault::Depth, "stake: in the open; stake: on the roof"),
    (Fault::Shelter, "stake"),
    // What melts before the start melts while it falls.
    (Fault::Fallen, "budget: water; water-budget: melt water"),
    (Fault::Melt, "water-budget: melt water"),
    (Fault::Jitter, "consistency"),
    (Fault::Upright, "lux: upright board under clouds; lux: beam on upright board"),
    (
        Fault::Sky,
        "lux: zenith; lux: level board over the sum of the sky; \
         lux: level board in shade over the sum of the sky",
    ),
    // Boards are not in the shade of their discs any more.
    (Fault::SunLow, "sundial: shadow of a rod; lux: level board in shade; lux: beam on"),
    // The edge of the wall's shadow is not where it is looked at.
    (Fault::SunAside, "sundial: azimuth; sundial: width"),
    (Fault::Edges, "sundial: width"),
    (Fault::Shadows, "shadows: contrast left"),
    (Fault::Glow, "halo: light"),
    (Fault::Far, "allard: extinction"),
    (Fault::Flash, "flash: stroke"),
    (Fault::Shutter, "flash: light of; flash: stroke"),
    (Fault::Darkening, "wet-card: full pores; wet-card: under a film"),
    (Fault::Rained, "water-budget: rain on the ground"),
    (Fault::Puddles, "water-budget: water in and out"),
    (Fault::Rough, "lamp-streak: width; lamp-streak: length"),
    (Fault::Reflectance, "fresnel: reflectance"),
    // At another level the board is met at other elevations, and the disc is deeper.
    (Fault::Level, "mirror: images"),
    (Fault::Clearness, "secchi: depth"),
    // A board of 10 % is looked for where it is set up.
    (Fault::Ranges, "lidar-board: range of a board; lidar-air: reach; lidar-air: before full overlap"),
    (Fault::Echoes, "lidar-board: intensity"),
    (Fault::WetEchoes, "lidar-road: 6 m away; lidar-road: 12 m away"),
    (Fault::Points, "lidar-drops: drops; lidar-road: range of"),
];

/// The weathers that an instrument is tested in.
fn weathers(instrument: &str) -> Vec<Weather> {
    let all: &[&str] = match instrument {
        "visibility" | "rays" => &["fog.mor=60"],
        "gauge" => &["rain.rate=5"],
        "streaks" => &["rain.rate=2.5, rain.exposure=0.004, wind.speed=5"],
        "budget" => &["snowfall.rate=3, snow_cover.depth=auto, snow_cover.hours=30"],
        "stake" => &["snow_cover.depth=0.1"],
        "wet-card" => &["wetness.amount=1"],
        "water-budget" => &[
            "rain.rate=25, wetness.rained_before=10",
            "snowfall.rate=2, snow_cover.depth=auto, snow_cover.hours=12, \
             snow_cover.temperature=5, wetness.rained_before=0",
        ],
        "lux" => &[
            "light.model=clear, light.clouds=1",
            "light.model=clear, light.sun_elevation=40, light.sun_azimuth=200",
        ],
        "sundial" => &["light.model=clear, light.sun_elevation=40, light.sun_azimuth=200"],
        "shadows" => &["light.model=overcast"],
        "allard" | "halo" => &["fog.mor=120"],
        "fresnel" | "mirror" => &["flood.level=0.5"],
        "secchi" => &["flood.level=0.5, flood.secchi=0.3"],
        "ripples" => &["flood.level=1, rain.rate=10"],
        "lamp-streak" => &["wetness.amount=1"],
        "lidar-board" | "lidar-air" => &["fog.mor=60"],
        "lidar-drops" => &["rain.rate=50"],
        "lidar-road" => &["wetness.amount=1"],
        "flash" => &["lightning.rate=40, lightning.distance=1500"],
        _ => &["fog.mor=150, snow_cover.depth=0.1"],
    };
    all.iter().map(|changes| changed(&Weather::clear(), changes).unwrap()).collect()
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
            Self::SunLow => scale("light", "sun_elevation", 1.0 / 1.1),
            Self::SunAside => scale("light", "sun_azimuth", 1.01),
            // A picture of an edge that is wider is the same picture from nearer.
            Self::Edges if (shot.camera.width, shot.camera.height) == (240, 240) => {
                (drawn.camera.fx, drawn.camera.fy) = (1.2 * shot.camera.fx, 1.2 * shot.camera.fy);
            }
            Self::Shutter => scale("lightning", "exposure", 0.1),
            Self::Darkening => scale("wetness", "porosity", 1.0 / 1.1),
            Self::Rained => scale("wetness", "rained_before", 1.1),
            Self::Melt => scale("snow_cover", "temperature", 1.1),
            Self::Level if shot.camera.width == 480 => scale("flood", "level", 1.1),
            Self::Rough if shot.camera.width == 640 => {
                // Less of a film by the logarithm of 1.1.
                if let Some(amount) = expected::number(&shot.weather, shot.time, "wetness", "amount") {
                    drawn.weather.set_text(&format!("wetness.amount={}", amount - 0.0477)).unwrap();
                }
            }
            Self::Clearness if shot.camera.width == 48 => scale("flood", "secchi", 1.1),
            // Not of what is drawn, but of its light.
            Self::Upright
            | Self::Sky
            | Self::Edges
            | Self::Shadows
            | Self::Glow
            | Self::Far
            | Self::Flash
            | Self::Puddles
            | Self::Rough
            | Self::Reflectance
            | Self::Level
            | Self::Clearness
            | Self::Ranges
            | Self::Echoes
            | Self::WetEchoes
            | Self::Points => {}
        }
        drawn
    }

    /// The light of a pixel that is drawn in place of another, if this changes the light of a
    /// picture: linear RGB, the coverage by splats, and the light of another weather at the same
    /// time.
    fn light(self, shot: &OwnedShot) -> Option<FalseLight> {
        let on = |effect: &str| expected::is_on(&shot.weather, effect);
        let says = |model: &str| expected::says(&shot.weather, shot.time, "light", "model", model);
        let mut other = shot.weather.clone();
        let mut without = |change: &str| {
            other.set_text(change).unwrap();
            Some(other.clone())
        };
        let (other, factor): (Option<Weather>, LightFactor) = match self {
            Self::Sky if says("clear") => {
                (None, |alpha, [own, _], _| if alpha < 0.5 { 1.1 * own } else { own })
            }
            Self::Shadows if shot.subject == ShotSubject::Place && says("overcast") => {
                (without("light=off"), |_, [own, other], _| 0.7 * own + 0.3 * other)
            }
            Self::Glow if on("fog") && says("night") && shot.camera.width > 100 => {
                (None, |_, [own, _], _| 1.1 * own)
            }
            // The lens of these pictures is as long as the lamp is far.
            Self::Far if on("fog") && says("night") && shot.camera.width == shot.camera.height => {
                (None, |_, [own, _], camera| own * (1.0 + 0.1 * (camera.fx * 0.02 / 3.0) / 50.0))
            }
            Self::Reflectance if on("flood") && shot.camera.width == 64 => (None, |_, [own, _], _| 1.1 * own),
            Self::Flash if on("lightning") => {
                (without("lightning=off"), |_, [own, other], _| other + 1.1 * (own - other))
            }
            _ => return None,
        };
        Some(FalseLight { other, factor })
    }

    /// The splats of a lit target that are set up in place of others.
    fn falsify_target(self, splats: &mut Splats, up: DVec3) {
        if self != Self::Upright {
            return;
        }
        for index in 0..splats.len() {
            let turn = quat::to_matrix(splats.quats[index].map(f64::from));
            let normal = DVec3::from_array(turn.map(|row| row[2]));
            if normal.dot(up).abs() < 0.1 {
                let stride = splats.sh_stride();
                for value in &mut splats.sh[index * stride..index * stride + 3] {
                    let shown = srgb_decode(0.5 + sh::C0 * f64::from(*value));
                    *value = sh::dc_of(srgb_encode(1.1 * shown)) as f32;
                }
            }
        }
    }

    /// The instruments that this is about.
    fn is_for(self, instrument: &str) -> bool {
        match self {
            Self::Shelter => instrument == "stake",
            Self::Upright => instrument == "lux",
            // Shadows that are seen from elsewhere are shadows.
            Self::Jitter => instrument != "shadows",
            // What only states show.
            Self::Rained | Self::Melt | Self::Puddles => instrument == "water-budget",
            Self::Ranges => matches!(instrument, "lidar-board" | "lidar-air"),
            Self::Echoes => instrument == "lidar-board",
            Self::WetEchoes => instrument == "lidar-road",
            Self::Points => matches!(instrument, "lidar-drops" | "lidar-road"),
            // A film darkens for a lidar whatever the pores.
            Self::Darkening => instrument != "lidar-road",
            // A lidar sees drops as they are, at any pace and without a shutter: one of these is
            // enough.
            Self::Pace | Self::Speed | Self::Exposure => instrument != "lidar-drops",
            _ => true,
        }
    }
}

/// The light of a pixel by its coverage, its own light and another weather's, and the camera.
type LightFactor = fn(f64, [f64; 2], &Camera) -> f64;

/// A change of a picture's light, in another weather's.
struct FalseLight {
    other: Option<Weather>,
    factor: LightFactor,
}

/// A rig with a fault, that remembers what it was asked for.
struct FaultyRig {
    field: PlaceRenderer,
    fault: Fault,
    shots: Vec<OwnedShot>,
}

impl InstrumentRenderer for FaultyRig {
    fn site(&self) -> Site {
        self.field.site()
    }

    fn views(&mut self) -> Result<[Camera; 2]> {
        self.field.views()
    }

    fn set_up(&mut self, splats: Splats) -> Result<ShotSubject> {
        self.field.set_up(splats)
    }

    fn set_up_lit(&mut self, splats: Splats, lamps: Vec<Lamp>) -> Result<ShotSubject> {
        let mut splats = splats;
        self.fault.falsify_target(&mut splats, DVec3::from_array(self.site().up));
        self.field.set_up_lit(splats, lamps)
    }

    fn shadows(&mut self) -> Result<ShadowReport> {
        // It is half as fine as the demo's street.
        Ok(match self.field.shadows()? {
            ShadowReport::Split { sun, .. } => ShadowReport::Split { sun, is_photographed: true },
            other => other,
        })
    }

    fn water(&mut self, subject: ShotSubject, weather: &Weather, time: f64) -> Result<Option<WaterState>> {
        let camera = Street::views()[0].camera((8, 8)).unwrap();
        let requested = OwnedShot { subject, camera, weather: weather.clone(), time };
        let drawn = self.fault.falsified(self.shots.len(), &requested);
        self.shots.push(requested);
        let mut state = self.field.water(subject, &drawn.weather, time)?;
        if let (Fault::Puddles, Some(state)) = (self.fault, &mut state) {
            for (level, ground) in state.level.iter_mut().zip(&state.ground) {
                *level = ground + 1.1 * (*level - ground);
            }
        }
        Ok(state)
    }

    fn clear_away(&mut self) {
        self.field.clear_away();
    }

    fn scan(&mut self, scan: &InstrumentScan<'_>) -> Result<LidarSweep> {
        let InstrumentScan { subject, weather, time, motion, .. } = *scan;
        let requested = OwnedShot { subject, camera: motion.camera(0.0), weather: weather.clone(), time };
        let drawn = self.fault.falsified(self.shots.len(), &requested);
        self.shots.push(requested);
        let mut sweep =
            self.field.scan(&InstrumentScan { weather: &drawn.weather, time: drawn.time, ..*scan })?;
        match self.fault {
            Fault::Ranges => sweep.points.iter_mut().for_each(|point| point.range *= 1.1),
            Fault::Echoes => sweep.points.iter_mut().for_each(|point| point.intensity *= 1.1),
            Fault::WetEchoes if expected::is_on(weather, "wetness") => {
                sweep.points.iter_mut().for_each(|point| point.intensity *= 1.1);
            }
            Fault::Points => {
                let mut number = 0;
                sweep.points.retain(|_| {
                    number += 1;
                    number % 10 != 0
                });
            }
            _ => {}
        }
        Ok(sweep)
    }

    fn draw(
        &mut self,
        subject: ShotSubject,
        request: &FrameRequest<'_>,
        picture: &mut Picture,
    ) -> Result<()> {
        let FrameRequest { camera: FrameCamera::Pinhole(moving), weather, time, .. } = *request else {
            panic!("instruments use pinholes");
        };
        let requested = OwnedShot { subject, camera: moving.camera, weather: weather.clone(), time };
        let drawn = self.fault.falsified(self.shots.len(), &requested);
        self.shots.push(requested);
        let (camera, weather, time) = (&drawn.camera, &drawn.weather, drawn.time);
        let drawn_request = FrameRequest { camera: camera.into(), weather, time, ..*request };
        self.field.draw(subject, &drawn_request, picture)?;
        if let Some(FalseLight { other, factor }) = self.fault.light(&drawn) {
            let mut beside = picture.frame.clone();
            if let Some(weather) = &other {
                let mut second = Picture::default();
                self.field.draw(subject, &FrameRequest { weather, ..drawn_request }, &mut second)?;
                beside = second.frame;
            }
            for (at, value) in picture.frame.rgb.iter_mut().enumerate() {
                let lights = [*value, beside.rgb[at]].map(|v| srgb_decode(f64::from(v)));
                *value = srgb_encode(factor(f64::from(picture.frame.alpha[at / 3]), lights, camera)) as f32;
            }
        }
        Ok(())
    }
}

/// Returns a rig on one thread: several work side by side.
fn rig(scene: Scene) -> FaultyRig {
    let config = CpuConfig { threads: Some(1), ..CpuConfig::default() };
    let mut renderer = Renderer::new(&Device::Cpu, config, |_| {}).unwrap();
    let place = renderer.load(scene).unwrap();
    let camera = Street::views()[0].camera((240, 160)).unwrap();
    let field = PlaceRenderer::new(renderer, place, camera);
    FaultyRig { field, fault: Fault::None, shots: Vec::new() }
}

/// Returns the readings of an instrument on a rig with a fault, and the pictures that it asked for.
fn read(rig: &mut FaultyRig, fault: Fault, instrument: &Instrument) -> (Finding, Vec<OwnedShot>) {
    rig.fault = fault;
    let mut all = Finding::default();
    for weather in &weathers(instrument.name) {
        assert!((instrument.applies)(weather, 0.0), "{}", instrument.name);
        let request = MeasureRequest { weather, time: 0.0, setting: "test" };
        let finding = instrument.read(rig, &request).unwrap();
        assert!(!finding.readings.is_empty(), "{}", instrument.name);
        all.readings.extend(finding.readings);
        rig.clear_away();
    }
    (all, std::mem::take(&mut rig.shots))
}

/// Faults that an instrument finds without being expected to, and those that it does not find.
fn mistakes(rig: &mut FaultyRig, instrument: &Instrument) -> Vec<String> {
    let (own, shots) = read(rig, Fault::None, instrument);
    let mut wrong = Vec::new();
    for (fault, finds) in FINDS {
        // Quantities that this instrument must find wrong; "" for any.
        let own_finds = || {
            let finds = finds.split("; ").map(|find| find.split_once(": ").unwrap_or((find, "")));
            finds.filter(|find| find.0 == instrument.name).map(|find| find.1)
        };
        let mut missed: Vec<&str> = own_finds().collect();
        let changes = |k: usize| {
            matches!(
                fault,
                Fault::Upright
                    | Fault::Puddles
                    | Fault::Ranges
                    | Fault::Echoes
                    | Fault::WetEchoes
                    | Fault::Points
            ) || fault.light(&shots[k]).is_some()
                || fault.falsified(k, &shots[k]) != shots[k]
        };
        let is_touched = fault.is_for(instrument.name) && (0..shots.len()).any(changes);
        let finding = if is_touched { read(rig, fault, instrument).0 } else { own.clone() };
        for reading in finding.readings.iter().filter(|reading| !reading.passes()) {
            println!("{fault:?}: {} finds {reading:?}", instrument.name);
            let expected = own_finds().find(|part| reading.quantity.contains(part));
            if expected.is_none() {
                wrong.push(format!("{fault:?} is no error of {}: {reading:?}", instrument.name));
            }
            missed.retain(|part| Some(*part) != expected);
        }
        wrong.extend(
            missed.iter().map(|part| format!("{fault:?} is not found by {}: {part}", instrument.name)),
        );
    }
    wrong
}

#[test]
fn each_instrument_finds_its_own_error_and_no_other() {
    for find in FINDS.iter().flat_map(|(_, finds)| finds.split("; ")).filter(|find| !find.is_empty()) {
        let name = find.split_once(": ").map_or(find, |find| find.0);
        assert!(INSTRUMENTS.iter().any(|instrument| instrument.name == name), "no instrument {name}");
    }
    let scene = Street::builtin().sampling(0.5).scene(&|_| true).unwrap();
    let queue = Mutex::new(INSTRUMENTS.iter().filter(|instrument| instrument.name != "controls"));
    let work = || {
        let mut rig = rig(scene.clone());
        let next = || queue.lock().unwrap().next();
        std::iter::from_fn(next).flat_map(|instrument| mistakes(&mut rig, instrument)).collect::<Vec<_>>()
    };
    let wrong: Vec<String> = std::thread::scope(|scope| {
        let count = std::thread::available_parallelism().map_or(1, usize::from).min(8);
        let workers: Vec<_> = (0..count).map(|_| scope.spawn(work)).collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap()).collect()
    });
    assert!(wrong.is_empty(), "{wrong:#?}");
}
