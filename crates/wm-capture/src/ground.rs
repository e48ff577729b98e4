//! The ground under a walk: how high above it the cameras were held, in scene units.
//!
//! A person carries a camera at one height over the ground, so the ground is parallel to the path.
//! What is up comes from three things together, weighted by how well each is known: the pictures'
//! own up, their x axes (people do not roll cameras) and the path itself. Points are then counted
//! by how far below the nearest cameras they lie, so that a street may rise and fall. The ground is
//! the height with the most points under which there are next to none.
//!
//! A row of window sills or the lower edge of what is seen of a wall is such a height too. So a
//! point only counts as ground if it was seen past: lines of sight to things behind it run low over
//! it, which none does through a wall. And where the cameras may have lain on their side (COLMAP
//! keeps photos as they are stored), a wall may be taken for the ground: there is no result where
//! another side is as near.
//!
//! A result is reliable or absent: every limit below is a reason for no result. The method cannot
//! tell a person from a drone that flies level and looks ahead.

use super::Capture;
use glam::{DMat2, DMat3, DVec2, DVec3};
use thiserror::Error;
use wm_base::linear::{horizontals, outer};
use wm_base::statistics::quantile;

/// Height above the ground at which people hold cameras, m: that of the eyes of an adult.
pub const CARRIED_HEIGHT_M: f64 = 1.6;

/// Fewest cameras: a plane through three does not tell how flat the path is.
const MIN_CAMERAS: usize = 5;
/// Largest median pitch up or down, degrees: facades are photographed at some 12 degrees, drones
/// and circles about an object look down more steeply than this.
const MAX_MEDIAN_PITCH_DEG: f64 = 15.0;
/// Largest pitch of nine in ten cameras, degrees.
const MAX_PITCH_DEG: f64 = 30.0;
/// Largest deviation of camera heights among neighbours, in camera heights: arms up and down are
/// within it, cranes and stairs are not.
const MAX_UNEVENNESS: f64 = 0.3;
/// Largest distance of points from the path, in camera heights: a fall of two in a hundred, as
/// yards have for the rain, is an eighth of the height by then; nearer than 3 level pictures may
/// show no ground.
const MAX_ASIDE: f64 = 6.0;
/// Largest error of a point's height from the uncertainty of up, in camera heights.
const MAX_TILT_ERROR: f64 = 0.1;
/// Half thickness of the ground, in camera heights: covers kerbs, cobbles and the error of up. Its
/// middle is then searched in a slab twice as thick.
const SLAB_HALF: f64 = 0.15;
/// Most points below the ground for each point on it: mismatches and mirrors; cellars and quays
/// have more.
const MAX_BELOW_SHARE: f64 = 0.05;
/// Largest distance from the path of points that count as below, in camera heights: beyond its ends
/// the ground may fall.
const MAX_ASIDE_BELOW: f64 = 4.0;
/// Fewest ground points that were seen past; by chance there are a few.
const MIN_POINTS: usize = 20;
/// Least share of the points of the slab that were seen past: near 0 at the foot of a wall, a third
/// and more on streets.
const MIN_CLEAR_SHARE: f64 = 0.15;
/// Least share of the cameras under which such points lie: the ground of a walk is seen all along.
const MIN_CAMERA_SHARE: f64 = 0.25;
/// Largest range of the middle eight in ten of the heights of such points, in camera heights:
/// points at all heights of the slab have 0.48, a cobbled street between its gutters 0.34.
const MAX_HEIGHT_RANGE: f64 = 0.4;
/// Cameras at most this much farther from a point than the nearest one determine its depth
/// together, in camera heights: over a few steps arms up and down even out, and a street that rises
/// is followed.
const SHARED_REACH: f64 = 1.5;
/// Radius of the column under a camera in which nothing lies above the ground, in camera heights:
/// the person stood there.
const COLUMN_RADIUS: f64 = 0.4;
/// Most points in the columns that are taken for passers-by and mismatches.
const MAX_STRAY_POINTS: usize = 3;
/// Least ratio of the distances of another side and of the ground: a nearer side is as likely the
/// ground.
const MIN_SIDE_RATIO: f64 = 2.0;
/// Standard deviation of the mean of the pictures' ups, radians: how much all are pitched alike.
const PITCH_ERROR_RAD: f64 = 0.15;
/// Standard deviation of a picture's x axis from level, radians.
const ROLL_ERROR_RAD: f64 = 0.026;
/// Most cameras that count as independent in roll, and in height: neighbours err alike.
const INDEPENDENT_ROLLS: f64 = 4.0;
const INDEPENDENT_HEIGHTS: f64 = 8.0;
/// Most points, points of the slab, and lines of sight that are sampled.
const MAX_POINTS: usize = 40_000;
const MAX_SLAB_POINTS: usize = 400;
const MAX_LINES: usize = 60_000;

/// The ground that the cameras of a walk stand over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureGround {
    /// The upward normal, world axes, length 1: perpendicular to the path, along slopes too.
    pub up: DVec3,
    /// Mean height of the cameras above it, scene units, above 0.
    pub height: f64,
    /// A point on it, under the middle of the cameras, scene units.
    pub under: DVec3,
    /// Points on it that were seen past.
    pub points: usize,
}

/// The reason why no ground is found.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum CaptureGroundError {
    /// Too few cameras, or all in one place.
    #[error("{0} photos from different places are too few")]
    Few(usize),
    /// It is not known which photo sees which point.
    #[error("the data set does not say which photos see which points")]
    Blind,
    /// The cameras look up or down, degrees, up above 0.
    #[error("the photos were not taken level: their middle looks {} {:.0} degrees", if *.0 > 0.0 { "up" } else { "down" }, .0.abs())]
    Pitched(f64),
    /// The cameras have no up in common, or it is not that of their path.
    #[error("the photos do not tell which way is up")]
    Askew,
    /// No surface that could be the ground.
    #[error("no ground is clearly visible")]
    Unclear,
    /// The cameras' heights differ among neighbours.
    #[error("the photos were taken at too different heights")]
    Uneven,
    /// A surface on another side is as near.
    #[error("a surface to another side of the cameras is as near as the ground, so that it could be that")]
    Sides,
}

/// The pose of a camera; one on its side has `right` and `up` exchanged.
#[derive(Clone, Copy)]
struct Pose {
    center: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
}

/// Points that were seen, and the indices of the camera and the point of each line of sight.
struct SightLines {
    points: Vec<DVec3>,
    lines: Vec<(usize, usize)>,
}

/// Finds the ground under the cameras of a capture.
///
/// # Errors
/// [`CaptureGroundError`] if the evidence is thin, in the words of a half sentence.
pub fn ground(capture: &Capture) -> Result<CaptureGround, CaptureGroundError> {
    let poses: Vec<Pose> = capture
        .views
        .iter()
        .map(|view| {
            let (camera, rotation) = (&view.camera, view.camera.rotation());
            let [right, forward] = [0, 2].map(|row| rotation.row(row));
            Pose { center: camera.center(), right, up: camera.up(), forward }
        })
        .collect();
    let are_finite = poses.iter().all(|p| (p.center + p.right + p.up + p.forward).is_finite());
    if poses.len() < MIN_CAMERAS || !are_finite {
        return Err(CaptureGroundError::Few(poses.len()));
    }
    let seen = SightLines::from_capture(capture);
    if seen.lines.is_empty() {
        return Err(CaptureGroundError::Blind);
    }
    let found = ground_under(&poses, &seen)?;
    let turned = |turn: fn(&Pose) -> Pose| poses.iter().map(turn).collect::<Vec<_>>();
    for side in [
        turned(|p| Pose { right: -p.up, up: p.right, ..*p }),
        turned(|p| Pose { right: p.up, up: -p.right, ..*p }),
        turned(|p| Pose { right: -p.right, up: -p.up, ..*p }),
    ] {
        if ground_under(&side, &seen).is_ok_and(|other| other.height < MIN_SIDE_RATIO * found.height) {
            return Err(CaptureGroundError::Sides);
        }
    }
    Ok(found)
}

impl SightLines {
    /// Points that are finite, thinned out where there are very many, and their lines of sight.
    fn from_capture(capture: &Capture) -> Self {
        let positions = &capture.points.positions;
        let step = positions.len().div_ceil(MAX_POINTS).max(1);
        let (mut points, mut places) = (Vec::new(), vec![None; positions.len()]);
        for (index, position) in positions.iter().enumerate().step_by(step) {
            let point = DVec3::from_array(*position);
            if point.is_finite() {
                places[index] = Some(points.len());
                points.push(point);
            }
        }
        let place = |point: u32| places.get(point as usize).copied().flatten();
        let all = capture
            .observations
            .iter()
            .enumerate()
            .flat_map(|(view, seen)| seen.iter().filter_map(move |one| Some((view, place(one.point)?))));
        let lines: Vec<(usize, usize)> = all.collect();
        let step = lines.len().div_ceil(MAX_LINES).max(1);
        Self { points, lines: lines.into_iter().step_by(step).collect() }
    }
}

/// Finds the ground of cameras that were held upright.
fn ground_under(poses: &[Pose], seen: &SightLines) -> Result<CaptureGround, CaptureGroundError> {
    let (up, tilt) = upright(poses)?;
    let mut pitches: Vec<f64> =
        poses.iter().map(|p| p.forward.dot(up).clamp(-1.0, 1.0).asin().to_degrees()).collect();
    let middle = quantile(&mut pitches, 0.5);
    let mut sizes: Vec<f64> = pitches.iter().map(|pitch| pitch.abs()).collect();
    if middle.abs() > MAX_MEDIAN_PITCH_DEG || quantile(&mut sizes, 0.9) > MAX_PITCH_DEG {
        return Err(CaptureGroundError::Pitched(middle));
    }
    let walk = Walk::of(poses, up);
    let depths = |reach: f64| -> Vec<Depth> {
        seen.points.iter().map(|point| walk.depth(*point, tilt, reach)).collect()
    };
    // How far cameras are taken together is told by the height, which is roughly known without.
    let rough = lowest(&depths(0.0)).ok_or(CaptureGroundError::Unclear)?;
    let depths = depths(SHARED_REACH * rough);
    let candidate = lowest(&depths).ok_or(CaptureGroundError::Unclear)?;
    let mut slab: Vec<usize> = (0..depths.len())
        .filter(|i| depths[*i].counts(candidate) && depths[*i].is_within(2.0 * SLAB_HALF, candidate))
        .collect();
    let step = slab.len().div_ceil(MAX_SLAB_POINTS).max(1);
    slab = slab.into_iter().step_by(step).collect();
    let clear = walk.select_seen_past(&slab, seen, candidate);
    let mut below: Vec<f64> = clear.iter().map(|index| depths[*index].down).collect();
    let height = quantile(&mut below, 0.5);
    let range = quantile(&mut below, 0.9) - quantile(&mut below, 0.1);
    let mut cameras: Vec<usize> = clear.iter().map(|index| depths[*index].camera).collect();
    cameras.sort_unstable();
    cameras.dedup();
    let is_clear = clear.len() >= MIN_POINTS
        && clear.len() as f64 >= MIN_CLEAR_SHARE * slab.len() as f64
        && cameras.len() as f64 >= MIN_CAMERA_SHARE * poses.len() as f64
        && range <= MAX_HEIGHT_RANGE * height;
    let in_column = |low: f64, high: f64| {
        let is_in = |d: &&Depth| {
            d.aside <= COLUMN_RADIUS * height && d.down >= low * height && d.down <= high * height
        };
        depths.iter().filter(is_in).count()
    };
    // Higher than the ground and lower than a hand: what is stood on, if the surface lies deeper
    // than that.
    let is_stood_on =
        in_column(0.1, 0.75) > MAX_STRAY_POINTS + in_column(1.0 - SLAB_HALF, 1.0 + SLAB_HALF) / 5;
    if !is_clear || is_stood_on {
        return Err(CaptureGroundError::Unclear);
    }
    if walk.uneven() > MAX_UNEVENNESS * height {
        return Err(CaptureGroundError::Uneven);
    }
    let center = poses.iter().map(|pose| pose.center).sum::<DVec3>() / poses.len() as f64;
    Ok(CaptureGround { up, height, under: center - up * height, points: clear.len() })
}

/// Up, and the covariance of its error along the axes of [`horizontals`], square radians.
fn upright(poses: &[Pose]) -> Result<(DVec3, DMat2), CaptureGroundError> {
    let count = poses.len() as f64;
    let center = poses.iter().map(|pose| pose.center).sum::<DVec3>() / count;
    let (mut held, mut level, mut path) = (DVec3::ZERO, DMat3::ZERO, DMat3::ZERO);
    for pose in poses {
        held += pose.up / count;
        level += outer(pose.right, INDEPENDENT_ROLLS / count / ROLL_ERROR_RAD.powi(2));
        path += outer(pose.center - center, 1.0);
    }
    let square = path.col(0).x + path.col(1).y + path.col(2).z;
    // Cameras in one place differ by rounding.
    if !(square > 1e-20 * center.length_squared() && square.is_finite()) {
        return Err(CaptureGroundError::Few(1));
    }
    // Cameras that are held every way have no common up.
    if held.length() < 0.5 {
        return Err(CaptureGroundError::Askew);
    }
    let held = held.normalize();
    let (mut up, mut covariance) = (held, DMat2::IDENTITY);
    // How uneven the path is weighs it, and is only known with up: it starts at a twentieth of its
    // size.
    let least = (0.003f64).powi(2) * square / count;
    let mut variance = 0.0025 * square / count;
    for turn in 0..20 {
        if turn > 0 {
            variance = (up.dot(path * up) / (count - 3.0).max(1.0)).max(least);
        }
        let information = level + path * ((INDEPENDENT_HEIGHTS / count).min(1.0) / variance);
        let (x, y) = horizontals(up);
        let prior = 1.0 / PITCH_ERROR_RAD.powi(2);
        let pull = information * up + (up - held) * prior;
        let (xx, xy, yy) =
            (x.dot(information * x) + prior, x.dot(information * y), y.dot(information * y) + prior);
        covariance = DMat2::from_cols(DVec2::new(xx, xy), DVec2::new(xy, yy)).inverse();
        let step = covariance * DVec2::new(x.dot(pull), y.dot(pull));
        up = (up - x * step.x - y * step.y).normalize();
    }
    let is_sound = up.is_finite() && covariance.is_finite() && up.dot(held) > 0.9;
    if is_sound { Ok((up, covariance)) } else { Err(CaptureGroundError::Askew) }
}

/// The position of a point relative to the path.
#[derive(Clone, Copy)]
struct Depth {
    /// Depth below the cameras around it, scene units.
    down: f64,
    /// Horizontal distance to the nearest camera, scene units.
    aside: f64,
    /// Index of that camera.
    camera: usize,
    /// The standard deviation of `down` from the uncertainty of up, scene units.
    error: f64,
}

impl Depth {
    /// Returns true if it is near enough to count when the ground is `height` below the cameras.
    fn counts(&self, height: f64) -> bool {
        self.aside <= MAX_ASIDE * height && self.error <= MAX_TILT_ERROR * height
    }

    /// Returns true if it is on a ground `height` below the cameras, within the share `slab` of
    /// that.
    fn is_within(&self, slab: f64, height: f64) -> bool {
        (self.down - height).abs() <= slab * height
    }
}

/// Height with the most points under which there are next to none; `None` if there are too few.
fn lowest(depths: &[Depth]) -> Option<f64> {
    let mut down: Vec<f64> = depths.iter().map(|d| d.down).filter(|down| *down > 0.0).collect();
    let most = down.iter().copied().fold(0.0, f64::max).min(1e3 * quantile(&mut down, 0.5));
    if down.len() < MIN_POINTS {
        return None;
    }
    // By steps of 4 %, which is well within the slab, over seven orders of magnitude.
    let heights = (0..400).map(|step| most * (-0.04 * f64::from(step)).exp());
    let mut best = None;
    for height in heights.filter(|height| *height > 0.0) {
        let (mut at, mut below) = (0usize, 0usize);
        for depth in depths.iter().filter(|d| d.counts(height)) {
            at += usize::from(depth.is_within(SLAB_HALF, height));
            below += usize::from(
                depth.down > (1.0 + SLAB_HALF) * height && depth.aside <= MAX_ASIDE_BELOW * height,
            );
        }
        let is_ground = at >= MIN_POINTS && below as f64 <= MAX_BELOW_SHARE * at as f64;
        if is_ground && best.is_none_or(|(most, _)| at > most) {
            best = Some((at, height));
        }
    }
    best.map(|(_, height)| height)
}

/// The cameras from above.
struct Walk {
    up: DVec3,
    x: DVec3,
    y: DVec3,
    /// `[V]`: place on the map, scene units.
    map: Vec<DVec2>,
    /// `[V]`: height along up, scene units.
    heights: Vec<f64>,
}

impl Walk {
    fn of(poses: &[Pose], up: DVec3) -> Self {
        let (x, y) = horizontals(up);
        let map = poses.iter().map(|p| DVec2::new(p.center.dot(x), p.center.dot(y))).collect();
        Self { up, x, y, map, heights: poses.iter().map(|p| p.center.dot(up)).collect() }
    }

    fn at(&self, point: DVec3) -> DVec2 {
        DVec2::new(point.dot(self.x), point.dot(self.y))
    }

    /// The cameras nearest to a place with their distances: a quarter of all, 3 to 6, the nearest
    /// first, and all that are at most `reach` farther than the nearest.
    fn around(&self, place: DVec2, reach: f64) -> Vec<(f64, usize)> {
        let count = (self.map.len() / 4).clamp(3, 6);
        let mut nearest: Vec<(f64, usize)> =
            self.map.iter().enumerate().map(|(camera, at)| (at.distance(place), camera)).collect();
        let rank = |a: &(f64, usize), b: &(f64, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        nearest.select_nth_unstable_by(count, rank);
        nearest[..count].sort_unstable_by(rank);
        let limit = nearest[0].0 + reach;
        let mut index = 0;
        nearest.retain(|(distance, _)| {
            index += 1;
            index <= count || *distance <= limit
        });
        // In one order, whatever the selection left.
        nearest[count..].sort_unstable_by(rank);
        nearest
    }

    fn depth(&self, point: DVec3, tilt: DMat2, reach: f64) -> Depth {
        let place = self.at(point);
        let around = self.around(place, reach);
        let count = around.len() as f64;
        let height = around.iter().map(|(_, camera)| self.heights[*camera]).sum::<f64>() / count;
        let middle = around.iter().map(|(_, camera)| self.map[*camera]).sum::<DVec2>() / count;
        let offset = place - middle;
        Depth {
            down: height - point.dot(self.up),
            aside: around[0].0,
            camera: around[0].1,
            error: offset.dot(tilt * offset).max(0.0).sqrt(),
        }
    }

    /// Root mean square of how far cameras are above or below those around them, scene units.
    fn uneven(&self) -> f64 {
        let off = self.map.iter().zip(&self.heights).map(|(place, height)| {
            let around = self.around(*place, 0.0);
            let mean =
                around.iter().map(|(_, camera)| self.heights[*camera]).sum::<f64>() / around.len() as f64;
            (height - mean).powi(2)
        });
        (off.sum::<f64>() / self.map.len() as f64).sqrt()
    }

    /// Selects the points of `slab` over which two lines of sight run low, on to things at least a
    /// camera height behind.
    fn select_seen_past(&self, slab: &[usize], seen: &SightLines, height: f64) -> Vec<usize> {
        struct Line {
            from: DVec2,
            along: DVec2,
            length: f64,
            start: f64,
            slope: f64,
        }
        let lines: Vec<Line> = seen
            .lines
            .iter()
            .filter_map(|(camera, point)| {
                let (from, to) = (self.map[*camera], self.at(seen.points[*point]));
                let (start, end) = (self.heights[*camera], seen.points[*point].dot(self.up));
                let length = from.distance(to);
                let slope = (end - start) / length;
                // Shorter ones end too near to run over anything.
                (length > height).then(|| Line { from, along: (to - from) / length, length, start, slope })
            })
            .collect();
        let runs_over = |line: &&Line, place: DVec2, ground: f64| {
            let offset = place - line.from;
            let along = offset.dot(line.along);
            // Walls that a line grazes are within a tenth of a height only where it ends on them.
            if along <= 0.0
                || along > line.length - height
                || offset.perp_dot(line.along).abs() > 0.1 * height
            {
                return false;
            }
            let above = (line.start + line.slope * along - ground) / height;
            above > 0.1 && above < 0.7
        };
        let mut clear = slab.to_vec();
        clear.retain(|index| {
            let (place, ground) = (self.at(seen.points[*index]), seen.points[*index].dot(self.up));
            lines.iter().filter(|line| runs_over(line, place, ground)).take(2).count() == 2
        });
        clear
    }
}

#[cfg(test)]
mod tests;
