//! The selection of frames of a sequence.

use anyhow::{Result, bail};
use std::fmt;
use std::num::NonZeroU32;

/// A range of frames, by their numbers in the whole sequence, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FrameRange {
    /// The first frame.
    first: u32,
    /// The frame after the last; `None` for the end of the sequence.
    end: Option<u32>,
}

impl std::str::FromStr for FrameRange {
    type Err = String;

    /// Parses `300..420` (without 420), `300..=420` or `300..`.
    fn from_str(text: &str) -> Result<Self, String> {
        let form = || format!("`{text}` is not a range of frames: use 300..420, 300..=420 or 300..");
        let number = |part: &str| part.trim().parse::<u32>().map_err(|_| form());
        let (first, rest) = text.split_once("..").ok_or_else(form)?;
        let first = number(first)?;
        let end = match rest.trim().strip_prefix('=') {
            None if rest.trim().is_empty() => return Ok(Self { first, end: None }),
            None => number(rest)?,
            Some(last) => number(last)?.saturating_add(1),
        };
        if end <= first {
            return Err(format!("`{text}` has no frames: the end must be after the first"));
        }
        Ok(Self { first, end: Some(end) })
    }
}

impl fmt::Display for FrameRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}..", self.first)?;
        self.end.map_or(Ok(()), |end| write!(f, "{end}"))
    }
}

/// Returns the numbers of the frames to render, ascending, of a sequence of `all`: every `step`-th
/// frame of `range`.
///
/// # Errors
/// The range is beyond the sequence.
pub(crate) fn wanted(range: Option<FrameRange>, step: NonZeroU32, all: u32) -> Result<Vec<u32>> {
    let range = range.unwrap_or(FrameRange { first: 0, end: None });
    let end = range.end.unwrap_or(all);
    if range.first >= all || end > all {
        bail!("--frames {range}: the sequence has {all} frames, 0..{all}; make it longer with --seconds");
    }
    Ok((range.first..end).step_by(step.get() as usize).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str, step: u32, all: u32) -> Result<Vec<u32>> {
        wanted(Some(text.parse().map_err(anyhow::Error::msg)?), NonZeroU32::new(step).unwrap(), all)
    }

    #[test]
    fn ranges_are_those_of_the_words() {
        assert_eq!(of("3..6", 1, 10).unwrap(), [3, 4, 5]);
        assert_eq!(of("3..=6", 1, 10).unwrap(), [3, 4, 5, 6]);
        assert_eq!(of("7..", 1, 10).unwrap(), [7, 8, 9]);
        assert_eq!(of(" 0 .. 10 ", 4, 10).unwrap(), [0, 4, 8]);
        assert_eq!(of("9..=9", 100, 10).unwrap(), [9]);
        assert_eq!(wanted(None, NonZeroU32::new(3).unwrap(), 7).unwrap(), [0, 3, 6]);
    }

    #[test]
    fn what_is_no_range_is_said() {
        for (text, want) in [
            ("5", "`5` is not a range of frames: use 300..420, 300..=420 or 300.."),
            ("..5", "`..5` is not a range of frames"),
            ("-1..5", "`-1..5` is not a range of frames"),
            ("1..x", "`1..x` is not a range of frames"),
            ("1..=", "`1..=` is not a range of frames"),
            ("1...5", "`1...5` is not a range of frames"),
            ("1..99999999999", "`1..99999999999` is not a range of frames"),
            ("5..5", "`5..5` has no frames: the end must be after the first"),
            ("5..=4", "`5..=4` has no frames"),
            ("6..2", "`6..2` has no frames"),
            ("3..11", "--frames 3..11: the sequence has 10 frames, 0..10; make it longer with --seconds"),
            ("3..=10", "--frames 3..11: the sequence has 10 frames"),
            ("10..", "--frames 10..: the sequence has 10 frames"),
            ("3..=4294967295", "--frames 3..4294967295: the sequence has 10 frames"),
        ] {
            let error = of(text, 1, 10).unwrap_err().to_string();
            assert!(error.starts_with(want), "{text}: {error}");
        }
    }
}
