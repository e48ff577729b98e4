// A splat in the picture, as `cpu.rs` has it; see the contract in `mod.rs`.

@group(0) @binding(0) var<uniform> view: View;
// `[groups][SPLAT_ROWS][16]`: mean 3, quat 4, scale 3, opacity, coefficient 0 of the colour 3, 1
// for sky. What form they are in, `activated.wgsl` or `stored.wgsl` say.
@group(0) @binding(2) var<storage, read> splats: array<f32>;

fn number(splat: u32, row: u32) -> f32 {
    return splats[(splat / GROUP * SPLAT_ROWS + row) * GROUP + splat % GROUP];
}

fn numbers(splat: u32, row: u32) -> vec3<f32> {
    return vec3<f32>(number(splat, row), number(splat, row + 1u), number(splat, row + 2u));
}

fn is_sky(splat: u32) -> bool {
    return number(splat, ROW_SKY) > 0.5;
}

struct Projected {
    // Mean less the camera's centre, world axes.
    offset: vec3<f32>,
    mean2d: vec2<f32>,
    z: f32,
    inverse_z: f32,
    // X / z and Y / z, and the same within the limits of the Jacobian.
    tangents: vec2<f32>,
    held: vec2<f32>,
    // Columns of R.
    axes: mat3x3<f32>,
    scales: vec3<f32>,
    // Rows of J W R, and of M = J W R diag(scales).
    unscaled_x: vec3<f32>,
    unscaled_y: vec3<f32>,
    m_x: vec3<f32>,
    m_y: vec3<f32>,
    // xx, xy, yy, dilated, px^2.
    cov: vec3<f32>,
    // Determinant without and with the dilation.
    sharp: f32,
    det: f32,
    log2_opacity: f32,
}

fn project(splat: u32) -> Projected {
    var p: Projected;
    p.offset = numbers(splat, ROW_MEAN) - view.center;
    p.z = dot(view.rotation_z, p.offset);
    p.inverse_z = 1.0 / p.z;
    p.tangents = vec2<f32>(dot(view.rotation_x, p.offset), dot(view.rotation_y, p.offset)) * p.inverse_z;
    p.mean2d = p.tangents * view.focal + view.principal;
    // Outside the picture the linearisation explodes.
    p.held = min(max(p.tangents, view.low), view.high);
    let row_x = view.focal.x * p.inverse_z * (view.rotation_x - p.held.x * view.rotation_z);
    let row_y = view.focal.y * p.inverse_z * (view.rotation_y - p.held.y * view.rotation_z);

    let q = quat_of(splat);
    let d = q.yzw + q.yzw;
    let squares = q.yzw * d;
    let xy = q.y * d.y;
    let xz = q.y * d.z;
    let yz = q.z * d.z;
    let turns = q.x * d;
    p.axes = mat3x3<f32>(
        1.0 - (squares.y + squares.z), xy + turns.z, xz - turns.y,
        xy - turns.z, 1.0 - (squares.x + squares.z), yz + turns.x,
        xz + turns.y, yz - turns.x, 1.0 - (squares.x + squares.y),
    );
    p.scales = scales_of(splat);
    p.unscaled_x = row_x * p.axes;
    p.unscaled_y = row_y * p.axes;
    p.m_x = p.scales * p.unscaled_x;
    p.m_y = p.scales * p.unscaled_y;
    let cov = vec3<f32>(dot(p.m_x, p.m_x), dot(p.m_x, p.m_y), dot(p.m_y, p.m_y));
    // Cauchy-Binet: the determinant from the minors, none of them negative when squared.
    let minors = cross(p.m_x, p.m_y);
    p.sharp = dot(minors, minors);
    p.det = (cov.x + cov.z) * DILATION + (p.sharp + DILATION * DILATION);
    p.cov = cov + vec3<f32>(DILATION, 0.0, DILATION);

    p.log2_opacity = log2_opacity_of(splat);
    if view.antialiased != 0u {
        p.log2_opacity += 0.5 * log2(max(p.sharp / p.det, MIN_COMPENSATION * MIN_COMPENSATION));
    }
    return p;
}

// The factor of the exponent: ux, vx, vy; see `Record`.
fn factor_of(p: Projected) -> vec3<f32> {
    let vy = sqrt(p.cov.x / p.det) * SQRT_HALF_LOG2E;
    return vec3<f32>(SQRT_HALF_LOG2E / sqrt(p.cov.x), -(vy * (p.cov.y / p.cov.x)), vy);
}

// Slopes of the reciprocal depth over the picture, along x and y, of the splat flattened along the
// normal of the surface.
fn reciprocal_slopes(p: Projected) -> vec2<f32> {
    let height = p.scales * (view.split_normal * p.axes);
    let high = max(dot(height, height), 1e-30);
    let share = high / max(dot(p.scales, p.scales), 1e-30);
    let flat = height * (clamp((STANDS - share) / (STANDS - LIES), 0.0, 1.0) * FLATTENING / high);
    let deep = p.scales * (view.rotation_z * p.axes);
    let along = deep - flat * dot(height, deep);
    let m_x = p.m_x - flat * dot(height, p.m_x);
    let m_y = p.m_y - flat * dot(height, p.m_y);
    let with_x = dot(along, m_x);
    let with_y = dot(along, m_y);
    let cov = vec3<f32>(dot(m_x, m_x), dot(m_x, m_y), dot(m_y, m_y));
    let minors = cross(m_x, m_y);
    let det = (cov.x + cov.z) * SLOPE_DILATION + (dot(minors, minors) + SLOPE_DILATION * SLOPE_DILATION);
    return vec2<f32>(
        with_x * (cov.z + SLOPE_DILATION) - with_y * cov.y,
        with_y * (cov.x + SLOPE_DILATION) - with_x * cov.y,
    ) * (-(p.inverse_z * p.inverse_z) / det);
}

// The shortest of the splat's own axes, the first of equal ones.
fn shortest_of(p: Projected) -> vec3<f32> {
    if p.scales.z < min(p.scales.x, p.scales.y) {
        return vec3<f32>(0.0, 0.0, 1.0);
    }
    return select(vec3<f32>(1.0, 0.0, 0.0), vec3<f32>(0.0, 1.0, 0.0), p.scales.y < p.scales.x);
}

// What turns an axis towards the camera: 1 or -1.
fn facing(p: Projected, axis: vec3<f32>) -> f32 {
    return select(1.0, -1.0, dot(axis, p.offset) > 0.0);
}
