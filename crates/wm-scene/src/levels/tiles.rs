//! A scene in levels as 3D Tiles 1.1, for CesiumJS and others.
//!
//! `tileset.json` has a binary tree of tiles; beside it, `tiles/<number>.glb` has the splats of
//! each as SPZ in glTF (`KHR_gaussian_splatting_compression_spz_2`), as CesiumJS reads it. A leaf
//! of the index is a tile with its finest splats. A tile above has the splats of its leaves at the
//! level that is as many steps coarser as it is above them, and is replaced by the tiles below it:
//! where levels halve, each tile has about as many splats as a leaf. Above the coarsest level tiles
//! are empty. The splats that are always drawn are in the root, to which the rest is added.
//!
//! Tiles stand on the globe where the scene's place is known, else about the middle of the scene; a
//! local origin of the scene is noted in `asset.extras.origin`, in the scene's units and axes.
//!
//! Lengths are metres where the scene's scale is known, else scene units. A tile's own axes are x
//! east, y north, z up, with the middle of its box as origin.

use super::{
    LevelFile, LevelIndex, LevelLeaf,
    tree::{BoxTree, Extent},
    writer::ellipsoids,
};
use crate::formats::format::WriteOptions;
use crate::formats::{GltfSplats, write_scene_with};
use crate::{Gps, Metadata, Scene, Splats};
use glam::{DMat3, DMat4, DVec3};
use serde_json::{Value, json};
use std::{
    fs,
    io::ErrorKind,
    ops::Range,
    path::{Path, PathBuf},
};
use wm_base::{FormatError, Problem, files::write_atomically, statistics::quantile};

/// The tiles of a scene in levels, to be written in any order and on any threads, and then their
/// `tileset.json`.
pub struct TilePlan<'a> {
    index: &'a LevelIndex,
    main: PathBuf,
    /// SH above this degree are left out.
    sh_degree: u8,
    /// Metres a unit.
    metres: f64,
    /// The point of the scene that is the origin of the root, scene units.
    origin: DVec3,
    transform: DMat4,
    environment: Option<Extent>,
    root: Tile,
    /// The tiles that have splats, depth first.
    contents: Vec<Content>,
    notes: Vec<String>,
}

struct Tile {
    extent: Extent,
    /// Error of the tile in place of those below it, metres.
    error: f64,
    /// Index among the contents.
    content: Option<usize>,
    children: Vec<Self>,
}

struct Content {
    /// Indices of its leaves.
    leaves: Vec<usize>,
    /// The position in the runs of each, or the last.
    level: usize,
    /// The point that is its origin, scene units.
    middle: DVec3,
}

/// Most decoded files that are kept while tiles are written; neighbouring tiles share them.
const MAX_OPEN_FILES: usize = 8;

/// Geometric error of a tile in distances between its splats: at the 16 pixels of error that
/// CesiumJS allows, splats are 2 pixels apart when their tile is replaced. The distance is the
/// diagonal of a leaf over the square root of its number of splats, as on a surface.
const ERROR_PER_SPACING: f64 = 8.0;

impl<'a> TilePlan<'a> {
    /// Plans the tiles of `index`, for a `main` that is called `tileset.json`, without SH above
    /// `sh_degree` (0 to 3). Makes its folder, and removes the file `main` if it is there.
    ///
    /// # Errors
    /// [`FormatError`] if the index states no boxes, the environment cannot be read, or the folder
    /// cannot be made.
    pub fn new(index: &'a LevelIndex, main: &Path, sh_degree: u8) -> Result<Self, FormatError> {
        let fault = |problem| FormatError::whole(main, problem);
        let boxes: Vec<Extent> = index.leaves.iter().map(LevelLeaf::extent).collect();
        if let Some(leaf) = boxes.iter().position(|extent| !extent.is_finite()) {
            let what = format!("leaf {leaf} has no box, which tiles need; write the levels again");
            return Err(FormatError::whole(index.path(), Problem::Value(what)));
        }
        let tree = BoxTree::of(&boxes).ok_or_else(|| FormatError::whole(index.path(), Problem::NoSplats))?;
        let environment = index.read_environment()?.map(|scene| ellipsoids(&[scene.splats]));
        let environment = environment.filter(Extent::is_finite);
        let folder = main.with_file_name("tiles");
        fs::create_dir_all(folder).map_err(|error| fault(error.into()))?;
        match fs::remove_file(main) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(fault(error.into())),
            _ => {}
        }
        let metres = index.metadata.metres_per_unit.unwrap_or(1.0);
        let mut contents = Vec::new();
        let weights = loss_weights(&index.leaves);
        let (root, ..) = Tile::of(&tree, &index.leaves, &weights, metres, &mut contents);
        let (origin, transform, notes) = placed(&index.metadata, &boxes);
        let main = main.to_owned();
        Ok(Self { index, main, sh_degree, metres, origin, transform, environment, root, contents, notes })
    }

    /// Number of files of tiles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.contents.len() + usize::from(self.environment.is_some())
    }

    /// Returns true if there is no file.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Facts that the scene does not state, so that the tiles are placed by a guess; one line each.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Writes the files of some tiles, of those from 0 to [`Self::len`]. Neighbours share what is
    /// read for them.
    ///
    /// # Errors
    /// [`FormatError`] if a file of the levels is not there or damaged, or one of the tiles cannot
    /// be written.
    ///
    /// # Panics
    /// If there are fewer tiles.
    pub fn write_tiles(&self, tiles: Range<usize>) -> Result<(), FormatError> {
        let mut files: Vec<(usize, LevelFile)> = Vec::new();
        for number in tiles {
            let (splats, middle) = if number == self.contents.len() {
                let environment = self.index.read_environment()?;
                (environment.map(|scene| scene.splats).unwrap_or_default(), self.origin)
            } else {
                let content = &self.contents[number];
                (self.splats_of(content, &mut files)?, content.middle)
            };
            let scene =
                Scene { splats: self.moved(splats, middle), metadata: self.facts(), ..Scene::default() };
            let options = WriteOptions { gltf: GltfSplats::SpzCesium, ..WriteOptions::default() };
            write_scene_with(&self.main.with_file_name(uri(number)), &scene, &options)?;
        }
        Ok(())
    }

    /// The metadata that each tile holds.
    fn facts(&self) -> Metadata {
        Metadata { rasterization: self.index.metadata.rasterization, ..Metadata::default() }
    }

    fn splats_of(
        &self,
        content: &Content,
        files: &mut Vec<(usize, LevelFile)>,
    ) -> Result<Splats, FormatError> {
        let mut splats = Splats::default();
        for leaf in &content.leaves {
            let runs = &self.index.leaves[*leaf].runs;
            let run = &runs[content.level.min(runs.len() - 1)];
            // The file that was used last is at the end.
            match files.iter().position(|(file, _)| *file == run.file) {
                Some(place) => files[place..].rotate_left(1),
                None => {
                    if files.len() >= MAX_OPEN_FILES {
                        files.remove(0);
                    }
                    files.push((run.file, self.index.read_file(run.file)?));
                }
            }
            if let Some((_, file)) = files.last() {
                splats = Splats::joined(splats, file.splats(run.offset, run.count)?);
            }
        }
        Ok(splats)
    }

    /// Splats in metres from `middle`.
    fn moved(&self, mut splats: Splats, middle: DVec3) -> Splats {
        splats.limit_sh(self.sh_degree);
        for mean in &mut splats.means {
            let from = (DVec3::from(mean.map(f64::from)) - middle) * self.metres;
            *mean = from.as_vec3().to_array();
        }
        let larger = self.metres.ln() as f32;
        splats.log_scales.as_flattened_mut().iter_mut().for_each(|v| *v += larger);
        splats
    }

    /// Writes `tileset.json`, after all tiles.
    ///
    /// # Errors
    /// [`FormatError`] if a tile is not there or it cannot be written.
    pub fn write_tileset(&self) -> Result<(), FormatError> {
        for number in 0..self.len() {
            let path = self.main.with_file_name(uri(number));
            fs::metadata(&path).map_err(|error| FormatError::reading(&path, error))?;
        }
        let whole = self.environment.map_or(self.root.extent, |extent| extent.union(self.root.extent));
        let root = if self.environment.is_some() {
            let mut root = self.tile(&self.root, Some(self.origin));
            root["refine"] = json!("REPLACE");
            let error = (whole.diagonal() * self.metres).max(self.root.error);
            json!({
                "transform": self.transform.to_cols_array(),
                "boundingVolume": { "box": self.volume(whole, self.origin) },
                "geometricError": error,
                "refine": "ADD",
                "content": { "uri": uri(self.contents.len()) },
                "children": [root],
            })
        } else {
            let mut root = self.tile(&self.root, None);
            root["transform"] = json!(self.transform.to_cols_array());
            root["refine"] = json!("REPLACE");
            root
        };
        let extensions = ["KHR_gaussian_splatting", "KHR_gaussian_splatting_compression_spz_2"];
        let mut extras = json!({ "generator": concat!("weather-magician ", env!("CARGO_PKG_VERSION")) });
        if let Some(origin) = self.index.metadata.origin {
            extras["origin"] = json!(origin);
        }
        let tileset = json!({
            "asset": { "version": "1.1", "extras": extras },
            "extensionsUsed": ["3DTILES_content_gltf"],
            "extensions": { "3DTILES_content_gltf": { "extensionsUsed": extensions, "extensionsRequired": extensions } },
            "geometricError": (whole.diagonal() * self.metres).max(2.0 * self.root.error),
            "root": root,
        });
        write_atomically(&self.main, |out| Ok(writeln!(out, "{tileset}")?))
    }

    /// A tile below one with the origin `above`, or the root.
    fn tile(&self, tile: &Tile, above: Option<DVec3>) -> Value {
        let middle = above.map_or(self.origin, |_| tile.extent.middle());
        let mut value = json!({
            "boundingVolume": { "box": self.volume(tile.extent, middle) },
            "geometricError": tile.error,
        });
        if let Some(above) = above {
            let shift = tile_from_scene() * (middle - above) * self.metres;
            value["transform"] = json!(DMat4::from_translation(shift).to_cols_array());
        }
        if let Some(number) = tile.content {
            value["content"] = json!({ "uri": uri(number) });
        }
        if !tile.children.is_empty() {
            value["children"] = tile.children.iter().map(|child| self.tile(child, Some(middle))).collect();
        }
        value
    }

    /// A box in the axes of a tile whose origin is a point of the scene: its middle, then half of
    /// each side.
    fn volume(&self, extent: Extent, origin: DVec3) -> [f64; 12] {
        let [low, high] = [extent.low, extent.high].map(|v| DVec3::from(v.map(f64::from)));
        let center = tile_from_scene() * (0.5 * (low + high) - origin) * self.metres;
        let half = (tile_from_scene() * (0.5 * (high - low))).abs() * self.metres;
        let [x, y, z] = half.to_array();
        [center.x, center.y, center.z, x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z]
    }
}

impl Tile {
    /// The tile of a node, its height above the leaves, and its leaves.
    fn of(
        tree: &BoxTree,
        leaves: &[LevelLeaf],
        weights: &[Vec<f64>],
        metres: f64,
        contents: &mut Vec<Content>,
    ) -> (Self, usize, Vec<usize>) {
        match tree {
            BoxTree::Leaf(leaf) => {
                let extent = leaves[*leaf].extent();
                contents.push(Content { leaves: vec![*leaf], level: 0, middle: extent.middle() });
                let content = Some(contents.len() - 1);
                (Self { extent, error: 0.0, content, children: Vec::new() }, 0, vec![*leaf])
            }
            BoxTree::Node(extent, children) => {
                let [a, b] =
                    children.each_ref().map(|child| Self::of(child, leaves, weights, metres, contents));
                let level = 1 + a.1.max(b.1);
                let below = [a.2, b.2].concat();
                let least = 1.01 * a.0.error.max(b.0.error);
                let has_level = below.iter().any(|leaf| leaves[*leaf].runs.len() > level);
                let children = vec![a.0, b.0];
                let (content, error) = if has_level {
                    let error = |leaf: &usize| {
                        let (leaf, weights) = (&leaves[*leaf], &weights[*leaf]);
                        let level = level.min(leaf.runs.len() - 1);
                        let spacing =
                            leaf.extent().diagonal() * metres / (leaf.runs[level].count as f64).sqrt();
                        ERROR_PER_SPACING * spacing * weights[level]
                    };
                    let error = below.iter().map(error).fold(least, f64::max);
                    contents.push(Content { leaves: below.clone(), level, middle: extent.middle() });
                    (Some(contents.len() - 1), error)
                } else {
                    (None, (extent.diagonal() * metres).max(2.0 * least))
                };
                (Self { extent: *extent, error, content, children }, level, below)
            }
        }
    }
}

/// For each level of each leaf, its stated error against the mean of all leaves at that level, 1/2
/// to 2; 1 where it is not known.
fn loss_weights(leaves: &[LevelLeaf]) -> Vec<Vec<f64>> {
    let most = leaves.iter().map(|leaf| leaf.runs.len()).max().unwrap_or(0);
    let error = |leaf: &LevelLeaf, level: usize| Some(f64::from(leaf.runs.get(level)?.error?));
    let mean = |level: usize| {
        let errors: Vec<f64> = leaves.iter().filter_map(|leaf| error(leaf, level)).collect();
        errors.iter().sum::<f64>() / errors.len().max(1) as f64
    };
    let means: Vec<f64> = (0..most).map(mean).collect();
    let weight = |leaf: &LevelLeaf, level: usize| match error(leaf, level) {
        Some(error) if means[level] > 0.0 => (error / means[level]).clamp(0.5, 2.0),
        _ => 1.0,
    };
    leaves.iter().map(|leaf| (0..leaf.runs.len()).map(|level| weight(leaf, level)).collect()).collect()
}

/// The axes of tiles from those of a PLY: glTF's, as formats are turned to them, with y up put to z
/// as 3D Tiles do.
fn tile_from_scene() -> DMat3 {
    DMat3::from_cols(DVec3::NEG_X, DVec3::NEG_Z, DVec3::NEG_Y)
}

/// The point of the scene that is the root's origin, the root's transform, and what was guessed for
/// it.
fn placed(metadata: &Metadata, boxes: &[Extent]) -> (DVec3, DMat4, Vec<String>) {
    let mut notes = Vec::new();
    let median =
        |k: usize| quantile(&mut boxes.iter().map(|extent| extent.middle()[k]).collect::<Vec<_>>(), 0.5);
    let mut origin = DVec3::new(median(0), median(1), median(2));
    let up = metadata.up.map_or(DVec3::NEG_Y, DVec3::normalize);
    if metadata.metres_per_unit.is_none() {
        notes.push("the scene's scale is not known: a unit counts as a metre".into());
    }
    if metadata.up.is_none() {
        notes.push("the scene's up is not known: it is taken as -y".into());
    }
    if let Some(ground) = metadata.ground {
        origin += up * (ground - up.dot(origin));
    }
    // Any level direction without north.
    let level = |v: DVec3| (v - up * up.dot(v)).try_normalize();
    let north = metadata.north.and_then(level);
    let any = || level(DVec3::Z).or_else(|| level(DVec3::X)).unwrap_or(DVec3::X);
    let enu_from_scene = {
        let north = north.unwrap_or_else(any);
        DMat3::from_cols(north.cross(up), north, up).transpose()
    };
    let Some([latitude, longitude]) = metadata.location else {
        notes.push(
            "the scene's place is not known: the tiles stand in a frame of their own, not on the globe"
                .into(),
        );
        return (origin, DMat4::from_mat3(enu_from_scene * tile_from_scene().transpose()), notes);
    };
    if north.is_none() {
        notes.push("north is not known: the tiles are turned any way".into());
    }
    let height = if metadata.ground.is_some() { "its ground" } else { "its middle" };
    notes.push(format!(
        "the middle of the scene is put at {latitude:.6}, {longitude:.6} and {height} on the ellipsoid: neither is measured"
    ));
    let ecef = ecef_from_enu(latitude, longitude);
    (origin, ecef * DMat4::from_mat3(enu_from_scene * tile_from_scene().transpose()), notes)
}

/// East, north and up at a place on the WGS 84 ellipsoid, in the axes of the Earth; degrees.
fn ecef_from_enu(latitude: f64, longitude: f64) -> DMat4 {
    let place = Gps { latitude, longitude, altitude: None }.ecef();
    let (sin, cos) = latitude.to_radians().sin_cos();
    let (sin_east, cos_east) = longitude.to_radians().sin_cos();
    let east = DVec3::new(-sin_east, cos_east, 0.0);
    let up = DVec3::new(cos * cos_east, cos * sin_east, sin);
    DMat4::from_cols(east.extend(0.0), up.cross(east).extend(0.0), up.extend(0.0), place.extend(1.0))
}

fn uri(number: usize) -> String {
    format!("tiles/{number}.glb")
}
