//! Reflectances of labels for lidars, where they are known better than by colour.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The diffuse reflectance of everything that has a label.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelReflectance {
    /// The label, see [`crate::Splats::labels`]; 1 and above.
    pub label: u16,
    /// Diffuse reflectance, 0-1; retroreflectors have up to 100.
    pub reflectance: f64,
    /// The wavelength at which it holds, nm; nothing if it holds at all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength: Option<f64>,
}

/// Largest difference from a lidar's wavelength at which a reflectance for a wavelength holds, nm.
const MAX_WAVELENGTH_OFFSET_NM: f64 = 100.0;
/// Most entries of a place.
const MAX_ENTRIES: usize = 1024;

/// The reflectance of each label for a lidar of a wavelength, nm: that whose wavelength is nearest
/// and within 100 nm, else one without a wavelength. Of equal ones the last holds.
#[must_use]
pub fn by_label(entries: &[LabelReflectance], wavelength: f64) -> BTreeMap<u16, f64> {
    let away = |entry: &LabelReflectance| entry.wavelength.map(|own| (own - wavelength).abs());
    let mut fitting: Vec<&LabelReflectance> = entries
        .iter()
        .filter(|entry| away(entry).is_none_or(|away| away <= MAX_WAVELENGTH_OFFSET_NM))
        .collect();
    // The best comes last and replaces the others.
    let rank = |entry: &LabelReflectance| away(entry).unwrap_or(f64::INFINITY);
    fitting.sort_by(|a, b| rank(b).total_cmp(&rank(a)));
    fitting.into_iter().map(|entry| (entry.label, entry.reflectance)).collect()
}

/// The first fault of entries, in one line.
pub(crate) fn fault(entries: &[LabelReflectance]) -> Option<String> {
    if entries.len() > MAX_ENTRIES {
        return Some(format!("reflectances: {} are too many; there may be {MAX_ENTRIES}", entries.len()));
    }
    entries.iter().enumerate().find_map(|(index, entry)| {
        let LabelReflectance { label, reflectance, wavelength } = *entry;
        let says = if label == 0 {
            "its label is 0, which stands for none".to_owned()
        } else if !(0.0..=100.0).contains(&reflectance) {
            format!("its reflectance is {reflectance}: it must be from 0 to 100")
        } else {
            let wavelength = wavelength.filter(|nm| !(300.0..=20_000.0).contains(nm))?;
            format!("its wavelength is {wavelength} nm: it must be from 300 to 20000")
        };
        Some(format!("reflectances: number {}: {says}", index + 1))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_wavelength_holds() {
        let entry = |label, reflectance, wavelength| LabelReflectance { label, reflectance, wavelength };
        let entries = [
            entry(3, 0.4, Some(905.0)),
            entry(3, 0.3, None),
            entry(3, 0.1, Some(1550.0)),
            entry(5, 0.7, Some(850.0)),
            entry(5, 0.6, Some(940.0)),
            entry(9, 0.2, None),
        ];
        let at = |nm| by_label(&entries, nm).into_iter().collect::<Vec<_>>();
        assert_eq!(at(905.0), [(3, 0.4), (5, 0.6), (9, 0.2)]);
        assert_eq!(at(1550.0), [(3, 0.1), (9, 0.2)]);
        assert_eq!(at(700.0), [(3, 0.3), (9, 0.2)]);
    }

    #[test]
    fn faults_name_the_entry() {
        let entry = LabelReflectance { label: 1, reflectance: 0.5, wavelength: None };
        assert_eq!(fault(&[entry]), None);
        let faults = [
            LabelReflectance { label: 0, ..entry },
            LabelReflectance { reflectance: f64::NAN, ..entry },
            LabelReflectance { wavelength: Some(0.9), ..entry },
        ];
        for bad in faults {
            let says = fault(&[entry, bad]).unwrap();
            assert!(says.starts_with("reflectances: number 2: its "), "{says}");
        }
    }
}
