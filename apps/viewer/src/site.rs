//! The scene of a static page: `place/place.json` of a site.

use crate::catalog::Catalog;
use crate::state::ViewState;
use crate::text::{one_line, shown};
use crate::view::View;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use wm_scene::survey::Survey;
use wm_scene::{Camera, Metadata};

/// The version of the files of a site that this program writes and reads.
pub const SITE_VERSION: u32 = 1;
/// Memory of a page for the splats of a scene in levels of detail where nobody says it: a module of
/// 32 bits has 4 GiB at most, and phones less.
pub const DEFAULT_MEMORY_BYTES: u64 = 1 << 30;
/// Longest text of a site's file, bytes: one with 10,000 photos has some 6 MB.
const MAX_TEXT: usize = 32 << 20;
/// Longest name of a file, bytes.
const MAX_NAME: usize = 200;
/// Files that the scene may be: one, or the index of one in levels of detail.
const SCENES: [&str; 2] = ["scene.sog", "lod-meta.json"];

/// The camera of a photo.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SiteView {
    /// The name of the photo.
    pub name: String,
    /// The camera.
    pub camera: Camera,
}

/// A file of a site that a page may fetch.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SiteAsset {
    /// The path below `place/`, such as `assets/shelter.wmasset`.
    pub name: String,
    /// The size, bytes.
    pub bytes: u64,
}

/// The scene of a static page: its facts, the initial view, and the files that belong to it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SiteFile {
    /// [`SITE_VERSION`].
    pub version: u32,
    /// The program that wrote it.
    pub program: String,
    /// The name of the scene, used in file names.
    pub name: String,
    /// The file of the scene below `place/`: `scene.sog`, or `lod-meta.json` in levels of detail.
    pub scene: String,
    /// The facts of the scene.
    pub metadata: Metadata,
    /// The cameras of the photos, all of them: they shape what lies.
    pub views: Vec<SiteView>,
    /// The initial state.
    pub start: ViewState,
    /// Near plane, scene units.
    pub near: f64,
    /// Command-line words of the scene.
    pub words: Vec<String>,
    /// The files below `place/` beside the scene.
    pub files: Vec<SiteAsset>,
    /// The digest of the scene that the files were made of, 32 bytes in hexadecimal digits.
    pub digest: String,
    /// Names of the presets that have a thumbnail, `thumbnails/NAME.jpg` below `place/`.
    pub thumbnails: Vec<String>,
    /// Number of splats of the scene.
    pub splats: u64,
    /// Memory for the splats of a scene in levels of detail, bytes; `null` for another scene.
    pub memory: Option<u64>,
}

impl SiteFile {
    /// Reads the text of a file.
    ///
    /// # Errors
    /// The text is too long or not of this form, of another version, or a value or a name is
    /// invalid, in one line.
    pub fn parse(text: &str) -> Result<Self, String> {
        #[derive(Deserialize)]
        struct Version {
            version: u32,
        }
        let fault = |why: &dyn std::fmt::Display| format!("place.json: {}", one_line(&why.to_string()));
        if text.len() > MAX_TEXT {
            return Err(fault(&format!("{} bytes are too many: the maximum is {MAX_TEXT}", text.len())));
        }
        // Another version may have other keys.
        let Version { version } = serde_json::from_str(text).map_err(|error| fault(&error))?;
        if version != SITE_VERSION {
            let why = format!(
                "version {version} is not {SITE_VERSION}, which this page reads; export the site again with one program"
            );
            return Err(fault(&why));
        }
        let site: Self = serde_json::from_str(text).map_err(|error| fault(&error))?;
        site.check().map_err(|why| fault(&why))?;
        Ok(site)
    }

    /// Returns the text of the file.
    ///
    /// # Errors
    /// A value that [`Self::parse`] would refuse.
    pub fn text(&self) -> Result<String, String> {
        self.check().map_err(|why| format!("place.json: {}", one_line(&why)))?;
        let text = serde_json::to_string(self).map_err(|error| format!("place.json: {error}"))?;
        Ok(text + "\n")
    }

    fn check(&self) -> Result<(), String> {
        if !SCENES.contains(&self.scene.as_str()) {
            return Err(format!("scene is `{}`: must be {}", shown(&self.scene), SCENES.join(" or ")));
        }
        if !(self.near.is_finite() && self.near > 0.0) {
            return Err(format!("near is {}: must be finite and above 0", self.near));
        }
        if self.digest.len() != 64 || !self.digest.bytes().all(|byte| byte.is_ascii_hexdigit()) {
            return Err(format!("digest is `{}`: must be 64 hexadecimal digits", shown(&self.digest)));
        }
        let mut names = BTreeSet::new();
        for SiteAsset { name, .. } in &self.files {
            check_name(name).map_err(|why| format!("files: `{}` {why}", shown(name)))?;
            if !names.insert(name) {
                return Err(format!("files: `{name}` is there twice"));
            }
        }
        for name in &self.thumbnails {
            let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
            if name.is_empty() || name.len() > MAX_NAME || !name.chars().all(is_plain) {
                return Err(format!("thumbnails: `{}` must be letters, digits and -_", shown(name)));
            }
        }
        for SiteView { name, camera } in &self.views {
            camera.check().map_err(|error| format!("views: `{}`: {error}", shown(name)))?;
        }
        Ok(())
    }

    /// Returns the catalog of the scene, whose survey is `survey`, for a page that renders by
    /// `renderer`, in words.
    ///
    /// # Errors
    /// The initial state makes no view, in one line.
    pub fn catalog(&self, survey: Survey, renderer: String) -> Result<Catalog, String> {
        let catalog = Catalog {
            stem: self.name.clone(),
            words: self.words.iter().map(Into::into).collect(),
            fact_words: Vec::new(),
            is_unsaved: false,
            run_words: Vec::new(),
            survey,
            near: self.near,
            splats: usize::try_from(self.splats).unwrap_or(usize::MAX),
            renderer,
            views: self.views.iter().map(|view| (view.name.clone(), view.camera)).collect(),
            weather: Default::default(),
            panoramas: Default::default(),
            has_video: false,
        };
        let start = View::new(self.start.clone(), &catalog, None);
        let start = start.map_err(|why| format!("place.json: start: {}", one_line(&why)))?;
        Ok(Catalog { weather: (*start.weather).clone(), ..catalog })
    }
}

/// Checks the path of a file below `place/`: letters, digits and `-_.` between slashes.
///
/// # Errors
/// The rule that it breaks, which follows its name.
fn check_name(name: &str) -> Result<(), &'static str> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    if name.len() > MAX_NAME {
        return Err("is too long");
    }
    let is_part = |part: &str| !part.is_empty() && !part.starts_with('.') && part.chars().all(is_plain);
    if !name.split('/').all(is_part) {
        return Err("must be a path below place/ of letters, digits and -_. between slashes");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;
    use serde_json::{Value, json};
    use wm_scene::Scene;

    fn site() -> SiteFile {
        let camera = testing::view().camera();
        SiteFile {
            version: SITE_VERSION,
            program: crate::PROGRAM.into(),
            name: "garden".into(),
            scene: SCENES[0].into(),
            metadata: Metadata { metres_per_unit: Some(0.1 + 0.2), ..Metadata::default() },
            views: vec![SiteView { name: "a photo.jpg".into(), camera }],
            start: testing::state(),
            near: 0.1,
            words: vec!["garden.ply".into()],
            files: vec![SiteAsset { name: "assets/0a1b.wmasset".into(), bytes: 12 }],
            digest: "0123456789abcdef".repeat(4),
            thumbnails: vec!["fog".into()],
            splats: 3,
            memory: None,
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let site = site();
        let text = site.text().unwrap();
        assert_eq!(SiteFile::parse(&text), Ok(site.clone()));
        let survey = Survey::of(&Scene::default(), &site.metadata);
        let catalog = site.catalog(survey, "cpu".into()).unwrap();
        assert_eq!(catalog.initial_state(&site.views[0].camera).weather, site.start.weather);
        assert_eq!((catalog.stem.as_str(), catalog.views.len(), catalog.splats), ("garden", 1, 3));
    }

    #[test]
    fn what_cannot_be_used_is_told_in_a_line() {
        let file = |name: &str| json!([{ "name": name, "bytes": 1 }]);
        for (key, value, expected) in [
            ("version", json!(2), "version 2 is not 1"),
            ("version", json!(-1), "invalid value"),
            ("colour", json!(1), "unknown field `colour`"),
            ("scene", json!("scene.ply"), "must be scene.sog or lod-meta.json"),
            ("near", json!(0), "near is 0"),
            ("digest", json!("00"), "64 hexadecimal digits"),
            ("files", file("../secret"), "must be a path below place/"),
            ("files", file("assets/../x"), "must be a path below place/"),
            ("files", file("/etc/passwd"), "must be a path below place/"),
            ("files", file(r"assets\x"), "must be a path below place/"),
            ("files", file("https://x.example/a"), "must be a path below place/"),
            ("files", file("a?b"), "must be a path below place/"),
            ("files", file("a%2e%2e"), "must be a path below place/"),
            ("files", file(""), "must be a path below place/"),
            ("files", file(&"a".repeat(300)), "is too long"),
            ("files", json!([{ "name": "a", "bytes": 1 }, { "name": "a", "bytes": 1 }]), "is there twice"),
            ("thumbnails", json!(["../fog"]), "thumbnails: `../fog`"),
            ("thumbnails", json!(["line\nbreak"]), "thumbnails: "),
            ("start", json!({ "tiem": 1 }), "unknown field `tiem`"),
        ] {
            let mut whole: Value = serde_json::from_str(&site().text().unwrap()).unwrap();
            whole[key] = value;
            let error = SiteFile::parse(&whole.to_string()).unwrap_err();
            assert!(error.starts_with("place.json: ") && error.contains(expected), "{key}: {error}");
            assert!(!error.contains('\n') && error.len() < 500, "{key}: {error}");
        }
        assert!(SiteFile::parse("{").is_err() && SiteFile::parse(&"[".repeat(100_000)).is_err());
        let mut site = site();
        site.start.time = f64::MAX;
        let survey = Survey::of(&Scene::default(), &site.metadata);
        assert!(site.catalog(survey, "cpu".into()).unwrap_err().starts_with("place.json: start: time"));
        site.files[0].name = "..".into();
        assert!(site.text().is_err());
    }
}
