use super::*;
use std::{
    os::unix::fs::PermissionsExt,
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
};
use tempfile::{TempDir, tempdir};
use wm_scene::capture::{self, CaptureOptions};

/// Stands in for COLMAP: writes its arguments to `calls`, says what the real one says, and copies a
/// model of three photos. `$1` is the command; `BREAK` in the folder of the photos names one that fails.
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
  exhaustive_matcher|sequential_matcher) echo "Matching block [1/1, 1/1]";;
  mapper) echo "Registering image #2 (3)"; [ -f "$images/EMPTY" ] || cp -r "$here/model/." "$output";;
  image_undistorter)
    [ -f "$images/SLOW" ] && exec sleep 60
    mkdir -p "$output/images" "$output/sparse"; cp "$images"/*.png "$output/images"; cp "$input"/* "$output/sparse"
    echo "Undistorting image [3/3]";;
esac
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
        let photos = folder.path().join("my photos");
        fs::create_dir(&photos).unwrap();
        for name in ["a.png", "b.png", "c.png"] {
            let mut encoder = png::Encoder::new(File::create(photos.join(name)).unwrap(), 4, 3);
            encoder.set_color(png::ColorType::Grayscale);
            encoder.write_header().unwrap().write_image_data(&[9; 12]).unwrap();
        }
        for (model, count) in [("0", 1u64), ("1", 3)] {
            let model = folder.path().join("model").join(model);
            fs::create_dir_all(&model).unwrap();
            let mut cameras = 1u64.to_le_bytes().to_vec();
            cameras.extend([1u32, 1].iter().flat_map(|v| v.to_le_bytes()));
            cameras.extend([4u64, 3].iter().flat_map(|v| v.to_le_bytes()));
            cameras.extend([4.0f64, 4.0, 2.0, 1.5].iter().flat_map(|v| v.to_le_bytes()));
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
        ColmapOptions { program: Some(self.folder.path().join("colmap")), ..ColmapOptions::default() }
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
        let message = self.run(&self.options()).unwrap_err().to_string();
        assert!(!message.contains('\n'), "{message}");
        message.replace(&self.folder.path().display().to_string(), "DIR")
    }
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
    for (step, total) in [
        (ColmapStep::Features, 3),
        (ColmapStep::Matches, 1),
        (ColmapStep::Cameras, 3),
        (ColmapStep::Undistortion, 3),
    ] {
        assert!(told.contains(&ColmapProgress { step, done: total, total: Some(total) }), "{told:?}");
    }
    let capture = capture::read(&made.dataset, &CaptureOptions::default()).unwrap();
    assert_eq!(capture.views.len(), 3);
    assert!(capture.photo(0).is_some());
    let log = fs::read_to_string(run.join(LOG)).unwrap();
    assert!(
        log.contains("\n$ ") && log.contains("Processed file [3/3]") && log.contains("Undistorting image")
    );
}

#[test]
fn newer_versions_and_other_wishes() {
    let place = Place::new("FeatureExtraction");
    let options =
        ColmapOptions { matching: Matching::Sequential, device: ColmapDevice::Gpu, ..place.options() };
    place.run(&options).unwrap();
    let calls = place.calls();
    assert!(calls[0].ends_with("--FeatureExtraction.use_gpu 1"), "{}", calls[0]);
    assert_eq!(
        calls[1],
        "sequential_matcher --database_path DIR/run/database.db --FeatureMatching.use_gpu 1"
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
    fs::remove_file(place.folder.path().join("run").join(LOG)).unwrap();
    assert_eq!(place.say(), "DIR/run: it is there already and no run of COLMAP; choose another folder");
    fs::remove_file(place.photos().join("a.png")).unwrap();
    fs::write(place.photos().join("d.heic"), "x").unwrap();
    assert_eq!(place.say(), "DIR/my photos: 2 photos (JPEG or PNG) and 1 other files, at least 3 are needed");
    let nowhere = ColmapOptions { program: Some("/nowhere/colmap".into()), ..ColmapOptions::default() };
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
