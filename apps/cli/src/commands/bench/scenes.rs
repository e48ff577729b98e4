//! The scenes that are measured, and the cameras that see them.

use super::args::BenchArgs;
use crate::names::stem_of;
use crate::scene::{AssetFolder, OpenScene, SceneArgs, read_saying_remarks};
use anyhow::Result;
use glam::DVec3;
use std::path::{Path, PathBuf};
use weather_magician::formats::ReadOptions;
use weather_magician::view::ViewOptions;
use weather_magician::{Camera, Metadata, Scene};
use wm_render::bench_scene::{shell_camera, shell_splats};
use wm_scene::Group;

/// Calls `measure` for each scene with its name, the scene and the camera.
pub(super) fn each<R>(
    args: &BenchArgs,
    mut measure: impl FnMut(&str, &mut OpenScene, Camera) -> Result<R>,
) -> Result<Vec<R>> {
    if args.scenes.is_empty() {
        let (mut loaded, camera) = made_up(args)?;
        return Ok(vec![measure(&format!("synthetic, {} splats", args.splats), &mut loaded, camera)?]);
    }
    let of = |path: &PathBuf| {
        let (mut loaded, camera) = real(path, args)?;
        measure(&stem_of(path), &mut loaded, camera)
    };
    args.scenes.iter().map(of).collect()
}

/// Returns the synthetic scene and its camera.
fn made_up(args: &BenchArgs) -> Result<(OpenScene, Camera)> {
    /// Splats over each pixel, about as many as in trained scenes.
    const SPLATS_PER_PIXEL: f64 = 60.0;
    /// Height above which 98 % of the splats lie, scene units.
    const GROUND_HEIGHT: f64 = -13.6;
    let splats = shell_splats(args.splats as usize, SPLATS_PER_PIXEL, args.sh_degree, 1);
    // All facts are given, so that none is guessed; the ground lies below nearly all splats.
    let facts = Metadata {
        metres_per_unit: Some(1.0),
        up: Some(DVec3::Z),
        ground: Some(GROUND_HEIGHT),
        ..Metadata::default()
    };
    let scene = Scene { splats, ..Scene::default() };
    let camera = shell_camera(args.size.0, args.size.1);
    Ok((OpenScene::of(scene, &facts, &args.run)?, camera))
}

/// Opens a scene; returns it and its camera.
fn real(path: &Path, args: &BenchArgs) -> Result<(OpenScene, Camera)> {
    let read = SceneArgs {
        scene: path.to_owned(),
        repair: true,
        assets: Some(AssetFolder::Off),
        ..SceneArgs::default()
    };
    let mut loaded = if args.drop_sky {
        let mut scene = read_saying_remarks(path, &ReadOptions::default())?;
        wm_scene::survey::label_sky(&mut scene.splats);
        let groups = &scene.splats.groups;
        let rest: Vec<usize> = (0..groups.len()).filter(|i| groups[*i] != Group::Sky).collect();
        scene.splats = scene.splats.select(&rest);
        OpenScene::of(scene, &Metadata::default(), &args.run)?
    } else {
        OpenScene::new(&read, &args.run, None)?
    };
    let options = ViewOptions { up: None, fov: args.fov, near: None, size: Some(args.size) };
    let camera = loaded.camera(args.camera.as_ref(), &options)?;
    Ok((loaded, camera))
}
