//! `align`: sets facts of a scene by hand: up, ground, scale, open water, sun, lamps.

use crate::overwrite::OverwriteArgs;
use crate::scene::{count_of, parse_distance, read_saying_remarks, save};
use anyhow::{Context, Result, bail};
use clap::Args;
use glam::DVec3;
use std::path::PathBuf;
use std::sync::Arc;
use weather_magician::formats::folder::scene_file;
use weather_magician::formats::{ReadOptions, WriteOptions, format_for, lost, sidecar_path, write_sidecar};
use weather_magician::lamps::{lamps_along_photos, lamps_on_posts};
use weather_magician::view::spec;
use weather_magician::{Metadata, Scene};
use wm_base::files::check_writable;
use wm_scene::survey::{Aligned, Alignment, GivenGround, GivenScale, Survey, align};
use wm_scene::{Lamp, LitWindow, PhotoSun};

/// Options of `align`.
#[derive(Args, Debug)]
#[command(
    after_help = "Splats and cameras stay as they are; the facts go with the scene. Points are in scene units.\n\n\
                  weather-magician align garden.ply --overwrite --ground 0,0,0.1:5,0,0:2,6,0.2\n\
                  weather-magician align garden.ply --overwrite --known-distance 0,0,0:1.5,0,2=12.5\n\
                  weather-magician align table.spz -o upright.spz --flip\n\
                  weather-magician align garden.ply --overwrite --lamp path --window 3,8,2:4.2,8,3.4\n\
                  weather-magician align garden.ply --overwrite --sun 2,1,3.5:4.1,1.6,0"
)]
pub(crate) struct AlignArgs {
    /// The scene: a PLY, SPZ, SOG, glTF, .splat or .ksplat, or the folder of a 3DGS training or a
    /// SOG
    scene: PathBuf,
    /// Output scene; the ending chooses the format. Without it, --overwrite writes the facts into
    /// SCENE.wm.toml, beside the scene
    #[arg(short, long, value_name = "PATH")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Up in the scene's axes, such as 0,-1,0
    #[arg(long, value_name = "X,Y,Z", value_parser = spec::parse_direction, allow_hyphen_values = true, help_heading = "Facts")]
    up: Option<DVec3>,
    /// Reverse up: the one given, that of the ground's points, or that of the scene
    #[arg(long, help_heading = "Facts")]
    flip: bool,
    /// Three points of the ground, which also tell up if --up is not given; or the height of the
    /// ground along up, scene units
    #[arg(long, value_name = "X,Y,Z:X,Y,Z:X,Y,Z|UNITS", value_parser = parse_ground, allow_hyphen_values = true, help_heading = "Facts")]
    ground: Option<GivenGround>,
    /// Metres per scene unit
    #[arg(long, value_name = "METRES", allow_negative_numbers = true, help_heading = "Facts")]
    metres_per_unit: Option<f64>,
    /// The scale from two points and the metres between them, such as 0,0,0:1.5,0,2=12.5
    #[arg(long, value_name = "X,Y,Z:X,Y,Z=M", value_parser = parse_distance, allow_hyphen_values = true, conflicts_with = "metres_per_unit", help_heading = "Facts")]
    known_distance: Option<(DVec3, DVec3, f64)>,
    /// The scale from the height of the photos' cameras above the ground, m
    #[arg(long, value_name = "METRES", allow_negative_numbers = true, conflicts_with_all = ["metres_per_unit", "known_distance"], help_heading = "Facts")]
    camera_height: Option<f64>,
    /// Outline of open water, three points or more, on which neither snow nor sand lies; may be
    /// given several times. `none`: there is none, although something blue looks like a pool
    #[arg(long, value_name = "X,Y,Z:X,Y,Z:...|none", value_parser = parse_outline, allow_hyphen_values = true, help_heading = "Facts")]
    water: Vec<Outline>,
    /// The sun of the photos: the top of something and the end of its shadow; or the direction
    /// towards the sun. `none`: the light was diffuse, as under clouds
    #[arg(long, value_name = "X,Y,Z:X,Y,Z|X,Y,Z|none", value_parser = parse_sun, allow_hyphen_values = true, help_heading = "Light")]
    sun: Option<PhotoSun>,
    /// A lamp that shines down, and its luminous flux in lumens (5000); may be given several times.
    /// `path`: a row of them beside the path of the photos. `posts`: one on each post that is
    /// found. `none`: there are none
    #[arg(long, value_name = "X,Y,Z[=LUMENS]|posts|path|none", value_parser = parse_lamp, allow_hyphen_values = true, help_heading = "Light")]
    lamp: Vec<GivenLamp>,
    /// A window that is lit by night, by two opposite corners on its wall; may be given several
    /// times. `none`: there are none
    #[arg(long, value_name = "X,Y,Z:X,Y,Z|none", value_parser = parse_window, allow_hyphen_values = true, help_heading = "Light")]
    window: Vec<GivenWindow>,
}

fn parse_sun(text: &str) -> Result<PhotoSun, String> {
    if text == "none" {
        return Ok(PhotoSun::Diffuse);
    }
    let Some((top, end)) = text.split_once(':') else {
        return Ok(PhotoSun::Towards(spec::parse_direction(text).map_err(|e| e.to_string())?.normalize()));
    };
    let sun = PhotoSun::of_shadow(spec::parse_point(top)?, spec::parse_point(end)?);
    sun.ok_or_else(|| "the top and the end of its shadow must be two points".into())
}

/// A lamp on the command line.
#[derive(Clone, Copy, Debug, PartialEq)]
enum GivenLamp {
    None,
    Posts,
    Path,
    /// Place and luminous flux, lm.
    At(DVec3, f64),
}

fn parse_lamp(text: &str) -> Result<GivenLamp, String> {
    match text {
        "none" => return Ok(GivenLamp::None),
        "posts" => return Ok(GivenLamp::Posts),
        "path" => return Ok(GivenLamp::Path),
        _ => {}
    }
    let (point, lumens) = match text.split_once('=') {
        Some((point, lumens)) => {
            (point, lumens.parse().map_err(|_| format!("`{lumens}` is no number of lumens"))?)
        }
        None => (text, Lamp::default_lumens()),
    };
    Ok(GivenLamp::At(spec::parse_point(point)?, lumens))
}

/// The corners of a window; `None` for none.
type GivenWindow = Option<[DVec3; 2]>;

fn parse_window(text: &str) -> Result<GivenWindow, String> {
    if text == "none" {
        return Ok(None);
    }
    let (a, b) = text.split_once(':').ok_or("give two opposite corners, X,Y,Z:X,Y,Z, or none")?;
    Ok(Some([spec::parse_point(a)?, spec::parse_point(b)?]))
}

/// An outline; without points for none.
type Outline = Arc<[DVec3]>;

fn parse_outline(text: &str) -> Result<Outline, String> {
    if text == "none" {
        return Ok(Arc::default());
    }
    let points = text.split(':').map(spec::parse_point).collect::<Result<Outline, _>>()?;
    if points.len() < 3 {
        Err("give three points or more, X,Y,Z:X,Y,Z:X,Y,Z, or none".into())
    } else {
        Ok(points)
    }
}

fn parse_ground(text: &str) -> Result<GivenGround, String> {
    if let Ok(height) = text.trim().parse() {
        return Ok(GivenGround::Height(height));
    }
    let points: Vec<&str> = text.split(':').collect();
    let [a, b, c] = points[..] else {
        return Err("give three points, X,Y,Z:X,Y,Z:X,Y,Z, or one height along up".into());
    };
    Ok(GivenGround::Points([spec::parse_point(a)?, spec::parse_point(b)?, spec::parse_point(c)?]))
}

impl AlignArgs {
    /// The outlines of open water; `None` if nothing is said of it.
    fn water(&self) -> Option<Vec<Vec<[f64; 3]>>> {
        let outlines = self.water.iter().filter(|outline| !outline.is_empty());
        let outlines = outlines.map(|outline| outline.iter().map(DVec3::to_array).collect()).collect();
        (!self.water.is_empty()).then_some(outlines)
    }
}

/// Beam of a lamp that is put into a scene.
pub(crate) const LAMP_BEAM_DEG: f64 = 140.0;

impl AlignArgs {
    /// Returns true if the sun, lamps or windows are given.
    fn has_lights(&self) -> bool {
        self.sun.is_some() || !self.lamp.is_empty() || !self.window.is_empty()
    }

    /// Sets the sun, lamps and windows of a scene.
    fn light(&self, scene: &mut Scene) -> Result<()> {
        let survey = Survey::of(scene, &Metadata::default());
        let (up, origin) = (survey.up.value, survey.origin);
        if let Some(sun) = self.sun {
            if let PhotoSun::Towards(towards) = sun
                && towards.dot(up) <= 0.0
            {
                let below = -towards.dot(up).asin().to_degrees();
                bail!(
                    "--sun: it is {below:.1} degrees below the horizon; give the top before the end of its shadow, or set --up"
                );
            }
            scene.metadata.sun = Some(sun);
        }
        if !self.lamp.is_empty() {
            let mut lamps = Vec::new();
            for lamp in &self.lamp {
                match *lamp {
                    GivenLamp::None => {}
                    GivenLamp::Posts => lamps.extend(lamps_on_posts(scene, &survey)),
                    GivenLamp::Path => lamps.extend(lamps_along_photos(scene, &survey)),
                    GivenLamp::At(at, lumens) => lamps.push(Lamp {
                        lumens,
                        aim: Some((-up).to_array()),
                        beam: LAMP_BEAM_DEG,
                        ..Lamp::new((at - origin).to_array())
                    }),
                }
            }
            scene.metadata.lamps = Some(lamps);
        }
        if !self.window.is_empty() {
            // Windows look to where the photos were taken, or to the middle of the scene.
            let views = scene.views.iter().map(|view| view.camera.center());
            let eye = match scene.views.len() {
                0 => survey.center,
                count => views.sum::<DVec3>() / count as f64,
            };
            let window = |corners: &[DVec3; 2]| {
                LitWindow::between(corners.map(|corner| corner - origin), up, eye)
                    .context("--window: its corners must not be level, nor above each other")
            };
            scene.metadata.windows = Some(self.window.iter().flatten().map(window).collect::<Result<_>>()?);
        }
        Ok(())
    }
}

/// Returns an alignment relative to the origin of a scene; users give points and heights of the
/// world.
fn local(by: Alignment, scene: &Scene) -> Alignment {
    let origin = scene.metadata.origin_or_zero();
    let ground = by.ground.map(|ground| match ground {
        GivenGround::Points(points) => GivenGround::Points(points.map(|point| point - origin)),
        GivenGround::Height(height) if origin != DVec3::ZERO => {
            let up = by.up.unwrap_or_else(|| Survey::of(scene, &Metadata::default()).up.value).normalize();
            GivenGround::Height(height - if by.flip { -up } else { up }.dot(origin))
        }
        height => height,
    });
    Alignment { ground, ..by }
}

/// Returns outlines relative to the origin of a scene.
fn local_outlines(mut outlines: Vec<Vec<[f64; 3]>>, scene: &Scene) -> Vec<Vec<[f64; 3]>> {
    let origin = scene.metadata.origin_or_zero();
    for corner in outlines.iter_mut().flatten() {
        *corner = (DVec3::from_array(*corner) - origin).to_array();
    }
    outlines
}

/// Runs the command.
pub(crate) fn run(args: &AlignArgs) -> Result<()> {
    let distance = args.known_distance.map(|(a, b, metres)| GivenScale::Distance(a, b, metres));
    let scale = distance.or(args.metres_per_unit.map(GivenScale::MetresPerUnit));
    let by = Alignment {
        up: args.up,
        flip: args.flip,
        ground: args.ground,
        scale: scale.or(args.camera_height.map(GivenScale::CameraHeight)),
    };
    // Cheap checks come before reading a large file.
    let water = args.water();
    let is_aligned = by != Alignment::default() || (water.is_none() && !args.has_lights());
    if is_aligned {
        by.check()?;
    }
    match &args.out {
        None if !args.overwrite.overwrite => bail!(
            "{}: give an output scene with -o, or --overwrite to set the facts of the scene itself",
            args.scene.display()
        ),
        None => check_writable(&sidecar_path(&scene_file(&args.scene)?))?,
        Some(out) => {
            format_for(out)?;
            // The folder for the files of a SOG is created; any other must exist.
            if out.extension().is_none_or(|extension| extension != "json") {
                check_writable(out)?;
            }
            args.overwrite.check(out, &[&args.scene], "choose another name")?;
        }
    }
    let mut scene = read_saying_remarks(&args.scene, &ReadOptions::default())?;
    let by = local(by, &scene);
    let water = water.map(|outlines| local_outlines(outlines, &scene));
    let aligned = is_aligned
        .then(|| align(&mut scene, &by).with_context(|| args.scene.display().to_string()))
        .transpose()?;
    if let Some(water) = water {
        scene.metadata.water = Some(water);
    }
    args.light(&mut scene)?;
    if let Some(fault) = scene.metadata.fault() {
        bail!("{fault}");
    }
    let written = match &args.out {
        None => {
            let file = scene_file(&args.scene)?;
            write_sidecar(&file, &scene.metadata_beside_file(scene.metadata.clone()))?;
            sidecar_path(&file)
        }
        Some(out) => {
            save(out, &scene, &WriteOptions::default())?;
            out.clone()
        }
    };
    println!("{}: written", written.display());
    for line in aligned.iter().flat_map(Aligned::lines) {
        println!("  {line}");
    }
    if let Some(outlines) = scene.metadata.water.as_ref().filter(|_| !args.water.is_empty()) {
        println!("  water: {}", count_of(outlines.len(), "outline"));
    }
    if args.sun.is_some() {
        let survey = Survey::of(&scene, &Metadata::default());
        match survey.sun {
            Some(sun) => println!("  sun: {}", sun.line()),
            None => println!("  sun: none, the light is diffuse"),
        }
    }
    if !args.lamp.is_empty() || !args.window.is_empty() {
        let Metadata { lamps, windows, .. } = &scene.metadata;
        let [lamps, windows] = [lamps.as_ref().map_or(0, Vec::len), windows.as_ref().map_or(0, Vec::len)];
        println!("  lamps: {}, {}", count_of(lamps, "lamp"), count_of(windows, "lit window"));
    }
    if let Some(out) = &args.out {
        for line in lost(&format_for(out)?.loses, &scene) {
            println!("  lost: {line}");
        }
    }
    let Some(aligned) = aligned else { return Ok(()) };
    if aligned.has_old_sky() {
        println!(
            "  sky: its {} splats were made along another up; --sky rebuild of render and convert decides anew",
            aligned.after.sky_splats
        );
    }
    for warning in aligned.after.up_warning().into_iter().chain(aligned.after.warning()) {
        eprintln!("warning: {warning}");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lamps_and_windows_are_points() {
        assert_eq!(parse_lamp("1,-2,6"), Ok(GivenLamp::At(DVec3::new(1.0, -2.0, 6.0), 5_000.0)));
        assert_eq!(parse_lamp("posts"), Ok(GivenLamp::Posts));
        assert_eq!(parse_lamp("0,0,4=800"), Ok(GivenLamp::At(DVec3::new(0.0, 0.0, 4.0), 800.0)));
        assert_eq!(parse_window("0,0,1:1,0,2"), Ok(Some([DVec3::Z, DVec3::new(1.0, 0.0, 2.0)])));
        assert!(parse_lamp("0,0,4=bright").is_err() && parse_window("0,0,1").is_err());
    }

    #[test]
    fn the_sun_stands_from_the_end_of_a_shadow_over_the_top() {
        for text in ["0,0,4:0,-3,0", "0,3,4"] {
            let Ok(PhotoSun::Towards(towards)) = parse_sun(text) else { panic!("{text}") };
            assert!(towards.distance(DVec3::new(0.0, 0.6, 0.8)) < 1e-12, "{text}: {towards}");
        }
        assert_eq!(parse_sun("none"), Ok(PhotoSun::Diffuse));
        assert!(parse_sun("1,2,3:1,2,3").is_err() && parse_sun("0,0,0").is_err());
    }

    #[test]
    fn water_is_an_outline_or_none() {
        assert_eq!(parse_outline("none").unwrap().len(), 0);
        assert_eq!(parse_outline("0,0,0:1,0,0:0,-1,0:-1,0,0").unwrap()[2], DVec3::NEG_Y);
        for bad in ["", "0,0,0:1,0,0", "0,0,0:1,0,0:x,0,0"] {
            assert!(parse_outline(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn the_ground_is_a_height_or_three_points() {
        assert_eq!(parse_ground("-1.5"), Ok(GivenGround::Height(-1.5)));
        let points = [DVec3::ZERO, DVec3::X, DVec3::NEG_Y];
        assert_eq!(parse_ground("0,0,0:1,0,0:0,-1,0"), Ok(GivenGround::Points(points)));
        for bad in ["", "1,2,3", "0,0,0:1,0,0", "0,0,0:1,0,0:0,x,0", "0,0,0:1,0,0:0,1"] {
            assert!(parse_ground(bad).is_err(), "{bad}");
        }
    }
}
