//! Places on Earth, as receivers of satellites state them.

use glam::{DMat3, DVec3};

/// A place on Earth, WGS 84.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gps {
    /// Degrees, north above 0.
    pub latitude: f64,
    /// Degrees, east above 0.
    pub longitude: f64,
    /// Metres above the sea, where it is known.
    pub altitude: Option<f64>,
}

/// Altitudes at which photos are taken, m above the sea: from the Dead Sea to balloons.
const ALTITUDES_M: std::ops::RangeInclusive<f64> = -600.0..=50_000.0;

impl Gps {
    /// `None` if it states no place: not finite, or the 0, 0 that cameras without reception write.
    #[must_use]
    pub fn stated(self) -> Option<Self> {
        let Self { latitude, longitude, .. } = self;
        let is_finite = latitude.is_finite() && longitude.is_finite();
        (is_finite && (latitude != 0.0 || longitude != 0.0)).then_some(self)
    }

    /// `None` if it is no place on Earth where photos are taken: not finite, the 0, 0 that cameras
    /// without reception write, or out of range.
    #[must_use]
    pub fn checked(self) -> Option<Self> {
        let Self { latitude, longitude, altitude } = self;
        let in_range = latitude.abs() <= 90.0 && longitude.abs() <= 180.0;
        let is_high = altitude.is_some_and(|metres| !ALTITUDES_M.contains(&metres));
        self.stated().filter(|_| in_range && !is_high)
    }

    /// Earth-centred, earth-fixed, m.
    pub fn ecef(&self) -> DVec3 {
        const EQUATORIAL_RADIUS_M: f64 = 6_378_137.0;
        const FLATTENING: f64 = 1.0 / 298.257_223_563;
        const ECCENTRICITY2: f64 = FLATTENING * (2.0 - FLATTENING);
        let (sin, cos) = self.latitude.to_radians().sin_cos();
        let (east, along) = self.longitude.to_radians().sin_cos();
        let normal = EQUATORIAL_RADIUS_M / (1.0 - ECCENTRICITY2 * sin * sin).sqrt();
        let height = self.altitude.unwrap_or(0.0);
        let flat = (normal + height) * cos;
        DVec3::new(flat * along, flat * east, (normal * (1.0 - ECCENTRICITY2) + height) * sin)
    }

    /// East, north, up of `self` from `origin`, m.
    #[must_use]
    pub fn enu_from(&self, origin: &Self) -> DVec3 {
        let (sin, cos) = origin.latitude.to_radians().sin_cos();
        let (sin_l, cos_l) = origin.longitude.to_radians().sin_cos();
        let rows = DMat3::from_cols(
            DVec3::new(-sin_l, cos_l, 0.0),
            DVec3::new(-sin * cos_l, -sin * sin_l, cos),
            DVec3::new(cos * cos_l, cos * sin_l, sin),
        );
        rows.transpose() * (self.ecef() - origin.ecef())
    }

    /// The place so many metres east, north and up of `self`: the inverse of [`Self::enu_from`], to
    /// a millimetre within some kilometres. Not for the poles.
    #[must_use]
    pub fn moved(&self, enu: DVec3) -> Self {
        const METRES_PER_DEGREE: f64 = 111_320.0;
        let mut place = *self;
        // Newton's method with the derivative of a sphere: each round leaves less than a hundredth
        // of the error.
        for _ in 0..6 {
            let left = enu - place.enu_from(self);
            place.latitude += left.y / METRES_PER_DEGREE;
            place.longitude += left.x / (METRES_PER_DEGREE * place.latitude.to_radians().cos());
            place.altitude = Some(place.altitude.unwrap_or(0.0) + left.z);
        }
        place
    }
}
