// Colours and normals of the records that touch a packet, seen from the middle of the group.

// The coefficients of colours of consecutive records.
struct ColorPiece {
    first: u32,
    count: u32,
    // Numbers a record.
    stride: u32,
}

@group(0) @binding(1) var<uniform> piece: ColorPiece;
@group(0) @binding(2) var<storage, read> counters: array<u32, 4>;
@group(0) @binding(3) var<storage, read> records: array<RayRecord>;
@group(0) @binding(4) var<storage, read> order: array<u32>;
@group(0) @binding(5) var<storage, read> sh: array<f32>;
// `[records][FEATURES]`
@group(0) @binding(6) var<storage, read_write> features: array<f32>;

fn coefficient(at: u32, k: u32) -> vec3<f32> {
    return vec3<f32>(sh[at + 3u * k], sh[at + 3u * k + 1u], sh[at + 3u * k + 2u]);
}

// Display-referred and not clamped, of what is seen along the unit vector `d`.
fn color_of(at: u32, d: vec3<f32>) -> vec3<f32> {
    let dd = d * d;
    var basis = array<f32, 16>(
        C0,
        -C1 * d.y,
        C1 * d.z,
        -C1 * d.x,
        C2[0] * d.x * d.y,
        C2[1] * d.y * d.z,
        C2[2] * (2.0 * dd.z - dd.x - dd.y),
        C2[3] * d.x * d.z,
        C2[4] * (dd.x - dd.y),
        C3[0] * d.y * (3.0 * dd.x - dd.y),
        C3[1] * d.x * d.y * d.z,
        C3[2] * d.y * (4.0 * dd.z - dd.x - dd.y),
        C3[3] * d.z * (2.0 * dd.z - 3.0 * (dd.x + dd.y)),
        C3[4] * d.x * (4.0 * dd.z - dd.x - dd.y),
        C3[5] * d.z * (dd.x - dd.y),
        C3[6] * d.x * (dd.x - 3.0 * dd.y),
    );
    var rgb = vec3<f32>(0.5);
    for (var k = 0u; 3u * k < min(piece.stride, 48u); k++) {
        rgb += basis[k] * coefficient(at, k);
    }
    return rgb;
}

@compute @workgroup_size(WORKGROUP)
fn see(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let i = group_index(workgroup) * WORKGROUP + local;
    if i >= counters[0] {
        return;
    }
    let name = order[i];
    if name < piece.first || name >= piece.first + piece.count {
        return;
    }
    let record = records[name];
    let way = record.mean - task.center;
    let distance = length(way);
    let d = select(vec3<f32>(0.0), way / max(distance, TINY), distance > TINY);
    let at = FEATURES * name;
    if COLOR {
        let color = color_of((name - piece.first) * piece.stride, d);
        for (var k = 0u; k < 3u; k++) {
            features[at + k] = color[k];
        }
    }
    if NORMAL {
        // Its largest number first: squares of small splats' rows would be infinite.
        var row = record.row_0;
        row /= max(max(abs(row.x), abs(row.y)), max(abs(row.z), TINY));
        row /= length(row);
        let normal = select(row, -row, dot(row, d) > 0.0);
        for (var k = 0u; k < 3u; k++) {
            features[at + FEATURES - 3u + k] = normal[k];
        }
    }
}
