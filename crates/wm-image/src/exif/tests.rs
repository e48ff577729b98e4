use super::*;
use proptest::prelude::*;

/// A value of a tag: its type, its number of values, and its bytes.
type Entry = (u16, u16, u32, Vec<u8>);

fn text(tag: u16, text: &str) -> Entry {
    (tag, 2, text.len() as u32 + 1, [text.as_bytes(), &[0]].concat())
}

fn time_stamp(values: [u32; 6]) -> Entry {
    (7, 5, 3, values.iter().flat_map(|value| value.to_le_bytes()).collect())
}

/// An EXIF block with these tags in the directories of the photo and of its GPS.
fn block(photo: &[Entry], gps: &[Entry]) -> Vec<u8> {
    described(&[], photo, gps)
}

/// [`block`] with these tags in the first directory.
fn described(first: &[Entry], photo: &[Entry], gps: &[Entry]) -> Vec<u8> {
    let size = |entries: &[Entry]| 2 + 12 * entries.len() + 4;
    let photo_at = 8 + size(first) + 2 * 12;
    let gps_at = photo_at + size(photo);
    let mut values_at = gps_at + size(gps);
    let (mut out, mut values) = (b"II\x2a\0\x08\0\0\0".to_vec(), Vec::new());
    let pointer = |tag: u16, at: usize| (tag, 4, 1, (at as u32).to_le_bytes().to_vec());
    let first = [first, &[pointer(0x8769, photo_at), pointer(0x8825, gps_at)]].concat();
    for entries in [&first, photo, gps] {
        out.extend((entries.len() as u16).to_le_bytes());
        for (tag, kind, count, bytes) in entries {
            out.extend(tag.to_le_bytes());
            out.extend(kind.to_le_bytes());
            out.extend(count.to_le_bytes());
            let mut inline = bytes.clone();
            if bytes.len() > 4 {
                inline = (values_at as u32).to_le_bytes().to_vec();
                values.extend(bytes);
                values_at += bytes.len();
            }
            inline.resize(4, 0);
            out.extend(inline);
        }
        out.extend([0; 4]);
    }
    [out, values].concat()
}

fn taken(photo: &[Entry], gps: &[Entry]) -> Option<f64> {
    Tags::parse(&block(photo, gps)).taken
}

fn clock(time: &str, zone: &str) -> Option<f64> {
    taken(&[text(0x9003, time), text(0x9011, zone)], &[])
}

/// 30 May 2024, 8:56:09 UTC.
const MAY_2024_S: f64 = 1_717_059_369.0;

#[test]
fn gps_time_is_utc_and_comes_first() {
    let gps = [time_stamp([8, 1, 56, 1, 950, 100]), text(0x001D, "2024:05:30")];
    let photo = [text(0x9003, "2001:01:01 00:00:00"), text(0x9011, "+00:00")];
    assert_eq!(taken(&photo, &gps), Some(MAY_2024_S + 0.5));
    let dashes = [time_stamp([8, 1, 56, 1, 9, 1]), text(0x001D, "2024-05-30")];
    assert_eq!(taken(&[], &dashes), Some(MAY_2024_S));
    // Half of it is no time, and neither is one that was not set.
    assert_eq!(taken(&photo, &gps[..1]), Some(978_307_200.0));
    assert_eq!(taken(&[], &gps[1..]), None);
    let unset = [time_stamp([0, 0, 0, 0, 0, 0]), text(0x001D, "2024:05:30")];
    assert_eq!(taken(&[], &unset), None);
}

#[test]
fn the_cameras_clock_needs_its_offset() {
    for (time, zone) in [
        ("2024:05:30 08:56:09", "+00:00"),
        ("2024:05:30 10:56:09", "+02:00"),
        ("2024:05:29 23:26:09", "-09:30"),
        ("2024:05:30 22:56:09", "+14:00"),
    ] {
        assert_eq!(clock(time, zone), Some(MAY_2024_S), "{time} {zone}");
    }
    assert_eq!(taken(&[text(0x9003, "2024:05:30 08:56:09")], &[]), None);
}

#[test]
fn dates_are_those_of_the_calendar() {
    let day = |date: &str| days(date.as_bytes());
    assert_eq!(day("2000:02:29"), Some(951_782_400 / SECONDS_A_DAY));
    assert_eq!(day("2000:03:01"), Some(951_782_400 / SECONDS_A_DAY + 1));
    assert_eq!(day("2038:01:19"), Some(24_855));
    let all =
        ["2023:02:29", "2100:02:28", "1970:01:01", "0000:00:00", "2024:13:01", "2024:00:10", "2024:04:31"];
    for none in all {
        assert_eq!(day(none), None, "{none}");
    }
}

#[test]
fn times_that_are_none_are_left_out() {
    for (time, zone) in [
        ("2024:05:30 24:00:00", "+00:00"),
        ("2024:05:30 08:60:00", "+00:00"),
        ("2024:05:30 08:56:61", "+00:00"),
        ("2024:05:30T08:56:09", "+00:00"),
        ("2024:05:30 08:56", "+00:00"),
        ("    :  :     :  :  ", "   :  "),
        ("2024:05:30 08:56:09", "+15:00"),
        ("2024:05:30 08:56:09", "+01:60"),
        ("2024:05:30 08:56:09", "02:00"),
        ("2024:05:30 08:56:09", "+2"),
        ("2024:05:30 08:56:09", ""),
        ("-024:05:30 08:56:09", "+00:00"),
        ("２024:05:30 08:56:09", "+00:00"),
        ("", "+00:00"),
    ] {
        assert_eq!(clock(time, zone), None, "{time} {zone}");
    }
    for stamp in [[24, 1, 0, 1, 0, 1], [1, 1, 60, 1, 0, 1], [1, 0, 0, 1, 0, 1], [u32::MAX, 1, 0, 1, 0, 1]] {
        assert_eq!(taken(&[], &[time_stamp(stamp), text(0x001D, "2024:05:30")]), None, "{stamp:?}");
    }
}

#[test]
fn mapillary_states_place_and_time_in_the_description() {
    let read = |json: &str, photo: &[Entry], gps: &[Entry]| {
        let tags = Tags::parse(&described(&[text(0x010E, json)], photo, gps));
        (tags.taken, tags.gps.map(|gps| (gps.latitude, gps.longitude, gps.altitude)))
    };
    let whole = r#"{"MAPAltitude":"37.0","MAPLatitude":"55.698167","MAPLongitude":"13.195389","MAPCaptureTime":
        "2024_05_30_08_56_09_250","MAPCompassHeading":{"TrueHeading":179.2}}"#;
    assert_eq!(read(whole, &[], &[]), (Some(MAY_2024_S + 0.25), Some((55.698_167, 13.195_389, Some(37.0)))));
    let numbers = r#"{"MAPLatitude":-33.5,"MAPLongitude":151.25,"MAPCaptureTime":"2024_05_30_08_56_09"}"#;
    assert_eq!(read(numbers, &[], &[]), (Some(MAY_2024_S), Some((-33.5, 151.25, None))));
    // EXIF's own tags come first.
    let photo = [text(0x9003, "2001:01:01 00:00:00"), text(0x9011, "+00:00")];
    assert_eq!(read(whole, &photo, &[]).0, Some(978_307_200.0));
    for other in [
        "a walk in May",
        "[]",
        r#"{"MAPCaptureTime":"2024_05_30"}"#,
        r#"{"MAPCaptureTime":"2024_05_30_25_56_09"}"#,
        r#"{"MAPCaptureTime":"2024_05_30_99999999999999999999_56_09"}"#,
        r#"{"MAPLatitude":"north","MAPLongitude":"13"}"#,
        r#"{"MAPLatitude":"0","MAPLongitude":"0"}"#,
    ] {
        assert_eq!(read(other, &[], &[]), (None, None), "{other}");
    }
}

#[test]
fn blocks_cut_at_any_byte_give_what_is_left() {
    let whole = block(
        &[text(0x9003, "2024:05:30 08:56:09"), text(0x9011, "+00:00")],
        &[time_stamp([8, 1, 56, 1, 9, 1]), text(0x001D, "2024:05:30")],
    );
    assert_eq!(Tags::parse(&whole).taken, Some(MAY_2024_S));
    for end in 0..whole.len() {
        let found = Tags::parse(&whole[..end]).taken;
        assert!(found.is_none_or(|time| time == MAY_2024_S), "{end}");
    }
}

proptest! {
    #[test]
    fn any_texts_and_offsets_never_panic(
        time in prop::collection::vec(any::<u8>(), 0..24),
        zone in prop::collection::vec(any::<u8>(), 0..8),
        date in prop::collection::vec(prop::sample::select(b"0129:- \0".to_vec()), 8..12),
        stamp in prop::array::uniform6(any::<u32>()),
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
    ) {
        let entry = |tag: u16, bytes: Vec<u8>| (tag, 2, bytes.len() as u32, bytes);
        let mut bytes = block(&[entry(0x9003, time), entry(0x9011, zone)], &[time_stamp(stamp), entry(0x001D, date)]);
        for (at, byte) in edits {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        let range = 631_152_000.0 - 86_400.0..4_102_444_800.0 + 86_400.0;
        prop_assert!(Tags::parse(&bytes).taken.is_none_or(|time| range.contains(&time)));
    }
}
