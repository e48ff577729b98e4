use super::cast::{FILTER_VARIANCE_CELLS2, Footprints, LEAST_ALPHA, cast, project};
use super::grid::{Grid, unit};
use super::occluder::Occluder;
use super::*;
use crate::level::dot;
use crate::optics::Site;
use crate::testing::on_threads;
use glam::DVec3;
use proptest::prelude::*;
use wm_base::random::uniform;
use wm_scene::splats::{Splat, logit};
use wm_scene::synthetic::{Builder, moved, rotation};
use wm_scene::{Group, Splats};

impl Shelter {
    /// Returns the distance that a particle at `point` (world, scene units) falls until a surface
    /// stops it, m: about 0 on a surface, negative below one, infinite where nothing is known to
    /// stop it.
    pub(crate) fn distance_to_surface(&self, point: [f32; 3]) -> f32 {
        self.ahead(point) * self.metres_per_unit as f32
    }

    /// Returns true if the map can be used for another direction of fall (world axes, of any
    /// length).
    pub(crate) fn holds(&self, fall: [f64; 3]) -> bool {
        unit(fall).is_some_and(|fall| dot(fall, self.grid.axes[2]) >= self.turn)
    }

    /// Columns and rows.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.grid.columns, self.grid.rows]
    }

    /// Returns the point at which a fall through the middle of a cell stops, world, scene units;
    /// `None` where nothing stops it, and off the grid.
    pub(crate) fn surface(&self, column: usize, row: usize) -> Option<[f64; 3]> {
        let Grid { axes, origin, low, cell, columns, .. } = &self.grid;
        let stop = f64::from(*self.stops.get(row * columns + column).filter(|_| column < *columns)?);
        let [u, v] = [low[0] + (column as f64 + 0.5) * cell, low[1] + (row as f64 + 0.5) * cell];
        let at = |k: usize| origin[k] + u * axes[0][k] + v * axes[1][k] + stop * axes[2][k];
        stop.is_finite().then(|| [at(0), at(1), at(2)])
    }
}

const DOWN: [f64; 3] = [0.0, 0.0, -1.0];
const GREY: [f32; 3] = [0.5; 3];

fn site(metres_per_unit: f64, up: DVec3) -> Site {
    Site { metres_per_unit, up: up.to_array(), ..Site::PLAIN }
}

fn metres() -> Site {
    site(1.0, DVec3::Z)
}

fn map(splats: &Splats, fall: [f64; 3]) -> Shelter {
    Occluders::of(splats, &metres(), &ShelterOptions::default()).shelter(fall)
}

/// The occluders of splats in metres, for maps whose cells are so wide, m.
fn with_cells(splats: &Splats, cell: f64) -> Occluders {
    Occluders::of(splats, &metres(), &ShelterOptions { cell, ..ShelterOptions::default() })
}

/// Casts footprints on a grid and returns where its cells stop, which is at `before` to begin with;
/// `clear` is the share of a fall that each cell still lets through.
fn stops_of(footprints: &Footprints, grid: &Grid, before: f32, clear: &mut [f32]) -> Vec<f32> {
    let (mut stops, mut splats) = (vec![before; clear.len()], vec![0; clear.len()]);
    cast(footprints, grid, &mut stops, clear, &mut splats);
    stops
}

fn point(x: f64, y: f64, z: f64) -> [f32; 3] {
    [x, y, z].map(|v| v as f32)
}

/// A floor of 8 m by 8 m at height 0.
fn floor() -> Builder {
    let mut place = Builder::new(5);
    place.surface(DVec3::new(-4.0, -4.0, 0.0), DVec3::X * 8.0, DVec3::Y * 8.0, 0.08, |_, _| GREY);
    place
}

/// The floor and a table top of 2 m by 2 m, a metre above its middle.
fn table() -> Splats {
    let mut place = floor();
    place.surface(DVec3::new(-1.0, -1.0, 1.0), DVec3::X * 2.0, DVec3::Y * 2.0, 0.04, |_, _| GREY);
    place.build()
}

/// A ball of standard deviation `size`.
fn ball(at: DVec3, size: f64, opacity: f64) -> Splat {
    Splat {
        mean: at.to_array().map(|v| v as f32),
        quat: [1.0, 0.0, 0.0, 0.0],
        log_scale: [size.ln() as f32; 3],
        logit_opacity: logit(opacity) as f32,
        rgb: GREY,
        group: Group::Scene,
    }
}

/// Edges are found to a cell and the size of the splats there: 0.1 m + 0.05 m.
const EDGE_TOLERANCE_M: f64 = 0.15;

#[test]
fn a_table_shelters_what_is_beneath_it() {
    let shelter = map(&table(), DOWN);
    for i in 0..4000 {
        let [x, y, z] = [0, 1, 2].map(|k| uniform(1, 3 * i + k));
        let (x, y) = (7.0 * x - 3.5, 7.0 * y - 3.5);
        let away = x.abs().max(y.abs());
        if (away - 1.0).abs() < EDGE_TOLERANCE_M {
            continue;
        }
        // The floor, the air, the top of the table: none shelters itself.
        let heights = [(0.0, away > 1.0), (0.8 * z, away > 1.0), (1.02, true), (1.0 + z, true)];
        for (height, is_exposed) in heights {
            assert_eq!(shelter.is_exposed(point(x, y, height)), is_exposed, "({x}, {y}, {height})");
        }
        let fallen = shelter.distance_to_surface(point(x, y, 2.0));
        assert!((fallen - if away > 1.0 { 2.0 } else { 1.0 }).abs() < 0.05, "({x}, {y}): {fallen}");
    }
    assert!(shelter.is_exposed(point(90.0, 0.0, -5.0)), "off the grid");
    assert_eq!(shelter.distance_to_surface(point(90.0, 0.0, -5.0)), f32::INFINITY);
}

#[test]
fn the_shelter_of_a_slanted_fall_moves_with_height() {
    for (x, y) in [(1.0, 0.0), (-0.6, 0.3), (0.2, -1.2)] {
        let shelter = map(&table(), [2.0 * x, 2.0 * y, -2.0]);
        for height in [0.0, 0.4] {
            // Blown by this much between the table and the height.
            let [over, along] = [x, y].map(|tan: f64| tan * (1.0 - height));
            for (u, v) in [(0.0, 0.0), (1.0, 0.2), (-1.0, 0.3), (0.3, 1.0), (0.1, -1.0)] {
                let inside =
                    point(over + (1.0 - EDGE_TOLERANCE_M) * u, along + (1.0 - EDGE_TOLERANCE_M) * v, height);
                let outside =
                    point(over + (1.0 + EDGE_TOLERANCE_M) * u, along + (1.0 + EDGE_TOLERANCE_M) * v, height);
                assert!(!shelter.is_exposed(inside), "({x}, {y}): {inside:?}");
                assert!(shelter.is_exposed(outside) || (u, v) == (0.0, 0.0), "({x}, {y}): {outside:?}");
            }
        }
    }
}

#[test]
fn slopes_do_not_shelter_themselves() {
    for degrees in [20f64, 45.0, 60.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let mut place = Builder::new(3);
        let along = DVec3::new(cos, 0.0, sin);
        place.surface(DVec3::new(0.0, -2.0, 0.0), along * 4.0, DVec3::Y * 4.0, 0.05, |_, _| GREY);
        let shelter = map(&place.build(), DOWN);
        for i in 0..2000 {
            let at = along * (0.2 + 3.6 * uniform(1, 2 * i));
            let at = point(at.x, 3.0 * uniform(1, 2 * i + 1) - 1.5, at.z);
            assert!(shelter.is_exposed(at), "{degrees} degrees: {at:?}");
            let soft = shelter.exposure(at, 0.5);
            assert!(degrees > 45.0 || soft > 0.97, "{degrees} degrees: {at:?} {soft}");
        }
    }
}

/// With cells of a fifth of the radius, half a cell of the edge is `0.85 / 5 / 2` of the disc, and
/// the splats there scatter by as much as a fifth of a cell: 0.1 and 0.04.
#[test]
fn exposure_is_a_half_under_an_edge() {
    let shelter = map(&table(), DOWN);
    for i in 0..200 {
        let y = 0.6 * uniform(2, i) - 0.3;
        let at = |x: f64| f64::from(shelter.exposure(point(x, y, 0.02), 0.5));
        assert!((at(1.0) - 0.5).abs() < 0.14, "{y}: {}", at(1.0));
        assert_eq!((at(0.3), at(1.7)), (0.0, 1.0));
        // It rises all the way, by little at a time: a millimetre is at most 0.85 * 0.001 / 0.5 of
        // the disc, plus what one row of cells weighs more or less by its own move.
        for step in 0..1400 {
            let (here, next) = (at(0.3 + 0.001 * f64::from(step)), at(0.301 + 0.001 * f64::from(step)));
            assert!(next >= here - 1e-3 && next - here < 0.02, "{step}: {here} {next}");
        }
    }
    assert_eq!(shelter.exposure(point(0.0, 0.0, 0.0), 0.01), 0.0);
    assert_eq!(shelter.exposure(point(2.0, 0.0, 0.0), f32::NAN), 1.0);
    assert_eq!(shelter.exposure(point(0.0, 0.0, 0.0), f32::INFINITY), shelter.exposure([0.0; 3], 6.4));
    assert_eq!(shelter.exposure([f32::NAN; 3], 0.5), 1.0);
    assert_eq!(shelter.exposure(point(1e30, 0.0, 0.0), 0.5), 1.0);
}

/// A layer of 400 balls of standard deviation 0.025 m over 4 m^2 has a mean coverage of
/// `opacity 2 pi 0.025^2 400 / 4 = 0.39 opacity`: ten of leaves leave `e^-3.7`; haze has opacities
/// below the least, or one layer.
#[test]
fn haze_does_not_shelter_and_leaves_do() {
    let shelters = |opacity: f64, layers: u64| {
        let mut splats = floor().build();
        for i in 0..400 * layers {
            let [x, y, z] = [0, 1, 2].map(|k| uniform(7, 3 * i + k));
            splats.push(&ball(DVec3::new(2.0 * x - 1.0, 2.0 * y - 1.0, 2.0 + z), 0.025, opacity));
        }
        let shelter = map(&splats, DOWN);
        let points =
            (0..1000).map(|i| point(1.4 * uniform(8, 2 * i) - 0.7, 1.4 * uniform(8, 2 * i + 1) - 0.7, 0.0));
        points.filter(|at| !shelter.is_exposed(*at)).count() as f64 / 1000.0
    };
    assert_eq!(shelters(0.08, 40), 0.0);
    assert!(shelters(0.3, 1) < 0.02);
    assert!(shelters(0.95, 10) > 0.98);
}

#[test]
fn a_lone_floater_does_not_shelter_and_a_canopy_does() {
    let mut splats = floor().build();
    // A floater over another, one over nothing, one of many splats; a canopy of a metre.
    let floaters = [DVec3::new(2.0, 2.0, 5.0), DVec3::new(2.0, 2.0, 2.0), DVec3::new(-2.0, -2.0, 9.0)];
    for at in floaters {
        (0..5).for_each(|i| splats.push(&ball(at + DVec3::Z * (0.05 * f64::from(i)), 0.06, 0.9)));
    }
    let mut place = Builder::new(1);
    place.surface(DVec3::new(-0.5, -0.5, 2.5), DVec3::X, DVec3::Y, 0.05, |_, _| GREY);
    let canopy = place.build();
    for i in 0..canopy.len() {
        let mean = canopy.means[i];
        let (quat, log_scale) = (canopy.quats[i], canopy.log_scales[i]);
        splats.push(&Splat { mean, quat, log_scale, ..ball(DVec3::ZERO, 1.0, 0.95) });
    }
    let shelter = map(&splats, DOWN);
    for at in floaters {
        for height in [0.0, 1.0] {
            assert!(shelter.is_exposed(point(at.x, at.y, height)), "{at}");
        }
        let fallen = shelter.distance_to_surface(point(at.x, at.y, 3.0));
        assert!((fallen - 3.0).abs() < 0.05, "{at}: {fallen}");
    }
    assert!(!shelter.is_exposed(point(0.0, 0.0, 0.0)));
}

/// Random splats of all shapes in a box about the origin.
fn mess(seed: u64, count: u64) -> Splats {
    let mut splats = Splats::with_capacity(0, 0);
    for i in 0..count {
        let [x, y, z, a, b, c, opacity] = std::array::from_fn(|k| uniform(seed, 8 * i + k as u64));
        let turn = rotation(seed + 1, i);
        splats.push(&Splat {
            mean: point(2.0 * x - 1.0, 2.0 * y - 1.0, 2.0 * z - 1.0),
            quat: [turn.w, turn.x, turn.y, turn.z].map(|v| v as f32),
            log_scale: [a, b, c].map(|v| (-5.0 + 3.5 * v * v) as f32),
            logit_opacity: (8.0 * opacity - 3.0) as f32,
            rgb: GREY,
            group: Group::Scene,
        });
    }
    splats
}

/// Returns the possible stops of a cell, in f64 and from the formulas alone, over all splats: each
/// distance at which the fall may fall below a half, given how far f32 may be off; with infinity if
/// it may not.
///
/// A mean within 1.5 of the origin is off by 6e-8 of it, 3e-6 of the filter's width here (0.055 *
/// 0.5); at the 3.3 standard deviations of the least alpha that is 1e-5 in the exponent, and
/// rounding it adds 5e-6 (q = 11, some six operations). Near a half, the errors add up to less than
/// twice that: 4e-5. A splat at the least alpha is there or not: its whole alpha more.
fn referee(splats: &Splats, grid: &Grid, least_opacity: f64, middle: [f64; 2]) -> Vec<f64> {
    let [across, down, fall] = grid.axes.map(DVec3::from_array);
    let mut met: Vec<(f64, f64, f64)> = Vec::new();
    for i in 0..splats.len() {
        let mean = DVec3::from_array(splats.means[i].map(f64::from)) - DVec3::from_array(grid.origin);
        let turn = wm_scene::quat::to_matrix(splats.quats[i].map(f64::from));
        let along = |axis: DVec3| -> [f64; 3] {
            let scales = splats.scales(i);
            std::array::from_fn(|k| scales[k] * (0..3).map(|j| axis[j] * turn[j][k]).sum::<f64>())
        };
        let (a, b, c) = (along(across), along(down), along(fall));
        let filter = FILTER_VARIANCE_CELLS2 * grid.cell.powi(2);
        let (aa, ab, bb) = (dot(a, a) + filter, dot(a, b), dot(b, b) + filter);
        let (before, after) = (dot(a, a) * dot(b, b) - ab * ab, aa * bb - ab * ab);
        let d = [middle[0] - mean.dot(across), middle[1] - mean.dot(down)];
        let solved = [(bb * d[0] - ab * d[1]) / after, (aa * d[1] - ab * d[0]) / after];
        let q = d[0] * solved[0] + d[1] * solved[1];
        let alpha = splats.opacity(i) * (before / after).sqrt() * (-0.5 * q).exp();
        if splats.opacity(i) >= least_opacity && alpha > 0.99 * LEAST_ALPHA {
            let t = mean.dot(fall);
            met.push((t, alpha, t + dot(c, a) * solved[0] + dot(c, b) * solved[1]));
        }
    }
    met.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut least, mut most, mut may) = (1.0, 1.0, Vec::new());
    for (_, alpha, depth) in met {
        let is_sure = alpha > (1.0 + 5e-5) * LEAST_ALPHA;
        let was = most;
        least *= 1.0 - alpha;
        most *= if is_sure { 1.0 - alpha } else { 1.0 };
        if least < 0.5 + 4e-5 && was > 0.5 - 4e-5 && (is_sure || alpha > (1.0 - 5e-5) * LEAST_ALPHA) {
            may.push(depth);
        }
    }
    if most > 0.5 - 4e-5 {
        may.push(f64::INFINITY);
    }
    may
}

#[test]
fn the_grid_is_what_the_referee_says() {
    for (seed, count, fall) in
        [(1, 600, [0.0, 0.0, -1.0]), (2, 2500, [0.5, -0.2, -0.8]), (3, 1200, [0.9, 0.1, 0.1])]
    {
        let splats = mess(seed, count);
        let occluders = with_cells(&splats, 0.05);
        assert!(occluders.all.len() > splats.len() / 2);
        let grid = occluders.grid(unit(fall).unwrap());
        let footprints = project(&occluders.all, &grid);
        let cells = grid.columns * grid.rows;
        let stops = stops_of(&footprints, &grid, f32::NEG_INFINITY, &mut vec![1.0; cells]);
        let (mut stopped, mut loose) = (0, 0);
        for (cell, stop) in stops.iter().enumerate() {
            let (column, row) = (cell % grid.columns, cell / grid.columns);
            let middle = [(column, 0), (row, 1)].map(|(k, i)| grid.low[i] + (k as f64 + 0.5) * grid.cell);
            let may = referee(&splats, &grid, occluders.options.least_opacity, middle);
            // Depth: 1e-5 standard deviations of up to 0.23, and rounding.
            let is_one = |want: &f64| f64::from(*stop) == *want || (f64::from(*stop) - want).abs() < 5e-6;
            assert!(may.iter().any(is_one), "seed {seed}, cell {column} {row}: {stop}, want {may:?}");
            stopped += usize::from(stop.is_finite());
            loose += usize::from(may.len() > 1);
        }
        assert!(stopped > stops.len() / 10 && loose < stops.len() / 200, "{stopped} {loose} {}", stops.len());
    }
}

#[test]
fn cells_that_are_opened_again_meet_all_that_is_over_them() {
    let occluders = with_cells(&mess(5, 2000), 0.03);
    let grid = occluders.grid([0.6, 0.0, -0.8]);
    let footprints = project(&occluders.all, &grid);
    let count = grid.columns * grid.rows;
    for share in [0.0, 0.001, 0.02, 1.0] {
        let clear: Vec<f32> = (0..count as u64).map(|i| f32::from(u8::from(uniform(3, i) < share))).collect();
        let few = footprints.over(&grid, &clear);
        let stops =
            [&footprints, &few].map(|footprints| stops_of(footprints, &grid, 0.1, &mut clear.clone()));
        assert_eq!(stops[0], stops[1]);
        assert_eq!(few.all.is_empty(), share == 0.0);
    }
}

#[test]
fn pooled_occluders_let_as_much_through() {
    // Leaves that stand alone, some to a cube. Much smaller ones are fainter in a wide cell than
    // what is drawn.
    let mut splats = Splats::with_capacity(0, 0);
    for i in 0..1_600 {
        let draw = |k: u64| uniform(11, 4 * i + k);
        let at = DVec3::new(4.0 * draw(0) - 2.0, 4.0 * draw(1) - 2.0, 2.0 + 0.2 * draw(2));
        splats.push(&ball(at, 0.05, 0.8));
    }
    let place = with_cells(&splats, 0.2);
    let softened = place.softened(2.0);
    assert!(softened.all.len() < place.all.len() / 2, "{} of {}", softened.all.len(), place.all.len());
    // The area, m^2, that all of them keep from what falls straight down.
    let shadow = |all: &[Occluder], grid: &Grid| {
        let mut clear = vec![1.0; grid.columns * grid.rows];
        stops_of(&project(all, grid), grid, f32::NEG_INFINITY, &mut clear);
        clear.iter().map(|left| 1.0 - f64::from(*left)).sum::<f64>() * grid.cell * grid.cell
    };
    // Nothing stops, so that all is summed.
    let grid = Grid { stopped: 0.0, ..softened.grid([0.0, 0.0, -1.0]) };
    let fine = place.mapped(&ShelterOptions { cell: 0.05, ..ShelterOptions::default() });
    let fine_grid = Grid { stopped: 0.0, ..fine.grid([0.0, 0.0, -1.0]) };
    let (want, got) = (shadow(&fine.all, &fine_grid), shadow(&softened.all, &grid));
    assert!(want > 5.0 && (got / want - 1.0).abs() < 0.05, "{got} m^2, {want} with narrow cells");
}

#[test]
fn maps_are_the_same_for_any_number_of_threads() {
    let splats = mess(4, 3000);
    let [one, others @ ..] = on_threads([1, 2, 3, 16], || {
        let shelter = with_cells(&splats, 0.02).shelter([0.3, 0.1, -1.0]);
        shelter.stops.iter().map(|v| v.to_bits()).collect::<Vec<_>>()
    });
    assert!(one.len() > 10_000);
    assert!(others.iter().all(|other| *other == one));
}

#[test]
fn a_place_turned_scaled_and_moved_has_the_same_shelter() {
    let (splats, fall) = (table(), DVec3::new(0.4, -0.2, -1.0));
    let before = map(&splats, fall.to_array());
    let (turn, shift) = (rotation(6, 1), DVec3::new(300.0, -200.0, 50.0));
    let there = moved(&splats, turn, 4.0, shift);
    let site = site(0.25, turn * DVec3::Z);
    let after = Occluders::of(&there, &site, &ShelterOptions::default()).shelter((turn * fall).to_array());
    assert!((after.cell() - 0.1).abs() < 1e-12);
    let mut different = 0;
    for i in 0..5000 {
        let at = DVec3::from_array([0, 1, 2].map(|k| uniform(9, 3 * i + k)));
        let at = DVec3::new(6.0 * at.x - 3.0, 6.0 * at.y - 3.0, 1.5 * at.z);
        let place = turn * (at * 4.0) + shift;
        let [at, place] = [at, place].map(|p| point(p.x, p.y, p.z));
        different += usize::from(before.is_exposed(at) != after.is_exposed(place));
    }
    // The cells of the two lie differently: points within a cell of an edge, 8 m of it over 36 m^2,
    // and those at the margin under the table, 1 cm of 1.5 m over 4 m^2.
    assert!(different < 120, "{different}");
}

#[test]
fn nothing_shelters_nothing() {
    let mut sky = table();
    sky.groups.fill(Group::Sky);
    for splats in [Splats::default(), sky] {
        let shelter = map(&splats, DOWN);
        assert_eq!(shelter.size(), [0, 0]);
        assert!(shelter.is_exposed([0.0; 3]) && shelter.exposure([0.0; 3], 1.0) == 1.0);
        assert_eq!(shelter.surface(0, 0), None);
    }
}

#[test]
fn faults_and_giants_are_left_out() {
    let mut splats = table();
    let want = map(&splats, DOWN);
    let giant = ball(DVec3::Z * 3.0, 9.0, 0.99);
    let nan = f32::NAN;
    for odd in [
        giant,
        Splat { mean: [0.0, nan, 2.0], ..giant },
        Splat { log_scale: [nan, 0.0, 0.0], ..giant },
        Splat { log_scale: [f32::INFINITY; 3], ..giant },
        Splat { logit_opacity: nan, ..giant },
        Splat { quat: [nan; 4], ..giant },
        Splat { group: Group::Sky, log_scale: [0.0; 3], ..giant },
    ] {
        splats.push(&odd);
    }
    let shelter = map(&splats, [0.0, 0.0, f64::NAN]);
    assert_eq!(shelter.fall(), DOWN);
    assert!(shelter.stops.iter().all(|stop| !stop.is_nan()));
    for (x, is_exposed) in [(0.0, false), (0.8, false), (1.2, true), (3.0, true)] {
        assert_eq!(shelter.is_exposed(point(x, 0.0, 0.0)), is_exposed);
        assert_eq!(want.is_exposed(point(x, 0.0, 0.0)), is_exposed);
    }
}

#[test]
fn a_large_scene_has_wider_cells() {
    let options = ShelterOptions { most_cells: 1000, ..ShelterOptions::default() };
    let shelter = Occluders::of(&table(), &metres(), &options).shelter(DOWN);
    let [columns, rows] = shelter.size();
    assert!(columns * rows <= 1000 && columns * rows > 800, "{columns} {rows}");
    assert!((shelter.cell() - 8.0 / 31.0).abs() < 0.01, "{}", shelter.cell());
    // A line has a length and no area.
    let mut line = Splats::with_capacity(0, 0);
    (0..1000).for_each(|i| line.push(&ball(DVec3::X * f64::from(i), 0.001, 0.9)));
    let [columns, rows] = Occluders::of(&line, &metres(), &options).shelter(DOWN).size();
    assert!(columns * rows <= 1000 && columns > 500, "{columns} {rows}");
}

#[test]
fn a_grid_with_a_focus_is_a_part_of_the_whole() {
    let (splats, fall, site) = (table(), [0.2, 0.1, -1.0], metres());
    let of = |focus| {
        Occluders::of(&splats, &site, &ShelterOptions { focus, ..ShelterOptions::default() }).shelter(fall)
    };
    let (whole, part) = (of(None), of(Some(([[0.5, 0.0, 0.0]; 2], 1.0))));
    assert_eq!(part.size(), [20, 20]);
    for i in 0..500 {
        let at = point(0.5 * uniform(4, 2 * i), 1.6 * uniform(4, 2 * i + 1) - 0.8, 0.3);
        assert_eq!((part.is_exposed(at), whole.is_exposed(at)), (false, false));
    }
    assert!(part.is_exposed(point(-0.7, 0.0, 0.3)) && !whole.is_exposed(point(-0.7, 0.0, 0.3)));
    assert_eq!(of(Some(([[50.0, 0.0, 0.0]; 2], 1.0))).size(), [0, 0]);
    assert_eq!(of(Some(([[0.0; 3]; 2], -1.0))).size(), [0, 0]);
}

#[test]
fn a_map_holds_for_small_turns() {
    let shelter = map(&table(), DOWN);
    let tilted = |degrees: f64| [5.0 * degrees.to_radians().sin(), 0.0, -5.0 * degrees.to_radians().cos()];
    assert!(shelter.holds(DOWN) && shelter.holds(tilted(2.9)) && shelter.holds(tilted(-2.9)));
    assert!(!shelter.holds(tilted(3.1)) && !shelter.holds([0.0, 0.0, 1.0]) && !shelter.holds([f64::NAN; 3]));
}

#[test]
fn surfaces_are_where_cells_say() {
    let shelter = map(&table(), [0.5, 0.2, -1.0]);
    let [columns, rows] = shelter.size();
    let mut found = 0;
    for (column, row) in (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))) {
        let Some(at) = shelter.surface(column, row) else { continue };
        assert!(at[2].abs() < 0.1 || (at[2] - 1.0).abs() < 0.1, "{at:?}");
        let left = shelter.distance_to_surface(at.map(|v| v as f32));
        assert!(left.abs() < 1e-4 && shelter.is_exposed(at.map(|v| v as f32)), "{at:?}: {left}");
        found += 1;
    }
    assert!(found > 4000, "{found}");
    assert_eq!((shelter.surface(columns, 0), shelter.surface(0, rows)), (None, None));
}

proptest! {
    /// No scene of any numbers makes a map with NaN, or a query that fails.
    #[test]
    fn any_splats_make_a_map(
        numbers in prop::collection::vec(prop::array::uniform12(prop::num::f32::ANY), 0..20),
        plain in prop::collection::vec(prop::array::uniform12(-3.0..3.0f32), 0..20),
        fall in prop::array::uniform3(-1.0..1.0f64),
        at in prop::array::uniform3(prop::num::f32::ANY),
        radius in prop::num::f32::ANY,
    ) {
        let mut splats = Splats::with_capacity(0, 0);
        for n in numbers.iter().chain(&plain) {
            splats.push(&Splat {
                mean: [n[0], n[1], n[2]],
                quat: [n[3], n[4], n[5], n[6]],
                log_scale: [n[7], n[8], n[9]],
                logit_opacity: n[10],
                ..ball(DVec3::ZERO, 1.0, 0.5)
            });
        }
        let options = ShelterOptions { most_cells: 10_000, ..ShelterOptions::default() };
        let shelter = Occluders::of(&splats, &metres(), &options).shelter(fall);
        let [columns, rows] = shelter.size();
        prop_assert!(columns * rows <= 10_000 && shelter.stops.iter().all(|stop| !stop.is_nan()));
        let _ = shelter.is_exposed(at);
        prop_assert!((0.0..=1.0).contains(&shelter.exposure(at, radius)));
    }
}

/// The built-in street, whose surfaces are known: points about it are under a roof, an eave, a
/// porch or a tree where a ray against the fall says so, and all rays from 0.25 m around it. Some
/// lie under leaves that the splats scatter otherwise, and under backs that nobody sees, which have
/// no splats.
#[test]
fn roofs_of_the_street_shelter() {
    let place = wm_street::Street::builtin();
    let sampling = place.sampling(0.5);
    let splats = sampling.splats_in(0..sampling.len());
    let fall = DVec3::new(0.3, 0.4, -1.0).normalize();
    let options = ShelterOptions { focus: Some(([[0.0; 3]; 2], 40.0)), ..ShelterOptions::default() };
    let shelter = Occluders::of(&splats, &metres(), &options).shelter(fall.to_array());
    assert!((shelter.cell() - 0.1).abs() < 1e-9 && shelter.size() == [800, 800]);
    let [mut right, mut wrong] = [[0; 2]; 2];
    for i in 0..8000 {
        let [x, y, z] = [0, 1, 2].map(|k| uniform(6, 3 * i + k));
        let at = DVec3::new(40.0 * x - 20.0, 24.0 * y - 12.0, 0.05 + 5.0 * z);
        let around = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y];
        let above = around.map(|d| place.first(at + 0.25 * d, -fall).map_or(0.0, |hit| hit.t));
        let is_sheltered = above.iter().all(|t| *t > 0.4);
        if is_sheltered || above.iter().all(|t| *t == 0.0) {
            let is_right = shelter.is_exposed(point(at.x, at.y, at.z)) != is_sheltered;
            let count = if is_right { &mut right } else { &mut wrong };
            count[usize::from(is_sheltered)] += 1;
        }
    }
    assert!(right[0] > 3000 && right[1] > 2000, "{right:?}");
    assert!(wrong[0] * 250 < right[0] && wrong[1] * 60 < right[1], "{right:?} {wrong:?}");
}
