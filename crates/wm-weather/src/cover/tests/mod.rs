//! Snow on made-up places whose surfaces are known.

mod melting;

use super::*;
use crate::particles::random::RandomSequence;
use crate::testing::{self, SITE, photo_view};
use glam::DVec3;
use wm_scene::Camera;
use wm_scene::splats::Splat;
use wm_scene::synthetic::Builder;
use wm_street::{Place, Street};

const SNOW: CoverMaterial = CoverMaterial { color: [0.8; 3], shade: [0.2, 0.22, 0.28] };

const COVER_REQUEST: CoverRequest = CoverRequest {
    depth: 0.1,
    thaw: None,
    wet_fall: 0.0,
    repose: 0.84,
    threshold: f64::INFINITY,
    material: SNOW,
};

fn slanted(slope: [f64; 2]) -> Airflow {
    Airflow { slope, moved: 0.0 }
}

/// The cover of what stands in `splats`, for an eye at `eye`.
fn cover_of(splats: &Splats, airflow: &Airflow, eye: [f64; 3]) -> Cover {
    Cover::of(splats, &FusedSurfaces::from_splats(splats), &SITE, airflow, [eye; 2])
}

/// A yard of 10 m by 8 m with a roof of 3 m by 3 m at 2.5 m over a part of it.
fn porch() -> Splats {
    let mut place = Builder::new(1);
    place.surface(DVec3::ZERO, DVec3::X * 10.0, DVec3::Y * 8.0, 0.05, |_, _| [0.4; 3]);
    place.surface(DVec3::new(4.0, 3.0, 2.5), DVec3::X * 3.0, DVec3::Y * 3.0, 0.05, |_, _| [0.4; 3]);
    place.build()
}

/// Area of the yard from above, m^2: that of the splats, which end softly some cm beyond its edge.
fn yard(ground: &GroundGrid) -> f64 {
    let cells = ground.size[0] * ground.size[1];
    let area = (0..cells).filter(|cell| !ground.nodes_of(*cell).is_empty()).count() as f64;
    let area = area * f64::from(ground.cell).powi(2);
    assert!(area > 79.5 && area < 82.5, "{area}");
    area
}

/// Water that lies, has melted and was shed, kg, of snow of 300 kg/m^3.
fn account(cover: &Cover, lying: &LyingCover) -> [f64; 3] {
    let lies = lying.settled[0].depth.iter().map(|depth| f64::from(*depth)).sum();
    let area = f64::from(cover.rings[0].cell).powi(2);
    [lies, lying.melted[0], lying.settled[0].lost].map(|depth| depth * area * 300.0)
}

/// Mean depth over a field of the uppermost surface between two heights.
fn mean(cover: &Cover, lying: &LyingCover, x: [f64; 2], y: [f64; 2], z: [f64; 2]) -> f64 {
    let ground = &cover.rings[0];
    let (mut sum, mut count) = (0.0, 0);
    for node in 0..lying.settled[0].depth.len() {
        let at = ground.point(node);
        let is_in = |k: usize, ends: [f64; 2]| at[k] > ends[0] && at[k] < ends[1];
        if is_in(0, x) && is_in(1, y) && is_in(2, z) {
            sum += f64::from(lying.settled[0].depth[node]);
            count += 1;
        }
    }
    assert!(count > 100, "{count} nodes");
    sum / f64::from(count)
}

#[test]
fn roofs_are_covered_and_what_is_below_is_bare() {
    let splats = porch();
    let mut cover = cover_of(&splats, &Airflow::default(), [5.0, 4.0, 0.0]);
    let lying = cover.lay_all(&[CoverRequest { depth: 0.1, repose: 0.84, ..COVER_REQUEST }]);
    let open = mean(&cover, &lying, [1.0, 3.0], [1.0, 7.0], [-0.2, 0.2]);
    let roof = mean(&cover, &lying, [4.5, 6.5], [3.5, 5.5], [2.3, 2.7]);
    let below = mean(&cover, &lying, [5.0, 6.0], [4.0, 5.0], [-0.2, 0.2]);
    assert!((open / 0.1 - 1.0).abs() < 0.03 && (roof / 0.1 - 1.0).abs() < 0.03, "{open} {roof}");
    assert!(below < 0.005, "{below}");
    // What fell lies.
    let fell: f64 = cover.rings[0].share.iter().map(|v| f64::from(*v) * 0.1).sum();
    let lies: f64 = lying.settled[0].depth.iter().map(|v| f64::from(*v)).sum();
    assert!(
        ((lies + lying.settled[0].lost) / fell - 1.0).abs() < 1e-3,
        "{lies} {} {fell}",
        lying.settled[0].lost
    );
}

/// More snow than a slit of a yard holds fills it, and spreads on the yard.
#[test]
fn a_pit_fills_to_its_rim() {
    let mut place = Builder::new(3);
    for (x, z, wide) in [(-3.0, 0.0, 5.0), (2.0, -1.0, 0.2), (2.2, 0.0, 5.0)] {
        let at = DVec3::new(x, 0.0, z);
        place.surface(at, DVec3::X * wide, DVec3::Y * 8.0, 0.03, |_, _| [0.4; 3]);
    }
    let cover = cover_of(&place.build(), &Airflow::default(), [3.0, 4.0, 0.0]);
    let ground = &cover.rings[0];
    let is_in_slit = |node: usize| ground.point(node)[2] < -0.7;
    let fell: Vec<f32> = (0..ground.len()).map(|node| if is_in_slit(node) { 2.5 } else { 0.0 }).collect();
    let settled = settle::settle(ground, &fell, COVER_REQUEST.repose as f32);
    let depths = (0..ground.len()).filter(|node| is_in_slit(*node)).map(|node| settled.depth[node]);
    let deepest = depths.fold(0.0, f32::max);
    assert!((1.0..1.8).contains(&deepest), "{deepest} m");
    let sum = |depths: &[f32]| depths.iter().map(|depth| f64::from(*depth)).sum::<f64>();
    assert!(((sum(&settled.depth) + settled.lost) / sum(&fell) - 1.0).abs() < 1e-3);
}

/// Splats that reach over the end of a ring are buried as those before and behind it.
#[test]
fn ground_is_buried_across_the_end_of_a_ring() {
    let mut place = Builder::new(2);
    place.surface(DVec3::ZERO, DVec3::X * 34.0, DVec3::Y * 8.0, 0.2, |_, _| [0.4; 3]);
    let splats = place.build();
    let mut cover = cover_of(&splats, &Airflow::default(), [17.0, 4.0, 0.0]);
    assert!(cover.rings.len() > 1, "the field fits one ring");
    let lying = cover.lay_all(&[CoverRequest { depth: 0.15, ..COVER_REQUEST }]);
    let places = &cover.rings[0].places;
    let ends = [0.0, places.size()[0] as f64].map(|column| places.point([column, 0.0], 0.0)[0] as f32);
    assert!(ends.iter().all(|end| (1.0..33.0).contains(end)), "{ends:?}");
    let at_an_end = |index: &usize| {
        let [x, y, _] = splats.means[*index];
        (1.0..7.0).contains(&y) && ends.iter().any(|end| (x - end).abs() < 0.4)
    };
    let near: Vec<usize> = (0..splats.len()).filter(at_an_end).collect();
    let is_seen = |index: &&usize| lying.buried.factors[**index] > 0.1;
    let seen = near.iter().filter(is_seen).count();
    // Some are rough enough to stand out anywhere.
    assert!(near.len() > 150 && seen <= 2, "{seen} of {} splats are seen through 15 cm", near.len());
}

/// A tree stands on the yard: its leaves hold little, and with gaps between; the yard holds all.
/// Nothing gets lost from the account.
#[test]
fn leaves_of_a_crown_hold_little_in_clumps() {
    let mut place = Builder::new(4);
    place.surface(DVec3::ZERO, DVec3::X * 10.0, DVec3::Y * 8.0, 0.05, |_, _| [0.4; 3]);
    place.leaves(DVec3::new(5.0, 4.0, 2.5), 1.2, 6000, [0.1, 0.4, 0.1]);
    let mut cover = cover_of(&place.build(), &Airflow::default(), [5.0, 4.0, 0.0]);
    let lying = cover.lay_all(&[CoverRequest { depth: 0.3, ..COVER_REQUEST }]);
    let ground = &cover.rings[0];
    let depths: Vec<f32> = (0..ground.len())
        .filter(|node| ground.is_crown(*node) && ground.share[*node] > 0.5)
        .map(|node| lying.settled[0].depth[node])
        .collect();
    let share = |is: &dyn Fn(f32) -> bool| {
        depths.iter().filter(|depth| is(**depth)).count() as f64 / depths.len() as f64
    };
    assert!(depths.len() > 200 && depths.iter().all(|depth| *depth <= 0.08 + 1e-6), "{}", depths.len());
    let (bare, full) = (share(&|depth| depth < 0.001), share(&|depth| depth > 0.07));
    // Much slides off the sides of a ball.
    assert!(bare > 0.2 && full > 0.1, "{bare} bare, {full} full");
    let open = mean(&cover, &lying, [0.5, 2.0], [1.0, 7.0], [-0.2, 0.2]);
    assert!((open / 0.3 - 1.0).abs() < 0.03, "{open}");
    let sum = |values: &[f32], factor: f64| values.iter().map(|v| f64::from(*v) * factor).sum::<f64>();
    let (fell, lies) = (sum(&ground.share, 0.3), sum(&lying.settled[0].depth, 1.0));
    let lost = lying.settled[0].lost;
    assert!(((lies + lost) / fell - 1.0).abs() < 1e-3, "{lies} + {lost} of {fell}");
}

/// A steep roof stands over the yard on both sides of its ridge, and faces away from up as much as
/// leaves do.
#[test]
fn a_steep_roof_is_no_crown() {
    let mut place = Builder::new(4);
    place.surface(DVec3::ZERO, DVec3::X * 12.0, DVec3::Y * 8.0, 0.05, |_, _| [0.4; 3]);
    let up = DVec3::new(1.0, 0.0, 1.2);
    place.surface(DVec3::new(5.0, 1.0, 0.0), up, DVec3::Y * 6.0, 0.05, |_, _| [0.4; 3]);
    place.surface(
        DVec3::new(7.0, 1.0, 0.0),
        up * DVec3::new(-1.0, 1.0, 1.0),
        DVec3::Y * 6.0,
        0.05,
        |_, _| [0.4; 3],
    );
    let cover = cover_of(&place.build(), &Airflow::default(), [6.0, 4.0, 0.0]);
    let ground = &cover.rings[0];
    let high = (0..ground.len()).filter(|node| ground.height[*node] > 0.6).count();
    let leaves = (0..ground.len()).filter(|node| ground.is_crown(*node)).count();
    assert!(high > 100 && leaves * 100 <= high, "{leaves} of leaves, {high} of the roof");
}

/// A lawn as a drone's photos leave it: splats up to a metre off the level that the cameras agree
/// on, and wide ones far below. A post stands on it.
#[test]
fn snow_closes_over_rough_ground_and_posts_stick_out() {
    let splat = |[x, y, z]: [f64; 3], scales: [f64; 3]| Splat {
        mean: [x, y, z].map(|v| v as f32),
        quat: [1.0, 0.0, 0.0, 0.0],
        log_scale: scales.map(|scale| scale.ln() as f32),
        logit_opacity: 1.0,
        rgb: [0.2, 0.5, 0.1],
        group: Group::Scene,
    };
    let (mut splats, mut draws) = (Splats::with_capacity(0, 0), RandomSequence::new(1));
    for _ in 0..600 {
        let mut at = |from: f64, to: f64| from + (to - from) * draws.uniform();
        splats.push(&splat([at(-4.0, 4.0), at(-4.0, 4.0), at(-1.0, 1.0)], [0.03, 0.03, 0.3]));
    }
    let rough = splats.len();
    for x in [-2.5, 2.5] {
        splats.push(&splat([x, -2.5, -5.0], [2.0, 2.0, 0.1]));
    }
    let lawn = splats.len();
    let post = |place: DVec3| (place - DVec3::new(1.5, 1.5, 0.0)).truncate().abs().max_element() < 0.2;
    splats.push(&splat([1.5, 1.5, 0.6], [0.1, 0.1, 0.3]));
    let eyes = [[-3.0, -3.0], [-3.0, 3.0], [0.0, 0.0], [3.0, -3.0], [3.0, 3.0]];
    let views = eyes.map(|[x, y]| {
        let eye = DVec3::new(x, y, 12.0);
        let camera = Camera::looking((160, 120), 50.0, eye, DVec3::ZERO, DVec3::Y).unwrap();
        photo_view(camera, |from, ray| {
            let at = |height: f64| (height - from.z) / ray.z;
            Some(if post(from + at(1.2) * ray) { at(1.2) } else { at(0.0) })
        })
    });
    let scan = FusedSurfaces::from_views(&splats, &views, &SITE);
    let mut cover = Cover::of(&splats, &scan, &SITE, &Airflow::default(), [[0.0; 3]; 2]);
    let hidden = |cover: &mut Cover, depth: f64| -> Vec<f32> {
        cover
            .lay_all(&[CoverRequest { depth, ..COVER_REQUEST }])
            .buried
            .factors
            .iter()
            .map(|seen| 1.0 - seen)
            .collect()
    };
    let snow = hidden(&mut cover, 0.1);
    let far = |index: &usize| (splats.means[*index][0] - 1.5).hypot(splats.means[*index][1] - 1.5) > 1.0;
    let open: Vec<usize> = (0..rough).filter(far).collect();
    let covered = open.iter().filter(|index| snow[**index] > 0.95).count();
    assert!(covered as f64 > 0.97 * open.len() as f64 && open.len() > 400, "{covered} of {}", open.len());
    assert!(snow[rough..lawn].iter().all(|hidden| *hidden > 0.95), "{:?}", &snow[rough..lawn]);
    assert!(snow[lawn] < 0.05, "the post is hidden by {}", snow[lawn]);
    // A dusting hides as much of them as it covers.
    let dusting = hidden(&mut cover, 0.004);
    let share = f64::from(coverage(0.004));
    let mean = open.iter().map(|index| f64::from(dusting[*index])).sum::<f64>() / open.len() as f64;
    assert!((mean - share).abs() < 0.05, "{mean} of {share}");
}

/// Flat splats on the exact surfaces of the built-in street, as far as rays from above and from its
/// views see them.
fn street(place: &Place) -> Splats {
    let mut splats = Splats::with_capacity(0, 0);
    let mut add = |origin: DVec3, direction: DVec3, sigma: f64| {
        let Some(surface) = place.first(origin, direction) else { return };
        let at = origin + direction.normalize() * surface.t;
        if at.truncate().length() > 80.0 {
            return;
        }
        let turn = glam::DQuat::from_rotation_arc(DVec3::Z, surface.normal);
        splats.push(&Splat {
            mean: at.to_array().map(|v| v as f32),
            quat: [turn.w, turn.x, turn.y, turn.z].map(|v| v as f32),
            log_scale: [sigma.ln() as f32, sigma.ln() as f32, -5.5],
            logit_opacity: 4.0,
            rgb: [0.4; 3],
            group: Group::Scene,
        });
    };
    for y in 0..400 {
        for x in 0..360 {
            let at = DVec3::new(f64::from(x) * 0.08 - 19.0, f64::from(y) * 0.08 + 21.0, 40.0);
            add(at, -DVec3::Z, 0.045);
        }
    }
    // Under eaves, from the side.
    for (x, y) in (0..320).flat_map(|y| (0..290).map(move |x| (x, y))) {
        let at = DVec3::new(f64::from(x) * 0.1 - 19.0, f64::from(y) * 0.1 + 21.0, 0.0);
        for way in [DVec3::new(0.5, 0.2, 1.0), DVec3::new(-0.5, -0.2, 1.0)] {
            add(at + 40.0 * way, -way, 0.055);
        }
    }
    // The floor of the porch, which those do not reach.
    let (low, high) = Street::porch();
    for y in 0..100 {
        for x in 0..50 {
            let share = DVec3::new(f64::from(x) / 50.0, f64::from(y) / 100.0, 0.0);
            add(low + share * (high - low) + DVec3::Z * 1.5, -DVec3::Z, 0.045);
        }
    }
    for view in Street::views() {
        let camera = view.camera((160, 120)).unwrap();
        for (x, y) in (0..120).flat_map(|y| (0..160).map(move |x| (x, y))) {
            let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
            add(camera.center(), ray, 0.05);
        }
    }
    splats
}

/// Compares the cover with rays cast at the street.
#[test]
fn the_street_is_covered_where_it_is_open() {
    let place = Street::builtin();
    let splats = street(&place);
    let mut cover = cover_of(&splats, &Airflow::default(), [-5.0, 37.0, 0.0]);
    let lying = cover.lay_all(&[CoverRequest { depth: 0.1, repose: 0.9, ..COVER_REQUEST }]);
    let ground = &cover.rings[0];
    // Depth on the surface of a point: within 6 cm of it in height.
    let depth = |at: DVec3| {
        let (place, height) = ground.places.locate(at.to_array());
        let cell = ground.places.cell_at(place)?;
        let near = |node: &usize| (f64::from(ground.height[*node]) - height).abs() < 0.06;
        Some(ground.nodes_of(cell).find(near).map_or(0.0, |node| lying.settled[0].depth[node]))
    };
    let (mut open, mut covered, mut sum) = (0, 0, 0.0);
    for view in &Street::views() {
        let camera = view.camera((240, 180)).unwrap();
        for (x, y) in (0..180).flat_map(|y| (0..240).map(move |x| (x, y))) {
            let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let Some(surface) = place.first(camera.center(), ray) else { continue };
            let at = camera.center() + ray.normalize() * surface.t;
            let Some(depth) = depth(at) else { continue };
            let over = at + DVec3::Z * 0.03 + surface.normal * 0.03;
            let sees = |x: f64, y: f64| place.first(over, DVec3::new(x, y, 1.0)).is_none();
            let skies = [(0.0, 0.0), (0.35, 0.0), (0.0, 0.35), (-0.35, 0.0), (0.0, -0.35)];
            let exposure = skies.iter().filter(|(x, y)| sees(*x, *y)).count();
            let slope = surface.normal.z.clamp(-1.0, 1.0).acos().to_degrees();
            if exposure == 5 && slope < 30.0 {
                open += 1;
                covered += u32::from(depth > 0.02);
                sum += f64::from(depth);
            }
        }
    }
    let (recall, mean) = (f64::from(covered) / f64::from(open), sum / f64::from(open));
    println!("{} splats: {open} open points, {recall:.4} covered, {mean:.4} m deep", splats.len());
    assert!(open > 2000 && recall > 0.97 && (mean / 0.1 - 1.0).abs() < 0.03);
    // A metre inside the porch.
    let (low, high) = Street::porch();
    let inside = |at: DVec3| {
        // Its back is the house.
        at.x > low.x + 0.1 && at.x < high.x - 1.0 && at.y > low.y + 1.0 && at.y < high.y - 1.0
    };
    let floor: Vec<f32> = (0..ground.height.len())
        .filter(|node| {
            let at = DVec3::from_array(ground.point(*node));
            inside(at) && (at.z - low.z).abs() < 0.2
        })
        .map(|node| lying.settled[0].depth[node])
        .collect();
    let deepest = floor.iter().copied().fold(0.0, f32::max);
    println!("{} nodes a metre inside the porch: at most {deepest:.4} m", floor.len());
    assert!(floor.len() > 50 && deepest < 0.005);
}

/// A house in the middle of a yard.
fn house() -> Splats {
    let mut place = Builder::new(1);
    place.surface(DVec3::ZERO, DVec3::X * 14.0, DVec3::Y * 8.0, 0.05, |_, _| [0.4; 3]);
    place.block(DVec3::new(6.0, 4.0, 0.0), DVec3::new(2.0, 4.0, 2.5), 0.05, [0.5; 3]);
    place.build()
}

/// A house in the middle of a yard: behind it, out of the wind, less lies than before it, and no
/// more than fell lies in all.
#[test]
fn the_lee_of_a_house_holds_less() {
    let splats = house();
    // 5 m/s, and flakes at 1 m/s: no flatter than 45 degrees, towards x.
    let mut cover = cover_of(&splats, &slanted([1.0, 0.0]), [7.0, 4.0, 0.0]);
    let lying = cover.lay_all(&[CoverRequest { depth: 0.1, repose: 0.84, ..COVER_REQUEST }]);
    let side = |x: [f64; 2]| mean(&cover, &lying, x, [3.5, 4.5], [-0.2, 0.2]);
    let (windward, lee, open) = (side([3.6, 4.6]), side([7.3, 8.3]), side([1.0, 3.0]));
    assert!(windward > 0.09 && lee < 0.02 && (open / 0.1 - 1.0).abs() < 0.03, "{windward} {lee} {open}");
}

/// Mass is conserved: lying, melted, shed and blown away add up to the fall on the level area,
/// counted apart from the cover.
#[test]
fn what_falls_is_what_lies() {
    let flows = [([0.0; 2], 0.0), ([0.5, 0.2], 0.0), ([0.4, -0.2], 0.5)];
    for (flow, melted) in flows.into_iter().flat_map(|flow| [(flow, 0.0), (flow, 0.06)]) {
        let (slope, moved) = flow;
        let splats = porch();
        let mut cover = cover_of(&splats, &Airflow { slope, moved }, [5.0, 4.0, 0.0]);
        let lying = cover.lay_all(&[CoverRequest {
            thaw: (melted > 0.0).then(|| Thaw::new(0.1, melted, 0.0)),
            ..COVER_REQUEST
        }]);
        let ground = &cover.rings[0];
        let cell = f64::from(ground.cell).powi(2);
        let lies: f64 = lying.settled[0].depth.iter().map(|d| f64::from(*d) * cell).sum();
        let gone = lying.melted[0] * cell;
        let shed = (lying.settled[0].lost + 0.1 * ground.shed) * cell;
        let fell = 0.1 * yard(ground);
        assert!(((lies + gone + shed) / fell - 1.0).abs() < 0.01, "{flow:?}: {lies} {gone} {shed} {fell}");
        assert!((gone > 0.3 * fell) == (melted > 0.0));
    }
}

/// A wind that carries snow leaves it behind what stands in its way.
#[test]
fn snow_drifts_behind_a_wall() {
    let mut place = Builder::new(1);
    place.surface(DVec3::ZERO, DVec3::X * 20.0, DVec3::Y * 6.0, 0.05, |_, _| [0.4; 3]);
    place.block(DVec3::new(8.0, 3.0, 0.0), DVec3::new(0.4, 6.0, 1.0), 0.05, [0.5; 3]);
    let splats = place.build();
    let side = |moved: f64, x: [f64; 2]| {
        let airflow = Airflow { slope: [0.3, 0.0], moved };
        let mut cover = cover_of(&splats, &airflow, [10.0, 3.0, 0.0]);
        let lying = cover.lay_all(&[COVER_REQUEST]);
        mean(&cover, &lying, x, [2.5, 3.5], [-0.2, 0.2])
    };
    let (before, lee, far) = (side(0.5, [4.0, 6.0]), side(0.5, [9.0, 11.0]), side(0.5, [16.0, 18.0]));
    let still = side(0.0, [9.0, 11.0]);
    assert!(lee > 1.3 * still && (before / 0.1 - 1.0).abs() < 0.05 && far > 0.05, "{before} {lee} {far}");
}

/// Wet snow sticks to the side of a house that the wind meets; dry snow to none.
#[test]
fn wet_snow_sticks_to_the_windward_wall() {
    let splats = house();
    let sides = |lying: &Splats| {
        let between = |x: [f32; 2]| {
            let is = |mean: &&[f32; 3]| {
                let [along, across, up] = **mean;
                let is_beside = across > 2.5 && across < 5.5 && up > 0.6 && up < 2.0;
                along > x[0] && along < x[1] && is_beside
            };
            lying.means.iter().filter(is).count()
        };
        [between([4.8, 5.1]), between([6.9, 7.2])]
    };
    let on_walls = |slope: [f64; 2], wet_fall: f64| {
        let mut cover = cover_of(&splats, &slanted(slope), [7.0, 4.0, 0.0]);
        sides(&cover.lay_all(&[CoverRequest { wet_fall, ..COVER_REQUEST }]).splats)
    };
    let [windward, lee] = on_walls([1.0, 0.0], 0.05);
    assert!(windward > 300 && lee == 0, "{windward} {lee}");
    // The same where the place reaches far, and the widest cells are wide.
    let mut far = Builder::new(2);
    far.surface(DVec3::X * 400.0, DVec3::X * 6.0, DVec3::Y * 6.0, 0.05, |_, _| [0.4; 3]);
    let mut wide = splats.clone();
    wide.append(&far.build());
    let mut cover = cover_of(&wide, &slanted([1.0, 0.0]), [7.0, 4.0, 0.0]);
    assert!(cover.rings.last().unwrap().cell > 0.5);
    let [windward, lee] = sides(&cover.lay_all(&[CoverRequest { wet_fall: 0.05, ..COVER_REQUEST }]).splats);
    assert!(windward > 300 && lee < 30, "{windward} {lee}");
    // Of dry snow hardly any is on walls, and without wind no more of wet.
    let dry = [on_walls([1.0, 0.0], 0.0), on_walls([0.0, 0.0], 0.0)];
    assert!(dry.as_flattened().iter().all(|count| *count < 30), "{dry:?}");
    assert_eq!(on_walls([0.0, 0.0], 0.05), dry[1]);
}

/// Over a time in which it snows and thaws: what fell, from the rate, is what lies and what has
/// melted.
#[test]
fn water_is_kept_over_time() {
    let splats = porch();
    let mut cover = cover_of(&splats, &Airflow::default(), [5.0, 4.0, 0.0]);
    let weather = testing::weather([
        "snowfall.rate=0:2,4:4,6:0",
        "snow_cover.depth=auto",
        // Settled from the start: water is volume times density.
        "snow_cover.density=300",
        "snow_cover.temperature=0:-3,6:-3,8:6",
        "snow_cover.lapse=3600",
        "snow_cover.hours=2",
    ]);
    // 2 h of 2 mm before, then up to 4 and down to 0, by hand.
    for (time, fell) in [(-1.0, 2.0), (0.0, 4.0), (4.0, 16.0), (6.0, 20.0), (9.0, 20.0)] {
        let sky = weather.at(time).prepare(&SITE);
        let lying = cover.lay_all(&sky.cover()[..1]);
        let [lies, melted, shed] = account(&cover, &lying);
        let fell = fell * yard(&cover.rings[0]);
        let all = (lies + melted + shed) / fell;
        assert!((all - 1.0).abs() < 0.01, "{time}: {all}");
        assert!((melted > 0.0) == (time > 6.0));
    }
}

#[test]
fn nothing_lies_where_nothing_can() {
    let asked = CoverRequest { depth: 10.0, repose: 0.84, ..COVER_REQUEST };
    let lying = |splats: &Splats| cover_of(splats, &slanted([0.3, 0.0]), [0.0; 3]).lay_all(&[asked]);
    let nothing = lying(&Splats::with_capacity(0, 0));
    assert!(nothing.splats.is_empty() && nothing.buried.factors.is_empty());
    // A wall, and a sky.
    let mut place = Builder::new(1);
    place.surface(DVec3::ZERO, DVec3::X * 6.0, DVec3::Z * 4.0, 0.05, |_, _| [0.4; 3]);
    let mut wall = place.build();
    let bare = lying(&wall);
    let volume = |lying: &LyingCover| lying.settled[0].depth.iter().map(|d| f64::from(*d)).sum::<f64>();
    println!("{} splats on a wall", bare.splats.len());
    assert!(volume(&bare).is_finite() && bare.splats.check().is_ok());
    wall.groups.fill(Group::Sky);
    assert!(lying(&wall).splats.is_empty());
    assert!(
        Cover::of(&wall, &FusedSurfaces::from_splats(&wall), &SITE, &Airflow::default(), [[0.0; 3]; 2])
            .is_bare()
    );
}
