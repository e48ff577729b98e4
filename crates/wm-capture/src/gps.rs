//! Scale, up and north from the positions that the photos state.
//!
//! Places on the ellipsoid become east, north and up in metres around the first of them; then the
//! similarity `enu = s R x + t` is found that takes the cameras there (Horn 1987, the closed form
//! with quaternions), first from three cameras at a time for one that most agree with (RANSAC),
//! then from all of them with weights that let outliers fade (Geman and McClure).

use glam::{DMat3, DQuat, DVec3};
use wm_base::jacobi::jacobi;
use wm_base::linear::{horizontals, outer};
use wm_base::statistics::quantile;
use wm_scene::Gps;

/// Facts of a place that the positions of its photos give.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpsFit {
    /// Metres per scene unit.
    pub metres_per_unit: f64,
    /// The direction against gravity, world axes, length 1.
    pub up: DVec3,
    /// True north, level, world axes, length 1.
    pub(crate) north: DVec3,
    /// The inverse covariance of `up` in world axes, 1/rad^2: how much a turn of it is resisted, by
    /// direction. Small along the direction in which cameras on one line leave it open; zero if
    /// altitudes are missing.
    pub(crate) information: DMat3,
    /// Median distance between the cameras and the positions of their photos, m.
    pub residual: f64,
    /// Greatest distance between two places along an axis, m, outliers left out.
    pub extent: f64,
    /// Photos with a place, outliers left out.
    pub photos: usize,
}

/// Least extent of the cameras, m: the error of a good receiver.
const MIN_EXTENT_M: f64 = 10.0;

/// Least ratio of the extent to the residual.
const MIN_EXTENT_RATIO: f64 = 4.0;

/// Triples of cameras that RANSAC tries.
const TRIAL_COUNT: usize = 500;

/// Least error that a position is assumed to have, m.
pub(crate) const MIN_ERROR_M: f64 = 1.0;

/// Least distance of an outlier, in residuals of the fit.
const OUTLIER_RATIO: f64 = 10.0;
/// Least distance of an outlier, m: no receiver errs as much under an open sky.
const OUTLIER_DISTANCE_M: f64 = 50.0;

/// Most positions that count as independent: those of one flight or walk err alike.
pub(crate) const MAX_INDEPENDENT: f64 = 8.0;

/// Fits camera centres `[V, 3]`, scene units, to the places of their photos `[V]`.
///
/// `None` with fewer than 3 places, or where they lie too close together for their error to tell.
///
/// # Panics
/// If the lengths differ.
#[must_use]
pub fn fit(centers: &[DVec3], places: &[Option<Gps>]) -> Option<GpsFit> {
    fit_with_outliers(centers, places).0
}

/// [`fit`], and the indices of the photos whose places it leaves out: those that are no place on
/// Earth, and those far from where the others put their cameras.
///
/// # Panics
/// If the lengths differ.
#[must_use]
pub fn fit_with_outliers(centers: &[DVec3], places: &[Option<Gps>]) -> (Option<GpsFit>, Vec<usize>) {
    assert_eq!(centers.len(), places.len(), "a place (or none) a camera");
    let is_absurd = |index: &usize| places[*index].is_some_and(|place| place.checked().is_none());
    let mut outliers: Vec<usize> = (0..places.len()).filter(is_absurd).collect();
    let used: Vec<usize> =
        (0..places.len()).filter(|i| places[*i].and_then(Gps::checked).is_some()).collect();
    let both: Vec<(DVec3, Gps)> = used.iter().filter_map(|i| Some((centers[*i], places[*i]?))).collect();
    let Some((fit, far)) = fit_checked(&both) else { return (None, outliers) };
    outliers.extend(far.into_iter().map(|place| used[place]));
    outliers.sort_unstable();
    (Some(fit), outliers)
}

/// The place nearest to the median of all along each axis: a stray one does not tell where east and
/// up are.
fn middle(both: &[(DVec3, Gps)]) -> Option<Gps> {
    let all: Vec<DVec3> = both.iter().map(|(_, place)| place.ecef()).collect();
    let median = |axis: usize| quantile(&mut all.iter().map(|p| p[axis]).collect::<Vec<_>>(), 0.5);
    let median = DVec3::new(median(0), median(1), median(2));
    let nearest = |a: &&(DVec3, Gps), b: &&(DVec3, Gps)| {
        a.1.ecef().distance(median).total_cmp(&b.1.ecef().distance(median))
    };
    both.iter().min_by(nearest).map(|(_, place)| *place)
}

/// The fit of places on Earth, and the indices of the outliers among them.
fn fit_checked(both: &[(DVec3, Gps)]) -> Option<(GpsFit, Vec<usize>)> {
    let origin = middle(both)?;
    // Where some photos lack an altitude, those that have one would stand high above the others.
    let is_flat = both.iter().any(|(_, place)| place.altitude.is_none());
    let level = |place: Gps| if is_flat { Gps { altitude: None, ..place } } else { place };
    let pairs: Vec<(DVec3, DVec3)> =
        both.iter().map(|(center, place)| (*center, level(*place).enu_from(&level(origin)))).collect();
    if pairs.len() < 3 || !(MIN_EXTENT_M..f64::INFINITY).contains(&extent_of(&pairs)) {
        return None;
    }
    let mut best: Option<(f64, Similarity)> = None;
    for trial in 0..TRIAL_COUNT {
        let pick = |turn: u64| {
            (wm_base::random::uniform(trial as u64, turn) * pairs.len() as f64) as usize % pairs.len()
        };
        let triple = [pick(0), pick(1), pick(2)];
        if triple[0] == triple[1] || triple[1] == triple[2] || triple[0] == triple[2] {
            continue;
        }
        let Some(found) = Similarity::of(triple.map(|index| (pairs[index].0, pairs[index].1, 1.0))) else {
            continue;
        };
        let residual = found.residual(&pairs);
        if best.as_ref().is_none_or(|(least, _)| residual < *least) {
            best = Some((residual, found));
        }
    }
    let (_, mut fit) = best?;
    for _ in 0..20 {
        let sigma = (1.5 * fit.residual(&pairs)).max(MIN_ERROR_M);
        let weighted = pairs.iter().map(|(from, to)| {
            let off = (fit.apply(*from) - *to).length() / sigma;
            (*from, *to, (1.0 + off * off).powi(-2))
        });
        fit = Similarity::of(weighted)?;
    }
    let far = OUTLIER_DISTANCE_M.max(OUTLIER_RATIO * fit.residual(&pairs));
    let is_outlier = |(from, to): &(DVec3, DVec3)| (fit.apply(*from) - *to).length() > far;
    let outliers: Vec<usize> = (0..pairs.len()).filter(|index| is_outlier(&pairs[*index])).collect();
    let pairs: Vec<(DVec3, DVec3)> = pairs.into_iter().filter(|pair| !is_outlier(pair)).collect();
    if pairs.len() < 3 {
        return None;
    }
    let (residual, extent) = (fit.residual(&pairs), extent_of(&pairs));
    let is_sound = fit.scale.is_finite()
        && fit.scale > 0.0
        && extent >= MIN_EXTENT_M
        && extent > MIN_EXTENT_RATIO * residual;
    let found = GpsFit {
        metres_per_unit: fit.scale,
        up: fit.rotation.transpose() * DVec3::Z,
        north: fit.rotation.transpose() * DVec3::Y,
        information: if is_flat { DMat3::ZERO } else { fit.information(&pairs, residual) },
        residual,
        extent,
        photos: pairs.len(),
    };
    is_sound.then_some((found, outliers))
}

/// Greatest distance between two places along an axis, m.
fn extent_of(pairs: &[(DVec3, DVec3)]) -> f64 {
    let box_of = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = pairs.iter().fold(box_of, |(low, high), (_, at)| (low.min(*at), high.max(*at)));
    (high - low).max_element()
}

impl GpsFit {
    /// Standard deviation of [`Self::up`] in the direction in which it is known least, radians;
    /// infinite if it is not known.
    #[must_use]
    pub(crate) fn up_error(&self) -> f64 {
        let (x, y) = horizontals(self.up);
        let [xx, xy, yy] =
            [x.dot(self.information * x), x.dot(self.information * y), y.dot(self.information * y)];
        let least = 0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
        least.max(0.0).sqrt().recip()
    }
}

struct Similarity {
    scale: f64,
    rotation: DMat3,
    from: DVec3,
    to: DVec3,
}

impl Similarity {
    /// The one that takes the first points to the second, least squares with weights.
    fn of(pairs: impl IntoIterator<Item = (DVec3, DVec3, f64)> + Clone) -> Option<Self> {
        let (mut from, mut to, mut sum) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for (a, b, weight) in pairs.clone() {
            from += a * weight;
            to += b * weight;
            sum += weight;
        }
        if !(sum > 0.0 && sum.is_finite()) {
            return None;
        }
        (from, to) = (from / sum, to / sum);
        let (mut product, mut square) = ([[0.0; 3]; 3], 0.0);
        for (a, b, weight) in pairs.clone() {
            let (a, b) = ((a - from).to_array(), (b - to).to_array());
            for (row, a) in product.iter_mut().zip(a) {
                for (cell, b) in row.iter_mut().zip(b) {
                    *cell += weight * a * b;
                }
            }
            square += weight * a.iter().map(|v| v * v).sum::<f64>();
        }
        let rotation = horn_rotation(product);
        let mut along = 0.0;
        for (a, b, weight) in pairs {
            along += weight * (b - to).dot(rotation * (a - from));
        }
        let scale = along / square;
        (scale.is_finite() && scale > 0.0).then_some(Self { scale, rotation, from, to })
    }

    fn apply(&self, point: DVec3) -> DVec3 {
        self.to + self.scale * (self.rotation * (point - self.from))
    }

    /// The inverse covariance of up by the spread of the places, for an error of `residual` m; see
    /// [`GpsFit::information`].
    fn information(&self, pairs: &[(DVec3, DVec3)], residual: f64) -> DMat3 {
        // A turn w moves the place p by w x p: places resist it by |w x p|^2.
        let spread = pairs.iter().fold(DMat3::ZERO, |sum, (_, to)| sum + outer(*to - self.to, 1.0));
        let trace = spread.col(0).x + spread.col(1).y + spread.col(2).z;
        let count = pairs.len() as f64;
        let sigma = residual.max(MIN_ERROR_M);
        let turns = (DMat3::from_diagonal(DVec3::splat(trace)) - spread)
            * ((MAX_INDEPENDENT / count).min(1.0) / (sigma * sigma));
        // Up is turned by w_x and w_y; a turn about itself, w_z, is left free.
        let [xz, yz, zz] = [turns.col(2).x, turns.col(2).y, turns.col(2).z.max(1e-12)];
        let (xx, xy, yy) =
            (turns.col(0).x - xz * xz / zz, turns.col(0).y - xz * yz / zz, turns.col(1).y - yz * yz / zz);
        // w_x moves up by -y, w_y by +x.
        let enu = DMat3::from_cols(DVec3::new(yy, -xy, 0.0), DVec3::new(-xy, xx, 0.0), DVec3::ZERO);
        self.rotation.transpose() * enu * self.rotation
    }

    /// Median distance.
    fn residual(&self, pairs: &[(DVec3, DVec3)]) -> f64 {
        let mut off: Vec<f64> = pairs.iter().map(|(from, to)| (self.apply(*from) - *to).length()).collect();
        quantile(&mut off, 0.5)
    }
}

/// Horn's rotation: the largest eigenvector of a symmetric 4 x 4 matrix of `sum a b^T`.
fn horn_rotation(product: [[f64; 3]; 3]) -> DMat3 {
    let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = product;
    let matrix = [
        [xx + yy + zz, yz - zy, zx - xz, xy - yx],
        [yz - zy, xx - yy - zz, xy + yx, zx + xz],
        [zx - xz, xy + yx, yy - xx - zz, yz + zy],
        [xy - yx, zx + xz, yz + zy, zz - xx - yy],
    ];
    let (values, vectors) = jacobi(matrix);
    let largest = (0..4).max_by(|a, b| values[*a].total_cmp(&values[*b])).unwrap_or(0);
    let [w, x, y, z] = vectors[largest];
    DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize())
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_base::random::uniform;

    const LUND: Gps = Gps { latitude: 55.7047, longitude: 13.191, altitude: Some(50.0) };

    /// A place so far east, north and up of Lund, by the radii of the ellipsoid there.
    fn place(enu: DVec3) -> Gps {
        let metres = |latitude: f64, longitude: f64| {
            Gps { latitude, longitude, altitude: LUND.altitude }.enu_from(&LUND)
        };
        let (north, east) =
            (metres(LUND.latitude + 1e-4, LUND.longitude).y, metres(LUND.latitude, LUND.longitude + 1e-4).x);
        Gps {
            latitude: LUND.latitude + enu.y / north * 1e-4,
            longitude: LUND.longitude + enu.x / east * 1e-4,
            altitude: Some(50.0 + enu.z),
        }
    }

    #[test]
    fn a_degree_is_as_long_as_it_should_be() {
        // The meridian's degree at 55.7 degrees north: 111.33 km; the parallel's: 62.85 km.
        let north = Gps { latitude: LUND.latitude + 0.01, ..LUND }.enu_from(&LUND);
        let east = Gps { longitude: LUND.longitude + 0.01, ..LUND }.enu_from(&LUND);
        assert!((north.y - 1113.4).abs() < 0.5 && north.x.abs() < 0.01, "{north}");
        assert!((east.x - 629.0).abs() < 0.7 && east.y.abs() < 0.1, "{east}");
        let up = Gps { altitude: Some(70.0), ..LUND }.enu_from(&LUND);
        assert!((up - DVec3::new(0.0, 0.0, 20.0)).length() < 1e-6);
    }

    #[test]
    fn moving_is_the_inverse_of_east_north_up() {
        for enu in [DVec3::ZERO, DVec3::new(900.0, -700.0, 60.0), DVec3::new(-3000.0, 2000.0, -20.0)] {
            let there = LUND.moved(enu);
            assert!((there.enu_from(&LUND) - enu).length() < 1e-3, "{there:?}");
        }
    }

    #[test]
    fn the_scale_comes_out_of_noise_and_outliers() {
        let turn = DMat3::from_quat(DQuat::from_xyzw(0.5, -0.3, 0.2, 0.8).normalize());
        let noise =
            |index: u64| DVec3::new(uniform(1, index), uniform(2, index), uniform(3, index)) * 4.0 - 2.0;
        let (mut centers, mut places) = (Vec::new(), Vec::new());
        for index in 0..60u64 {
            let enu = DVec3::new(3.0 * index as f64, 20.0 * (index as f64 * 0.1).sin(), 0.02 * index as f64);
            centers.push(turn * enu / 16.4 + DVec3::new(3.0, -2.0, 7.0));
            let off = if index % 6 == 0 { DVec3::new(-80.0, 150.0, 9.0) } else { DVec3::ZERO };
            places.push((index % 7 != 3).then(|| place(enu + noise(index) + off)));
        }
        let found = fit(&centers, &places).unwrap();
        // Errors of 2 m along 180 m with 50 cameras leave well under 1 %.
        assert!((found.metres_per_unit / 16.4 - 1.0).abs() < 0.01, "{found:?}");
        let stray = (0..60).filter(|i| i % 6 == 0 && i % 7 != 3).count();
        assert!(found.residual < 3.0 && found.photos == 51 - stray, "{found:?}");
    }

    #[test]
    fn one_place_on_the_moon_changes_nothing() {
        let turn = DMat3::from_quat(DQuat::from_xyzw(0.5, -0.3, 0.2, 0.8).normalize());
        let survey = |count: usize| -> (Vec<DVec3>, Vec<Option<Gps>>) {
            let cameras = (0..count).map(|i| DVec3::new(20.0 * (i % 4) as f64, 25.0 * (i / 4) as f64, 50.0));
            cameras.map(|enu| (turn * enu / 7.0, Some(place(enu)))).unzip()
        };
        let (centers, places) = survey(16);
        let truth = fit(&centers, &places).unwrap();
        let lund = places[0].unwrap();
        for (name, lie) in [
            ("in Sydney", Gps { latitude: -33.9, longitude: 151.2, ..lund }),
            ("on the moon", Gps { altitude: Some(384_000e3), ..lund }),
            ("beyond the pole", Gps { latitude: 95.0, ..lund }),
            ("in the next town", Gps { latitude: lund.latitude + 0.2, ..lund }),
            ("in the air", Gps { altitude: Some(9_000.0), ..lund }),
        ] {
            for at in [0, 7] {
                let mut places = places.clone();
                places[at] = Some(lie);
                let (found, outliers) = fit_with_outliers(&centers, &places);
                let found = found.unwrap_or_else(|| panic!("{name}"));
                assert_eq!((outliers, found.photos), (vec![at], 15), "{name}");
                assert!(found.up.angle_between(truth.up).to_degrees() < 0.1, "{name}: {found:?}");
                assert!(
                    (found.metres_per_unit / truth.metres_per_unit - 1.0).abs() < 1e-3,
                    "{name}: {found:?}"
                );
                assert!(
                    (found.extent - truth.extent).abs() < 30.0 && found.up_error() < 2.0 * truth.up_error()
                );
            }
        }
        // Photos of one spot, and one far away: an extent that is none.
        let (centers, mut places) = survey(12);
        let (spot, there) = (places[0], Gps { latitude: -33.9, longitude: 151.2, ..lund });
        places.fill(spot);
        places[5] = Some(there);
        assert_eq!(fit(&centers, &places), None);
    }

    /// A survey from the air of which up, north and scale are known, in axes of its own.
    #[test]
    fn up_and_north_come_with_their_error() {
        let turn = DMat3::from_quat(DQuat::from_xyzw(0.5, -0.3, 0.2, 0.8).normalize());
        let noise =
            |index: u64| DVec3::new(uniform(1, index), uniform(2, index), uniform(3, index)) * 2.0 - 1.0;
        let survey = |rows: u64| {
            let cameras =
                (0..4 * rows).map(|i| DVec3::new(20.0 * (i % 4) as f64, 25.0 * (i / 4) as f64, 50.0));
            let pairs =
                cameras.enumerate().map(|(i, enu)| (turn * enu / 7.0, Some(place(enu + noise(i as u64)))));
            pairs.unzip::<_, _, Vec<_>, Vec<_>>()
        };
        let (centers, places) = survey(5);
        let found = fit(&centers, &places).unwrap();
        let off = |found: DVec3, truth: DVec3| found.angle_between(turn * truth).to_degrees();
        let error = found.up_error().to_degrees();
        assert!(off(found.up, DVec3::Z) < 2.0 * error && off(found.north, DVec3::Y) < 1.0, "{found:?}");
        assert!(error > 0.3 && error < 1.5, "{error}");
        // On one line a turn about it is open, and without altitudes everything is.
        let (centers, places) = survey(1);
        let line = fit(&centers, &places).unwrap();
        assert!(line.up_error().to_degrees() > 20.0, "{}", line.up_error());
        let (centers, mut places) = survey(5);
        places[3] = places[3].map(|place| Gps { altitude: None, ..place });
        assert!(fit(&centers, &places).unwrap().up_error().is_infinite());
    }

    #[test]
    fn places_that_say_nothing_give_nothing() {
        let line = |step: f64, count: usize| -> (Vec<DVec3>, Vec<Option<Gps>>) {
            (0..count).map(|i| DVec3::X * step * i as f64).map(|at| (at, Some(place(at)))).unzip()
        };
        let (centers, places) = line(10.0, 2);
        assert_eq!(fit(&centers, &places), None);
        let (centers, places) = line(0.5, 10);
        assert_eq!(fit(&centers, &places), None);
        assert_eq!(fit(&[], &[]), None);
        let (centers, places) = line(10.0, 10);
        assert!((fit(&centers, &places).unwrap().metres_per_unit - 1.0).abs() < 1e-3);
        // Cameras all in one point, wherever their photos say they are.
        assert_eq!(fit(&[DVec3::ONE; 10], &places), None);
        for bad in [(0.0, 0.0), (91.0, 0.0), (f64::NAN, 1.0), (5.0, 181.0)] {
            assert_eq!(Gps { latitude: bad.0, longitude: bad.1, altitude: None }.checked(), None);
        }
    }
}
