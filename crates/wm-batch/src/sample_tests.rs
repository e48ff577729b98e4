//! Tests of readings in memory: they are those of the files, in any order.

use super::splits::split_of;
use super::*;
use glam::DVec3;
use std::path::Path;
use wm_base::npy;
use wm_image::PictureSize;
use wm_image::png::write_rgb8;
use wm_place::{CpuConfig, Device, Renderer};
use wm_place::{Layers, PictureLayer};
use wm_scene::formats::write_scene;
use wm_scene::synthetic::Builder;
use wm_scene::{Metadata, Scene};

/// A camera with a rolling shutter, an exposure of its own and noise, twice as fast as the frames,
/// and a lidar.
const RIG: &str = r#"
[[sensor]]
name = "front"
kind = "camera"
rate = 20
phase = 0.02
size = [24, 16]
fov = 60
readout = 0.01
exposure = "auto"
iso = 800
[[sensor]]
name = "top"
kind = "lidar"
model = "lidar.toml"
sub_rays = 1
format = "npy"
[[sensor]]
name = "late"
kind = "camera"
rate = 10
phase = 0.15
size = [24, 16]
fov = 60
"#;

const LIDAR: &str = r#"
name = "small"
wavelength = 905
divergence = 3.0
pulse = 6
range = [0.5, 100]
reference_range = 50
range_noise = 0.015
[rows]
rate = 10
elevations = [-12, -6, -2]
columns = 90
"#;

const PLAN: &str = r#"
seed = 9
frames = 2
frame_rate = 10
block = 3
also = ["depth.npy"]
pairs = true
splits = { train = 0.75, val = 0.25 }
[[scene]]
file = "red.ply"
[[scene]]
file = "blue.ply"
[[path]]
camera = "0,-6,1:0,4,1"
speed = 8
[rig]
file = "rig.toml"
[[weather]]
from = ["heavy-rain", "fog"]
"#;

fn place(folder: &Path) -> BatchPlan {
    for (name, rgb) in [("red", [0.7, 0.2, 0.1]), ("blue", [0.1, 0.2, 0.7])] {
        let mut place = Builder::new(5);
        place.surface(DVec3::new(-6.0, -8.0, 0.0), DVec3::X * 12.0, DVec3::Y * 16.0, 0.9, |_, _| {
            [0.5, 0.5, 0.45]
        });
        place.block(DVec3::new(0.5, 3.0, 0.0), DVec3::new(2.0, 2.0, 2.0), 0.5, rgb);
        let metadata = Metadata {
            metres_per_unit: Some(1.0),
            up: Some(DVec3::Z),
            ground: Some(0.0),
            ..Metadata::default()
        };
        let scene = Scene { splats: place.build(), metadata, ..Scene::default() };
        write_scene(&folder.join(format!("{name}.ply")), &scene).unwrap();
    }
    std::fs::write(folder.join("rig.toml"), RIG).unwrap();
    std::fs::write(folder.join("lidar.toml"), LIDAR).unwrap();
    BatchPlan::parse(PLAN, "p.toml", folder, "p").unwrap()
}

fn run(plan: &BatchPlan) -> BatchRun {
    let cpu = CpuConfig { threads: Some(1), ..CpuConfig::default() };
    let renderer = Renderer::new(&Device::Cpu, cpu, |_| {}).unwrap();
    BatchRun::new(plan.clone(), renderer, |_| None).unwrap()
}

fn array(sample: &BatchSample, layer: PictureLayer) -> &SampleArray {
    let SampleData::Picture(layers) = &sample.data else { panic!("a picture") };
    layers.iter().find(|array| array.layer == layer).unwrap()
}

#[test]
fn a_sample_has_the_bytes_of_the_files_in_any_order() {
    let folder = tempfile::tempdir().unwrap();
    let plan = place(folder.path());
    let mut whole = run(&plan);
    let store = BatchStore::new(&folder.path().join("set")).unwrap();
    for block in 0..whole.clips.blocks() {
        whole.make(&store, &whole.clips.block(block), &mut ()).unwrap();
    }
    // A camera that begins in a clip's second block makes no second thumbnail.
    merge(&whole, &store, true, &mut ()).unwrap();
    let frames = folder.path().join("set").join(FRAMES_LAYOUT);
    let mut alone = run(&plan);
    let two = SampleOptions::default();
    let one = SampleOptions { places: 1, ..two };
    let depth = PictureLayer::Depth;
    // Eight frames: two scenes, two weathers, two frames. To and fro between the scenes, the last
    // frame first.
    for (number, frame) in [7u64, 0, 5, 2].into_iter().enumerate() {
        let options = if number % 2 == 0 { two } else { one };
        let sample = alone.sample(frame, &options).unwrap();
        let own = frames.join(&sample.clip.name).join("front").join(format!("{:06}", sample.reading.index));
        // The first picture of each frame: at 0.02 s and at 0.12 s.
        assert_eq!(u64::from(sample.reading.index), 2 * (frame % 2), "{frame}");
        assert!((sample.reading.time - 0.1 * (frame % 2) as f64 - 0.02).abs() < 1e-9);
        for (layer, kind) in [(PictureLayer::Color, "png"), (PictureLayer::Clear, "clear.png")] {
            let SampleArray { shape, values: SampleValues::Bytes(bytes), .. } = array(&sample, layer) else {
                panic!("{layer}");
            };
            assert_eq!(shape[..], [16, 24, 3]);
            let again = folder.path().join("again.png");
            write_rgb8(&again, bytes, PictureSize::new(24, 16), &[]).unwrap();
            let [ours, theirs] = [again, own.with_extension(kind)].map(|path| std::fs::read(path).unwrap());
            assert!(ours == theirs, "frame {frame}: {layer}");
        }
        let (values, shape) = npy::read(&own.with_extension("depth.npy")).unwrap();
        let ours = array(&sample, depth);
        assert!(ours.values == SampleValues::Floats(values) && ours.shape == shape, "frame {frame}");
        // Fewer layers change nothing of the others.
        let bare = alone.sample(frame, &SampleOptions { layers: Some(Layers::COLOR), ..options }).unwrap();
        assert_eq!(array(&bare, PictureLayer::Color), array(&sample, PictureLayer::Color));
    }
    let sweep = alone.sample(3, &SampleOptions { sensor: Some("top"), ..two }).unwrap();
    let SampleData::Points(points) = &sweep.data else { panic!("points") };
    let (rows, shape) = npy::read(&frames.join(&sweep.clip.name).join("top/000001.npy")).unwrap();
    let mut theirs: Vec<[u32; 3]> =
        rows.chunks(shape[1]).map(|row| [row[0], row[1], row[2]].map(f32::to_bits)).collect();
    let mut ours: Vec<[u32; 3]> = points.iter().map(|point| point.position.map(f32::to_bits)).collect();
    theirs.sort_unstable();
    ours.sort_unstable();
    assert!(ours.len() > 20 && ours == theirs);

    for (frame, sensor, says) in [
        (8, None, "p.toml: frame 8: the set has 8"),
        (0, Some("frnt"), "there is no sensor `frnt`, did you mean `front`?"),
        (
            2,
            Some("late"),
            "frame 2: sensor \"late\" reads nothing in it, since it begins at 0.15 s of a clip",
        ),
    ] {
        let fault = alone.sample(frame, &SampleOptions { sensor, ..two }).unwrap_err().to_string();
        assert!(fault.contains(says), "{fault}");
    }
    let fault =
        alone.sample(0, &SampleOptions { layers: Some(Layers::FLOW), ..two }).unwrap_err().to_string();
    assert!(fault.contains("layer flow shows one instant"), "{fault}");
}

/// Event cameras have files of their own; layouts and samples have no room for them, and say so.
#[test]
fn slices_of_events_are_files_alone() {
    let folder = tempfile::tempdir().unwrap();
    place(folder.path());
    let dvs = "[[sensor]]\nname = \"dvs\"\nkind = \"events\"\nrate = 10\nsize = [24, 16]\nnoise = 50\npictures = 2\n";
    std::fs::write(folder.path().join("rig.toml"), format!("{RIG}{dvs}")).unwrap();
    let parse = |text: &str| BatchPlan::parse(text, "p.toml", folder.path(), "p").unwrap();
    let mut own = run(&parse(PLAN));
    let store = BatchStore::new(&folder.path().join("set")).unwrap();
    own.make_frames(&store, &(0..2), &mut ()).unwrap();
    let clip = own.sample(0, &SampleOptions::default()).unwrap().clip.name;
    let slices = folder.path().join("set").join(FRAMES_LAYOUT).join(clip).join("dvs");
    for index in 0..2 {
        let bytes = std::fs::read(slices.join(format!("{index:06}.npy"))).unwrap();
        // The noise alone: 50 Hz over 0.1 s in 24 x 16 pixels, 13 bytes each.
        assert!(bytes.starts_with(b"\x93NUMPY") && bytes.len() > 13 * 1600, "{}", bytes.len());
    }
    let sample = SampleOptions { sensor: Some("dvs"), ..SampleOptions::default() };
    let fault = own.sample(0, &sample).unwrap_err().to_string();
    assert!(fault.contains("a sample has no room for the readings of kind events"), "{fault}");
    for layout in LAYOUTS.iter().map(|layout| layout.name) {
        let plan = parse(&format!("layouts = [\"{FRAMES_LAYOUT}\", \"{layout}\"]\n{PLAN}"));
        let fault = BatchRun::new(plan, Renderer::cpu().unwrap(), |_| None).err().unwrap().to_string();
        let says = "it has no room for sensor \"dvs\", of kind events; leave out one of the two";
        assert_eq!(fault, format!("layout {layout}: {says}"));
    }
}

#[test]
fn layers_are_known_by_their_names() {
    for name in ["rgb", "clear", "surface-depth", "median-depth", "flow-mask"] {
        assert_eq!(name.parse::<PictureLayer>().unwrap().to_string(), name);
    }
    assert!("depth.npy".parse::<PictureLayer>().unwrap_err().contains("leave out the extension"));
    assert!("dept".parse::<PictureLayer>().unwrap_err().ends_with("surface-depth or clear"));
}

#[test]
fn splits_list_their_clips_without_a_list() {
    let folder = tempfile::tempdir().unwrap();
    let plan = place(folder.path());
    let clips = 5000;
    let splits = [0, 1].map(|split| SplitClips::count(&plan, split, clips));
    assert_eq!(splits[0].len() + splits[1].len(), clips);
    assert!((splits[0].len() as f64 / clips as f64 - 0.75).abs() < 0.03);
    for (split, own) in splits.iter().enumerate() {
        let listed: Vec<u64> = (0..own.len()).map(|index| own.get(index).unwrap()).collect();
        assert!(listed.iter().copied().eq((0..clips).filter(|clip| split_of(&plan, *clip) == split)));
        assert_eq!(own.get(own.len()), None);
    }
    assert!(SplitClips::count(&plan, 0, 0).is_empty());
}
