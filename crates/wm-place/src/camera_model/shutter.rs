//! Shutters: the times at which the lines of a picture see the scene.
//!
//! Line `i` of `n`, counted from the side that is read first, is exposed about the instant
//! `t + (i + 0.5) / n readout` of a frame at `t`, over the exposure time. Time is cut into equal
//! steps; each is one render of the lines that are exposed in it, and a line is the mean, in linear
//! light, of the steps that its exposure overlaps. Steps are so short that the picture moves by
//! [`MAX_SHIFT_PX`] px or less in one.

use crate::lens_view::PictureRect;
use std::ops::Range;
use std::str::FromStr;

/// Maximum shift of the picture per step, px: without and with an exposure time.
const MAX_SHIFT_PX: [f64; 2] = [1.0, 2.0];
/// Maximum number of steps of a readout, and of an exposure time.
const MAX_STEPS: [f64; 2] = [256.0, 48.0];

/// The side of the picture that is read first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ReadoutSide {
    /// The top row.
    #[default]
    Top,
    /// The bottom row.
    Bottom,
    /// The left column.
    Left,
    /// The right column.
    Right,
}

impl FromStr for ReadoutSide {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "top" => Ok(Self::Top),
            "bottom" => Ok(Self::Bottom),
            "left" => Ok(Self::Left),
            "right" => Ok(Self::Right),
            _ => Err(format!("`{text}` is not a side: use top, bottom, left or right")),
        }
    }
}

/// The exposure and the readout of a camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shutter {
    /// Exposure time of a line, s, 0 for an instant: what moves in front of the camera is blurred
    /// over it.
    pub exposure: f64,
    /// Time from the exposure of the first line to that of the last, s, 0 for a global shutter.
    pub readout: f64,
    /// The side that is read first.
    pub first: ReadoutSide,
}

/// Maximum exposure time and readout time, s.
pub(crate) const MAX_DURATION_S: f64 = 1.0;

impl Shutter {
    /// Returns true if a whole picture is of one instant.
    pub(crate) fn is_instant(&self) -> bool {
        self.exposure == 0.0 && self.readout == 0.0
    }

    /// Checks its times.
    ///
    /// # Errors
    /// A line that names the value.
    pub fn check(&self) -> Result<(), String> {
        for (name, value) in [("exposure time", self.exposure), ("readout", self.readout)] {
            if !(0.0..=MAX_DURATION_S).contains(&value) {
                return Err(format!("the {name} is {value} s: it must be from 0 to {MAX_DURATION_S} s"));
            }
        }
        Ok(())
    }

    /// The times of all steps, s after that of the frame.
    pub(super) fn span(&self) -> Range<f64> {
        -0.5 * self.exposure..self.readout + 0.5 * self.exposure
    }

    /// The lines of a picture of a size.
    pub(super) fn lines(&self, size: [u32; 2]) -> u32 {
        match self.first {
            ReadoutSide::Top | ReadoutSide::Bottom => size[1],
            ReadoutSide::Left | ReadoutSide::Right => size[0],
        }
    }

    /// The part of a picture of a size that some of its lines are.
    pub(super) fn rect(&self, size: [u32; 2], lines: &Range<u32>) -> PictureRect {
        let [width, height] = size;
        let count = lines.end - lines.start;
        match self.first {
            ReadoutSide::Top => PictureRect { at: [0, lines.start], size: [width, count] },
            ReadoutSide::Bottom => PictureRect { at: [0, height - lines.end], size: [width, count] },
            ReadoutSide::Left => PictureRect { at: [lines.start, 0], size: [count, height] },
            ReadoutSide::Right => PictureRect { at: [width - lines.end, 0], size: [count, height] },
        }
    }

    /// Cuts the exposure of so many lines into steps, for a picture that moves by `speed` px/s.
    pub(super) fn steps(&self, speed: f64, lines: u32) -> ShutterSteps {
        let span = self.span();
        let [sharp, blurred] = MAX_SHIFT_PX;
        let [reading, exposing] = MAX_STEPS;
        let mut count = 1.0f64;
        if self.readout > 0.0 {
            count = (self.readout * speed / sharp).ceil().clamp(1.0, reading.min(f64::from(lines)));
            count *= (span.end - span.start) / self.readout;
        }
        if self.exposure > 0.0 {
            let own = (self.exposure * speed / blurred).ceil().clamp(1.0, exposing);
            count = count.max(own * (span.end - span.start) / self.exposure);
        }
        let count = count.ceil() as u32;
        ShutterSteps {
            shutter: *self,
            start: span.start,
            length: (span.end - span.start) / f64::from(count),
            count,
            lines,
        }
    }
}

/// The steps of the exposure of one picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShutterSteps {
    shutter: Shutter,
    /// s after the time of the frame.
    start: f64,
    /// Length of a step, s.
    pub(crate) length: f64,
    /// Number of steps.
    pub(crate) count: u32,
    lines: u32,
}

impl ShutterSteps {
    /// The middle of a step, s after the time of the frame.
    pub(crate) fn time(&self, step: u32) -> f64 {
        self.start + (f64::from(step) + 0.5) * self.length
    }

    /// The share of a line's exposure that lies in a step, 0-1.
    pub(crate) fn share(&self, line: u32, step: u32) -> f64 {
        let middle = (f64::from(line) + 0.5) / f64::from(self.lines) * self.shutter.readout;
        // In steps, from the start of this one.
        let at = |time: f64| (time - self.start) / self.length - f64::from(step);
        if self.shutter.exposure == 0.0 {
            return f64::from((at(middle).floor() == 0.0) as u8);
        }
        let half = 0.5 * self.shutter.exposure;
        let overlap = at(middle + half).min(1.0) - at(middle - half).max(0.0);
        (overlap * self.length / self.shutter.exposure).clamp(0.0, 1.0)
    }

    /// The lines of which a share lies in a step.
    pub(crate) fn lines(&self, step: u32) -> Range<u32> {
        // A line may stand on the edge of a step by rounding, so its share decides.
        let is_in = |line: &u32| self.share(*line, step) > 1e-9;
        let first = (0..self.lines).find(is_in).unwrap_or(0);
        let end = (first..self.lines).rev().find(is_in).map_or(first, |last| last + 1);
        first..end
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_of_each_line_add_up() {
        for (exposure, readout, speed) in [
            (0.0, 0.03, 3000.0),
            (0.01, 0.0, 3000.0),
            (0.01, 0.03, 700.0),
            (0.0001, 0.03, 700.0),
            (0.02, 0.001, 90.0),
        ] {
            let shutter = Shutter { exposure, readout, ..Shutter::default() };
            let steps = shutter.steps(speed, 97);
            let mut sums = [0.0; 97];
            let mut middles = [0.0; 97];
            for step in 0..steps.count {
                for line in steps.lines(step) {
                    sums[line as usize] += steps.share(line, step);
                    middles[line as usize] += steps.share(line, step) * steps.time(step);
                }
            }
            for line in 0..97 {
                assert!((sums[line] - 1.0).abs() < 1e-9, "{exposure} {readout} {line}: {}", sums[line]);
                let middle = (line as f64 + 0.5) / 97.0 * readout;
                // A line without an exposure has the time of its step.
                assert!((middles[line] - middle).abs() < 0.51 * steps.length, "{exposure} {readout} {line}");
            }
        }
    }

    #[test]
    fn lines_begin_at_the_side_that_is_read_first() {
        let at = |first: ReadoutSide| {
            let shutter = Shutter { first, readout: 0.01, exposure: 0.0 };
            let rect = shutter.rect([40, 30], &(2..7));
            (rect.at, rect.size, shutter.lines([40, 30]))
        };
        assert_eq!(at(ReadoutSide::Top), ([0, 2], [40, 5], 30));
        assert_eq!(at(ReadoutSide::Bottom), ([0, 23], [40, 5], 30));
        assert_eq!(at(ReadoutSide::Left), ([2, 0], [5, 30], 40));
        assert_eq!(at(ReadoutSide::Right), ([33, 0], [5, 30], 40));
    }
}
