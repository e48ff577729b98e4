use super::*;
use glam::{DMat3, DQuat};
use wm_base::random::uniform;

const LUND: Gps = Gps { latitude: 55.7047, longitude: 13.191, altitude: Some(50.0) };
const SYDNEY: Gps = Gps { latitude: -33.86, longitude: 151.21, altitude: Some(20.0) };
/// 30 May 2024, 8:56 UTC.
const MAY_2024_S: f64 = 1_717_059_360.0;

/// The model's axes: turned, and of another unit.
fn turn() -> DMat3 {
    DMat3::from_quat(DQuat::from_xyzw(0.5, -0.3, 0.2, 0.8).normalize())
}

struct Flight {
    centers: Vec<DVec3>,
    places: Vec<Option<Gps>>,
    times: Vec<Option<f64>>,
}

impl Flight {
    /// Photos at `at` (east, north, up of `home`, m), 3 s apart, with positions that are up to 1 m
    /// off.
    fn over(home: Gps, at: impl Iterator<Item = DVec3>) -> Self {
        let mut flight = Self { centers: Vec::new(), places: Vec::new(), times: Vec::new() };
        for (index, enu) in at.enumerate() {
            let noise = |k| 2.0 * uniform(k, index as u64) - 1.0;
            let off = DVec3::new(noise(1), noise(2), noise(3));
            flight.centers.push(turn() * enu / 7.0 + DVec3::new(3.0, -2.0, 7.0));
            flight.places.push(Some(home.moved(enu + off)));
            flight.times.push(Some(MAY_2024_S + 3.0 * index as f64));
        }
        flight
    }

    /// A drone on lines 15 m apart.
    fn survey() -> Self {
        Self::over(LUND, (0..24).map(|i| DVec3::new(15.0 * f64::from(i % 4), 12.0 * f64::from(i / 4), 50.0)))
    }

    fn site(&self) -> CaptureSite {
        CaptureSite::of(&self.centers, &self.places, &self.times, turn() * DVec3::Z)
    }
}

fn off_degrees(place: &CapturePlace, north: DVec3) -> f64 {
    place.north.angle_between(turn() * north).to_degrees()
}

#[test]
fn north_place_and_time_of_a_survey() {
    let site = Flight::survey().site();
    let place = site.place.unwrap();
    assert!(off_degrees(&place, DVec3::Y) < 1.0, "{place:?}");
    assert!(place.north.dot(turn() * DVec3::Z).abs() < 1e-9);
    assert!((place.north_error.to_degrees() - 1.0).abs() < 1.0 && place.photos == 24, "{place:?}");
    let middle = place.location.enu_from(&LUND).truncate();
    assert!(middle.distance(DVec2::new(22.5, 30.0)) < 15.0, "{middle}");
    let time = site.time.unwrap();
    assert!((time.captured - MAY_2024_S - 36.0).abs() < 2.0 && time.span == 69.0, "{time:?}");
    let mut metadata = Metadata::default();
    site.note(&mut metadata);
    assert_eq!((metadata.captured, metadata.captured_span), (Some(time.captured), Some(69.0)));
    assert_eq!((metadata.north, metadata.fault()), (Some(place.north), None));
    assert!(metadata.north_source.unwrap().starts_with("the GPS of 24 photos, met within "));
    // What is known stays.
    let given = Metadata { north: Some(DVec3::X), captured: Some(0.0), ..Metadata::default() };
    let mut noted = given.clone();
    site.note(&mut noted);
    assert_eq!(noted, Metadata { location: noted.location, ..given });
}

/// A straight walk leaves its roll open in space, and phones often state no heights.
#[test]
fn straight_walks_without_heights_tell_north_if_up_is_known() {
    for heading in [0.0f64, 40.0, 90.0, 200.0] {
        let (sin, cos) = heading.to_radians().sin_cos();
        let mut walk = Flight::over(LUND, (0..50).map(|i| DVec3::new(sin, cos, 0.0) * 2.0 * f64::from(i)));
        for is_flat in [false, true] {
            if is_flat {
                walk.places.iter_mut().flatten().for_each(|place| place.altitude = None);
            }
            let place = walk.site().place.unwrap();
            assert!(off_degrees(&place, DVec3::Y) < 1.0, "{heading} {place:?}");
        }
    }
    let short = Flight::over(LUND, (0..12).map(|i| DVec3::X * f64::from(i)));
    let site = short.site();
    assert_eq!(site.place, None);
    assert!(site.location.unwrap().enu_from(&LUND).truncate().length() < 15.0);
}

#[test]
fn the_date_line_and_the_south_are_no_other_place() {
    let fiji = Gps { latitude: -16.8, longitude: 179.9999, altitude: Some(5.0) };
    for home in [SYDNEY, fiji] {
        let at = |i: i32| DVec3::new(15.0 * f64::from(i % 4), 12.0 * f64::from(i / 4), 50.0);
        let mut flight = Flight::over(home, (0..24).map(at));
        for place in flight.places.iter_mut().flatten() {
            place.longitude = (place.longitude + 180.0).rem_euclid(360.0) - 180.0;
        }
        let place = flight.site().place.unwrap();
        assert!(off_degrees(&place, DVec3::Y) < 1.0);
        assert!(place.location.enu_from(&home).truncate().length() < 80.0, "{place:?}");
        assert!(place.location.checked().is_some());
    }
}

#[test]
fn positions_that_contradict_each_other_are_not_believed() {
    let mut flight = Flight::survey();
    for place in flight.places.iter_mut().step_by(6) {
        *place = Some(SYDNEY);
    }
    // A few are left out.
    let site = flight.site();
    assert_eq!(site.place.unwrap().photos, 20);
    assert!(off_degrees(&site.place.unwrap(), DVec3::Y) < 1.0 && site.time.is_some());
    for place in flight.places.iter_mut().skip(1).step_by(3) {
        *place = Some(Gps { latitude: 123.0, longitude: 300.0, altitude: None });
    }
    assert_eq!(flight.site(), CaptureSite::default());
    flight.places.fill(None);
    assert_eq!(flight.site().place, None);
}

#[test]
fn an_up_that_positions_contradict_gives_no_north() {
    let Flight { centers, places, times } = Flight::survey();
    let other = turn() * DVec3::new(0.0, 0.6, 0.8);
    let site = CaptureSite::of(&centers, &places, &times, other);
    assert!(site.place.is_none() && site.time.is_some());
    assert_eq!(CaptureSite::of(&centers, &places, &times, DVec3::ZERO).place, None);
    assert_eq!(CaptureSite::of(&[], &[], &[], DVec3::Z), CaptureSite::default());
}

#[test]
fn half_of_the_photos_must_state_a_time() {
    let mut flight = Flight::survey();
    flight.times[..12].fill(None);
    assert_eq!(flight.site().time.unwrap().span, 33.0);
    flight.times[12] = None;
    assert_eq!(flight.site().time, None);
}
