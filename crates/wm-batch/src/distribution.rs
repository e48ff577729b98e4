//! Distributions of values, by their inverse: a number from 0 to 1 in, a value out.

/// The distribution of a value. Limits cut it off: what is left has its shape.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Distribution {
    /// Even between two numbers.
    Uniform {
        /// The least.
        min: f64,
        /// The greatest.
        max: f64,
    },
    /// Even in the logarithm.
    LogUniform {
        /// The least, above 0.
        min: f64,
        /// The greatest.
        max: f64,
    },
    /// Normal.
    Normal {
        /// The mean.
        mean: f64,
        /// The standard deviation.
        deviation: f64,
        /// The least, if there is one.
        min: Option<f64>,
        /// The greatest, if there is one.
        max: Option<f64>,
    },
    /// Normal in the logarithm.
    LogNormal {
        /// The median.
        median: f64,
        /// The standard deviation of the natural logarithm.
        deviation: f64,
        /// The least, if there is one.
        min: Option<f64>,
        /// The greatest, if there is one.
        max: Option<f64>,
    },
    /// Weibull, as wind speeds have it.
    Weibull {
        /// The shape.
        shape: f64,
        /// The scale, of 63 % of the values below it.
        scale: f64,
        /// The least, if there is one.
        min: Option<f64>,
        /// The greatest, if there is one.
        max: Option<f64>,
    },
}

impl Distribution {
    /// Checks its numbers.
    ///
    /// # Errors
    /// The problem in words.
    pub(crate) fn check(&self) -> Result<(), String> {
        let above = |name: &str, value: f64| {
            if value.is_finite() && value > 0.0 {
                Ok(())
            } else {
                Err(format!("{name} is {value}: it must be above 0"))
            }
        };
        let [min, max] = self.limits();
        if min.is_nan() || max.is_nan() || min >= max {
            return Err(format!("min is {min} and max is {max}: min must be below max"));
        }
        match self {
            Self::Uniform { .. } if min.is_infinite() || max.is_infinite() => {
                Err("min and max must be finite".into())
            }
            Self::Uniform { .. } => Ok(()),
            Self::LogUniform { .. } if max.is_infinite() => Err("max must be finite".into()),
            Self::LogUniform { .. } => above("min", min),
            Self::Normal { mean, deviation, .. } => {
                if !mean.is_finite() {
                    return Err(format!("mean is {mean}: it must be finite"));
                }
                above("deviation", *deviation)
            }
            Self::LogNormal { median, deviation, .. } => {
                above("median", *median)?;
                above("deviation", *deviation)
            }
            Self::Weibull { shape, scale, .. } => {
                above("shape", *shape)?;
                above("scale", *scale)
            }
        }?;
        let [low, high] = self.shares();
        if high - low < 1e-9 {
            return Err(format!("nothing lies between min {min} and max {max}"));
        }
        Ok(())
    }

    fn limits(&self) -> [f64; 2] {
        match *self {
            Self::Uniform { min, max } | Self::LogUniform { min, max } => [min, max],
            Self::Normal { min, max, .. } => [min.unwrap_or(f64::NEG_INFINITY), max.unwrap_or(f64::INFINITY)],
            Self::LogNormal { min, max, .. } | Self::Weibull { min, max, .. } => {
                [min.unwrap_or(0.0), max.unwrap_or(f64::INFINITY)]
            }
        }
    }

    /// The value below which a share `x` of the values lies, 0 <= x < 1.
    pub(crate) fn value(&self, x: f64) -> f64 {
        let [min, max] = self.limits();
        match self {
            Self::Uniform { .. } => min + x * (max - min),
            Self::LogUniform { .. } => min * (max / min).powf(x),
            _ => {
                let [low, high] = self.shares();
                self.whole(low + x * (high - low)).clamp(min, max)
            }
        }
    }

    /// As [`Self::value`], without limits.
    fn whole(&self, x: f64) -> f64 {
        // Without limits, the ends are nearly never.
        let x = x.clamp(1e-12, 1.0 - 1e-12);
        match *self {
            Self::Normal { mean, deviation, .. } => mean + deviation * normal_quantile(x),
            Self::LogNormal { median, deviation, .. } => median * (deviation * normal_quantile(x)).exp(),
            Self::Weibull { shape, scale, .. } => scale * (-(-x).ln_1p()).powf(1.0 / shape),
            Self::Uniform { .. } | Self::LogUniform { .. } => self.value(x),
        }
    }

    /// The shares of the values of the whole distribution below its limits.
    fn shares(&self) -> [f64; 2] {
        self.limits().map(|limit| {
            let (mut low, mut high) = (0.0, 1.0);
            if limit == f64::INFINITY {
                return 1.0;
            }
            // The inverse rises, so that halving finds its inverse.
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if self.whole(middle) < limit { low = middle } else { high = middle }
            }
            if low == 0.0 { 0.0 } else { 0.5 * (low + high) }
        })
    }
}

/// The quantile of the standard normal distribution, to 1.2e-9 of its value (Acklam's rational
/// functions).
fn normal_quantile(p: f64) -> f64 {
    const A: [f64; 6] = [
        -3.969_683_028_665_376e1,
        2.209_460_984_245_205e2,
        -2.759_285_104_469_687e2,
        1.383_577_518_672_69e2,
        -3.066_479_806_614_716e1,
        2.506_628_277_459_239,
    ];
    const B: [f64; 5] = [
        -5.447_609_879_822_406e1,
        1.615_858_368_580_409e2,
        -1.556_989_798_598_866e2,
        6.680_131_188_771_972e1,
        -1.328_068_155_288_572e1,
    ];
    const C: [f64; 6] = [
        -7.784_894_002_430_293e-3,
        -3.223_964_580_411_365e-1,
        -2.400_758_277_161_838,
        -2.549_732_539_343_734,
        4.374_664_141_464_968,
        2.938_163_982_698_783,
    ];
    const D: [f64; 4] =
        [7.784_695_709_041_462e-3, 3.224_671_290_700_398e-1, 2.445_134_137_142_996, 3.754_408_661_907_416];
    let horner = |c: &[f64], x: f64| c.iter().fold(0.0, |sum, c| sum * x + c);
    let tail = |p: f64| {
        let q = (-2.0 * p.ln()).sqrt();
        horner(&C, q) / (horner(&D, q) * q + 1.0)
    };
    if p < 0.024_25 {
        tail(p)
    } else if p > 1.0 - 0.024_25 {
        -tail(1.0 - p)
    } else {
        let q = p - 0.5;
        let r = q * q;
        horner(&A, r) * q / (horner(&B, r) * r + 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        // Abramowitz and Stegun, table 26.5; the rational functions are good to 1.2e-9 of the
        // value.
        for (p, x) in [
            (0.5, 0.0),
            (0.841_344_746, 1.0),
            (0.977_249_868, 2.0),
            (0.001_349_898, -3.0),
            (0.975, 1.959_963_985),
        ] {
            assert!((normal_quantile(p) - x).abs() < 1e-7, "{p}");
        }
    }

    #[test]
    fn limits_cut_off_and_leave_the_shape() {
        let cut = Distribution::LogNormal { median: 2.0, deviation: 1.2, min: None, max: Some(4.0) };
        cut.check().unwrap();
        let whole = Distribution::LogNormal { median: 2.0, deviation: 1.2, min: None, max: None };
        // Of the whole, share(4) lie below 4; half of these lie below the median of what is cut
        // off.
        let share =
            (0..100_000).filter(|k| whole.value((f64::from(*k) + 0.5) / 1e5) < 4.0).count() as f64 / 1e5;
        assert!((whole.value(0.5 * share) - cut.value(0.5)).abs() < 1e-3);
        assert!(cut.value(0.999_999) <= 4.0 && cut.value(0.0) >= 0.0);
        let wind = Distribution::Weibull { shape: 2.0, scale: 5.0, min: None, max: None };
        assert!((wind.value(1.0 - (-1f64).exp()) - 5.0).abs() < 1e-9);
        let fog = Distribution::LogUniform { min: 30.0, max: 2000.0 };
        assert!((fog.value(0.5) - (30.0f64 * 2000.0).sqrt()).abs() < 1e-9);
    }

    #[test]
    fn wrong_numbers_are_named() {
        for (bad, says) in [
            (Distribution::Uniform { min: 2.0, max: 1.0 }, "min is 2"),
            (Distribution::LogUniform { min: 0.0, max: 1.0 }, "min is 0"),
            (Distribution::Normal { mean: 0.0, deviation: -1.0, min: None, max: None }, "deviation"),
            (Distribution::Normal { mean: 0.0, deviation: 1.0, min: Some(90.0), max: None }, "nothing lies"),
            (Distribution::Weibull { shape: 0.0, scale: 1.0, min: None, max: None }, "shape"),
        ] {
            let fault = bad.check().unwrap_err();
            assert!(fault.contains(says), "{fault}");
        }
    }
}
