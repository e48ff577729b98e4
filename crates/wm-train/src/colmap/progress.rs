//! Reads the progress of a command from its output.
//!
//! The wording differs between versions, so that little of it is relied on: a count in brackets, or
//! the number of photos whose cameras are found. Where nothing is understood there is no progress,
//! and nothing else is lost.

/// One of the four commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColmapStep {
    /// Finds features in each photo.
    Features,
    /// Finds them again in other photos.
    Matches,
    /// Finds cameras and points.
    Cameras,
    /// Makes photos without distortion.
    Undistortion,
}

impl ColmapStep {
    /// Returns the name of the step for people, such as "matching photos".
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Features => "finding features",
            Self::Matches => "matching photos",
            Self::Cameras => "finding cameras",
            Self::Undistortion => "undistorting photos",
        }
    }
}

/// The progress of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ColmapProgress {
    /// The step.
    pub step: ColmapStep,
    /// Photos (or blocks of them) that are done.
    pub done: usize,
    /// The number of items in all, once that is known.
    pub total: Option<usize>,
}

/// Progress that a line of output tells.
pub(super) fn of(step: ColmapStep, line: &str, photos: usize) -> Option<ColmapProgress> {
    let (done, total) = match step {
        ColmapStep::Features => bracketed(line.split("Processed file").nth(1)?)?,
        ColmapStep::Matches => {
            bracketed(line.split_once("ing block").or_else(|| line.split_once("ing image"))?.1)?
        }
        ColmapStep::Cameras => {
            // "Registering image #12 (35)" or "(num_reg_frames=35)": the 35th.
            let rest = line.split("Registering image").nth(1)?;
            let digits = |c: char| c.is_ascii_digit();
            let counted = rest.rsplit_once('(')?.1;
            let number: String =
                counted.chars().skip_while(|c| !digits(*c)).take_while(|c| digits(*c)).collect();
            (number.parse().ok()?, photos)
        }
        ColmapStep::Undistortion => bracketed(line.split("Undistorting image").nth(1)?)?,
    };
    (total > 0 && done <= total).then_some(ColmapProgress { step, done, total: Some(total) })
}

/// The counts of `[3/45]`, and of `[2/4, 3/5]`, which is 8 of 20.
fn bracketed(text: &str) -> Option<(usize, usize)> {
    let inner = text.split_once('[')?.1.split_once(']')?.0;
    let (mut done, mut total) = (0usize, 1usize);
    for part in inner.split(',') {
        let (at, of) = part.split_once('/')?;
        let (at, of): (usize, usize) = (at.trim().parse().ok()?, of.trim().parse().ok()?);
        done = done.checked_mul(of)?.checked_add(at.checked_sub(1)?)?;
        total = total.checked_mul(of)?;
    }
    Some((done + 1, total))
}

/// Lines of what arrives in pieces.
#[derive(Default)]
pub(super) struct Lines {
    /// The start of a line that has not ended.
    begun: Vec<u8>,
    last_error: Option<String>,
}

impl Lines {
    /// The lines that end in `bytes`.
    pub(crate) fn take(&mut self, bytes: &[u8]) -> impl Iterator<Item = String> {
        let mut lines = Vec::new();
        for byte in bytes {
            if *byte == b'\n' || *byte == b'\r' {
                let line = String::from_utf8_lossy(&self.begun).trim().to_owned();
                self.begun.clear();
                if is_error(&line) {
                    self.last_error = Some(line.clone());
                }
                lines.push(line);
            } else if self.begun.len() < 4096 {
                self.begun.push(*byte);
            }
        }
        lines.into_iter()
    }

    /// The last line that speaks of an error, shortened.
    pub(crate) fn last_error(&self) -> Option<String> {
        let line = self.last_error.as_ref()?;
        Some(line.chars().filter(|c| !c.is_control()).take(200).collect())
    }
}

/// Returns true for an error line: glog's begin with E or F and the date; older versions write
/// ERROR.
fn is_error(line: &str) -> bool {
    let mut start = line.chars();
    let is_logged =
        matches!(start.next(), Some('E' | 'F')) && start.take(4).filter(char::is_ascii_digit).count() == 4;
    is_logged || line.contains("ERROR") || line.contains("Error:") || line.contains("error:")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_many_versions_are_understood() {
        let progress = |step, line: &str| of(step, line, 50).map(|p| (p.done, p.total.unwrap()));
        assert_eq!(progress(ColmapStep::Features, "Processed file [12/345]"), Some((12, 345)));
        let logged = "I20241107 16:06:57.981905  2136 feature_extraction.cc:258] Processed file [1/301]";
        assert_eq!(progress(ColmapStep::Features, logged), Some((1, 301)));
        assert_eq!(progress(ColmapStep::Features, "  Features:        3114"), None);
        assert_eq!(progress(ColmapStep::Matches, "Matching block [1/1, 1/1] in 0.5s"), Some((1, 1)));
        assert_eq!(progress(ColmapStep::Matches, "I2 x.cc:1] Processing block [2/4, 3/5]"), Some((8, 20)));
        assert_eq!(progress(ColmapStep::Matches, "Matching image [3/29] in 0.1s"), Some((3, 29)));
        assert_eq!(progress(ColmapStep::Cameras, "Registering image #12 (35)"), Some((35, 50)));
        assert_eq!(
            progress(ColmapStep::Cameras, "I2 a.cc:3] Registering image #12 (num_reg_frames=7)"),
            Some((7, 50))
        );
        assert_eq!(progress(ColmapStep::Cameras, "Registering image #12 (99)"), None);
        assert_eq!(progress(ColmapStep::Undistortion, "Undistorting image [3/45]"), Some((3, 45)));
        for odd in
            ["Processed file [", "Processed file [0/3]", "Processed file [3/x]", "Processed file 3/4]", ""]
        {
            assert_eq!(progress(ColmapStep::Features, odd), None, "{odd}");
        }
        assert_eq!(
            progress(ColmapStep::Matches, &format!("Matching block [{0}/{0}, {0}/{0}]", usize::MAX)),
            None
        );
    }

    #[test]
    fn lines_come_in_pieces() {
        let mut lines = Lines::default();
        assert_eq!(lines.take(b"one\ntw").collect::<Vec<_>>(), ["one"]);
        assert_eq!(lines.take(b"o\r\nE0714 12:48:36 no\x07 such option\nbye\n").count(), 4);
        assert_eq!(lines.last_error().unwrap(), "E0714 12:48:36 no such option");
    }
}
