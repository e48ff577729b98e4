//! Scenes in levels, written and read.

use super::{LevelFileJob, LevelIndex, LevelWriteOptions, LevelWriter, NewLeaf, TilePlan};
use crate::{Metadata, Rasterization, Scene, Splats, formats::DetailLevel, morton, testing::Dice};
use glam::{DMat4, DVec3};
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};
use tempfile::tempdir;
use wm_base::FormatError;

/// Splats about `middle`, within 2 units of it but for their tails.
fn some(dice: &mut Dice, middle: [f32; 3], count: usize) -> Splats {
    let mut splats = Splats::with_capacity(count, 1);
    let mut next = || dice.draw(-1.0, 1.0) as f32;
    for _ in 0..count {
        splats.means.push(middle.map(|v| v + 2.0 * next()));
        splats.quats.push([next(), next(), next(), 1.0]);
        splats.log_scales.push([next() - 3.0, next() - 3.0, next() - 3.0]);
        splats.logit_opacities.push(2.0 * next());
        splats.sh.extend((0..12).map(|_| next()));
        splats.groups.push(crate::Group::Scene);
    }
    splats
}

/// Leaves on a row, of 40, 20 and 10 splats; the fourth has one level, the fifth lacks the middle
/// one.
fn leaves() -> Vec<NewLeaf> {
    let mut dice = Dice::new(7);
    let leaf = |number: usize| {
        let middle = [6.0 * number as f32, -3.0, 1.0];
        let counts: &[usize] = match number {
            3 => &[40],
            4 => &[40, 0, 10],
            _ => &[40, 20, 10],
        };
        let levels: Vec<Splats> = counts.iter().map(|count| some(&mut dice, middle, *count)).collect();
        NewLeaf { errors: [0.0, 0.01, 0.005][..levels.len()].to_vec(), levels }
    };
    (0..7).map(leaf).collect()
}

fn written(main: &Path, leaves: Vec<NewLeaf>) -> Result<(), FormatError> {
    let options = LevelWriteOptions {
        splats_per_file: 100,
        rasterization: Some(Rasterization::Antialiased),
        ..Default::default()
    };
    let mut writer = LevelWriter::create(main, options)?;
    let mut jobs = Vec::new();
    for leaf in leaves {
        jobs.extend(writer.add(leaf)?);
    }
    let metadata = Metadata { metres_per_unit: Some(0.5), ..Metadata::default() };
    let environment = some(&mut Dice::new(1), [500.0; 3], 9);
    let mut end = writer.finish(Some(environment), &metadata)?;
    jobs.append(&mut end.jobs);
    jobs.into_iter().rev().try_for_each(LevelFileJob::write)?;
    end.write_index()
}

/// The files below a folder.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            all.extend(
                files(&path)
                    .into_iter()
                    .map(|(name, bytes)| (Path::new(path.file_name().unwrap()).join(name), bytes)),
            );
        } else {
            all.insert(path.file_name().unwrap().into(), fs::read(&path).unwrap());
        }
    }
    all
}

#[test]
fn what_is_written_is_read() {
    let folder = tempdir().unwrap();
    let main = folder.path().join("a/lod-meta.json");
    written(&main, leaves()).unwrap();
    let index = LevelIndex::open(&main).unwrap();
    assert_eq!((index.levels, index.leaves.len()), (3, 7));
    // 40 splats a leaf: three leaves are the first that have 100.
    let names = ["0_0", "1_0", "2_0", "0_1", "0_2"].map(|name| format!("{name}/meta.json"));
    let (mut found, mut expected) = (index.files.clone(), names.to_vec());
    found.sort();
    expected.sort();
    assert_eq!(found, expected);
    assert_eq!(index.metadata.metres_per_unit, Some(0.5));
    assert_eq!(index.metadata.rasterization, Some(Rasterization::Antialiased));
    assert_eq!([0, 1, 2].map(|level| index.count_of_level(level)), [280, 100 + 40 + 10, 60 + 40]);
    let given = leaves();
    let mut covered = vec![0; index.files.len()];
    for leaf in &index.leaves {
        let number = ((leaf.low[0] + leaf.high[0]) / 12.0).round() as usize;
        let given = &given[number];
        for run in &leaf.runs {
            let (splats, read) = (&given.levels[run.level as usize], index.read_file(run.file).unwrap());
            assert_eq!(read.metadata().rasterization, Some(Rasterization::Antialiased));
            let read = read.splats(run.offset, run.count).unwrap();
            covered[run.file] += run.count;
            assert_eq!(run.error, Some([0.0, 0.01, 0.01][run.level as usize]));
            for (index, from) in morton::order(&splats.means).into_iter().enumerate() {
                let off = (0..3).map(|k| (read.means[index][k] - splats.means[from as usize][k]).abs());
                assert!(off.fold(0.0, f32::max) < 1e-2, "leaf {number}, splat {index}");
                // Of a box of three standard deviations, and the rounding of the files.
                let reach = splats.log_scales[from as usize].iter().fold(f32::MIN, |a, b| a.max(*b)).exp();
                let inside = |k: usize| {
                    read.means[index][k] - reach > leaf.low[k] - 0.01
                        && read.means[index][k] + reach < leaf.high[k] + 0.01
                };
                assert!((0..3).all(inside));
            }
        }
    }
    let lengths: Vec<u64> =
        (0..index.files.len()).map(|file| index.read_file(file).unwrap().len() as u64).collect();
    assert_eq!(covered, lengths);
    assert_eq!(index.read_environment().unwrap().unwrap().splats.len(), 9);
    assert_eq!(index.read_level(DetailLevel::Finest).unwrap().splats.len(), 289);
    // Written over what has more: nothing old is left, and the bytes are those of a new folder.
    let other = folder.path().join("b/lod-meta.json");
    written(&other, leaves().into_iter().cycle().take(9).collect()).unwrap();
    fs::write(folder.path().join("b/0_0/notes.txt"), "mine").unwrap();
    written(&other, leaves()).unwrap();
    let mut again = files(&folder.path().join("b"));
    assert_eq!(again.remove(Path::new("0_0/notes.txt")).unwrap(), b"mine");
    assert!(again == files(&folder.path().join("a")));
}

#[test]
fn a_stopped_write_leaves_no_index() {
    let folder = tempdir().unwrap();
    let main = folder.path().join("lod-meta.json");
    written(&main, leaves()).unwrap();
    let mut writer = LevelWriter::create(&main, LevelWriteOptions::default()).unwrap();
    assert_eq!(files(folder.path()).len(), 0);
    assert!(writer.add(leaves().remove(0)).unwrap().is_empty());
    let end = writer.finish(None, &Metadata::default()).unwrap();
    let message = end.write_index().unwrap_err().to_string();
    assert!(message.ends_with("0_0/meta.json: no such file or folder; check the path"), "{message}");
    assert!(!main.exists());
}

#[test]
fn what_cannot_be_written_is_told() {
    let folder = tempdir().unwrap();
    let options = LevelWriteOptions::default();
    let said = |error: FormatError| error.to_string().rsplit("lod-meta.json: ").next().unwrap().to_owned();
    assert!(LevelWriter::create(&folder.path().join("a.json"), options).is_err());
    let mut writer = LevelWriter::create(&folder.path().join("lod-meta.json"), options).unwrap();
    let mut refused = |change: &dyn Fn(&mut NewLeaf)| {
        let mut leaf = leaves().remove(0);
        change(&mut leaf);
        said(writer.add(leaf).err().unwrap())
    };
    for (message, expected) in [
        (refused(&|leaf| leaf.errors[1] = f32::NAN), "the error NaN; it must be 0 or more"),
        (refused(&|leaf| leaf.errors.truncate(2)), "2 errors for 3 levels"),
        (refused(&|leaf| leaf.levels[1].means[3][0] = f32::NAN), "splat 3 cannot be drawn; repair the scene"),
        (refused(&|leaf| leaf.levels.resize(65, Splats::default())), "65 levels; 64 are the most"),
    ] {
        assert_eq!(message, format!("not written: leaf 0: {expected}"));
    }
    let empty = said(writer.finish(None, &Metadata::default()).err().unwrap());
    assert_eq!(empty, "there are no splats in it; nothing can be shown");
}

#[test]
fn leaves_are_given_the_levels_that_they_lack() {
    let folder = tempdir().unwrap();
    let main = folder.path().join("lod-meta.json");
    let options = LevelWriteOptions { levels: 4, ..LevelWriteOptions::default() };
    let mut writer = LevelWriter::create(&main, options).unwrap();
    writer.add(leaves().remove(3)).unwrap();
    writer.add(leaves().remove(4)).unwrap();
    let mut end = writer.finish(None, &Metadata::default()).unwrap();
    end.jobs.drain(..).try_for_each(LevelFileJob::write).unwrap();
    end.write_index().unwrap();
    let text: Value = serde_json::from_slice(&fs::read(&main).unwrap()).unwrap();
    assert_eq!(text["counts"], json!([80, 40, 50, 50]));
    // Here they are not read again.
    let index = LevelIndex::open(&main).unwrap();
    let levels = |leaf: usize| index.leaves[leaf].runs.iter().map(|run| run.level).collect::<Vec<_>>();
    assert_eq!((levels(0), levels(1)), (vec![0], vec![0, 2]));
    assert_eq!(index.count_of_level(3), 50);
}

/// A small index whose files are not there.
fn index() -> Value {
    let leaf = |run: Value| json!({ "bound": { "min": [0, 0, 0], "max": [1, 1, 1] }, "lods": { "0": run }, "errors": [0, 1] });
    json!({
        "version": 1, "lodLevels": 2, "lodErrors": true, "environment": "env/meta.json", "filenames": ["0_0/meta.json", "1_0/meta.json"],
        "tree": { "bound": {}, "children": [
            leaf(json!({ "file": 0, "offset": 0, "count": 5 })),
            leaf(json!({ "file": 0, "offset": 5, "count": 7 })),
        ] },
    })
}

fn parsed(text: &str) -> Result<LevelIndex, String> {
    let parsed = LevelIndex::parse(Path::new("lod-meta.json"), text.as_bytes());
    parsed.map_err(|problem| {
        let message = problem.to_string();
        assert!(!message.contains(['\n', '\r']), "{message}");
        message.trim_start_matches("SOG: ").trim_end_matches("; export the file again").to_owned()
    })
}

#[test]
fn an_index_that_contradicts_itself_is_refused() {
    assert!(parsed(&index().to_string()).is_ok());
    let run = json!({ "file": 1, "offset": 0, "count": 2 });
    for (place, value, expected) in [
        ("/version", json!(2), "lod-meta.json of version 2 is not read, 1 is"),
        ("/lodLevels", json!(0), "lod-meta.json has 0 levels; 1 to 64 are read"),
        ("/lodLevels", json!(65), "lod-meta.json has 65 levels; 1 to 64 are read"),
        ("/environment", json!("./0_0/meta.json"), "lod-meta.json names \"./0_0/meta.json\" twice"),
        ("/filenames/1", json!("0_0/./meta.json"), "lod-meta.json names \"0_0/./meta.json\" twice"),
        ("/tree/children/1/lods/0/file", json!(2), "lod-meta.json has no file 2"),
        (
            "/tree/children/1/lods/0/offset",
            json!(4),
            "a leaf of lod-meta.json has splats that another has too",
        ),
        (
            "/tree/children/1/lods/0/offset",
            json!(u64::MAX),
            "a leaf of lod-meta.json has splats that another has too",
        ),
        (
            "/tree/children/0/lods",
            json!({ "0": run, "00": run }),
            "a leaf of lod-meta.json has level 0 twice",
        ),
        (
            "/tree/children/0/lods",
            json!({ "2": run }),
            "a leaf of lod-meta.json has a level \"2\": there are 0 to 1",
        ),
        (
            "/tree/children/0/lods",
            json!({ "a\n": run }),
            "a leaf of lod-meta.json has a level \"a\\n\": there are 0 to 1",
        ),
        (
            "/tree/children/0/bound/min/1",
            json!(2),
            "a box of lod-meta.json ends before it begins: [0.0, 2.0, 0.0] to [1.0, 1.0, 1.0]",
        ),
    ] {
        let mut changed = index();
        *changed.pointer_mut(place).unwrap() = value;
        assert_eq!(parsed(&changed.to_string()).err().as_deref(), Some(expected), "{place}");
    }
    for (place, value) in [
        ("/tree/children/1/lods/0/offset", json!(-1)),
        ("/tree/children/1/lods/0/count", json!(1.5)),
        ("/tree/children/0/bound/min", json!([0, null, 0])),
        ("/tree/children/0/errors", json!([null])),
        ("/filenames", json!("0_0")),
    ] {
        let mut changed = index();
        *changed.pointer_mut(place).unwrap() = value;
        assert!(
            parsed(&changed.to_string()).err().unwrap().starts_with("lod-meta.json: invalid "),
            "{place}"
        );
    }
    let deep = format!("{}{{}}{}", "{\"children\":[".repeat(100_000), "]}".repeat(100_000));
    let deep = format!("{{\"lodLevels\":1,\"filenames\":[],\"tree\":{deep}}}");
    let message = parsed(&deep).unwrap_err();
    assert!(message.starts_with("lod-meta.json: recursion limit exceeded at line 1"), "{message}");
    // What only lacks a use is left out: errors that are none, levels without splats.
    let mut odd = index();
    odd["tree"]["children"][0]["errors"] = json!([-1]);
    odd["tree"]["children"][0]["lods"]["1"] = json!({ "file": 1, "offset": 0, "count": 2 });
    odd["tree"]["children"][1]["lods"]["0"]["count"] = json!(0);
    let odd = parsed(&odd.to_string()).unwrap();
    assert_eq!(odd.leaves.len(), 1);
    assert!(odd.leaves[0].runs.iter().all(|run| run.error.is_none()));
}

#[test]
fn a_cut_or_damaged_index_is_read_or_refused() {
    let text = index().to_string();
    for length in 0..text.len() {
        assert!(parsed(&text[..length]).is_err(), "{length}");
    }
    // `parsed` holds each message to one line.
    damage(&text, 2000);
}

/// Reads an index with one to three of its bytes changed, `count` times.
fn damage(text: &str, count: u64) {
    let mut read = 0u64;
    for round in 0..count {
        let mut bytes = text.as_bytes().to_vec();
        let mut dice = Dice::new(round);
        let mut below = |most: usize| (dice.draw(0.0, most as f64) as usize).min(most - 1);
        for _ in 0..=below(3) {
            let (at, with) = (below(bytes.len()), b"0123456789-.eE{}[],:\"n\0 \xff"[below(25)]);
            bytes[at] = with;
        }
        let Ok(text) = String::from_utf8(bytes) else { continue };
        read += u64::from(parsed(&text).is_ok());
    }
    assert!(read > 0 && read < count, "{read} of {count}");
}

#[test]
#[ignore = "a million indices, by hand"]
fn a_million_damaged_indices_are_read_or_refused() {
    damage(&index().to_string(), 1_000_000);
}

#[test]
fn damaged_files_are_told() {
    let folder = tempdir().unwrap();
    let main = folder.path().join("lod-meta.json");
    let said = || {
        let message =
            LevelIndex::open(&main).unwrap().read_level(DetailLevel::Finest).unwrap_err().to_string();
        assert!(!message.contains(['\n', '\r']), "{message}");
        message.replace(&folder.path().display().to_string(), "DIR")
    };
    let file = |name: &str| folder.path().join("0_1").join(name);
    written(&main, leaves()).unwrap();
    // More splats than the file has: the index alone cannot tell.
    let text = fs::read_to_string(&main).unwrap();
    let last = LevelIndex::open(&main)
        .unwrap()
        .leaves
        .iter()
        .map(|leaf| leaf.runs[0])
        .find(|run| run.offset == 80)
        .unwrap();
    let run = format!("\"0\":{{\"file\":{},\"offset\":80,\"count\":40}}", last.file);
    assert!(text.contains(&run));
    fs::write(&main, text.replace(&run, &run.replace("40}", "41}"))).unwrap();
    let name = LevelIndex::open(&main).unwrap().files[last.file].clone();
    assert_eq!(
        said(),
        format!("DIR/{name}: SOG: a part of it has splats that it lacks; export the file again")
    );
    fs::write(&main, text).unwrap();
    let means = fs::read(file("means_u.webp")).unwrap();
    for length in [0, 11, means.len() / 2, means.len() - 1] {
        fs::write(file("means_u.webp"), &means[..length]).unwrap();
        let message = said();
        assert!(
            message.starts_with("DIR/0_1/meta.json: SOG: the picture \"means_u.webp\" is not a WebP"),
            "{message}"
        );
    }
    fs::write(file("means_u.webp"), means).unwrap();
    let meta = fs::read_to_string(file("meta.json")).unwrap();
    fs::write(file("meta.json"), meta.replace("\"count\":120", "\"count\":999999999999")).unwrap();
    assert_eq!(
        said(),
        "DIR/0_1/meta.json: SOG: the picture \"means_l.webp\" has 120 pixels, 999999999999 are needed; export the file again"
    );
    fs::remove_file(file("quats.webp")).unwrap();
    fs::write(file("meta.json"), meta).unwrap();
    assert!(said().starts_with("DIR/0_1/meta.json: SOG: \"quats.webp\" cannot be read"), "{}", said());
    fs::remove_file(file("meta.json")).unwrap();
    assert!(said().starts_with("DIR/0_1/meta.json: SOG: \"meta.json\" cannot be read"), "{}", said());
}

/// Checks a tile and those below it, whose axes are moved by `above`; gives the splats of tiles
/// that have none below, in the axes of the Earth.
fn walked(folder: &Path, tile: &Value, above: DMat4, error: f64) -> Vec<DVec3> {
    let transform = tile.get("transform").map_or(DMat4::IDENTITY, |v| {
        DMat4::from_cols_array(&serde_json::from_value::<[f64; 16]>(v.clone()).unwrap())
    });
    let here = above * transform;
    let own = tile["geometricError"].as_f64().unwrap();
    assert!(own < error || own == 0.0);
    let bounds: [f64; 12] = serde_json::from_value(tile["boundingVolume"]["box"].clone()).unwrap();
    let mut found = Vec::new();
    if let Some(uri) = tile.pointer("/content/uri") {
        let splats = Scene::open(folder.join(uri.as_str().unwrap())).unwrap().splats;
        for mean in &splats.means {
            // The axes of a PLY to those of glTF, y up, and then z up.
            let [x, y, z] = mean.map(f64::from);
            let local = [-x, -z, -y];
            assert!(
                (0..3).all(|k| (local[k] - bounds[k]).abs() <= bounds[3 + 4 * k] + 1e-3),
                "{local:?} {bounds:?}"
            );
            found.push(here.transform_point3(local.into()));
        }
    }
    match tile.get("children").and_then(Value::as_array) {
        None => found,
        Some(children) => children.iter().flat_map(|child| walked(folder, child, here, own)).collect(),
    }
}

#[test]
fn tiles_stand_where_the_scene_does() {
    let folder = tempdir().unwrap();
    let levels = folder.path().join("levels/lod-meta.json");
    written(&levels, leaves()).unwrap();
    let mut index = LevelIndex::open(&levels).unwrap();
    index.metadata.location = Some([0.0, 0.0]);
    index.metadata.up = Some(DVec3::NEG_Y);
    index.metadata.north = Some(DVec3::Z);
    index.metadata.ground = Some(4.0);
    let main = folder.path().join("tiles/tileset.json");
    let plan = TilePlan::new(&index, &main, 3).unwrap();
    assert_eq!(plan.notes().len(), 1);
    assert!(plan.write_tileset().is_err() && !main.exists());
    (0..plan.len()).rev().for_each(|tile| plan.write_tiles(tile..tile + 1).unwrap());
    plan.write_tileset().unwrap();
    let tileset: Value = serde_json::from_slice(&fs::read(&main).unwrap()).unwrap();
    let root = &tileset["root"];
    assert_eq!((&root["refine"], &root["children"][0]["refine"]), (&json!("ADD"), &json!("REPLACE")));
    // Seven leaves are three steps high, and there are three levels: the tile above all is empty.
    assert_eq!((plan.len(), root["children"][0].get("content")), (7 + 5 + 1, None));
    let mut found = walked(
        main.parent().unwrap(),
        root,
        DMat4::IDENTITY,
        tileset["geometricError"].as_f64().unwrap() + 1.0,
    );
    // At the equator of longitude 0 up is x, east y, north z; a unit is half a metre, and -y = 4 on
    // the ground.
    let middles = |k: usize| {
        let mut all: Vec<f64> =
            index.leaves.iter().map(|leaf| 0.5 * f64::from(leaf.low[k] + leaf.high[k])).collect();
        all.sort_by(f64::total_cmp);
        all[3]
    };
    let mut expected: Vec<DVec3> = Vec::new();
    for run in index.leaves.iter().map(|leaf| leaf.runs[0]) {
        let splats = index.read_file(run.file).unwrap().splats(run.offset, run.count).unwrap();
        let moved = |[x, y, z]: [f32; 3]| {
            let [x, y, z] = [x, y, z].map(f64::from);
            DVec3::new(6_378_137.0 + 0.5 * (-y - 4.0), 0.5 * (x - middles(0)), 0.5 * (z - middles(2)))
        };
        expected.extend(splats.means.into_iter().map(moved));
    }
    assert_eq!(found.len(), expected.len());
    let by_place = |a: &DVec3, b: &DVec3| a.y.total_cmp(&b.y);
    found.sort_by(by_place);
    expected.sort_by(by_place);
    let far = found.iter().zip(&expected).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
    assert!(far < 1e-3, "{far}");
}

/// Bundles hold what the folders do; one that is damaged is told in a line.
#[test]
fn bundles_stand_for_folders() {
    let folder = tempdir().unwrap();
    let [main, bundled] = ["a", "b"].map(|name| folder.path().join(name).join("lod-meta.json"));
    fs::create_dir(folder.path().join("a")).unwrap();
    written(&main, leaves()).unwrap();
    let index = LevelIndex::open(&main).unwrap();
    let expected = index.read_level(DetailLevel::Finest).unwrap();
    let to = folder.path().join("b");
    for name in index.files.iter().chain(&index.environment) {
        index.write_bundle(name, &to).unwrap();
    }
    index.write_bundled(&bundled).unwrap();
    let other = LevelIndex::open(&bundled).unwrap();
    assert!(other.files.iter().chain(&other.environment).all(|name| name.ends_with(".sog")));
    assert_eq!((&other.leaves, &other.metadata), (&index.leaves, &index.metadata));
    assert_eq!(other.read_level(DetailLevel::Finest).unwrap(), expected);
    // Bundles of bundles are the same.
    let again = folder.path().join("c");
    other.write_bundle(&other.files[0], &again).unwrap();
    assert_eq!(fs::read(again.join(&other.files[0])).unwrap(), fs::read(to.join(&other.files[0])).unwrap());

    let path = to.join(&other.files[0]);
    let whole = fs::read(&path).unwrap();
    for bad in [&whole[..whole.len() / 2], &whole[..9], &[]] {
        fs::write(&path, bad).unwrap();
        let message = other.read_level(DetailLevel::Finest).unwrap_err().to_string();
        assert!(message.starts_with(&path.display().to_string()) && !message.contains('\n'), "{message}");
    }
    fs::remove_file(main.with_file_name(&index.files[0]).with_file_name("quats.webp")).unwrap();
    let message = index.write_bundle(&index.files[0], &again).unwrap_err().to_string();
    assert!(message.contains("quats.webp"), "{message}");
    // Writing anew removes them.
    written(&bundled, leaves()).unwrap();
    assert!(!path.exists() && main.with_file_name("lod-meta.json").exists());
}
