//! A training that is run again gives the same bytes.

use super::*;

#[test]
fn any_number_of_threads() {
    let place = place();
    for strategy in ["mcmc", "adaptive"] {
        let mut config = restless(strategy, 40);
        config.exposure = wm_train::config::ExposureMode::Photo;
        place.configure("a.json", &config);
        for threads in ["1", "2", "7"] {
            let out = format!("{strategy}-{threads}.ply");
            place.trained(&["--config", "a.json", "--threads", threads, "--out", &out]);
            let first = format!("{strategy}-1.ply");
            assert!(place.read(&out) == place.read(&first), "{out} differs from {first}");
        }
    }
    assert!(place.read("mcmc-1.ply") != place.read("adaptive-1.ply"));
}

#[test]
fn the_options_and_the_configuration_they_make() {
    let place = place();
    let options = ["--exposure", "shared", "--background", "black", "--densify", "fixed", "--seed", "7"];
    place.trained(&options);
    assert_eq!(place.metrics("scene.ply.run").len(), 40);
    place.trained(&["--config", "scene.ply.run/config.json", "--out", "b.ply", "--steps", "3"]);
    assert!(place.read("b.ply") == place.read("scene.ply"));
    assert_eq!(place.read("b.ply.run/config.json"), place.read("scene.ply.run/config.json"));
    let other = ["--exposure", "shared", "--background", "black", "--densify", "fixed", "--seed", "8"];
    place.trained(&[&other[..], &["--out", "c.ply"]].concat());
    assert!(place.read("c.ply") != place.read("scene.ply"), "the seed changes nothing");
}

/// Photos come and go in a cache that holds few of them.
#[test]
fn any_size_of_the_cache() {
    let place = place_with(&DatasetOptions { size: (330, 220), count: 5, ..PHOTOS });
    for (cache, out) in [("1", "small.ply"), ("64", "large.ply")] {
        place.trained(&["--cache", cache, "--steps", "8", "--out", out]);
    }
    assert!(place.read("small.ply") == place.read("large.ply"));
}
