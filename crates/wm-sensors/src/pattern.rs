//! Directions and times of the beams of a sweep.

use serde::Deserialize;

/// One pulse of a sweep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Time after the start of the sweep, s.
    pub time: f64,
    /// Azimuth from x forward towards y left, radians.
    pub azimuth: f64,
    /// Elevation above the plane of x and y, radians.
    pub elevation: f64,
    /// Row (ring, channel), the highest first; 0 where there are no rows.
    pub ring: u16,
    /// Column, in the order of time.
    pub column: u32,
}

/// The pattern of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub enum BeamPattern {
    /// Rows of fixed elevation that turn or are swept from side to side.
    Rows(RowPattern),
    /// A table of beams that repeats.
    Table(TablePattern),
    /// Two rotating prisms, whose curve does not repeat.
    Risley(RisleyPattern),
}

/// Rows of beams that turn about z.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct RowPattern {
    /// Sweeps a second, Hz.
    pub(crate) rate: f64,
    /// Elevations of the rows, degrees, in the order of firing.
    #[serde(default)]
    pub(crate) elevations: Vec<f64>,
    /// Instead: the lowest and the highest elevation of evenly spaced rows, degrees.
    #[serde(default)]
    pub(crate) between: Option<[f64; 2]>,
    /// The number of evenly spaced rows.
    #[serde(default)]
    pub(crate) count: Option<usize>,
    /// Azimuth offset of each row from the head, degrees; empty for none.
    #[serde(default)]
    pub(crate) azimuth_offsets: Vec<f64>,
    /// Firings of all rows in a sweep.
    pub(crate) columns: u32,
    /// Firing delay of each row after its column, microseconds; empty for all at once.
    #[serde(default)]
    pub(crate) firing_offsets: Vec<f64>,
    /// Azimuths at which a sweep begins and ends, degrees.
    #[serde(default = "full_turn")]
    pub(crate) azimuths: [f64; 2],
}

/// Seen from above it turns as a clock does, from the back over the front.
fn full_turn() -> [f64; 2] {
    [180.0, -180.0]
}

/// Beams in a table.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct TablePattern {
    /// Sweeps a second, Hz.
    pub(crate) rate: f64,
    /// Time after the start of the sweep (s), azimuth and elevation (degrees) of each beam.
    pub(crate) beams: Vec<[f64; 3]>,
}

/// The sum of two vectors that rotate, as angles about the forward axis.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct RisleyPattern {
    /// Sweeps a second, Hz, into which the curve is cut.
    pub(crate) rate: f64,
    /// Beams a sweep.
    pub(crate) points: u32,
    /// Deflection by each prism, degrees.
    pub(crate) deflections: [f64; 2],
    /// Speed of each prism, turns a minute; below 0 the other way round.
    pub(crate) speeds: [f64; 2],
}

/// Most beams of a sweep.
const MAX_BEAMS: usize = 20_000_000;

impl BeamPattern {
    /// Sweeps a second, Hz.
    #[must_use]
    pub fn rate(&self) -> f64 {
        match self {
            Self::Rows(rows) => rows.rate,
            Self::Table(table) => table.rate,
            Self::Risley(risley) => risley.rate,
        }
    }

    /// The beams of sweep `index`, in the order of columns.
    #[must_use]
    pub fn beams(&self, index: u64) -> Vec<Beam> {
        match self {
            Self::Rows(rows) => rows.beams(),
            Self::Table(table) => table.beams(),
            Self::Risley(risley) => risley.beams(index),
        }
    }

    /// Rows and columns of a sweep, if it has rows.
    #[must_use]
    pub fn grid(&self) -> Option<[u32; 2]> {
        match self {
            Self::Rows(rows) => Some([rows.elevations().len() as u32, rows.columns]),
            _ => None,
        }
    }

    /// The fault of a pattern that makes no beams, with its key.
    pub(crate) fn fault(&self) -> Option<String> {
        let rate = self.rate();
        if !(0.01..=1e6).contains(&rate) {
            return Some(format!("rate is {rate}: it must be 0.01 to 1000000 sweeps a second"));
        }
        match self {
            Self::Rows(rows) => rows.fault(),
            Self::Table(table) => table.fault(),
            Self::Risley(risley) => risley.fault(),
        }
    }
}

/// The first of `values` that is not within -`most` to `most`.
fn beyond(values: &[f64], most: f64) -> Option<f64> {
    values.iter().copied().find(|value| !(-most..=most).contains(value))
}

impl RowPattern {
    /// Elevations of the rows in the order of firing, degrees.
    #[must_use]
    pub fn elevations(&self) -> Vec<f64> {
        let (Some([low, high]), Some(count)) = (self.between, self.count) else {
            return self.elevations.clone();
        };
        let step = if count > 1 { (high - low) / (count - 1) as f64 } else { 0.0 };
        (0..count).map(|row| high - step * row as f64).collect()
    }

    fn fault(&self) -> Option<String> {
        if self.between.is_some() != self.count.is_some() {
            return Some("between and count belong together: give both, or elevations".into());
        }
        if self.between.is_some() && !self.elevations.is_empty() {
            return Some("give elevations, or between and count, not both".into());
        }
        if self.count.is_some_and(|count| count > 4096) {
            return Some(format!("count is {}: at most 4096 rows", self.count.unwrap_or(0)));
        }
        let elevations = self.elevations();
        let rows = elevations.len();
        if rows == 0 || self.columns == 0 {
            return Some("there are no beams: give elevations, and columns above 0".into());
        }
        if rows * self.columns as usize > MAX_BEAMS {
            return Some(format!("{rows} rows of {} columns are more than {MAX_BEAMS} beams", self.columns));
        }
        if let Some(bad) = beyond(&elevations, 90.0) {
            return Some(format!("an elevation is {bad}: it must be from -90 to 90 degrees"));
        }
        let period = 1e6 / self.rate;
        for (key, list, most) in [
            ("azimuth_offsets", &self.azimuth_offsets, 360.0),
            ("firing_offsets", &self.firing_offsets, period),
        ] {
            if !list.is_empty() && list.len() != rows {
                return Some(format!("{key} has {} numbers for {rows} rows", list.len()));
            }
            if let Some(bad) = beyond(list, most) {
                return Some(format!("{key} has {bad}: it must be a number of at most {most}"));
            }
        }
        beyond(&self.azimuths, 720.0).map(|bad| format!("azimuths has {bad}: it must be from -720 to 720"))
    }

    fn beams(&self) -> Vec<Beam> {
        let elevations = self.elevations();
        let mut order: Vec<usize> = (0..elevations.len()).collect();
        order.sort_by(|a, b| elevations[*b].total_cmp(&elevations[*a]));
        let mut rings = vec![0; elevations.len()];
        order.iter().enumerate().for_each(|(ring, row)| rings[*row] = ring as u16);
        let [begin, end] = self.azimuths;
        let period = 1.0 / self.rate;
        let mut beams = Vec::with_capacity(elevations.len() * self.columns as usize);
        for column in 0..self.columns {
            for (row, elevation) in elevations.iter().enumerate() {
                let offset = self.firing_offsets.get(row).map_or(0.0, |micros| 1e-6 * micros);
                let time = period * f64::from(column) / f64::from(self.columns) + offset;
                // The head goes on while the rows fire one after the other.
                let head = begin + (end - begin) * time / period;
                let azimuth = head + self.azimuth_offsets.get(row).copied().unwrap_or(0.0);
                let (azimuth, elevation) = (azimuth.to_radians(), elevation.to_radians());
                beams.push(Beam { time, azimuth, elevation, ring: rings[row], column });
            }
        }
        beams
    }
}

impl TablePattern {
    fn fault(&self) -> Option<String> {
        if self.beams.is_empty() {
            return Some("beams is empty: give [time, azimuth, elevation] of each".into());
        }
        if self.beams.len() > MAX_BEAMS {
            return Some(format!("beams has more than {MAX_BEAMS} entries"));
        }
        let period = 1.0 / self.rate;
        self.beams.iter().enumerate().find_map(|(index, [time, azimuth, elevation])| {
            let is_fine = (0.0..=period).contains(time) && azimuth.abs() <= 720.0 && elevation.abs() <= 90.0;
            (!is_fine).then(|| {
                format!(
                    "beam {} is [{time}, {azimuth}, {elevation}]: its time must be from 0 to {period} s, its azimuth from -720 to \
                     720 and its elevation from -90 to 90 degrees",
                    index + 1
                )
            })
        })
    }

    fn beams(&self) -> Vec<Beam> {
        let beam = |(column, [time, azimuth, elevation]): (usize, &[f64; 3])| Beam {
            time: *time,
            azimuth: azimuth.to_radians(),
            elevation: elevation.to_radians(),
            ring: 0,
            column: column as u32,
        };
        self.beams.iter().enumerate().map(beam).collect()
    }
}

impl RisleyPattern {
    fn fault(&self) -> Option<String> {
        if self.points == 0 || self.points as usize > MAX_BEAMS {
            return Some(format!("points is {}: it must be from 1 to {MAX_BEAMS}", self.points));
        }
        if let Some(bad) = beyond(&self.deflections, 40.0) {
            return Some(format!("deflections has {bad}: it must be from -40 to 40 degrees"));
        }
        beyond(&self.speeds, 1e6)
            .map(|bad| format!("speeds has {bad}: it must be a number of turns a minute"))
    }

    fn beams(&self, index: u64) -> Vec<Beam> {
        let step = 1.0 / (self.rate * f64::from(self.points));
        let first = index * u64::from(self.points);
        let turns = |speed: f64, shot: u64| {
            // Whole turns are taken off before they cost digits.
            std::f64::consts::TAU * (speed / 60.0 * step * shot as f64).fract()
        };
        let beam = |column: u32| {
            let shot = first + u64::from(column);
            let [a, b] = [0, 1].map(|k| {
                let (sin, cos) = turns(self.speeds[k], shot).sin_cos();
                [self.deflections[k] * cos, self.deflections[k] * sin]
            });
            // The length of the sum is the angle from the axis.
            let [y, z] = [a[0] + b[0], a[1] + b[1]];
            let angle = y.hypot(z).to_radians();
            let scale = if angle > 1e-12 { angle.sin() / y.hypot(z) } else { 0.0 };
            let (x, y, z) = (angle.cos(), y * scale, z * scale);
            let time = step * f64::from(column);
            Beam { time, azimuth: y.atan2(x), elevation: z.asin(), ring: 0, column }
        };
        (0..self.points).map(beam).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows() -> RowPattern {
        RowPattern {
            rate: 10.0,
            elevations: vec![-1.0, 3.0, 1.0],
            between: None,
            count: None,
            azimuth_offsets: vec![],
            columns: 360,
            firing_offsets: vec![0.0, 10.0, 20.0],
            azimuths: full_turn(),
        }
    }

    #[test]
    fn rows_turn_while_they_fire() {
        let beams = rows().beams();
        assert_eq!(beams.len(), 1080);
        // A degree is 277.8 microseconds, and the sweep begins at the back.
        assert!((beams[0].azimuth.to_degrees() - 180.0).abs() < 1e-9);
        assert!((beams[3].azimuth.to_degrees() - 179.0).abs() < 1e-9);
        assert!((beams[2].azimuth.to_degrees() - (180.0 - 0.072)).abs() < 1e-9);
        assert!((beams[1079].time - (0.1 * 359.0 / 360.0 + 2e-5)).abs() < 1e-12);
        assert_eq!([beams[0].ring, beams[1].ring, beams[2].ring], [2, 0, 1]);
    }

    #[test]
    fn prisms_draw_a_rosette_that_goes_on() {
        let risley =
            RisleyPattern { rate: 10.0, points: 10_000, deflections: [9.2; 2], speeds: [7294.0, -4664.0] };
        let all: Vec<Beam> = (0..3).flat_map(|index| risley.beams(index)).collect();
        let off = |beam: &Beam| (beam.azimuth.cos() * beam.elevation.cos()).acos().to_degrees();
        let widest = all.iter().map(off).fold(0.0, f64::max);
        assert!((18.3..18.41).contains(&widest), "{widest}");
        // No jump from one sweep to the next: as far as from beam to beam.
        let step = |a: &Beam, b: &Beam| (a.azimuth - b.azimuth).hypot(a.elevation - b.elevation);
        assert!(step(&all[9_999], &all[10_000]) < 2.0 * step(&all[9_998], &all[9_999]) + 1e-3);
        assert!(step(&all[0], &all[10_000]) > 0.01);
    }

    #[test]
    fn patterns_without_beams_are_refused() {
        let fault = |change: &dyn Fn(&mut RowPattern)| {
            let mut rows = rows();
            change(&mut rows);
            BeamPattern::Rows(rows).fault().unwrap_or_default()
        };
        assert!(fault(&|rows| rows.rate = 0.0).starts_with("rate is 0"));
        assert!(fault(&|rows| rows.rate = f64::NAN).starts_with("rate is NaN"));
        assert!(fault(&|rows| rows.elevations.clear()).starts_with("there are no beams"));
        assert!(fault(&|rows| rows.columns = 0).starts_with("there are no beams"));
        assert!(fault(&|rows| rows.elevations[0] = f64::INFINITY).starts_with("an elevation is inf"));
        assert!(fault(&|rows| rows.azimuth_offsets = vec![1.0]).contains("1 numbers for 3 rows"));
        assert!(fault(&|rows| rows.count = Some(3)).contains("belong together"));
        assert_eq!(fault(&|_| {}), "");
        let table = TablePattern { rate: 10.0, beams: vec![[0.0, 1.0, 100.0]] };
        assert!(BeamPattern::Table(table).fault().unwrap().starts_with("beam 1 is"));
        let none = TablePattern { rate: 10.0, beams: vec![] };
        assert!(BeamPattern::Table(none).fault().unwrap().starts_with("beams is empty"));
    }
}
