use super::*;
use crate::photos::encode_png;
use std::{
    os::unix::fs::PermissionsExt,
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};
use tempfile::{TempDir, tempdir};
use wm_capture::{self as capture, CaptureOptions};

/// Stands in for COLMAP: writes its arguments to `calls`, says what the real one says, and copies a
/// model of three photos. `$1` is the command; `BREAK` in the folder of the photos names one that
/// fails.
const FAKE: &str = r#"#!/bin/sh
here=$(dirname "$0")
if [ "$2" = "-h" ]; then echo "  --HELP_OPTION.use_gpu arg (=1)"; exit 1; fi
echo "$@" >> "$here/calls"
command=$1; shift
while [ $# -gt 1 ]; do
  case "$1" in
    --image_path) images=$2;; --output_path) output=$2;; --input_path) input=$2;; --database_path) database=$2;;
  esac
  shift 2
done
if [ -f "$images/BREAK" ] && [ "$(cat "$images/BREAK")" = "$command" ]; then
  echo "E0714 12:48:36.849566 1 option_manager.cc:923] it broke"; exit 3
fi
case "$command" in
  feature_extractor) touch "$database"; echo "Processed file [1/3]"; echo "Processed file [3/3]" >&2;;
  exhaustive_matcher|sequential_matcher) cp "$here/colmap.db" "$database"; echo "Matching block [1/1, 1/1]";;
  mapper) echo "Registering image #2 (3)"; [ -f "$images/EMPTY" ] || cp -r "$here/model/." "$output";;
  image_undistorter)
    [ -f "$images/SLOW" ] && exec sleep 60
    mkdir -p "$output/images" "$output/sparse"; cp "$images"/*.png "$output/images"; cp "$input"/* "$output/sparse"
    echo "Undistorting image [3/3]";;
esac
"#;

/// Stands in for a Python with pycolmap, as [`FAKE`] does for COLMAP.
const FAKE_PYTHON: &str = r#"#!/bin/sh
grep -q "^import pycolmap" "$1" || exit 9
shift
exec "$(dirname "$0")/colmap" "$@"
"#;

/// One place at a time: a program cannot be started while it is open for writing, and a child that
/// another thread starts meanwhile holds it open for a moment.
static ALONE: Mutex<()> = Mutex::new(());

struct Place {
    folder: TempDir,
    _alone: MutexGuard<'static, ()>,
}

impl Place {
    fn new(help: &str) -> Self {
        let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = tempdir().unwrap();
        let program = folder.path().join("colmap");
        fs::write(&program, FAKE.replace("HELP_OPTION", help)).unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        let python = folder.path().join("python3");
        fs::write(&python, FAKE_PYTHON).unwrap();
        fs::set_permissions(&python, fs::Permissions::from_mode(0o755)).unwrap();
        let database = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/colmap.db");
        fs::copy(database, folder.path().join("colmap.db")).unwrap();
        let photos = folder.path().join("my photos");
        fs::create_dir(&photos).unwrap();
        for name in ["a.png", "b.png", "c.png"] {
            write_photo(&photos.join(name), 40, 30);
        }
        for (model, count) in [("0", 1u64), ("1", 3)] {
            let model = folder.path().join("model").join(model);
            fs::create_dir_all(&model).unwrap();
            let mut cameras = 1u64.to_le_bytes().to_vec();
            cameras.extend([1u32, 1].iter().flat_map(|v| v.to_le_bytes()));
            cameras.extend([40u64, 30].iter().flat_map(|v| v.to_le_bytes()));
            cameras.extend([40.0f64, 40.0, 20.0, 15.0].iter().flat_map(|v| v.to_le_bytes()));
            fs::write(model.join("cameras.bin"), cameras).unwrap();
            let mut images = count.to_le_bytes().to_vec();
            for (index, name) in ["a.png", "b.png", "c.png"].iter().take(count as usize).enumerate() {
                images.extend((index as u32 + 1).to_le_bytes());
                images.extend([1.0f64, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0].iter().flat_map(|v| v.to_le_bytes()));
                images.extend(1u32.to_le_bytes());
                images.extend(name.as_bytes());
                images.extend([0; 9]);
            }
            fs::write(model.join("images.bin"), images).unwrap();
            fs::write(model.join("points3D.bin"), 0u64.to_le_bytes()).unwrap();
        }
        Self { folder, _alone }
    }

    fn photos(&self) -> PathBuf {
        self.folder.path().join("my photos")
    }

    fn options(&self) -> ColmapOptions {
        let tool = CameraTool::Colmap(self.folder.path().join("colmap"));
        ColmapOptions { tool: Some(tool), ..ColmapOptions::default() }
    }

    fn with_python(&self) -> ColmapOptions {
        let tool = CameraTool::Pycolmap(self.folder.path().join("python3"));
        ColmapOptions { tool: Some(tool), ..ColmapOptions::default() }
    }

    fn run(&self, options: &ColmapOptions) -> Result<Reconstruction, ColmapError> {
        reconstruct(&self.photos(), &self.folder.path().join("run"), options, &mut |_| (), &|| false)
    }

    fn calls(&self) -> Vec<String> {
        let folder = self.folder.path().display().to_string();
        let calls = fs::read_to_string(self.folder.path().join("calls")).unwrap();
        calls.lines().map(|line| line.replace(&folder, "DIR")).collect()
    }

    fn say(&self) -> String {
        self.say_with(&self.options())
    }

    fn say_with(&self, options: &ColmapOptions) -> String {
        let message = self.run(options).unwrap_err().to_string();
        assert!(!message.contains('\n'), "{message}");
        message.replace(&self.folder.path().display().to_string(), "DIR")
    }
}

/// Each of the four steps says that all is done.
fn assert_steps(told: &[ColmapProgress]) {
    for (step, total) in [
        (ColmapStep::Features, 3),
        (ColmapStep::Matches, 1),
        (ColmapStep::Cameras, 3),
        (ColmapStep::Undistortion, 3),
    ] {
        assert!(told.contains(&ColmapProgress { step, done: total, total: Some(total) }), "{told:?}");
    }
}

fn write_photo(path: &Path, width: u32, height: u32) {
    let pixels = vec![9; (width * height) as usize];
    fs::write(path, encode_png(width, height, png::ColorType::Grayscale, &pixels)).unwrap();
}

#[test]
fn the_four_commands_make_a_capture() {
    let place = Place::new("SiftExtraction");
    let mut told = Vec::new();
    let run = place.folder.path().join("run");
    let made =
        reconstruct(&place.photos(), &run, &place.options(), &mut |p| told.push(p), &|| false).unwrap();
    assert_eq!((made.photos, made.registered), (3, 3));
    assert_eq!(
        place.calls(),
        [
            "feature_extractor --database_path DIR/run/database.db --image_path DIR/my photos \
             --ImageReader.camera_model OPENCV --ImageReader.single_camera 1 --SiftExtraction.use_gpu 0",
            "exhaustive_matcher --database_path DIR/run/database.db --SiftMatching.use_gpu 0",
            "mapper --database_path DIR/run/database.db --image_path DIR/my photos --output_path DIR/run/models",
            "image_undistorter --image_path DIR/my photos --input_path DIR/run/models/1 --output_path \
             DIR/run/dataset --output_type COLMAP",
        ]
    );
    assert_steps(&told);
    let capture = capture::read(&made.dataset, &CaptureOptions::default()).unwrap();
    assert_eq!(capture.views.len(), 3);
    assert!(capture.photo(0).is_some());
    let log = fs::read_to_string(run.join(LOG_FILE)).unwrap();
    assert!(
        log.contains("\n$ ") && log.contains("Processed file [3/3]") && log.contains("Undistorting image")
    );
}

#[test]
fn pycolmap_makes_the_same_capture() {
    let place = Place::new("SiftExtraction");
    let mut told = Vec::new();
    let run = place.folder.path().join("run");
    let mut progress = |progress| told.push(progress);
    let made = reconstruct(&place.photos(), &run, &place.with_python(), &mut progress, &|| false).unwrap();
    assert_eq!((made.photos, made.registered), (3, 3));
    // The script knows the commands of COLMAP.
    assert_eq!(
        place.calls(),
        [
            "feature_extractor --database_path DIR/run/database.db --image_path DIR/my photos \
             --ImageReader.camera_model OPENCV --ImageReader.single_camera 1 --FeatureExtraction.use_gpu 0",
            "exhaustive_matcher --database_path DIR/run/database.db --FeatureMatching.use_gpu 0",
            "mapper --database_path DIR/run/database.db --image_path DIR/my photos --output_path DIR/run/models",
            "image_undistorter --image_path DIR/my photos --input_path DIR/run/models/1 --output_path \
             DIR/run/dataset --output_type COLMAP",
        ]
    );
    assert_steps(&told);
    // The photos of the database that are not in the model, with those that they share most with.
    let missing: Vec<String> = made.unregistered.iter().map(ToString::to_string).collect();
    assert_eq!(missing.len(), 40);
    let photo = |number: u32| format!("folder of photos/{number:03}.jpg");
    assert_eq!(
        (missing[1].clone(), missing[39].clone()),
        (
            format!("{} shares 42 points with {} and 35 points with {}", photo(2), photo(4), photo(3)),
            format!("{} shares 5 points with {}", photo(40), photo(39))
        )
    );

    // A whole capture of the same photos is taken as it is; other photos make another.
    assert_eq!(place.run(&place.with_python()).unwrap(), made);
    assert_eq!(place.calls().len(), 4);
    write_photo(&place.photos().join("b.png"), 40, 31);
    place.run(&place.with_python()).unwrap();
    assert_eq!(
        place.calls()[4],
        "feature_extractor --database_path DIR/run/database.db --image_path DIR/my photos \
         --ImageReader.camera_model OPENCV --ImageReader.single_camera 0 --FeatureExtraction.use_gpu 0"
    );

    fs::write(place.photos().join("EMPTY"), "").unwrap();
    write_photo(&place.photos().join("b.png"), 40, 32);
    let said = place.say_with(&place.with_python());
    let shared = format!("{} and {} share the most, 525 points", photo(37), photo(38));
    assert!(said.ends_with(&format!("({shared}; its log is DIR/run/colmap.log)")), "{said}");
    write_photo(&place.photos().join("b.png"), 2, 2);
    assert_eq!(
        place.say_with(&place.with_python()),
        "DIR/my photos/b.png: 2x2 px is too small to find its camera; give a larger photo, or remove it"
    );
}

/// With the pycolmap of this machine, if there is one: photos of nothing, of which no camera can be
/// found.
#[test]
fn the_pycolmap_that_is_installed_is_understood() {
    let python = ["python3", "python"].iter().find_map(|name| on_path(name));
    let imports = |python: &PathBuf| {
        let mut command = std::process::Command::new(python);
        command.args(["-c", "import pycolmap"]).output().is_ok_and(|output| output.status.success())
    };
    let Some(python) = python.filter(imports) else {
        eprintln!("skipped: python3 cannot import pycolmap");
        return;
    };
    let place = Place::new("SiftExtraction");
    for name in ["a.png", "b.png", "c.png"] {
        write_photo(&place.photos().join(name), 120, 90);
    }
    let options = ColmapOptions { tool: Some(CameraTool::Pycolmap(python)), ..ColmapOptions::default() };
    let mut told = Vec::new();
    let run = place.folder.path().join("run");
    let error = reconstruct(&place.photos(), &run, &options, &mut |p| told.push(p), &|| false).unwrap_err();
    let log = fs::read_to_string(run.join(LOG_FILE)).unwrap();
    assert!(matches!(error, ColmapError::NothingRegistered { .. }), "{error}: {log}");
    let features = ColmapProgress { step: ColmapStep::Features, done: 3, total: Some(3) };
    assert!(told.contains(&features), "{told:?}: {log}");
}

#[test]
fn newer_versions_and_other_wishes() {
    let place = Place::new("FeatureExtraction");
    let options = ColmapOptions { matching: Matching::Sequential, ..place.options() };
    place.run(&options).unwrap();
    let calls = place.calls();
    assert!(calls[0].ends_with("--FeatureExtraction.use_gpu 0"), "{}", calls[0]);
    assert_eq!(
        calls[1],
        "sequential_matcher --database_path DIR/run/database.db --FeatureMatching.use_gpu 0"
    );
}

#[test]
fn failures_say_what_and_where() {
    let place = Place::new("SiftExtraction");
    fs::write(place.photos().join("BREAK"), "mapper").unwrap();
    assert_eq!(
        place.say(),
        "COLMAP failed while finding cameras (exit status: 3: E0714 12:48:36.849566 1 option_manager.cc:923] it \
         broke); all it said is in DIR/run/colmap.log"
    );
    fs::remove_file(place.photos().join("BREAK")).unwrap();
    fs::write(place.photos().join("EMPTY"), "").unwrap();
    assert!(place.say().starts_with("COLMAP found no cameras: the photos share too little"));
    fs::remove_file(place.photos().join("EMPTY")).unwrap();
    // What an earlier run left behind is no hindrance, what is not its own is.
    place.run(&place.options()).unwrap();
    for name in [LOG_FILE, DONE_FILE] {
        fs::remove_file(place.folder.path().join("run").join(name)).unwrap();
    }
    assert_eq!(place.say(), "DIR/run: it is there already and no run of COLMAP; choose another folder");
    fs::remove_file(place.photos().join("a.png")).unwrap();
    fs::write(place.photos().join("d.heic"), "x").unwrap();
    assert_eq!(place.say(), "DIR/my photos: 2 photos (JPEG or PNG) and 1 other files, at least 3 are needed");
    let tool = Some(CameraTool::Colmap("/nowhere/colmap".into()));
    let nowhere = ColmapOptions { tool, ..ColmapOptions::default() };
    drop(place);
    let place = Place::new("SiftExtraction");
    let message = place.run(&nowhere).unwrap_err().to_string();
    assert!(message.starts_with("/nowhere/colmap: cannot be started: "), "{message}");
    assert!(ColmapError::NotInstalled.to_string().contains("install"));
}

#[test]
fn a_run_that_is_stopped_leaves_no_command_behind() {
    let place = Place::new("SiftExtraction");
    fs::write(place.photos().join("SLOW"), "").unwrap();
    let is_last = AtomicBool::new(false);
    let mut watch = |p: ColmapProgress| is_last.store(p.step == ColmapStep::Undistortion, Ordering::Relaxed);
    let start = std::time::Instant::now();
    let run = place.folder.path().join("run");
    let stopped = reconstruct(&place.photos(), &run, &place.options(), &mut watch, &|| {
        is_last.load(Ordering::Relaxed) && start.elapsed() > Duration::from_millis(200)
    });
    assert!(
        matches!(stopped, Err(ColmapError::Stopped { step: ColmapStep::Undistortion, .. })),
        "{stopped:?}"
    );
    assert!(start.elapsed() < Duration::from_secs(30));
    // Started again, it goes on: the database is still there.
    assert!(run.join("database.db").is_file());
}
