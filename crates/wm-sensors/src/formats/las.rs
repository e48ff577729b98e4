//! LAS 1.2 with points of format 3 (ASPRS 2008).

use super::records::write_records;
use crate::echo::EchoClass;
use crate::error::SensorError;
use crate::sweep::{LidarPoint, LidarSweep};
use std::path::Path;

/// Metres of a step of a coordinate.
const STEP_M: f64 = 0.001;
/// Bytes of the header and of a point.
const HEADER_BYTES: u16 = 227;
const RECORD_BYTES: u16 = 34;

pub(super) fn save(sweep: &LidarSweep, path: &Path) -> Result<(), SensorError> {
    let fault = |problem: String| SensorError::Points { path: path.into(), problem };
    let count = u32::try_from(sweep.points.len()).map_err(|_| fault("too many points for LAS 1.2".into()))?;
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for point in &sweep.points {
        for k in 0..3 {
            let v = f64::from(point.position[k]);
            (low[k], high[k]) = (low[k].min(v), high[k].max(v));
        }
    }
    if sweep.points.is_empty() {
        (low, high) = ([0.0; 3], [0.0; 3]);
    }
    // Places far from the origin of the scene would not fit 32 bits otherwise.
    let offset = [0, 1, 2].map(|k| (0.5 * (low[k] + high[k])).round());
    if (0..3).any(|k| high[k] - low[k] > 4e6) {
        return Err(fault("points are too far apart for LAS: more than 4000 km".into()));
    }
    // Coordinates of the world, whose origin goes into the offset, to the millimetre.
    let world = |place: &[f64; 3]| [0, 1, 2].map(|k| place[k] + sweep.origin[k]);
    let header = header(count, &world(&offset), &world(&low), &world(&high));
    write_records(path, &header, &sweep.points, |point, out| record(point, &offset, sweep.time[0], out))
}

fn header(count: u32, offset: &[f64; 3], low: &[f64; 3], high: &[f64; 3]) -> Vec<u8> {
    let text = |text: &str| {
        let mut field = [0u8; 32];
        field[..text.len()].copy_from_slice(text.as_bytes());
        field
    };
    let mut out = b"LASF".to_vec();
    // No file source, no flags, no project.
    out.extend([0u8; 4 + 16]);
    out.extend([1, 2]);
    out.extend(text("SIMULATED"));
    out.extend(text("weather-magician"));
    // Day and year of making: none, so that equal points are equal bytes.
    out.extend([0u8; 4]);
    out.extend(HEADER_BYTES.to_le_bytes());
    out.extend(u32::from(HEADER_BYTES).to_le_bytes());
    out.extend(0u32.to_le_bytes());
    out.push(3);
    out.extend(RECORD_BYTES.to_le_bytes());
    out.extend(count.to_le_bytes());
    // Points by return: each point is said to be the first of one.
    out.extend(count.to_le_bytes());
    out.extend([0u8; 16]);
    for value in [STEP_M; 3].iter().chain(offset) {
        out.extend(value.to_le_bytes());
    }
    for k in 0..3 {
        out.extend(high[k].to_le_bytes());
        out.extend(low[k].to_le_bytes());
    }
    debug_assert_eq!(out.len(), usize::from(HEADER_BYTES));
    out
}

fn record(point: &LidarPoint, offset: &[f64; 3], start: f64, out: &mut Vec<u8>) {
    for (value, offset) in point.position.iter().zip(offset) {
        let steps = ((f64::from(*value) - offset) / STEP_M).round() as i32;
        out.extend(steps.to_le_bytes());
    }
    let intensity = (257.0 * point.intensity).round() as u16;
    out.extend(intensity.to_le_bytes());
    // Return 1 of 1.
    out.push(0b0000_1001);
    // Unclassified, or noise.
    out.push(if point.class == EchoClass::Surface { 1 } else { 7 });
    // Scan angle, then our class in the user's byte.
    out.extend([0, point.class as u8]);
    out.extend(point.ring.to_le_bytes());
    out.extend((start + f64::from(point.time)).to_le_bytes());
    for _ in 0..3 {
        out.extend(intensity.to_le_bytes());
    }
}
