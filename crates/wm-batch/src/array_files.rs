//! Arrays for NumPy in memory, format version 1.0.

use wm_base::npy::header;

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_is_that_of_the_reader() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let values: Vec<f32> = (0..24u8).map(f32::from).collect();
        std::fs::write(&path, floats(values.iter().copied(), &[3, 4, 2])).unwrap();
        assert_eq!(wm_base::npy::read(&path).unwrap(), (values, vec![3, 4, 2]));
        assert_eq!(bytes(&[1, 2], &[1, 2]).len(), 130);
    }
}
