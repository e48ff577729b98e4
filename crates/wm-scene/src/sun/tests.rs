use super::*;

fn degrees(latitude: f64, longitude: f64, time: f64) -> (f64, f64) {
    let sun = SunPosition::at(latitude, longitude, time).unwrap();
    (sun.azimuth.to_degrees(), sun.elevation.to_degrees())
}

/// Example of NREL's report on the algorithm (Reda and Andreas 2004, table A5.1): Golden, Colorado,
/// 17 October 2003, 12:30:30, UTC-7: azimuth 194.34024, zenith 50.11162, at 820 hPa and 1,830 m;
/// the air of sea level lifts the sun by 0.003 degrees more.
#[test]
fn position_is_that_of_the_nrel_example() {
    let (azimuth, elevation) = degrees(39.742_476, -105.178_6, 1_066_419_030.0);
    assert!((azimuth - 194.340_24).abs() < 0.001, "{azimuth}");
    assert!((elevation - (90.0 - 50.111_62) - 0.003).abs() < 0.002, "{elevation}");
}

/// Meeus, Astronomical Algorithms, example 25.b: declination -7 degrees 47' 1.74" on 13 October
/// 1992, 0:00 dynamical time. Seen from the pole that is the elevation, less a parallax of 0.0024
/// degrees; the sun is down, so there is no refraction. The minute between dynamical and universal
/// time is 0.0003 degrees.
#[test]
fn elevation_at_the_pole_is_the_declination() {
    let (_, elevation) = degrees(90.0, 0.0, 718_934_400.0);
    let expected = -(7.0 + 47.0 / 60.0 + 1.74 / 3600.0) - 0.0024;
    assert!((elevation - expected).abs() < 0.001, "{elevation}");
}

/// 20 June 2024, 20:51 UTC, is the solstice. Its highest sun of the day over a latitude is in the
/// south at 90 - latitude
/// + 23.44 degrees, or in the north where that is beyond the zenith.
#[test]
fn noon_of_the_june_solstice_is_at_its_height() {
    let noon = 1_718_884_800.0;
    for latitude in [-30.0, 0.0, 45.0, 52.0, 60.0] {
        let day = (-60..=60).map(|minute| degrees(latitude, 0.0, noon + 60.0 * f64::from(minute)));
        let (azimuth, highest) = day.fold((0.0, -90.0), |best, at| if at.1 > best.1 { at } else { best });
        let southern = 90.0 - latitude + 23.44;
        let (expected, side) = if southern <= 90.0 { (southern, 180.0) } else { (180.0 - southern, 0.0) };
        assert!((highest - expected).abs() < 0.03, "{latitude}: {highest}, not {expected}");
        let off = (azimuth - side + 180.0).rem_euclid(360.0) - 180.0;
        assert!(off.abs() < 1.0, "{latitude}: {azimuth}");
    }
}

/// The built-in street: 52.0907 N, 5.1214 E, 30 May 2024, 8:56 UTC; its x axis points east and its
/// y axis north.
#[test]
fn sun_of_the_built_in_street_is_found() {
    let sun = SunPosition::at(52.0907, 5.1214, 1_717_059_360.0).unwrap();
    let (towards, drawn) = (sun.east_north_up(), [0.60, -0.33, 0.73]);
    let length = |v: [f64; 3]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
    assert!((length(towards) - 1.0).abs() < 1e-12);
    let cos = (0..3).map(|k| towards[k] * drawn[k]).sum::<f64>() / length(drawn);
    assert!(cos.acos().to_degrees() < 0.5, "{towards:?}");
}

#[test]
fn axes_are_east_north_and_up() {
    let towards = |azimuth: f64, elevation: f64| {
        let sun = SunPosition { azimuth: azimuth.to_radians(), elevation: elevation.to_radians() };
        sun.east_north_up()
    };
    for (sun, expected) in [
        (towards(0.0, 0.0), [0.0, 1.0, 0.0]),
        (towards(90.0, 0.0), [1.0, 0.0, 0.0]),
        (towards(123.0, 90.0), [0.0, 0.0, 1.0]),
        (towards(180.0, -30.0), [0.0, -0.75f64.sqrt(), -0.5]),
    ] {
        assert!((0..3).all(|k| (sun[k] - expected[k]).abs() < 1e-12), "{sun:?} is not {expected:?}");
    }
    // Afternoon in the west, morning in the east.
    assert!(SunPosition::at(50.0, 0.0, 1_717_084_800.0).unwrap().east_north_up()[0] < 0.0);
    assert!(SunPosition::at(50.0, 0.0, 1_717_052_400.0).unwrap().east_north_up()[0] > 0.0);
}

#[test]
fn places_and_times_out_of_range_are_errors() {
    assert_eq!(SunPosition::at(90.1, 0.0, 0.0), Err(SunPositionError::Latitude(90.1)));
    assert_eq!(SunPosition::at(0.0, -180.5, 0.0), Err(SunPositionError::Longitude(-180.5)));
    assert!(matches!(SunPosition::at(f64::NAN, 0.0, 0.0), Err(SunPositionError::Latitude(_))));
    assert!(matches!(SunPosition::at(0.0, f64::NAN, 0.0), Err(SunPositionError::Longitude(_))));
    for time in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e18, -1e18, 4e10, -9e10] {
        assert!(matches!(SunPosition::at(0.0, 0.0, time), Err(SunPositionError::Time(_))), "{time}");
    }
    let error = SunPosition::at(0.0, 0.0, 4e10).unwrap_err().to_string();
    assert_eq!(error, "40000000000 seconds since 1970 is not in the years -500 to 3000");
    for (latitude, longitude) in [(90.0, 180.0), (-90.0, -180.0), (0.0, 0.0)] {
        let sun = SunPosition::at(latitude, longitude, 1.7e9).unwrap();
        assert!(sun.azimuth.is_finite() && sun.elevation.is_finite());
    }
}
