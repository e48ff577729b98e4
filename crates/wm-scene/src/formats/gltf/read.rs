//! Reading: JSON, buffers, nodes, accessors.

use super::kind::interpret;
use super::words::{AXES, BIN, JSON, MAGIC, SPLATTING, attribute, sh_attribute};
use crate::{
    Group, Metadata, Remark, Scene, Splats,
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
use wm_base::{
    error::{Problem, excerpt, one_line},
    files,
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
    mesh: Option<usize>,
    #[serde(default)]
    children: Vec<usize>,
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
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: u64,
    component_type: u32,
    #[serde(default)]
    normalized: bool,
    count: u64,
    #[serde(rename = "type")]
    kind: String,
    sparse: Option<Value>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct BufferView {
    buffer: usize,
    #[serde(default)]
    byte_offset: u64,
    byte_length: u64,
    byte_stride: Option<u64>,
}

#[derive(Deserialize)]
struct Buffer {
    uri: Option<String>,
}

fn fault(what: impl Into<String>) -> Problem {
    Problem::Header(format!("glTF: {}", what.into()))
}

/// Reads a file in memory; buffers in other files are below the folder of its path, `main`. The
/// scene has the axes of glTF.
pub(super) fn read(file: &[u8], main: &Path) -> Result<Scene, Problem> {
    let (json, bin) = if file.starts_with(MAGIC) { chunks(file)? } else { (file, None) };
    let gltf: Gltf = serde_json::from_slice(files::without_byte_order_mark(json))
        .map_err(|error| fault(one_line(&error.to_string())))?;
    if let Some(unknown) = gltf.extensions_required.iter().find(|name| !is_read(name)) {
        let name: String = one_line(unknown).chars().take(80).collect();
        return Err(fault(format!("it requires the extension {name}, which is not read")));
    }
    if let Some(fault_of) = gltf.asset.extras.wm.fault() {
        return Err(fault(format!("asset.extras.wm: {fault_of}")));
    }
    let buffers = gltf.buffers.iter().map(|buffer| read_buffer(buffer, bin, main));
    let buffers = buffers.collect::<Result<Vec<_>, _>>()?;
    let size = buffers.iter().map(|buffer| buffer.len() as u64).sum();
    let reader = Reader { gltf: &gltf, buffers, size };
    let mut read = PlacedSplats { metadata: gltf.asset.extras.wm.clone(), ..PlacedSplats::default() };
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
struct PlacedSplats {
    metadata: Metadata,
    remarks: Vec<Remark>,
    parts: Vec<(Splats, Similarity)>,
    /// Number of splats.
    count: usize,
}

impl PlacedSplats {
    /// The scene, relative to the origin that the file states, else to one that suits its places: a
    /// node may stand far from zero, with splats near to it.
    fn scene(self) -> Scene {
        let Self { metadata, remarks, parts, count } = self;
        let step = count.div_ceil(1 << 12).max(1);
        let positions = parts.iter().flat_map(|(splats, place)| {
            splats.means.iter().step_by(step).map(|mean| place.point(origin::wide(*mean)))
        });
        let size =
            parts.iter().map(|(splats, place)| place.scale * origin::usual_size(splats)).fold(0.0, f64::max);
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

/// Returns true if splats are read rightly of a file that requires an extension: it is of splats,
/// or of what splats do not have, such as materials.
fn is_read(extension: &str) -> bool {
    const FOREIGN_PREFIXES: [&str; 7] = [
        "KHR_mesh_quantization",
        "KHR_materials_",
        "KHR_texture_",
        "KHR_lights_",
        "EXT_mesh_features",
        "EXT_instance_features",
        "EXT_structural_metadata",
    ];
    extension == SPLATTING
        || is_spz(extension)
        || FOREIGN_PREFIXES.iter().any(|start| extension.starts_with(start))
}

/// Returns true if this is a name of the extension of splats in an SPZ. Drafts had several:
/// `KHR_spz_compression`, `KHR_spz_gaussian_splats_compression`,
/// `KHR_gaussian_splatting_compression_spz` and that with `_2`.
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
const MIN_SPLAT_BYTES: u64 = 56;

/// An entry of a list of the file.
fn listed<'a, T>(list: &'a [T], index: usize, kind: &str) -> Result<&'a T, Problem> {
    list.get(index).ok_or_else(|| fault(format!("there is no {kind} {index}")))
}

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
        read: &mut PlacedSplats,
    ) -> Result<(), Problem> {
        // Each node is met once, so that what is below is a tree; deeper ones than the stack holds
        // are refused.
        let mut waiting = vec![(index, *above)];
        while let Some((index, above)) = waiting.pop() {
            let node = listed(&self.gltf.nodes, index, "node")?;
            if std::mem::replace(&mut met[index], true) {
                return Err(fault(format!("node {index} stands at two places")));
            }
            let here = above.after(&similarity(node).ok_or_else(|| {
                fault(format!("node {index} is not scaled alike in all directions, or mirrored"))
            })?);
            if let Some(mesh) = node.mesh {
                self.mesh(listed(&self.gltf.meshes, mesh, "mesh")?, &here, read)?;
            }
            waiting.extend(node.children.iter().rev().map(|child| (*child, here)));
        }
        Ok(())
    }

    fn mesh(&self, mesh: &Mesh, place: &Similarity, read: &mut PlacedSplats) -> Result<(), Problem> {
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
                    // As CesiumJS has them, the axes are those of glTF already; such files lack
                    // what the extension demands.
                    if ["kernel", "colorSpace"].iter().all(|key| extension.get(key).is_some()) {
                        spz::FORMAT.axes.turn(&mut inner);
                        AXES.turn(&mut inner);
                    } else {
                        let text = "glTF: the numbers in its SPZ are taken for those of glTF's axes, as CesiumJS does";
                        add_new(&mut read.remarks, &[Remark::note("spz-axes", text)]);
                    }
                    read.metadata = std::mem::take(&mut read.metadata).or(inner.metadata);
                    add_new(&mut read.remarks, &inner.remarks);
                    self.groups(primitive, &mut inner.splats)?;
                    inner.splats
                }
                None => self.splats(primitive, extension)?,
            };
            add_new(&mut read.remarks, &interpret(extension, &mut splats));
            // Nodes may share a mesh, and meshes values: as many splats as a bomb wants.
            let together = (read.count + splats.len()) as u64 * MIN_SPLAT_BYTES;
            check_unpacked(together, self.size, "a glTF whose nodes share splats")?;
            read.count += splats.len();
            read.parts.push((splats, *place));
        }
        Ok(())
    }

    fn splats(&self, primitive: &Primitive, extension: &Value) -> Result<Splats, Problem> {
        let get = |name: &str| primitive.attributes.get(name).copied();
        // Drafts had `_SCALE` and the like, or the accessors in the extension, and the colour in
        // COLOR_0 alone.
        let index = |value: Option<&Value>| Some(value?.as_u64()? as usize);
        let find = |name: &str| {
            let draft = get(&format!("_{name}")).or_else(|| index(extension.get(name.to_lowercase())));
            get(&attribute(name)).or(draft)
        };
        let coefficient =
            |k: usize| get(&sh_attribute(k)).or_else(|| index(extension.get("sh").and_then(|sh| sh.get(k))));
        let known = |accessor: Option<usize>, name: &str| {
            accessor.ok_or_else(|| fault(format!("the splats have no attribute {name}")))
        };
        let needed = |name: &str| known(find(name), &attribute(name));
        let degree =
            (1..=sh::MAX_DEGREE).rfind(|d| coefficient(sh::coefficients(*d) - 1).is_some()).unwrap_or(0);
        let position = known(get("POSITION"), "POSITION")?;
        // The other attributes have as many values, or `fill` says so.
        let count = self.accessor(position)?.count;
        self.numbers::<3>(position, count, |_, _| ())?;
        let mut splats = Splats::zeroed(count as usize, degree);
        self.numbers::<3>(position, count, |i, v| splats.means[i] = v)?;
        self.numbers::<4>(needed("ROTATION")?, count, |i, [x, y, z, w]| {
            splats.quats[i] = [w, x, y, z];
        })?;
        let mut least = f32::INFINITY;
        self.numbers::<3>(needed("SCALE")?, count, |i, v| {
            least = v.iter().fold(least, |least, v| least.min(*v));
            splats.log_scales[i] = v;
        })?;
        if least >= 0.0 {
            splats.log_scales.as_flattened_mut().iter_mut().for_each(|v| *v = v.ln());
        }
        let stride = splats.sh_stride();
        let color = get("COLOR_0").filter(|_| coefficient(0).is_none());
        if let Some(color) = color {
            let has_alpha = self.accessor(color)?.kind == "VEC4";
            let mut take = |i: usize, [r, g, b, a]: [f32; 4]| {
                splats.sh[i * stride..][..3]
                    .copy_from_slice(&[r, g, b].map(|v| sh::dc_of(f64::from(v)) as f32));
                splats.logit_opacities[i] = logit(f64::from(a)) as f32;
            };
            match has_alpha {
                true => self.numbers::<4>(color, count, take)?,
                false => self.numbers::<3>(color, count, |i, [r, g, b]| take(i, [r, g, b, 1.0]))?,
            }
        }
        if color.is_none() || find("OPACITY").is_some() {
            self.numbers::<1>(needed("OPACITY")?, count, |i, [v]| {
                splats.logit_opacities[i] = logit(f64::from(v)) as f32;
            })?;
        }
        for k in usize::from(color.is_some())..sh::coefficients(degree) {
            self.numbers::<3>(known(coefficient(k), &sh_attribute(k))?, count, |i, v| {
                splats.sh[i * stride + k * 3..][..3].copy_from_slice(&v);
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
        listed(&self.gltf.accessors, index, "accessor")
    }

    /// A buffer view and its bytes.
    fn view(&self, index: usize) -> Result<(&BufferView, &[u8]), Problem> {
        let view = listed(&self.gltf.buffer_views, index, "buffer view")?;
        let mut bytes = Bytes::new(listed(&self.buffers, view.buffer, "buffer")?, "a buffer of the glTF");
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
