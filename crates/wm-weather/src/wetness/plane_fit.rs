//! The plane through points of ground.

/// Sums over points of ground, by which the plane through them is fitted.
#[derive(Default)]
pub(super) struct PlaneFit {
    count: f64,
    /// Sums of x, y and the height.
    sums: [f64; 3],
    /// Sums of x x, x y, y y, x times the height, y times the height and of the height's square.
    products: [f64; 6],
}

/// The plane through points of ground.
pub(super) struct Plane {
    /// Slopes along x and y.
    pub(super) slopes: [f64; 2],
    /// The mean point.
    pub(super) mean: [f64; 3],
    /// Variance of the heights about it.
    pub(super) variance: f64,
}

impl PlaneFit {
    pub(super) fn add(&mut self, point: [f64; 2], height: f64) {
        let [x, y] = point;
        self.count += 1.0;
        [x, y, height].iter().zip(&mut self.sums).for_each(|(v, sum)| *sum += v);
        let products = [x * x, x * y, y * y, x * height, y * height, height * height];
        products.iter().zip(&mut self.products).for_each(|(v, sum)| *sum += v);
    }

    /// Returns `None` for fewer than `least` points, and where the determinant of their covariance
    /// is below `flattest`: they lie on a line.
    pub(super) fn plane(&self, least: f64, flattest: f64) -> Option<Plane> {
        let mean @ [mx, my, mh] = self.sums.map(|sum| sum / self.count);
        let [xx, xy, yy, xh, yh, hh] = self.products.map(|sum| sum / self.count);
        let (xx, xy, yy) = (xx - mx * mx, xy - mx * my, yy - my * my);
        let (xh, yh, hh) = (xh - mx * mh, yh - my * mh, hh - mh * mh);
        let det = xx * yy - xy * xy;
        let slopes = [(xh * yy - yh * xy) / det, (yh * xx - xh * xy) / det];
        let variance = hh - slopes[0] * xh - slopes[1] * yh;
        (self.count >= least && det >= flattest).then_some(Plane { slopes, mean, variance })
    }
}
