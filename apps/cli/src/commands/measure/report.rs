//! The results of `measure`, from which its tables and its page are made.

use crate::commands::bench::paper::SpeedTable;
use weather_magician::measure::{Finding, Instrument, Reading};

/// Results of one instrument.
pub(super) struct InstrumentSection {
    pub(super) instrument: &'static Instrument,
    pub(super) findings: Vec<Finding>,
}

impl InstrumentSection {
    /// Returns the readings, in order.
    pub(super) fn readings(&self) -> impl Iterator<Item = &Reading> {
        self.findings.iter().flat_map(|finding| &finding.readings)
    }
}

/// All results.
pub(super) struct MeasureReport {
    pub(super) place: String,
    pub(super) about: String,
    pub(super) renderer: String,
    pub(super) seconds: f64,
    pub(super) sections: Vec<InstrumentSection>,
    /// Rendering speed, for the page of a whole sweep.
    pub(super) speed: Option<SpeedTable>,
}

impl MeasureReport {
    /// Returns the readings of all instruments.
    fn readings(&self) -> impl Iterator<Item = &Reading> {
        self.sections.iter().flat_map(InstrumentSection::readings)
    }

    /// Returns the number of readings within tolerance, and outside of it.
    pub(super) fn verdict(&self) -> [usize; 2] {
        self.readings().fold([0; 2], |[right, off], reading| match reading.passes() {
            true => [right + 1, off],
            false => [right, off + 1],
        })
    }
}
