//! Movers: people, cars and other things that were somewhere else when the next photo was taken.
//!
//! Movers are found before a training, without a network, by disagreement between photos. Stereo
//! finds the depth of static surfaces only: movers have no match in other photos. Stereo depth,
//! interpolated over the gaps, is therefore that of the scene behind the movers. With it each
//! pixel of a photo is projected into the others. Where several of these see the same surface and
//! agree on its colour, but the photo does not, the photo shows a mover. A pixel is static if
//! stereo found matches of its colour nearby. Differences that change sign within a few pixels are
//! misregistered texture.
//!
//! The depth of a training that is half done would not do: it has ghosts of the movers in it, and
//! the residuals of the training are larger on leaves than on cars. Masks are a function of photos
//! and priors, so a training that is resumed makes them again.
//!
//! - [`view`]: photos at the size of the search, with the filled depth and what misregistration may
//!   do to colours.
//! - [`consensus`]: the verdict on each pixel.
//! - [`shape`]: masks from verdicts.
//! - [`sheet`]: the picture of the masks.

pub(crate) mod consensus;
pub(crate) mod shape;
pub(crate) mod sheet;
#[cfg(test)]
mod tests;
pub(crate) mod view;

pub(crate) use view::MoverView;

use crate::photos::level_for;
use consensus::{Judge, PixelVerdict};
use rayon::prelude::*;
use wm_scene::Camera;

/// Most pixels of a photo in the search; sides are halved until it has no more.
const MAX_PIXELS: u32 = 100_000;
/// Shortest side of a photo that is still halved, px.
const MIN_HALVED_SIDE_PX: u32 = 128;
/// Fewest photos for a search.
const MIN_PHOTOS: usize = 5;
/// Rounds; from the second on, movers that were found are no evidence about other photos.
const ROUND_COUNT: usize = 3;
/// Least share of known stereo depth in the median photo: interpolation over larger gaps is
/// unreliable.
const MIN_MEDIAN_KNOWN: f32 = 0.12;
/// Least ratio of a photo's known stereo depth to that of the median photo, for the photo to be
/// judged.
const MIN_KNOWN_RATIO: f32 = 0.4;
/// Least share of pixels with a verdict, for masks to be used.
const MIN_JUDGED_SHARE: f64 = 0.25;
/// Range of the share of moving pixels: below it masks are likely errors, above it they are wrong.
const MIN_MOVING_SHARE: f64 = 0.0075;
const MAX_MOVING_SHARE: f64 = 0.4;

/// The pixels of a photo that show movers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct MoverMask {
    /// Width, px; the mask is over the whole photo, which may be larger.
    pub(crate) width: u32,
    /// Height, px.
    pub(crate) height: u32,
    /// True where there are movers, `[H, W]`; empty if there are none.
    pub(crate) moves: Vec<bool>,
}

impl MoverMask {
    /// Returns true if no pixel shows a mover.
    pub(crate) fn is_empty(&self) -> bool {
        !self.moves.contains(&true)
    }

    /// Returns the indices of the pixels that show movers, in a photo of this size.
    pub(crate) fn pixels(&self, width: u32, height: u32) -> Vec<usize> {
        if self.is_empty() {
            return Vec::new();
        }
        let place = |at: u32, pixels: u32, of: u32| {
            ((2 * u64::from(at) + 1) * u64::from(of) / (2 * u64::from(pixels))) as usize
        };
        let columns: Vec<usize> = (0..width).map(|x| place(x, width, self.width)).collect();
        let mut found = Vec::new();
        for y in 0..height {
            let row = &self.moves[place(y, height, self.height) * self.width as usize..];
            let first = y as usize * width as usize;
            found.extend((first..).zip(&columns).filter(|(_, x)| row[**x]).map(|(pixel, _)| pixel));
        }
        found
    }
}

/// The conclusion of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MoverOutcome {
    /// There are movers.
    Found {
        /// Photos that show some.
        photos: usize,
        /// Share of the pixels of all photos.
        share: f64,
    },
    /// There are none.
    None,
    /// Too few pixels are seen by several photos: this share.
    TooFewJudged(f64),
    /// An implausibly large share was found: this one.
    TooMany(f64),
}

/// Returns how often the sides of photos are halved for the search.
pub(crate) fn level(cameras: &[Camera]) -> u8 {
    level_for(cameras, MAX_PIXELS, MIN_HALVED_SIDE_PX)
}

/// Searches photos for movers; returns a mask for each where there are some, else no mask.
///
/// The result does not depend on the number of threads.
pub(crate) fn find(views: &[MoverView]) -> (MoverOutcome, Vec<MoverMask>) {
    if views.len() < MIN_PHOTOS {
        return (MoverOutcome::TooFewJudged(0.0), Vec::new());
    }
    let mut known: Vec<f32> = views.iter().map(|view| view.known).collect();
    known.sort_by(f32::total_cmp);
    let median = known[known.len() / 2];
    if median < MIN_MEDIAN_KNOWN {
        return (MoverOutcome::TooFewJudged(f64::from(median)), Vec::new());
    }
    let least = MIN_KNOWN_RATIO * median;
    let pixels: usize = views.iter().map(|view| view.matched.len()).sum();
    let share = |count: usize| count as f64 / pixels.max(1) as f64;
    let judge = Judge::new(views);
    let (mut masks, mut judged) = (vec![Vec::new(); views.len()], 0.0);
    for _ in 0..ROUND_COUNT {
        let found: Vec<(Vec<bool>, usize)> = (views.par_iter().enumerate())
            .map(|(index, view)| {
                if view.known < least || view.known == 0.0 {
                    return (Vec::new(), 0);
                }
                let verdicts = judge.photo(index, &masks);
                let judged = verdicts.iter().filter(|verdict| **verdict != PixelVerdict::Unknown).count();
                (shape::mask(&verdicts, view), judged)
            })
            .collect();
        judged = share(found.iter().map(|(_, judged)| judged).sum());
        masks = found.into_iter().map(|(mask, _)| mask).collect();
    }
    let mask = |view: &MoverView, moves: Vec<bool>| {
        let (width, height) = (view.camera.width, view.camera.height);
        MoverMask { width, height, moves }
    };
    let masks: Vec<MoverMask> = views.iter().zip(masks).map(|(view, moves)| mask(view, moves)).collect();
    let moving = share(masks.iter().flat_map(|mask| &mask.moves).filter(|moves| **moves).count());
    let outcome = match () {
        () if judged < MIN_JUDGED_SHARE => MoverOutcome::TooFewJudged(judged),
        () if moving > MAX_MOVING_SHARE => MoverOutcome::TooMany(moving),
        () if moving <= MIN_MOVING_SHARE => MoverOutcome::None,
        () => {
            let photos = masks.iter().filter(|mask| !mask.is_empty()).count();
            return (MoverOutcome::Found { photos, share: moving }, masks);
        }
    };
    (outcome, Vec::new())
}
