//! `export-web`: writes a scene as a static web page that renders it in weather in the browser.
//!
//! A site is made in a folder beside its own and moved there when it is whole.

mod assets;
mod output;
mod pictures;
mod place;
mod player;
mod single_file;
mod site;

use crate::commands::render::camera::ViewpointArgs;
use crate::interrupt;
use crate::names::stem_of;
use crate::overwrite::OverwriteArgs;
use crate::scene::{OpenScene, OwnSkyArgs, RunArgs, SceneArgs};
use crate::weather::WeatherArgs;
use anyhow::{Context, Result, bail};
use assets::{AssetBudget, PreparedWeathers};
use clap::Args;
use output::{SiteFolder, megabytes};
use player::PlayerFiles;
use std::path::{Path, PathBuf};
use weather_magician::levels::parse_memory;
use weather_magician::{Camera, Weather};
use wm_viewer::ViewState;
use wm_viewer::catalog::panoramas_of;
use wm_viewer::site::{DEFAULT_MEMORY_BYTES, SITE_VERSION, SiteAsset, SiteFile, SiteView};

/// Options of `export-web`.
#[derive(Args, Debug)]
#[command(after_help = "weather-magician export-web garden.ply --weather fog --out site/\n\
                  weather-magician export-web garden.ply --weather moderate-rain --set wind.speed=6 --single-file --out garden.html\n\n\
                  Put the folder on any static host, or look at it here: python3 -m http.server -d site/\n\
                  docs/guide/web.md says what runs where, and how the player is built.")]
pub(crate) struct ExportWebArgs {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    sky: OwnSkyArgs,
    #[command(flatten)]
    weather: WeatherArgs,
    /// Time of the weather at which the page opens, seconds
    #[arg(
        long,
        value_name = "S",
        default_value_t = 0.0,
        allow_negative_numbers = true,
        help_heading = "Weather"
    )]
    time: f64,
    /// Weathers that the page has the prepared data of, beside its first: auto (those of common
    /// presets, as far as they fit --asset-megabytes), all (of every preset, as far as they fit),
    /// none, or a list of presets and weather files. The browser makes what is not prepared when it
    /// is asked for
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "auto",
        help_heading = "Weather"
    )]
    prepare: Vec<String>,
    /// Most of those data, megabytes [default: 128, with --single-file 12]; those of the first
    /// weather are always there but with --single-file
    #[arg(long, value_name = "N", help_heading = "Weather")]
    asset_megabytes: Option<u32>,
    #[command(flatten)]
    viewpoint: ViewpointArgs,
    /// Output folder, or the HTML file with --single-file [default: named after scene and weather,
    /// in this folder]
    #[arg(short, long, value_name = "PATH", help_heading = "Output")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Write one HTML file with everything in it, 40 MB at most; it also opens from a disk
    #[arg(long, help_heading = "Output")]
    single_file: bool,
    /// Folder with player.js and player_bg.wasm [default: those of the program, or web-player
    /// beside it]
    #[arg(long, value_name = "FOLDER", help_heading = "Output")]
    player: Option<PathBuf>,
    /// Leave out the video, which browsers show that cannot run the player
    #[arg(long, help_heading = "Output")]
    no_video: bool,
    /// Leave out the small pictures of the presets
    #[arg(long, help_heading = "Output")]
    no_thumbnails: bool,
    /// Memory that the page may take for a scene in levels of detail, such as 2GiB or 800MB
    /// [default: 1GiB]
    #[arg(long, value_name = "BYTES", value_parser = parse_memory, help_heading = "Output")]
    memory: Option<u64>,
    #[command(flatten)]
    run: RunArgs,
}

impl ExportWebArgs {
    /// Checks the options that do not depend on the scene.
    fn check(&self) -> Result<()> {
        self.viewpoint.check()?;
        if !self.time.is_finite() || self.time.abs() > 1e6 {
            bail!("--time {}: give seconds, such as 0 or 12.5", self.time);
        }
        if self.scene.assets.is_some() {
            bail!("--assets: a site has a folder of its own for them; leave it out");
        }
        Ok(())
    }

    /// The bytes of prepared data.
    fn asset_budget(&self) -> AssetBudget {
        let megabytes = self.asset_megabytes.unwrap_or(if self.single_file { 12 } else { 128 });
        AssetBudget { most: u64::from(megabytes) * 1_000_000, is_strict: self.single_file }
    }

    /// The output path.
    fn out(&self, weather: &Weather) -> Result<PathBuf> {
        let named = || {
            let name = format!("{}-{}", stem_of(&self.scene.scene), weather.name);
            PathBuf::from(if self.single_file { name + ".html" } else { name + "-site" })
        };
        let out = self.out.clone().unwrap_or_else(named);
        let is_html = out.extension().is_some_and(|e| e.eq_ignore_ascii_case("html"));
        match (self.single_file, is_html) {
            (true, false) => bail!("{}: --single-file writes a .html file; name one", out.display()),
            (false, true) => {
                bail!("{}: a site is a folder; give --single-file for one HTML file", out.display())
            }
            _ => Ok(out),
        }
    }
}

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

/// The error of an export that was stopped.
const NOT_WRITTEN: &str = "no site is written";

/// Fails if Ctrl-C was pressed.
fn stop_if_asked() -> Result<()> {
    interrupt::check(NOT_WRITTEN)
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

/// Returns a camera with another size of its picture, `width` px wide; both sides are even.
fn resized(camera: &Camera, width: u32) -> Camera {
    let width = width.min(camera.width).max(2) & !1;
    let height = f64::from(width) * f64::from(camera.height) / f64::from(camera.width);
    camera.resized(width, ((height / 2.0).round() as u32 * 2).clamp(2, 8192))
}

/// The context of an error about a path.
fn at<T, E: Into<anyhow::Error>>(outcome: Result<T, E>, path: &Path) -> Result<T> {
    outcome.map_err(Into::into).with_context(|| path.display().to_string())
}
