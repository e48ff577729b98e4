//! Dialects of the splat PLY: recognised by the properties of their vertices, and made into what
//! the reference would have stored.
//!
//! | properties | dialect | read as |
//! |---|---|---|
//! | `scale_0` and `scale_1`, no `scale_2` | 2DGS | flat splats: the third scale is the logarithm of 0 |
//! | `scale_0` alone | balls | three equal scales; no rotation is needed |
//! | `red` `green` `blue` and no `f_dc_0` | nerfstudio's `--ply-color-mode rgb` | `f_dc` of the colours, by their type and range |
//! | `filter_3D` | Mip-Splatting | scales sqrt(s^2 + f^2), opacity times the square root of the ratio of the determinants |
//! | more than 45 `f_rest` | SH above degree 3 | cut to degree 3 |
//! | x y z without any property of a splat | points | balls by the distance to neighbours |

use super::{
    header::{Element, Header, Kind, Property, Scalar, missing, property},
    rows::Rows,
};
use crate::{
    Remark, Splats, sh,
    splats::{logit, sigmoid},
    values::MAX_SCENE_COORDINATE,
};
use wm_base::error::{Problem, excerpt};
use wm_base::kd_tree::KdTree;
use wm_base::statistics::median;

/// The parts of a splat that a file has, and in which form.
#[derive(Debug)]
pub(super) struct Dialect {
    pub(crate) colors: Colors,
    /// Scales of a splat: 1 to 3, or 0 for points, which also have no opacity and no rotation.
    pub(crate) scales: usize,
    pub(crate) is_turned: bool,
    pub(crate) is_filtered: bool,
    /// Coefficients above degree 0 of a channel in the file.
    pub(crate) rest: usize,
    pub(crate) sh_degree: u8,
    /// Faces of a mesh of which only the corners are read.
    faces: u64,
}

/// The form of colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Colors {
    Sh,
    Rgb { names: [&'static str; 3], kind: Scalar },
    None,
}

/// Names of the colours of vertices.
const RGB_NAMES: [[&str; 3]; 3] =
    [["red", "green", "blue"], ["r", "g", "b"], ["diffuse_red", "diffuse_green", "diffuse_blue"]];

/// Prefixes of the names of properties from which a splat is drawn; a file without any of them has
/// points.
const SPLAT_PREFIXES: [&str; 5] = ["f_dc_", "f_rest_", "scale_", "rot_", "opacity"];

/// Prefixes of the names of properties that trainings add and no picture shows: normals, features,
/// classes, measures.
#[rustfmt::skip]
const UNSEEN_PREFIXES: [&str; 28] = [
    "nx", "ny", "nz", "normal", "semantic", "language", "obj_", "ins_", "feat", "clip", "dino",
    "embed", "id", "index", "class", "seg", "conf", "quality", "uncert", "error", "count", "state",
    "flag", "intensity", "alpha", "level", "view", "grad",
];

/// Prefixes of the names of properties of scenes that move.
const TIME_PREFIXES: [&str; 7] = ["trbf_", "motion_", "omega_", "rot_r_", "scale_t", "velocity", "time"];

impl Dialect {
    /// Recognises the dialect of the vertices of a file.
    ///
    /// # Errors
    /// [`Problem`] if they are those of no splats that can be drawn.
    pub(crate) fn of(header: &Header, vertex: &Element) -> Result<Self, Problem> {
        let has = |name: &str| vertex.properties.iter().any(|p| p.name == name);
        let starts = |start: &str| vertex.properties.iter().find(|p| p.name.starts_with(start));
        if let Some(anchor) = starts("f_offset_").or_else(|| starts("f_anchor_feat")) {
            return Err(Problem::Value(format!(
                "it has anchors (the property {}) of which a network of its training makes the splats; export the splats \
                 themselves",
                excerpt(anchor.name.as_bytes())
            )));
        }
        let is_points = SPLAT_PREFIXES.iter().all(|start| starts(start).is_none());
        let scales = if is_points {
            0
        } else if has("scale_0") && !has("scale_2") {
            if has("scale_1") { 2 } else { 1 }
        } else {
            // If one is missing, `Layout` says which.
            3
        };
        let rgb = RGB_NAMES.into_iter().find(|names| names.iter().all(|name| has(name)));
        let colors = match rgb {
            _ if starts("f_dc_").is_some() => Colors::Sh,
            Some(names) => Colors::Rgb { names, kind: scalar(vertex, names[0])? },
            None if is_points => Colors::None,
            None => return Err(missing("f_dc_0")),
        };
        let rest = vertex.properties.iter().filter(|p| p.name.starts_with("f_rest_")).count();
        let coefficients = rest / 3 + 1;
        let degree =
            (0..=u8::MAX).find(|degree| sh::coefficients(*degree) >= coefficients).unwrap_or(u8::MAX);
        if !rest.is_multiple_of(3) || sh::coefficients(degree) != coefficients {
            return Err(Problem::ShCount(rest));
        }
        Ok(Self {
            colors,
            scales,
            is_turned: !is_points && (scales > 1 || has("rot_0")),
            is_filtered: has("filter_3D") && !is_points,
            rest: rest / 3,
            sh_degree: degree.min(sh::MAX_DEGREE),
            faces: header
                .elements
                .iter()
                .filter(|e| e.name == "face")
                .fold(0, |sum, e| e.count.saturating_add(sum)),
        })
    }

    /// Makes the splats that the rows stand for, and says what was changed and what was passed
    /// over.
    pub(crate) fn finish(&self, mut rows: Rows, vertex: &Element, kept: &[usize]) -> (Splats, Vec<Remark>) {
        let mut remarks = Vec::new();
        let splats = &mut rows.splats;
        if let Colors::Rgb { kind, .. } = self.colors {
            bring_to_sh(splats, kind);
        }
        match self.scales {
            0 => {
                remarks.push(self.about_points(splats.len()));
                draw_as_balls(splats);
                return (rows.splats, remarks);
            }
            1 => splats.log_scales.iter_mut().for_each(|scales| *scales = [scales[0]; 3]),
            2 => {
                splats.log_scales.iter_mut().for_each(|scales| scales[2] = f32::NEG_INFINITY);
                remarks.push(Remark::note("flat", "2D splats (two scales each), read as flat ones"));
            }
            _ => {}
        }
        if !self.is_turned {
            splats.quats.fill([1.0, 0.0, 0.0, 0.0]);
        }
        if matches!(self.colors, Colors::Rgb { .. }) {
            remarks
                .push(Remark::note("rgb", "the colours are red, green and blue, the same from everywhere"));
        }
        if self.is_filtered {
            for (index, filter) in rows.filters.iter().enumerate() {
                apply_filter(splats, index, f64::from(*filter), self.scales.max(2));
            }
            let how = "the 3D filter of Mip-Splatting (filter_3D) is applied to scales and opacities";
            remarks.push(Remark::note("filter-3d", how));
        }
        if self.rest > sh::coefficients(sh::MAX_DEGREE) - 1 {
            let how = format!(
                "{} f_rest properties are SH above degree 3, which is cut: colours by direction are less sharp",
                3 * self.rest
            );
            remarks.push(Remark::doubt("sh-degree", how));
        }
        remarks.extend(about_properties(vertex, kept));
        remarks.extend(about_activation(splats));
        (rows.splats, remarks)
    }

    fn about_points(&self, count: usize) -> Remark {
        let faces = match self.faces {
            0 => String::new(),
            faces => format!(" of a mesh whose {faces} faces are not read"),
        };
        let grey = if self.colors == Colors::None { ", grey as they have no colours" } else { "" };
        let text = format!(
            "{count} points{faces} and no splats: each is drawn as a ball as large as its distance to others{grey}; train \
             splats from the photos for true pictures"
        );
        Remark::doubt("points", text)
    }
}

/// The number type of a property.
fn scalar(vertex: &Element, name: &str) -> Result<Scalar, Problem> {
    match vertex.properties.iter().find(|p| p.name == name).map(|p| p.kind) {
        Some(Kind::Scalar(scalar)) => Ok(scalar),
        _ => Err(property(&format!("the property {name} is a list, not one number per splat"))),
    }
}

/// The number that means full light among colours of a type of which `largest` is the largest.
fn white(kind: Scalar, largest: f32) -> f32 {
    match kind {
        Scalar::I8 | Scalar::U8 => 255.0,
        // Shares may be a little above 1.
        Scalar::F32 | Scalar::F64 if largest <= 2.0 => 1.0,
        _ if largest <= 255.0 => 255.0,
        _ => 65_535.0,
    }
}

/// Replaces colours by the coefficients of degree 0 that show them.
fn bring_to_sh(splats: &mut Splats, kind: Scalar) {
    let stride = splats.sh_stride();
    let shown = |splats: &Splats| -> f32 {
        let firsts = splats.sh.chunks_exact(stride).flat_map(|sh| &sh[..3]);
        firsts.filter(|v| v.is_finite()).fold(0.0, |largest, v| largest.max(*v))
    };
    let white = f64::from(white(kind, shown(splats)));
    for sh in splats.sh.chunks_exact_mut(stride) {
        sh[..3].iter_mut().for_each(|v| *v = sh::dc_of(f64::from(*v) / white) as f32);
    }
}

/// Adds the filter to the first `axes` axes of a splat: its variance to each, and to the opacity
/// what the volume gained.
fn apply_filter(splats: &mut Splats, index: usize, filter: f64, axes: usize) {
    let variance = filter * filter;
    let mut ratio = 1.0;
    for scale in &mut splats.log_scales[index][..axes] {
        let old = (2.0 * f64::from(*scale)).exp();
        let new = old + variance;
        // Of a flat splat without a filter nothing changes.
        if new > 0.0 {
            ratio *= old / new;
        }
        *scale = (0.5 * new.ln()) as f32;
    }
    let logit_opacity = &mut splats.logit_opacities[index];
    if ratio < 1.0 {
        *logit_opacity = logit(sigmoid(f64::from(*logit_opacity)) * ratio.sqrt()) as f32;
    }
}

/// Neighbours that determine the size of a ball.
const NEIGHBOUR_COUNT: usize = 4;
/// Standard deviation of a ball in distances to its neighbours: leaves no gaps in a surface.
const BALL_SCALE: f64 = 0.5;
/// Largest ratio of a ball to the median one: a stray point is far from others without being large.
const MAX_BALL_RATIO: f64 = 4.0;
/// Logit of the opacity of a ball.
const BALL_LOGIT: f32 = 4.0;

/// Gives points the shape of splats.
fn draw_as_balls(splats: &mut Splats) {
    let is_place = |mean: &[f32; 3]| mean.iter().all(|v| v.abs() <= MAX_SCENE_COORDINATE);
    let places: Vec<[f32; 3]> = splats.means.iter().copied().filter(is_place).collect();
    let tree = KdTree::new(&places);
    let distance = |mean: &[f32; 3]| -> f64 {
        if !is_place(mean) {
            return 0.0;
        }
        // The nearest is the point itself.
        let found = tree.nearest(mean, NEIGHBOUR_COUNT);
        let squares = found.iter().skip(1).map(|near| f64::from(near.square));
        (squares.sum::<f64>() / found.len().saturating_sub(1).max(1) as f64).sqrt()
    };
    let distances: Vec<f64> = splats.means.iter().map(distance).collect();
    let mut known: Vec<f64> = distances.iter().copied().filter(|d| *d > 0.0 && d.is_finite()).collect();
    let middle = median(&mut known).unwrap_or(1.0);
    for (scales, distance) in splats.log_scales.iter_mut().zip(distances) {
        // Points that share a place are as large as the others.
        let distance = if distance > 0.0 { distance.min(MAX_BALL_RATIO * middle) } else { middle };
        *scales = [(BALL_SCALE * distance).ln() as f32; 3];
    }
    splats.quats.fill([1.0, 0.0, 0.0, 0.0]);
    splats.logit_opacities.fill(BALL_LOGIT);
}

/// Says which properties are passed over: those that no picture shows, those of time, and those
/// that are not understood.
fn about_properties(vertex: &Element, kept: &[usize]) -> Vec<Remark> {
    let others = vertex.properties.iter().enumerate().filter(|(index, p)| {
        // Normals are in every file of the reference, and colours beside SH repeat them.
        let is_usual = ["nx", "ny", "nz"].contains(&p.name.as_str());
        !kept.contains(index)
            && !is_usual
            && !p.name.starts_with("f_rest_")
            && !RGB_NAMES.as_flattened().contains(&p.name.as_str())
    });
    let is_integer = |p: &Property| !matches!(p.kind, Kind::Scalar(Scalar::F32 | Scalar::F64));
    let (mut unseen, mut of_time, mut unknown) = (Vec::new(), Vec::new(), Vec::new());
    for (_, other) in others {
        let starts = |list: &[&str]| {
            let name = other.name.to_ascii_lowercase();
            list.iter().any(|start| name.starts_with(start))
        };
        // Whole numbers are names and counts.
        let list = if starts(&TIME_PREFIXES) || other.name == "t" {
            &mut of_time
        } else if starts(&UNSEEN_PREFIXES) || is_integer(other) {
            &mut unseen
        } else {
            &mut unknown
        };
        list.push(&*other.name);
    }
    let mut remarks = Vec::new();
    if !unseen.is_empty() {
        remarks.push(Remark::note("unused-property", format!("not used: {}", named(&unseen))));
    }
    if !of_time.is_empty() {
        let text = format!(
            "splats that move ({}) are drawn where they stand at first; export one moment",
            named(&of_time)
        );
        remarks.push(Remark::doubt("moving", text));
    }
    if !unknown.is_empty() {
        let text = format!(
            "{} {} not understood and not used; if splats look otherwise by it, export them as plain 3DGS",
            named(&unknown),
            if unknown.len() == 1 { "is" } else { "are" }
        );
        remarks.push(Remark::doubt("unknown-property", text));
    }
    remarks
}

/// Names of properties in words: a few, and how many more.
fn named(names: &[&str]) -> String {
    const MAX_SHOWN_NAMES: usize = 4;
    let shown = names
        .iter()
        .take(MAX_SHOWN_NAMES)
        .map(|name| excerpt(name.as_bytes()))
        .collect::<Vec<_>>()
        .join(", ");
    let word = if names.len() == 1 { "the property" } else { "the properties" };
    match names.len().saturating_sub(MAX_SHOWN_NAMES) {
        0 => format!("{word} {shown}"),
        more => format!("{word} {shown} and {more} more"),
    }
}

/// Says where all numbers look as if the activations were applied to them already.
fn about_activation(splats: &Splats) -> Option<Remark> {
    let are_shares = splats.logit_opacities.iter().all(|v| (0.0..=1.0).contains(v));
    let is_spread = splats.logit_opacities.iter().any(|v| *v != splats.logit_opacities[0]);
    let are_sizes = splats.log_scales.as_flattened().iter().all(|v| *v > 0.0 || *v == f32::NEG_INFINITY);
    (are_shares && is_spread && are_sizes).then(|| {
        let text = "all opacities are within 0 to 1 and all scales above 0, as if they were no logits and logarithms; they are \
                    read as those: if the splats are huge and pale, export them as 3DGS stores them";
        Remark::doubt("activated", text)
    })
}
