//! Reading: JSON, buffers, nodes, accessors.

use super::{BIN, FORMAT, JSON, MAGIC, SPLATTING, attribute, sh_attribute};
use crate::{
    Group, Metadata, Remark, Scene, Splats,
    color::srgb_encode,
    error::{Problem, excerpt, one_line},
    files,
    formats::{
        beside::beside,
        bytes::{Bytes, check_unpacked},
        spz,
    },
    origin,
    remark::add_new,
    sh,
    similarity::Similarity,
    splats::logit,
};
use base64::prelude::{BASE64_STANDARD, Engine as _};
use glam::{DMat3, DMat4, DQuat, DVec3};
use serde::Deserialize;
use serde_json::Value;
use std::{
    borrow::Cow,
    collections::BTreeMap,
    path::{Component, Path},
};

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Gltf {
    asset: Asset,
    #[serde(default)]
    extensions_required: Vec<String>,
    #[serde(default)]
    scene: usize,
    #[serde(default)]
    scenes: Vec<Root>,
    #[serde(default)]
    nodes: Vec<Node>,
    #[serde(default)]
    meshes: Vec<Mesh>,
    #[serde(default)]
    accessors: Vec<Accessor>,
    #[serde(default)]
    buffer_views: Vec<BufferView>,
    #[serde(default)]
    buffers: Vec<Buffer>,
}

#[derive(Deserialize)]
struct Asset {
    #[serde(default)]
    extras: Extras,
}

#[derive(Default, Deserialize)]
struct Extras {
    /// The metadata of this program, in the file's extras.
    #[serde(default)]
    wm: Metadata,
}

#[derive(Deserialize)]
struct Root {
    #[serde(default)]
    nodes: Vec<usize>,
}

#[derive(Deserialize)]
struct Node {
    #[serde(default)]
    mesh: Option<usize>,
    #[serde(default)]
    children: Vec<usize>,
    #[serde(default)]
    matrix: Option<[f64; 16]>,
    #[serde(default)]
    translation: [f64; 3],
    #[serde(default = "no_rotation")]
    rotation: [f64; 4],
    #[serde(default = "no_scale")]
    scale: [f64; 3],
}

fn no_rotation() -> [f64; 4] {
    [0.0, 0.0, 0.0, 1.0]
}

fn no_scale() -> [f64; 3] {
    [1.0; 3]
}

#[derive(Deserialize)]
struct Mesh {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    #[serde(default)]
    attributes: BTreeMap<String, usize>,
    #[serde(default)]
    extensions: BTreeMap<String, Value>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    #[serde(default)]
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: u64,
    component_type: u32,
    #[serde(default)]
    normalized: bool,
    count: u64,
    #[serde(rename = "type")]
    kind: String,
    #[serde(default)]
    sparse: Option<Value>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct BufferView {
    buffer: usize,
    #[serde(default)]
    byte_offset: u64,
    byte_length: u64,
    #[serde(default)]
    byte_stride: Option<u64>,
}

#[derive(Deserialize)]
struct Buffer {
    #[serde(default)]
    uri: Option<String>,
}

fn fault(what: impl Into<String>) -> Problem {
    Problem::Header(format!("glTF: {}", what.into()))
}

/// Reads a file in memory; buffers in other files are below the folder of its path, `main`. The scene has the axes of glTF.
pub(super) fn read(file: &[u8], main: &Path) -> Result<Scene, Problem> {
    let (json, bin) = if file.starts_with(MAGIC) { chunks(file)? } else { (file, None) };
    let gltf: Gltf = serde_json::from_slice(json).map_err(|error| fault(one_line(&error.to_string())))?;
    if let Some(unknown) = gltf.extensions_required.iter().find(|name| !is_read(name)) {
        return Err(fault(format!(
            "it requires the extension {}, which is not read",
            excerpt(unknown.as_bytes())
        )));
    }
    if let Some(fault_of) = gltf.asset.extras.wm.fault() {
        return Err(fault(format!("asset.extras.wm: {fault_of}")));
    }
    let buffers = gltf.buffers.iter().map(|buffer| read_buffer(buffer, bin, main));
    let buffers = buffers.collect::<Result<Vec<_>, _>>()?;
    let size = buffers.iter().map(|buffer| buffer.len() as u64).sum();
    let reader = Reader { gltf: &gltf, buffers, size };
    let mut read = Placed { metadata: gltf.asset.extras.wm.clone(), ..Placed::default() };
    if let Some(root) = gltf.scenes.get(gltf.scene) {
        // A node may stand at one place of the tree only, so that none is met twice.
        let mut met = vec![false; gltf.nodes.len()];
        for node in &root.nodes {
            reader.node(*node, &Similarity::IDENTITY, &mut met, &mut read)?;
        }
    } else {
        for mesh in &gltf.meshes {
            reader.mesh(mesh, &Similarity::IDENTITY, &mut read)?;
        }
    }
    if read.count == 0 {
        return Err(fault(format!("no primitive with {SPLATTING} is in its scene")));
    }
    Ok(read.scene())
}

/// The splats of primitives, as they are in them, with their places in the scene.
#[derive(Default)]
struct Placed {
    metadata: Metadata,
    remarks: Vec<Remark>,
    parts: Vec<(Splats, Similarity)>,
    /// Number of splats.
    count: usize,
}

impl Placed {
    /// The scene, relative to the origin that the file states, else to one that suits its places: a node may stand far from zero, with
    /// splats near to it.
    fn scene(self) -> Scene {
        let Self { metadata, remarks, parts, count } = self;
        let step = count.div_ceil(1 << 12).max(1);
        let positions = parts.iter().flat_map(|(splats, place)| {
            splats.means.iter().step_by(step).map(|mean| place.point(origin::wide(*mean)))
        });
        let size = parts.iter().map(|(splats, place)| place.scale * origin::usual_size(splats)).fold(0.0, f64::max);
        let is_moved = parts.iter().any(|(_, place)| place.translation != DVec3::ZERO);
        let moved_by = match metadata.origin {
            None if is_moved => origin::choose(&positions.collect::<Vec<_>>(), size).unwrap_or(DVec3::ZERO),
            _ => DVec3::ZERO,
        };
        let from = metadata.origin.unwrap_or(moved_by);
        let mut all = Splats::default();
        for (mut splats, place) in parts {
            Similarity { translation: place.translation - from, ..place }.apply_to(&mut splats);
            all = Splats::joined(all, splats);
        }
        Scene { splats: all, metadata, remarks, moved_by, ..Scene::default() }
    }
}

/// Returns true if splats are read rightly of a file that requires an extension: it is of splats, or of what splats do not
/// have, such as materials.
fn is_read(extension: &str) -> bool {
    const OF_OTHERS: [&str; 7] = [
        "KHR_mesh_quantization",
        "KHR_materials_",
        "KHR_texture_",
        "KHR_lights_",
        "EXT_mesh_features",
        "EXT_instance_features",
        "EXT_structural_metadata",
    ];
    extension == SPLATTING || is_spz(extension) || OF_OTHERS.iter().any(|start| extension.starts_with(start))
}

/// Returns true if this is a name of the extension of splats in an SPZ. Drafts had several: `KHR_spz_compression`,
/// `KHR_spz_gaussian_splats_compression`, `KHR_gaussian_splatting_compression_spz` and that with `_2`.
fn is_spz(extension: &str) -> bool {
    extension.split('_').any(|word| word == "spz")
}

/// JSON and binary chunk of a GLB.
fn chunks(file: &[u8]) -> Result<(&[u8], Option<&[u8]>), Problem> {
    let mut bytes = Bytes::new(file, "the GLB");
    let (_, version, _) = (bytes.u32()?, bytes.u32()?, bytes.u32()?);
    if version != 2 {
        return Err(fault(format!("version {version} is not read, 2 is")));
    }
    let (JSON, json) = chunk(&mut bytes)? else {
        return Err(fault("the first chunk of the GLB is not JSON"));
    };
    let bin = if bytes.rest().is_empty() { None } else { Some(chunk(&mut bytes)?) };
    Ok((json, bin.filter(|(kind, _)| *kind == BIN).map(|(_, bin)| bin)))
}

/// Type and content of the next chunk of a GLB.
fn chunk<'a>(bytes: &mut Bytes<'a>) -> Result<(u32, &'a [u8]), Problem> {
    let (length, kind) = (bytes.u32()?, bytes.u32()?);
    Ok((kind, bytes.take(u64::from(length))?))
}

fn read_buffer<'a>(buffer: &Buffer, bin: Option<&'a [u8]>, main: &Path) -> Result<Cow<'a, [u8]>, Problem> {
    let Some(uri) = &buffer.uri else {
        return bin.map(Cow::Borrowed).ok_or_else(|| fault("a buffer has no content"));
    };
    if let Some(data) = uri.strip_prefix("data:") {
        let text = data.split_once(";base64,").map(|(_, text)| text);
        let bytes = text.and_then(|text| BASE64_STANDARD.decode(text).ok());
        return bytes.map(Cow::Owned).ok_or_else(|| fault("a buffer's data is not base64"));
    }
    let name = excerpt(uri.as_bytes());
    let path = Path::new(uri);
    if uri.is_empty()
        || !path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
    {
        return Err(fault(format!("the buffer \"{name}\" is not a file below its folder")));
    }
    let path = beside(main, path);
    let read = match files::is_file(&path) {
        Ok(false) => Err(std::io::ErrorKind::InvalidInput.into()),
        _ => files::read(&path),
    };
    read.map(Cow::Owned).map_err(|error| fault(format!("the buffer \"{name}\" cannot be read: {error}")))
}

/// Fewest bytes of a splat in memory.
const SPLAT_SIZE: u64 = 56;

struct Reader<'a> {
    gltf: &'a Gltf,
    buffers: Vec<Cow<'a, [u8]>>,
    /// Bytes of the buffers.
    size: u64,
}

impl Reader<'_> {
    fn node(
        &self,
        index: usize,
        above: &Similarity,
        met: &mut [bool],
        read: &mut Placed,
    ) -> Result<(), Problem> {
        // Each node is met once, so that what is below is a tree; deeper ones than the stack holds are refused.
        let mut waiting = vec![(index, *above)];
        while let Some((index, above)) = waiting.pop() {
            let node =
                self.gltf.nodes.get(index).ok_or_else(|| fault(format!("there is no node {index}")))?;
            if std::mem::replace(&mut met[index], true) {
                return Err(fault(format!("node {index} stands at two places")));
            }
            let here = above.after(&similarity(node).ok_or_else(|| {
                fault(format!("node {index} is not scaled alike in all directions, or mirrored"))
            })?);
            if let Some(mesh) = node.mesh {
                let mesh =
                    self.gltf.meshes.get(mesh).ok_or_else(|| fault(format!("there is no mesh {mesh}")))?;
                self.mesh(mesh, &here, read)?;
            }
            waiting.extend(node.children.iter().rev().map(|child| (*child, here)));
        }
        Ok(())
    }

    fn mesh(&self, mesh: &Mesh, place: &Similarity, read: &mut Placed) -> Result<(), Problem> {
        for primitive in &mesh.primitives {
            let extension = primitive.extensions.get(SPLATTING);
            // An SPZ is in the extension; early drafts had it beside, or instead.
            let inner = extension.and_then(|e| e.get("extensions")).and_then(Value::as_object);
            let packed = inner.into_iter().flatten().chain(&primitive.extensions);
            let packed = packed.into_iter().find(|(name, _)| is_spz(name)).map(|(_, packed)| packed);
            let Some(extension) = extension.or(packed) else { continue };
            let mut splats = match packed {
                Some(packed) => {
                    let view = packed.get("bufferView").and_then(Value::as_u64);
                    let view = view.ok_or_else(|| fault("the SPZ's bufferView is not a number"))?;
                    let mut inner = spz::read(self.view(view as usize)?.1)?;
                    // As CesiumJS has them, the axes are those of glTF already.
                    if extension.get("kernel").is_some() {
                        spz::FORMAT.axes.turn(&mut inner);
                        FORMAT.axes.turn(&mut inner);
                    }
                    read.metadata = std::mem::take(&mut read.metadata).or(inner.metadata);
                    add_new(&mut read.remarks, &inner.remarks);
                    self.groups(primitive, &mut inner.splats)?;
                    inner.splats
                }
                None => self.splats(primitive)?,
            };
            add_new(&mut read.remarks, &interpret(extension, &mut splats));
            // Nodes may share a mesh, and meshes values: as many splats as a bomb wants.
            let together = (read.count + splats.len()) as u64 * SPLAT_SIZE;
            check_unpacked(together, self.size, "a glTF whose nodes share splats")?;
            read.count += splats.len();
            read.parts.push((splats, *place));
        }
        Ok(())
    }

    fn splats(&self, primitive: &Primitive) -> Result<Splats, Problem> {
        let get = |name: &str| primitive.attributes.get(name).copied();
        let needed =
            |name: &str| get(name).ok_or_else(|| fault(format!("the splats have no attribute {name}")));
        let degree = (1..=sh::MAX_DEGREE)
            .rfind(|d| get(&sh_attribute(sh::coefficients(*d) - 1)).is_some())
            .unwrap_or(0);
        let position = needed("POSITION")?;
        // The other attributes have as many values, or `fill` says so.
        let count = self.accessor(position)?.count;
        self.numbers::<3>(position, count, |_, _| ())?;
        let mut splats = Splats::zeroed(count as usize, degree);
        self.numbers::<3>(position, count, |i, v| splats.means[i] = v)?;
        self.numbers::<4>(needed(&attribute("ROTATION"))?, count, |i, [x, y, z, w]| {
            splats.quats[i] = [w, x, y, z];
        })?;
        let mut least = f32::INFINITY;
        self.numbers::<3>(needed(&attribute("SCALE"))?, count, |i, v| {
            least = v.iter().fold(least, |least, v| least.min(*v));
            splats.log_scales[i] = v;
        })?;
        if least >= 0.0 {
            splats.log_scales.as_flattened_mut().iter_mut().for_each(|v| *v = v.ln());
        }
        self.numbers::<1>(needed(&attribute("OPACITY"))?, count, |i, [v]| {
            splats.logit_opacities[i] = logit(f64::from(v)) as f32;
        })?;
        let stride = splats.sh_stride();
        for coefficient in 0..sh::coefficients(degree) {
            let name = sh_attribute(coefficient);
            self.numbers::<3>(needed(&name)?, count, |i, v| {
                splats.sh[i * stride + coefficient * 3..][..3].copy_from_slice(&v);
            })?;
        }
        self.groups(primitive, &mut splats)?;
        Ok(splats)
    }

    /// Reads the groups of splats, where a file has them.
    fn groups(&self, primitive: &Primitive, splats: &mut Splats) -> Result<(), Problem> {
        let Some(groups) = primitive.attributes.get("_GROUP").copied() else { return Ok(()) };
        self.numbers::<1>(groups, splats.len() as u64, |i, [v]| {
            splats.groups[i] = Group::from_number(v as u8).unwrap_or_default();
        })
    }

    fn accessor(&self, index: usize) -> Result<&Accessor, Problem> {
        self.gltf.accessors.get(index).ok_or_else(|| fault(format!("there is no accessor {index}")))
    }

    /// A buffer view and its bytes.
    fn view(&self, index: usize) -> Result<(&BufferView, &[u8]), Problem> {
        let view = self
            .gltf
            .buffer_views
            .get(index)
            .ok_or_else(|| fault(format!("there is no buffer view {index}")))?;
        let buffer = self
            .buffers
            .get(view.buffer)
            .ok_or_else(|| fault(format!("there is no buffer {}", view.buffer)))?;
        let mut bytes = Bytes::new(buffer, "a buffer of the glTF");
        bytes.take(view.byte_offset)?;
        Ok((view, bytes.take(view.byte_length)?))
    }

    /// Calls `each` with the values of an accessor of `count` elements of `N` numbers.
    fn numbers<const N: usize>(
        &self,
        index: usize,
        count: u64,
        mut each: impl FnMut(usize, [f32; N]),
    ) -> Result<(), Problem> {
        let accessor = self.accessor(index)?;
        let kind = ["", "SCALAR", "VEC2", "VEC3", "VEC4"][N];
        if accessor.kind != kind || accessor.count != count {
            let Accessor { kind: found, count: other, .. } = accessor;
            let found = excerpt(found.as_bytes());
            return Err(fault(format!("accessor {index} has {other} {found}, {count} {kind} are needed")));
        }
        let Some(view) = accessor.buffer_view.filter(|_| accessor.sparse.is_none()) else {
            return Err(fault(format!(
                "accessor {index} is sparse or has no buffer view, which is not read"
            )));
        };
        let (view, bytes) = self.view(view)?;
        // Component size, and what normalised integers are divided by.
        let (size, divisor): (u64, f32) = match accessor.component_type {
            5120 => (1, 127.0),
            5121 => (1, 255.0),
            5122 => (2, 32_767.0),
            5123 => (2, 65_535.0),
            5126 => (4, 1.0),
            other => {
                return Err(fault(format!(
                    "accessor {index} has the component type {other}, which no splat has"
                )));
            }
        };
        // The lowest of normalised signed integers means -1 too.
        let (divisor, least) = if accessor.normalized { (divisor, -1.0) } else { (1.0, f32::NEG_INFINITY) };
        let row = size * N as u64;
        let stride = view.byte_stride.unwrap_or(row).max(row);
        let mut bytes = Bytes::new(bytes, "an accessor of the glTF");
        bytes.take(accessor.byte_offset)?;
        let needed = count.checked_sub(1).map_or(Some(0), |gaps| gaps.checked_mul(stride)?.checked_add(row));
        let bytes = bytes.take(needed.ok_or_else(|| fault(format!("accessor {index} is too long")))?)?;
        let component = accessor.component_type;
        for (i, row) in bytes.chunks(stride as usize).enumerate() {
            let value = |k: usize| {
                let at = &row[k * size as usize..];
                let (byte, short) = (at[0], at.first_chunk().copied().unwrap_or_default());
                match component {
                    5120 => (f32::from(byte as i8) / divisor).max(least),
                    5121 => f32::from(byte) / divisor,
                    5122 => (f32::from(i16::from_le_bytes(short)) / divisor).max(least),
                    5123 => f32::from(u16::from_le_bytes(short)) / divisor,
                    _ => at.first_chunk().map_or(0.0, |b| f32::from_le_bytes(*b)),
                }
            };
            each(i, std::array::from_fn(value));
        }
        Ok(())
    }
}

/// Brings the colours of splats to those of a [`Scene`], and says what of the extension is not as it states.
fn interpret(extension: &Value, splats: &mut Splats) -> Vec<Remark> {
    let stated = |key: &str| extension.get(key).and_then(Value::as_str);
    let mut remarks = Vec::new();
    if stated("colorSpace") == Some("lin_rec709_display") {
        encode_colors(splats);
        let text = "glTF: the colours are linear light (lin_rec709_display) and become sRGB splat by splat; where splats \
                    blend, sRGB is blended";
        remarks.push(Remark::note("linear-colours", text));
    }
    for (key, known) in [
        ("kernel", &["ellipse"][..]),
        ("colorSpace", &["srgb_rec709_display", "lin_rec709_display"]),
        ("projection", &["perspective"]),
        ("sortingMethod", &["cameraDistance", "zDepth"]),
    ] {
        if let Some(other) = stated(key).filter(|value| !known.contains(value)) {
            let text = format!(
                "glTF: the {key} {} is not known, {} is taken; export the splats with it",
                excerpt(other.as_bytes()),
                known[0]
            );
            remarks.push(Remark::doubt("splat-kind", text));
        }
    }
    remarks
}

/// Replaces SH of linear light by those of the sRGB colours that they show: the nearest ones of their degree over all directions.
fn encode_colors(splats: &mut Splats) {
    // Gauss's places for cosines, even steps around: exact for products of two functions of degree 3.
    const PLACES: [(f64, f64); 4] = [
        (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
        (-0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
        (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
        (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    ];
    const AROUND: usize = 8;
    let directions = PLACES.into_iter().flat_map(|(z, weight)| {
        (0..AROUND).map(move |step| {
            let (sine, cosine) = (std::f64::consts::TAU * (step as f64 + 0.5) / AROUND as f64).sin_cos();
            let across = (1.0 - z * z).sqrt();
            ([across * cosine, across * sine, z], weight * std::f64::consts::TAU / AROUND as f64)
        })
    });
    let directions: Vec<([f64; 3], [f64; 16], f64)> =
        directions.map(|(direction, weight)| (direction, sh::basis(direction), weight)).collect();
    let stride = splats.sh_stride();
    for sh in splats.sh.chunks_exact_mut(stride) {
        let mut encoded = [0.0; 48];
        for (direction, basis, weight) in &directions {
            let shown = sh::color(sh, *direction).map(srgb_encode);
            for (k, value) in encoded[..stride].iter_mut().enumerate() {
                *value += weight * basis[k / 3] * (shown[k % 3] - 0.5);
            }
        }
        sh.iter_mut().zip(encoded).for_each(|(value, encoded)| *value = encoded as f32);
    }
}

/// The transform of a node; `None` if it stretches or mirrors.
fn similarity(node: &Node) -> Option<Similarity> {
    let matrix = match &node.matrix {
        Some(matrix) => DMat4::from_cols_array(matrix),
        None => DMat4::from_scale_rotation_translation(
            DVec3::from_array(node.scale),
            DQuat::from_array(node.rotation).normalize(),
            DVec3::from_array(node.translation),
        ),
    };
    let linear = DMat3::from_mat4(matrix);
    let scale = linear.determinant().cbrt();
    let rotation = linear * (1.0 / scale);
    let is_rotation = (rotation * rotation.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-4);
    let sound = scale > 0.0 && scale.is_finite() && is_rotation && matrix.w_axis.is_finite();
    // What is a rotation up to rounding of the file's text need not be touched.
    let rotation = if rotation.abs_diff_eq(DMat3::IDENTITY, 1e-12) { DMat3::IDENTITY } else { rotation };
    sound.then(|| Similarity { scale, rotation, translation: matrix.w_axis.truncate() })
}
