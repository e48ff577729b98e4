// The records of the splats in view, in the order of the splats, and the keys by which they are
// sorted.

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
    let place = place_of(chunk.first_block + block, local);
    if place >= view.visible_capacity {
        return;
    }

    let splat = block * WORKGROUP + local;
    let p = project(splat);
    let distance = length(p.offset);
    let direction = p.offset / distance;
    let rgb = relit(splat, shade(splat, direction));
    let seen = through_air(direction, select(distance, FAR_AWAY, is_sky(splat)), rgb);

    let axis = p.axes * shortest_of(p);
    let normal = facing(p, axis) * axis;
    let factor = factor_of(p);
    let slope_y = p.cov.y / p.cov.x;
    let slope_x = p.cov.y / p.cov.z;
    var index = bitcast<f32>(chunk.first_splat + splat);
    if view.split == 1u {
        let slopes = bitcast<vec2<u32>>(reciprocal_slopes(p));
        index = bitcast<f32>((slopes.x & 0xffff0000u) | (slopes.y >> 16u));
    }
    var depth = p.z;
    if view.split == 2u {
        depth = bitcast<f32>(SPLAT_NAME + chunk.first_splat + splat);
    }
    records[place] = Record(
        vec4<f32>(p.mean2d, factor.xy),
        vec4<f32>(factor.z, p.log2_opacity, seen.xy),
        vec4<f32>(seen.z, depth, normal.xy),
        vec4<f32>(normal.z, slope_y, slope_x, index),
    );
    // Positive floats are in the order of their bits.
    depths[place] = bitcast<u32>(p.z);
}
