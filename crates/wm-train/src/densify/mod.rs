//! How splats come and go, one strategy a file.

pub mod adaptive;
pub mod mcmc;

use wm_render::cpu::model::morton_order;
pub use wm_render::stages::optimize::Pulls;
use wm_render::stages::optimize::{Changed, Learnt, LearntMut, Moments, Origin, Shapes};
use wm_render::stages::project::MIN_ALPHA;
use wm_scene::Splats;

/// The splats of a training and everything that is known of each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Population {
    /// The splats.
    pub splats: Splats,
    /// What the optimiser remembers of them; empty where that stays on a device.
    pub moments: Moments,
    /// What pulled on them since splats last came or went.
    pub pulls: Pulls,
    /// The last step that had each in view, or that made it, `[N]`.
    pub seen: Vec<u32>,
    /// Where they come from, of a population whose moments and coefficients above degree 0 stay on a device.
    origins: Option<Origins>,
}

/// Where splats come from.
#[derive(Clone, Debug, Default, PartialEq)]
struct Origins {
    rows: Vec<Origin>,
    /// Whether the moments of all opacities are forgotten.
    forgets_opacities: bool,
}

impl Population {
    /// A population that begins.
    #[must_use]
    pub fn new(splats: Splats) -> Self {
        let mut population = Self::unsorted(splats);
        population.sort();
        population
    }

    /// One whose splats stay in their order.
    #[must_use]
    pub fn unsorted(splats: Splats) -> Self {
        let (moments, pulls, seen) = (Moments::new(&splats), Pulls::new(splats.len()), vec![0; splats.len()]);
        Self { splats, moments, pulls, seen, origins: None }
    }

    /// One whose moments and coefficients above degree 0 stay on a device.
    #[must_use]
    pub fn of_shapes(shapes: Shapes) -> Self {
        let Shapes { splats, pulls, seen } = shapes;
        let rows = (0..splats.len() as u32).map(|row| Origin { row, forgotten: false }).collect();
        let origins = Some(Origins { rows, forgets_opacities: false });
        Self { splats, moments: Moments::default(), pulls, seen, origins }
    }

    /// What became of it, for the device.
    ///
    /// # Panics
    /// If it is not one of shapes.
    #[must_use]
    pub fn changed(&self) -> Changed<'_> {
        let Origins { rows, forgets_opacities } = self.origins.as_ref().expect("a population of shapes");
        let Self { splats, pulls, seen, .. } = self;
        Changed { splats, pulls, seen, origins: rows, forgets_opacities: *forgets_opacities }
    }

    /// Number of splats.
    #[must_use]
    pub fn len(&self) -> usize {
        self.splats.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.splats.is_empty()
    }

    /// All of it, for a device.
    #[must_use]
    pub fn learnt(&self) -> Learnt<'_> {
        Learnt { splats: &self.splats, moments: &self.moments, pulls: &self.pulls, seen: &self.seen }
    }

    /// The same, to be written.
    pub fn learnt_mut(&mut self) -> LearntMut<'_> {
        let Self { splats, moments, pulls, seen, .. } = self;
        LearntMut { splats, moments, pulls, seen }
    }

    /// Marks the splats that step `step` had in view.
    pub fn see(&mut self, visible: &[u32], step: u32) {
        for index in visible {
            self.seen[*index as usize] = step;
        }
    }

    /// The splats that any picture can show: the others are below the least alpha that is drawn.
    #[must_use]
    pub fn drawn(&self) -> Splats {
        let splats = &self.splats;
        let shown: Vec<usize> =
            (0..splats.len()).filter(|i| splats.opacity(*i) >= f64::from(MIN_ALPHA)).collect();
        splats.select(&shown)
    }

    /// Keeps the splats `indices`, in that order.
    pub fn select(&mut self, indices: &[usize]) {
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

    /// Adds copies of the splats `indices`, about which nothing is known yet.
    pub fn copy(&mut self, indices: &[usize]) {
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

    /// Forgets what was learnt about one splat.
    pub fn forget(&mut self, index: usize) {
        match &mut self.origins {
            None => self.moments.clear_row(index, self.splats.sh_degree),
            Some(Origins { rows, .. }) => rows[index].forgotten = true,
        }
    }

    /// Forgets what was learnt about opacities.
    pub fn forget_opacities(&mut self) {
        match &mut self.origins {
            None => {
                let pair = &mut self.moments.logit_opacities;
                [&mut pair.first, &mut pair.second].into_iter().for_each(|moments| moments.fill(0.0));
            }
            Some(origins) => origins.forgets_opacities = true,
        }
    }

    /// Makes the colours of splat `index` those of `from`.
    fn copy_colors(&mut self, index: usize, from: usize) {
        let stride = self.splats.sh_stride();
        self.splats.sh.copy_within(from * stride..(from + 1) * stride, index * stride);
        if let Some(Origins { rows, .. }) = &mut self.origins {
            rows[index].row = rows[from].row;
        }
    }

    /// Brings neighbours together: the renderer culls runs of splats.
    pub fn sort(&mut self) {
        let order: Vec<usize> = morton_order(&self.splats.means).into_iter().map(|i| i as usize).collect();
        self.select(&order);
    }
}

/// What a strategy did at a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Densified {
    /// Splats that came.
    pub born: usize,
    /// Splats that moved to another place.
    pub moved: usize,
    /// Splats that went.
    pub gone: usize,
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
