//! Arrays for NumPy in memory, format version 1.0.

/// An array of f32 of a shape, the last axis fastest.
pub(crate) fn floats(values: impl Iterator<Item = f32>, shape: &[usize]) -> Vec<u8> {
    let mut out = header("<f4", shape);
    out.extend(values.flat_map(f32::to_le_bytes));
    out
}

/// An array of u8 of a shape, the last axis fastest.
pub(crate) fn bytes(values: &[u8], shape: &[usize]) -> Vec<u8> {
    let mut out = header("|u1", shape);
    out.extend(values);
    out
}

/// Magic, version, length and a Python dictionary padded to a multiple of 64 bytes.
fn header(kind: &str, shape: &[usize]) -> Vec<u8> {
    const FIXED: usize = 10;
    let sides: Vec<String> = shape.iter().map(usize::to_string).collect();
    let sides = sides.join(", ");
    let mut text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({sides}), }}");
    let length = (FIXED + text.len() + 1).next_multiple_of(64);
    text.extend(std::iter::repeat_n(' ', length - FIXED - text.len() - 1));
    text.push('\n');
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend(((length - FIXED) as u16).to_le_bytes());
    out.extend(text.into_bytes());
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_is_that_of_the_reader() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let values: Vec<f32> = (0..24u8).map(f32::from).collect();
        std::fs::write(&path, floats(values.iter().copied(), &[3, 4, 2])).unwrap();
        assert_eq!(wm_scene::npy::read(&path).unwrap(), (values, vec![3, 4, 2]));
        assert_eq!(bytes(&[1, 2], &[1, 2]).len(), 130);
    }
}
