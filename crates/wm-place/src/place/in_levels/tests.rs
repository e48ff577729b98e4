use super::*;
use crate::levels::{LevelBudget, LevelStream, RunId, coverage, held_bytes};
use crate::place::levels::runs_at;
use crate::{Error, FrameRequest, PlaceOptions};
use glam::DVec3;
use std::collections::BTreeMap;
use std::fs;
use tempfile::TempDir;
use wm_base::files::fetched;
use wm_scene::Group;
use wm_scene::formats::{DetailLevel, ReadOptions, read_scene};
use wm_scene::levels::{LevelIndex, LevelLeaf, LevelWriteOptions, LevelWriter, NewLeaf};

/// The built-in street in leaves of 8 m and three levels, of which each leaves out every other
/// splat of the one before.
fn street() -> (TempDir, PathBuf) {
    let scene = wm_street::Street::builtin().sampling(0.06).scene(&|_| true).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let main = folder.path().join("lod-meta.json");
    let mut leaves: BTreeMap<[i32; 3], Vec<usize>> = BTreeMap::new();
    let mut sky = Vec::new();
    for index in 0..scene.splats.len() {
        let cell = scene.splats.means[index].map(|v| (v / 8.0).floor() as i32);
        match scene.splats.groups[index] {
            Group::Sky => sky.push(index),
            _ => leaves.entry(cell).or_default().push(index),
        }
    }
    let options = LevelWriteOptions { splats_per_file: 2000, ..LevelWriteOptions::default() };
    let mut writer = LevelWriter::create(&main, options).unwrap();
    for leaf in leaves.values() {
        let level = |step: usize| {
            let mut splats = scene.splats.select(&leaf.iter().copied().step_by(step).collect::<Vec<_>>());
            let wider = 0.5 * (step as f32).ln();
            splats.log_scales.iter_mut().for_each(|scales| scales[0] += wider);
            splats
        };
        let levels = [1, 2, 4].map(level).to_vec();
        for job in writer.add(NewLeaf { levels, errors: vec![0.0, 0.02, 0.05] }).unwrap() {
            job.write().unwrap();
        }
    }
    let mut end = writer.finish(Some(scene.splats.select(&sky)), &scene.metadata).unwrap();
    end.jobs.drain(..).for_each(|job| job.write().unwrap());
    end.write_index().unwrap();
    (folder, main)
}

fn camera(x: f64, target: f64) -> Camera {
    let (eye, target) = (DVec3::new(x, -10.0, 1.6), DVec3::new(0.0, target, 1.5));
    Camera { near: 0.1, ..Camera::looking((120, 80), 60.0, eye, target, DVec3::Z).unwrap() }
}

fn load(main: &std::path::Path, splats: u64, repairs: bool) -> (Renderer, PreparedPlace) {
    let mut renderer = Renderer::cpu().unwrap();
    let budget = LevelBudget { splats: Some(splats), ..LevelBudget::default() };
    let index = LevelIndex::open(main).unwrap();
    let place = renderer.load_levels(index, &PlaceOptions::default(), &budget, repairs).unwrap();
    (renderer, place)
}

fn picture(renderer: &mut Renderer, place: &mut PreparedPlace, weather: &str, camera: Camera) -> Vec<f32> {
    let weather = Weather::preset(weather).unwrap();
    renderer.render(place, &FrameRequest::new(&weather, camera, 0.0)).unwrap().frame.rgb
}

fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// With room for all splats the picture is that of the finest level as a whole, whatever was looked
/// at before.
#[test]
fn a_cut_depends_on_the_camera_alone() {
    let (_folder, main) = street();
    let options = ReadOptions { level: DetailLevel::Finest, ..ReadOptions::default() };
    let whole = read_scene(&main, &options).unwrap();
    let all = whole.splats.len() as u64;
    let mut renderer = Renderer::cpu().unwrap();
    let mut place = renderer.load(whole).unwrap();
    let here = camera(0.0, 20.0);
    let expected = picture(&mut renderer, &mut place, "clear", here);
    let (mut renderer, mut place) = load(&main, all, false);
    let fine = picture(&mut renderer, &mut place, "clear", here);
    // Where two splats are at the same depth, the order of the leaves decides.
    assert!(largest_difference(&fine, &expected) < 0.02);

    // With few of them it is another picture, and the same one after any other.
    let (mut renderer, mut place) = load(&main, all / 8, false);
    let alone = picture(&mut renderer, &mut place, "clear", here);
    let difference = largest_difference(&alone, &expected);
    assert!(difference > 0.01, "{difference}");
    picture(&mut renderer, &mut place, "clear", camera(1.0, -50.0));
    assert_eq!(picture(&mut renderer, &mut place, "clear", here), alone);
    // Nor do drafts before it change it.
    let weather = Weather::clear();
    let draft = FrameRequest::new(&weather, camera(-1.0, 40.0), 0.0);
    renderer.render(&mut place, &FrameRequest { patience: Patience::Draft, ..draft }).unwrap();
    assert_eq!(picture(&mut renderer, &mut place, "clear", here), alone);
    // A shot of other cameras is another cut.
    place.set_shot(&[camera(1.0, -50.0)]);
    assert_ne!(picture(&mut renderer, &mut place, "clear", here), alone);
    place.set_shot(&[]);
    assert_eq!(picture(&mut renderer, &mut place, "clear", here), alone);
}

/// Runs that no cut wants are dropped once others need the room.
#[test]
fn memory_is_bounded() {
    let (_folder, main) = street();
    let index = Arc::new(LevelIndex::open(&main).unwrap());
    let mut backend =
        AnyRenderer::new(&wm_render::Device::Cpu, wm_render::CpuConfig::default(), |_| {}).unwrap();
    let mut stream = LevelStream::new(Arc::clone(&index), false);
    let all = runs_at(&index, 0);
    // As much as the largest of the cuts below takes.
    let bytes = |some: &[RunId]| {
        some.iter().map(|id| held_bytes(index.leaves[id.0 as usize].runs[0].count, 0)).sum::<u64>()
    };
    let most = all.chunks(3).map(bytes).max().unwrap();
    assert!(most < bytes(&all) / 2);
    stream.most = most;
    for some in all.chunks(3) {
        assert_eq!(stream.hold(&mut backend, some, Patience::Whole).unwrap(), some);
        assert!(stream.bytes <= most, "{}", stream.bytes);
        assert!(some.iter().all(|id| stream.get(*id).is_some()));
    }
    assert!(stream.get(all[0]).is_none());
    stream.clear(&mut backend);
    assert_eq!(stream.bytes, 0);
}

/// A file that is missing or damaged is named, or by choice what it holds is drawn at a coarser
/// level or not at all.
#[test]
fn damaged_files_are_named_or_left_out() {
    let (folder, main) = street();
    let here = camera(0.0, 20.0);
    let (mut renderer, mut place) = load(&main, 1 << 20, false);
    let whole = picture(&mut renderer, &mut place, "clear", here);
    // A file of the finest level that the camera sees.
    let index = LevelIndex::open(&main).unwrap();
    let leaf = index.leaves.iter().max_by(|a, b| {
        let area = |leaf: &LevelLeaf| coverage(leaf.low, leaf.high, &here);
        area(a).total_cmp(&area(b))
    });
    let file = leaf.unwrap().runs[0].file;
    let path = folder.path().join(&index.files[file]).with_file_name("sh0.webp");
    let bytes = fs::read(&path).unwrap();
    for damage in [Some(&bytes[..bytes.len() / 2]), Some(&b"RIFF"[..]), None] {
        match damage {
            Some(bytes) => fs::write(&path, bytes).unwrap(),
            None => fs::remove_file(&path).unwrap(),
        }
        let mut renderer = Renderer::cpu().unwrap();
        let opened = LevelIndex::open(&main).unwrap();
        let budget = LevelBudget::default();
        let failed = renderer.load_levels(opened, &PlaceOptions::default(), &budget, false);
        let Err(Error::Format(error)) = failed else { panic!("{:?}", failed.map(|_| ())) };
        let line = error.to_string();
        assert!(line.contains(&index.files[file]) && !line.contains('\n'), "{line}");
        let (mut renderer, mut place) = load(&main, 1 << 20, true);
        let coarser = picture(&mut renderer, &mut place, "clear", here);
        let warnings = place.take_warnings();
        assert_eq!(warnings.iter().filter(|line| line.contains("coarser level")).count(), 1, "{warnings:?}");
        let difference = largest_difference(&coarser, &whole);
        assert!((1e-3..0.9).contains(&difference), "{difference}");
    }
}

/// Weather that is prepared with few splats acts on all that are drawn: snow covers the street, and
/// fog takes its far end.
#[test]
fn weather_acts_on_what_is_drawn() {
    let (_folder, main) = street();
    let (mut renderer, mut place) = load(&main, 1 << 20, false);
    let here = camera(0.0, 20.0);
    let clear = picture(&mut renderer, &mut place, "clear", here);
    let weather = Weather::preset("snow-covered").unwrap();
    let snow = renderer.render(&mut place, &FrameRequest::new(&weather, here, 0.0)).unwrap().frame.rgb;
    // The same snow as of the whole scene.
    let whole = read_scene(&main, &ReadOptions::default()).unwrap();
    let mut of_whole = renderer.load(whole).unwrap();
    let expected = renderer.render(&mut of_whole, &FrameRequest::new(&weather, here, 0.0)).unwrap().frame.rgb;
    let difference = |a: &[f32], b: &[f32]| -> f32 {
        (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f32>() / a.len() as f32).sqrt()
    };
    let (off, changed) = (difference(&snow, &expected), difference(&clear, &expected));
    assert!(changed > 0.01 && off < 0.5 * changed, "{off} {changed}");
}

/// A place whose files are fetched, and its store: the street in a folder of its own.
struct FetchedFiles {
    from: PathBuf,
    root: PathBuf,
}

impl FetchedFiles {
    fn main(&self) -> PathBuf {
        self.root.join("lod-meta.json")
    }

    fn fetch(&self, path: &std::path::Path) {
        fetched::insert(path, fs::read(self.from.join(path.strip_prefix(&self.root).unwrap())).unwrap());
    }

    /// Opens the place once all that it asks for is there.
    fn open(&self, budget: &LevelBudget) -> (Renderer, PreparedPlace) {
        fetched::files_below(&self.root).iter().for_each(|path| fetched::remove(path));
        self.fetch(&self.main());
        // Files that name others are asked for first.
        for _ in 0..3 {
            let mut renderer = Renderer::cpu().unwrap();
            let index = LevelIndex::open(&self.main()).unwrap();
            match renderer.load_levels(index, &PlaceOptions::default(), budget, false) {
                Ok(place) => return (renderer, place),
                Err(error) => assert!(error.to_string().ends_with("not fetched yet"), "{error}"),
            }
            fetched::take_wanted().iter().for_each(|path| self.fetch(path));
        }
        panic!("it asks for more and more");
    }
}

/// Whatever order files come in, a frame is drawn at any time, and is the same as from a disk once
/// all is there.
#[test]
fn files_that_are_fetched_give_the_frames_of_a_disk() {
    let (folder, main) = street();
    let store =
        FetchedFiles { from: folder.path().into(), root: PathBuf::from(fetched::ROOT).join("street") };
    let all = LevelIndex::open(&main).unwrap().count_of_level(0);
    let (here, there) = (camera(0.0, 20.0), camera(1.0, -50.0));
    let mut fetches = 0;
    // The weather's splats are not those of the finest level then.
    let small = LevelBudget { memory: 230 << 20, splats: Some(all / 3) };
    let whole = LevelBudget { splats: Some(2 * all), ..LevelBudget::default() };
    for (order, budget, weather) in
        [(0, whole, "clear"), (0, small, "fog"), (1, small, "clear"), (2, small, "clear")]
    {
        let mut renderer = Renderer::cpu().unwrap();
        let index = LevelIndex::open(&main).unwrap();
        let mut place = renderer.load_levels(index, &PlaceOptions::default(), &budget, false).unwrap();
        let expected = [here, there].map(|camera| picture(&mut renderer, &mut place, weather, camera));
        assert!(!place.waits_for_files());
        let (mut renderer, mut place) = store.open(&budget);
        for (camera, expected) in [here, there].into_iter().zip(&expected) {
            let mut waiting: Vec<PathBuf> = Vec::new();
            loop {
                let drawn = picture(&mut renderer, &mut place, weather, camera);
                assert!(drawn.iter().all(|v| v.is_finite()));
                let wanted = fetched::take_wanted();
                if wanted.is_empty() && waiting.is_empty() {
                    assert!(!place.waits_for_files());
                    assert_eq!(&drawn, expected, "{order}");
                    break;
                }
                assert!(place.waits_for_files());
                // A frame notes again what has not come.
                waiting.extend(wanted.into_iter().filter(|path| !waiting.contains(path)).collect::<Vec<_>>());
                for _ in 0..waiting.len().div_ceil(2) {
                    let at = [0, waiting.len() - 1, waiting.len() / 2][order];
                    store.fetch(&waiting.remove(at));
                    fetches += 1;
                }
            }
            // What it did not need may go, and the next frame of it needs nothing else.
            fetched::keep_within(0, &place.spare_files());
            assert_eq!(&picture(&mut renderer, &mut place, weather, camera), expected);
            assert_eq!(fetched::take_wanted(), [] as [PathBuf; 0]);
        }
        assert!(place.take_warnings().iter().all(|line| !line.contains("coarser")));
    }
    // With room for all of it, all is there once it is open.
    assert!(fetches > 6, "{fetches}");
    // A damaged one is named.
    let (mut renderer, mut place) = store.open(&small);
    let weather = Weather::clear();
    let error = loop {
        let drawn = renderer.render(&mut place, &FrameRequest::new(&weather, here, 0.0));
        let wanted = fetched::take_wanted();
        if let Err(error) = drawn {
            break error.to_string();
        }
        assert!(!wanted.is_empty(), "what is damaged was drawn");
        for path in wanted {
            store.fetch(&path);
            if path.ends_with("sh0.webp") {
                fetched::insert(&path, b"RIFF".as_slice());
            }
        }
    };
    assert!(error.contains("sh0.webp") && !error.contains('\n'), "{error}");
}
