use super::*;
use crate::testing::{Files, Named, pth, safetensors, said, with_header, zip};

fn two() -> Vec<Named> {
    vec![
        ("a".into(), vec![2, 3], (0..6).map(|v| v as f32 - 2.5).collect()),
        ("b.weight".into(), vec![2], vec![0.5, -8.0]),
    ]
}

fn opened(path: &Path) -> Result<Weights, WeightsError> {
    Weights::open(&[path.into()], "give others")
}

/// Both tensors of [`two`].
fn both(path: &Path) -> Result<Vec<f32>, WeightsError> {
    let mut weights = opened(path)?;
    let (a, b) = (weights.tensor("a", &[2, 3])?, weights.tensor("b.weight", &[2])?);
    Ok([numbers(&a), numbers(&b)].concat())
}

#[test]
fn both_formats_give_the_same_numbers() {
    let (files, expected) = (Files::new(), [-2.5, -1.5, -0.5, 0.5, 1.5, 2.5, 0.5, -8.0]);
    for (name, content) in [("x.safetensors", safetensors(&two())), ("x.pth", pth(&two()))] {
        assert_eq!(both(&files.put(name, content)).unwrap(), expected, "{name}");
    }
    // One in each of two files; the first that has a name is taken.
    let first = files.put("1", safetensors(&two()[..1]));
    let mut other = two();
    other[0].2.fill(7.0);
    let second = files.put("2", pth(&other));
    let mut weights = Weights::open(&[first, second], "").unwrap();
    assert_eq!(numbers(&weights.tensor("a", &[2, 3]).unwrap())[0], -2.5);
    assert_eq!(numbers(&weights.tensor("b.weight", &[2]).unwrap()), [0.5, -8.0]);
}

#[test]
fn other_precisions_are_converted() {
    let files = Files::new();
    for (kind, bytes) in [
        ("F16", &[0x00u8, 0x38, 0x00, 0xc8][..]),
        ("BF16", &[0x00, 0x3f, 0x00, 0xc1]),
        ("F64", &[0, 0, 0, 0, 0, 0, 0xe0, 0x3f, 0, 0, 0, 0, 0, 0, 0x20, 0xc0]),
    ] {
        let header =
            format!(r#"{{"b":{{"dtype":"{kind}","shape":[2],"data_offsets":[0,{}]}}}}"#, bytes.len());
        let path = files.put("x", with_header(&header, bytes));
        let tensor = opened(&path).unwrap().tensor("b", &[2]).unwrap();
        assert_eq!(numbers(&tensor), [0.5, -8.0], "{kind}");
    }
    let path =
        files.put("x", with_header(r#"{"b":{"dtype":"I32","shape":[1],"data_offsets":[0,4]}}"#, &[0; 4]));
    assert!(said(opened(&path).unwrap().tensor("b", &[1])).contains("tensor b is stored as I32; "));
}

#[test]
fn tensors_that_are_not_there_or_other() {
    let files = Files::new();
    let mut bad = two();
    bad[1].2[1] = f32::NAN;
    for (name, content, broken) in
        [("x.safetensors", safetensors(&two()), safetensors(&bad)), ("x.pth", pth(&two()), pth(&bad))]
    {
        let path = files.put(name, content);
        let also = files.put("y", safetensors(&[]));
        let mut weights = Weights::open(&[path.clone(), also.clone()], "give others").unwrap();
        let (path, also) = (path.display(), also.display());
        assert_eq!(
            said(weights.tensor("c", &[4])),
            format!("{path}, {also}: no tensor c of shape [4]; give others")
        );
        assert_eq!(
            said(weights.tensor("a", &[3, 2])),
            format!("{path}: tensor a has shape [2, 3], not [3, 2]; give others")
        );
        let line = said(both(&files.put("z", broken)));
        assert!(line.contains("tensor b.weight holds NaN or infinite numbers"), "{line}");
    }
}

/// An archive of 64 bits that claims so many entries and has none.
fn claiming_entries(count: u64) -> Vec<u8> {
    let mut bytes = b"PK\x03\x04".to_vec();
    let record = bytes.len() as u64;
    bytes.extend(b"PK\x06\x06");
    bytes.extend(44u64.to_le_bytes());
    bytes.extend([45, 0, 45, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    [count, count, 0, 4].iter().for_each(|number: &u64| bytes.extend(number.to_le_bytes()));
    bytes.extend(b"PK\x06\x07\0\0\0\0");
    bytes.extend(record.to_le_bytes());
    bytes.extend(b"\x01\0\0\0PK\x05\x06");
    bytes.extend([0xff; 16]);
    bytes.extend([0, 0]);
    bytes
}

#[test]
fn files_that_are_none() {
    let files = Files::new();
    let old = b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.\x80\x02M\xe9\x03.";
    for (content, says) in [
        (&b""[..], "the file is empty"),
        (b"weights", "neither a safetensors file nor one of PyTorch"),
        (b"weights of a network\n", "neither a safetensors file nor one of PyTorch"),
        (b"ply\nformat ascii 1.0\n", "neither "),
        (old, "torch.save(torch.load('"),
        (b"PK\x03\x04", "a zip archive without its end"),
        (&claiming_entries(u64::MAX)[..], "claims 18446744073709551615 entries"),
        (b"\xff\xff\xff\xff\xff\xff\xff\x7f{}", "a header of 9223372036854775807 bytes in a file of 10"),
        (b"\x02\0\0\0\0\0\0\0{", "a header of 2 bytes in a file of 9"),
    ] {
        let line = said(opened(&files.put("x", content)));
        assert!(line.contains(says), "{line}");
    }
    assert!(said(opened(&files.path().join("no"))).contains("no: cannot be read: "));
    assert!(said(opened(files.path())).contains("it is no file"));
    for (header, says) in [
        (r#"{"a":1}"#, "damaged"),
        (r#"{"a":{"dtype":"F32","shape":[1],"data_offsets":[0,8]}}"#, "damaged"),
        (r#"{"a":{"dtype":"F32","shape":[9007199254740993,4096],"data_offsets":[0,8]}}"#, "damaged"),
        (r#"{"a":{"dtype":"F32","shape":[3],"data_offsets":[0,12]}}"#, "12 bytes of numbers in a file of "),
        (r#"{"a":{"dtype":"F32","shape":[1],"data_offsets":[0,4]}}"#, "4 bytes of numbers in a file of "),
        (r#"{"a":{"dtype":"F32","shape":[2],"data_offsets":[8,0]}}"#, "damaged"),
    ] {
        let line = said(opened(&files.put("x", with_header(header, &[0; 8]))));
        assert!(line.contains(says), "{header}: {line}");
    }
}

#[test]
fn cut_off_files_are_refused_wherever_they_end() {
    let files = Files::new();
    for whole in [safetensors(&two()), pth(&two())] {
        for end in 0..whole.len() {
            said(both(&files.put("x", &whole[..end])));
        }
    }
}

/// A byte may be the value of a number; all others are compared with something, or named.
#[test]
fn changed_bytes_are_refused_or_harmless() {
    let files = Files::new();
    for whole in [safetensors(&two()), pth(&two())] {
        for at in 0..whole.len() {
            for value in [0x00, 0xff, whole[at] ^ 1, whole[at] ^ 0x80] {
                let mut changed = whole.clone();
                changed[at] = value;
                if let Ok(values) = both(&files.put("x", &changed)) {
                    assert_eq!(values.len(), 8);
                }
            }
        }
    }
}

#[test]
fn archives_that_hold_no_tensors() {
    let files = Files::new();
    let archive =
        |pickle: &[u8]| zip(&[("x/data.pkl".into(), pickle.into()), ("x/data/0".into(), vec![0; 8])]);
    // Tuples of themselves, doubled a hundred times: more than any memory if they were copied.
    let mut doubled = b"\x80\x02)q\x00".to_vec();
    doubled.extend(b"h\x00h\x00\x86q\x00".repeat(100));
    doubled.push(b'.');
    let mut nested = vec![b')'];
    nested.extend([0x85; 1_000_000]);
    nested.push(b'.');
    for (content, says) in [
        (zip(&[("readme".into(), b"hello".to_vec())]), "a zip archive without data.pkl"),
        (archive(b"\x80\x02}."), "its data.pkl holds no tensors by name"),
        (archive(b"\x80\x02K\x05."), "its data.pkl holds no tensors by name"),
        (archive(b"\x80\x02}"), "its data.pkl breaks off"),
        (archive(b"\x80\x02X\xff\xff\xff\xff"), "its data.pkl breaks off"),
        (archive(b"."), "its data.pkl breaks off"),
        (archive(b"\x80\x02u."), "its data.pkl breaks off"),
        (archive(b"\x80\x04\x95."), "holds more than tensors by name"),
        (archive(&doubled), "holds no tensors by name"),
        (archive(&nested), "holds no tensors by name"),
    ] {
        let line = said(opened(&files.put("x", content)));
        assert!(line.contains(says), "{says}: {line}");
    }

    let whole = pth(&two());
    let changed = |from: &[u8], to: &[u8]| {
        let at = whole.windows(from.len()).position(|window| window == from).unwrap();
        [&whole[..at], to, &whole[at + from.len()..]].concat()
    };
    for (content, says) in [
        (changed(b"little", b"bigend"), "highest byte first"),
        // The strides of a: columns first.
        (changed(b"(J\x03\0\0\0J\x01\0\0\0t", b"(J\x01\0\0\0J\x02\0\0\0t"), "stored as not contiguous"),
        (changed(b"FloatStorage\n", b"LongsStorage\n"), "stored as LongsStorage"),
        // A first number beyond the storage.
        (changed(b"tQK\x00", b"tQK\x09"), "tensor a is larger than what is stored of it"),
    ] {
        let line = said(both(&files.put("x", content)));
        assert!(line.contains(says), "{says}: {line}");
    }
    // Packed: the method in the directory.
    let mut packed = whole.clone();
    let at = whole.windows(4).position(|window| window == b"PK\x01\x02").unwrap();
    packed[at + 10] = 8;
    assert!(said(both(&files.put("x", packed))).contains("compressed"));
}
