//! Normals from inverse depth (`N_pseudo` in the paper).
//!
//! Each normal is that of the plane `1 / z = a x + b y + c` that fits the window around a pixel
//! best. Inverse depth is linear over the image of a plane, so this is exact on planes, and the
//! window averages noise.

use wm_scene::Camera;

/// Largest relative difference of the depths of neighbours on one surface.
const SURFACE_TOLERANCE: f32 = 0.05;
/// Least share of known pixels in a window.
const MIN_KNOWN_SHARE: f64 = 0.4;

/// Returns normals, `[H, W, 3]`, world axes, towards the camera, from inverse depth `[H, W]` in
/// windows of `2 radius + 1` px; 0 where too little is known and in the sky. `camera` has the size
/// of the image.
pub(crate) fn normals(inverse: &[f32], camera: &Camera, radius: usize) -> Vec<[f32; 3]> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let world_from_camera = camera.rotation().transpose();
    let wanted = MIN_KNOWN_SHARE * ((2 * radius + 1) * (2 * radius + 1)) as f64;
    let at = |pixel: usize| {
        let (column, row) = (pixel % width, pixel / width);
        let middle = inverse[pixel];
        if middle.is_nan() || middle <= 0.0 {
            return [0.0; 3];
        }
        let (mut n, mut sums, mut squares) = (0.0f64, [0.0f64; 3], [0.0f64; 5]);
        for y in row.saturating_sub(radius)..(row + radius + 1).min(height) {
            for x in column.saturating_sub(radius)..(column + radius + 1).min(width) {
                let value = inverse[y * width + x];
                // This form of the comparison excludes NaN.
                let is_near = (value / middle - 1.0).abs() <= SURFACE_TOLERANCE;
                if !is_near {
                    continue;
                }
                let (dx, dy) = (x as f64 - column as f64, y as f64 - row as f64);
                let off = f64::from(value - middle);
                n += 1.0;
                for (sum, v) in sums.iter_mut().zip([dx, dy, off]) {
                    *sum += v;
                }
                for (sum, v) in squares.iter_mut().zip([dx * dx, dx * dy, dy * dy, dx * off, dy * off]) {
                    *sum += v;
                }
            }
        }
        let ([sx, sy, so], [xx, xy, yy, xo, yo]) = (sums, squares);
        let (xx, xy, yy) = (xx - sx * sx / n, xy - sx * sy / n, yy - sy * sy / n);
        let (xo, yo) = (xo - sx * so / n, yo - sy * so / n);
        let determinant = xx * yy - xy * xy;
        if n < wanted || determinant < 1e-3 * xx * yy {
            return [0.0; 3];
        }
        let (a, b) = ((yy * xo - xy * yo) / determinant, (xx * yo - xy * xo) / determinant);
        // Uses the plane's value at the centre, not the noisy value itself.
        let at_middle = f64::from(middle) + (so - a * sx - b * sy) / n;
        let (x, y) = (column as f64 + 0.5 - camera.cx, row as f64 + 0.5 - camera.cy);
        // q . ray is the inverse depth, above 0: q points away.
        let q = glam::DVec3::new(a * camera.fx, b * camera.fy, at_middle - a * x - b * y);
        (world_from_camera * -q.normalize_or_zero()).to_array().map(|v| v as f32)
    };
    (0..inverse.len()).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use wm_base::random::uniform;

    #[test]
    fn the_normal_of_a_noisy_plane_is_found() {
        let camera =
            Camera::looking((60, 40), 50.0, DVec3::new(1.0, -9.0, 2.0), DVec3::ZERO, DVec3::Z).unwrap();
        for normal in
            [DVec3::Z, DVec3::new(0.3, -0.8, 0.5).normalize(), DVec3::new(-0.5, -0.5, 0.1).normalize()]
        {
            let mut inverse = Vec::new();
            for pixel in 0..2400u32 {
                let ray = camera.ray(f64::from(pixel % 60) + 0.5, f64::from(pixel / 60) + 0.5);
                // The plane through the origin; view z of the point is that of its offset from the
                // camera.
                let t = -normal.dot(camera.center()) / normal.dot(ray);
                let z = camera.viewmat.transform_point3(camera.center() + ray * t).z;
                let noise = 1.0 + 0.002 * (uniform(4, pixel.into()) - 0.5);
                inverse.push(if t > 0.0 && z < 60.0 { (noise / z) as f32 } else { f32::NAN });
            }
            let found = normals(&inverse, &camera, 3);
            let mut worst = 0.0f64;
            let mut count = 0;
            for n in found.iter().filter(|n| **n != [0.0; 3]) {
                let n = DVec3::from_array(n.map(f64::from));
                worst = worst.max(n.angle_between(normal).to_degrees());
                count += 1;
            }
            // Noise of 0.06 % (standard deviation) over 49 px at steps of a 40th of the distance:
            // 0.4 degrees.
            assert!(count > 400 && worst < 1.5, "{count} {worst}");
        }
        assert_eq!(normals(&[f32::NAN; 2400], &camera, 2), vec![[0.0; 3]; 2400]);
    }
}
