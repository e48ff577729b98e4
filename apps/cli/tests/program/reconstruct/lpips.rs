//! LPIPS of the held-out photos: with weights that are made up here, since none are in the program.

use super::*;

#[cfg(not(feature = "nets"))]
#[test]
fn a_build_without_networks_says_so() {
    let place = place();
    let says = ["--lpips: this build has no neural networks", "`--features nets`"];
    place.untrained("set", &["--lpips", "x"], &says);
}

#[cfg(feature = "nets")]
mod with_networks {
    use super::*;
    use serde_json::Value;

    /// AlexNet in one file and the heads in another, with numbers that keep what goes through
    /// alive.
    fn put_weights(place: &Workshop) {
        let (heads, network): (Vec<_>, Vec<_>) =
            wm_nets::lpips::tensors().into_iter().partition(|(name, _)| name.starts_with("lin"));
        for (file, tensors) in [("alexnet.safetensors", network), ("heads.safetensors", heads)] {
            let (mut header, mut numbers) = (serde_json::Map::new(), Vec::<u8>::new());
            for (name, shape) in tensors {
                let from = numbers.len();
                let scale = (6.0 / shape[1..].iter().product::<usize>() as f32).sqrt();
                for index in 0..shape.iter().product::<usize>() as u32 {
                    // Bits that look random, as a number in 0-1.
                    let mixed = index.wrapping_mul(0x9E37_79B9);
                    let unit =
                        ((mixed ^ (mixed >> 15)).wrapping_mul(0x85EB_CA6B) >> 8) as f32 / 2f32.powi(24);
                    let value = if file.starts_with("heads") { unit } else { (2.0 * unit - 1.0) * scale };
                    numbers.extend(value.to_le_bytes());
                }
                let entry = serde_json::json!({ "dtype": "F32", "shape": shape, "data_offsets": [from, numbers.len()] });
                header.insert(name, entry);
            }
            let header = serde_json::to_vec(&header).unwrap();
            place.put(file, [&(header.len() as u64).to_le_bytes(), &header[..], &numbers].concat());
        }
    }

    /// LPIPS in each line of the metrics that has held-out photos.
    fn measured(place: &Workshop) -> Vec<Option<f64>> {
        let text = String::from_utf8(place.read("scene.ply.run/metrics.jsonl")).unwrap();
        let lines = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        let held_out = lines.filter_map(|line| line.get("held_out").cloned());
        held_out.map(|held_out| held_out.get("lpips").map(|lpips| lpips.as_f64().unwrap())).collect()
    }

    /// The numbers behind LPIPS in what is printed.
    fn told(output: &Output) -> Vec<f64> {
        let printed = printed(output);
        let after = printed.lines().filter(|line| line.starts_with("held-out "));
        after.filter_map(|line| Some(line.split_once(", LPIPS ")?.1.parse().unwrap())).collect()
    }

    #[test]
    fn the_report_has_it_where_weights_are_given() {
        let place = place();
        put_weights(&place);
        let hold_out = ["--eval-every", "3"];
        let without = place.trained(&hold_out);
        assert!(!printed(&without).contains("LPIPS"), "{}", printed(&without));
        let scene = place.read("scene.ply");
        assert_eq!(measured(&place), [None; 10]);

        let weights = ["--lpips", "alexnet.safetensors", "--lpips", "heads.safetensors"];
        let first = place.trained(&[&hold_out[..], &weights, &["--overwrite"]].concat());
        let [one, two, mean] = told(&first)[..] else { panic!("{}", printed(&first)) };
        assert!(one > 0.0 && two > 0.0 && (mean - (one + two) / 2.0).abs() < 1.1e-4, "{one} {two} {mean}");
        let lines = measured(&place);
        assert_eq!(lines[..9], [None; 9]);
        assert!((lines[9].unwrap() - mean).abs() < 0.51e-4, "{lines:?} {mean}");
        // Measuring changes nothing.
        assert!(place.read("scene.ply") == scene);

        // A training that is done is measured again, with weights or without.
        let again = place.trained(&[&hold_out[..], &weights, &["--resume"]].concat());
        assert_eq!((told(&again), measured(&place)), (told(&first), lines));
        assert!(told(&place.trained(&[&hold_out[..], &["--resume"]].concat())).is_empty());
        assert_eq!(measured(&place), [None; 10]);
    }

    #[test]
    fn weights_that_are_none_are_refused_before_the_training() {
        let place = place();
        put_weights(&place);
        place.put("empty", "");
        place.put("text", "no weights, but a text");
        place.put("cut", &place.read("alexnet.safetensors")[..100_000]);
        for (file, says) in [
            ("none", "cannot be read: "),
            ("set", "cannot be read: it is no file"),
            ("empty", "the file is empty"),
            ("text", "neither a safetensors file nor one of PyTorch"),
            ("cut", "damaged or cut off ("),
            ("heads.safetensors", "no tensor features.0.weight of shape [64, 3, 11, 11]; "),
            ("alexnet.safetensors", "no tensor lin0.model.1.weight of shape [1, 64, 1, 1]; "),
        ] {
            let says = format!("{file}: {says}");
            place.untrained("set", &["--lpips", file, "--eval-every", "3"], &[&says]);
        }
        let both = ["--lpips", "alexnet.safetensors", "--lpips", "heads.safetensors"];
        place.untrained("set", &both, &["none are held out; give --eval-every too"]);
        let small = [&both[..], &["--eval-every", "3", "--longest", "40"]].concat();
        place.untrained("set", &small, &["00000.png: 40x27 px is too small for --lpips, which needs 31"]);
    }
}
