// The derivative of projection, as `cpu.rs` has it: a thread per splat in view; see the contract in
// `mod.rs`.

@group(0) @binding(6) var<storage, read> records: array<Record>;
// See `gather.wgsl`.
@group(0) @binding(7) var<storage, read> pulls: array<f32>;
// `[records][GRADIENT_ROW]`
@group(0) @binding(8) var<storage, read_write> gradients: array<f32>;

fn pulled(place: u32, number: u32) -> f32 {
    return pulls[16u * place + number];
}

fn pulled_three(place: u32, number: u32) -> vec3<f32> {
    return vec3<f32>(pulled(place, number), pulled(place, number + 1u), pulled(place, number + 2u));
}

fn write(place: u32, number: u32, value: f32) {
    gradients[place * GRADIENT_ROW + number] = value;
}

fn write_three(place: u32, number: u32, values: vec3<f32>) {
    write(place, number, values.x);
    write(place, number + 1u, values.y);
    write(place, number + 2u, values.z);
}

// What the pixels pull on the shape of the 2D Gaussian; vectors are over the splat's own axes.
struct Shape {
    // The rows of `P` times those of M without scales, and what pulls on each.
    whitened_u: vec3<f32>,
    whitened_v: vec3<f32>,
    pulled_u: vec3<f32>,
    pulled_v: vec3<f32>,
    // Twice the derivatives by sharp and by the trace of M M^T, where antialiased.
    by_sharp: f32,
    by_trace: f32,
    // A column an axis: minors of M without scales (the axis) and M (the row).
    minors: mat3x3<f32>,
}

fn shape_of(p: Projected, factor: vec3<f32>, place: u32) -> Shape {
    var shape: Shape;
    let x = p.unscaled_x;
    let y = p.unscaled_y;
    // An axis and itself: 0 but for rounding.
    shape.minors = mat3x3<f32>(
        (x.x * p.m_y - y.x * p.m_x) * vec3<f32>(0.0, 1.0, 1.0),
        (x.y * p.m_y - y.y * p.m_x) * vec3<f32>(1.0, 0.0, 1.0),
        (x.z * p.m_y - y.z * p.m_x) * vec3<f32>(1.0, 1.0, 0.0),
    );
    shape.whitened_u = factor.x * x;
    shape.whitened_v = factor.z / p.cov.x * (y * DILATION - p.m_x * shape.minors);
    // suu, suv, svv
    let moments = 4.0 * LN_2 * LN_2 * pulled_three(place, SLOT_SUU);
    shape.pulled_u = moments.x * shape.whitened_u + moments.y * shape.whitened_v;
    shape.pulled_v = moments.y * shape.whitened_u + moments.z * shape.whitened_v;
    if view.antialiased != 0u && p.sharp / p.det > MIN_COMPENSATION * MIN_COMPENSATION {
        let s = pulled(place, SLOT_S);
        // 1 / sharp - 1 / det without their difference.
        shape.by_sharp = s * ((p.det - p.sharp) / (p.sharp * p.det));
        shape.by_trace = -(s * DILATION / p.det);
    }
    return shape;
}

@compute @workgroup_size(WORKGROUP)
fn project_backward(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
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
    let factor = factor_of(p);
    let shape = shape_of(p, factor, place);

    // Through the picture.
    let s_u = pulled(place, SLOT_SU);
    let s_v = pulled(place, SLOT_SV);
    let by_center = 2.0 * LN_2 * vec2<f32>(factor.x * s_u + factor.y * s_v, factor.z * s_v);
    let half = 0.5 * (p.cov.x - p.cov.z);
    let largest = 0.5 * (p.cov.x + p.cov.z) + sqrt(half * half + p.cov.y * p.cov.y);
    let odds = odds_of(splat);
    write(place, GRADIENT_OPACITY, pulled(place, SLOT_S) * (odds / (1.0 + odds)));
    write(place, GRADIENT_MEAN2D, by_center.x);
    write(place, GRADIENT_MEAN2D + 1u, by_center.y);
    write(place, GRADIENT_ABSGRAD, 2.0 * LN_2 * pulled(place, SLOT_ABS_X));
    write(place, GRADIENT_ABSGRAD + 1u, 2.0 * LN_2 * factor.z * pulled(place, SLOT_ABS_Y));
    write(place, GRADIENT_WEIGHT, pulled(place, SLOT_WEIGHT));
    write(place, GRADIENT_RADIUS, 3.0 * sqrt(largest));
    write(place, GRADIENT_INDEX, records[place].d.w);

    // Scales and turn: by the pairs of an axis and itself, and of the two others.
    let x = p.unscaled_x;
    let y = p.unscaled_y;
    let s = p.scales;
    let minors = shape.minors;
    let own = shape.whitened_u * shape.pulled_u + shape.whitened_v * shape.pulled_v
        + shape.by_sharp * vec3<f32>(dot(minors[0], minors[0]), dot(minors[1], minors[1]), dot(minors[2], minors[2]))
        + shape.by_trace * (x * x + y * y);
    let others = shape.whitened_u.yzx * shape.pulled_u.zxy + shape.whitened_v.yzx * shape.pulled_v.zxy
        + shape.by_sharp * vec3<f32>(dot(minors[1], minors[2]), dot(minors[2], minors[0]), dot(minors[0], minors[1]))
        + shape.by_trace * (x.yzx * x.zxy + y.yzx * y.zxy);
    let by_scale = s * s * own;
    write_three(place, GRADIENT_SCALE, by_scale);
    var turn = (s.yzx - s.zxy) * (s.yzx + s.zxy) * others;
    if NORMAL {
        let shortest = shortest_of(p);
        let by_normal = pulled_three(place, SLOT_FEATURES + 4u) * facing(p, p.axes * shortest);
        turn += cross(shortest, by_normal * p.axes);
    }
    let q = quat_of(splat);
    let by_quat = vec4<f32>(-dot(q.yzw, turn), q.x * turn + cross(q.yzw, turn));
    let twice = 2.0 * inverse_length_of(splat);
    write(place, GRADIENT_QUAT, twice * by_quat.x);
    write_three(place, GRADIENT_QUAT + 1u, twice * by_quat.yzw);

    // The mean: in the camera's axes, and through the direction of the colour.
    let by_m_x = s * (factor.x * shape.pulled_u + factor.y * shape.pulled_v + shape.by_sharp * (p.m_y * minors))
        + shape.by_trace * p.m_x;
    let by_m_y = s * (factor.z * shape.pulled_v - shape.by_sharp * (p.m_x * minors)) + shape.by_trace * p.m_y;
    let ahead = s * (view.rotation_z * p.axes);
    let along = p.inverse_z * view.focal;
    let by_held = -along * p.inverse_z * vec2<f32>(dot(by_m_x, ahead), dot(by_m_y, ahead));
    let by_view = along * by_center + select(vec2<f32>(0.0), by_held, p.held == p.tangents);
    var by_z = -((by_scale.x + by_scale.y + by_scale.z) * p.inverse_z) - dot(by_view, p.tangents);
    if DEPTH {
        by_z += pulled(place, SLOT_FEATURES + 3u);
    }
    var by_mean = by_view.x * view.rotation_x + by_view.y * view.rotation_y + by_z * view.rotation_z;
    if COLOR {
        let distance = length(p.offset);
        let direction = p.offset / distance;
        let record = records[place];
        // What was held at black learns nothing.
        let lit = vec3<f32>(record.b.zw, record.c.x) > vec3<f32>(0.0);
        var by_rgb = select(vec3<f32>(0.0), pulled_three(place, SLOT_FEATURES), lit);
        if view.extinction > 0.0 && !is_sky(splat) {
            let is_lit = shade(splat, direction) > vec3<f32>(0.0);
            by_rgb = select(vec3<f32>(0.0), photo_air(distance).factor * by_rgb, is_lit);
        }
        let by_direction = shade_backward(splat, place, direction, by_rgb);
        by_mean += (by_direction - dot(direction, by_direction) * direction) / distance;
    }
    write_three(place, GRADIENT_MEAN, by_mean);
}
