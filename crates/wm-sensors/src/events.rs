//! Event cameras: pixels that tell when the logarithm of their light has changed by a threshold.
//!
//! Between two pictures the logarithm is a straight line. A pixel keeps a reference; where the line
//! is a threshold above or below it, an event is told and the reference follows. Thresholds differ
//! from pixel to pixel, a pixel is blind for a while after an event, and some events come from no
//! light at all.
//!
//! A slice of time is the same if it is made alone: at its start each reference is the nearest of
//! the pixel's own levels, a threshold apart. So slices one after the other differ from one long
//! recording by at most one event per pixel and slice.
//!
//! Source: the model and its numbers are those of ESIM (Rebecq et al., CoRL 2018) and v2e (Hu et
//! al., CVPRW 2021).

use crate::error::SensorError;
use hdf5_writer::{DatasetBuilder, Hdf5Builder, Hdf5Writer, WriteOptions};
use rayon::prelude::*;
use std::io::Cursor;
use std::path::Path;
use wm_base::files::write_atomically;
use wm_base::npy;
use wm_base::random::{RandomSequence, RandomStream, bits};
use wm_base::{FormatError, Problem};

/// The light below which a pixel is dark, as a share of white: what its dark current adds.
const DARK_LIGHT: f32 = 1e-3;
/// The least threshold of a pixel: a smaller one would tell of nothing but noise.
const MIN_THRESHOLD: f64 = 0.01;
/// Events of one pixel between two pictures, at most: a lamp that is switched on tells some 35.
const MAX_STEP_EVENTS: u32 = 1000;
/// Purposes of random numbers, see [`RandomStream`]: thresholds, levels and noise.
const RANDOM_PURPOSES: [u64; 3] = [0x4556_5400, 0x4556_5401, 0x4556_5402];

/// The pixels of an event camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EventModel {
    /// Change of the logarithm of light that is an event, 0.01 to 10.
    pub threshold: f64,
    /// Standard deviation of the thresholds of the pixels, a share of `threshold`, 0 to 0.5.
    pub mismatch: f64,
    /// The time for which a pixel is blind after an event, s, 0 to 1.
    pub refractory: f64,
    /// Events without a change of light, a second and pixel, 0 to 1000.
    pub noise: f64,
}

impl Default for EventModel {
    /// A DAVIS in usual light, as v2e has it.
    fn default() -> Self {
        Self { threshold: 0.2, mismatch: 0.03, refractory: 5e-4, noise: 0.1 }
    }
}

impl EventModel {
    /// Checks the ranges of its numbers.
    ///
    /// # Errors
    /// The number that is out of its range, and what is expected.
    pub fn check(&self) -> Result<(), String> {
        let ranges = [
            ("threshold", self.threshold, MIN_THRESHOLD, 10.0),
            ("mismatch", self.mismatch, 0.0, 0.5),
            ("refractory", self.refractory, 0.0, 1.0),
            ("noise", self.noise, 0.0, 1000.0),
        ];
        match ranges.into_iter().find(|(_, value, low, high)| !(*low..=*high).contains(value)) {
            Some((name, value, low, high)) => Err(format!("{name} is {value}: it must be {low} to {high}")),
            None => Ok(()),
        }
    }
}

/// An event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Event {
    /// Time after the start of the slice, microseconds.
    pub time: u32,
    /// Row, px from the top.
    pub y: u16,
    /// Column, px from the left.
    pub x: u16,
    /// True if the light grew.
    pub is_brighter: bool,
}

/// The events of a slice of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EventSlice {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// The start of the slice, s.
    pub start: f64,
    /// Events in the order of time, then rows, then columns.
    pub events: Vec<Event>,
}

/// A pixel while a slice is made.
#[derive(Clone, Copy)]
struct Pixel {
    light: f64,
    reference: f64,
    thresholds: [f64; 2],
    blind_until: f64,
}

/// Makes the events of a slice from pictures one after the other.
pub struct EventSampler {
    model: EventModel,
    size: [u32; 2],
    pixels: Vec<Pixel>,
    stream: RandomStream,
    time: f64,
    events: Vec<Event>,
}

impl EventSampler {
    /// Begins a slice with the light at its start, `[H, W]`, a share of white in linear light.
    /// `seed` decides on the thresholds, and with `index`, the number of the slice, on noise.
    ///
    /// # Panics
    /// If `light` is not of this size, px.
    #[must_use]
    pub fn new(model: EventModel, size: [u32; 2], light: &[f32], seed: u64, index: u32) -> Self {
        assert_eq!(light.len(), size[0] as usize * size[1] as usize, "a picture of {size:?} px");
        let [thresholds, levels, noise] = RANDOM_PURPOSES;
        let (thresholds, levels) =
            (RandomStream::new(seed, thresholds, 0), RandomStream::new(seed, levels, 0));
        let pixel = |(at, light): (usize, &f32)| {
            let [on, off, _] = thresholds.normal3(at as u64);
            let thresholds = [on, off]
                .map(|normal| (model.threshold * (1.0 + model.mismatch * normal)).max(MIN_THRESHOLD));
            let light = logarithm(*light);
            let offset = model.threshold * levels.uniform(at as u64);
            let reference = offset + model.threshold * ((light - offset) / model.threshold).round();
            Pixel { light, reference, thresholds, blind_until: 0.0 }
        };
        let pixels = light.par_iter().enumerate().map(pixel).collect();
        let stream = RandomStream::new(seed, noise, index);
        Self { model, size, pixels, stream, time: 0.0, events: Vec::new() }
    }

    /// Goes on to a picture at `time` after the start of the slice, s.
    ///
    /// # Panics
    /// If `light` is not of the size of the first, or `time` is not after the last.
    pub fn advance(&mut self, time: f64, light: &[f32]) {
        assert!(light.len() == self.pixels.len() && time > self.time, "pictures in the order of time");
        let (from, width, model) = (self.time, self.size[0] as usize, self.model);
        let row = |(y, (pixels, light)): (usize, (&mut [Pixel], &[f32]))| {
            let mut events = Vec::new();
            for (x, (pixel, light)) in pixels.iter_mut().zip(light).enumerate() {
                let mut tell = |at: f64, is_brighter: bool| {
                    let time = (at * 1e6).round() as u32;
                    events.push(Event { time, y: y as u16, x: x as u16, is_brighter });
                };
                pixel.follow(logarithm(*light), [from, time], model.refractory, &mut tell);
            }
            events
        };
        let rows = self.pixels.par_chunks_mut(width).zip(light.par_chunks(width)).enumerate().map(row);
        let rows: Vec<Vec<Event>> = rows.collect();
        self.events.extend(rows.into_iter().flatten());
        self.time = time;
    }

    /// Ends the slice, which began at `start`, s.
    #[must_use]
    pub fn finish(mut self, start: f64) -> EventSlice {
        let [width, height] = self.size;
        let (rate, span, seed) = (self.model.noise, self.time, self.stream.seed());
        // A Poisson process per pixel: the gaps between its events are exponential.
        let noise = |at: u64| {
            let mut draws = RandomSequence::new(bits(seed, at));
            let mut seconds = 0.0;
            std::iter::from_fn(move || {
                seconds -= f64::ln_1p(-draws.uniform()) / rate;
                let (y, x) = ((at / u64::from(width)) as u16, (at % u64::from(width)) as u16);
                (seconds < span).then(|| Event {
                    time: (seconds * 1e6) as u32,
                    y,
                    x,
                    is_brighter: draws.uniform() < 0.5,
                })
            })
        };
        if rate > 0.0 {
            self.events.par_extend((0..self.pixels.len() as u64).into_par_iter().flat_map_iter(noise));
        }
        self.events.par_sort_unstable();
        EventSlice { width, height, start, events: self.events }
    }
}

fn logarithm(light: f32) -> f64 {
    f64::from((light.max(0.0) + DARK_LIGHT).ln())
}

impl Pixel {
    /// Follows a straight line to `light` over a span of time, s.
    fn follow(&mut self, light: f64, [from, to]: [f64; 2], refractory: f64, tell: &mut dyn FnMut(f64, bool)) {
        let (start, change) = (self.light, light - self.light);
        self.light = light;
        let is_brighter = change > 0.0;
        let step = if is_brighter { self.thresholds[0] } else { -self.thresholds[1] };
        for _ in 0..MAX_STEP_EVENTS {
            let level = self.reference + step;
            if change == 0.0 || (light - level) * change.signum() < 0.0 {
                return;
            }
            self.reference = level;
            let at = from + ((level - start) / change).clamp(0.0, 1.0) * (to - from);
            if at >= self.blind_until {
                self.blind_until = at + refractory;
                tell(at, is_brighter);
            }
        }
        self.reference = light;
    }
}

impl EventSlice {
    /// Writes the events: `.npy` is a table of `t` (microseconds since time 0), `x`, `y` and `p` (1
    /// brighter, 0 darker); `.h5` has the same as columns of `events`, with `ms_to_idx` and
    /// `t_offset`, as the data set DSEC.
    ///
    /// # Errors
    /// [`SensorError`] if the file cannot be written or its name has another ending.
    pub fn save(&self, path: &Path) -> Result<(), SensorError> {
        let bytes = match path.extension().and_then(|ending| ending.to_str()) {
            Some("npy") => self.to_npy(),
            Some("h5") => self.to_hdf5().map_err(|error| {
                FormatError::whole(path, Problem::Value(format!("cannot be written as HDF5: {error}")))
            })?,
            _ => {
                let formats = "events are written to names that end in .npy or .h5";
                return Err(SensorError::Extension { path: path.into(), formats });
            }
        };
        Ok(write_atomically(path, |out| Ok(out.write_all(&bytes)?))?)
    }

    /// The start of the slice in microseconds.
    fn offset(&self) -> i64 {
        (self.start * 1e6).round() as i64
    }

    fn to_npy(&self) -> Vec<u8> {
        let fields = "[('t', '<i8'), ('x', '<u2'), ('y', '<u2'), ('p', 'u1')]";
        let mut bytes = npy::header(fields, &[self.events.len()]);
        for event in &self.events {
            bytes.extend((self.offset() + i64::from(event.time)).to_le_bytes());
            bytes.extend(event.x.to_le_bytes());
            bytes.extend(event.y.to_le_bytes());
            bytes.push(u8::from(event.is_brighter));
        }
        bytes
    }

    fn to_hdf5(&self) -> Result<Vec<u8>, hdf5_writer::Error> {
        let count = self.events.len() as u64;
        let times: Vec<u32> = self.events.iter().map(|event| event.time).collect();
        let columns = |of: fn(&Event) -> u16| self.events.iter().map(of).collect::<Vec<u16>>();
        let signs: Vec<u8> = self.events.iter().map(|event| u8::from(event.is_brighter)).collect();
        let last = times.last().map_or(0, |time| time / 1000 + 1);
        let index: Vec<u64> =
            (0..=last).map(|ms| times.partition_point(|time| *time < 1000 * ms) as u64).collect();
        let plan = Hdf5Builder::new()
            .dataset(DatasetBuilder::typed_data("events/t", [count], &times)?)
            .dataset(DatasetBuilder::typed_data("events/x", [count], &columns(|event| event.x))?)
            .dataset(DatasetBuilder::typed_data("events/y", [count], &columns(|event| event.y))?)
            .dataset(DatasetBuilder::typed_data("events/p", [count], &signs)?)
            .dataset(DatasetBuilder::typed_data("ms_to_idx", [index.len() as u64], &index)?)
            .dataset(DatasetBuilder::typed_data("t_offset", [], &[self.offset()])?)
            .into_plan()?;
        Ok(Hdf5Writer::new(Cursor::new(Vec::new()), WriteOptions::default()).finish(plan)?.into_inner())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EVEN: EventModel = EventModel { threshold: 0.25, mismatch: 0.0, refractory: 0.0, noise: 0.0 };

    fn light(logarithm: f64) -> f32 {
        (logarithm.exp() - f64::from(DARK_LIGHT)) as f32
    }

    /// A ramp of the logarithm tells one event a threshold, at even times; and back as many.
    #[test]
    fn a_ramp_tells_one_event_a_threshold() {
        let mut made = EventSampler::new(EVEN, [1, 1], &[light(-2.0)], 7, 0);
        made.advance(0.1, &[light(0.0)]);
        made.advance(0.2, &[light(-2.0)]);
        let slice = made.finish(3.0);
        let of = |is_brighter| -> Vec<&Event> {
            slice.events.iter().filter(|event| event.is_brighter == is_brighter).collect()
        };
        let [up, down] = [true, false].map(of);
        assert!((7..=8).contains(&up.len()) && down.len().abs_diff(up.len()) <= 1, "{slice:?}");
        for pair in up.windows(2) {
            assert!((pair[1].time - pair[0].time).abs_diff(12_500) <= 2, "{slice:?}");
        }
        assert!(
            up.iter().all(|event| event.time <= 100_000) && down.iter().all(|event| event.time >= 100_000)
        );
    }

    /// A threshold a tenth larger tells a tenth fewer events: as many as fit, but for half a one on
    /// average, since references begin at the nearest level.
    #[test]
    fn thresholds_are_what_they_say() {
        let count = |threshold: f64| {
            let model = EventModel { threshold, ..EVEN };
            let size = [64, 64];
            let mut made = EventSampler::new(model, size, &[light(-5.0); 4096], 1, 0);
            made.advance(1.0, &[light(0.0); 4096]);
            made.finish(0.0).events.len() as f64 / 4096.0
        };
        for threshold in [0.1, 0.2, 0.22] {
            let (seen, want) = (count(threshold), 5.0 / threshold - 0.5);
            // Five standard errors: pixels have one of two counts.
            assert!((seen - want).abs() < 0.04, "{threshold}: {seen}, not {want}");
        }
    }

    #[test]
    fn blindness_noise_and_slices_are_as_stated() {
        let model = EventModel { refractory: 0.05, ..EVEN };
        let mut made = EventSampler::new(model, [1, 1], &[light(-3.0)], 1, 0);
        made.advance(0.1, &[light(0.0)]);
        assert!(made.finish(0.0).events.len() <= 3);
        let noisy = |noise: f64, index: u32| {
            let model = EventModel { noise, mismatch: 0.1, ..EVEN };
            let mut made = EventSampler::new(model, [100, 100], &[0.5; 10_000], 1, index);
            made.advance(0.1, &[0.5; 10_000]);
            made.finish(0.0)
        };
        // Five standard deviations of Poisson counts; at the most a pixel has a hundred.
        for (noise, want) in [(0.0, 0.0), (2.0, 2000.0), (1000.0, 1_000_000.0)] {
            let slice = noisy(noise, 0);
            let (seen, brighter) =
                (slice.events.len() as f64, slice.events.iter().filter(|event| event.is_brighter).count());
            assert!((seen - want).abs() <= 5.0 * f64::sqrt(want), "{seen} {want}");
            assert!((2.0 * brighter as f64 - want).abs() <= 10.0 * f64::sqrt(want), "{brighter} of {want}");
            // As many in each half of the slice.
            let early = slice.events.iter().filter(|event| event.time < 50_000).count();
            assert!((2.0 * early as f64 - want).abs() <= 10.0 * f64::sqrt(want), "{early} of {want}");
        }
        // The counts of pixels spread as Poisson's: their variance is their mean.
        let mut counts = vec![0.0; 10_000];
        noisy(20.0, 0).events.iter().for_each(|e| counts[100 * usize::from(e.y) + usize::from(e.x)] += 1.0);
        let variance = counts.iter().map(|count: &f64| (count - 2.0).powi(2)).sum::<f64>() / 10_000.0;
        assert!((variance - 2.0).abs() < 0.15, "{variance}");
        assert!(noisy(2.0, 0) == noisy(2.0, 0) && noisy(2.0, 0) != noisy(2.0, 1));
        assert!(noisy(2.0, 3).events.is_sorted());
    }

    #[test]
    fn files_hold_every_event() {
        let folder = tempfile::tempdir().unwrap();
        let event = |time, x| Event { time, y: 2, x, is_brighter: x == 1 };
        let slice =
            EventSlice { width: 4, height: 3, start: 2.5, events: vec![event(10, 1), event(2000, 3)] };
        slice.save(&folder.path().join("a.npy")).unwrap();
        let bytes = std::fs::read(folder.path().join("a.npy")).unwrap();
        let rows = &bytes[bytes.len() - 26..];
        assert_eq!(rows[..8], 2_500_010i64.to_le_bytes());
        assert_eq!(rows[8..13], [1, 0, 2, 0, 1]);
        assert!(bytes.len() % 64 == 26 && String::from_utf8_lossy(&bytes).contains("('p', 'u1')]"));
        slice.save(&folder.path().join("a.h5")).unwrap();
        let bytes = std::fs::read(folder.path().join("a.h5")).unwrap();
        assert!(bytes.starts_with(b"\x89HDF\r\n\x1a\n"));
        // Times, columns, rows, signs and the offset, little-endian, each as an array of its own.
        let holds = |part: &[u8]| bytes.windows(part.len()).any(|window| window == part);
        assert!(holds(&[10u32, 2000].map(u32::to_le_bytes).concat()));
        assert!(holds(&[1, 0, 3, 0]) && holds(&[2, 0, 2, 0]) && holds(&2_500_000i64.to_le_bytes()));
        assert!(holds(&[0u64, 1, 1, 2].map(u64::to_le_bytes).concat()), "ms_to_idx");
        let error = slice.save(Path::new("a.raw")).unwrap_err().to_string();
        assert_eq!(error, "a.raw: events are written to names that end in .npy or .h5");
    }
}
