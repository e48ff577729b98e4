use super::*;
use crate::testing::{self, on_threads};
use glam::DQuat;
use wm_base::random::uniform;
use wm_scene::synthetic::{Builder, moved};

const SITE: Site = Site { airlight: [0.7; 3], far: 60.0, ..testing::SITE };

impl Default for PaperCover {
    fn default() -> Self {
        let weather = testing::weather(["fidelity=paper", "snow_cover=on"]);
        weather.at(0.0).prepare(&SITE).paper_cover.unwrap()
    }
}

fn snow(splats: &Splats) -> Splats {
    PaperCover::default().snow(splats, &SITE)
}

/// A surface of 5 m by 5 m, as Builder scatters it: splats every 0.1 m.
fn plain(u: DVec3, v: DVec3) -> Splats {
    let mut builder = Builder::new(3);
    builder.surface(DVec3::ZERO, 5.0 * u, 5.0 * v, 0.1, |_, _| [0.4; 3]);
    builder.build()
}

fn flat(at: [f32; 3]) -> Splat {
    Splat {
        mean: at,
        quat: [1.0, 0.0, 0.0, 0.0],
        log_scale: [0.05f32.ln(), 0.05f32.ln(), 0.005f32.ln()],
        logit_opacity: 3.0,
        rgb: [0.4; 3],
        group: Group::Scene,
    }
}

fn of(splats: impl IntoIterator<Item = Splat>) -> Splats {
    let mut all = Splats::with_capacity(0, 0);
    splats.into_iter().for_each(|splat| all.push(&splat));
    all
}

/// Level splats anywhere on 5 m by 5 m: with gaps, and with crowds.
fn random_floor(count: u64) -> Splats {
    of((0..count).map(|i| flat([5.0 * uniform(7, 2 * i) as f32, 5.0 * uniform(7, 2 * i + 1) as f32, 0.0])))
}

/// Returns the coverage of the points (x, y) every 0.05 m from `from` to `to`, seen from above:
/// mean and least.
fn covered(snow: &Splats, from: f64, to: f64) -> [f64; 2] {
    let steps = ((to - from) / 0.05) as usize;
    let alphas: Vec<f64> = (0..steps * steps)
        .map(|i| {
            let at = [i % steps, i / steps].map(|k| from + 0.05 * k as f64);
            let clear = (0..snow.len()).map(|j| {
                let off = [0, 1].map(|k| f64::from(snow.means[j][k]) - at[k]);
                let far = (off[0] * off[0] + off[1] * off[1]) / snow.scales(j)[0].powi(2);
                1.0 - snow.opacity(j) * (-0.5 * far).exp()
            });
            1.0 - clear.product::<f64>()
        })
        .collect();
    [alphas.iter().sum::<f64>() / alphas.len() as f64, alphas.iter().copied().fold(1.0, f64::min)]
}

#[test]
fn a_floor_is_covered() {
    let snow = snow(&plain(DVec3::X, DVec3::Y));
    assert_eq!(snow.check(), Ok(()));
    assert!(snow.groups.iter().all(|group| *group == Group::Snow));
    assert!((0..snow.len()).all(|i| snow.is_sound(i)));
    let [mean, least] = covered(&snow, 0.1, 4.9);
    assert!(mean > 0.95 && least > 0.88, "{mean} {least}");
}

#[test]
fn gaps_are_filled() {
    let floor = random_floor(1500);
    let snow = snow(&floor);
    assert!(snow.len() > 1700, "{}", snow.len());
    let [mean, least] = covered(&snow, 0.3, 4.7);
    assert!(mean > 0.95 && least > 0.4, "{mean} {least}");
    let unfilled = PaperCover { fill_angle: 0.0, ..PaperCover::default() }.snow(&floor, &SITE);
    assert!(unfilled.len() <= 1500, "{}", unfilled.len());
    let [bare, _] = covered(&unfilled, 0.3, 4.7);
    assert!(bare < mean - 0.01, "{bare} {mean}");
}

/// Filled-in points are as far from all before them as they should be.
#[test]
fn spacing_holds() {
    let cover = PaperCover::default();
    let mut flakes = cover.seeds(&random_floor(1500), DVec3::Z, 1.0);
    let seeds = flakes.len();
    let patches = cover.patches(&flakes, DVec3::Z, 1.0);
    cover.fill(&mut flakes, &patches);
    assert!(flakes.len() > seeds + 200, "{seeds} {}", flakes.len());
    for i in seeds..flakes.len() {
        for other in &flakes[..i] {
            let distance = place(other.at).distance(place(flakes[i].at));
            let ratio = other.spacing / flakes[i].spacing;
            assert!(distance >= flakes[i].spacing || !(0.5..2.0).contains(&ratio), "{distance} {ratio}");
        }
    }
}

#[test]
fn a_wall_gets_none() {
    assert!(snow(&plain(DVec3::X, DVec3::Z)).is_empty());
}

/// A roof of 45 degrees is seeded, each seed where a splat is, and not filled; one of 20 degrees
/// is.
#[test]
fn steep_planes_are_not_filled() {
    let roof = |degrees: f64| {
        let turn = DQuat::from_rotation_x(degrees.to_radians());
        let splats = random_floor(1500);
        let seeds = splats.len();
        let splats = moved(&splats, turn, 1.0, DVec3::ZERO);
        (seeds, snow(&splats).len())
    };
    let (seeds, steep) = roof(45.0);
    assert!(steep <= seeds && steep > seeds * 9 / 10, "{seeds} {steep}");
    let (seeds, gentle) = roof(20.0);
    assert!(gentle > seeds + 200, "{seeds} {gentle}");
    assert_eq!(roof(65.0).1, 0);
}

#[test]
fn lone_floaters_are_removed() {
    let floor = plain(DVec3::X, DVec3::Y);
    let mut with = floor.clone();
    for at in [
        [1.0, 1.0, 0.6],
        [3.0, 1.0, 2.0],
        [3.1, 1.0, 2.0],
        [3.0, 1.1, 2.0],
        [2.0, 40.0, 9.0],
        [1.0, 4.0, 30.0],
        [1e13, -1e14, 1e12],
    ] {
        with.push(&flat(at));
    }
    let snow = snow(&with);
    let high = snow.means.iter().filter(|mean| mean[2] > 0.3 || mean[1] > 6.0).count();
    assert_eq!(high, 0);
    assert!(covered(&snow, 0.1, 4.9)[1] > 0.85);
}

#[test]
fn neither_threads_nor_the_order_of_splats_count() {
    let mut builder = Builder::new(5);
    builder.surface(DVec3::ZERO, 6.0 * DVec3::X, 6.0 * DVec3::Y, 0.1, |_, _| [0.4; 3]);
    builder.block(DVec3::new(2.0, 2.0, 0.0), DVec3::new(1.0, 1.5, 1.2), 0.1, [0.5; 3]);
    builder.tree(DVec3::new(4.0, 4.0, 0.0), 3.0, 4000);
    let splats = builder.build();
    let cover = PaperCover::default();
    let [one, two, seven] = on_threads([1, 2, 7], || cover.snow(&splats, &SITE));
    assert!(one.len() > 1000, "{}", one.len());
    assert!(one == two && one == seven);
    let backwards: Vec<usize> = (0..splats.len()).rev().collect();
    assert_eq!(cover.snow(&splats.select(&backwards), &SITE), one);
    assert_ne!(PaperCover { seed: 1, ..cover }.snow(&splats, &SITE), one);
}

/// Scale, place and direction of the world's axes change only rounding, of which a few choices
/// depend.
#[test]
fn axes_and_units_do_not_count() {
    let splats = random_floor(1500);
    let turn = DQuat::from_rotation_x(1.2) * DQuat::from_rotation_y(-0.4);
    let other = moved(&splats, turn, 20.0, DVec3::new(3.0, -40.0, 11.0));
    let site = Site { metres_per_unit: 0.05, up: (turn * DVec3::Z).to_array(), ..SITE };
    let [here, there] =
        [snow(&splats), PaperCover::default().snow(&other, &site)].map(|snow| snow.len() as f64);
    assert!((there / here - 1.0).abs() < 0.05, "{here} {there}");
}

#[test]
fn only_solid_splats_of_the_scene_hold_snow() {
    let floor = plain(DVec3::X, DVec3::Y);
    for group in [Group::Sky, Group::Snow] {
        let other = Splats { groups: vec![group; floor.len()], ..floor.clone() };
        assert!(snow(&other).is_empty(), "{group:?}");
    }
    let faint = Splats { logit_opacities: vec![logit(0.09) as f32; floor.len()], ..floor.clone() };
    assert!(snow(&faint).is_empty());
    let huge = Splats { log_scales: vec![[2.0, 2.0, -3.0]; floor.len()], ..floor };
    assert!(snow(&huge).is_empty());
    // Small ones, 100 m apart.
    let apart = of((0..400).map(|i| flat([100.0 * (i % 20) as f32, 100.0 * (i / 20) as f32, 0.0])));
    assert!(snow(&apart).is_empty());
}

#[test]
fn the_limit_holds_and_snow_still_covers() {
    let floor = plain(DVec3::X, DVec3::Y);
    let all = snow(&floor).len();
    for most in [0, 1, 900, all] {
        let few = PaperCover { most, ..PaperCover::default() }.snow(&floor, &SITE);
        assert!(few.len() <= most, "{} of {most}", few.len());
        if most == 900 {
            let [mean, _] = covered(&few, 0.5, 4.5);
            assert!(few.len() > 500 && mean > 0.9, "{} {mean}", few.len());
        }
    }
}

#[test]
fn few_splats_have_fewer_neighbours() {
    assert!(snow(&Splats::with_capacity(0, 2)).is_empty());
    for count in [1, 2] {
        assert!(snow(&random_floor(count)).is_empty(), "{count}");
    }
    for count in 3..20 {
        let snow = snow(&random_floor(count));
        assert!((0..snow.len()).all(|i| snow.is_sound(i)), "{count}");
    }
    let ten = of((0..10).map(|i| flat([0.1 * (i % 4) as f32, 0.1 * (i / 4) as f32, 0.0])));
    assert!(snow(&ten).len() >= 8, "{}", snow(&ten).len());
}

#[test]
fn faults_hold_no_snow() {
    let mut floor = plain(DVec3::X, DVec3::Y);
    for i in 0..floor.len() / 9 {
        let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e15, 1e-40][i % 6];
        match i % 4 {
            0 => floor.means[i][i % 3] = bad,
            1 => floor.quats[i] = [bad; 4],
            2 => floor.log_scales[i][i % 3] = bad,
            _ => floor.logit_opacities[i] = bad,
        }
    }
    floor.quats[7] = [0.0; 4];
    let snow = snow(&floor);
    assert!(snow.len() > 1000 && (0..snow.len()).all(|i| snow.is_sound(i)));
}

/// Crowds in one place, lines, and places at the end of what f32 can tell apart.
#[test]
fn degenerate_places_do_no_harm() {
    let line = |k: usize, step: f32| {
        of((0..3000).map(|i| {
            let mut at = [1.0, 2.0, 3.0];
            at[k] = step * i as f32;
            flat(at)
        }))
    };
    for k in 0..3 {
        for step in [0.1, 1e-12, 1e-38, 1e11] {
            let snow = snow(&line(k, step));
            assert!((0..snow.len()).all(|i| snow.is_sound(i)) && snow.len() <= 3000, "{k} {step}");
        }
    }
    assert!(snow(&line(0, 0.0)).is_empty());
    let far = of((0..3000).map(|i| flat([1e14 + 1e8 * i as f32, 1e7 * (i % 50) as f32, (i / 50) as f32])));
    let snow = snow(&far);
    assert!((0..snow.len()).all(|i| snow.is_sound(i)));
}

#[test]
fn a_site_without_up_or_scale_has_none() {
    let floor = plain(DVec3::X, DVec3::Y);
    for site in [
        Site { up: [0.0; 3], ..SITE },
        Site { up: [f64::NAN; 3], ..SITE },
        Site { metres_per_unit: 0.0, ..SITE },
        Site { metres_per_unit: f64::NAN, ..SITE },
    ] {
        assert!(PaperCover::default().snow(&floor, &site).is_empty());
    }
    let short = Splats { quats: Vec::new(), ..floor };
    assert!(snow(&short).is_empty());
}

#[test]
fn constants_out_of_range_do_no_harm() {
    let floor = random_floor(300);
    let d = PaperCover::default;
    for cover in [
        PaperCover { neighbours: 0, ..d() },
        PaperCover { neighbours: usize::MAX, ..d() },
        PaperCover { spacing: f64::NAN, ..d() },
        PaperCover { spacing: 1e-9, ..d() },
        PaperCover { darts: f64::INFINITY, ..d() },
        PaperCover { spread: -1e9, ..d() },
        PaperCover { outlier_neighbours: usize::MAX, ..d() },
        PaperCover { outlier_neighbours: 0, ..d() },
        PaperCover { opacity: f64::NAN, size: -1.0, lift: f64::INFINITY, ..d() },
        PaperCover { most: usize::MAX, ..d() },
    ] {
        assert!(cover.snow(&floor, &SITE).len() <= 300 * 258, "{cover:?}");
    }
}
