//! `bake`: writes a scene with its snow or dust cover as an ordinary scene file for other programs.

use crate::names::stem_of;
use crate::overwrite::OverwriteArgs;
use crate::progress::Reporter;
use crate::scene::{OpenScene, OwnSkyArgs, RunArgs, SceneArgs};
use crate::weather::WeatherArgs;
use anyhow::{Result, bail};
use clap::Args;
use std::path::PathBuf;
use weather_magician::BakedScene;
use weather_magician::formats::{format_for, lost};
use wm_base::files::check_writable;

/// Options of `bake`.
#[derive(Args, Debug)]
#[command(after_long_help = wm_weather::reference_page::help())]
pub(crate) struct BakeArgs {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    sky: OwnSkyArgs,
    #[command(flatten)]
    weather: WeatherArgs,
    /// Time of the weather, seconds
    #[arg(long, value_name = "S", default_value_t = 0.0, allow_negative_numbers = true)]
    time: f64,
    /// Output file; its extension is the format: .ply, .spz, .sog, .glb and others [default: a .ply
    /// named after scene and weather, in this folder]
    #[arg(short, long, value_name = "PATH")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    #[command(flatten)]
    run: RunArgs,
}

/// Runs the command.
pub(crate) fn run(args: &BakeArgs) -> Result<()> {
    let weather = args.weather.read()?;
    let named = || format!("{}-{}.ply", stem_of(&args.scene.scene), weather.name).into();
    let out: PathBuf = args.out.clone().unwrap_or_else(named);
    let format = format_for(&out)?;
    check_writable(&out)?;
    args.overwrite.check(&out, &[&args.scene.scene], "give another name with --out")?;
    if !args.time.is_finite() {
        bail!("--time {}: give seconds, such as 0 or 12.5", args.time);
    }
    let mut loaded = OpenScene::with_sky(&args.scene, &args.run, None, args.sky)?;
    let OpenScene { renderer, place } = &mut loaded;
    let baked = renderer.bake(place, &weather, args.time, &mut Reporter::default())?;
    loaded.warn();
    let Some(BakedScene { scene, added }) = baked else {
        bail!(
            "nothing lies under the weather {} at {} s: ask for it, such as --set snow_cover.depth=0.1",
            weather.name,
            args.time
        );
    };
    if added == 0 {
        bail!(
            "{}: nothing lies on it at {} s: all has melted, or no surface looks up at the sky (give --up if up is wrong)",
            args.scene.scene.display(),
            args.time
        );
    }
    let count = scene.splats.len();
    scene.save(&out)?;
    println!("{}: {count} splats, {added} of them lie on the place", out.display());
    for line in lost(&format.loses, &scene) {
        eprintln!("{}: lost: {line}", out.display());
    }
    Ok(())
}
