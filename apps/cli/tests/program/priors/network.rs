//! The network's priors, with weights that are made up: none are in the program.

use super::*;

#[cfg(not(feature = "nets"))]
#[test]
fn a_build_without_networks_says_so() {
    let desk = desk();
    for options in ["--source network", "--weights x", "--network large --offline"] {
        desk.refused(options, &["this build has no neural networks", "`--features nets`"]);
    }
}

#[cfg(feature = "nets")]
mod with_networks {
    use super::*;
    use std::path::PathBuf;
    use wm_capture::Observation;
    use wm_capture::colmap::write;
    use wm_nets::DepthAnything;
    use wm_nets::depth_anything::Version;
    use wm_scene::SparsePoints;
    use wm_train::photos::{PhotoOptions, Photos};
    use wm_train::priors::SkyClass;

    /// A random network that takes photos of 84 px.
    fn weights() -> PathBuf {
        let fixtures =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../crates/wm-nets/fixtures/depth_anything");
        fixtures.join("v2/model.safetensors")
    }

    fn with(file: &Path, options: &str) -> String {
        format!("--weights {} {options}", file.display())
    }

    #[test]
    fn bad_weights_are_named() {
        let desk = desk();
        let file = weights();
        let bytes = fs::read(&file).unwrap();
        desk.put("cut.safetensors", &bytes[..bytes.len() - 9]);
        let header = br#"{"a":{"dtype":"F32","shape":[1],"data_offsets":[0,4]}}"#;
        let other = [&(header.len() as u64).to_le_bytes()[..], header, &[0; 4]].concat();
        desk.put("other.safetensors", other);
        let zeros = "0".repeat(64);
        let with_file = |name: &str| with(Path::new(name), "");
        let checksum = format!("--checksum {zeros}");
        let absent =
            ["depth-anything-v2-base.safetensors: is not there", "--offline", "huggingface.co", "--weights"];
        for (options, says) in [
            (with_file("x.pth"), &["x.pth: cannot be read: "][..]),
            (with_file("cut.safetensors"), &["cut.safetensors: damaged or cut off", "copy it again"]),
            (with_file("other.safetensors"), &["other.safetensors: no tensors of Depth Anything"]),
            (with(&file, "--version v1"), &["model.safetensors"]),
            (with(&file, "--network large"), &["the network is of no published size, not large"]),
            (with(&file, &checksum), &["model.safetensors: has SHA-256 ", "get it again"]),
            (with(&file, "--checksum 12"), &["--checksum: \"12\" is no SHA-256"]),
            (with(&file, &with(&file, &checksum)), &["--checksum is that of one file"]),
            ("--offline --network base".into(), &absent),
        ] {
            desk.refused(&options, says);
        }
        // One that was fetched earlier is taken, and the checksum holds for it too.
        let small = "cache/weather-magician/depth-anything-v2-small.safetensors";
        desk.put(small, "no weights");
        desk.refused("--offline --network small", &[small, "neither a safetensors file"]);
        desk.refused(&format!("--offline {checksum}"), &[small, "SHA-256"]);
    }

    #[test]
    fn a_network_that_says_nothing_of_the_place_is_left_out() {
        let desk = desk();
        desk.refused(&with(&weights(), ""), &["out: none of 4 photos has a prior; 00000.png: "]);
    }

    /// Points are put where the network sees them, but for a scale and a shift.
    #[test]
    fn what_the_network_says_is_fitted_to_points() {
        const SCALE_AND_SHIFT: (f64, f64) = (0.3, 1.0);
        let desk = desk();
        desk.photos("set", &DatasetOptions { size: (84, 84), count: 3, ..PHOTOS });
        let mut made = capture(&desk.path("set"));
        let photos = Photos::open(&made, &PhotoOptions::default()).unwrap();
        let network = DepthAnything::read(&[weights()], Version::V2).unwrap();
        (made.points, made.observations) = (SparsePoints::default(), vec![Vec::new(); 3]);
        let mut largest = 0.0f64;
        for place in 0..3 {
            let photo = photos.get(place, 0).unwrap();
            let disparity = network.predict(&photo.rgb_f32(), 84).unwrap();
            assert_eq!((disparity.width, disparity.height), (84, 84));
            let most = disparity.values.iter().copied().fold(0.0f32, f32::max);
            for pixel in (0..84 * 84).step_by(11) {
                let value = f64::from(disparity.values[pixel]);
                if value < 0.1 * f64::from(most) {
                    continue;
                }
                let (x, y) = ((pixel % 84) as f64 + 0.5, (pixel / 84) as f64 + 0.5);
                let z = 1.0 / (SCALE_AND_SHIFT.0 * value + SCALE_AND_SHIFT.1);
                let ray = photo.camera.ray(x, y);
                let at = photo.camera.center() + ray * (z / ray.dot(photo.camera.forward()));
                let point = made.points.len() as u32;
                made.points.push(at.to_array(), [128; 3], 0.0, 1);
                made.observations[place].push(Observation { point, xy: [x as f32, y as f32] });
            }
            largest = largest.max(f64::from(most));
        }
        assert!(largest > 0.0 && made.points.len() > 100, "{largest} {}", made.points.len());
        write::write(&made, &desk.path("set/sparse/0"), ColmapStorage::Binary).unwrap();
        succeeds(&mut command_on_set(&desk, &with(&weights(), "")));
        let priors = Priors::open(&desk.path("set/priors")).unwrap().unwrap();
        assert!(priors.index().source.starts_with("network: Depth Anything V2"), "{}", priors.index().source);
        for place in 0..3 {
            let view = &made.views[place];
            let fit = priors.index().photos[&view.name].fit.unwrap();
            assert!(
                (fit.scale / SCALE_AND_SHIFT.0 - 1.0).abs() < 1e-3
                    && (fit.shift / SCALE_AND_SHIFT.1 - 1.0).abs() < 0.01,
                "{fit:?}"
            );
            let prior = priors.get(&view.name, &view.camera).unwrap().unwrap();
            let photo = photos.get(place, 0).unwrap();
            let said = network.predict(&photo.rgb_f32(), 84).unwrap();
            for ((found, said), class) in prior.disparity.iter().zip(&said.values).zip(&prior.sky) {
                let expected = SCALE_AND_SHIFT.0 * f64::from(*said) + SCALE_AND_SHIFT.1;
                let is_off = (f64::from(*found) / expected - 1.0).abs() > 0.01;
                assert!(*class == SkyClass::Sky || !is_off, "{found} {expected}");
            }
        }
    }
}
