//! Rain gauge and disdrometer: how much water falls, in drops of which sizes and speeds.
//!
//! Both look through slabs of air ([`super::drops`]). Water through a level plane is the sum over
//! drops of volume times fall speed, over the air that was looked at. Of flakes the volume is that
//! of their water, by the density of Fabry and Szyrmer.
//!
//! Two lenses: a close one for what is small and many, one of half its scale for what is large and
//! rare, which carries the water. They take pictures until the rate's standard error, by how far
//! pictures are apart, is 1.2 %; the next pictures are those of the lens that tells least.
//!
//! Tolerance 5 %. What touches in a picture is parted by its peaks: left together, drops are 3 %
//! too much, since volumes grow faster than areas, and small flakes pass for large ones, which the
//! close lens counts already. The slab's thickness makes 5 % of a diameter uncertain at most,
//! without a bias above 0.5 % of the sum. Flakes are drawn a hundredth as opaque as they are: their
//! three arms lie over each other, and what one hides of another is 5 % of the water at a tenth, 1
//! % at a hundredth. Speeds: Brandes' formula, which the program goes by, is within 4 % of the
//! measurements.

use super::blobs::BlobSplit;
use super::drops::{AirSlab, DropSample, MeasuredDrop, SlabView};
use super::expected::{FallLaw, effect, falling};
use super::plot::{Axis, Series};
use super::{Bench, Instrument, Tolerance, expected, mean, median};
use std::ops::Range;
use wm_place::Result;
use wm_weather::particles::{ParticleShape, PrecipitationKind, RAIN};

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "gauge",
    title: "Rain gauge and disdrometer",
    about: "A probe camera looks through slabs of air of known volume, 10 m away, with a shutter of 10 us: through a close lens at what is \
            small, through a wide one at what is large and rare. What a drop hides is its \
            area and so its diameter and its water; where it is a moment later is its speed. Gauge: the sum of water times speed over the \
            volume of air; of snow with the water that a flake of its width holds. Disdrometer: by how much drops above 0.7 mm are wider than that in the mean, \
            against the spectrum of Marshall and Palmer; and in classes of a quarter of a millimetre speed over what Gunn and Kinzer measured, \
            of which the class that is farthest off counts.",
    applies: |weather, time| falling(weather, time).iter().any(|(kind, _)| FallLaw::of(kind).is_some()),
    measure,
    sweep: &[
        "rain.rate=1",
        "rain.rate=2.5",
        "rain.rate=10",
        "rain.rate=25",
        "rain.rate=50",
        "rain.rate=10, wind.speed=6",
        "snowfall.rate=0.5",
        "snowfall.rate=1",
        "snowfall.rate=2",
        "snowfall.rate=3",
        "snowfall.rate=5",
    ],
};

/// Standard error of a rate at which pictures are enough, as a share.
const TARGET_STANDARD_ERROR: f64 = 0.012;
/// Pictures that a lens takes at once, and most of both.
const PICTURES_PER_ROUND: usize = 9;
const MAX_PICTURES: usize = 300;
/// Drops in front of a pixel of board, so that few touch.
const DROPS_PER_PIXEL: f64 = 9e-4;
/// Opacity of flakes in the pictures.
const FLAKE_OPACITY: f64 = 0.01;
/// Least diameters of the two lenses, mm: drops are drawn whole (0.3 px and more), and flakes by
/// themselves in the wide lens (1.25 px).
const MIN_DROP_MM: f64 = 0.5;
const MIN_FLAKE_MM: [f64; 2] = [0.25, 5.0];
/// Faster than any drop falls, m/s.
const MAX_FALL_SPEED_M_S: f64 = 12.0;
/// Diameter from which the close lens sees flakes by themselves, mm: fewer stand for all that are
/// smaller.
const MIN_SINGLE_FLAKE_MM: f64 = 2.5;
/// Index of the first place of the wide lens.
const WIDE_LENS_FIRST_PLACE: usize = 8 * 64;
/// The fields that all slabs share.
const SLAB: AirSlab = AirSlab {
    size: 960,
    depth: 10.0,
    thickness: 0.0,
    scale: 0.0,
    margin: [0.0; 2],
    apart: 0.0,
    fastest: 0.0,
    pairs: 3,
    split: BlobSplit::Peaks,
};

/// A look at the drops of some diameters, and what is seen of them.
struct Lens {
    look: SlabView,
    /// mm.
    diameters: Range<f64>,
    caught: DropSample,
}

impl Lens {
    /// The close one and the wide one.
    fn both(bench: &Bench<'_>, kind: &PrecipitationKind, law: &FallLaw, rate: f64) -> Result<[Self; 2]> {
        let wind = bench.number("wind", "speed").unwrap_or(0.0);
        let weather = bench.with(&format!("{}.exposure=0.00001", effect(kind)))?;
        let (opacity, [least, large], close) = match kind.shape {
            ParticleShape::Ball => {
                // Of what is larger than drops the whole slab is as much larger: the smallest are
                // 0.375 px wide.
                let least = kind.seen(kind.diameters[0]);
                let larger = least / MIN_DROP_MM;
                let fastest = MAX_FALL_SPEED_M_S.max(1.1 * (law.speed)(kind.seen(kind.diameters[1])));
                let slab = AirSlab {
                    scale: 750.0 / larger,
                    depth: SLAB.depth * larger,
                    thickness: larger,
                    margin: [12.0 + 2.0 * wind, 30.0],
                    apart: 0.002 * (larger * MAX_FALL_SPEED_M_S / fastest),
                    fastest,
                    ..SLAB
                };
                (1.0, [least, 2.0 * least], slab)
            }
            ParticleShape::Flake => {
                let margin = [24.0 + 8.0 * wind, 40.0];
                (
                    FLAKE_OPACITY,
                    MIN_FLAKE_MM,
                    AirSlab { scale: 600.0, thickness: 0.6, margin, apart: 0.01, fastest: 3.0, ..SLAB },
                )
            }
        };
        let lens = |least: f64, diameters: Range<f64>, wider: f64, first: usize| -> Result<Self> {
            let scale = close.scale / wider;
            // Those that are a little smaller are there, too, drawn in part.
            let most = DROPS_PER_PIXEL * scale * scale / (law.density)(rate, 0.85 * least);
            let thickness = most.clamp(0.1, close.thickness);
            // Between two pictures drops go the same way in pixels.
            let slab = AirSlab { scale, thickness, apart: close.apart * wider, ..close };
            let look = SlabView::new(&weather, bench.time, kind, slab, opacity)?.beginning_at(first);
            Ok(Self { look, diameters, caught: DropSample::default() })
        };
        Ok([lens(least, 0.0..large, 1.0, 0)?, lens(large, large..f64::INFINITY, 2.0, WIDE_LENS_FIRST_PLACE)?])
    }

    fn take(&mut self, bench: &mut Bench<'_>) -> Result<()> {
        self.look.take(bench, PICTURES_PER_ROUND, &mut self.caught)
    }

    fn drops(&self) -> impl Iterator<Item = &MeasuredDrop> {
        self.caught.drops.iter().filter(|drop| self.diameters.contains(&drop.diameter))
    }

    /// Water through a level plane, mm/h, and its variance by what the pictures are apart.
    fn flux(&self, law: &FallLaw) -> [f64; 2] {
        let (mut tracked, mut speed) = (0.0, 0.0);
        for MeasuredDrop { diameter, velocity, .. } in self.drops() {
            if let Some([_, down]) = velocity {
                let own = (law.water)(*diameter);
                tracked += own;
                speed += own * down;
            }
        }
        // Those of which there is no second picture fall like the others. mm^3 a m^2 and second are
        // 3.6e-3 mm/h.
        let fall = if tracked > 0.0 { 3.6e-3 * speed / tracked } else { 0.0 };
        let count = self.caught.pictures as f64;
        let mut fluxes = vec![0.0; self.caught.pictures];
        for drop in self.drops() {
            fluxes[drop.picture] += fall * (law.water)(drop.diameter) * count / self.caught.volume;
        }
        let flux = mean(fluxes.iter().copied());
        let squares: f64 = fluxes.iter().map(|own| (own - flux).powi(2)).sum();
        [flux, squares / (count * (count - 1.0))]
    }
}

/// Looks until the rate is told well enough; gives it with its standard error, mm/h.
fn look(bench: &mut Bench<'_>, law: &FallLaw, lenses: &mut [Lens; 2]) -> Result<[f64; 2]> {
    for lens in lenses.iter_mut() {
        lens.take(bench)?;
    }
    loop {
        let fluxes = lenses.each_ref().map(|lens| lens.flux(law));
        let [rate, variance] = [0, 1].map(|k| fluxes[0][k] + fluxes[1][k]);
        let pictures = lenses.each_ref().map(|lens| lens.caught.pictures);
        if variance.sqrt() <= TARGET_STANDARD_ERROR * rate || pictures[0] + pictures[1] >= MAX_PICTURES {
            return Ok([rate, variance.sqrt()]);
        }
        // What another picture would take of the variance.
        let [close, wide] = [0, 1].map(|k| fluxes[k][1] / pictures[k] as f64);
        lenses[usize::from(wide > close)].take(bench)?;
    }
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    for (kind, rate) in falling(bench.weather, bench.time) {
        let Some(law) = FallLaw::of(kind) else { continue };
        let mut lenses = Lens::both(bench, kind, law, rate)?;
        let [measured, error] = look(bench, law, &mut lenses)?;
        let five = Tolerance::Relative(0.05);
        let told = bench.add(format!("{} rate", kind.name), "mm/h", [rate, measured], five);
        told.standard_error = Some(error);
        let speeds = classes(kind, law, &lenses);
        let farthest =
            speeds.iter().map(|class| class[2]).max_by(|a, b| (a - 1.0).abs().total_cmp(&(b - 1.0).abs()));
        let quantity = format!("fall speed over {}, farthest of {} sizes", law.speed_law[0], speeds.len());
        if *kind == RAIN {
            // Of an exponential spectrum the same beyond any diameter.
            let wanted = 1.0 / expected::rain_slope(rate);
            bench.add("mean diameter beyond 0.7 mm", "mm", [wanted, beyond(&lenses)], five);
            plot_sizes(bench, rate, &lenses);
        }
        bench.add(quantity, "", [1.0, farthest.unwrap_or(f64::NAN)], five);
        plot_speeds(bench, law, &speeds);
        for (lens, what) in lenses.iter_mut().zip(["close", "wide"]) {
            let (count, volume, scale) = (lens.drops().count(), lens.caught.volume, lens.look.slab.scale);
            if let Some(mut shown) = lens.caught.shown.take() {
                shown.caption = format!(
                    "a part of a slab in the {what} lens, {scale} px to a metre; {count} caught in {volume:.0} m\u{b3} of air"
                );
                bench.show_picture(shown);
            }
        }
    }
    Ok(())
}

/// By how much drops above [`MIN_SPEED_DROP_MM`] are wider than that in the mean, mm.
fn beyond(lenses: &[Lens; 2]) -> f64 {
    let mut sums = [0.0; 2];
    for lens in lenses {
        for drop in lens.drops().filter(|drop| drop.diameter > MIN_SPEED_DROP_MM) {
            sums[0] += (drop.diameter - MIN_SPEED_DROP_MM) / lens.caught.volume;
            sums[1] += 1.0 / lens.caught.volume;
        }
    }
    sums[0] / sums[1]
}

/// Drops that sizes are told from, mm, and the width of a class of speeds.
const MIN_SPEED_DROP_MM: f64 = 0.7;
const SPEED_CLASS_WIDTH: f64 = 0.25;
/// Drops that make a class.
const MIN_CLASS_DROPS: usize = 40;
/// Farther than this from the median of its class a speed is that of two drops taken for one, as a
/// share.
const MAX_SPEED_DEVIATION: f64 = 0.4;

/// Classes of diameter that have enough members: mean diameter, mm, mean speed, m/s, and that over
/// the mean by the law.
fn classes(kind: &PrecipitationKind, law: &FallLaw, lenses: &[Lens; 2]) -> Vec<[f64; 3]> {
    // Of what is larger than drops the classes are as much wider.
    let (first, width) = match kind.shape {
        ParticleShape::Ball => {
            let least = kind.seen(kind.diameters[0]);
            (least, SPEED_CLASS_WIDTH * least / MIN_DROP_MM)
        }
        ParticleShape::Flake => (MIN_SINGLE_FLAKE_MM, SPEED_CLASS_WIDTH),
    };
    let mut classes: Vec<Vec<[f64; 2]>> = vec![Vec::new(); 48];
    for MeasuredDrop { diameter, velocity, .. } in lenses.iter().flat_map(Lens::drops) {
        let class = ((diameter - first) / width).floor();
        if let (Some([_, down]), 0.0..48.0) = (velocity, class) {
            classes[class as usize].push([*diameter, *down]);
        }
    }
    for class in &mut classes {
        let middle = median(class.iter().map(|p| p[1]).collect());
        class.retain(|p| (p[1] / middle - 1.0).abs() < MAX_SPEED_DEVIATION);
    }
    let full = classes.iter().filter(|class| class.len() >= MIN_CLASS_DROPS);
    let means = full.map(|class| {
        let of = |value: &dyn Fn(&[f64; 2]) -> f64| mean(class.iter().map(value));
        [of(&|p| p[0]), of(&|p| p[1]), of(&|p| p[1]) / of(&|p| (law.speed)(p[0]))]
    });
    means.collect()
}

fn curve(most: f64, f: impl Fn(f64) -> f64) -> Vec<[f64; 2]> {
    (5..=60).map(|k| f64::from(k) / 60.0 * most).map(|d| [d, f(d)]).collect()
}

fn plot_speeds(bench: &mut Bench<'_>, law: &FallLaw, classes: &[[f64; 3]]) {
    let most = classes.iter().map(|class| 1.1 * class[0]).fold(6.0, f64::max);
    bench.plot(
        "Fall speed",
        "diameter, mm",
        "fall speed, m/s",
        vec![
            Series::line(law.speed_law[1], curve(most, law.speed)),
            Series::points(
                "measured, means of classes",
                classes.iter().map(|class| [class[0], class[1]]).collect(),
            ),
        ],
    );
}

fn plot_sizes(bench: &mut Bench<'_>, rate: f64, lenses: &[Lens; 2]) {
    let slope = expected::rain_slope(rate);
    let mut numbers = [(0usize, 0.0); 24];
    for lens in lenses {
        for drop in lens.drops() {
            let class = (((drop.diameter - 0.5) / SPEED_CLASS_WIDTH).floor().max(0.0) as usize).min(23);
            numbers[class].0 += 1;
            numbers[class].1 += 1.0 / lens.caught.volume / SPEED_CLASS_WIDTH;
        }
    }
    let full = numbers.iter().enumerate().filter(|(_, (count, _))| *count > 3);
    let numbers = full.map(|(k, (_, number))| [0.5 + SPEED_CLASS_WIDTH * (k as f64 + 0.5), *number]);
    let spectrum = curve(6.0, |d| 8000.0 * (-slope * d).exp()).into_iter().filter(|p| p[1] > 0.05);
    bench.plot(
        "Sizes",
        "diameter, mm",
        Axis::log("drops a m\u{b3} and mm"),
        vec![
            Series::line("Marshall and Palmer 1948", spectrum.collect()),
            Series::points("measured", numbers.collect()),
        ],
    );
}
