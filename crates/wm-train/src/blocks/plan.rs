//! The plan of a training in blocks: cells, their photos and configurations, and what all trainings
//! share.

use super::cells::{self, GroundAxes, GroundCell, MIN_PHOTOS, PlacedPhoto};
use super::error::BlockError;
use crate::brightness::NamedGains;
use crate::checkpoint::{FNV_START, hash};
use crate::config::TrainConfig;
use crate::files::write_json;
use crate::haze::PhotoHaze;
use crate::session::{SessionOptions, TrainObserver, WholeSession, confirmed_of};
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::fs;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use wm_base::files::write_durably;
use wm_base::statistics::quantile;
use wm_scene::Scene;
use wm_scene::formats::write_scene;

/// The splats of the sky in the run folder, if there are any.
pub(super) const SKY_FILE: &str = "sky.ply";

/// The version of the plan's format.
const VERSION: u32 = 1;
/// Photos of a block where their number is not given, about: the preset `best` takes 75 steps for
/// each of 400.
const PHOTOS_PER_BLOCK: usize = 400;

/// The number of blocks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BlockCount {
    /// One for every 400 photos.
    #[default]
    Auto,
    /// This many.
    Number(NonZero<u32>),
}

/// A box in the axes of the capture, in the world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlockRegion {
    /// Least coordinates, scene units.
    pub low: [f64; 3],
    /// Greatest coordinates, scene units.
    pub high: [f64; 3],
}

impl BlockRegion {
    /// Returns true if a point is inside.
    pub(crate) fn holds(&self, point: DVec3) -> bool {
        let point = point.to_array();
        (0..3).all(|axis| (self.low[axis]..=self.high[axis]).contains(&point[axis]))
    }
}

/// Options of cutting a capture into blocks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BlockOptions {
    /// The number of blocks.
    pub count: BlockCount,
    /// The box that is trained; `None` trains all that the photos show.
    pub region: Option<BlockRegion>,
}

/// A plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlockPlan {
    version: u32,
    /// The number of training photos of all blocks together.
    pub photos: usize,
    /// The size of the photos, as the options state it.
    photo_size: String,
    /// Every how many photos one is held out, and the first of them.
    hold_out: (u32, u32),
    /// Axes of the cells.
    pub(crate) ground: GroundAxes,
    /// The point of the world that is zero in the capture as it is read, scene units.
    #[serde(default)]
    pub(crate) origin: DVec3,
    /// The box that is trained, in the world.
    pub(crate) region: Option<BlockRegion>,
    /// The folder of the priors, relative to the run folder if it lies there.
    pub(crate) priors: Option<PathBuf>,
    /// Splats of the shared sky, in `sky.ply`.
    pub(crate) sky: usize,
    /// The haze of all photos.
    pub(crate) haze: Option<PlannedHaze>,
    /// The brightness of all photos beside each other.
    pub(crate) gains: Option<NamedGains>,
    /// The blocks.
    pub blocks: Vec<TrainBlock>,
}

/// A block and its training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainBlock {
    /// The cell whose splats the scene has from this block.
    pub(crate) core: GroundCell,
    /// The cell with a fifth of its size around it: photos that show enough of it join.
    pub(crate) reach: GroundCell,
    /// Points of the reconstruction in the core.
    pub points: usize,
    /// Pixels that confirm what two other photos show.
    pub(crate) confirmed: u64,
    /// The configuration of the training, with its seed.
    pub(crate) config: TrainConfig,
    /// Names of the photos that it learns from.
    pub cameras: Vec<String>,
    /// Names of the photos that it is measured on.
    pub(crate) held_out: Vec<String>,
}

/// The haze of photos; see [`PhotoHaze`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlannedHaze {
    /// Extinction a scene unit.
    pub(crate) extinction: f64,
    /// The standard deviation of the extinction; `None` if the extinction was given.
    pub(crate) error: Option<f64>,
    /// Extinction a scene unit as photos show it.
    pub(crate) shown: f64,
    /// Light of endless haze, linear RGB.
    pub(crate) airlight: [f64; 3],
    /// The photos' gains in the haze.
    pub(crate) gains: NamedGains,
}

impl PlannedHaze {
    /// Returns it as trainings take it.
    pub(crate) fn haze(&self) -> PhotoHaze {
        let Self { extinction, error, shown, airlight, .. } = *self;
        PhotoHaze { extinction, error, shown, airlight }
    }
}

impl BlockPlan {
    /// Reads a plan; returns it and its checksum.
    pub(super) fn read(path: &Path) -> Result<(Self, u64), BlockError> {
        let bytes = fs::read(path).map_err(|reason| BlockError::Unread { path: path.to_owned(), reason })?;
        let damaged = |reason: String| BlockError::Damaged { path: path.to_owned(), reason };
        let plan: Self = serde_json::from_slice(&bytes).map_err(|error| damaged(error.to_string()))?;
        if plan.version != VERSION {
            return Err(damaged(format!("version {}, this program reads {VERSION}", plan.version)));
        }
        if plan.blocks.is_empty() {
            return Err(damaged("it has no blocks".into()));
        }
        if let Some(block) = plan.blocks.iter().position(|block| block.cameras.len() < MIN_PHOTOS) {
            return Err(damaged(format!("block {block} has fewer than {MIN_PHOTOS} cameras")));
        }
        for block in &plan.blocks {
            block.config.check().map_err(|error| damaged(error.to_string()))?;
        }
        Ok((plan, hash(FNV_START, &bytes)))
    }

    /// Writes it, so that it outlives a power cut: trainings of hours stand on it.
    pub(super) fn write(&self, path: &Path) -> Result<(), BlockError> {
        write_durably(path, |out| Ok(write_json(self, out)?))?;
        Ok(())
    }

    /// Refuses a plan that was made with other options.
    pub(super) fn check(
        &self,
        path: &Path,
        options: &SessionOptions,
        blocks: &BlockOptions,
    ) -> Result<(), BlockError> {
        let other = |was: String, is: String| BlockError::OtherPlan { path: path.to_owned(), was, is };
        if let BlockCount::Number(count) = blocks.count
            && count.get() as usize != self.blocks.len()
        {
            return Err(other(format!("{} blocks", self.blocks.len()), count.to_string()));
        }
        let size = format!("{:?}", options.dataset.size);
        if size != self.photo_size {
            return Err(other(format!("photos of size {}", self.photo_size), size));
        }
        let hold_out = (options.held_out.every, options.held_out.from);
        if hold_out != self.hold_out {
            let said = |(every, from)| format!("one photo of {every} held out, from {from}");
            return Err(other(said(self.hold_out), said(hold_out)));
        }
        if blocks.region != self.region {
            let said = |region: Option<BlockRegion>| match region {
                Some(BlockRegion { low, high }) => format!("the region {low:?} to {high:?}"),
                None => "no region".into(),
            };
            return Err(other(said(self.region), said(blocks.region)));
        }
        for (index, block) in self.blocks.iter().enumerate() {
            let config = config_of(options, index, block.cameras.len(), block.confirmed)?;
            if config != block.config {
                return Err(other("other options of the training".into(), "these".into()));
            }
        }
        Ok(())
    }

    /// Returns true if a point belongs to the core of a block.
    pub(crate) fn is_core(&self, block: &TrainBlock, point: DVec3) -> bool {
        block.core.holds(self.ground.place(point))
            && self.region.is_none_or(|region| region.holds(point + self.origin))
    }
}

/// Returns the configuration of a block's training: that of a training of its photos, with a seed
/// of its own.
fn config_of(
    options: &SessionOptions,
    block: usize,
    photos: usize,
    confirmed: u64,
) -> Result<TrainConfig, BlockError> {
    let mut config = match options.config.clone() {
        Some(config) => config,
        None => options.plan.config(photos, confirmed)?,
    };
    config.seed = config.seed.wrapping_add(block as u64);
    Ok(config)
}

/// Makes the plan of a data set, and writes the sky.
pub(super) fn make(
    whole: &WholeSession,
    options: &SessionOptions,
    blocks: &BlockOptions,
    folder: &Path,
    observer: &mut dyn TrainObserver,
) -> Result<BlockPlan, BlockError> {
    let (taught, held_out) = (&whole.data.set.places[..], &whole.data.held_out[..]);
    let count = match blocks.count {
        BlockCount::Auto => taught.len().div_ceil(PHOTOS_PER_BLOCK).max(1),
        BlockCount::Number(count) => count.get() as usize,
    };
    if count > taught.len() / MIN_PHOTOS {
        let (photos, most) = (taught.len(), taught.len() / MIN_PHOTOS);
        return Err(BlockError::TooMany { wanted: count, photos, fewest: MIN_PHOTOS, most });
    }
    let points: Vec<DVec3> =
        whole.data.set.capture.points.positions.iter().map(|point| DVec3::from_array(*point)).collect();
    let origin = whole.data.set.capture.origin;
    let is_inside: Vec<bool> =
        points.iter().map(|point| blocks.region.is_none_or(|region| region.holds(*point + origin))).collect();
    if !points.is_empty() && !is_inside.contains(&true) {
        return Err(BlockError::EmptyRegion);
    }
    let seen = [whole.seen_points(taught), whole.seen_points(held_out)];
    let center = |place: &usize, seen: &[u32]| {
        middle(&points, seen).unwrap_or_else(|| whole.data.set.photos.camera(*place, 0).center())
    };
    let middles: Vec<DVec3> = taught.iter().zip(&seen[0]).map(|(place, seen)| center(place, seen)).collect();
    let ground = GroundAxes::of(up(whole, taught), &middles);
    let on_ground: Vec<DVec2> = points.iter().map(|point| ground.place(*point)).collect();
    let places: Vec<DVec2> = middles.iter().map(|middle| ground.place(*middle)).collect();
    let photos: Vec<PlacedPhoto<'_>> =
        places.iter().zip(&seen[0]).map(|(place, seen)| PlacedPhoto { place: *place, seen }).collect();
    let measured = held_out.iter().zip(&seen[1]);
    let measured: Vec<PlacedPhoto<'_>> = measured
        .map(|(place, seen)| PlacedPhoto { place: ground.place(center(place, seen)), seen })
        .collect();
    // Cells are cut where there is something to train.
    let own: Vec<DVec2> = match blocks.region {
        Some(region) => {
            let inside = middles.iter().zip(&places).filter(|(middle, _)| region.holds(**middle + origin));
            inside.map(|(_, place)| *place).collect()
        }
        None => places.clone(),
    };
    let own = if own.len() < count { &places } else { &own };
    let mut planned = Vec::with_capacity(count);
    for (index, (core, reach)) in cells::cells(own, count).into_iter().enumerate() {
        let within = |cell: &GroundCell| -> Vec<bool> {
            on_ground.iter().zip(&is_inside).map(|(at, inside)| *inside && cell.holds(*at)).collect()
        };
        let (in_core, in_reach) = (within(&core), within(&reach));
        let joined: Vec<usize> =
            cells::joining(&photos, &core, &in_core, &in_reach).into_iter().map(|i| taught[i]).collect();
        let shown = measured.iter().zip(held_out).filter(|(photo, _)| {
            let inside = photo.seen.iter().filter(|point| in_reach[**point as usize]).count();
            2 * inside > photo.seen.len()
        });
        let confirmed = confirmed_of(whole, &joined);
        planned.push(TrainBlock {
            core,
            reach,
            points: in_core.iter().filter(|inside| **inside).count(),
            confirmed,
            config: config_of(options, index, joined.len(), confirmed)?,
            held_out: shown.map(|(_, place)| whole.data.set.name(*place).to_owned()).collect(),
            cameras: joined.into_iter().map(|place| whole.data.set.name(place).to_owned()).collect(),
        });
    }
    let names: Vec<String> = taught.iter().map(|place| whole.data.set.name(*place).to_owned()).collect();
    let config = config_of(options, 0, taught.len(), confirmed_of(whole, taught))?;
    let haze = whole.haze(config.haze, observer)?;
    let splats = whole.sky(&config, haze.as_ref())?;
    let sky = splats.len();
    if sky > 0 {
        write_scene(&folder.join(SKY_FILE), &Scene { splats, ..Scene::default() })?;
    }
    Ok(BlockPlan {
        version: VERSION,
        photos: taught.len(),
        photo_size: format!("{:?}", options.dataset.size),
        hold_out: (options.held_out.every, options.held_out.from),
        ground,
        origin,
        region: blocks.region,
        priors: whole.priors.as_ref().map(|priors| match priors.folder.strip_prefix(folder) {
            Ok(inside) => inside.to_owned(),
            Err(_) => std::path::absolute(&priors.folder).unwrap_or_else(|_| priors.folder.clone()),
        }),
        sky,
        haze: haze.map(|(haze, gains)| PlannedHaze {
            extinction: haze.extinction,
            error: haze.error,
            shown: haze.shown,
            airlight: haze.airlight,
            gains: NamedGains::new(&gains, &names),
        }),
        gains: whole.data.gains().map(|gains| NamedGains::new(gains, &names)),
        blocks: planned,
    })
}

/// Returns up, which need not be exact here: that of the capture, or the cameras' own in the mean.
fn up(whole: &WholeSession, places: &[usize]) -> DVec3 {
    let held = || places.iter().map(|place| whole.data.set.photos.camera(*place, 0).up()).sum::<DVec3>();
    whole.data.up.map(|up| up.up).unwrap_or_else(held).try_normalize().unwrap_or(DVec3::Z)
}

/// Returns the median of the points that a photo shows, axis by axis; `None` if it shows none that
/// is finite.
fn middle(points: &[DVec3], seen: &[u32]) -> Option<DVec3> {
    let finite = || seen.iter().map(|point| points[*point as usize]).filter(|point| point.is_finite());
    let along = |axis: usize| {
        let mut values: Vec<f64> = finite().map(|point| point.to_array()[axis]).collect();
        quantile(&mut values, 0.5)
    };
    finite().next().map(|_| DVec3::new(along(0), along(1), along(2)))
}
