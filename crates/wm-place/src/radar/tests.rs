use super::*;
use crate::testing::street;

#[test]
fn rain_dims_a_street_and_adds_its_own_detections() {
    let mut renderer = Renderer::cpu().unwrap();
    let (mut place, camera) = street(&mut renderer);
    let motion = CameraMotion::Still { camera: Box::new(camera), speed: 10.0 };
    // The preset with fewer cells of velocity.
    let preset = RADAR_PRESETS.iter().find(|(name, _)| *name == "mid-range-77").unwrap().1;
    let radar =
        RadarModel::parse(&preset.replace("velocity_cell = 0.12", "velocity_cell = 0.5"), "test").unwrap();
    assert_eq!(radar.cells()[2], 160);
    let options = RadarScanOptions { seed: 3, ..RadarScanOptions::default() };
    let mut scan = |rain: f64, options: &RadarScanOptions, sweeps: u32| {
        let weather = Weather::clear().set("rain.rate", rain).unwrap();
        let mut made = Vec::new();
        let mut take = |sweep| {
            made.push(sweep);
            Ok(())
        };
        let count =
            renderer.scan_radar(&mut place, &weather, &radar, &motion, options, sweeps, &mut take, &mut ());
        assert_eq!([count.unwrap(), sweeps], [made.len() as u32; 2]);
        made
    };
    let clear = scan(0.0, &options, 2);
    let surfaces = clear[0].count(RadarClass::Surface);
    assert!(surfaces > 30 && clear[0].count(RadarClass::Rain) == 0, "{surfaces}");
    // What stands is still over the ground, and comes nearer ahead.
    for one in clear[0].detections.iter().filter(|one| one.class == RadarClass::Surface && one.snr > 20.0) {
        assert!(one.ground_velocity.abs() < 0.5, "{one:?}");
        assert!((one.velocity + 10.0 * one.azimuth.cos() * one.elevation.cos()).abs() < 0.5, "{one:?}");
    }
    let rain = scan(100.0, &options, 1);
    assert!(rain[0].count(RadarClass::Rain) > 0);
    // 100 mm/h take 58 dB from a kilometre there and back.
    let far = |sweep: &RadarSweep| -> [f64; 2] {
        let surfaces =
            sweep.detections.iter().filter(|one| one.class == RadarClass::Surface && one.range > 15.0);
        let powers = surfaces.map(|one| (f64::from(one.range), 10f64.powf(0.1 * f64::from(one.rcs))));
        powers.fold([0.0; 2], |[sum, by_range], (range, power)| [sum + power, by_range + range * power])
    };
    let [[before, by_range], [after, _]] = [far(&clear[0]), far(&rain[0])];
    let (metres, loss) = (by_range / before, 10.0 * (before / after).log10());
    println!("{loss:.2} dB at {metres:.1} m");
    assert!((loss / (0.0584 * metres) - 1.0).abs() < 0.3, "{loss} dB at {metres} m");
    // A later sweep is the same when made alone.
    let alone = scan(0.0, &RadarScanOptions { index: 1, ..options }, 1);
    assert!(alone[0] == clear[1] && alone[0] != clear[0]);
    for (view, _) in RadarView::ALL {
        let picture = view.draw(&rain[0]);
        assert_eq!(picture.rgb.len(), 3 * picture.size.pixels());
    }
}
