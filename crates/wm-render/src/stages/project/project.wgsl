// The records of the splats in view, in the order of the splats, and the keys by which they are sorted.

@group(0) @binding(6) var<storage, read_write> records: array<Record>;
@group(0) @binding(7) var<storage, read_write> depths: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn project_visible(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group_index(workgroup);
    if block >= chunk.blocks {
        return;
    }
    let at = chunk.first_block + block;
    let own = blocks[at].mask[local / 32u];
    let bit = local % 32u;
    if ((own >> bit) & 1u) == 0u {
        return;
    }
    var slot = blocks[at].count + countOneBits(own & ((1u << bit) - 1u));
    for (var word = 0u; word < local / 32u; word++) {
        slot += countOneBits(blocks[at].mask[word]);
    }
    if slot >= view.visible_capacity {
        return;
    }

    let splat = block * WORKGROUP + local;
    let p = project(splat);
    let distance = length(p.offset);
    let direction = p.offset / distance;
    let seen = through_air(direction, select(distance, FAR_AWAY, is_sky(splat)), shade(splat, direction));

    // The shortest axis, the first of equal ones, towards the camera.
    var normal = p.axes[0];
    if p.scales.z < min(p.scales.x, p.scales.y) {
        normal = p.axes[2];
    } else if p.scales.y < p.scales.x {
        normal = p.axes[1];
    }
    normal = select(normal, -normal, dot(normal, p.offset) > 0.0);

    let vy = sqrt(p.cov.x / p.det) * SQRT_HALF_LOG2E;
    let ux = SQRT_HALF_LOG2E / sqrt(p.cov.x);
    let slope_y = p.cov.y / p.cov.x;
    let slope_x = p.cov.y / p.cov.z;
    let index = bitcast<f32>(chunk.first_splat + splat);
    records[slot] = Record(
        vec4<f32>(p.mean2d, ux, -(vy * slope_y)),
        vec4<f32>(vy, p.log2_opacity, seen.xy),
        vec4<f32>(seen.z, p.z, normal.xy),
        vec4<f32>(normal.z, slope_y, slope_x, index),
    );
    // Positive floats are in the order of their bits.
    depths[slot] = bitcast<u32>(p.z);
}
