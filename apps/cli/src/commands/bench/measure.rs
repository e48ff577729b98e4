//! Cases of the benchmark, measured in turns.

use crate::interrupt;
use crate::memory::bytes_of;
use crate::progress;
use anyhow::{Result, ensure};
use std::time::Instant;
use weather_magician::frame::FrameInputs;
use weather_magician::{Camera, FrameRequest, Picture, PreparedPlace, Renderer, Weather};
use wm_render::{Geometry, MedianDepth, Outputs, RenderConfig, SetId, SetView, Stats};
use wm_weather::cover::CoverRequest;
use wm_weather::paper::PaperCover;
use wm_weather::{PreparedWeather, Site};

/// Number of warm-up rounds, in which memory is first touched and clocks rise.
pub(crate) const WARM_UP: u32 = 2;

/// The error of a measurement that was stopped.
pub(crate) const INCOMPLETE: &str = "the measurement is not complete";

/// Cases that are only in the paper's table.
const PAPER_FOG: &str = "rgb, fog, paper";
const PAPER_COVER: &str = "rgb, snow cover, paper";

/// A case of the benchmark: outputs and a weather.
pub(crate) struct BenchCase {
    /// The outputs and the weather.
    pub(crate) name: &'static str,
    /// The weather.
    pub(crate) weather: Weather,
    config: RenderConfig,
    sky: PreparedWeather,
}

impl BenchCase {
    /// Returns every case: outputs under a clear sky, weathers with colour alone, and everything at
    /// once.
    pub(crate) fn all(site: &Site, config: impl Fn(Outputs) -> RenderConfig) -> Result<Vec<Self>> {
        use Geometry::{Depth, DepthNormal, None};
        use MedianDepth::{Off, On};
        let mut cases: Vec<Self> = [
            ("rgb", None, Off, "clear"),
            ("rgb+depth", Depth, Off, "clear"),
            ("rgb+depth+normal", DepthNormal, Off, "clear"),
            ("rgb+depth+normal+median", DepthNormal, On, "clear"),
            ("rgb, fog", None, Off, "fog"),
            ("rgb, haze", None, Off, "haze"),
            ("rgb, smog", None, Off, "smog"),
            ("rgb+depth+normal, fog", DepthNormal, Off, "fog"),
        ]
        .into_iter()
        .map(|(name, geometry, median_depth, weather)| {
            let weather = Weather::find(weather)?;
            let sky = weather.at(0.0).prepare(site);
            let outputs = Outputs { geometry, median_depth, ..Outputs::default() };
            Ok(Self { name, weather, config: config(outputs), sky })
        })
        .collect::<Result<_>>()?;
        for (name, preset, sets) in [
            ("rgb, rain 25 mm/h", "clear", &["rain.rate=25"][..]),
            // A cloudburst of about 100,000 drops in view, which are drawn farther than usual.
            ("rgb, rain, more drops", "clear", &["rain.rate=60", "rain.size=1.3"]),
            ("rgb, snow 2.5 mm/h", "clear", &["snowfall.rate=2.5"]),
            ("rgb, rain, paper, k = 4", "clear", &["rain.rate=25", "fidelity=paper"]),
            ("rgb, snow cover 10 cm", "clear", &["snow_cover.depth=0.1"]),
            ("rgb, light of clouds", "clear", &["light.model=overcast"]),
            ("rgb, night, fog, 10 lamps", "clear", &["light.model=night", "light.lamps=on", "fog.mor=200"]),
            ("rgb, wet", "clear", &["wetness.amount=0.7", "wetness.puddles=0"]),
            ("rgb, wet, puddles", "clear", &["wetness.amount=1", "wetness.puddles=0.8"]),
            ("rgb, rain, wet", "clear", &["rain.rate=25", "wetness.amount=0.7", "wetness.puddles=0"]),
            (
                "rgb, rain, wet, splashes",
                "clear",
                &["rain.rate=25", "wetness.amount=0.7", "wetness.puddles=0", "splash=on"],
            ),
            ("rgb, flood 0.3 m", "clear", &["flood.level=0.3", "wind.speed=4"]),
            ("rgb, flood, rain 8 mm/h", "clear", &["flood.level=0.3", "wind.speed=4", "rain.rate=8"]),
            // Drops of a windscreen alone, to compare with "rgb", and in the rain of "rgb, rain 25
            // mm/h", to compare with that.
            ("rgb, lens", "clear", &["lens.distance=0.2", "lens.aperture=1.5", "lens.rate=15"]),
            (
                "rgb, rain, lens",
                "clear",
                &["lens.distance=0.2", "lens.aperture=1.5", "lens.rate=15", "rain.rate=25"],
            ),
            (PAPER_FOG, "fog", &["fidelity=paper"]),
            (PAPER_COVER, "clear", &["snow_cover=on", "fidelity=paper"]),
        ] {
            let mut weather = Weather::find(preset)?;
            sets.iter().try_for_each(|set| weather.set_text(set))?;
            let sky = weather.at(1.0).prepare(site);
            cases.push(Self { name, weather, config: config(Outputs::default()), sky });
        }
        Ok(cases)
    }

    /// Returns the first case, and those whose name contains one of `texts`.
    ///
    /// # Errors
    /// If one of them is in no name.
    pub(crate) fn named(mut cases: Vec<Self>, texts: &[String]) -> Result<Vec<Self>> {
        let names: Vec<&str> = cases.iter().map(|case| case.name).collect();
        for text in texts {
            ensure!(
                names.iter().any(|name| name.contains(text)),
                "no case is named like {text:?}: there are {}",
                names.join("; ")
            );
        }
        let first = cases[0].name;
        cases.retain(|case| case.name == first || texts.iter().any(|text| case.name.contains(text)));
        Ok(cases)
    }

    /// Returns true if the case is only measured for the paper's table.
    pub(crate) fn is_of_table(&self) -> bool {
        [PAPER_FOG, PAPER_COVER].contains(&self.name)
    }

    /// The cover of the paper that the weather has, if any.
    pub(crate) fn paper_cover(&self) -> Option<&PaperCover> {
        self.sky.paper_cover.as_ref()
    }

    /// The covers that the weather needs.
    pub(crate) fn cover(&self) -> &[CoverRequest] {
        self.sky.cover()
    }

    /// Returns true if the weather needs more of the place than its splats: its light, or a thinned
    /// copy for drops on the lens and for water.
    pub(crate) fn needs_place(&self) -> bool {
        let sky = &self.sky;
        sky.light().is_some() || sky.wetness().is_some() || sky.glass().is_some() || sky.flood().is_some()
    }

    /// Returns the index of a case in a list; 0 if it is not in it.
    pub(crate) fn position(cases: &[Self], name: &str) -> usize {
        cases.iter().position(|case| case.name == name).unwrap_or(0)
    }
}

/// Times of one frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameTiming {
    /// Wall-clock time, seconds.
    pub(crate) wall: f64,
    /// CPU time of all threads of the process, seconds; the wall-clock time if the system does not
    /// report it.
    pub(crate) cpu: f64,
    /// Statistics of the renderer.
    pub(crate) stats: Stats,
}

/// Measurements of one case, one per round.
#[derive(Clone, Debug)]
pub(crate) struct Rounds<T>(pub(crate) Vec<T>);

/// The frames of one case.
pub(crate) type FrameTimings = Rounds<FrameTiming>;

impl<T> Default for Rounds<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T> Rounds<T> {
    /// Returns the median over the rounds.
    pub(crate) fn median(&self, of: impl Fn(&T) -> f64) -> f64 {
        median(self.0.iter().map(of).collect())
    }

    /// Returns the least value of all rounds, the one that other load on the machine affects least.
    pub(crate) fn best(&self, of: impl Fn(&T) -> f64) -> f64 {
        self.0.iter().map(of).fold(f64::INFINITY, f64::min)
    }

    /// Returns the median of the ratios to another case in the same rounds.
    pub(crate) fn ratio(&self, to: &Self, of: impl Fn(&T) -> f64) -> f64 {
        median(self.0.iter().zip(&to.0).map(|(a, b)| of(a) / of(b)).collect())
    }
}

/// Returns the median; NaN for an empty list.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => f64::NAN,
        count if count % 2 == 1 => values[middle],
        _ => 0.5 * (values[middle - 1] + values[middle]),
    }
}

/// A renderer with a loaded scene.
pub(crate) enum BenchTarget<'a> {
    /// Splats alone, without shelter.
    Sets {
        /// The renderer.
        renderer: &'a mut Renderer,
        /// The splat sets of the scene and its covers.
        sets: Vec<SetView<'a>>,
    },
    /// A place whose light follows the weather.
    Place {
        /// The renderer.
        renderer: &'a mut Renderer,
        /// The place, with its lamps.
        place: &'a mut PreparedPlace,
    },
}

impl<'a> BenchTarget<'a> {
    /// Returns a scene without covers.
    pub(crate) fn plain(renderer: &'a mut Renderer, set: SetId) -> Self {
        Self::Sets { renderer, sets: vec![SetView::plain(set)] }
    }

    /// Renders the scene in a case.
    fn render(&mut self, case: &BenchCase, camera: &Camera, picture: &mut Picture) -> Result<Stats> {
        match self {
            Self::Sets { renderer, sets } => {
                let inputs = FrameInputs::of_sets(sets, &case.sky, camera, &case.config);
                Ok(renderer.draw(&inputs, picture)?)
            }
            Self::Place { renderer, place } => {
                let request = FrameRequest::new(&case.weather, camera, 1.0);
                Ok(renderer.render_into(place, &request, picture, &mut ())?)
            }
        }
    }
}

/// Renders the cases of `plan` (target, case) in turns; stops early on Ctrl-C. The bar shows the
/// rounds as `what`.
pub(crate) fn turns(
    stands: &mut [BenchTarget<'_>],
    camera: &Camera,
    plan: &[(usize, &BenchCase)],
    rounds: u32,
    what: &'static str,
) -> Result<Vec<FrameTimings>> {
    let bar = progress::bar(u64::from(rounds), what);
    let mut measured = vec![FrameTimings::default(); plan.len()];
    let mut frames = vec![Picture::default(); plan.len()];
    for round in 0..rounds + WARM_UP {
        // The order rotates with the round, so that no case always follows the same other.
        for k in 0..plan.len() {
            let k = (k + round as usize) % plan.len();
            if interrupt::asked() {
                return Ok(measured);
            }
            let (stand, case) = (&mut stands[plan[k].0], plan[k].1);
            let clock = Clock::start();
            let stats = stand.render(case, camera, &mut frames[k])?;
            let Timing { wall, cpu } = clock.stop();
            if round >= WARM_UP {
                measured[k].0.push(FrameTiming { wall, cpu, stats });
            }
        }
        if round >= WARM_UP {
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    Ok(measured)
}

/// Durations, seconds.
#[derive(Clone, Copy)]
pub(crate) struct Timing {
    /// Wall-clock time.
    pub(crate) wall: f64,
    /// CPU time of all threads of the process; the wall-clock time if the system does not report it.
    pub(crate) cpu: f64,
}

/// Measures wall-clock and CPU time from its start.
pub(crate) struct Clock {
    started: Instant,
    cpu: Option<f64>,
}

impl Clock {
    /// Starts a clock.
    pub(crate) fn start() -> Self {
        Self { cpu: cpu_seconds(), started: Instant::now() }
    }

    /// Returns the times since the start.
    pub(crate) fn stop(&self) -> Timing {
        let wall = self.started.elapsed().as_secs_f64();
        let cpu = self.cpu.and_then(|before| Some(cpu_seconds()? - before)).unwrap_or(wall);
        Timing { wall, cpu }
    }
}

/// CPU time of all threads of this process, seconds.
#[cfg(unix)]
fn cpu_seconds() -> Option<f64> {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Some(time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64)
}

/// CPU time of all threads of this process, seconds.
#[cfg(not(unix))]
fn cpu_seconds() -> Option<f64> {
    None
}

/// Returns the peak memory of this process, bytes, if the system reports it.
pub(crate) fn peak_memory() -> Option<u64> {
    bytes_of("/proc/self/status", "VmHWM:")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_taken_round_by_round() {
        let samples = |walls: [f64; 3]| {
            Rounds(walls.map(|wall| FrameTiming { wall, cpu: wall, stats: Stats::default() }).to_vec())
        };
        // The machine was ten times slower in the second round.
        let (a, b) = (samples([1.0, 10.0, 1.1]), samples([2.0, 20.0, 2.2]));
        assert!((b.ratio(&a, |s| s.wall) - 2.0).abs() < 1e-12);
        assert_eq!((a.median(|s| s.wall), a.best(|s| s.wall)), (1.1, 1.0));
    }

    #[test]
    fn cpu_time_and_memory_are_told_on_linux() {
        if cfg!(target_os = "linux") {
            assert!(cpu_seconds().unwrap() > 0.0 && peak_memory().unwrap() > 1 << 20);
        }
    }
}
