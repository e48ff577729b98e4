//! The splats of a training, and what is known of each.

use crate::random::Random;
use rayon::prelude::*;
use wm_render::cpu::model::morton_order;
use wm_render::training::{
    Changed, DensifyStats, Learnt, LearntMut, MIN_ALPHA, Moments, Noise, Origin, Shapes,
};
use wm_scene::splats::{logit, sigmoid};
use wm_scene::{Group, Splats, quat};

/// The splats of a training and everything that is known of each.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Population {
    /// The splats.
    pub(crate) splats: Splats,
    /// The optimiser's moments; empty where these stay on a device.
    pub(crate) moments: Moments,
    /// Screen-space gradients since splats were last added or removed.
    pub(crate) pulls: DensifyStats,
    /// The last step that had each in view, or that made it, `[N]`.
    pub(crate) seen: Vec<u32>,
    /// The origin of each splat, of a population whose moments and coefficients above degree 0 stay
    /// on a device.
    origins: Option<Origins>,
}

/// The origins of splats on a device.
#[derive(Clone, Debug, Default, PartialEq)]
struct Origins {
    rows: Vec<Origin>,
    /// True if the moments of all opacities are reset.
    forgets_opacities: bool,
}

impl Population {
    /// Returns a new population, sorted for locality.
    pub(crate) fn new(splats: Splats) -> Self {
        let mut population = Self::unsorted(splats);
        population.sort();
        population
    }

    /// Returns a new population whose splats keep their order.
    pub(crate) fn unsorted(splats: Splats) -> Self {
        let (moments, pulls, seen) =
            (Moments::new(&splats), DensifyStats::new(splats.len()), vec![0; splats.len()]);
        Self { splats, moments, pulls, seen, origins: None }
    }

    /// Returns a population whose moments and coefficients above degree 0 stay on a device.
    pub(crate) fn of_shapes(shapes: Shapes) -> Self {
        let Shapes { splats, pulls, seen } = shapes;
        let rows = (0..splats.len() as u32).map(|row| Origin { row, forgotten: false }).collect();
        let origins = Some(Origins { rows, forgets_opacities: false });
        Self { splats, moments: Moments::default(), pulls, seen, origins }
    }

    /// Returns the changes of the population, for the device.
    ///
    /// # Panics
    /// If it is not one of shapes.
    pub(crate) fn changed(&self) -> Changed<'_> {
        let Origins { rows, forgets_opacities } = self.origins.as_ref().expect("a population of shapes");
        let Self { splats, pulls, seen, .. } = self;
        Changed { splats, pulls, seen, origins: rows, forgets_opacities: *forgets_opacities }
    }

    /// Returns the number of splats.
    pub(crate) fn len(&self) -> usize {
        self.splats.len()
    }

    /// Borrows all of it for a device.
    pub(crate) fn learnt(&self) -> Learnt<'_> {
        Learnt { splats: &self.splats, moments: &self.moments, pulls: &self.pulls, seen: &self.seen }
    }

    /// Borrows all of it for a device, mutably.
    pub(crate) fn learnt_mut(&mut self) -> LearntMut<'_> {
        let Self { splats, moments, pulls, seen, .. } = self;
        LearntMut { splats, moments, pulls, seen }
    }

    /// Marks the splats that were in view at step `step`.
    pub(crate) fn see(&mut self, visible: &[u32], step: u32) {
        for index in visible {
            self.seen[*index as usize] = step;
        }
    }

    /// Returns the splats that any render can show: the others are below the least alpha that is
    /// drawn.
    pub(crate) fn drawn(&self) -> Splats {
        let splats = &self.splats;
        let shown: Vec<usize> =
            (0..splats.len()).filter(|i| splats.opacity(*i) >= f64::from(MIN_ALPHA)).collect();
        splats.select(&shown)
    }

    /// Keeps the splats `indices`, in that order.
    pub(crate) fn select(&mut self, indices: &[usize]) {
        self.splats = self.splats.select(indices);
        match &mut self.origins {
            None => self.moments.select(indices, self.splats.sh_degree),
            Some(Origins { rows, .. }) => *rows = indices.iter().map(|i| rows[*i]).collect(),
        }
        for array in [&mut self.pulls.sums, &mut self.pulls.counts, &mut self.pulls.radii] {
            *array = indices.iter().map(|i| array[*i]).collect();
        }
        self.seen = indices.iter().map(|i| self.seen[*i]).collect();
    }

    /// Adds copies of the splats `indices`, with empty moments.
    pub(crate) fn copy(&mut self, indices: &[usize]) {
        let copies = self.splats.select(indices);
        let seen: Vec<u32> = indices.iter().map(|i| self.seen[*i]).collect();
        self.seen.extend(seen);
        let splats = &mut self.splats;
        splats.append(&copies);
        match &mut self.origins {
            None => self.moments.resize(&self.splats),
            Some(Origins { rows, .. }) => {
                let copies: Vec<Origin> =
                    indices.iter().map(|i| Origin { forgotten: true, ..rows[*i] }).collect();
                rows.extend(copies);
            }
        }
        for array in [&mut self.pulls.sums, &mut self.pulls.counts, &mut self.pulls.radii] {
            array.resize(self.splats.len(), 0.0);
        }
    }

    /// Resets the moments of one splat.
    pub(crate) fn forget(&mut self, index: usize) {
        match &mut self.origins {
            None => self.moments.clear_row(index, self.splats.sh_degree),
            Some(Origins { rows, .. }) => rows[index].forgotten = true,
        }
    }

    /// Resets the moments of all opacities.
    pub(crate) fn forget_opacities(&mut self) {
        match &mut self.origins {
            None => {
                let pair = &mut self.moments.logit_opacities;
                [&mut pair.first, &mut pair.second].into_iter().for_each(|moments| moments.fill(0.0));
            }
            Some(origins) => origins.forgets_opacities = true,
        }
    }

    /// Copies the colours of splat `from` to splat `index`.
    pub(super) fn copy_colors(&mut self, index: usize, from: usize) {
        let stride = self.splats.sh_stride();
        self.splats.sh.copy_within(from * stride..(from + 1) * stride, index * stride);
        if let Some(Origins { rows, .. }) = &mut self.origins {
            rows[index].row = rows[from].row;
        }
    }

    /// Sorts splats for spatial locality: the renderer culls runs of splats.
    pub(crate) fn sort(&mut self) {
        let order: Vec<usize> = morton_order(&self.splats.means).into_iter().map(|i| i as usize).collect();
        self.select(&order);
    }
}

/// Moves nearly transparent splats at random, by at most their own size.
pub(crate) fn explore(population: &mut Population, noise: &Noise, random: Random) {
    let splats = &mut population.splats;
    let noisy = logit(noise.most) as f32;
    let (quats, scales, opacities) = (&splats.quats, &splats.log_scales, &splats.logit_opacities);
    let groups = &splats.groups;
    splats.means.par_iter_mut().enumerate().with_min_len(1024).for_each(|(i, mean)| {
        if opacities[i] > noisy || groups[i] == Group::Sky {
            return;
        }
        let gate = sigmoid(-100.0 * (sigmoid(f64::from(opacities[i])) - 0.005));
        let matrix = quat::to_matrix(quats[i].map(f64::from));
        let normal = random.normal3(i as u64);
        let turned: [f64; 3] = std::array::from_fn(|k| {
            let size = f64::from(scales[i][k]).exp();
            size * (noise.size * gate * size).min(1.0)
                * (0..3).map(|row| matrix[row][k] * normal[row]).sum::<f64>()
        });
        for row in 0..3 {
            let off: f64 = (0..3).map(|k| matrix[row][k] * turned[k]).sum();
            mean[row] += off as f32;
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_render::testing::random_splats;

    #[test]
    fn what_is_known_of_a_splat_goes_with_it() {
        let splats = random_splats(300, 1, 5);
        let mut population = Population::new(splats);
        for i in 0..300 {
            population.moments.means.first[3 * i] = population.splats.means[i][0];
            population.pulls.sums[i] = population.splats.logit_opacities[i];
            population.seen[i] = population.splats.logit_opacities[i].to_bits();
        }
        population.copy(&[7, 200]);
        population.splats.means[0] = [90.0; 3];
        population.sort();
        assert_eq!((population.len(), population.splats.check()), (302, Ok(())));
        let known = (0..302).filter(|i| {
            population.moments.means.first[3 * i] == population.splats.means[*i][0]
                && population.pulls.sums[*i] == population.splats.logit_opacities[*i]
                && population.seen[*i] == population.splats.logit_opacities[*i].to_bits()
        });
        assert_eq!(known.count(), 299);
    }
}
