//! The facts of the scene that the page's tool changes: up, the ground, the scale, lamps, and the
//! sun of the photos.
//!
//! Changes act on the pictures at once. They become those of the scene only when the page asks for
//! it, as `align --overwrite` writes them. Until then they are kept in a journal beside the scene,
//! so that they outlast the program, however it ends.
//!
//! A change happens between two frames: `Renderer::align` surveys the place anew and drops its
//! assets, the thread that makes assets is stopped, and the catalog that clients are checked with
//! is replaced as a whole.

use super::words::survey_words;
use crate::commands::align::LAMP_BEAM_DEG;
use crate::names::with_behind;
use crate::scene::count_of;
use glam::DVec3;
use serde::Deserialize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::SystemTime;
use weather_magician::formats::folder::scene_file;
use weather_magician::formats::{sidecar, sidecar_path, write_sidecar};
use weather_magician::{Error, Metadata, PlaceFacts, PreparedPlace, Renderer, Scene};
use wm_base::FormatError;
use wm_scene::survey::{Aligned, Alignment, GivenGround, GivenScale, OwnSky, UpSide};
use wm_scene::{Lamp, LitWindow, PhotoSun};
use wm_viewer::state::check_point;

/// A change that a client asks for. Points are in scene units.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(tag = "action", rename_all = "lowercase", deny_unknown_fields)]
pub(crate) enum FactChange {
    /// Sets up and the ground by three points of the ground.
    Ground {
        /// The points.
        points: [DVec3; 3],
    },
    /// Sets the scale by the distance of two points.
    Scale {
        /// The points.
        points: [DVec3; 2],
        /// Their distance, m.
        metres: f64,
    },
    /// Turns up round.
    Flip {},
    /// Puts a lamp at a point; a point of the ground gets one on a post.
    Lamp {
        /// The point.
        point: DVec3,
    },
    /// Lights a window between two opposite corners.
    Window {
        /// The corners.
        points: [DVec3; 2],
        /// The eye that sees them, outside of the wall.
        eye: DVec3,
    },
    /// Takes all lamps and lit windows away.
    Dark {},
    /// Sets the sun of the photos by a point and the end of its shadow.
    Sun {
        /// The point, then the end of its shadow.
        points: [DVec3; 2],
    },
    /// No sun cast shadows in the photos.
    Clouds {},
    /// Returns to the facts that were last saved, or that the program started with.
    Undo {},
    /// Writes the facts beside the scene.
    Save {},
}

impl FactChange {
    /// Checks the values that can be checked without the scene.
    fn check(self) -> Result<(), FactError> {
        let points = match &self {
            Self::Ground { points } => &points[..],
            Self::Scale { points, .. } | Self::Window { points, .. } | Self::Sun { points } => &points[..],
            Self::Lamp { point } => std::slice::from_ref(point),
            Self::Flip {} | Self::Dark {} | Self::Clouds {} | Self::Undo {} | Self::Save {} => &[],
        };
        let eye = if let Self::Window { eye, .. } = &self { Some(eye) } else { None };
        let mut points = points.iter().chain(eye);
        points
            .try_for_each(|point| check_point("facts: point", point.to_array()))
            .map_err(FactError::Refused)?;
        if let Self::Scale { points: [a, b], metres } = self {
            let scale = metres / a.distance(b);
            // What is no scale at all is told by the alignment.
            if scale > 0.0 && scale.is_finite() && !Metadata::SCALE_RANGE.contains(&scale) {
                let (least, most) = (Metadata::SCALE_RANGE.start(), Metadata::SCALE_RANGE.end());
                return Err(FactError::Refused(format!(
                    "{scale:e} metres a unit: a scale is {least:e} to {most:e}; check the points and the metres"
                )));
            }
        }
        Ok(())
    }
}

/// The reason why a change was not made, in one line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum FactError {
    /// The values cannot be used.
    Refused(String),
    /// It is not possible now.
    Busy(String),
    /// The program failed.
    Failed(String),
}

impl From<Error> for FactError {
    fn from(error: Error) -> Self {
        match error {
            Error::Align(error) => Self::Refused(error.to_string()),
            other => Self::Failed(other.to_string()),
        }
    }
}

/// The facts that are saved, and the way to change those in use.
pub(crate) struct FactEditor {
    scene: PathBuf,
    sky: OwnSky,
    saved: PlaceFacts,
    saved_words: Vec<String>,
    is_unsaved: bool,
    /// True once it was told that the journal cannot be written.
    is_warned: bool,
}

impl FactEditor {
    /// Returns the editor of a place as it was opened from the path `scene`, with the command-line
    /// words of its facts.
    pub(crate) fn new(scene: PathBuf, sky: OwnSky, place: &PreparedPlace, words: Vec<String>) -> Self {
        Self { scene, sky, saved: place.facts(), saved_words: words, is_unsaved: false, is_warned: false }
    }

    /// True if the facts in use differ from those that are saved.
    pub(crate) fn is_unsaved(&self) -> bool {
        self.is_unsaved
    }

    /// Returns the command-line words of the facts in use.
    pub(crate) fn words(&self, place: &PreparedPlace) -> Vec<String> {
        if self.is_unsaved { survey_words(place.survey()) } else { self.saved_words.clone() }
    }

    /// Takes the facts that were changed and not saved when the last viewer of the scene ended, if
    /// there are any, and says so.
    pub(crate) fn restore(&mut self, renderer: &mut Renderer, place: &mut PreparedPlace) {
        let Ok(file) = scene_file(&self.scene) else { return };
        let journal = journal_of(&file);
        let path = sidecar_path(&journal);
        let Some(written) = modified(&path) else { return };
        let shown = path.display();
        let is_old = [&file, &sidecar_path(&file)].into_iter().any(|path| modified(path) > Some(written));
        if is_old {
            eprintln!(
                "note: {shown}: these facts were not saved, and are older than the scene: they are not used"
            );
            return;
        }
        let metadata = match sidecar::read(&journal) {
            Ok(metadata) => metadata.unwrap_or_default(),
            Err(error) => return eprintln!("warning: {error}; it is not used"),
        };
        let before = place.facts();
        let mut scene = Scene { metadata, ..Scene::default() };
        scene.set_origin(scene.metadata.origin_or_zero() + place.scene().moved_by);
        let mut facts = PlaceFacts { scene: scene.metadata, given: Metadata::default() };
        if self.sky != OwnSky::Keep {
            facts.scene.airlight = before.scene.airlight;
        }
        // The program may have ended because of these facts.
        let renewed = catch_unwind(AssertUnwindSafe(|| renderer.set_facts(place, facts)));
        if matches!(renewed, Ok(Ok(()))) {
            self.is_unsaved = true;
            eprintln!(
                "note: the facts that were not saved last time are in use again ({shown}): Align on the page saves or undoes them"
            );
        } else {
            eprintln!("warning: {shown}: these facts, which were not saved, cannot be used");
            let _ = renderer.set_facts(place, before);
        }
    }

    /// Makes a change, keeps it in the journal, and says in a sentence what it did.
    ///
    /// # Errors
    /// [`FactError`]; the facts are as they were then.
    pub(crate) fn apply(
        &mut self,
        renderer: &mut Renderer,
        place: &mut PreparedPlace,
        change: FactChange,
    ) -> Result<String, FactError> {
        change.check()?;
        let text = self.change(renderer, place, change)?;
        self.keep(place);
        Ok(text)
    }

    /// Writes the journal, or removes it if all is saved.
    fn keep(&mut self, place: &PreparedPlace) {
        let outcome = scene_file(&self.scene).and_then(|file| {
            let journal = journal_of(&file);
            if self.is_unsaved {
                return write_sidecar(&journal, &self.metadata(place));
            }
            let path = sidecar_path(&journal);
            match std::fs::remove_file(&path) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                    Err(FormatError::reading(&path, error))
                }
                _ => Ok(()),
            }
        });
        if let Err(error) = outcome
            && !std::mem::replace(&mut self.is_warned, true)
        {
            eprintln!("warning: {error}; changed facts that are not saved are lost when the viewer ends");
        }
    }

    /// Returns the facts in use as they belong beside the scene.
    fn metadata(&self, place: &PreparedPlace) -> Metadata {
        let PlaceFacts { scene, mut given } = place.facts();
        // The height that was given is that in the world.
        given.ground = given.ground.map(|_| place.survey().ground.value);
        let facts = given.or(scene);
        // The light of a sky that the file does not have would be wrong in it.
        let airlight = facts.airlight.filter(|_| self.sky == OwnSky::Keep);
        place.scene().metadata_beside_file(Metadata { airlight, ..facts })
    }

    fn change(
        &mut self,
        renderer: &mut Renderer,
        place: &mut PreparedPlace,
        change: FactChange,
    ) -> Result<String, FactError> {
        let none = Alignment::default();
        let text = match change {
            FactChange::Ground { points } => {
                let aligned = renderer
                    .align(place, &Alignment { ground: Some(GivenGround::Points(points)), ..none })?;
                let side = match aligned.side {
                    Some(UpSide::Cameras) => ", to the side of the cameras",
                    Some(UpSide::Splats) => ", to the side where most of the scene is",
                    Some(UpSide::Before) | None => "",
                };
                let text = format!("The ground is set. Up turned by {:.1}°{side}.", aligned.turned);
                with_old_sky(text, &aligned)
            }
            FactChange::Scale { points: [a, b], metres } => {
                let scale = GivenScale::Distance(a, b, metres);
                let aligned = renderer.align(place, &Alignment { scale: Some(scale), ..none })?;
                format!("1 unit of the scene is {:.4} m.", aligned.after.metres_per_unit.value)
            }
            FactChange::Flip {} => with_old_sky(
                "Up is turned round.".into(),
                &renderer.align(place, &Alignment { flip: true, ..none })?,
            ),
            FactChange::Lamp { point } => {
                let lamp = lamp_at(place, point);
                set_lights(renderer, place, |lamps, _| lamps.push(lamp))?
            }
            FactChange::Window { points, eye } => {
                let window = LitWindow::between(points, DVec3::from_array(place.site().up), eye);
                let window = window.ok_or_else(|| {
                    FactError::Refused("the corners of a window must not be level or above each other".into())
                })?;
                set_lights(renderer, place, |_, windows| windows.push(window))?
            }
            FactChange::Dark {} => set_lights(renderer, place, |lamps, windows| {
                lamps.clear();
                windows.clear();
            })?,
            FactChange::Sun { points: [top, end] } => {
                let up = DVec3::from_array(place.site().up);
                match PhotoSun::of_shadow(top, end) {
                    Some(sun @ PhotoSun::Towards(towards)) if towards.dot(up) > 0.0 => {
                        set_sun(renderer, place, sun)?;
                        let height = towards.dot(up).asin().to_degrees();
                        format!("The sun of the photos was {height:.0}° high.")
                    }
                    _ => {
                        let why = "the shadow ends above what casts it: click the top first";
                        return Err(FactError::Refused(why.into()));
                    }
                }
            }
            FactChange::Clouds {} => {
                set_sun(renderer, place, PhotoSun::Diffuse)?;
                "The photos have no shadows of a sun.".into()
            }
            FactChange::Undo {} => {
                let Metadata { lamps, windows, .. } = self.saved.scene.clone();
                let (lamps, windows) = (lamps.unwrap_or_default(), windows.unwrap_or_default());
                renderer.set_lamps(place, lamps, windows)?;
                if place.facts() != self.saved {
                    renderer.set_facts(place, self.saved.clone())?;
                }
                self.is_unsaved = false;
                return Ok("The facts are those of the file again.".into());
            }
            FactChange::Save {} => return self.save(place),
        };
        self.is_unsaved = true;
        Ok(text)
    }

    fn save(&mut self, place: &PreparedPlace) -> Result<String, FactError> {
        if !self.is_unsaved {
            return Ok("There is nothing to save.".into());
        }
        let failed = |error: FormatError| FactError::Failed(error.to_string());
        let file = scene_file(&self.scene).map_err(failed)?;
        write_sidecar(&file, &self.metadata(place)).map_err(failed)?;
        (self.saved, self.saved_words, self.is_unsaved) = (place.facts(), Vec::new(), false);
        let name = sidecar_path(&file);
        let name = name.file_name().unwrap_or_default().to_string_lossy();
        Ok(format!("Saved as {name}, beside the scene."))
    }
}

/// Returns the path beside which the journal of a scene lies, as metadata lie beside a scene.
fn journal_of(file: &Path) -> PathBuf {
    with_behind(file, ".unsaved")
}

fn modified(path: &Path) -> Option<SystemTime> {
    std::fs::metadata(path).and_then(|metadata| metadata.modified()).ok()
}

/// Height above the ground of a lamp that is put on the ground, and the height up to which a point
/// counts as that.
const NEW_LAMP_HEIGHT_M: f64 = 5.0;
const MAX_GROUND_HEIGHT_M: f64 = 1.5;

/// Returns the lamp that is put at a point.
fn lamp_at(place: &PreparedPlace, point: DVec3) -> Lamp {
    let site = place.site();
    let up = DVec3::from_array(site.up);
    let height = (up.dot(point) - site.ground) * site.metres_per_unit;
    let rise = if height < MAX_GROUND_HEIGHT_M { NEW_LAMP_HEIGHT_M } else { 0.0 };
    let at = point + up * (rise / site.metres_per_unit);
    Lamp { aim: Some((-up).to_array()), beam: LAMP_BEAM_DEG, ..Lamp::new(at.to_array()) }
}

/// Changes the lamps and lit windows of a place; says how many there are then.
fn set_lights(
    renderer: &mut Renderer,
    place: &mut PreparedPlace,
    change: impl FnOnce(&mut Vec<Lamp>, &mut Vec<LitWindow>),
) -> Result<String, FactError> {
    let Metadata { lamps, windows, .. } = &place.scene().metadata;
    let mut lamps = lamps.clone().unwrap_or_default();
    let mut windows = windows.clone().unwrap_or_default();
    change(&mut lamps, &mut windows);
    let text = format!("{} and {}.", count_of(lamps.len(), "lamp"), count_of(windows.len(), "lit window"));
    // A fault that the user can mend.
    let outcome = renderer.set_lamps(place, lamps, windows);
    outcome.map_err(|error| FactError::Refused(error.to_string()))?;
    Ok(text)
}

/// Sets the sun of the photos.
fn set_sun(renderer: &mut Renderer, place: &mut PreparedPlace, sun: PhotoSun) -> Result<(), FactError> {
    let mut facts = place.facts();
    facts.scene.sun = Some(sun);
    Ok(renderer.set_facts(place, facts)?)
}

/// Adds a warning to the text of a change if the scene's own sky was made for another up.
fn with_old_sky(text: String, aligned: &Aligned) -> String {
    if !aligned.has_old_sky() {
        return text;
    }
    text + " The scene's own sky was made for another up: after saving, start again with --sky rebuild if it looks wrong."
}
