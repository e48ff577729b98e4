//! Faults of a file are told in one line, and never cost more memory than the file allows.

use super::*;

fn say(bytes: &[u8]) -> String {
    let message = read_bytes(bytes).unwrap_err().to_string();
    assert!(!message.contains(['\n', '\r']), "{message}");
    message
}

/// Bytes that the arrays of a scene hold.
fn memory(splats: &Splats) -> usize {
    splats.means.capacity() * 12
        + splats.quats.capacity() * 16
        + splats.log_scales.capacity() * 12
        + splats.logit_opacities.capacity() * 4
        + splats.sh.capacity() * 4
        + splats.groups.capacity()
}

proptest! {
    #[test]
    fn mutated_files_never_panic_nor_take_memory(
        scene in any_scene(4),
        encoding in prop::sample::select(&PlyEncoding::ALL[..]),
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..3u8), 1..8),
    ) {
        let mut bytes = written(&scene, encoding);
        for (at, byte, kind) in edits {
            let at = at.index(bytes.len());
            match kind {
                0 => bytes[at] = byte,
                1 => bytes.insert(at, byte),
                _ => { bytes.remove(at); }
            }
        }
        check_bounded(&bytes)?;
    }

    #[test]
    fn random_headers_never_panic_nor_take_memory(
        lines in prop::collection::vec(prop::sample::select(LINES), 0..30),
        body in prop::collection::vec(any::<u8>(), 0..400),
    ) {
        let mut bytes = b"ply\n".to_vec();
        for line in lines {
            bytes.extend(line.as_bytes());
            bytes.push(b'\n');
        }
        bytes.extend(b"end_header\n");
        bytes.extend(body);
        check_bounded(&bytes)?;
    }

    #[test]
    fn random_bytes_never_panic(body in prop::collection::vec(any::<u8>(), 0..400)) {
        check_bounded(&body)?;
        check_bounded(&[b"ply\n", &body[..]].concat())?;
    }
}

const LINES: &[&str] = &[
    "format ascii 1.0",
    "format binary_little_endian 1.0",
    "format binary_big_endian 1.0",
    "element vertex 2",
    "element vertex 1000000000000",
    "element vertex 18446744073709551615",
    "element face 3",
    "element face 18446744073709551615",
    "property list char int a",
    "property list uint double b",
    "property float x\nproperty char y\nproperty double z",
    "property uchar f_dc_0\nproperty uchar f_dc_1\nproperty uchar f_dc_2\nproperty char opacity",
    "property char scale_0\nproperty char scale_1\nproperty char scale_2",
    "property char rot_0\nproperty char rot_1\nproperty char rot_2\nproperty char rot_3",
    "comment wm.ground 1.5",
    "",
];

/// Reads in both ways; what comes out may not be larger than the input allows.
fn check_bounded(bytes: &[u8]) -> Result<(), TestCaseError> {
    for read in [read_bytes(bytes), read_pipe(bytes)] {
        match read {
            // A value takes a byte at least and becomes four; doubling arrays may be half empty.
            Ok(scene) => {
                prop_assert_eq!(scene.splats.check(), Ok(()));
                prop_assert!(memory(&scene.splats) <= 9 * bytes.len());
            }
            Err(error) => prop_assert!(!error.to_string().contains(['\n', '\r']), "{}", error),
        }
    }
    Ok(())
}

#[test]
fn a_cut_at_any_byte_is_an_error() {
    for encoding in PlyEncoding::ALL {
        let bytes = written(&small_scene(), encoding);
        // In ASCII the last group is one digit and its line end may be missing.
        let whole = if encoding == PlyEncoding::Ascii { bytes.len() - 1 } else { bytes.len() };
        for end in 0..whole {
            for read in [read_bytes(&bytes[..end]), read_pipe(&bytes[..end])] {
                let message = read.unwrap_err().to_string();
                let cut = ["cut off", "the file is empty", "not a PLY file"];
                assert!(cut.iter().any(|c| message.contains(c)), "{encoding:?} {end}: {message}");
            }
        }
        assert!(read_bytes(&bytes[..whole]).is_ok());
    }
}

#[test]
fn missing_bytes_are_counted() {
    let bytes = written(&small_scene(), PlyEncoding::BinaryLittleEndian);
    let cut = &bytes[..bytes.len() - 100];
    let expected = "a.ply: cut off: the header promises 3 splats, at least 100 bytes are missing; copy or \
                    download the file again";
    assert_eq!(say(cut), expected);
    assert_eq!(read_pipe(cut).unwrap_err().to_string(), expected);
    let bytes = written(&small_scene(), PlyEncoding::Ascii);
    let last_line = bytes[..bytes.len() - 1].iter().rposition(|b| *b == b'\n').unwrap() + 1;
    assert_eq!(
        say(&bytes[..last_line]),
        "a.ply: cut off: the header promises 3 splats, the file ends after 2; copy or download the file again"
    );
    let end = bytes.windows(10).position(|w| w == b"end_header").unwrap();
    assert_eq!(
        say(&bytes[..end]),
        "a.ply: cut off in the header: there is no end_header line; copy or download the file again"
    );
}

#[test]
fn a_promise_of_10_to_the_12_splats_takes_no_memory() {
    for encoding in PlyEncoding::ALL {
        let bytes = written(&small_scene(), encoding);
        let at = bytes.windows(9).position(|w| w == b"vertex 3\n").unwrap() + 7;
        let large = [&bytes[..at], b"1000000000000", &bytes[at + 1..]].concat();
        let messages = [say(&large), read_pipe(&large).unwrap_err().to_string()];
        let expected = if encoding == PlyEncoding::Ascii {
            "the file ends after 3;"
        } else {
            // 26 floats and the group, for all but 3 splats.
            "at least 104999999999685 bytes are missing;"
        };
        for message in messages {
            let start = "a.ply: cut off: the header promises 1000000000000 splats, ";
            assert!(message.starts_with(&format!("{start}{expected}")), "{message}");
        }
    }
}

/// A header of `properties` with 1 splat and no body.
fn header(properties: &[impl std::fmt::Display]) -> Vec<u8> {
    let lines: String = properties.iter().map(|p| format!("property {p}\n")).collect();
    format!("ply\nformat ascii 1.0\nelement vertex 1\n{lines}end_header\n").into_bytes()
}

const NEEDED: &str = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";

/// [`NEEDED`] and other properties of floats.
fn floats(more: impl IntoIterator<Item = String>) -> Vec<String> {
    NEEDED.split(' ').map(Into::into).chain(more).map(|name| format!("float {name}")).collect()
}

#[test]
fn what_is_no_splat_is_named() {
    let hint = "; a 3DGS file has x y z f_dc_0..2 opacity scale_0..2 rot_0..3";
    for (index, name) in NEEDED.split(' ').enumerate() {
        let mut properties = floats([]);
        properties.remove(index);
        // Without its last scale a splat is flat.
        if name != "scale_2" {
            let expected = format!("a.ply: the vertex element has no property {name}{hint}");
            assert_eq!(say(&header(&properties)), expected);
        }

        properties.push(format!("list uchar float {name}"));
        let expected = format!("a.ply: the property {name} is a list, not one number per splat{hint}");
        assert_eq!(say(&header(&properties)), expected);

        assert_eq!(
            say(&header(&floats([name.into()]))),
            format!("a.ply: the property {name} is declared twice{hint}")
        );
    }
    assert_eq!(
        say(b"ply\nformat ascii 1.0\nend_header\n"),
        format!("a.ply: there is no vertex element{hint}")
    );
    assert_eq!(
        say(&header(&["uint packed_position", "uint packed_rotation"])),
        "a.ply: compressed PLY: only binary_little_endian is read; export the file again"
    );
    for count in [1, 3, 10, 27, 44, 46, 71] {
        let all = floats((0..count).map(|i| format!("f_rest_{i}")));
        let expected = format!(
            "a.ply: {count} f_rest properties fit no SH degree: 0, 9, 24, 45 or 72 do; export the file again"
        );
        assert_eq!(say(&header(&all)), expected);
    }
    let all = floats((1..10).map(|i| format!("f_rest_{i}")));
    assert_eq!(say(&header(&all)), format!("a.ply: the vertex element has no property f_rest_0{hint}"));
}

#[test]
fn headers_that_are_not_understood_are_named() {
    let start = "ply\nformat ascii 1.0\n";
    for (line, expected) in [
        ("elephant 1", "the header line \"elephant 1\" is not understood; export the file again"),
        ("format text 1.0", "\"text\" is not an encoding of PLY; export the file again"),
        ("format ascii 2.0", "PLY version \"2.0\" is not read, 1.0 is; export the file again"),
        ("element vertex -1", "\"-1\" is not a number of elements; export the file again"),
        ("element vertex", "the header line \"element vertex\" is not understood; export the file again"),
        ("property float x", "a property stands before the first element; export the file again"),
        ("comment wm.up \"\u{7}\u{e9}", "METADATA"),
        ("comment wm.ground high", "METADATA"),
        (
            "comment wm.up [0.0, 0.0, 2.0]",
            "metadata: up is [0, 0, 2]: it must have length 1; correct or remove the line",
        ),
    ] {
        let message = say(format!("{start}{line}\nend_header\n").as_bytes());
        let rest = message.strip_prefix("a.ply, line 3: ").unwrap_or_else(|| panic!("{message}"));
        if expected == "METADATA" {
            assert!(
                rest.starts_with("metadata: ") && rest.ends_with("; correct or remove the line"),
                "{rest}"
            );
        } else {
            assert_eq!(rest, expected);
        }
    }
    for (property, expected) in [
        ("half x", "\"half\" is not a number type of PLY; export the file again"),
        ("list float int x", "a list cannot have a length that is not an integer; export the file again"),
        ("float", "the header line \"property float\" is not understood; export the file again"),
    ] {
        assert_eq!(say(&header(&[property])), format!("a.ply, line 4: {expected}"));
    }
    assert_eq!(
        say(b"ply\nelement vertex 1\nend_header\n"),
        "a.ply: the header has no format line; export the file again"
    );
    let long = [&b"ply\n"[..], &b"comment\n".repeat(200_000)].concat();
    assert_eq!(
        say(&long),
        "a.ply: the header has no end_header line in its first 1048576 bytes; this is not a PLY that can be read"
    );
}

#[test]
fn no_splats_are_an_error() {
    let bytes = String::from_utf8(header(&floats([]))).unwrap().replace("vertex 1", "vertex 0");
    assert_eq!(say(bytes.as_bytes()), "a.ply: there are no splats in it; nothing can be shown");
}

#[test]
fn bad_rows_of_ascii_have_their_line() {
    let text = |row: &str| [&header(&floats([]))[..], b"\n", row.as_bytes(), b"\n"].concat();
    let row = ["1"; 14];
    assert!(read_bytes(&text(&row.join(" "))).is_ok());
    let mut bad = row;
    bad[6] = "1,5";
    assert_eq!(
        say(&text(&bad.join(" "))),
        "a.ply, line 20: \"1,5\" is not a number for opacity; correct it or export the file again"
    );
    assert_eq!(
        say(&text(&row[1..].join(" "))),
        "a.ply, line 20: there are too few values for a splat; correct the line or export the file again"
    );
    assert_eq!(
        say(&text(&format!("{} 1", row.join(" ")))),
        "a.ply, line 20: there are more values than the 14 properties of a splat; correct the line or export \
         the file again"
    );
}

#[test]
fn a_negative_list_has_its_byte() {
    let text = "ply\nformat binary_big_endian 1.0\nelement face 2\nproperty list short int a\n\
                element vertex 1\n";
    let lines: String = floats([]).iter().map(|p| format!("property {p}\n")).collect();
    let mut bytes = format!("{text}{lines}end_header\n").into_bytes();
    let at = bytes.len() + 6;
    bytes.extend([0, 1, 0, 0, 0, 7, 0xff, 0xfe]);
    bytes.extend([0; 56]);
    assert_eq!(
        say(&bytes),
        format!("a.ply, byte {at}: a list of the element face has a negative length; export the file again")
    );
}

/// A compressed PLY whose second element of SH has other properties than its first.
#[test]
fn two_elements_of_sh_in_a_compressed_ply_are_refused() {
    let floats: String = (0..12).map(|i| format!("property float bound_{i}\n")).collect();
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement chunk 1\n{floats}element vertex 1\nproperty uint packed_position\n\
         property uint packed_rotation\nproperty uint packed_scale\nproperty uint packed_color\nelement sh 1\nelement sh 1\n\
         property uchar f_rest_0\nend_header\n"
    );
    for (index, name) in ["min_x", "min_y", "min_z", "max_x", "max_y", "max_z"].into_iter().enumerate() {
        bytes = bytes.replace(&format!("bound_{index}\n"), &format!("{name}\n"));
        let scale = name.replace('_', "_scale_");
        bytes = bytes.replace(&format!("bound_{}\n", index + 6), &format!("{scale}\n"));
    }
    let bytes = [bytes.as_bytes(), &[0; 48 + 16 + 1]].concat();
    assert!(say(&bytes).ends_with("there are two elements sh; export the file again"), "{}", say(&bytes));
}
