//! A part of a data set that one training learns, while other trainings learn the others.

use super::error::SessionError;
use crate::brightness::{NamedGains, PhotoGains};
use crate::dataset::Dataset;
use crate::haze::PhotoHaze;
use crate::photos::Photos;
use crate::priors::points::{has_tracks, inside};
use std::collections::HashSet;
use wm_capture::{Capture, Observation};
use wm_scene::SparsePoints;
use wm_scene::{Group, Splats};

/// A part of a data set, and the values that its training shares with those of the other parts:
/// brightness, haze and sky, which would differ if each part estimated its own.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainPart {
    /// Names of the photos to learn from.
    pub(crate) photos: Vec<String>,
    /// Names of the photos to measure on.
    pub(crate) held_out: Vec<String>,
    /// The gains of the photos relative to all of the data set; `None` if the points do not
    /// determine them.
    pub(crate) gains: Option<NamedGains>,
    /// The haze of all photos, and their gains in it.
    pub(crate) haze: Option<(PhotoHaze, NamedGains)>,
    /// Splats of the sky, which do not learn; none without a sky.
    pub(crate) sky: Splats,
}

impl TrainPart {
    /// Returns the capture with the photos of this part alone, and with the points that its
    /// training photos show.
    pub(super) fn capture(&self, whole: &Capture) -> Result<Capture, SessionError> {
        let known: HashSet<&str> = whole.views.iter().map(|view| view.name.as_str()).collect();
        let names = || self.photos.iter().chain(&self.held_out);
        if let Some(photo) = names().find(|name| !known.contains(name.as_str())) {
            return Err(SessionError::NoSuchPhoto { dataset: whole.source.clone(), photo: photo.clone() });
        }
        let own: HashSet<&str> = names().map(String::as_str).collect();
        let taught: HashSet<&str> = self.photos.iter().map(String::as_str).collect();
        Ok(capture_of(whole, |name| own.contains(name), |name| taught.contains(name)))
    }

    /// Returns the indices in `photos` of those that are held out, and of the others.
    pub(super) fn split(&self, capture: &Capture, photos: &Photos) -> (Vec<usize>, Vec<usize>) {
        let held_out: HashSet<&str> = self.held_out.iter().map(String::as_str).collect();
        let name = |place: usize| capture.views[photos.view(place)].name.as_str();
        (0..photos.len()).partition(|place| held_out.contains(name(*place)))
    }

    /// Returns the haze, and the gains of the training photos in their order.
    pub(super) fn haze_of(&self, set: &Dataset) -> Option<(PhotoHaze, PhotoGains)> {
        let (haze, gains) = self.haze.as_ref()?;
        Some((*haze, gains.of(set.places.iter().map(|place| set.name(*place)))))
    }

    /// Adds the sky.
    pub(super) fn add_sky(&self, splats: &mut Splats) {
        if !self.sky.is_empty() {
            let mut sky = self.sky.clone();
            sky.groups.fill(Group::Sky);
            splats.append(&sky);
        }
    }
}

/// Returns the capture with the views that `is_kept` keeps by their names, and with the points that
/// those of them show that `is_taught` names too.
pub(super) fn capture_of(
    whole: &Capture,
    is_kept: impl Fn(&str) -> bool,
    is_taught: impl Fn(&str) -> bool,
) -> Capture {
    let kept: Vec<usize> = (0..whole.views.len()).filter(|view| is_kept(&whole.views[*view].name)).collect();
    let taught: Vec<usize> =
        kept.iter().copied().filter(|view| is_taught(&whole.views[*view].name)).collect();
    let mut is_shown = vec![false; whole.points.len()];
    if has_tracks(whole) {
        let seen = taught.iter().flat_map(|view| &whole.observations[*view]);
        seen.for_each(|seen| is_shown[seen.point as usize] = true);
    } else {
        for (point, is_shown) in is_shown.iter_mut().enumerate() {
            *is_shown =
                taught.iter().any(|view| inside(whole, &whole.views[*view].camera, point as u32).is_some());
        }
    }
    let mut points = SparsePoints::default();
    let mut places = vec![u32::MAX; is_shown.len()];
    for point in (0..is_shown.len()).filter(|point| is_shown[*point]) {
        places[point] = points.len() as u32;
        let from = &whole.points;
        points.push(from.positions[point], from.colors[point], from.errors[point], from.track_lengths[point]);
    }
    let observed = |view: &usize| -> Vec<Observation> {
        let own = whole.observations[*view].iter();
        let moved = own.map(|seen| Observation { point: places[seen.point as usize], ..*seen });
        moved.filter(|seen| seen.point != u32::MAX).collect()
    };
    Capture {
        observations: kept.iter().map(observed).collect(),
        views: kept.iter().map(|view| whole.views[*view].clone()).collect(),
        points,
        source: whole.source.clone(),
        images: whole.images.clone(),
        origin: whole.origin,
        remarks: Vec::new(),
    }
}
