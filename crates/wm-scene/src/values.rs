//! The values that a splat may hold: one table for every reader, writer and renderer.
//!
//! | value | meaning | written to formats with less room |
//! |---|---|---|
//! | a logarithm of a scale of -infinity | flat: of no thickness along that axis | as their least scale; SOG and compressed PLY have entries for it |
//! | a logit of +infinity, -infinity | opaque, invisible | as opacity 1, 0 |
//! | a quaternion of zeros | no rotation | as the identity |
//! | a coordinate that is NaN, infinite or beyond [`MAX_SCENE_COORDINATE`] | a fault | |
//! | a logarithm of a scale that is NaN or above [`MAX_LOG_SCALE`] | a fault | |
//! | a logit that is NaN | a fault | |
//! | a part of a quaternion that is NaN or beyond 1e15 | a fault | |
//! | a coefficient of colour that is NaN or beyond 1e6 | a fault | |
//! | a row of zeros: position, rotation, scales, opacity and colour | a fault: a row that was never filled | |
//!
//! A reader gives a splat with a fault as the file has it. [`Splats::check_finite`] refuses such
//! splats, [`Splats::repaired`] leaves them out, and renderers pass them over. Readers of JSON take
//! a `null` in a table of values for one that continues the others.

use crate::Splats;

/// Largest coordinate of a splat, scene units, either sign: squares of distances, and of these and
/// scales together, stay within single precision. Far beyond is no place, but a damaged file.
pub const MAX_SCENE_COORDINATE: f32 = 1e10;

/// Largest stored scale that is taken for a number: its square still fits f32 with room for a
/// camera.
pub const MAX_LOG_SCALE: f32 = 30.0;

/// The stored scale that stands for a flat axis in tables and ranges, which hold no infinity:
/// 10^-13 units.
pub(crate) const FLAT_LOG_SCALE: f32 = -30.0;

/// Largest part of a quaternion, either sign: the square of its length stays within single
/// precision.
pub(crate) const MAX_QUAT: f32 = 1e15;

/// Largest coefficient of spherical harmonics, either sign: a light a million times as bright as
/// white.
pub(crate) const MAX_SH: f32 = 1e6;

/// Returns the least and the greatest value along each axis, without regard to NaN. The least is
/// infinity and the greatest -infinity if there is no other value.
pub(crate) fn ends(values: impl IntoIterator<Item = [f32; 3]>) -> [[f32; 3]; 2] {
    let [mut low, mut high] = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for value in values {
        for k in 0..3 {
            (low[k], high[k]) = (low[k].min(value[k]), high[k].max(value[k]));
        }
    }
    [low, high]
}

/// Returns NaN in place of infinities, for [`ends`].
pub(crate) fn finite(values: [f32; 3]) -> [f32; 3] {
    values.map(|v| if v.is_finite() { v } else { f32::NAN })
}

/// The faults of one splat, array by array.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// The mean is NaN, infinite or beyond [`MAX_SCENE_COORDINATE`].
    pub mean: bool,
    /// A scale is NaN or above [`MAX_LOG_SCALE`].
    pub scale: bool,
    /// The opacity is NaN.
    pub opacity: bool,
    /// The quaternion is NaN, infinite or beyond 1e15.
    pub quat: bool,
    /// The quaternion is zero. It is drawn as no rotation, and only told.
    pub zero_quat: bool,
    /// A colour coefficient is NaN, infinite or beyond 1e6.
    pub sh: bool,
    /// All values are zero.
    pub blank: bool,
}

impl Faults {
    /// Returns true if the splat cannot be drawn.
    #[must_use]
    pub(crate) fn is_fatal(self) -> bool {
        Self { zero_quat: false, ..self } != Self::default()
    }
}

impl Splats {
    /// Returns true if splat `index` has no fault, that of a zero quaternion included.
    #[must_use]
    pub fn is_sound(&self, index: usize) -> bool {
        self.faults(index) == Faults::default()
    }

    /// The faults of splat `index`.
    #[must_use]
    pub fn faults(&self, index: usize) -> Faults {
        // NaN is within no limit.
        let within = |values: &[f32], most: f32| values.iter().all(|v| v.abs() <= most);
        let (mean, quat) = (&self.means[index], &self.quats[index]);
        let (log_scale, logit) = (&self.log_scales[index], self.logit_opacities[index]);
        let sh = self.sh_of(index);
        let squared: f64 = quat.iter().map(|v| f64::from(*v).powi(2)).sum();
        let zero_quat = squared < 1e-30;
        let is_zero = |values: &[f32]| values.iter().all(|v| *v == 0.0);
        Faults {
            mean: !within(mean, MAX_SCENE_COORDINATE),
            scale: !log_scale.iter().all(|v| *v <= MAX_LOG_SCALE),
            opacity: logit.is_nan(),
            quat: !within(quat, MAX_QUAT),
            zero_quat,
            sh: !within(sh, MAX_SH),
            blank: zero_quat && logit == 0.0 && is_zero(mean) && is_zero(log_scale) && is_zero(sh),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Group, splats::Splat};

    #[test]
    fn the_table_is_kept() {
        let sound = Splat {
            mean: [MAX_SCENE_COORDINATE, 2.0, -MAX_SCENE_COORDINATE],
            quat: [MAX_QUAT, 0.0, 0.0, 0.0],
            log_scale: [MAX_LOG_SCALE, f32::NEG_INFINITY, -2.0],
            logit_opacity: f32::INFINITY,
            rgb: [0.25, 0.5, 0.75],
            group: Group::Sky,
        };
        let faults = |change: &dyn Fn(&mut Splats)| {
            let mut splats = Splats::with_capacity(1, 1);
            splats.push(&sound);
            change(&mut splats);
            splats.faults(0)
        };
        let none = Faults::default();
        assert_eq!(faults(&|_| ()), none);
        assert_eq!(faults(&|s| s.logit_opacities[0] = f32::NEG_INFINITY), none);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e20, -1e20] {
            assert_eq!(faults(&|s| s.means[0][2] = bad), Faults { mean: true, ..none }, "{bad}");
            assert_eq!(faults(&|s| s.quats[0][1] = bad), Faults { quat: true, ..none }, "{bad}");
            assert_eq!(faults(&|s| s.sh[7] = bad), Faults { sh: true, ..none }, "{bad}");
        }
        for bad in [f32::NAN, f32::INFINITY, 60.0] {
            assert_eq!(faults(&|s| s.log_scales[0][0] = bad), Faults { scale: true, ..none }, "{bad}");
        }
        assert_eq!(faults(&|s| s.logit_opacities[0] = f32::NAN), Faults { opacity: true, ..none });
        let zero = faults(&|s| s.quats[0] = [0.0; 4]);
        assert!(zero.zero_quat && !zero.is_fatal() && faults(&|s| s.means[0][0] = f32::NAN).is_fatal());
        let blank = Splats::zeroed(1, 1).faults(0);
        assert_eq!(blank, Faults { blank: true, zero_quat: true, ..none });
        assert!(blank.is_fatal());
    }
}
