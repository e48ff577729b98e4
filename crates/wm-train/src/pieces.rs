//! Connected pieces of a picture.

/// Returns the indices of the pixels left, right, above and below one, of those inside a picture of
/// so many pixels.
pub(crate) fn beside(pixel: usize, width: usize, pixels: usize) -> impl Iterator<Item = usize> {
    let x = pixel % width;
    let left = (x > 0).then(|| pixel - 1);
    let right = (x + 1 < width).then_some(pixel + 1);
    let below = Some(pixel + width).filter(|pixel| *pixel < pixels);
    [left, right, pixel.checked_sub(width), below].into_iter().flatten()
}

/// Returns the connected pieces of the pixels in `left`, `[H, W]`, in the order of their first:
/// neighbours that `joins` are of one piece.
pub(crate) fn pieces(
    mut left: Vec<bool>,
    width: usize,
    joins: impl Fn(usize, usize) -> bool,
) -> Vec<Vec<usize>> {
    let pixels = left.len();
    let mut pieces = Vec::new();
    for start in 0..pixels {
        if !std::mem::take(&mut left[start]) {
            continue;
        }
        let mut piece = vec![start];
        let mut next = 0;
        while next < piece.len() {
            let pixel = piece[next];
            for near in beside(pixel, width, pixels) {
                if left[near] && joins(pixel, near) {
                    left[near] = false;
                    piece.push(near);
                }
            }
            next += 1;
        }
        pieces.push(piece);
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_join_beside_but_not_across_or_around_the_border() {
        let picture = [1, 1, 0, 1, 0, 0, 1, 0, 1, 0, 0, 1].map(|v| v == 1);
        let all = pieces(picture.to_vec(), 4, |_, _| true);
        assert_eq!(all, [vec![0, 1], vec![3], vec![6], vec![8], vec![11]]);
        let apart = pieces(picture.to_vec(), 4, |a, b| (a, b) != (0, 1));
        assert_eq!(apart.len(), 6);
        assert_eq!(beside(0, 4, 12).collect::<Vec<_>>(), [1, 4]);
        assert_eq!(beside(11, 4, 12).collect::<Vec<_>>(), [10, 7]);
    }
}
