//! Captures of other programs that are not read, by the names of their files, and how to convert
//! them.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use wm_base::{FormatError, Problem};

/// A format that is known and not read.
struct Foreign {
    /// Name with its article.
    name: &'static str,
    /// Names of files or folders that all are there, lower case; `*.sfm` is any file that ends so.
    files: &'static [&'static str],
    /// A text at the beginning of the first of them, lower case; empty where the name is enough.
    begins: &'static str,
    advice: &'static str,
}

const fn named(name: &'static str, files: &'static [&'static str], advice: &'static str) -> Foreign {
    Foreign { name, files, begins: "", advice }
}

const CONVERT_ADVICE: &str =
    "convert it to a COLMAP model or a transforms.json with the poses of its cameras";

const RECORD3D_ADVICE: &str = "convert it with `ns-process-data record3d` of nerfstudio";

const FOREIGN: [Foreign; 27] = [
    named("an export of Record3D", &["rgbd", "metadata.json"], RECORD3D_ADVICE),
    named(
        "an export of Record3D",
        &["exr_rgbd"],
        "give its folder to `ns-process-data record3d` of nerfstudio",
    ),
    named("an export of Record3D", &["rgb", "depth", "metadata.json"], RECORD3D_ADVICE),
    named(
        "a capture of Record3D",
        &["*.r3d"],
        "export it and convert it with `ns-process-data record3d` of nerfstudio",
    ),
    named("a scan of ScanNet", &["*.sens"], CONVERT_ADVICE),
    named("a scan of ScanNet", &["color", "pose", "intrinsic"], CONVERT_ADVICE),
    named("a scene of NSVF", &["rgb", "pose", "intrinsics.txt"], CONVERT_ADVICE),
    named("a scan of ARKitScenes", &["lowres_wide.traj"], CONVERT_ADVICE),
    named("a sequence of TUM RGB-D", &["groundtruth.txt", "rgb.txt"], CONVERT_ADVICE),
    named("a project of Metashape", &["*.psx"], "export the cameras as COLMAP or Bundler"),
    Foreign {
        name: "the cameras of Metashape",
        files: &["*.xml"],
        begins: "<document",
        advice: "export the cameras as COLMAP or Bundler, or convert them with `ns-process-data metashape` of nerfstudio",
    },
    Foreign {
        name: "a block of ContextCapture",
        files: &["*.xml"],
        begins: "<blocksexchange",
        advice: "export it as COLMAP or Bundler",
    },
    Foreign {
        name: "the cameras of RealityCapture",
        files: &["*.csv"],
        begins: "#name,x,y,",
        advice: "export them as COLMAP or Bundler, or convert them with `ns-process-data realitycapture` of nerfstudio",
    },
    named("a project of RealityCapture", &["*.rcproj"], "export the registration as COLMAP or Bundler"),
    named("a model of VisualSFM", &["*.nvm"], "save it as Bundler's bundle.out with its list.txt"),
    named(
        "a scene of OpenMVS",
        &["*.mvs"],
        "give the model that it was made from, or export it with its InterfaceCOLMAP",
    ),
    named("a reconstruction of OpenMVG", &["sfm_data.json"], "export it with `openMVG_main_openMVG2Colmap`"),
    named("a reconstruction of OpenMVG", &["sfm_data.bin"], "export it with `openMVG_main_openMVG2Colmap`"),
    named("a reconstruction of Meshroom (AliceVision)", &["*.sfm"], "export it with its node ExportColmap"),
    named("a project of Meshroom", &["*.mg"], "export it with its node ExportColmap"),
    named("a capture of kapture", &["sensors", "sensors.txt"], "export it with `kapture_export_colmap.py`"),
    named(
        "a data set of kapture",
        &["sensors", "reconstruction"],
        "export it with `kapture_export_colmap.py`",
    ),
    named("a capture of LLFF", &["poses_bounds.npy"], "give the COLMAP model that its poses were made from"),
    named("a data set of Mega-NeRF", &["coordinates.pt"], CONVERT_ADVICE),
    named("a data set of NeuS", &["cameras_sphere.npz"], CONVERT_ADVICE),
    named("a project of Pix4D", &["*calibrated_camera_parameters.txt"], "export it as Bundler"),
    named("an archive", &["*.zip"], "unpack it and give its folder"),
];

/// The error of a folder or file that is no capture that can be read: it says what it is and what
/// to do.
pub(super) fn refusal(dataset: &Path) -> FormatError {
    let fault = |what: String| FormatError::value(dataset, what);
    let (folder, names) = if dataset.is_dir() {
        (dataset, names_in(dataset))
    } else {
        let name = dataset.file_name().unwrap_or_default().to_string_lossy().into_owned();
        (dataset.parent().unwrap_or(Path::new("")), vec![name])
    };
    let known = FOREIGN.iter().filter(|one| one.name != "an archive" || !dataset.is_dir());
    for foreign in known {
        let is_there = foreign.files.iter().all(|pattern| matching(&names, pattern).next().is_some());
        let begins =
            || matching(&names, foreign.files[0]).any(|name| begins_with(&folder.join(name), foreign.begins));
        if is_there && (foreign.begins.is_empty() || begins()) {
            return fault(format!("{}, which is not read; {}", foreign.name, foreign.advice));
        }
    }
    if !dataset.is_dir() {
        return fault(
            "a file of no capture that is known; give the folder of a COLMAP model, a transforms.json, a \
             reconstruction.json, a bundle.out, or photos"
                .into(),
        );
    }
    match model_below(dataset) {
        Some(model) => fault(format!(
            "no capture in the folder itself, but a COLMAP model in {}; name it with --model, or give a folder above it",
            model.display()
        )),
        None => FormatError::whole(dataset, Problem::NoCapture),
    }
}

/// The names that are `pattern`, or end as it does after `*`, ignoring case.
fn matching<'a>(names: &'a [String], pattern: &'static str) -> impl Iterator<Item = &'a String> {
    names.iter().filter(move |name| {
        let name = name.to_lowercase();
        pattern.strip_prefix('*').map_or(name == pattern, |ending| name.ends_with(ending))
    })
}

/// The names of files and folders in a folder, sorted.
fn names_in(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> =
        entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Returns true if a text is near the beginning of a file, ignoring case.
fn begins_with(path: &Path, text: &str) -> bool {
    const SNIFFED_BYTES: u64 = 512;
    let mut start = Vec::new();
    let read = File::open(path).and_then(|file| file.take(SNIFFED_BYTES).read_to_end(&mut start));
    read.is_ok() && String::from_utf8_lossy(&start).to_lowercase().contains(text)
}

/// The first folder at most three levels below that has a COLMAP model, relative to `dataset`.
pub(super) fn model_below(dataset: &Path) -> Option<PathBuf> {
    /// Folders that are looked into.
    const MAX_FOLDERS: usize = 1000;
    let mut level = vec![PathBuf::new()];
    let mut looked = 0;
    for _ in 0..3 {
        let mut next = Vec::new();
        for place in level {
            looked += 1;
            for name in names_in(&dataset.join(&place)) {
                let folder = place.join(name);
                let whole = dataset.join(&folder);
                // A run folder has the model that the program made itself.
                let is_run = folder.extension().is_some_and(|extension| extension == "run");
                if whole.is_dir() && !is_run && looked < MAX_FOLDERS {
                    let has = |kind: &str| {
                        ["cameras", "images"]
                            .iter()
                            .all(|part| whole.join(format!("{part}.{kind}")).is_file())
                    };
                    if has("bin") || has("txt") {
                        return Some(folder);
                    }
                    next.push(folder);
                }
            }
        }
        level = next;
    }
    None
}

#[cfg(test)]
mod tests {
    use crate::{CaptureOptions, read};
    use std::fs;
    use tempfile::tempdir;

    #[test]
    fn captures_of_other_programs_are_named() {
        for (file, text, says) in [
            ("model.NVM", "NVM_V3", "a model of VisualSFM, which is not read; save it as Bundler's"),
            ("scene.mvs", "", "a scene of OpenMVS"),
            ("cameras.sfm", "{}", "a reconstruction of Meshroom"),
            ("sfm_data.json", "{}", "a reconstruction of OpenMVG"),
            ("poses_bounds.npy", "", "a capture of LLFF"),
            (
                "cameras.xml",
                "<?xml version=\"1.0\"?>\n<document version=\"2.0\">",
                "the cameras of Metashape",
            ),
            ("block.xml", "<BlocksExchange>", "a block of ContextCapture"),
            ("poses.csv", "#name,x,y,alt,heading\n", "the cameras of RealityCapture"),
            ("notes.csv", "a,b\n", "no COLMAP model, transforms.json"),
            ("ba_output/cameras.txt", "", "but a COLMAP model in"),
        ] {
            let folder = tempdir().unwrap();
            let path = folder.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(&path, text).unwrap();
            fs::write(path.with_file_name("images.txt"), "").unwrap();
            let say = |path| read(path, &CaptureOptions::default()).unwrap_err().to_string();
            if !file.contains('/') {
                fs::remove_file(folder.path().join("images.txt")).unwrap();
            }
            let message = say(folder.path());
            assert!(message.contains(says) && !message.contains('\n'), "{file}: {message}");
            if file.ends_with("NVM") {
                assert!(say(&path).contains(says));
            }
        }
        let folder = tempdir().unwrap();
        fs::write(folder.path().join("notes.md"), "").unwrap();
        let message =
            read(&folder.path().join("notes.md"), &CaptureOptions::default()).unwrap_err().to_string();
        assert!(message.contains("a file of no capture that is known; give the folder"), "{message}");
    }
}
