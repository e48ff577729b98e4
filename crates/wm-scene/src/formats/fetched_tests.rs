//! Reading scenes from files that were fetched into memory.

use super::{ReadOptions, read_scene, write_scene};
use crate::Scene;
use crate::levels::{INDEX_NAME, LevelIndex};
use std::io::ErrorKind::NotFound;
use std::path::{Path, PathBuf};
use wm_base::files::fetched::{MAX_WANTED, ROOT, files_below, insert, keep_within, remove, take_wanted};
use wm_base::files::{is_folder, is_there as exists, read, read_if_there, want};

/// The only test that takes what is wanted, since there is one list.
#[test]
fn scenes_are_read_of_what_was_fetched() {
    let folder = tempfile::tempdir().unwrap();
    let splats = {
        let mut place = crate::synthetic::Builder::new(7);
        place.ball(glam::DVec3::ZERO, 1.0, 0.2, [0.5; 3]);
        place.build()
    };
    let scene = Scene { splats, ..Scene::default() };
    write_scene(&folder.path().join("a.sog"), &scene).unwrap();
    write_scene(&folder.path().join("b/meta.json"), &scene).unwrap();
    let root = Path::new(ROOT).join("reading");
    let (bundle, dir) = (root.join("a.sog"), root.join("./b"));
    let options = ReadOptions::default();
    let error = read_scene(&bundle, &options).unwrap_err().to_string();
    assert!(error.ends_with("reading/a.sog: no such file or folder; check the path"), "{error}");
    assert_eq!(take_wanted(), std::slice::from_ref(&bundle));
    let fetch = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    insert(&bundle, fetch("a.sog"));
    let expected = read_scene(&folder.path().join("a.sog"), &options).unwrap();
    assert_eq!(read_scene(&bundle, &options).unwrap(), expected);
    assert_eq!(LevelIndex::of_scene(&bundle).unwrap().map(|_| ()), None);
    // Metadata and cameras that are not beside it are not wanted.
    assert_eq!(take_wanted(), [] as [PathBuf; 0]);

    for file in std::fs::read_dir(folder.path().join("b")).unwrap() {
        let name = file.unwrap().file_name().into_string().unwrap();
        insert(&dir.join(&name), fetch(&format!("b/{name}")));
    }
    assert!(is_folder(&dir).unwrap() && !is_folder(&bundle).unwrap());
    assert_eq!(read_scene(&dir, &options).unwrap(), expected);
    // What is cut or damaged is named in a line.
    for (name, at) in [("a.sog", 1000), ("b/means_l.webp", 20), ("b/meta.json", 40)] {
        let path = root.join(name);
        let whole = read(&path).unwrap();
        let mut flipped = whole.clone();
        flipped[at] ^= 0xff;
        for bad in [whole[..whole.len() / 2].to_vec(), flipped, Vec::new()] {
            insert(&path, bad);
            let error = read_scene(if name == "a.sog" { &bundle } else { &dir }, &options);
            let error = error.unwrap_err().to_string();
            assert!(!error.contains('\n') && error.starts_with(ROOT), "{error}");
        }
        insert(&path, whole);
    }
    assert!(LevelIndex::open(&root.join(INDEX_NAME)).is_err());
    assert_eq!(take_wanted(), [root.join(INDEX_NAME)]);
    for path in files_below(&root) {
        remove(&path);
    }
    assert!(keep_within(0, &[]) && !exists(&dir));
    assert_eq!(read_if_there(&bundle).unwrap(), None);
    assert_eq!(read(&bundle).unwrap_err().kind(), NotFound);
    (0..MAX_WANTED + 9).for_each(|number| want(&root.join(number.to_string())));
    assert_eq!(take_wanted().len(), MAX_WANTED);
}
