//! The CPU back end's form of splats: activated, in Morton order, in groups of 16.

use crate::error::RenderError;
use crate::sizes::{CLUSTER, GROUP, GROUPS_PER_CLUSTER};
use crate::stages::intersect::MAX_SPLATS;
use rayon::prelude::*;
use wm_scene::{Group, Splats, morton, sh, splats::sigmoid};

/// Sixteen splats, as a structure of arrays.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct SplatGroup {
    /// Centres, world axes, scene units.
    pub(crate) mean: [[f32; GROUP]; 3],
    /// Unit quaternions, wxyz.
    pub(crate) quat: [[f32; GROUP]; 4],
    /// Standard deviations along the splat's own axes.
    pub(crate) scale: [[f32; GROUP]; 3],
    /// log2 of the opacity; [`NEVER_DRAWN_LOG2_OPACITY`] for padding.
    pub(crate) log2_opacity: [f32; GROUP],
    /// SH coefficient 0.
    pub(crate) dc: [[f32; GROUP]; 3],
}

/// log2 of an opacity far below every threshold, for padding.
pub(crate) const NEVER_DRAWN_LOG2_OPACITY: f32 = -1000.0;

/// The box and size of 256 neighbours, for culling.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cluster {
    /// Middle of the means' box.
    pub(crate) center: [f32; 3],
    /// Half its sides.
    pub(crate) half: [f32; 3],
    /// Largest standard deviation in the cluster, scene units.
    pub(crate) max_scale: f32,
}

/// A loaded set of splats.
#[derive(Debug)]
pub struct CpuModel {
    /// Number of splats, without padding.
    pub(crate) len: usize,
    /// Degree of the spherical harmonics.
    pub(crate) sh_degree: u8,
    /// `[ceil(N / 256) * 16]`.
    pub groups: Vec<SplatGroup>,
    /// Coefficients above 0, `[groups, K - 1, 3]` rows of 16 splats.
    pub sh_rest: Vec<[f32; GROUP]>,
    /// `[ceil(N / 256)]`.
    pub(crate) clusters: Vec<Cluster>,
    /// Index in the loaded [`Splats`] of each splat, padded with 0.
    pub(crate) source: Vec<u32>,
    /// For each group, a bit for each splat of the sky.
    pub(crate) sky: Vec<u16>,
}

impl CpuModel {
    /// Activates, checks and re-orders `splats`.
    ///
    /// # Errors
    /// [`RenderError`] if arrays do not fit, a number is not finite or there are too many.
    pub fn new(splats: &Splats) -> Result<Self, RenderError> {
        splats.check()?;
        if splats.len() > MAX_SPLATS {
            return Err(RenderError::TooMany(splats.len()));
        }
        let faulty = (0..splats.len()).into_par_iter().find_first(|i| {
            let faults = splats.faults(*i);
            faults.mean || faults.scale || faults.opacity || faults.quat || faults.sh
        });
        if let Some(index) = faulty {
            let faults = splats.faults(index);
            let value = [
                (faults.mean, "a position"),
                (faults.scale, "a scale"),
                (faults.opacity, "an opacity"),
                (faults.quat, "a rotation"),
            ];
            let value = value.into_iter().find(|(bad, _)| *bad).map_or("a colour", |(_, name)| name);
            return Err(RenderError::NotFinite { index, value });
        }

        let mut source = morton_order(&splats.means);
        let clusters = source.len().div_ceil(CLUSTER);
        source.resize(clusters * CLUSTER, 0);
        let rest = sh::coefficients(splats.sh_degree) - 1;
        let (len, rows) = (splats.len(), rest * 3);

        let groups: Vec<SplatGroup> = (0..clusters * GROUPS_PER_CLUSTER)
            .into_par_iter()
            .map(|group| activate(splats, &source[group * GROUP..(group + 1) * GROUP], group * GROUP, len))
            .collect();
        let mut sh_rest = vec![[0.0; GROUP]; groups.len() * rows];
        if rows > 0 {
            sh_rest.par_chunks_mut(rows).enumerate().for_each(|(group, out)| {
                for lane in 0..GROUP {
                    let coefficients = splats.sh_of(source[group * GROUP + lane] as usize);
                    for (row, value) in out.iter_mut().zip(&coefficients[3..]) {
                        row[lane] = *value;
                    }
                }
            });
        }
        let sky = (0..groups.len())
            .into_par_iter()
            .map(|group| {
                let lanes = &source[group * GROUP..(group + 1) * GROUP];
                let is_sky = |lane: usize| splats.groups[lanes[lane] as usize] == Group::Sky;
                (0..GROUP).map(|lane| u16::from(is_sky(lane)) << lane).sum()
            })
            .collect();
        let clusters = (0..clusters)
            .into_par_iter()
            .map(|cluster| bound(splats, &source[cluster * CLUSTER..len.min((cluster + 1) * CLUSTER)]))
            .collect();
        Ok(Self { len, sh_degree: splats.sh_degree, groups, sh_rest, clusters, source, sky })
    }

    /// Returns the number of rows of [`Self::sh_rest`] per group.
    #[must_use]
    pub fn sh_rows(&self) -> usize {
        (sh::coefficients(self.sh_degree) - 1) * 3
    }
}

fn activate(splats: &Splats, source: &[u32], first: usize, len: usize) -> SplatGroup {
    let mut group = SplatGroup {
        mean: [[0.0; GROUP]; 3],
        quat: [[0.0; GROUP]; 4],
        scale: [[0.0; GROUP]; 3],
        log2_opacity: [NEVER_DRAWN_LOG2_OPACITY; GROUP],
        dc: [[0.0; GROUP]; 3],
    };
    for (lane, index) in source.iter().enumerate() {
        let index = *index as usize;
        let quat = wm_scene::quat::normalize(splats.quats[index].map(f64::from));
        for k in 0..3 {
            group.mean[k][lane] = splats.means[index][k];
            group.scale[k][lane] = splats.scales(index)[k] as f32;
            group.dc[k][lane] = splats.sh_of(index)[k];
        }
        for k in 0..4 {
            group.quat[k][lane] = quat[k] as f32;
        }
        if first + lane < len {
            let opacity = sigmoid(f64::from(splats.logit_opacities[index]));
            group.log2_opacity[lane] = (opacity.log2() as f32).max(NEVER_DRAWN_LOG2_OPACITY);
        }
    }
    group
}

fn bound(splats: &Splats, source: &[u32]) -> Cluster {
    let mut low = [f32::INFINITY; 3];
    let mut high = [f32::NEG_INFINITY; 3];
    let mut max_log_scale = f32::NEG_INFINITY;
    for index in source {
        let index = *index as usize;
        for k in 0..3 {
            low[k] = low[k].min(splats.means[index][k]);
            high[k] = high[k].max(splats.means[index][k]);
            max_log_scale = max_log_scale.max(splats.log_scales[index][k]);
        }
    }
    Cluster {
        center: std::array::from_fn(|k| 0.5 * (low[k] + high[k])),
        half: std::array::from_fn(|k| 0.5 * (high[k] - low[k])),
        max_scale: max_log_scale.exp(),
    }
}

/// Returns the indices of `means` in the order of a Morton curve through their box, 21 bits per
/// axis; ties by index.
#[must_use]
pub fn morton_order(means: &[[f32; 3]]) -> Vec<u32> {
    let mut low = [f32::INFINITY; 3];
    let mut high = [f32::NEG_INFINITY; 3];
    for mean in means {
        for k in 0..3 {
            low[k] = low[k].min(mean[k]);
            high[k] = high[k].max(mean[k]);
        }
    }
    let cells = f64::from((1 << 21) - 1);
    let mut order: Vec<(u64, u32)> = means
        .par_iter()
        .enumerate()
        .map(|(index, mean)| {
            let cell = std::array::from_fn(|k| {
                let side = (f64::from(high[k]) - f64::from(low[k])).max(1e-30);
                ((f64::from(mean[k]) - f64::from(low[k])) / side * cells) as u64
            });
            (morton::code(cell), index as u32)
        })
        .collect();
    order.par_sort_unstable();
    order.into_par_iter().map(|(_, index)| index).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::random_splats;

    #[test]
    fn every_splat_is_there_once_and_padding_is_never_drawn() {
        let splats = random_splats(1000, 2, 1);
        let model = CpuModel::new(&splats).unwrap();
        assert_eq!((model.clusters.len(), model.groups.len(), model.source.len()), (4, 64, 1024));
        let mut seen = model.source[..1000].to_vec();
        seen.sort_unstable();
        assert!(seen.iter().enumerate().all(|(i, s)| i == *s as usize));
        assert!(
            model.groups[1000 / 16].log2_opacity[1000 % 16..].iter().all(|v| *v == NEVER_DRAWN_LOG2_OPACITY)
        );
        for (i, source) in model.source[..1000].iter().enumerate() {
            let (group, lane) = (&model.groups[i / 16], i % 16);
            assert_eq!(group.mean[1][lane], splats.means[*source as usize][1]);
            let row = &model.sh_rest[i / 16 * model.sh_rows() + 7];
            assert_eq!(row[lane], splats.sh_of(*source as usize)[10]);
        }
    }

    #[test]
    fn clusters_hold_their_splats() {
        let splats = random_splats(700, 0, 2);
        let model = CpuModel::new(&splats).unwrap();
        for (i, source) in model.source[..700].iter().enumerate() {
            let cluster = &model.clusters[i / CLUSTER];
            for k in 0..3 {
                let mean = splats.means[*source as usize][k];
                assert!((mean - cluster.center[k]).abs() <= cluster.half[k] * 1.000_01);
                assert!(splats.scales(*source as usize)[k] <= f64::from(cluster.max_scale) * 1.000_01);
            }
        }
    }

    #[test]
    fn numbers_that_are_none_are_refused() {
        let mut splats = random_splats(20, 1, 3);
        splats.sh[100] = f32::NAN;
        let error = CpuModel::new(&splats).unwrap_err().to_string();
        assert!(error.contains("splat 8 holds a colour"), "{error}");
    }
}
