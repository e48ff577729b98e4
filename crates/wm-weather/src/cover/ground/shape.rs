//! The shape of the ground: plains, ledges, crowns and the slopes of its surfaces.

use super::*;

impl GroundGrid {
    /// Returns true if the uppermost surface goes on about it, without a step up or down.
    pub(super) fn lies_in_a_plain(&self, node: usize) -> bool {
        let ([column, row], [a, b]) = (self.place(node), self.slope[node]);
        let goes_on = |[x, y]: [i64; 2]| {
            let Some(cell) = self.cell_of(column + x, row + y) else { return true };
            let plane = self.height[node] + (a * x as f32 + b * y as f32) * self.cell;
            self.nodes_of(cell).next().is_some_and(|upper| (self.height[upper] - plane).abs() < self.edge)
        };
        let cells = (PLAIN_REACH_M / self.cell).max(1.0) as i64;
        let mut around = LEDGE_DISTANCES_CELLS.into_iter().filter(|far| *far <= cells);
        let is_uppermost = self.nodes_of(self.cells[node] as usize).start == node;
        is_uppermost
            && !self.is_steep(node)
            && around.all(|far| WAYS_ROUND.iter().all(|[x, y]| goes_on([far * x, far * y])))
    }

    /// Returns true for leaves of a crown: a rough surface that stands over what is about it on
    /// several sides; on more of them if its splats face up, as those of a table do.
    fn is_of_crown(&self, node: usize) -> bool {
        if self.is_plain(node) || self.is_steep(node) {
            return false;
        }
        let ([column, row], below) = (self.place(node), self.height[node] - CROWN_STANDS);
        // What lies below the uppermost may be strays under the ground.
        let is_over =
            |cell: usize| self.nodes_of(cell).next().is_some_and(|upper| self.height[upper] < below);
        let drops = |[x, y]: &&[i64; 2]| {
            ABOUT_CROWN.into_iter().any(|metres| {
                let far = (metres / self.cell).round().max(1.0) as i64;
                self.cell_of(column + far * x, row + far * y).is_some_and(is_over)
            })
        };
        let sides = WAYS_ROUND.iter().filter(drops).count();
        // Surfaces without a known facing are leaves as well.
        let faces_less = |most: f32| self.facing[node].is_nan() || self.facing[node] < most;
        CROWN_RINGS.into_iter().any(|(least, most)| sides >= least && faces_less(most))
    }

    /// Finds the share of what leaves can hold that those of a node do; NaN where there are none.
    /// `spread` is how much its splats' cosines with up differ: those of a steep roof are alike.
    pub(super) fn clump(&self, node: usize, spread: f32) -> f32 {
        if spread < LEAVES_SPREAD || !self.is_of_crown(node) {
            return f32::NAN;
        }
        let [x, y] = self.middle(node).map(|v| v * f64::from(self.cell));
        ((lower_share(relief(x, y)) - CLUMP_SHARES[0]) / (CLUMP_SHARES[1] - CLUMP_SHARES[0])).clamp(0.0, 1.0)
    }

    /// Returns true for leaves of a crown.
    pub(crate) fn is_crown(&self, node: usize) -> bool {
        !self.clumps[node].is_nan()
    }

    /// Returns as much of a depth, m, as a node holds: leaves hold little, in clumps, and what is
    /// more falls through.
    pub(crate) fn held(&self, node: usize, depth: f32) -> f32 {
        if self.is_crown(node) { depth.min(ON_LEAVES) * self.clumps[node] } else { depth }
    }

    /// Returns true if something stands higher not far from it: then it is on the side of that, or
    /// below its top.
    fn is_overlooked(&self, node: usize) -> bool {
        let ([column, row], height) = (self.place(node), self.height[node] + self.edge);
        LEDGE_DISTANCES_CELLS.into_iter().flat_map(|far| WAYS_ROUND.map(|[x, y]| [far * x, far * y])).any(
            |[x, y]| {
                let upper = self.cell_of(column + x, row + y).and_then(|cell| self.nodes_of(cell).next());
                upper.is_some_and(|upper| self.height[upper] > height)
            },
        )
    }

    /// Lets nothing lie on small surfaces beside which something stands higher: they are lumps that
    /// a training leaves on walls, hedges and cars.
    pub(super) fn clear_ledges(&mut self) {
        let overlooked = map(self.len(), |node| self.slope[node] != WALL_SLOPE && self.is_overlooked(node));
        let mut is_done: Vec<bool> = self.slope.iter().map(|slope| *slope == WALL_SLOPE).collect();
        let least = LEDGE_AREA.max(LEDGE_CELLS * self.cell * self.cell) / (self.cell * self.cell);
        for first in 0..self.len() {
            if std::mem::replace(&mut is_done[first], true) {
                continue;
            }
            let mut piece = vec![first];
            let mut next = 0;
            while let Some(node) = piece.get(next).copied() {
                next += 1;
                for other in self.beside(node).into_iter().flatten() {
                    if !std::mem::replace(&mut is_done[other], true) {
                        piece.push(other);
                    }
                }
            }
            let below = piece.iter().filter(|node| overlooked[**node]).count() as f32;
            if (piece.len() as f32) < least && below > LEDGE_BELOW * piece.len() as f32 {
                piece.iter().for_each(|node| self.slope[*node] = WALL_SLOPE);
            }
        }
    }

    /// Returns true if an inner ground contains it.
    pub(crate) fn is_elsewhere(&self, node: usize) -> bool {
        self.is_inner[node]
    }

    /// Takes the roughness of splats off level surfaces: the median of a node's height and of those
    /// about it.
    pub(super) fn smooth(&self, node: usize) -> f32 {
        let [column, row] = self.place(node);
        let rough = ROUGHNESS_M.max(ROUGHNESS_CELLS * self.cell);
        let mut near = [0.0; 9];
        let mut count = 0;
        for k in 0..9 {
            if let Some(other) = self.level_with(node, column + k % 3 - 1, row + k / 3 - 1, rough) {
                near[count] = self.height[other];
                count += 1;
            }
        }
        near[..count].sort_by(f32::total_cmp);
        near[count / 2]
    }

    /// Returns the sums of values, each times the opacity, over the splats of the scene that are on
    /// each node's surface.
    pub(crate) fn sums_of_splats<const N: usize>(
        &self,
        splats: &Splats,
        value: impl Fn(usize) -> [f32; N] + Sync,
    ) -> Vec<[f32; N]> {
        let own = SURFACE_THICKNESS_M.max(OWN_CELLS * self.cell);
        let of = |index: usize| {
            if splats.groups[index] == Group::Sky || !splats.is_sound(index) {
                return None;
            }
            let (place, height) = self.places.locate(splats.means[index].map(f64::from));
            let cell = self.places.cell_at(place)?;
            let near = |node: &usize| (self.height[*node] - height as f32).abs() < own;
            let node = self.nodes_of(cell).find(near)?;
            let weight = splats.opacity(index) as f32;
            Some((node as u32, value(index).map(|value| weight * value)))
        };
        let found = map(splats.len().div_ceil(CHUNK_SPLAT_COUNT), |chunk| {
            let last = splats.len().min((chunk + 1) * CHUNK_SPLAT_COUNT);
            (chunk * CHUNK_SPLAT_COUNT..last).filter_map(of).collect::<Vec<_>>()
        });
        let mut sums = vec![[0.0f32; N]; self.len()];
        for (node, added) in found.into_iter().flatten() {
            sums[node as usize].iter_mut().zip(added).for_each(|(sum, added)| *sum += added);
        }
        sums
    }

    /// Finds how far the splats of each node face up (or down, where the side is not known): the
    /// mean cosine of their normals over the nodes beside each other, and its standard deviation;
    /// not numbers where none tells. In a scan a node's are those `of` its surface.
    pub(super) fn find_facing(&self, scan: &FusedSurfaces<'_>, of: &[usize]) -> (Vec<f32>, Vec<f32>) {
        let up = self.places.axes()[2];
        let cosine =
            |splat: usize| scan.splats.normal(splat).iter().zip(&up).map(|(a, b)| a * b).sum::<f64>() as f32;
        let mut sums;
        if self.is_scan {
            sums = map(self.len(), |node| {
                let splat = of[node];
                let mut scales = scan.splats.log_scales[splat];
                scales.sort_by(f32::total_cmp);
                let is_seen = splat < scan.oriented;
                let cosine = if is_seen { cosine(splat) } else { cosine(splat).abs() };
                // Balls and rods look nowhere; but of what was seen from below nobody knows the
                // top.
                let flat = if cosine < UNDERSIDE_COSINE { 1.0 } else { 1.0 - (scales[0] - scales[1]).exp() };
                [flat * cosine, flat * cosine * cosine, flat]
            });
        } else {
            let value = |splat: usize| [cosine(splat).abs(), cosine(splat).powi(2), 1.0];
            sums = self.sums_of_splats(&scan.splats, value);
        }
        for _ in 0..2 {
            sums = map(self.len(), |node| self.mean_about(node, |other| Some(sums[other])));
        }
        let least = if self.is_scan { MIN_FLATNESS } else { 0.0 };
        let known = |[sum, squares, weight]: [f32; 3]| {
            let mean = sum / weight;
            if weight > least {
                (mean, (squares / weight - mean * mean).max(0.0).sqrt())
            } else {
                (f32::NAN, f32::NAN)
            }
        };
        sums.into_iter().map(known).unzip()
    }

    /// The slope of a plane through a node and those about it.
    pub(super) fn fit(&self, node: usize) -> [f32; 2] {
        let [column, row] = self.place(node);
        let (mut count, mut lower, mut higher) = (0.0f32, 0, 0);
        let mut sums = [0.0f32; 5];
        let mut moments = [0.0f32; 3];
        for (dx, dy) in (-FIELD_RADIUS_CELLS..=FIELD_RADIUS_CELLS)
            .flat_map(|dy| (-FIELD_RADIUS_CELLS..=FIELD_RADIUS_CELLS).map(move |dx| (dx, dy)))
        {
            let Some(cell) = self.cell_of(column + dx, row + dy) else { continue };
            let Some(other) = self.level_with(node, column + dx, row + dy, self.edge) else {
                let upper = self.nodes_of(cell).next();
                let is_lower = upper.is_none_or(|upper| self.height[upper] < self.height[node]);
                lower += u32::from(is_lower);
                higher += u32::from(!is_lower);
                continue;
            };
            let (x, y, h) = (dx as f32, dy as f32, self.height[other] - self.height[node]);
            count += 1.0;
            sums.iter_mut().zip([x, y, h, x * h, y * h]).for_each(|(sum, value)| *sum += value);
            moments.iter_mut().zip([x * x, x * y, y * y]).for_each(|(sum, value)| *sum += value);
        }
        let field = ((2 * FIELD_RADIUS_CELLS + 1) * (2 * FIELD_RADIUS_CELLS + 1)) as f32;
        // A piece of a wall has what is above beside it and what is below, and is no ledge that
        // looks up.
        let facing = self.facing[node];
        let is_piece = match (self.is_scan, self.is_seen[node]) {
            _ if facing < UNDERSIDE_COSINE => true,
            (false, _) if higher == 0 || lower == 0 => false,
            (false, _) if facing.is_nan() => count < SURFACE_FIELD_SHARE * field,
            // Leaves of a crown look anywhere.
            (false, _) => {
                count < if facing < UPRIGHT_COSINE { LEDGE_FIELD_SHARE } else { CROWN_FIELD_SHARE } * field
            }
            (true, true) if facing > STEEP_SEEN => {
                higher > 0 && lower > 0 && count < SURFACE_FIELD_SHARE * field
            }
            (true, true) if !facing.is_nan() => self.is_overlooked(node),
            // Edges: wires and finials hold next to nothing.
            (true, true) => {
                count < SURFACE_FIELD_SHARE * field
                    || count < LEDGE_FIELD_SHARE * field && self.is_overlooked(node)
            }
            // What no camera sees is a surface only if it is a level one: pieces are haze, of the
            // sky too.
            (true, false) => count < UNSEEN_FIELD_SHARE * field || facing < LEVEL_UNSEEN,
        };
        if is_piece {
            return WALL_SLOPE;
        }
        let [x, y, h, xh, yh] = sums.map(|sum| sum / count);
        let [xx, xy, yy] = moments.map(|moment| moment / count);
        let (xx, xy, yy) = (xx - x * x, xy - x * y, yy - y * y);
        let (xh, yh) = (xh - x * h, yh - y * h);
        let det = xx * yy - xy * xy;
        if det > 0.05 {
            [(xh * yy - yh * xy) / det, (yh * xx - xh * xy) / det].map(|v| v / self.cell)
        } else {
            [0.0; 2]
        }
    }
}
