//! Writing a GLB.

use super::words::{AXES, BIN, FLOAT, JSON, MAGIC, SPLATTING, SPZ, UNSIGNED_BYTE, attribute, sh_attribute};
use crate::{
    Group, Scene, Splats,
    formats::{
        GltfSplats, SpzVersion, WriteOptions,
        pack::{byte_of_dc, byte_of_logit, unit},
        spz,
    },
    splats::sigmoid,
    values::ends,
};
use serde_json::{Map, Value, json};
use std::io::Write;
use wm_base::error::Problem;

/// A value of a splat that is an attribute: type, component type and bytes of the accessor, and its
/// writer.
struct Attribute<'a> {
    name: String,
    accessor: (&'static str, u32, u64),
    write: WriteOne<'a>,
}

/// Appends the bytes of the splat of an index.
type WriteOne<'a> = Box<dyn Fn(usize, &mut Vec<u8>) + 'a>;

fn floats<'a, const N: usize>(
    name: impl Into<String>,
    values: impl Fn(usize) -> [f32; N] + 'a,
) -> Attribute<'a> {
    let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][N - 1];
    Attribute {
        name: name.into(),
        accessor: (kind, FLOAT, 4 * N as u64),
        write: Box::new(move |index, out| values(index).iter().for_each(|v| out.extend(v.to_le_bytes()))),
    }
}

fn attributes(splats: &Splats) -> Vec<Attribute<'_>> {
    let axes = AXES;
    let signs = axes.sh_signs();
    let color = |index: usize, out: &mut Vec<u8>| {
        out.extend(splats.sh_of(index)[..3].iter().map(|v| byte_of_dc(*v)));
        out.push(byte_of_logit(splats.logit_opacities[index]));
    };
    let rotation = move |index: usize| {
        let [w, x, y, z] = unit(axes.quat(splats.quats[index]));
        [x, y, z, w]
    };
    let opacity = |index: usize| [sigmoid(f64::from(splats.logit_opacities[index])) as f32];
    let mut all = vec![
        floats(POSITION, move |index| axes.vector(splats.means[index])),
        // Bytes, for programs that know no splats.
        Attribute { name: COLOR.into(), accessor: ("VEC4", UNSIGNED_BYTE, 4), write: Box::new(color) },
        floats(attribute("ROTATION"), rotation),
        floats(attribute("SCALE"), |index| splats.log_scales[index].map(f32::exp)),
        floats(attribute("OPACITY"), opacity),
    ];
    all.extend((0..splats.sh_stride() / 3).map(|k| {
        floats(sh_attribute(k), move |index| [0, 1, 2].map(|c| splats.sh_of(index)[k * 3 + c] * signs[k]))
    }));
    if splats.groups.iter().any(|group| *group != Group::Scene) {
        all.push(floats(GROUP, |index| [f32::from(splats.groups[index] as u8)]));
    }
    all
}

pub(super) fn write(out: &mut dyn Write, scene: &Scene, options: &WriteOptions) -> Result<(), Problem> {
    let splats = &scene.splats;
    if let Some(fault) = scene.metadata.fault() {
        return Err(Problem::Value(format!("not written: {fault}")));
    }
    let mut all = attributes(splats);
    match options.gltf {
        GltfSplats::Floats => {
            let sizes: Vec<u64> = all.iter().map(|a| a.accessor.2 * splats.len() as u64).collect();
            let binary = sizes.iter().sum();
            head(out, &document(scene, &all, &sizes, options.gltf), binary)?;
            let mut bytes = Vec::new();
            for attribute in &all {
                for index in 0..splats.len() {
                    (attribute.write)(index, &mut bytes);
                    if bytes.len() >= PART_BYTES {
                        out.write_all(&bytes)?;
                        bytes.clear();
                    }
                }
            }
            Ok(out.write_all(&bytes)?)
        }
        GltfSplats::Spz | GltfSplats::SpzCesium => {
            let mut packed = Vec::new();
            let inner = WriteOptions { spz: SpzVersion::V3, ..*options };
            if options.gltf == GltfSplats::SpzCesium {
                // It has the opacity and the first coefficients of SH in COLOR_0.
                let inside = [attribute("OPACITY"), sh_attribute(0), GROUP.into()];
                all.retain(|a| !inside.contains(&a.name));
                let mut turned = scene.clone();
                AXES.turn(&mut turned);
                spz::FORMAT.axes.turn(&mut turned);
                spz::write(&mut packed, &turned, &inner)?;
            } else {
                spz::write(&mut packed, scene, &inner)?;
            }
            let length = packed.len() as u64;
            packed.resize(packed.len().next_multiple_of(4), 0);
            // The groups, which an SPZ has no room for, come behind it.
            let mut groups = Vec::new();
            if let Some(attribute) = all.iter().find(|a| a.name == GROUP) {
                (0..splats.len()).for_each(|index| (attribute.write)(index, &mut groups));
            }
            let sizes = [length, groups.len() as u64];
            let sizes = &sizes[..if groups.is_empty() { 1 } else { 2 }];
            let binary = (packed.len() + groups.len()) as u64;
            head(out, &document(scene, &all, sizes, options.gltf), binary)?;
            out.write_all(&packed)?;
            Ok(out.write_all(&groups)?)
        }
    }
}

const POSITION: &str = "POSITION";
const COLOR: &str = "COLOR_0";
const GROUP: &str = "_GROUP";
/// Bytes gathered before they are written.
const PART_BYTES: usize = 1 << 18;

/// Writes everything before the binary chunk's `length` bytes.
fn head(out: &mut dyn Write, document: &Value, length: u64) -> Result<(), Problem> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() as u64 + 8 + length;
    let [total, binary] = [total, length].map(u32::try_from);
    let (Ok(total), Ok(binary)) = (total, binary) else {
        return Err(Problem::Value("too many splats for one .glb, which ends at 4 GiB; reduce them".into()));
    };
    out.write_all(MAGIC)?;
    for word in [2, total, json.len() as u32, JSON] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(&json)?;
    out.write_all(&binary.to_le_bytes())?;
    Ok(out.write_all(&BIN.to_le_bytes())?)
}

/// The JSON. A buffer view of each of `sizes`, from places that four divides; accessors have one
/// each, or none where an SPZ has their values.
fn document(scene: &Scene, all: &[Attribute], sizes: &[u64], form: GltfSplats) -> Value {
    let is_packed = form != GltfSplats::Floats;
    let splats = &scene.splats;
    let mut at = 0;
    let views: Vec<Value> = sizes
        .iter()
        .map(|size| {
            let mut view = json!({ "buffer": 0, "byteOffset": at, "byteLength": size });
            if !is_packed {
                view["target"] = json!(34_962);
            }
            at += size.next_multiple_of(4);
            view
        })
        .collect();
    let [low, high] = ends(splats.means.iter().map(|mean| AXES.vector(*mean)));
    let mut names = Map::new();
    let mut accessors = Vec::new();
    for (index, attribute) in all.iter().enumerate() {
        let (kind, component, _) = attribute.accessor;
        let mut accessor = json!({ "componentType": component, "count": splats.len(), "type": kind });
        if !is_packed || attribute.name == GROUP {
            accessor["bufferView"] = json!(if is_packed { 1 } else { index });
        }
        if attribute.name == POSITION {
            accessor["min"] = json!(low);
            accessor["max"] = json!(high);
        } else if attribute.name == COLOR {
            accessor["normalized"] = json!(true);
        }
        names.insert(attribute.name.clone(), json!(index));
        accessors.push(accessor);
    }
    let mut extension = match form {
        GltfSplats::SpzCesium => json!({}),
        GltfSplats::Floats | GltfSplats::Spz => json!({
            "kernel": "ellipse",
            "colorSpace": "srgb_rec709_display",
            "sortingMethod": "cameraDistance",
            "projection": "perspective",
        }),
    };
    let mut used = vec![SPLATTING];
    if is_packed {
        extension["extensions"] = json!({ SPZ: { "bufferView": 0 } });
        used.push(SPZ);
    }
    let mut metadata = scene.metadata.clone();
    AXES.turn_facts(&mut metadata);
    let mut asset = json!({
        "version": "2.0",
        "generator": concat!("weather-magician ", env!("CARGO_PKG_VERSION")),
    });
    if metadata != Default::default() {
        asset["extras"] = json!({ "wm": metadata });
    }
    let mut node = json!({ "mesh": 0 });
    if let Some(origin) = metadata.origin {
        node["translation"] = json!(origin.to_array().map(|v| v + 0.0));
    }
    let mut document = json!({
        "asset": asset,
        "extensionsUsed": used,
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [node],
        "meshes": [{ "primitives": [{
            "attributes": names,
            "mode": 0,
            "extensions": { SPLATTING: extension },
        }] }],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": at }],
    });
    if is_packed {
        document["extensionsRequired"] = json!(used);
    }
    document
}
