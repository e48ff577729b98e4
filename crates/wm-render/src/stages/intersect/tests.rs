use super::cpu::{Pairs, PatchBox, offsets};
use super::{PATCHES_PER_TILE, TileGrid, record_of};
#[cfg(feature = "gpu")]
use crate::config::RenderConfig;
use crate::cpu::model::CpuModel;
use crate::dispatch;
#[cfg(feature = "gpu")]
use crate::gpu::probe::Probe;
use crate::hooks::{GROUP, PATCH, ShadeGroup};
use crate::simd::SimdPath;
use crate::stages::project::cpu::{ProjectedGroup, project_group};
use crate::stages::project::{LOG2_MIN_ALPHA, ProjectCamera, Record};
use crate::testing::comparison::HardSplats;
use crate::testing::{Backend, camera, random_splats};
use std::sync::atomic::{AtomicU64, Ordering};
use wm_scene::{Rasterization, Splats};

const SIZE: (u32, u32) = (150, 90);
/// Patches of the picture.
const COLUMNS: usize = 10;
const ROWS: usize = 6;

crate::parity! {
    no_pixel_is_lost_and_no_patch_is_kept_in_vain => |backend| {
        check(backend, &random_splats(700, 0, 1));
        for hard in HardSplats::ALL {
            check(backend, &hard.splats(300, 2));
        }
    };
}

/// Records in view, with their boxes.
fn project(path: SimdPath, splats: &Splats) -> (Vec<Record>, Vec<PatchBox>) {
    let camera = ProjectCamera::new(&camera(SIZE.0, SIZE.1));
    let model = CpuModel::new(splats).unwrap();
    let (mut records, mut boxes) = (Vec::new(), Vec::new());
    for group in &model.groups {
        let (mut p, mut shade) = (ProjectedGroup::default(), ShadeGroup::default());
        dispatch!(path, s => project_group(s, group, &camera, Rasterization::Classic, None, None, &mut p, &mut shade));
        let transposed = dispatch!(path, s => Record::transposed(s, &p, &shade, 0));
        for lane in (0..GROUP).filter(|lane| p.mask >> lane & 1 == 1) {
            boxes.push(PatchBox {
                columns: p.columns.map(|ends| ends[lane] as u16),
                rows: p.rows.map(|ends| ends[lane] as u16),
            });
            records.push(transposed[lane]);
        }
    }
    (records, boxes)
}

/// log2 alpha of a record at a picture point.
fn log2_alpha(r: &Record, x: f64, y: f64) -> f64 {
    let (dx, dy) = (x - f64::from(r.x), y - f64::from(r.y));
    let (u, v) = (f64::from(r.ux) * dx, f64::from(r.vx) * dx + f64::from(r.vy) * dy);
    f64::from(r.log2_opacity) - u * u - v * v
}

/// Records in view, and whether each is listed for each patch of 16x16 px:
/// `[records][rows][columns]`.
fn lists(backend: Backend, splats: &Splats) -> (Vec<Record>, Vec<bool>) {
    match backend {
        Backend::Cpu(path) => lists_of_cpu(path, splats),
        #[cfg(feature = "gpu")]
        Backend::Gpu => lists_of_gpu(splats),
    }
}

fn lists_of_cpu(path: SimdPath, splats: &Splats) -> (Vec<Record>, Vec<bool>) {
    let (records, boxes) = project(path, splats);
    let grid = TileGrid::new(SIZE.0, SIZE.1);
    // In two parts, as threads do it.
    let mut parts = [Pairs::default(), Pairs::default()];
    let half = records.len() / 2;
    for (part, range) in parts.iter_mut().zip([0..half, half..records.len()]) {
        part.clear(grid);
        let (splats, bounds, first) = (&records[range.clone()], &boxes[range.clone()], range.start as u32);
        dispatch!(path, s => part.extend(s, splats, bounds, first, grid));
    }
    let mut bounds = Vec::new();
    offsets(grid.tiles(), parts.iter_mut(), &mut bounds);
    let total = bounds[grid.tiles()] as usize;
    let lists: Vec<AtomicU64> = (0..total).map(|_| AtomicU64::new(u64::MAX)).collect();
    for part in &mut parts {
        part.scatter(&lists);
    }

    let mut listed = vec![false; records.len() * COLUMNS * ROWS];
    for tile in 0..grid.tiles() {
        let mut names = Vec::new();
        for key in &lists[bounds[tile] as usize..bounds[tile + 1] as usize] {
            let key = key.load(Ordering::Relaxed);
            let record = record_of(key);
            assert_eq!((key >> 32) as u32, records[record].depth.to_bits());
            assert_ne!(key & 15, 0);
            names.push(record);
            for patch in (0..PATCHES_PER_TILE).filter(|patch| key >> patch & 1 == 1) {
                let column = tile % grid.columns as usize * 2 + patch % 2;
                let row = tile / grid.columns as usize * 2 + patch / 2;
                if column < COLUMNS && row < ROWS {
                    listed[(record * ROWS + row) * COLUMNS + column] = true;
                }
            }
        }
        let all = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), all, "a record is twice in tile {tile}");
    }
    (records, listed)
}

/// The GPU's tiles are patches, and their lists are sorted.
#[cfg(feature = "gpu")]
fn lists_of_gpu(splats: &Splats) -> (Vec<Record>, Vec<bool>) {
    let Probe { records, lists } = Probe::of(splats, &camera(SIZE.0, SIZE.1), &RenderConfig::default());
    assert_eq!(lists.len(), COLUMNS * ROWS);
    let mut listed = vec![false; records.len() * lists.len()];
    for (tile, list) in lists.iter().enumerate() {
        let keys: Vec<(u32, u32)> =
            list.iter().map(|name| (records[*name as usize].depth.to_bits(), *name)).collect();
        assert!(keys.windows(2).all(|pair| pair[0] < pair[1]), "tile {tile} is not sorted");
        list.iter().for_each(|name| listed[*name as usize * COLUMNS * ROWS + tile] = true);
    }
    (records, listed)
}

fn check(backend: Backend, splats: &Splats) {
    let (records, listed) = lists(backend, splats);
    let cut = f64::from(LOG2_MIN_ALPHA);
    for (i, record) in records.iter().enumerate() {
        for row in 0..ROWS {
            for column in 0..COLUMNS {
                let (left, top) = (column * PATCH, row * PATCH);
                let inside = |x: usize, y: usize| x < SIZE.0 as usize && y < SIZE.1 as usize;
                let best = (0..PATCH * PATCH)
                    .map(|p| (left + p % PATCH, top + p / PATCH))
                    .filter(|(x, y)| inside(*x, *y))
                    .map(|(x, y)| log2_alpha(record, x as f64 + 0.5, y as f64 + 0.5))
                    .fold(f64::NEG_INFINITY, f64::max);
                let kept = listed[(i * ROWS + row) * COLUMNS + column];
                assert!(kept || best < cut, "record {i} lost in patch {column}, {row}: {best}");
                if kept && best < cut && inside(left + PATCH - 1, top + PATCH - 1) {
                    // Between the centres the rectangle may be touched, if by less than the slack.
                    let fine = (0..=120 * 120)
                        .map(|p| {
                            (
                                left as f64 + 0.5 + f64::from(p % 121) / 8.0,
                                top as f64 + 0.5 + f64::from(p / 121) / 8.0,
                            )
                        })
                        .map(|(x, y)| log2_alpha(record, x, y))
                        .fold(f64::NEG_INFINITY, f64::max);
                    let step = 0.125 * f64::from(record.ux.abs() + record.vx.abs() + record.vy.abs());
                    let reach = (f64::from(record.log2_opacity) - cut).max(0.0).sqrt();
                    assert!(
                        fine > cut - 0.01 - 2.0 * step * (step + reach),
                        "record {i} in vain in patch {column}, {row}"
                    );
                }
            }
        }
    }
}
