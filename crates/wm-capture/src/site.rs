//! Place, north and time of a capture, as its photos state them: what the direction of the sun over
//! it follows from.

use super::gps::{GpsFit, MAX_INDEPENDENT, MIN_ERROR_M, fit_with_outliers};
use glam::{DVec2, DVec3};
use wm_base::linear::horizontals;
use wm_base::statistics::quantile;
use wm_scene::Gps;
use wm_scene::Metadata;

/// Facts about a capture that its photos state; `None` for what they do not state well enough.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CaptureSite {
    /// True north, and the place on Earth.
    pub(crate) place: Option<CapturePlace>,
    /// The middle of the photos' positions, also where they do not tell north.
    pub(crate) location: Option<Gps>,
    /// The time of the photos.
    pub(crate) time: Option<CaptureTime>,
}

/// North over a capture, and its place on Earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CapturePlace {
    /// True north, level, world axes, length 1.
    pub(crate) north: DVec3,
    /// Standard deviation of its azimuth, radians.
    pub(crate) north_error: f64,
    /// The middle of the photos' positions.
    pub(crate) location: Gps,
    /// Photos whose positions agree.
    pub(crate) photos: usize,
    /// Median distance between the cameras and the positions of their photos, m.
    pub(crate) residual: f64,
}

/// The time of a capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureTime {
    /// Median of the photos' times, seconds since 1970, UTC.
    pub(crate) captured: f64,
    /// Seconds between the first photo and the last.
    pub(crate) span: f64,
}

/// Largest share of outliers with which the other positions are used.
const MAX_OUTLIER_SHARE: f64 = 0.25;
/// Least share of the photos that state a time.
const MIN_TIMED_SHARE: f64 = 0.5;
/// Largest error of north, radians: 3 degrees.
const MAX_NORTH_ERROR_RAD: f64 = 0.052;
/// Largest error of the positions' own up with which it is compared to up, and the largest angle
/// between the two, radians: 10 degrees.
const MAX_UP_ERROR_RAD: f64 = 0.175;
/// Largest angle between the two in errors of the positions' own up, where that is more.
const MAX_UP_ERRORS: f64 = 3.0;
/// Shortest span of time that the metadata state, s: the sun moves by a quarter of a degree.
const MIN_SPAN_S: f64 = 60.0;

impl CaptureSite {
    /// Finds place, north and time of cameras (centres `[V]`, world axes) from the positions and
    /// times of their photos (`[V]` each).
    ///
    /// Nothing is found if more than a quarter of the positions are far from the others or no
    /// places on Earth: such EXIF is made up.
    ///
    /// # Panics
    /// If the lengths differ.
    #[must_use]
    pub fn of(centers: &[DVec3], places: &[Option<Gps>], times: &[Option<f64>], up: DVec3) -> Self {
        assert_eq!(centers.len(), times.len(), "a time (or none) a camera");
        let (fit, outliers) = fit_with_outliers(centers, places);
        let stated = places.iter().flatten().count();
        if outliers.len() as f64 > MAX_OUTLIER_SHARE * stated as f64 {
            return Self::default();
        }
        let is_kept = |index: &usize| outliers.binary_search(index).is_err();
        let kept: Vec<usize> = (0..centers.len()).filter(is_kept).collect();
        let both: Vec<(DVec3, Gps)> = kept.iter().filter_map(|i| Some((centers[*i], places[*i]?))).collect();
        let times: Vec<f64> = kept.iter().filter_map(|i| times[*i]).collect();
        Self {
            place: fit.and_then(|fit| CapturePlace::of(&both, &fit, up)),
            location: middle(both.iter().map(|(_, gps)| *gps)),
            time: CaptureTime::of(times, centers.len()),
        }
    }

    /// Writes down the facts, where `metadata` do not state them.
    pub fn note(&self, metadata: &mut Metadata) {
        if let Some(CapturePlace { north, photos, residual, .. }) = self.place
            && metadata.north.is_none()
        {
            metadata.north = Some(north);
            metadata.north_source = Some(format!("the GPS of {photos} photos, met within {residual:.1} m"));
        }
        if let Some(location) = self.location {
            metadata.location.get_or_insert([location.latitude, location.longitude]);
        }
        if let Some(time) = self.time
            && metadata.captured.is_none()
        {
            metadata.captured = Some(time.captured);
            metadata.captured_span = Some(time.span).filter(|span| *span > MIN_SPAN_S);
        }
    }
}

impl CaptureTime {
    /// `None` if too few of the photos state a time.
    fn of(mut times: Vec<f64>, photos: usize) -> Option<Self> {
        if times.is_empty() || (times.len() as f64) < MIN_TIMED_SHARE * photos as f64 {
            return None;
        }
        let range = |(low, high): (f64, f64), time: &f64| (low.min(*time), high.max(*time));
        let (first, last) = times.iter().fold((f64::INFINITY, f64::NEG_INFINITY), range);
        Some(Self { captured: quantile(&mut times, 0.5), span: last - first })
    }
}

impl CapturePlace {
    /// North by the level positions alone: heights may be missing, and a straight walk leaves the
    /// tilt of a fit in space open.
    fn of(both: &[(DVec3, Gps)], space: &GpsFit, up: DVec3) -> Option<Self> {
        let up = up.try_normalize()?;
        let error = space.up_error();
        if error < MAX_UP_ERROR_RAD
            && up.angle_between(space.up) > MAX_UP_ERROR_RAD.max(MAX_UP_ERRORS * error)
        {
            return None;
        }
        let origin = both.get(both.len() / 2)?.1;
        let (x, y) = horizontals(up);
        let level = |at: &DVec3| DVec2::new(at.dot(x), at.dot(y));
        let pairs: Vec<(DVec2, DVec2)> =
            both.iter().map(|(center, gps)| (level(center), gps.enu_from(&origin).truncate())).collect();
        let fit = LevelFit::of(&pairs)?;
        let spread = fit.spread * (MAX_INDEPENDENT / pairs.len() as f64).min(1.0);
        let north_error = fit.residual.max(MIN_ERROR_M) / spread.sqrt();
        // The direction that the turn takes to the second axis, which is north.
        let north = DVec2::new(fit.turn.x, -fit.turn.y).rotate(DVec2::Y);
        let found = Self {
            north: (x * north.x + y * north.y).normalize(),
            north_error,
            location: middle(both.iter().map(|(_, gps)| *gps))?,
            photos: both.len(),
            residual: space.residual,
        };
        (north_error <= MAX_NORTH_ERROR_RAD && found.north.is_finite()).then_some(found)
    }
}

/// The median of latitudes and longitudes, across the date line too.
fn middle(places: impl Iterator<Item = Gps>) -> Option<Gps> {
    let places: Vec<Gps> = places.collect();
    let first = places.first()?.longitude;
    let median = |of: &dyn Fn(&Gps) -> f64| quantile(&mut places.iter().map(of).collect::<Vec<f64>>(), 0.5);
    let around = |degrees: f64| (degrees + 180.0).rem_euclid(360.0) - 180.0;
    Some(Gps {
        latitude: median(&|place| place.latitude),
        longitude: around(first + median(&|place| around(place.longitude - first))),
        altitude: None,
    })
}

/// The similarity of the plane that takes points to positions, with weights that let outliers fade
/// (Geman and McClure).
struct LevelFit {
    /// The turn, as a unit complex number.
    turn: DVec2,
    /// Weighted sum of the squared distances of the positions from their mean, m^2.
    spread: f64,
    /// Median distance, m.
    residual: f64,
}

impl LevelFit {
    fn of(pairs: &[(DVec2, DVec2)]) -> Option<Self> {
        let mut weights = vec![1.0; pairs.len()];
        let mut found = None;
        for _ in 0..20 {
            let sum: f64 = weights.iter().sum();
            let weighted = || pairs.iter().zip(&weights);
            let mean = |of: &dyn Fn(&(DVec2, DVec2)) -> DVec2| {
                weighted().map(|(pair, weight)| of(pair) * *weight).sum::<DVec2>() / sum
            };
            let (from, to) = (mean(&|pair| pair.0), mean(&|pair| pair.1));
            let (mut product, mut square, mut spread) = (DVec2::ZERO, 0.0, 0.0);
            for ((a, b), weight) in weighted() {
                let (a, b) = (*a - from, *b - to);
                product += *weight * DVec2::new(a.dot(b), a.perp_dot(b));
                square += weight * a.length_squared();
                spread += weight * b.length_squared();
            }
            let (turn, scale) = (product.try_normalize()?, product.length() / square);
            if !(scale.is_finite() && scale > 0.0) {
                return None;
            }
            let off: Vec<f64> =
                pairs.iter().map(|(a, b)| (scale * turn.rotate(*a - from)).distance(*b - to)).collect();
            let residual = quantile(&mut off.clone(), 0.5);
            let sigma = (1.5 * residual).max(MIN_ERROR_M);
            weights = off.iter().map(|off| (1.0 + (off / sigma).powi(2)).powi(-2)).collect();
            found = Some(Self { turn, spread, residual });
        }
        found
    }
}

#[cfg(test)]
mod tests;
