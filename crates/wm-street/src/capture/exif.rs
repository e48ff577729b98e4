//! EXIF of the photos: camera, time, focal length, position.

use super::flaws::ExifFault;
use super::settings::{CaptureKind, CaptureSettings};
use super::shots::Shot;
use crate::{Place, sky};
use wm_base::calendar::date_and_time;
use wm_base::random::RandomStream;
use wm_scene::Gps;

/// Diagonal of a full frame, mm.
const FULL_FRAME_DIAGONAL_MM: f64 = 43.266_615;
/// Purpose of the random numbers of lies.
const EXIF_FAULT_LANE: u64 = 47;

/// The facts that EXIF states.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ExifFacts {
    pub(crate) maker: &'static str,
    pub(crate) model: &'static str,
    /// Seconds since 1970, UTC.
    pub(crate) time: i64,
    /// Focal length of a full frame of the same angle of view, mm.
    pub(crate) focal: f64,
    pub(crate) gps: Option<Gps>,
}

/// Returns the facts that photo `index` states, lies included.
pub(super) fn facts(
    place: &Place,
    settings: &CaptureSettings,
    index: usize,
    shot: &Shot,
    gps: Gps,
) -> ExifFacts {
    let camera = &shot.camera;
    let diagonal = f64::from(camera.width).hypot(f64::from(camera.height));
    let mut facts = ExifFacts {
        maker: "Weather-Magician",
        model: match settings.kind {
            CaptureKind::Nadir | CaptureKind::Oblique => "made-up drone",
            CaptureKind::Walk => "made-up phone",
            CaptureKind::Drive => "made-up car camera",
        },
        time: sky::SUN_TIME_S + shot.time.round() as i64,
        focal: FULL_FRAME_DIAGONAL_MM * camera.fx / diagonal,
        gps: Some(gps),
    };
    let lies = &settings.flaws.exif;
    if lies.contains(&ExifFault::Focal) {
        facts.focal *= 2.7;
    }
    if lies.contains(&ExifFault::Time) {
        // Midnight at the beginning of a clock's count.
        facts.time = shot.time.round() as i64;
    }
    let places: Vec<ExifFault> = lies
        .iter()
        .copied()
        .filter(|lie| matches!(lie, ExifFault::Continent | ExifFault::Zero | ExifFault::Nonsense))
        .collect();
    if !places.is_empty() {
        let random = RandomStream::new(settings.seed, EXIF_FAULT_LANE, 0);
        facts.gps = Some(match places[index % places.len()] {
            ExifFault::Zero => Gps { latitude: 0.0, longitude: 0.0, altitude: Some(0.0) },
            ExifFault::Nonsense => Gps {
                latitude: 95.0 + 200.0 * random.uniform(2 * index as u64),
                longitude: 181.0 + 300.0 * random.uniform(2 * index as u64 + 1),
                altitude: Some(384_400_000.0),
            },
            // The same way in Australia.
            _ => Gps { latitude: -37.6, longitude: 144.2, altitude: Some(410.0) }
                .moved(gps.enu_from(&place.sights.home)),
        });
    }
    facts
}

/// A directory of EXIF and the values that do not fit into its entries.
#[derive(Default)]
struct Directory {
    /// Tag, type, number of values, and the value or its bytes.
    entries: Vec<(u16, u16, u32, Vec<u8>)>,
}

impl Directory {
    fn add(&mut self, tag: u16, kind: u16, count: usize, bytes: Vec<u8>) {
        self.entries.push((tag, kind, count as u32, bytes));
    }

    fn text(&mut self, tag: u16, text: &str) {
        self.add(tag, 2, text.len() + 1, [text.as_bytes(), &[0]].concat());
    }

    fn bytes(&mut self, tag: u16, bytes: &[u8]) {
        self.add(tag, 1, bytes.len(), bytes.to_vec());
    }

    fn short(&mut self, tag: u16, value: u16) {
        self.add(tag, 3, 1, value.to_le_bytes().to_vec());
    }

    fn long(&mut self, tag: u16, value: u32) {
        self.add(tag, 4, 1, value.to_le_bytes().to_vec());
    }

    /// Numbers of 0 and above, each with its denominator.
    fn rationals(&mut self, tag: u16, values: &[(f64, u32)]) {
        let bytes = values.iter().flat_map(|(value, below)| {
            let above = (value * f64::from(*below)).round().clamp(0.0, f64::from(u32::MAX)) as u32;
            [above.to_le_bytes(), below.to_le_bytes()].concat()
        });
        self.add(tag, 5, values.len(), bytes.collect());
    }

    /// The number of bytes that it takes.
    fn size(&self) -> usize {
        let value = |bytes: &Vec<u8>| if bytes.len() > 4 { bytes.len().next_multiple_of(2) } else { 0 };
        let values = self.entries.iter().map(|(.., bytes)| value(bytes));
        2 + 12 * self.entries.len() + 4 + values.sum::<usize>()
    }

    /// Appends it to a TIFF structure, at its end.
    fn write(mut self, out: &mut Vec<u8>) {
        self.entries.sort_by_key(|entry| entry.0);
        let mut place = out.len() + 2 + 12 * self.entries.len() + 4;
        let mut values = Vec::new();
        out.extend((self.entries.len() as u16).to_le_bytes());
        for (tag, kind, count, bytes) in &self.entries {
            out.extend(tag.to_le_bytes());
            out.extend(kind.to_le_bytes());
            out.extend(count.to_le_bytes());
            let mut inline = bytes.clone();
            if bytes.len() > 4 {
                inline = (place as u32).to_le_bytes().to_vec();
                values.extend(bytes);
                values.resize(values.len().next_multiple_of(2), 0);
                place += bytes.len().next_multiple_of(2);
            }
            inline.resize(4, 0);
            out.extend(inline);
        }
        out.extend(0u32.to_le_bytes());
        out.extend(values);
    }
}

impl ExifFacts {
    /// The block of EXIF, as a PNG's `eXIf` chunk has it.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let [year, month, day, hour, minute, second] = date_and_time(self.time);
        let time = format!("{year:04}:{month:02}:{day:02} {hour:02}:{minute:02}:{second:02}");
        let mut first = Directory::default();
        first.text(0x010F, self.maker);
        first.text(0x0110, self.model);
        first.short(0x0112, 1);
        first.text(0x0132, &time);
        let mut photo = Directory::default();
        photo.text(0x9003, &time);
        photo.text(0x9011, "+00:00");
        photo.rationals(0x920A, &[(self.focal / 5.6, 1000)]);
        photo.short(0xA405, self.focal.round() as u16);
        let gps = self.gps.map(|gps| {
            let mut directory = Directory::default();
            directory.bytes(0x0000, &[2, 3, 0, 0]);
            for (reference, angle, letters) in [(1, gps.latitude, ["N", "S"]), (3, gps.longitude, ["E", "W"])]
            {
                directory.text(reference, letters[usize::from(angle < 0.0)]);
                let (degrees, rest) = (angle.abs().trunc(), angle.abs().fract() * 60.0);
                let (minutes, seconds) = (rest.trunc(), rest.fract() * 60.0);
                directory.rationals(reference + 1, &[(degrees, 1), (minutes, 1), (seconds, 100_000)]);
            }
            if let Some(altitude) = gps.altitude {
                directory.bytes(0x0005, &[u8::from(altitude < 0.0)]);
                directory.rationals(0x0006, &[(altitude.abs(), if altitude.abs() < 4e6 { 1000 } else { 1 })]);
            }
            let [hour, minute, second] = [hour, minute, second].map(|value| (value as f64, 1));
            directory.rationals(0x0007, &[hour, minute, second]);
            directory.text(0x001D, &format!("{year:04}:{month:02}:{day:02}"));
            directory
        });
        // The pointers are entries themselves, so all sizes must be known before.
        let header = 8;
        let pointers = if gps.is_some() { 2 } else { 1 };
        let photo_at = header + first.size() + 12 * pointers;
        first.long(0x8769, photo_at as u32);
        if gps.is_some() {
            first.long(0x8825, (photo_at + photo.size()) as u32);
        }
        let mut out = b"II\x2a\0\x08\0\0\0".to_vec();
        first.write(&mut out);
        photo.write(&mut out);
        if let Some(gps) = gps {
            gps.write(&mut out);
        }
        out
    }
}
