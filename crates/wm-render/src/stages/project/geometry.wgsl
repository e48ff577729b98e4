// A splat in the picture, as `cpu.rs` has it; see the contract in `mod.rs`.

// A part of a set that one binding holds: whole blocks of 256 splats.
struct Chunk {
    // Its first block among all blocks of the frame.
    first_block: u32,
    blocks: u32,
    // Its first splat among its set's, and in `visibility`.
    first_splat: u32,
    // Rows of `sh_rest` a group of sixteen.
    sh_rows: u32,
    // 1 where `visibility` holds a factor a splat.
    faded: u32,
}

// What a block of 256 splats shows: how many, and after the scan how many are before it; a bit for each splat.
struct Block {
    count: u32,
    mask: array<u32, 8>,
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> chunk: Chunk;
// `[groups][SPLAT_ROWS][16]`: mean 3, quat 4, scale 3, log2 opacity, coefficient 0 of the colour 3, 1 for sky.
@group(0) @binding(2) var<storage, read> splats: array<f32>;
@group(0) @binding(3) var<storage, read> visibility: array<f32>;
@group(0) @binding(4) var<storage, read_write> blocks: array<Block>;

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
    // Columns of R.
    axes: mat3x3<f32>,
    scales: vec3<f32>,
    // xx, xy, yy, dilated, px^2.
    cov: vec3<f32>,
    det: f32,
    log2_opacity: f32,
}

fn project(splat: u32) -> Projected {
    var p: Projected;
    p.offset = numbers(splat, ROW_MEAN) - view.center;
    p.z = dot(view.rotation_z, p.offset);
    let inverse_z = 1.0 / p.z;
    let tangents = vec2<f32>(dot(view.rotation_x, p.offset), dot(view.rotation_y, p.offset)) * inverse_z;
    p.mean2d = tangents * view.focal + view.principal;
    // Outside the picture the linearisation explodes.
    let held = min(max(tangents, view.low), view.high);
    let row_x = view.focal.x * inverse_z * (view.rotation_x - held.x * view.rotation_z);
    let row_y = view.focal.y * inverse_z * (view.rotation_y - held.y * view.rotation_z);

    let w = number(splat, ROW_QUAT);
    let q = numbers(splat, ROW_QUAT + 1u);
    let d = q + q;
    let squares = q * d;
    let xy = q.x * d.y;
    let xz = q.x * d.z;
    let yz = q.y * d.z;
    let turns = w * d;
    p.axes = mat3x3<f32>(
        1.0 - (squares.y + squares.z), xy + turns.z, xz - turns.y,
        xy - turns.z, 1.0 - (squares.x + squares.z), yz + turns.x,
        xz + turns.y, yz - turns.x, 1.0 - (squares.x + squares.y),
    );
    p.scales = numbers(splat, ROW_SCALE);
    let m_x = p.scales * (row_x * p.axes);
    let m_y = p.scales * (row_y * p.axes);
    let cov = vec3<f32>(dot(m_x, m_x), dot(m_x, m_y), dot(m_y, m_y));
    // Cauchy-Binet: the determinant from the minors, none of them negative when squared.
    let minors = cross(m_x, m_y);
    let sharp = dot(minors, minors);
    p.det = (cov.x + cov.z) * DILATION + (sharp + DILATION * DILATION);
    p.cov = cov + vec3<f32>(DILATION, 0.0, DILATION);

    p.log2_opacity = number(splat, ROW_LOG2_OPACITY);
    if chunk.faded != 0u {
        p.log2_opacity += log2(max(visibility[chunk.first_splat + splat], 1e-30));
    }
    if view.antialiased != 0u {
        p.log2_opacity += 0.5 * log2(max(sharp / p.det, MIN_COMPENSATION * MIN_COMPENSATION));
    }
    return p;
}
