//! The Gaussians of a scene, structure of arrays, in their stored form.

use crate::{Group, sh};
use serde::{Deserialize, Serialize};
use thiserror::Error;
use wm_base::Problem;

/// A set of Gaussians in stored form: what training learns and files keep.
///
/// Stored and activated forms have different names: `log_scales` -> `scales` by `exp`,
/// `logit_opacities` -> `opacities` by the logistic function, `quats` are used at length 1,
/// `sh` -> colour by [`sh::color`]. N splats, K = `(sh_degree + 1)^2`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Splats {
    /// Centres, world axes, scene units, `[N, 3]`.
    pub means: Vec<[f32; 3]>,
    /// Orientations, wxyz, of any length but 0, `[N, 4]`.
    pub quats: Vec<[f32; 4]>,
    /// Natural logarithm of the standard deviations along the splat's own axes, `[N, 3]`.
    pub log_scales: Vec<[f32; 3]>,
    /// Logit of the opacity, `[N]`.
    pub logit_opacities: Vec<f32>,
    /// Spherical harmonics, `[N, K, 3]` flat: coefficient by coefficient, channels innermost.
    pub sh: Vec<f32>,
    /// Degree of `sh`, 0 to 3.
    pub sh_degree: u8,
    /// The part of the scene that each splat belongs to, `[N]`.
    pub groups: Vec<Group>,
    /// The number of each splat's class, such as road or building, `[N]`; 0 for none. Empty if no
    /// splat has one.
    #[serde(default)]
    pub labels: Vec<u16>,
    /// The number of the thing that each splat is a part of, `[N]`; 0 for none. Empty if no splat
    /// has one.
    #[serde(default)]
    pub instances: Vec<u16>,
}

/// The kinds of names that splats may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LabelKind {
    /// The class of what a splat shows: [`Splats::labels`].
    Label,
    /// The single thing that it is a part of: [`Splats::instances`].
    Instance,
}

impl LabelKind {
    /// Both kinds.
    pub const ALL: [Self; 2] = [Self::Label, Self::Instance];

    /// The name of the property of a PLY.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Label => "label",
            Self::Instance => "instance",
        }
    }
}

/// The reason why arrays do not make a set of splats.
#[derive(Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum SplatsError {
    /// An array has another length than `means`.
    #[error("`{array}` has {found} values, {expected} expected for {splats} splats")]
    Length {
        /// Name of the array.
        array: &'static str,
        /// Length of the array.
        found: usize,
        /// The length that fits `means`.
        expected: usize,
        /// Length of `means`.
        splats: usize,
    },
    /// `sh_degree` is above 3.
    #[error("SH degree {0} is not supported, the highest is 3")]
    Degree(u8),
}

impl From<SplatsError> for Problem {
    fn from(error: SplatsError) -> Self {
        Self::Splats(error.to_string())
    }
}

/// One splat in stored form, for code that makes scenes splat by splat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Centre, scene units.
    pub mean: [f32; 3],
    /// Orientation, wxyz.
    pub quat: [f32; 4],
    /// Logarithm of the standard deviations.
    pub log_scale: [f32; 3],
    /// Logit of the opacity.
    pub logit_opacity: f32,
    /// Display-referred colour, 0-1, the same from everywhere.
    pub rgb: [f32; 3],
    /// The part of the scene that it belongs to.
    pub group: Group,
}

impl Splats {
    /// An empty set of the given SH degree.
    ///
    /// # Panics
    /// If `sh_degree` is above 3.
    #[must_use]
    pub fn with_capacity(capacity: usize, sh_degree: u8) -> Self {
        assert!(sh_degree <= sh::MAX_DEGREE, "SH degree {sh_degree}");
        Self {
            means: Vec::with_capacity(capacity),
            quats: Vec::with_capacity(capacity),
            log_scales: Vec::with_capacity(capacity),
            logit_opacities: Vec::with_capacity(capacity),
            sh: Vec::with_capacity(capacity * sh::coefficients(sh_degree) * 3),
            sh_degree,
            groups: Vec::with_capacity(capacity),
            labels: Vec::new(),
            instances: Vec::new(),
        }
    }

    /// `count` splats with all values 0.
    ///
    /// # Panics
    /// If `sh_degree` is above 3.
    #[must_use]
    pub fn zeroed(count: usize, sh_degree: u8) -> Self {
        assert!(sh_degree <= sh::MAX_DEGREE, "SH degree {sh_degree}");
        // `vec!` of zeros takes pages that the system has cleared already; pushing would write them
        // twice.
        Self {
            means: vec![[0.0; 3]; count],
            quats: vec![[0.0; 4]; count],
            log_scales: vec![[0.0; 3]; count],
            logit_opacities: vec![0.0; count],
            sh: vec![0.0; count * sh::coefficients(sh_degree) * 3],
            sh_degree,
            groups: vec![Group::default(); count],
            labels: Vec::new(),
            instances: Vec::new(),
        }
    }

    /// Makes it `count` splats, new ones with all values 0.
    pub(crate) fn resize(&mut self, count: usize) {
        let sh_size = count * self.sh_stride();
        self.means.resize(count, [0.0; 3]);
        self.quats.resize(count, [0.0; 4]);
        self.log_scales.resize(count, [0.0; 3]);
        self.logit_opacities.resize(count, 0.0);
        self.sh.resize(sh_size, 0.0);
        self.groups.resize(count, Group::default());
        self.resize_names(count);
    }

    fn resize_names(&mut self, count: usize) {
        for kind in LabelKind::ALL {
            if !self.names(kind).is_empty() {
                self.names_mut(kind).resize(count, 0);
            }
        }
    }

    /// The labels or the instances; empty if no splat has one.
    #[must_use]
    pub fn names(&self, kind: LabelKind) -> &[u16] {
        match kind {
            LabelKind::Label => &self.labels,
            LabelKind::Instance => &self.instances,
        }
    }

    /// The labels or the instances, to be changed: none, or one a splat.
    pub fn names_mut(&mut self, kind: LabelKind) -> &mut Vec<u16> {
        match kind {
            LabelKind::Label => &mut self.labels,
            LabelKind::Instance => &mut self.instances,
        }
    }

    /// Number of splats, N.
    #[must_use]
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// Returns true if there is no splat.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// Values of `sh` a splat: 3 K.
    #[must_use]
    pub fn sh_stride(&self) -> usize {
        sh::coefficients(self.sh_degree) * 3
    }

    /// The SH coefficients of splat `index`, `[K, 3]` flat.
    #[must_use]
    pub fn sh_of(&self, index: usize) -> &[f32] {
        let stride = self.sh_stride();
        &self.sh[index * stride..(index + 1) * stride]
    }

    /// Standard deviations of splat `index` along its own axes, scene units.
    #[must_use]
    pub fn scales(&self, index: usize) -> [f64; 3] {
        self.log_scales[index].map(|v| f64::from(v).exp())
    }

    /// Opacity of splat `index`, 0-1.
    #[must_use]
    pub fn opacity(&self, index: usize) -> f64 {
        sigmoid(f64::from(self.logit_opacities[index]))
    }

    /// The shortest axis of splat `index` in world axes, length 1, its sign free.
    #[must_use]
    pub fn normal(&self, index: usize) -> [f64; 3] {
        let matrix = crate::quat::to_matrix(self.quats[index].map(f64::from));
        let axis = shortest_axis(self.log_scales[index]);
        [matrix[0][axis], matrix[1][axis], matrix[2][axis]]
    }

    /// Display-referred colour of a splat as seen from all sides on average, unclamped: that of SH
    /// degree 0.
    #[must_use]
    pub fn base_color(&self, index: usize) -> [f64; 3] {
        let sh = self.sh_of(index);
        [0, 1, 2].map(|k| 0.5 + sh::C0 * f64::from(sh[k]))
    }

    /// Adds the splats of another set; SH coefficients that it has more are left out, those that it
    /// lacks are 0.
    pub fn append(&mut self, other: &Self) {
        let (own, all) = (self.len(), self.len() + other.len());
        for kind in LabelKind::ALL {
            let more = other.names(kind);
            if !(more.is_empty() && self.names(kind).is_empty()) {
                let names = self.names_mut(kind);
                names.resize(own, 0);
                names.extend_from_slice(more);
                names.resize(all, 0);
            }
        }
        self.means.extend_from_slice(&other.means);
        self.quats.extend_from_slice(&other.quats);
        self.log_scales.extend_from_slice(&other.log_scales);
        self.logit_opacities.extend_from_slice(&other.logit_opacities);
        self.groups.extend_from_slice(&other.groups);
        let stride = self.sh_stride();
        for index in 0..other.len() {
            let (own, end) = (other.sh_of(index), self.sh.len() + stride);
            self.sh.extend_from_slice(&own[..own.len().min(stride)]);
            self.sh.resize(end, 0.0);
        }
    }

    /// The splats of both sets, with the higher of their SH degrees.
    #[must_use]
    pub fn joined(mut a: Self, b: Self) -> Self {
        if a.is_empty() {
            return b;
        }
        if a.sh_degree < b.sh_degree {
            let mut wide = Self::with_capacity(a.len() + b.len(), b.sh_degree);
            wide.append(&a);
            a = wide;
        }
        a.append(&b);
        a
    }

    /// Leaves out SH above `degree`.
    pub fn limit_sh(&mut self, degree: u8) {
        if degree >= self.sh_degree {
            return;
        }
        let (old, new) = (self.sh_stride(), sh::coefficients(degree) * 3);
        for index in 0..self.len() {
            self.sh.copy_within(index * old..index * old + new, index * new);
        }
        self.sh.truncate(self.len() * new);
        self.sh_degree = degree;
    }

    /// Adds one splat; its higher SH coefficients are 0.
    pub fn push(&mut self, splat: &Splat) {
        self.means.push(splat.mean);
        self.quats.push(splat.quat);
        self.log_scales.push(splat.log_scale);
        self.logit_opacities.push(splat.logit_opacity);
        self.sh.extend(splat.rgb.map(|c| sh::dc_of(f64::from(c)) as f32));
        self.sh.extend(std::iter::repeat_n(0.0, self.sh_stride() - 3));
        self.groups.push(splat.group);
        self.resize_names(self.len());
    }

    /// Checks that all arrays fit each other.
    ///
    /// # Errors
    /// [`SplatsError`] names the array that does not.
    pub fn check(&self) -> Result<(), SplatsError> {
        if self.sh_degree > sh::MAX_DEGREE {
            return Err(SplatsError::Degree(self.sh_degree));
        }
        let splats = self.len();
        for (array, found, expected) in [
            ("quats", self.quats.len(), splats),
            ("log_scales", self.log_scales.len(), splats),
            ("logit_opacities", self.logit_opacities.len(), splats),
            ("groups", self.groups.len(), splats),
            ("sh", self.sh.len(), splats * self.sh_stride()),
        ] {
            if found != expected {
                return Err(SplatsError::Length { array, found, expected, splats });
            }
        }
        for (array, found) in [("labels", self.labels.len()), ("instances", self.instances.len())] {
            if found != 0 && found != splats {
                return Err(SplatsError::Length { array, found, expected: splats, splats });
            }
        }
        Ok(())
    }

    /// The splats at `indices`, in that order; an index may repeat.
    ///
    /// # Panics
    /// If an index is not below [`Self::len`].
    #[must_use]
    pub fn select(&self, indices: &[usize]) -> Self {
        let mut out = Self::with_capacity(indices.len(), self.sh_degree);
        for &index in indices {
            out.means.push(self.means[index]);
            out.quats.push(self.quats[index]);
            out.log_scales.push(self.log_scales[index]);
            out.logit_opacities.push(self.logit_opacities[index]);
            out.sh.extend_from_slice(self.sh_of(index));
            out.groups.push(self.groups[index]);
        }
        for kind in LabelKind::ALL {
            let names = self.names(kind);
            if !names.is_empty() {
                *out.names_mut(kind) = indices.iter().map(|index| names[*index]).collect();
            }
        }
        out
    }
}

/// The logistic function: logit to opacity.
#[must_use]
pub fn sigmoid(logit: f64) -> f64 {
    1.0 / (1.0 + (-logit).exp())
}

/// The inverse of [`sigmoid`]; `opacity` is kept inside `[1e-7, 1 - 1e-7]` so that it stays finite.
#[must_use]
pub fn logit(opacity: f64) -> f64 {
    let opacity = opacity.clamp(1e-7, 1.0 - 1e-7);
    (opacity / (1.0 - opacity)).ln()
}

/// Index of the smallest of three scales; the first of equal ones.
#[must_use]
pub fn shortest_axis(scales: [f32; 3]) -> usize {
    let mut axis = 0;
    for candidate in 1..3 {
        if scales[candidate] < scales[axis] {
            axis = candidate;
        }
    }
    axis
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::SPLAT;

    fn one() -> Splat {
        Splat { mean: [1.0, 2.0, 3.0], log_scale: [-1.0, -3.0, -2.0], group: Group::Sky, ..SPLAT }
    }

    #[test]
    fn pushed_splats_come_back() {
        let mut splats = Splats::with_capacity(2, 2);
        splats.push(&one());
        splats.push(&Splat { mean: [0.0; 3], group: Group::Scene, ..one() });
        assert_eq!(splats.check(), Ok(()));
        assert_eq!(splats.sh_of(1).len(), 27);
        let swapped = splats.select(&[1, 0]);
        assert_eq!(swapped.groups, [Group::Scene, Group::Sky]);
        assert_eq!(swapped.means[1], [1.0, 2.0, 3.0]);
        assert_eq!(swapped.normal(0), [0.0, 1.0, 0.0]);
        assert!((swapped.opacity(0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn labels_go_with_their_splats() {
        let mut splats = Splats::with_capacity(2, 0);
        splats.push(&one());
        splats.labels = vec![7];
        splats.push(&one());
        assert_eq!((splats.check(), &splats.labels[..]), (Ok(()), &[7, 0][..]));
        splats.labels[1] = 65535;
        assert_eq!(splats.select(&[1, 1, 0]).labels, [65535, 65535, 7]);
        let mut other = Splats::with_capacity(1, 0);
        other.push(&one());
        other.instances = vec![3];
        for both in [Splats::joined(splats.clone(), other.clone()), {
            let mut both = splats.clone();
            both.append(&other);
            both
        }] {
            assert_eq!((&both.labels[..], &both.instances[..]), (&[7, 65535, 0][..], &[0, 0, 3][..]));
            assert_eq!(both.check(), Ok(()));
        }
        splats.resize(3);
        assert_eq!((splats.labels.len(), splats.instances.len()), (3, 0));
        splats.labels.pop();
        assert!(matches!(splats.check(), Err(SplatsError::Length { array: "labels", .. })));
    }

    #[test]
    fn a_short_array_is_named() {
        let mut splats = Splats::with_capacity(1, 0);
        splats.push(&one());
        splats.quats.clear();
        let error = splats.check().unwrap_err();
        assert_eq!(error, SplatsError::Length { array: "quats", found: 0, expected: 1, splats: 1 });
    }

    #[test]
    fn logit_undoes_sigmoid() {
        for opacity in [0.001, 0.1, 0.5, 0.99] {
            assert!((sigmoid(logit(opacity)) - opacity).abs() < 1e-12);
        }
    }
}
