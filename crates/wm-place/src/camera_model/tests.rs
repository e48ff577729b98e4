use super::*;
use crate::{FrameCamera, FrameRequest, Layers};
use crate::{PreparedPlace, Renderer};

/// The built-in street, thinned, and a camera on it.
fn street() -> (Renderer, PreparedPlace, Camera) {
    let scene = wm_street::Street::builtin().sampling(0.06).scene(&|_| true).unwrap();
    let mut renderer = Renderer::cpu().unwrap();
    let place = renderer.load(scene).unwrap();
    let view = Camera::look_at([4.0, -20.0, 1.8], [4.0, -30.0, 1.6]).size(120, 80);
    let camera = FrameCamera::from(view).at(0.0, &place).unwrap().camera;
    (renderer, place, camera)
}

/// A picture with depth and particles.
fn request<'a>(weather: &'a Weather, camera: impl Into<FrameCamera<'a>>, time: f64) -> FrameRequest<'a> {
    let layers = Layers::COLOR | Layers::DEPTH | Layers::PARTICLES;
    FrameRequest { layers, ..FrameRequest::new(weather, camera, time) }
}

fn psnr(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    let square: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / a.len() as f64;
    -10.0 * square.max(1e-20).log10()
}

/// Each line of a rolling shutter is that of a whole picture that was taken where the camera was
/// then.
#[test]
fn lines_of_a_rolling_shutter_are_those_of_pictures_of_their_times() {
    let (mut renderer, mut place, camera) = street();
    let weather = Weather::preset("heavy-rain").unwrap();
    let metres = place.site().metres_per_unit;
    for first in [ReadoutSide::Top, ReadoutSide::Bottom, ReadoutSide::Left, ReadoutSide::Right] {
        let shutter = Shutter { exposure: 0.0, readout: 0.03, first };
        let model = CameraModel { shutter, ..CameraModel::default() };
        let motion = CameraMotion::Still { camera: Box::new(camera), speed: 50.0 / 3.6 };
        let sensor = SensorCamera::new(model, motion);
        let picture = renderer.render(&mut place, &request(&weather, &sensor, 2.0)).unwrap();
        let lines = shutter.lines([120, 80]);
        let steps = shutter.steps(sensor.speed(2.0, metres), lines);
        assert!(steps.count > 5, "{}", steps.count);
        for step in [0, steps.count / 2, steps.count - 1] {
            let whole = sensor.at(2.0, steps.time(step), metres);
            assert!(
                (whole.camera.center() - camera.center()).length() * metres > 0.4 * 13.8 * steps.time(step)
            );
            let alone = request(&weather, whole, 2.0 + steps.time(step));
            let alone = renderer.render(&mut place, &alone).unwrap();
            let rect = shutter.rect([120, 80], &steps.lines(step));
            let of = |array: &[f32], n: usize| -> Vec<f32> {
                let row = |y: u32| {
                    let at = n * (y * 120 + rect.at[0]) as usize;
                    array[at..at + n * rect.size[0] as usize].to_vec()
                };
                (rect.at[1]..rect.at[1] + rect.size[1]).flat_map(row).collect()
            };
            // The same picture but for rounding: its pixels have other coordinates.
            let db = psnr(&of(&picture.frame.rgb, 3), &of(&alone.frame.rgb, 3));
            assert!(db > 60.0, "{first:?}, step {step}: {db:.1} dB");
            assert!(psnr(&of(&picture.frame.depth, 1), &of(&alone.frame.depth, 1)) > 40.0);
        }
    }
}

/// The blur of a moving camera is the mean of sharp pictures, and what falls is as bright over all
/// steps as in one.
#[test]
fn exposures_are_means_of_instants() {
    let (mut renderer, mut place, camera) = street();
    let metres = place.site().metres_per_unit;
    let mut weather = Weather::clear();
    let shutter = Shutter { exposure: 0.02, ..Shutter::default() };
    let model = CameraModel { shutter, ..CameraModel::default() };
    let motion = CameraMotion::Still { camera: Box::new(camera), speed: 14.0 };
    let sensor = SensorCamera::new(model, motion);
    let picture = renderer.render(&mut place, &request(&weather, &sensor, 0.5)).unwrap();
    let mut mean = vec![0.0f64; picture.frame.rgb.len()];
    let count = 64;
    for k in 0..count {
        let after = (f64::from(k) + 0.5) / f64::from(count) * 0.02 - 0.01;
        let one = request(&weather, sensor.at(0.5, after, metres), 0.5 + after);
        let one = renderer.render(&mut place, &one).unwrap();
        one.frame
            .rgb_linear()
            .iter()
            .zip(&mut mean)
            .for_each(|(v, sum)| *sum += f64::from(*v) / f64::from(count));
    }
    let mean: Vec<f32> = mean.iter().map(|v| srgb_encode(*v) as f32).collect();
    let db = psnr(&picture.frame.rgb, &mean);
    assert!(db > 38.0, "{db:.1} dB");
    // Rain over steps covers as much as rain in one exposure.
    weather.set_text("rain.rate=50").unwrap();
    weather.set_text("rain.exposure=0.02").unwrap();
    let covered = |picture: &Picture| -> f64 {
        picture.frame.particles.as_chunks::<4>().0.iter().map(|p| f64::from(p[3])).sum()
    };
    let over_steps = covered(&renderer.render(&mut place, &request(&weather, &sensor, 0.5)).unwrap());
    let still = request(&weather, sensor.at(0.5, 0.0, metres), 0.5);
    let once = covered(&renderer.render(&mut place, &still).unwrap());
    // In a step a drop that stands in a pixel is not quite opaque: 4 to 7 % of coverage, by larger
    // pictures; these show few drops.
    assert!((over_steps / once - 0.95).abs() < 0.1, "{over_steps} against {once}");
}

#[test]
fn plain_models_change_no_byte() {
    let (mut renderer, mut place, camera) = street();
    let weather = Weather::preset("fog").unwrap();
    let sensor = SensorCamera::new(CameraModel::default(), CameraMotion::from(camera));
    let by_model = FrameRequest { index: 3, ..FrameRequest::new(&weather, &sensor, 1.0) };
    let by_model = renderer.render(&mut place, &by_model).unwrap();
    let plain = renderer.render(&mut place, &FrameRequest::new(&weather, camera, 1.0)).unwrap();
    assert_eq!(by_model.frame, plain.frame);
}

/// Automatic exposures make a dark evening as bright on average as grey, and one more stop is twice
/// the light.
#[test]
fn exposures_change_the_light() {
    let (mut renderer, mut place, camera) = street();
    let mut weather = Weather::clear();
    weather.set_text("light.exposure=-2").unwrap();
    let mut take = |exposure: CameraExposure| {
        let model = CameraModel { exposure, ..CameraModel::default() };
        let sensor = SensorCamera::new(model, CameraMotion::from(camera));
        renderer.render(&mut place, &FrameRequest::new(&weather, &sensor, 1.0)).unwrap().frame
    };
    let mean = exposure::log_mean(&take(CameraExposure::Auto)).exp();
    assert!((mean / 0.18 - 1.0).abs() < 0.1, "{mean}");
    let (plain, brighter) =
        (take(CameraExposure::Stops(0.0)).rgb_linear(), take(CameraExposure::Stops(1.0)).rgb_linear());
    let worst = plain.iter().zip(&brighter).map(|(a, b)| (2.0 * a.max(0.0) - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-5, "{worst}");
}

#[test]
fn models_that_cannot_work_are_refused() {
    let fault = |model: CameraModel, weather: &str| {
        model.check(&Weather::preset(weather).unwrap()).unwrap_err().to_string()
    };
    let readout = |readout: f64| CameraModel {
        shutter: Shutter { readout, ..Shutter::default() },
        ..CameraModel::default()
    };
    assert!(fault(readout(-1.0), "heavy-rain").contains("readout is -1 s"));
    assert!(fault(readout(f64::NAN), "heavy-rain").contains("readout"));
    let noise = SensorNoise { iso: 0.0, ..SensorNoise::default() };
    let noisy = CameraModel { noise: Some(noise), ..CameraModel::default() };
    assert!(fault(noisy, "heavy-rain").contains("ISO is 0"));
    let (wide, round) = LensModel::fisheye((64, 64), 180.0).unwrap();
    let narrow = LensModel::Perspective(wm_scene::camera::Distortion::of([-0.1, 0.02, 0.0, 0.0, 0.0]));
    let bent = Camera { fx: 60.0, fy: 60.0, ..round };
    let through = |lens: LensModel, camera: &Camera| CameraModel {
        lens: Some(LensView::new(lens, camera).unwrap()),
        ..CameraModel::default()
    };
    let [wide, narrow] = [through(wide, &round), through(narrow, &bent)];
    for (model, set, says) in [
        (&readout(0.01), "lens.size=1", Some("need the whole picture at once")),
        (&wide, "lens.size=1", Some("drawn for pinholes only")),
        (&narrow, "lens.size=1", Some("drawn for pinholes only")),
        (&wide, "glare.scatter=1", Some("glare is drawn for lenses below 112 degrees only")),
        (&narrow, "glare.scatter=1", None),
        (&readout(0.01), "glare.scatter=1", None),
        (&CameraModel::default(), "lens.size=1", None),
    ] {
        let mut weather = Weather::clear();
        weather.set_text(set).unwrap();
        let found = model.check(&weather).map_err(|error| error.to_string());
        let is_right = match says {
            Some(says) => found.as_ref().is_err_and(|found| found.contains(says)),
            None => found.is_ok(),
        };
        assert!(is_right, "{set}: {found:?}");
    }
}
