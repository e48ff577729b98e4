//! `export-web`: writes a scene as a static web page that renders it in weather in the browser.
//!
//! A site is made in a folder beside its own and moved there when it is whole.

mod args;
mod assets;
mod output;
mod pictures;
mod place;
mod player;
mod single_file;
mod site;
mod stop;

pub(crate) use args::ExportWebArgs;

use crate::names::stem_of;
use crate::scene::OpenScene;
use anyhow::{Result, bail};
use assets::PreparedWeathers;
use output::{SiteFolder, megabytes};
use player::PlayerFiles;
use std::path::Path;
use stop::stop_if_asked;
use weather_magician::Weather;
use wm_viewer::ViewState;
use wm_viewer::catalog::panoramas_of;
use wm_viewer::site::{DEFAULT_MEMORY_BYTES, SITE_VERSION, SiteAsset, SiteFile, SiteView};

/// Runs the command.
pub(crate) fn run(args: &ExportWebArgs) -> Result<()> {
    args.check()?;
    let weather = args.weather.read()?;
    check_weather(&weather)?;
    let others = assets::weathers(&args.prepare)?;
    let out = args.out(&weather)?;
    let inputs = [&*args.scene.scene];
    // Of a folder the file by which an older site is known: what else lies in it stays.
    let replaced = if args.single_file { out.clone() } else { out.join(output::MARK) };
    args.overwrite.check_report(&replaced, &inputs)?;
    let player = PlayerFiles::find(args.player.as_deref())?;
    let folder = SiteFolder::new(&out, args.single_file)?;
    player.write(folder.path())?;
    site::write_page(folder.path(), args.single_file)?;

    let (mut loaded, place) = place::write(args, &folder.path().join("place"))?;
    stop_if_asked()?;
    let start = args.viewpoint.start(&mut loaded)?;
    // What it needs is of the first weather.
    pictures::poster(&mut loaded, &weather, &start, args.time, &folder.path().join("poster.jpg"))?;
    let prepared = if place.is_in_levels {
        // They are of the splats about a camera, and of no use elsewhere.
        PreparedWeathers::default()
    } else {
        assets::prepare(&mut loaded, &weather, &others, args.asset_budget())?
    };
    let thumbnails = match args.no_thumbnails {
        true => Vec::new(),
        false => pictures::thumbnails(&mut loaded, &start, &folder.path().join("place/thumbnails"))?,
    };
    if !args.no_video && !args.single_file {
        pictures::video(&mut loaded, &weather, &start, args.time, &folder.path().join("video.mp4"))?;
    }
    let files = prepared.finish(&folder.path().join("place/assets"))?;
    stop_if_asked()?;

    let digest = loaded.place.asset_digest().unwrap_or_default().to_string();
    let site = SiteFile {
        version: SITE_VERSION,
        program: wm_viewer::PROGRAM.into(),
        name: stem_of(&args.scene.scene),
        scene: place.file.into(),
        metadata: place.metadata,
        views: place
            .views
            .into_iter()
            .map(|view| SiteView { name: view.name, camera: view.camera })
            .collect(),
        start: ViewState::new(&start, &weather, args.time),
        near: start.near,
        words: place.words,
        files: files
            .iter()
            .map(|file| SiteAsset { name: format!("assets/{}", file.name), bytes: file.bytes })
            .collect(),
        digest,
        thumbnails,
        splats: loaded.place.splats(),
        memory: place.is_in_levels.then(|| args.memory.unwrap_or(DEFAULT_MEMORY_BYTES)),
    };
    let text = site.text().map_err(anyhow::Error::msg)?;
    output::write(&folder.path().join("place/place.json"), text.as_bytes())?;
    let lines = report(folder.path(), &loaded, &prepared, &files)?;
    let bytes = if args.single_file { single_file::write(&folder, &out)? } else { folder.finish()? };
    println!("{}: {}, {} splats, {}", out.display(), megabytes(bytes), loaded.place.splats(), weather.name);
    lines.iter().for_each(|line| println!("  {line}"));
    Ok(())
}

/// Fails if a weather needs a file that a site has no room for.
fn check_weather(weather: &Weather) -> Result<()> {
    match panoramas_of(weather).map_err(anyhow::Error::msg)?.into_keys().next() {
        Some(path) => bail!(
            "sky.panorama {path}: a site has no panoramas yet; choose another sky, such as --set sky=overcast"
        ),
        None => Ok(()),
    }
}

/// Returns the lines about the parts of a site.
fn report(
    folder: &Path,
    loaded: &OpenScene,
    prepared: &PreparedWeathers,
    files: &[assets::PackedAsset],
) -> Result<Vec<String>> {
    let size =
        |names: &[&str]| names.iter().map(|name| output::size_of(&folder.join(name))).sum::<Result<u64>>();
    let all = size(&["place"])?;
    let [assets, thumbnails] = [size(&["place/assets"])?, size(&["place/thumbnails"])?];
    let mut lines = vec![
        format!("player {}", megabytes(size(&["player.js", "player_bg.wasm"])?)),
        format!("scene {}", megabytes(all - assets - thumbnails)),
        format!("pictures {}", megabytes(thumbnails + size(&["poster.jpg", "video.mp4"])?)),
    ];
    lines.extend(
        files.iter().map(|file| format!("prepared {}, {} for {}", file.name, megabytes(file.bytes), file.of)),
    );
    let left = prepared.left(&loaded.place);
    if !left.is_empty() {
        lines.push(format!("left to the browser: {}", left.join(", ")));
    }
    Ok(lines)
}
