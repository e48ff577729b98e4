//! The scene of a site: written for the browser, and opened again as the browser will see it.

use super::args::ExportWebArgs;
use super::output::{at, make_folder};
use super::stop::NOT_WRITTEN;
use crate::commands::convert::levels;
use crate::progress;
use crate::scene::{OpenScene, change_sky, read_checked, refuse_for_levels};
use crate::viewer::words::{given_words, scene_words};
use anyhow::{Result, bail};
use std::fs;
use std::path::Path;
use weather_magician::formats::{ReadOptions, read_scene, write_scene};
use weather_magician::levels::{LevelBudget, MAX_FRAME_SPLATS};
use weather_magician::{Metadata, PlaceOptions, Scene};
use wm_scene::SceneView;
use wm_scene::levels::{INDEX_NAME, LevelIndex};
use wm_scene::survey::{FactSource, Survey, label_sky};
use wm_viewer::site::DEFAULT_MEMORY_BYTES;

/// The scene as a site has it.
pub(crate) struct SitePlace {
    /// The name of its file.
    pub(crate) file: &'static str,
    /// All facts.
    pub(crate) metadata: Metadata,
    /// The cameras of the photos.
    pub(crate) views: Vec<SceneView>,
    /// Command-line words of the scene.
    pub(crate) words: Vec<String>,
    /// True if it is drawn in levels of detail.
    pub(crate) is_in_levels: bool,
}

/// Writes the scene into `folder`, and opens what was written.
pub(crate) fn write(args: &ExportWebArgs, folder: &Path) -> Result<(OpenScene, SitePlace)> {
    let facts = args.scene.facts.metadata()?;
    let words = scene_words(&args.scene, args.sky, args.viewpoint.views.as_ref());
    let words = words.into_iter().map(|word| word.to_string_lossy().into_owned());
    let words = words.chain(given_words(&args.scene.facts)).collect();
    make_folder(folder)?;
    let source = &args.scene.scene;
    let index = if args.scene.level.is_none() { LevelIndex::of_scene(source)? } else { None };
    // A page draws smaller ones as a whole.
    if let Some(index) = index.filter(|index| index.count_of_level(0) > MAX_FRAME_SPLATS) {
        refuse_for_levels(args.sky, args.viewpoint.views.as_ref())?;
        copy_levels(&index, folder, args.scene.repair)?;
        return open_levels(args, folder, facts.or(index.metadata.clone()), words);
    }
    let bar = progress::spinner("reading the scene");
    let views = args.viewpoint.views.as_ref();
    let mut scene = read_checked(source, args.scene.level, views, args.scene.repair)?;
    if scene.splats.is_empty() {
        bail!("{}: there are no splats in it", source.display());
    }
    if let Some(line) = change_sky(&mut scene, source, args.sky.sky, &facts)? {
        bar.suspend(|| eprintln!("{line}"));
    }
    label_sky(&mut scene.splats);
    let survey = Survey::of(&scene, &facts);
    scene.metadata = known(facts.or(std::mem::take(&mut scene.metadata)), &survey);
    bar.finish_and_clear();
    if scene.splats.len() as u64 > MAX_FRAME_SPLATS {
        let facts = scene.metadata.clone();
        let written = folder.join("folders");
        let index = written.join(INDEX_NAME);
        make_folder(&written)?;
        levels::write(&index, scene, Vec::new(), None, &args.run)?;
        copy_levels(&LevelIndex::open(&index)?, folder, false)?;
        at(fs::remove_dir_all(&written), &written)?;
        return open_levels(args, folder, facts, words);
    }
    let bar = progress::spinner("writing the scene");
    let file = folder.join("scene.sog");
    let (views, metadata) = (std::mem::take(&mut scene.views), scene.metadata.clone());
    write_scene(&file, &scene)?;
    drop(scene);
    let read = read_scene(&file, &ReadOptions::default())?;
    bar.finish_and_clear();
    let scene = Scene { views: views.clone(), metadata: metadata.clone(), ..read };
    let mut renderer = args.run.renderer()?;
    let options = PlaceOptions { assets: Some(folder.join("assets")), ..PlaceOptions::default() };
    let place = renderer.load_with(scene, &options)?;
    let mut loaded = OpenScene { renderer, place };
    loaded.warn();
    Ok((loaded, SitePlace { file: "scene.sog", metadata, views, words, is_in_levels: false }))
}

/// Opens a scene in levels that was written, with these facts.
fn open_levels(
    args: &ExportWebArgs,
    folder: &Path,
    facts: Metadata,
    words: Vec<String>,
) -> Result<(OpenScene, SitePlace)> {
    let index = LevelIndex::open(&folder.join(INDEX_NAME))?;
    let budget = LevelBudget { memory: args.memory.unwrap_or(DEFAULT_MEMORY_BYTES), splats: None };
    let mut renderer = args.run.renderer()?;
    let options = PlaceOptions { facts: facts.clone(), ..PlaceOptions::default() };
    let place = renderer.load_levels(index, &options, &budget, args.scene.repair)?;
    let metadata = known(facts, place.survey());
    let mut loaded = OpenScene { renderer, place };
    loaded.warn();
    Ok((loaded, SitePlace { file: INDEX_NAME, metadata, views: Vec::new(), words, is_in_levels: true }))
}

/// Adds what a survey found to the facts of a scene: browsers compute with other last digits, and
/// assets are known by all of them.
fn known(stated: Metadata, survey: &Survey) -> Metadata {
    let is_known = |source: FactSource| source != FactSource::Assumed;
    let is_sure = |fact: wm_scene::survey::Confidence| Some(fact).filter(|fact| *fact != Default::default());
    let mut facts = stated;
    if facts.up.is_none() {
        (facts.up, facts.up_confidence) = (Some(survey.up.value), is_sure(survey.up.confidence));
    }
    if is_known(survey.ground.source) {
        (facts.ground, facts.ground_confidence) =
            (Some(survey.ground.value), is_sure(survey.ground.confidence));
    }
    if is_known(survey.metres_per_unit.source) {
        facts.metres_per_unit = Some(survey.metres_per_unit.value);
    }
    // The light of a place without a sky is a guess, which a stated one would not be.
    if survey.sky_splats > 0 {
        facts.airlight = Some(survey.airlight.value);
    }
    facts
}

/// Copies a scene in levels, each of its files as one bundle, since a page fetches file by file;
/// the index is last. With `repairs` files that are missing or damaged are left out.
fn copy_levels(index: &LevelIndex, folder: &Path, repairs: bool) -> Result<()> {
    let names: Vec<&String> = index.files.iter().chain(&index.environment).collect();
    progress::for_each(names.into_iter(), "copying the scene", NOT_WRITTEN, |name, bar| {
        match index.write_bundle(name, folder) {
            Err(error) if repairs => bar.suspend(|| eprintln!("warning: {error}; it is left out")),
            outcome => outcome?,
        }
        Ok(())
    })?;
    Ok(index.write_bundled(&folder.join(INDEX_NAME))?)
}
