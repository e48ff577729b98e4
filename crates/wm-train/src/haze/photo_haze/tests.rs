use super::*;
use crate::haze::sightings::Sighting;
use wm_base::random::uniform;

/// Points along a road as photos from a car show them.
struct Road {
    /// Extinction a unit, 0 for clear air.
    extinction: f64,
    /// Standard deviation of the logarithms of exposures.
    exposures: f64,
    /// Share of sightings of something else.
    strays: f64,
    seed: u64,
}

const PHOTOS: usize = 24;
const AIRLIGHT: [f64; 3] = [0.7, 0.74, 0.78];

/// A number of mean 0 and standard deviation 1.
fn normal(seed: u64, index: u64) -> f64 {
    2f64.sqrt() * ((0..6).map(|k| uniform(1000 * seed + k, index)).sum::<f64>() - 3.0)
}

impl Road {
    fn number(&self, kind: u64, index: usize) -> f64 {
        uniform(self.seed * 100 + kind, index as u64)
    }

    /// The tracks, and the positions of their points.
    fn tracks(&self) -> (Vec<PointTrack>, Vec<[f64; 3]>) {
        let positions: Vec<[f64; 3]> = (0..900)
            .map(|i| {
                let side = if self.number(0, i) < 0.5 { -6.0 } else { 6.0 };
                [side, 160.0 * self.number(1, i), 8.0 * self.number(2, i)]
            })
            .collect();
        let track = |point: usize| {
            let clear = [3, 4, 5].map(|kind| 0.02 + 0.6 * self.number(kind, point).powi(2));
            let sighting = |photo: usize| {
                let index = PHOTOS * point + photo;
                let along = positions[point][1] - 5.0 * photo as f64;
                if !(4.0..70.0).contains(&along) || self.number(6, index) < 0.3 {
                    return None;
                }
                let distance = (along * along + 36.0 + positions[point][2].powi(2)).sqrt();
                let kept = (-self.extinction * distance).exp();
                let gain = (self.exposures * normal(self.seed + 7, photo as u64)).exp();
                let is_stray = self.number(8, index) < self.strays;
                let light = std::array::from_fn(|c| {
                    let light = gain * (clear[c] * kept + AIRLIGHT[c] * (1.0 - kept));
                    let light = if is_stray { self.number(9 + c as u64, index) } else { light };
                    let shown = srgb_encode(light) + 0.01 * normal(self.seed + 12 + c as u64, index as u64);
                    srgb_decode(shown.clamp(0.0, 1.0)) as f32
                });
                Some(Sighting { photo: photo as u32, distance: distance as f32, light })
            };
            PointTrack { point: point as u32, sightings: (0..PHOTOS).filter_map(sighting).collect() }
        };
        let tracks = (0..positions.len()).map(track).filter(|track| track.sightings.len() > 1).collect();
        (tracks, positions)
    }

    fn evidence(&self) -> Evidence {
        let (tracks, positions) = self.tracks();
        Evidence::of(tracks, &positions, PHOTOS, KnownHaze::default()).unwrap()
    }
}

#[test]
fn haze_is_measured_beside_strays_and_exposures() {
    for (extinction, exposures, strays, seed) in [(0.03, 0.0, 0.0, 1), (0.02, 0.1, 0.05, 2)] {
        let road = Road { extinction, exposures, strays, seed };
        let found = road.evidence();
        assert!(found.proves(), "{found:?}");
        let haze = found.haze;
        let off = haze.extinction / extinction - 1.0;
        assert!(off.abs() < 0.15 && haze.error.unwrap() < 0.1 * extinction, "{off}: {found:?}");
        // Exposures have a mean of their own.
        for c in 0..3 {
            assert!((haze.airlight[c] / AIRLIGHT[c] - 1.0).abs() < 0.15, "{found:?}");
        }
    }
}

#[test]
fn light_of_the_horizon_is_kept() {
    let (tracks, positions) = Road { extinction: 0.01, exposures: 0.1, strays: 0.05, seed: 9 }.tracks();
    let known = KnownHaze { airlight: Some(AIRLIGHT), ..KnownHaze::default() };
    let found = Evidence::of(tracks, &positions, PHOTOS, known).unwrap();
    let haze = found.haze;
    assert!(found.proves() && (0..3).all(|c| (haze.airlight[c] - AIRLIGHT[c]).abs() < 1e-9), "{found:?}");
    assert!((haze.shown / 0.01 - 1.0).abs() < 0.08, "{found:?}");
}

#[test]
fn the_error_covers_a_camera_that_compresses_bright_light() {
    let (mut tracks, positions) = Road { extinction: 0.02, exposures: 0.0, strays: 0.02, seed: 11 }.tracks();
    let compressed = |v: f64| if v < 0.45 { v } else { 0.45 + 0.4 * (1.0 - (-(v - 0.45) / 0.4).exp()) };
    for light in tracks.iter_mut().flat_map(|track| &mut track.sightings).flat_map(|seen| &mut seen.light) {
        *light = compressed(f64::from(*light)) as f32;
    }
    let known = KnownHaze { airlight: Some(AIRLIGHT.map(compressed)), ..KnownHaze::default() };
    let haze = Evidence::of(tracks, &positions, PHOTOS, known).unwrap().haze;
    let error = haze.error.unwrap();
    assert!((haze.extinction - 0.02).abs() < 2.5 * error && error < 0.004, "{haze:?}");
}

#[test]
fn clear_air_is_no_haze() {
    for (exposures, strays, seed) in [(0.0, 0.0, 4), (0.1, 0.05, 5)] {
        let found = Road { extinction: 0.0, exposures, strays, seed }.evidence();
        assert!(!found.proves(), "{found:?}");
    }
}

#[test]
fn a_measurement_is_the_same_for_any_number_of_threads() {
    let road = Road { extinction: 0.02, exposures: 0.1, strays: 0.05, seed: 6 };
    let of = |threads| wm_render::cpu::pool(threads).unwrap().install(|| road.evidence());
    assert_eq!(of(1), of(3));
}

#[test]
fn known_haze_keeps_its_extinction_and_finds_its_light() {
    let (tracks, positions) = Road { extinction: 0.02, exposures: 0.1, strays: 0.05, seed: 7 }.tracks();
    let haze = Evidence::of(tracks, &positions, PHOTOS, KnownHaze { extinction: Some(0.02), airlight: None })
        .unwrap()
        .haze;
    assert!((haze.extinction - 0.02).abs() < 1e-12 && haze.error.is_none());
    assert!((0..3).all(|c| (haze.airlight[c] / AIRLIGHT[c] - 1.0).abs() < 0.15), "{haze:?}");
}

#[test]
fn few_points_tell_nothing() {
    let (mut tracks, positions) = Road { extinction: 0.02, exposures: 0.0, strays: 0.0, seed: 8 }.tracks();
    tracks.truncate(100);
    assert_eq!(Evidence::of(tracks, &positions, PHOTOS, KnownHaze::default()), None);
}

#[test]
fn colors_lose_their_haze_and_what_is_hidden_stays_sound() {
    let haze = PhotoHaze { extinction: 0.01, error: None, shown: 0.01, airlight: AIRLIGHT };
    let clear = [40u8, 120, 200];
    for distance in [0.0, 30.0, 80.0] {
        let kept = haze.transmittance(distance);
        let shown = std::array::from_fn(|c| {
            let light = srgb_decode(f64::from(clear[c]) / 255.0) * kept + AIRLIGHT[c] * (1.0 - kept);
            (255.0 * srgb_encode(light)).round() as u8
        });
        let found = haze.clear_color(shown, kept);
        assert!((0..3).all(|c| found[c].abs_diff(clear[c]) < 12), "{distance}: {found:?}");
    }
    let white = haze.clear_color([255; 3], 1e-6);
    assert!(white.iter().all(|v| *v == 255));
}
