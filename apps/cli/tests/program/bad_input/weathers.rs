//! Weathers that are misspelt, malformed or impossible.

use super::*;

#[test]
fn names_and_files() {
    let place = place();
    fs::create_dir(place.path("folder")).unwrap();
    for (name, says) in [
        ("fogg", "there is no weather `fogg`, did you mean `fog`?; the presets are clear, mist, fog"),
        ("quux", "there is no weather `quux`; the presets are clear, mist, fog"),
        ("missing.toml", "missing.toml: cannot read the weather file: no such file; check the path"),
        ("folder", "folder: cannot read the weather file: "),
        ("good.ply", "good.ply: cannot read the weather file: it is no text in UTF-8 (byte "),
    ] {
        place.render_refused("good.ply", &["--weather", name], &[says]);
    }
}

/// Other faults of files and overrides are tested in `file/tests.rs` and `track/tests.rs` of
/// wm-weather.
#[test]
fn files_have_line_and_column() {
    let place = place();
    for (text, says) in [
        ("\n[fog]\nmor = \"thick\"\n", "w.toml:3:7: fog.mor is `thick`: must be a number from 1"),
        ("fog = 3\n", "w.toml:1:7: fog must be a table: write [fog] and its parameters below"),
        ("[fog]\nmor = 9\n[fog]\nmor = 8\n", "w.toml:3:2: duplicate key"),
        (
            "[fog]\nmor = { keys = [[5, 100], [2, 50]] }\n",
            "w.toml:2:7: fog.mor has a keyframe at time 2 after",
        ),
        ("[fog]\nmor = { keys = [[nan, 100]] }\n", "w.toml:2:7: fog.mor has a keyframe at time NaN"),
        (
            "[fog]\nmor = { keys = [\n  [0, 9, \"holt\"],\n  [1, 8]] }\n",
            "w.toml:3:10: fog.mor has the easing `holt`, did you mean `hold`?; the easings are linear, hold",
        ),
        ("sky = \"cloudy\"\n", "w.toml:1:7: sky must be one of auto, clear, overcast, gradient, or a table"),
        ("[sky]\nheading = \"north\"\n", "w.toml:2:11: sky.heading is `north`: must be a number from"),
        ("[sky]\npanorama = \"gone.png\"\n", "gone.png: there is no such panorama; check sky.panorama"),
        ("[sky]\npanorama = \"good.ply\"\n", "good.ply: is not a readable picture: use PNG, JPEG or EXR"),
    ] {
        place.put("w.toml", text);
        place.render_refused("good.ply", &["--weather", "w.toml"], &[says]);
    }
    place.put("w.toml", "x = ".to_owned() + &"[".repeat(100_000));
    place.render_refused("good.ply", &["--weather", "w.toml"], &["w.toml:1:"]);
}

#[test]
fn overrides() {
    let place = place();
    for (text, says) in [
        ("", "must be effect.parameter=value, as in fog.mor=120"),
        (
            "=",
            "there is no ``; the effects are sky, light, lightning, dust_cover, snow_cover, wetness, flood",
        ),
        ("fog.mor=", "fog.mor is ``: must be a number from 1"),
        ("fog.mor=0", "fog.mor is 0: must be a number from 1"),
        ("fog.mor=nan", "fog.mor is `nan`: must be a number from 1"),
        ("fog.mor=5:50,2:60", "fog.mor has a keyframe at time 2 after one at 5: times must rise"),
        ("fog.mor=0:50,60", "fog.mor has the keyframe `60`: must be time:value"),
        ("fogg.mor=3", "there is no `fogg`, did you mean `fog`?"),
        ("fog.airlight=#12", "must be a colour as \"#rrggbb\""),
        ("sky=cloudy", "sky is auto, clear, overcast, gradient, on or off"),
        ("snow_cover.depth=-1", "snow_cover.depth is -1: must be a number from 0"),
        ("snow_cover.depth=11", "snow_cover.depth is 11: must be a number from 0"),
        ("fidelity=exact", "there is no fidelity `exact`: use physical or paper"),
        ("light.glow=-1", "light.glow is -1: must be a number from 0"),
        ("light.turbidity=0", "light.turbidity is 0: must be a number from 1"),
        ("light=dark", "light is auto, captured, overcast, clear, night, on or off"),
        ("lightning.rate=-3", "lightning.rate is -3: must be a number from 0"),
    ] {
        let named = format!("--set {text}: ");
        place.render_refused("good.ply", &["--set", text], &[&named, says]);
    }
}

#[test]
fn light_that_cannot_be() {
    let place = place();
    let shadows = ["--set", "light.cloud_shadows=on"];
    for (options, says) in [
        (&["--set", "light.model=clear", "--set", "light.hour=12"][..], "light.hour needs a place"),
        (
            &["--set", "light.model=clear", "--set", "light.sun_elevation=-5", shadows[0], shadows[1]],
            "light.cloud_shadows needs a sun: light.sun_elevation is -5 degrees",
        ),
    ] {
        place.render_refused("good.ply", options, &[says]);
    }
    for (lamp, says) in [
        ("lumens = -5", "number 1: its flux is -5 lm"),
        ("kelvin = 20", "20"),
        ("aim = [0, 0, 0]", "number 1"),
        ("beam = 400", "400"),
        ("lumens = nan", "NaN"),
    ] {
        place.put("good.ply.wm.toml", format!("[[lamps]]\nat = [0, 0, 1]\n{lamp}\n"));
        place.render_refused("good.ply", &[], &["good.ply.wm.toml", says]);
    }
}
