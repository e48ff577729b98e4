//! Depth and normals by multi-view stereo from photos with known cameras, without a network.
//!
//! Each pixel has a plane, stored as inverse depth over the image, `1 / z = a x + b y + c`, which
//! induces a homography into every other photo. Planes start at the points of the reconstruction
//! or at random, spread to neighbours and are varied (PatchMatch: Barnes et al. 2009; as stereo:
//! Bleyer et al. 2011; over a chessboard: Galliani et al. 2015). The cost of a plane is the
//! normalised correlation of the window around the pixel, weighted by distance and brightness,
//! with the two best other photos. Half the size comes first. Pixels are kept where the planes of
//! other photos lead back to the same pixel.

mod check;
mod matching;
mod sweep;

use super::normals::normals;
use super::points::{has_tracks, seen_points};
use crate::photo_warp::PhotoWarp;
use crate::photos::{PhotoError, Photos, level_for};
use glam::DVec3;
use matching::{StereoImage, StereoSource};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};
use sweep::{MAX_SOURCES, PlaneMap, Reference, Round, SourceChoice, doubled};
use wm_capture::Capture;
use wm_scene::Camera;

/// Options of stereo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StereoOptions {
    /// Most pixels of a photo; sides are halved until it has no more.
    pub(crate) pixels: u32,
    /// Other photos that each is compared with.
    pub(crate) sources: usize,
    /// Rounds at half the size and at the whole.
    pub(crate) rounds: (u32, u32),
    /// The seed of its random numbers.
    pub(crate) seed: u64,
}

impl Default for StereoOptions {
    fn default() -> Self {
        Self { pixels: 100_000, sources: 6, rounds: (4, 2), seed: 0 }
    }
}

/// The depth and normals of one photo.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct StereoMap {
    /// Inverse view z, 1 / scene unit, `[H, W]`, NaN where it is not known.
    pub(crate) disparity: Vec<f32>,
    /// World axes, towards the camera, `[H, W, 3]`, 0 where it is not known.
    pub(crate) normal: Vec<[f32; 3]>,
}

/// Triangulation angles below and above which photos are hard to compare, degrees.
const NARROW_ANGLE_DEG: f64 = 4.0;
const WIDE_ANGLE_DEG: f64 = 35.0;
/// Fewest points in view of a photo.
const MIN_POINTS: usize = 8;
/// Least ratio of the distance of the nearest surface to that of the near points.
const MIN_DISTANCE_RATIO: f64 = 0.2;
/// Shortest side of a photo that is still halved, px.
const MIN_HALVED_SIDE_PX: u32 = 64;
/// Shortest side of a photo that can be compared, px.
const MIN_SIDE_PX: u32 = 16;
/// Half the side of the window of normals, px.
const HALF_NORMAL_WINDOW_PX: usize = 3;
/// Radius within which a point of the reconstruction initialises planes, px.
const START_RADIUS_PX: isize = 12;

/// Returns how often the sides of photos are halved.
pub(crate) fn level(photos: &Photos, places: &[usize], options: &StereoOptions) -> u8 {
    let cameras: Vec<Camera> = places.iter().map(|place| photos.camera(*place, 0)).collect();
    level_for(&cameras, options.pixels, MIN_HALVED_SIDE_PX)
}

/// Computes the maps of the photos `places` (indices in `photos`); `None` for those that cannot be
/// compared with others. `progress` receives the number of passes that are done, of two per photo,
/// and returns false to stop.
///
/// # Errors
/// [`PhotoError`] if a photo is damaged.
pub(crate) fn estimate(
    capture: &Capture,
    photos: &Photos,
    places: &[usize],
    options: &StereoOptions,
    progress: &(dyn Fn(usize) -> bool + Sync),
) -> Result<Option<Vec<Option<StereoMap>>>, PhotoError> {
    let level = level(photos, places, options);
    if places.iter().any(|place| {
        photos.camera(*place, 0).width.min(photos.camera(*place, 0).height) >> level < MIN_SIDE_PX
    }) {
        return Ok(Some(vec![None; places.len()]));
    }
    let cameras: Vec<Camera> = places.iter().map(|place| photos.camera(*place, level)).collect();
    let halves: Vec<Camera> = places.iter().map(|place| photos.camera(*place, level + 1)).collect();
    let picture = |place: &usize, level: u8| {
        photos.get(*place, level).map(|photo| StereoImage::of(&photo.rgb, photo.width as usize))
    };
    let whole: Vec<StereoImage> =
        places.par_iter().map(|place| picture(place, level)).collect::<Result<_, _>>()?;
    let half: Vec<StereoImage> =
        places.par_iter().map(|place| picture(place, level + 1)).collect::<Result<_, _>>()?;

    let seen = seen_points(capture, photos, places);
    let sources = if has_tracks(capture) {
        choose_sources(capture, &cameras, &seen, options.sources)
    } else {
        sources_by_pose(capture, &cameras, &seen, options.sources)
    };
    let done = AtomicUsize::new(0);
    let sweep = |index: usize| -> Option<Option<PlaneMap>> {
        let found =
            (sources[index].len() >= 2 || places.len() == 2 && !sources[index].is_empty()).then(|| {
                let start = |camera: &Camera| start_map(capture, camera, &seen[index]);
                let coarse = reference_of(capture, index, &half, &halves, &sources, &seen, options.seed)?;
                let mut planes = coarse.begin(&start(&halves[index]));
                for round in 0..options.rounds.0 {
                    let ask = if round < 2 { SourceChoice::All } else { SourceChoice::Best };
                    let reach = 0.7f32.powi(round as i32);
                    coarse.run(Round { number: round + 1, reach, ask }, &mut planes);
                }
                let fine =
                    reference_of(capture, index, &whole, &cameras, &sources, &seen, options.seed ^ 0xf19e)?;
                let mut planes = PlaneMap {
                    planes: doubled(&planes.planes, &half[index], &whole[index]),
                    costs: Vec::new(),
                };
                fine.judge(&mut planes);
                for round in 0..options.rounds.1 {
                    let reach = 0.25 * 0.5f32.powi(round as i32);
                    fine.run(Round { number: round + 1, reach, ask: SourceChoice::Best }, &mut planes);
                }
                Some(planes)
            });
        progress(done.fetch_add(1, Ordering::Relaxed) + 1).then_some(found.flatten())
    };
    let swept: Option<Vec<Option<PlaneMap>>> = (0..places.len()).into_par_iter().map(sweep).collect();
    let Some(swept) = swept else { return Ok(None) };

    let compare = |index: usize| -> Option<Option<StereoMap>> {
        let map = swept[index].as_ref().and_then(|planes| {
            let reference = reference_of(capture, index, &whole, &cameras, &sources, &seen, 0)?;
            let others: Vec<check::OtherPhoto<'_>> = (sources[index].iter().zip(&reference.sources))
                .filter_map(|(other, there)| {
                    let planes = swept[*other].as_ref()?;
                    let back = PhotoWarp::new(&cameras[*other], &cameras[index]);
                    let depth = depth_row(&cameras[index], &cameras[*other]);
                    Some(check::OtherPhoto { there, planes, back, depth })
                })
                .collect();
            if others.is_empty() {
                return None;
            }
            let disparity = check::agreed(&reference, planes, &others);
            let normal = normals(&disparity, &cameras[index], HALF_NORMAL_WINDOW_PX);
            Some(StereoMap { disparity, normal })
        });
        progress(done.fetch_add(1, Ordering::Relaxed) + 1).then_some(map)
    };
    Ok((0..places.len()).into_par_iter().map(compare).collect())
}

/// Chooses for each photo the others that show most of its points under good triangulation angles.
fn choose_sources(capture: &Capture, cameras: &[Camera], seen: &[Vec<u32>], most: usize) -> Vec<Vec<usize>> {
    let mut photos_of = vec![Vec::new(); capture.points.len()];
    for (photo, points) in seen.iter().enumerate() {
        for point in points {
            photos_of[*point as usize].push(photo as u32);
        }
    }
    let centers: Vec<DVec3> = cameras.iter().map(Camera::center).collect();
    let of = |photo: usize| {
        let mut scores = vec![0.0f64; cameras.len()];
        for point in &seen[photo] {
            let at = DVec3::from_array(capture.points.positions[*point as usize]);
            for other in photos_of[*point as usize].iter().map(|other| *other as usize) {
                if other != photo {
                    scores[other] += angle_score(at, centers[photo], centers[other]);
                }
            }
        }
        best(&scores, most)
    };
    (0..cameras.len()).into_par_iter().map(of).collect()
}

/// Returns the score of photos at `a` and `b` for triangulating a point, 0-1: best at medium
/// angles.
fn angle_score(point: DVec3, a: DVec3, b: DVec3) -> f64 {
    let angle = (point - a).normalize_or_zero().angle_between((point - b).normalize_or_zero()).to_degrees();
    let score = (angle / NARROW_ANGLE_DEG).min(1.0) * (1.0 - angle / WIDE_ANGLE_DEG).clamp(0.0, 1.0);
    if score.is_finite() { score * score } else { 0.0 }
}

/// Returns the photos with the highest scores above 0.
fn best(scores: &[f64], most: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..scores.len()).filter(|other| scores[*other] > 0.0).collect();
    order.sort_by(|a, b| scores[*b].total_cmp(&scores[*a]).then(a.cmp(b)));
    order.truncate(most.min(MAX_SOURCES));
    order
}

/// Most points by which the sources of a photo are chosen.
const MAX_PROBES: usize = 200;
/// Range of the ratio of a point's distances from two photos at which they can be compared.
const DISTANCE_RATIOS: std::ops::RangeInclusive<f64> = 0.5..=2.0;
/// Distances of the tested places if no points are known, in distances between neighbouring
/// cameras.
const TRIED_DISTANCES: [f64; 4] = [3.0, 6.0, 12.0, 24.0];

/// For each photo the others whose cameras see the same places under angles that tell distances,
/// and from like distances. The places are the points that the photo may show, or places along its
/// rays where there are too few.
fn sources_by_pose(capture: &Capture, cameras: &[Camera], seen: &[Vec<u32>], most: usize) -> Vec<Vec<usize>> {
    let centers: Vec<DVec3> = cameras.iter().map(Camera::center).collect();
    let of = |photo: usize| {
        let camera = &cameras[photo];
        let probes: Vec<DVec3> = if seen[photo].len() >= MIN_POINTS {
            let step = seen[photo].len() / MAX_PROBES + 1;
            let at = |point: &u32| DVec3::from_array(capture.points.positions[*point as usize]);
            seen[photo].iter().step_by(step).map(at).collect()
        } else {
            let unit = baseline(&centers, photo);
            let shares = [1.0, 3.0, 5.0].map(|v| v / 6.0);
            let rays = shares.iter().flat_map(|y| shares.iter().map(move |x| (*x, *y)));
            let rays =
                rays.map(|(x, y)| camera.ray(x * f64::from(camera.width), y * f64::from(camera.height)));
            rays.flat_map(|ray| {
                TRIED_DISTANCES.map(|far| centers[photo] + ray.normalize_or_zero() * far * unit)
            })
            .collect()
        };
        let mut scores = vec![0.0f64; cameras.len()];
        for (other, score) in scores.iter_mut().enumerate().filter(|(other, _)| *other != photo) {
            let there = &cameras[other];
            let shows = |at: &&DVec3| {
                there.project(**at).is_some_and(|(x, y, z)| {
                    let (width, height) = (f64::from(there.width), f64::from(there.height));
                    let own = camera.viewmat.transform_point3(**at).z;
                    (0.0..width).contains(&x)
                        && (0.0..height).contains(&y)
                        && DISTANCE_RATIOS.contains(&(z / own))
                })
            };
            *score =
                probes.iter().filter(shows).map(|at| angle_score(*at, centers[photo], centers[other])).sum();
        }
        best(&scores, most)
    };
    (0..cameras.len()).into_par_iter().map(of).collect()
}

/// Returns the distance from a camera to the nearest one at another position; 1 if there is none.
fn baseline(centers: &[DVec3], photo: usize) -> f64 {
    let distances = centers.iter().map(|center| center.distance(centers[photo])).filter(|d| *d > 0.0);
    let nearest = distances.fold(f64::INFINITY, f64::min);
    if nearest.is_finite() { nearest } else { 1.0 }
}

/// Returns the view z of points, ascending.
fn distances(capture: &Capture, camera: &Camera, seen: &[u32]) -> Vec<f64> {
    let z = |point: &u32| {
        let at = DVec3::from_array(capture.points.positions[*point as usize]);
        camera.viewmat.transform_point3(at).z
    };
    let mut distances: Vec<f64> = seen.iter().map(z).filter(|z| z.is_finite() && *z > 0.0).collect();
    distances.sort_by(f64::total_cmp);
    distances
}

/// Returns inverse depth around the points that a photo shows, `[H, W]`, 0 elsewhere.
fn start_map(capture: &Capture, camera: &Camera, seen: &[u32]) -> Vec<f32> {
    let (width, height) = (camera.width as isize, camera.height as isize);
    let mut map = vec![0.0; (width * height) as usize];
    let mut off = vec![isize::MAX; map.len()];
    for point in seen {
        let at = DVec3::from_array(capture.points.positions[*point as usize]);
        let Some((x, y, z)) = camera.project(at) else { continue };
        let (column, row) = (x as isize, y as isize);
        for dy in -START_RADIUS_PX..=START_RADIUS_PX {
            for dx in -START_RADIUS_PX..=START_RADIUS_PX {
                let (column, row, square) = (column + dx, row + dy, dx * dx + dy * dy);
                if column >= 0 && row >= 0 && column < width && row < height {
                    let pixel = (row * width + column) as usize;
                    if square < off[pixel] {
                        (off[pixel], map[pixel]) = (square, (1.0 / z) as f32);
                    }
                }
            }
        }
    }
    map
}

fn reference_of<'a>(
    capture: &Capture,
    index: usize,
    pictures: &'a [StereoImage],
    cameras: &[Camera],
    sources: &[Vec<usize>],
    seen: &[Vec<u32>],
    seed: u64,
) -> Option<Reference<'a>> {
    let camera = &cameras[index];
    let distances = distances(capture, camera, &seen[index]);
    let near = if distances.len() >= MIN_POINTS {
        distances[distances.len() / 50]
    } else if has_tracks(capture) {
        return None;
    } else {
        // Without points, only the distance between cameras bounds the depth.
        let centers: Vec<DVec3> = cameras.iter().map(Camera::center).collect();
        TRIED_DISTANCES[0] * baseline(&centers, index)
    };
    Some(Reference {
        picture: &pictures[index],
        intrinsics: [camera.fx, camera.fy, camera.cx, camera.cy].map(|v| v as f32),
        sources: sources[index]
            .iter()
            .map(|other| StereoSource {
                picture: &pictures[*other],
                warp: PhotoWarp::new(camera, &cameras[*other]),
            })
            .collect(),
        nearest: (1.0 / (MIN_DISTANCE_RATIO * near)) as f32,
        seed: seed ^ (index as u64) << 32,
    })
}

/// View z in `to` of a point that `from` sees at z along its ray: `z (row . ray) + shift`.
fn depth_row(from: &Camera, to: &Camera) -> ([f32; 3], f32) {
    let relative = to.viewmat * from.viewmat.inverse();
    let row = relative.row(2);
    ([row.x, row.y, row.z].map(|v| v as f32), row.w as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photos::PhotoOptions;
    use std::path::Path;
    use wm_base::random::uniform;
    use wm_capture::{CaptureView, Observation};
    use wm_scene::{SparsePoints, camera::Distortion};

    const SIZE: (u32, u32) = (120, 90);

    /// Speckles some hundredths of a unit wide, smooth between.
    fn texture(u: f64, v: f64) -> f64 {
        let (x, y) = (25.0 * u, 25.0 * v);
        let at =
            |i: f64, j: f64| uniform(8, ((x.floor() + i + 4096.0) * 8192.0 + y.floor() + j + 4096.0) as u64);
        let (a, b) = (x.fract().rem_euclid(1.0), y.fract().rem_euclid(1.0));
        let mix = |p: f64, q: f64, t: f64| p + (q - p) * t;
        mix(mix(at(0.0, 0.0), at(1.0, 0.0), a), mix(at(0.0, 1.0), at(1.0, 1.0), a), b)
    }

    /// The floor z = 0 and the wall y = 3 behind it, and nothing above: distance along a ray and
    /// colour.
    fn cast(eye: DVec3, ray: DVec3) -> Option<(f64, f64)> {
        let (floor, wall) = (-eye.z / ray.z, (3.0 - eye.y) / ray.y);
        let t = if floor > 0.0 && (floor < wall || wall < 0.0) { floor } else { wall };
        let p = eye + ray * t;
        let color = if t == floor { texture(p.x, p.y) } else { texture(p.x + 50.0, p.z) };
        (t > 0.0 && p.z < 1.5).then_some((t, color))
    }

    fn capture(folder: &Path) -> Capture {
        let mut capture = Capture { source: folder.into(), images: folder.into(), ..Capture::default() };
        for index in 0..60 {
            let (x, y) = (2.0 * uniform(1, index) - 1.0, 3.0 * uniform(2, index));
            capture.points.push([x, y, 0.0], [0; 3], 0.0, 5);
        }
        for index in 0..5 {
            let eye = DVec3::new(0.5 * f64::from(index) - 1.0, -3.0, 1.0);
            let camera = Camera::looking(SIZE, 50.0, eye, DVec3::new(0.0, 1.5, 0.3), DVec3::Z).unwrap();
            let mut rgb = Vec::new();
            for pixel in 0..SIZE.0 * SIZE.1 {
                let ray = camera.ray(f64::from(pixel % SIZE.0) + 0.5, f64::from(pixel / SIZE.0) + 0.5);
                let value = cast(eye, ray).map_or(250, |(_, color)| (40.0 + 170.0 * color) as u8);
                rgb.extend([value; 3]);
            }
            let name = format!("{index}.png");
            let bytes = crate::photos::encode_png(SIZE.0, SIZE.1, png::ColorType::Rgb, &rgb);
            std::fs::write(folder.join(&name), bytes).unwrap();
            let seen = |point: u32| {
                let at = DVec3::from_array(capture.points.positions[point as usize]);
                let (x, y, _) = camera.project(at)?;
                Some(Observation { point, xy: [x as f32, y as f32] })
            };
            let observations = (0..60).filter_map(seen).collect();
            capture.observations.push(observations);
            let (distortion, file) = (Distortion::None, name.clone().into());
            capture.views.push(CaptureView {
                name,
                camera,
                distortion,
                camera_id: 1,
                file,
                mask: None,
                original: None,
            });
        }
        capture
    }

    #[test]
    fn floor_and_wall_are_found_and_the_sky_is_not_with_any_number_of_threads() {
        let folder = tempfile::tempdir().unwrap();
        let capture = capture(folder.path());
        let photos = Photos::open(&capture, &PhotoOptions::default()).unwrap();
        let places: Vec<usize> = (0..5).collect();
        let options = StereoOptions { rounds: (3, 1), ..StereoOptions::default() };
        let with = |threads| {
            let estimate = || estimate(&capture, &photos, &places, &options, &|_| true);
            wm_render::cpu::pool(threads).unwrap().install(estimate).unwrap().unwrap()
        };
        let maps = with(1);
        let (mut errors, mut angles, mut surface, mut sky) = (Vec::new(), Vec::new(), 0, 0);
        for (view, map) in capture.views.iter().zip(&maps) {
            let (camera, map) = (&view.camera, map.as_ref().unwrap());
            let eye = camera.center();
            for (i, disparity) in map.disparity.iter().enumerate() {
                let ray = camera.ray((i % 120) as f64 + 0.5, (i / 120) as f64 + 0.5);
                let hit = cast(eye, ray);
                surface += usize::from(hit.is_some());
                let Some((t, _)) = hit else {
                    sky += usize::from(!disparity.is_nan());
                    continue;
                };
                if !disparity.is_nan() {
                    let z = camera.viewmat.transform_point3(eye + ray * t).z;
                    errors.push((z * f64::from(*disparity) - 1.0).abs());
                    let normal = DVec3::from_array(map.normal[i].map(f64::from));
                    let truth = if (eye + ray * t).z.abs() < 1e-6 { DVec3::Z } else { DVec3::NEG_Y };
                    if normal != DVec3::ZERO {
                        angles.push(normal.angle_between(truth).to_degrees());
                    }
                }
            }
        }
        errors.sort_by(f64::total_cmp);
        angles.sort_by(f64::total_cmp);
        let known = errors.len() as f64 / surface as f64;
        let (error, angle) = (errors[errors.len() * 9 / 10], angles[angles.len() / 2]);
        println!("known {known:.2}, {error:.4} off at the 90th percentile, {angle:.1} degrees, sky {sky}");
        // A tenth of a pixel at these baselines is 0.5 % of the distance.
        assert!(known > 0.4 && error < 0.02 && angle < 8.0 && sky < surface / 100);
        // NaN is not itself.
        assert_eq!(format!("{maps:?}"), format!("{:?}", with(3)));
        // Without tracks and without points cameras alone say which photos to compare.
        let share = |maps: &[Option<StereoMap>]| {
            let known = maps.iter().flatten().flat_map(|map| &map.disparity).filter(|v| !v.is_nan()).count();
            known as f64 / surface as f64
        };
        let mut bare = capture.clone();
        bare.observations = vec![Vec::new(); 5];
        let untracked = estimate(&bare, &photos, &places, &options, &|_| true).unwrap().unwrap();
        bare.points = SparsePoints::default();
        let pointless = estimate(&bare, &photos, &places, &options, &|_| true).unwrap().unwrap();
        let shares = [&maps, &untracked, &pointless].map(|maps| share(maps));
        println!("known with tracks, points, and neither {shares:.2?}");
        assert!(shares[1] > 0.8 * shares[0] && shares[2] > 0.5 * shares[0]);
        let stopped = estimate(&capture, &photos, &places, &options, &|done| done < 3);
        assert!(stopped.unwrap().is_none());
    }
}
