//! Cells of the ground: a place is cut into as many as there are blocks, and each photo joins the
//! blocks that it shows.
//!
//! The cells are leaves of a tree of cuts across the longer side, each at the median of the photos,
//! so that blocks have about equal numbers of photos. A photo lies where the median of the points
//! that it shows does. Cells at the rim have no outer border, so every splat lies in one cell.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Extension of the reach of a block beyond its cell, as a fraction of the cell's size.
const REACH_MARGIN: f64 = 0.2;
/// The least share of a photo's points in the reach of a block that the photo joins.
const MIN_COVERED_SHARE: f64 = 0.25;
/// The least such share for a photo that was taken in the cell.
const MIN_COVERED_SHARE_INSIDE: f64 = 0.05;
/// Photos of a block that should show each point of its cell, if there are so many.
const PHOTOS_PER_POINT: u32 = 3;
/// Fewest points that an additional photo must contribute, and the least fraction of its own
/// points.
const MIN_ADDED_POINTS: (usize, f64) = (10, 0.02);
/// Fewest photos of a block.
pub(crate) const MIN_PHOTOS: usize = 3;

/// Axes of the ground: two along it, and up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct GroundAxes {
    /// The first axis along the ground, world axes, length 1: the direction in which the photos
    /// reach farthest.
    pub(crate) x: [f64; 3],
    /// The second axis along the ground, world axes, length 1.
    pub(crate) y: [f64; 3],
}

impl GroundAxes {
    /// Returns the axes of a ground with this up, the first along the direction in which `points`
    /// reach farthest.
    pub(crate) fn of(up: DVec3, points: &[DVec3]) -> Self {
        let (mut x, mut y) = up.any_orthonormal_pair();
        let mean = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for point in points {
            let (a, b) = ((*point - mean).dot(x), (*point - mean).dot(y));
            (xx, xy, yy) = (xx + a * a, xy + a * b, yy + b * b);
        }
        let (sin, cos) = (0.5 * (2.0 * xy).atan2(xx - yy)).sin_cos();
        (x, y) = (x * cos + y * sin, y * cos - x * sin);
        // The sign of the axis is chosen along the world's axis.
        let forward = |axis: DVec3| axis * axis.to_array()[largest(axis)].signum();
        Self { x: forward(x).to_array(), y: forward(y).to_array() }
    }

    /// Returns the place of a point on the ground.
    pub(crate) fn place(&self, point: DVec3) -> DVec2 {
        DVec2::new(point.dot(DVec3::from_array(self.x)), point.dot(DVec3::from_array(self.y)))
    }
}

fn largest(axis: DVec3) -> usize {
    let sizes = axis.abs().to_array();
    (0..3).max_by(|a, b| sizes[*a].total_cmp(&sizes[*b]).then(b.cmp(a))).unwrap_or(0)
}

/// A rectangle of the ground along its axes; `None` where it has no border.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct GroundCell {
    /// Least coordinates; they belong to it.
    pub(crate) low: [Option<f64>; 2],
    /// Greatest coordinates; they belong to the next cell.
    pub(crate) high: [Option<f64>; 2],
}

impl GroundCell {
    /// Returns true if a place lies in the cell.
    pub(crate) fn holds(&self, place: DVec2) -> bool {
        let place = place.to_array();
        (0..2).all(|axis| {
            self.low[axis].is_none_or(|low| place[axis] >= low)
                && self.high[axis].is_none_or(|high| place[axis] < high)
        })
    }

    /// Returns the cell with its borders moved outwards by a share of its size; sides without a
    /// border are as far as the `places`.
    fn grown(&self, places: &[DVec2]) -> Self {
        let mut grown = *self;
        for axis in 0..2 {
            let along = || places.iter().map(|place| place.to_array()[axis]);
            let low = self.low[axis].unwrap_or_else(|| along().fold(f64::INFINITY, f64::min));
            let high = self.high[axis].unwrap_or_else(|| along().fold(f64::NEG_INFINITY, f64::max));
            let margin = REACH_MARGIN * (high - low).max(0.0);
            grown.low[axis] = self.low[axis].map(|low| low - margin);
            grown.high[axis] = self.high[axis].map(|high| high + margin);
        }
        grown
    }
}

/// Cuts the ground into `count` cells with about equal numbers of `places`, each with its reach.
pub(crate) fn cells(places: &[DVec2], count: usize) -> Vec<(GroundCell, GroundCell)> {
    let mut cells = Vec::with_capacity(count);
    let all = (0..places.len()).collect();
    cut(places, all, GroundCell::default(), count, &mut cells);
    cells.into_iter().map(|cell| (cell, cell.grown(places))).collect()
}

fn cut(places: &[DVec2], mut own: Vec<usize>, cell: GroundCell, count: usize, cells: &mut Vec<GroundCell>) {
    let first = count / 2;
    let at = own.len() * first / count.max(1);
    if first == 0 || at == 0 {
        cells.push(cell);
        return;
    }
    let size = |axis: usize| {
        let along = own.iter().map(|index| places[*index].to_array()[axis]);
        let (low, high) = along
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        high - low
    };
    let axis = usize::from(size(1) > size(0));
    let along = |index: usize| places[index].to_array()[axis];
    own.sort_by(|a, b| along(*a).total_cmp(&along(*b)).then(a.cmp(b)));
    let border = (along(own[at - 1]) + along(own[at])) / 2.0;
    let (mut low, mut high) = (cell, cell);
    (low.high[axis], high.low[axis]) = (Some(border), Some(border));
    let rest = own.split_off(at);
    cut(places, own, low, first, cells);
    cut(places, rest, high, count - first, cells);
}

/// A photo on the ground.
#[derive(Clone, Debug)]
pub(crate) struct PlacedPhoto<'a> {
    /// The median place of the points that the photo shows.
    pub(crate) place: DVec2,
    /// Indices of the points that the photo shows.
    pub(crate) seen: &'a [u32],
}

/// Returns the photos, as indices, that join a block: those of whose points its reach holds enough,
/// and others as long as they show points of its core that too few of those show. `in_core` and
/// `in_reach` say of each point whether it is there.
pub(crate) fn joining(
    photos: &[PlacedPhoto<'_>],
    core: &GroundCell,
    in_core: &[bool],
    in_reach: &[bool],
) -> Vec<usize> {
    let count =
        |photo: &PlacedPhoto<'_>, of: &[bool]| photo.seen.iter().filter(|point| of[**point as usize]).count();
    let joins = |photo: &PlacedPhoto<'_>| {
        let (share, is_inside) =
            (count(photo, in_reach) as f64 / photo.seen.len() as f64, core.holds(photo.place));
        match photo.seen.is_empty() {
            true => is_inside,
            false => share >= if is_inside { MIN_COVERED_SHARE_INSIDE } else { MIN_COVERED_SHARE },
        }
    };
    let (mut joined, mut others): (Vec<usize>, Vec<usize>) =
        (0..photos.len()).partition(|index| joins(&photos[*index]));
    // Every visible point of the core must be in some photo of the block.
    let mut shown = vec![0u32; in_core.len()];
    let show = |shown: &mut Vec<u32>, photo: usize| {
        photos[photo].seen.iter().for_each(|point| shown[*point as usize] += 1);
    };
    joined.iter().for_each(|photo| show(&mut shown, *photo));
    others.sort_by_key(|photo| (usize::MAX - count(&photos[*photo], in_core), *photo));
    let rest = others.into_iter().filter(|photo| {
        let seen = photos[*photo].seen;
        let is_short = |point: &&u32| in_core[**point as usize] && shown[**point as usize] < PHOTOS_PER_POINT;
        let adds = seen.iter().filter(is_short).count();
        let is_worth = adds >= MIN_ADDED_POINTS.0 && adds as f64 >= MIN_ADDED_POINTS.1 * seen.len() as f64;
        if is_worth {
            show(&mut shown, *photo);
            joined.push(*photo);
        }
        !is_worth
    });
    let rest: Vec<usize> = rest.collect();
    let missing = MIN_PHOTOS.saturating_sub(joined.len());
    joined.extend(rest.into_iter().take(missing));
    joined.sort_unstable();
    joined
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(count: usize) -> Vec<DVec2> {
        // Three times as long as wide.
        (0..count).map(|i| DVec2::new((i * 7 % count) as f64 * 3.0, (i * 11 % count) as f64)).collect()
    }

    #[test]
    fn every_place_is_in_one_cell_and_cells_are_balanced() {
        let places = places(60);
        for count in [1, 2, 3, 5, 8] {
            let cells = cells(&places, count);
            assert_eq!(cells.len(), count);
            let mut own = vec![0; count];
            for place in places.iter().chain(&[DVec2::splat(-1e9), DVec2::new(1e9, -1e9)]) {
                let in_core: Vec<usize> = (0..count).filter(|cell| cells[*cell].0.holds(*place)).collect();
                assert_eq!(in_core.len(), 1, "{place} {cells:?}");
                assert!(cells[in_core[0]].1.holds(*place));
                own[in_core[0]] += 1;
            }
            let (least, most) = (own.iter().min().unwrap(), own.iter().max().unwrap());
            assert!(most - least <= 3, "{own:?}");
        }
        // The first cut is across the longer side, and the reach goes a fifth of the cell beyond.
        let [(core, reach), _] = cells(&places, 2)[..] else { panic!() };
        let border = core.high[0].unwrap();
        assert!(core.low == [None; 2] && core.high[1].is_none());
        assert!((reach.high[0].unwrap() - border - REACH_MARGIN * border).abs() < 1e-9);
    }

    #[test]
    fn the_first_axis_lies_along_a_street() {
        let along = DVec3::new(-3.0, 1.0, 0.0).normalize();
        let points: Vec<DVec3> = (0..20).map(|i| along * f64::from(i) + DVec3::X).collect();
        let axes = GroundAxes::of(DVec3::Z, &points);
        assert!((DVec3::from_array(axes.x) + along).length() < 1e-9, "{axes:?}");
        assert!(DVec3::from_array(axes.y).dot(DVec3::Z).abs() < 1e-12);
    }

    /// Ten photos in a row, each of the 30 points about it; what only photos from afar show is
    /// learnt too.
    #[test]
    fn photos_join_what_they_show() {
        let mut seen: Vec<Vec<u32>> = (0..10).map(|photo| (photo * 10..photo * 10 + 30).collect()).collect();
        // The last photo shows the beginning from afar, where few others look.
        seen[9].extend(0..12);
        let place = |photo: usize| DVec2::new(photo as f64 * 10.0 + 15.0, 0.0);
        let photos: Vec<PlacedPhoto<'_>> =
            seen.iter().enumerate().map(|(i, seen)| PlacedPhoto { place: place(i), seen }).collect();
        let places: Vec<DVec2> = (0..10).map(place).collect();
        let [(core, reach), (other, _)] = cells(&places, 2)[..] else { panic!() };
        let holds = |cell: &GroundCell| -> Vec<bool> {
            (0..120).map(|point| cell.holds(DVec2::new(f64::from(point), 0.0))).collect()
        };
        let own = joining(&photos, &core, &holds(&core), &holds(&reach));
        // The border is at 60 and the reach ends at 69: photo 6 shows 9 of 30 points in it, photo 7
        // none.
        assert_eq!(own, [0, 1, 2, 3, 4, 5, 6, 9]);
        let none: Vec<PlacedPhoto<'_>> =
            (0..10).map(|i| PlacedPhoto { place: place(i), seen: &[] }).collect();
        assert_eq!(joining(&none, &other, &[], &[]), [5, 6, 7, 8, 9]);
    }
}
