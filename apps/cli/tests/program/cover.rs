//! Tests lying snow through the commands `render` and `bake`: it grows frame by frame, any frame
//! alone is the same, and `bake` writes what `render` shows.

use crate::common::*;

const SIZE: (u32, u32) = (120, 80);

/// Mean light of a picture's lower half.
fn ground(picture: &Image<[u8; 3]>) -> f64 {
    let light = light_of(picture);
    let lower = &light.pixels[light.pixels.len() / 2..];
    lower.iter().map(|rgb| rgb[1]).sum::<f64>() / lower.len() as f64
}

#[test]
fn snow_grows_and_every_frame_is_the_same_alone() {
    let yard = Shot::yard(SIZE);
    let clear = yard.png("");
    let weather = "--set snow_cover.depth=0:0,2:0.2";
    let folder = yard.render("all", &format!("{weather} --seconds 2 --fps 4 --threads 1"));
    let frame = |k: usize| read_png(&folder.join(format!("{k:05}.png")));
    // Nothing lies at a depth of 0, nor before the first keyframe.
    assert!(frame(0) == clear);
    assert!(yard.png(&format!("{weather} --time -5")) == clear);
    let light: Vec<f64> = (0..8).map(|k| ground(&frame(k))).collect();
    println!("{light:.3?}");
    assert!(light.windows(2).all(|pair| pair[1] > pair[0] - 0.01) && light[7] > light[0] + 0.1, "{light:?}");
    for (k, threads) in [(3, 2), (7, 5)] {
        let options = format!("{weather} --time {} --threads {threads}", f64::from(k) / 4.0);
        assert!(yard.png(&options) == frame(k as usize), "{k}");
    }
}

#[test]
fn what_is_baked_is_what_is_rendered() {
    let yard = Shot::yard(SIZE);
    let paper = "snow_cover.depth=0.1 --set fidelity=paper";
    for asked in ["snow_cover.depth=0.1", "dust_cover.depth=0.05", paper] {
        let live = yard.png(&format!("--set {asked}"));
        yard.run(&format!("bake yard.ply --set {asked} --overwrite -o baked.ply"));
        let again = read_png(&(*yard).render(&yard.path("baked.ply"), &yard.view, "again.png", ""));
        let pairs = live.pixels.as_flattened().iter().zip(again.pixels.as_flattened());
        let psnr = psnr(pairs.map(|(a, b)| BYTE_STEP * (f64::from(*a) - f64::from(*b))));
        println!("{asked}: {psnr:.1} dB");
        assert!(psnr > 45.0, "{asked}: {psnr} dB");
    }
}

/// The paper has no dust: the physical one lies under its rain as well.
#[test]
fn dust_lies_under_the_papers_rain() {
    let yard = Shot::yard(SIZE);
    let light =
        |options: &str| ground(&yard.png(&format!("--set fidelity=paper --set rain.rate=5 {options}")));
    let (bare, dust) = (light(""), light("--set dust_cover.depth=0.1 --set dust_cover.color=#ffffff"));
    assert!(dust > bare + 0.05, "{dust} {bare}");
}

/// Snow lies on sand, and where it is gone the sand is seen as if there had been none.
#[test]
fn sand_is_seen_where_no_snow_is() {
    let yard = Shot::yard(SIZE);
    let shown = |options: &str| {
        yard.png(&format!("--set dust_cover.depth=0.05 --set dust_cover.color=#400000 {options}"))
    };
    let sand = shown("");
    assert!(shown("--set snow_cover.depth=0") == sand);
    let thaw = "--set snow_cover.depth=0.03 --set snow_cover.temperature=6 --set snow_cover.lapse=3600";
    assert!(shown(&format!("{thaw} --time 200")) == sand);
    let [bare, thin, deep] =
        [sand, shown("--set snow_cover.depth=0.004"), shown("--set snow_cover.depth=0.2")]
            .map(|picture| ground(&picture));
    println!("{bare:.3} {thin:.3} {deep:.3}");
    // Colours mix as they are encoded, so that half cover of white on dark is a tenth of its light.
    assert!(thin > bare + 0.02 && deep > thin + 0.05, "{bare} {thin} {deep}");
}

#[test]
fn there_must_be_something_to_bake() {
    let workshop = Workshop::with("", &[]);
    workshop.scene("yard", yard().build(), &yard_metadata(1.0));
    for (words, says) in [
        ("none.ply", "nothing lies under the weather clear at 0 s"),
        ("none.ply --set snow_cover.depth=0", "nothing lies under the weather"),
        ("none.obj --set snow_cover=on", "use .ply, .compressed.ply, .spz,"),
    ] {
        workshop.refused(&format!("bake yard.ply -o {words}"), &[says]);
    }

    // Deeper than all, and before the start.
    let words = |depth: f64| format!("bake yard.ply --set snow_cover.depth={depth} --time -100 -o deep.ply");
    workshop.run(&words(10.0));
    workshop.refused(&words(10.1), &["snow_cover.depth"]);
}

/// Snow that has fallen since the start lies, and melts; and time before the start is no error.
#[test]
fn snow_falls_lies_and_melts() {
    let yard = Shot::yard(SIZE);
    let light = |time: f64| {
        let sets = "--set snowfall.rate=0:3,4:3,4.1:0 --set snowfall.opacity=0 --set snow_cover.depth=auto \
                    --set snow_cover.hours=1 --set snow_cover.lapse=3600 \
                    --set snow_cover.temperature=0:-2,5:-2,6:9";
        ground(&yard.png(&format!("{sets} --time {time}")))
    };
    let [before, start, snow, thaw, bare] = [-3.0, 0.0, 4.0, 13.0, 60.0].map(light);
    println!("{before:.3} {start:.3} {snow:.3} {thaw:.3} {bare:.3}");
    assert!(before < start && start <= snow + 0.01 && thaw < snow && (bare - before).abs() < 0.02);
}
