//! The prepared data of a site: made by the library's cache, packed, and chosen by their size.

use super::output::{at, write};
use super::stop::stop_if_asked;
use crate::progress::Reporter;
use crate::scene::OpenScene;
use anyhow::Result;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use weather_magician::assets::pack_asset;
use weather_magician::panorama_file::read_panorama;
use weather_magician::{PreparedPlace, Weather};
use wm_weather::presets::PRESETS;

/// The presets that are prepared without being asked for, the most useful first: light, rain on wet
/// ground, lying snow, the sun, falling snow, lamps.
const COMMON: [&str; 8] =
    ["overcast", "moderate-rain", "snow-covered", "sunny", "snow", "heavy-rain", "night", "golden-hour"];
/// The beginning of the name of surfaces, which the others are made from.
const SURFACES: &str = "surfaces-";

/// Returns the weathers of `--prepare`.
pub(crate) fn weathers(names: &[String]) -> Result<Vec<Weather>> {
    let all = || PRESETS.iter().map(|(name, _)| *name);
    let presets = |names: &mut dyn Iterator<Item = &str>| -> Result<Vec<Weather>> {
        Ok(names.map(Weather::preset).collect::<Result<_, _>>()?)
    };
    match names {
        [word] if word == "none" => Ok(Vec::new()),
        [word] if word == "auto" => presets(&mut COMMON.into_iter()),
        [word] if word == "all" => {
            presets(&mut COMMON.into_iter().chain(all().filter(|name| !COMMON.contains(name))))
        }
        _ => names
            .iter()
            .map(|name| {
                let mut weather = Weather::find(name)?;
                weather.load_images(read_panorama)?;
                Ok(weather)
            })
            .collect(),
    }
}

/// A file of a site's folder of prepared data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct PackedAsset {
    /// The name that the cache has for it.
    pub(crate) name: String,
    /// The size, bytes.
    pub(crate) bytes: u64,
    /// The weather that it was made for.
    pub(crate) of: String,
}

/// Prepared data that a site will have.
#[derive(Default)]
pub(crate) struct PreparedWeathers {
    /// The files that belong to the site.
    chosen: Vec<PackedAsset>,
}

/// The bytes that prepared data may take.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AssetBudget {
    /// The most of them.
    pub(crate) most: u64,
    /// The first weather is bound by it too.
    pub(crate) is_strict: bool,
}

/// Prepares what the weathers need, each as far as the budget allows. What is in the folder already
/// is of the first one.
pub(crate) fn prepare(
    loaded: &mut OpenScene,
    first: &Weather,
    others: &[Weather],
    AssetBudget { most, is_strict }: AssetBudget,
) -> Result<PreparedWeathers> {
    let mut prepared = PreparedWeathers::default();
    let Some(folder) = loaded.place.asset_folder().map(Path::to_path_buf) else { return Ok(prepared) };
    let (mut seen, mut surfaces, mut total) = (BTreeSet::new(), Vec::new(), 0);
    for (position, weather) in std::iter::once(first).chain(others).enumerate() {
        stop_if_asked()?;
        loaded.renderer.prepare(&mut loaded.place, weather, &mut Reporter::default())?;
        loaded.warn();
        let mut new = Vec::new();
        for name in names_in(&folder)?.into_iter().filter(|name| !seen.contains(name)) {
            let path = folder.join(&name);
            let bytes = pack_asset(&at(fs::read(&path), &path)?).len() as u64;
            let asset = PackedAsset { name, bytes, of: weather.name.clone() };
            if asset.name.starts_with(SURFACES) { &mut surfaces } else { &mut new }.push(asset);
        }
        seen.extend(new.iter().chain(&surfaces).map(|asset| asset.name.clone()));
        // The smallest first: a part of them is of use too.
        new.sort_by_key(|asset| asset.bytes);
        for asset in new {
            if total + asset.bytes <= most || (position == 0 && !is_strict) {
                total += asset.bytes;
                prepared.chosen.push(asset);
            }
        }
    }
    // They serve only what the browser makes itself, such as the shadows of another sun.
    prepared.chosen.extend(surfaces.into_iter().filter(|asset| total + asset.bytes <= most));
    Ok(prepared)
}

impl PreparedWeathers {
    /// Leaves the files that were chosen in the folder, packed; returns them, the names ascending.
    pub(crate) fn finish(&self, folder: &Path) -> Result<Vec<PackedAsset>> {
        let mut kept = Vec::new();
        for name in names_in(folder)? {
            let path = folder.join(&name);
            match self.chosen.iter().find(|asset| asset.name == name) {
                Some(asset) => {
                    let packed = pack_asset(&at(fs::read(&path), &path)?);
                    write(&path, &packed)?;
                    kept.push(PackedAsset { bytes: packed.len() as u64, ..asset.clone() });
                }
                None => at(fs::remove_file(&path), &path)?,
            }
        }
        Ok(kept)
    }

    /// Returns the presets for which the browser must make something at their beginning.
    pub(crate) fn left(&self, place: &PreparedPlace) -> Vec<&'static str> {
        let has = |name: &String| self.chosen.iter().any(|asset| asset.name == *name);
        let is_whole = |name: &str| {
            let weather = Weather::preset(name).unwrap_or_default();
            place.asset_files(&weather, 0.0).iter().all(has)
        };
        PRESETS.iter().map(|(name, _)| *name).filter(|name| !is_whole(name)).collect()
    }
}

/// Returns the names of the prepared data in a folder, ascending; none if it is not there.
fn names_in(folder: &Path) -> Result<Vec<String>> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let entries = at(fs::read_dir(folder), folder)?.flatten();
    let mut names: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.retain(|name| name.ends_with(".wmasset"));
    names.sort();
    Ok(names)
}
