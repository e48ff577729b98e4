//! Records of a log that cannot be used: refused, or left out and counted by what they are.
//!
//! Missing records are always left out, since recordings have gaps. Damaged records are refused, or
//! left out with [`super::LogOptions::skip_bad`]. Both are remarked on.

use super::files::{fault, folders_in, name_of, shown};
use glam::DVec3;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use wm_base::{FormatError, Problem};

/// Length, m, and speed, m/s, within which a vehicle goes from one of its poses to the next.
const MAX_STEP_M: f64 = 100.0;
const MAX_SPEED_M_S: f64 = 100.0;

/// Counts of what was left out.
pub(super) struct Records {
    skip_bad: bool,
    missing: BTreeMap<String, usize>,
    /// Number and first error, by kind.
    damaged: BTreeMap<&'static str, (usize, String)>,
}

impl Records {
    pub(super) fn new(skip_bad: bool) -> Self {
        Self { skip_bad, missing: BTreeMap::new(), damaged: BTreeMap::new() }
    }

    /// Counts records that are missing. `what` follows a number: "sweeps have no pose".
    pub(super) fn lost(&mut self, what: impl Into<String>, count: usize) {
        if count > 0 {
            *self.missing.entry(what.into()).or_default() += count;
        }
    }

    /// The value of a record; `None` if it is damaged and damaged ones are left out. `kind` is a
    /// plural, such as "sweeps".
    ///
    /// # Errors
    /// The record is damaged, and such are refused.
    pub(super) fn sound<T>(
        &mut self,
        kind: &'static str,
        record: Result<T, FormatError>,
    ) -> Result<Option<T>, FormatError> {
        match record {
            Ok(value) => Ok(Some(value)),
            Err(error) if self.skip_bad => {
                let (count, _) = self.damaged.entry(kind).or_insert_with(|| (0, error.to_string()));
                *count += 1;
                Ok(None)
            }
            Err(error) => {
                let problem = Problem::Value(format!("{} (--skip-bad goes on without it)", error.problem));
                Err(FormatError { problem, ..error })
            }
        }
    }

    /// The values of a file with one record per line, `None` for those that are missing, or damaged
    /// and left out.
    ///
    /// # Errors
    /// As [`Records::sound`].
    pub(super) fn sound_lines<T>(
        &mut self,
        kind: &'static str,
        lines: Vec<Option<Result<T, FormatError>>>,
    ) -> Result<Vec<Option<T>>, FormatError> {
        let sound = |line: Option<_>| line.map_or(Ok(None), |record| self.sound(kind, record));
        lines.into_iter().map(sound).collect()
    }

    /// Drops poses to which the vehicle cannot have come from the others. `place` gives the time,
    /// ns, and the position, m, of an entry.
    ///
    /// # Errors
    /// There is one, and such are refused.
    pub(super) fn without_jumps<T>(
        &mut self,
        path: &Path,
        mut poses: Vec<T>,
        place: impl Fn(&T) -> (i64, DVec3),
    ) -> Result<Vec<T>, FormatError> {
        poses.sort_by_key(|pose| place(pose).0);
        let places: Vec<(i64, DVec3)> = poses.iter().map(&place).collect();
        let kept = reachable(&places);
        let mut sound = Vec::with_capacity(poses.len());
        for ((pose, (time, position)), kept) in poses.into_iter().zip(places).zip(kept) {
            let jump = || {
                let [x, y, z] = position.to_array().map(f64::round);
                let seconds = time as f64 * 1e-9;
                fault(path, format!("the vehicle jumps to {x}, {y}, {z} m and back at {seconds:.3} s"))
            };
            let record = if kept { Ok(pose) } else { Err(jump()) };
            sound.extend(self.sound("poses", record)?);
        }
        Ok(sound)
    }

    /// Warnings of what was left out.
    pub(super) fn warnings(self) -> impl Iterator<Item = String> {
        let missing =
            self.missing.into_iter().map(|(what, count)| format!("{count} {what}; they are left out"));
        let damaged = self
            .damaged
            .into_iter()
            .map(|(kind, (count, first))| format!("{count} damaged {kind} are left out; the first: {first}"));
        missing.chain(damaged)
    }
}

/// For each place of a vehicle, in the order of time: true if it can be reached from the longest
/// run without a jump.
fn reachable(places: &[(i64, DVec3)]) -> Vec<bool> {
    let is_step = |a: usize, b: usize| {
        let ((from, start), (to, end)) = (places[a], places[b]);
        start.distance(end) <= MAX_STEP_M + MAX_SPEED_M_S * 1e-9 * from.abs_diff(to) as f64
    };
    let (mut longest, mut start) = (0..0, 0);
    for index in 0..places.len() {
        if index > 0 && !is_step(index - 1, index) {
            start = index;
        }
        if index + 1 - start > longest.len() {
            longest = start..index + 1;
        }
    }
    let mut kept = vec![false; places.len()];
    kept[longest.clone()].fill(true);
    let mut last = longest.end.saturating_sub(1);
    for (index, is_kept) in kept.iter_mut().enumerate().skip(longest.end) {
        *is_kept = is_step(last, index);
        last = if *is_kept { index } else { last };
    }
    let mut first = longest.start;
    for index in (0..longest.start).rev() {
        kept[index] = is_step(first, index);
        first = if kept[index] { index } else { first };
    }
    kept
}

/// A log among several in one folder.
pub(super) struct Candidate<T> {
    pub(crate) name: String,
    pub(crate) value: T,
    /// The files that are missing for it to be read, in words.
    pub(crate) lacks: Option<String>,
}

/// A log in a folder, and what was passed over, in words.
pub(super) type ChosenLog<T> = (T, Option<String>);

/// A folder if it is a log, or the folders in it that are.
pub(super) fn logs_in(source: &Path, is_log: impl Fn(&Path) -> bool) -> Vec<PathBuf> {
    if is_log(source) {
        return vec![source.to_owned()];
    }
    folders_in(source).into_iter().filter(|folder| is_log(folder)).collect()
}

/// The log in one of the folders. `lacks` says what a log lacks to be read. `None` if there is
/// none.
///
/// # Errors
/// As [`choose`].
pub(super) fn choose_folder(
    source: &Path,
    plural: &str,
    options: &LogOptions,
    folders: Vec<PathBuf>,
    lacks: impl Fn(&Path) -> Option<String>,
) -> Result<Option<ChosenLog<PathBuf>>, FormatError> {
    if folders.is_empty() {
        return Ok(None);
    }
    let candidate =
        |folder: PathBuf| Candidate { name: whole_name(&folder), lacks: lacks(&folder), value: folder };
    let candidates = folders.into_iter().map(candidate).collect();
    choose(source, plural, candidates, options.scene.as_deref()).map(Some)
}

/// The name of a folder, which may be given as a dot.
pub(super) fn whole_name(folder: &Path) -> String {
    name_of(&std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned()))
}

/// True if a log of this name is meant: by all of it, by its number, or by that of a drive of
/// KITTI.
fn is_meant(name: &str, asked: &str) -> bool {
    let number = |text: &str| text.parse::<u64>().ok();
    let is_number = number(asked).is_some() && number(asked) == number(name);
    name == asked || is_number || name.contains(&format!("_drive_{asked}_"))
}

/// Chooses the log that is asked for, or the first whole one. `plural` is what they are, such as
/// "drives".
///
/// # Errors
/// There is none, none of that name, or none is whole.
pub(super) fn choose<T>(
    source: &Path,
    plural: &str,
    candidates: Vec<Candidate<T>>,
    asked: Option<&str>,
) -> Result<ChosenLog<T>, FormatError> {
    let count = candidates.len();
    let names = |whole: bool| {
        shown(candidates.iter().filter(|own| !whole || own.lacks.is_none()).map(|own| own.name.clone()))
    };
    let (known, whole) = (names(false), names(true));
    let passed = shown(candidates.iter().take_while(|own| own.lacks.is_some()).filter_map(|own| {
        let lacks = own.lacks.as_ref()?;
        Some(format!("{} ({lacks})", own.name))
    }));
    if let Some(asked) = asked {
        let Some(found) = candidates.into_iter().find(|own| is_meant(&own.name, asked)) else {
            return Err(fault(
                source,
                format!("there is no {asked:?} among its {plural}; there are {known}"),
            ));
        };
        return match found.lacks {
            Some(lacks) => {
                let others = match whole.as_str() {
                    "" => String::new(),
                    _ => format!("; of its {plural} these are whole: {whole}"),
                };
                Err(fault(source, format!("{}: {lacks}; unpack what is missing{others}", found.name)))
            }
            None => Ok((found.value, None)),
        };
    }
    if count > 0 && whole.is_empty() {
        return Err(fault(
            source,
            format!("none of its {plural} is whole: {passed}; unpack what is missing"),
        ));
    }
    let first = candidates.into_iter().find(|own| own.lacks.is_none());
    let first = first.ok_or_else(|| fault(source, format!("there are no {plural} in it")))?;
    let name = &first.name;
    let note = match (count, passed.is_empty()) {
        (1, _) => None,
        (_, true) => Some(format!("{name} is read, the first of {count} {plural}: {known}")),
        (_, false) => Some(format!(
            "{name} is read, the first of {count} {plural} whose files are there; passed over: {passed}"
        )),
    };
    Ok((first.value, note.map(|note| format!("{note}; --log-scene names another"))))
}

/// The part of a log that is read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogOptions {
    /// The log among several in a folder: a scene, a drive or a sequence. The first whose files are
    /// there, if nothing is said.
    pub scene: Option<String>,
    /// The cameras, by the names that the log gives them; empty for those that take colour pictures
    /// of the scene.
    pub cameras: Vec<String>,
    /// Step between pictures of each camera that are taken; 0 for as few as
    /// [`LogOptions::most_pictures`] asks for.
    pub stride: usize,
    /// Seconds of the log that are read, from its start; all of it if nothing is said.
    pub seconds: Option<u32>,
    /// Most pictures, over all cameras, where `stride` is 0.
    pub most_pictures: usize,
    /// True to go on without records that are damaged; they are refused otherwise. What is missing
    /// is always left out.
    pub skip_bad: bool,
}

impl Default for LogOptions {
    fn default() -> Self {
        Self {
            scene: None,
            cameras: Vec::new(),
            stride: 0,
            seconds: None,
            most_pictures: 600,
            skip_bad: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_that_cannot_be_reached_are_found() {
        let second = 1_000_000_000;
        let drive = |far: &[usize]| -> Vec<(i64, DVec3)> {
            let at = |k: usize| DVec3::X * if far.contains(&k) { 5e6 } else { 12.0 * k as f64 };
            (0..9).map(|k| (second * k as i64, at(k))).collect()
        };
        for far in [&[][..], &[0], &[8], &[3, 4], &[0, 1, 5, 8]] {
            let kept = reachable(&drive(far));
            let left: Vec<usize> = (0..9).filter(|k| !kept[*k]).collect();
            assert_eq!(left, far);
        }
        assert!(reachable(&[]).is_empty());
    }
}
