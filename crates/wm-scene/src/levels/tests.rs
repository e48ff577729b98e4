//! Scenes in levels, written and read.

use super::{LevelFileJob, LevelIndex, LevelWriteOptions, LevelWriter, NewLeaf};
use crate::{FormatError, Metadata, Rasterization, Splats, formats::DetailLevel, morton, testing::Dice};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};
use tempfile::tempdir;

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

/// Leaves on a row, of 40, 20 and 10 splats; the fourth has one level, the fifth lacks the middle one.
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
    let options = LevelWriteOptions { splats_per_file: 100, rasterization: Some(Rasterization::Antialiased) };
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
        (
            refused(&|leaf| leaf.levels[1].means[3][0] = f32::NAN),
            "splat 3 has numbers that are not finite; repair the scene",
        ),
        (refused(&|leaf| leaf.levels.resize(65, Splats::default())), "65 levels; 64 are the most"),
    ] {
        assert_eq!(message, format!("not written: leaf 0: {expected}"));
    }
    let empty = said(writer.finish(None, &Metadata::default()).err().unwrap());
    assert_eq!(empty, "there are no splats in it; nothing can be shown");
}
