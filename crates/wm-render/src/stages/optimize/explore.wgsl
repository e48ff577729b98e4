// Noise along the shapes of splats that are nearly transparent: a thread per splat; see the
// contract in `mod.rs`.

struct Noise {
    // Of the random numbers: the seed times a constant, both words.
    seed: u32,
    seed_high: u32,
    // Noise in units of a splat's variance.
    size: f32,
    // Logit above which a splat has none.
    most: f32,
}

@group(0) @binding(2) var<storage, read_write> splats: array<f32>;
@group(0) @binding(10) var<uniform> noise: Noise;

fn at(splat: u32, row: u32) -> u32 {
    return (splat / GROUP * SPLAT_ROWS + row) * GROUP + splat % GROUP;
}

// Whole numbers of 64 bits, low word first.

// The product of two words.
fn product(a: u32, b: u32) -> vec2<u32> {
    let low = (a & 0xffffu) * (b & 0xffffu);
    let mixed = (a >> 16u) * (b & 0xffffu) + (low >> 16u);
    let other = (a & 0xffffu) * (b >> 16u) + (mixed & 0xffffu);
    return vec2<u32>(a * b, (a >> 16u) * (b >> 16u) + (mixed >> 16u) + (other >> 16u));
}

fn times(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let low = product(a.x, b.x);
    return vec2<u32>(low.x, low.y + a.x * b.y + a.y * b.x);
}

// `a ^ a >> by`, 0 < by < 32.
fn folded(a: vec2<u32>, by: u32) -> vec2<u32> {
    return a ^ vec2<u32>((a.x >> by) | (a.y << (32u - by)), a.y >> by);
}

// `wm_scene::random::uniform`: number `index` of the seed, in [0, 1), and 1 less it.
fn uniform_at(index: u32) -> vec2<f32> {
    var z = vec2<u32>(noise.seed, noise.seed_high) ^ times(vec2<u32>(index, 0u), vec2<u32>(0xd192ed03u, 0xd1b54a32u));
    z = times(folded(z, 30u), vec2<u32>(0x1ce4e5b9u, 0xbf58476du));
    z = times(folded(z, 27u), vec2<u32>(0x133111ebu, 0x94d049bbu));
    let bits = folded(z, 31u).y;
    // Each to 24 bits, never 1 and never 0.
    return vec2<f32>(f32(bits >> 8u), f32((~bits >> 8u) + 1u)) / 16777216.0;
}

// Two normal numbers.
fn normals_at(index: u32) -> vec2<f32> {
    let radius = sqrt(-2.0 * log(uniform_at(index).y));
    let angle = 2.0 * PI * uniform_at(index + 1u).x;
    return radius * vec2<f32>(cos(angle), sin(angle));
}

fn sigmoid(x: f32) -> f32 {
    return 1.0 / (1.0 + exp2(clamp(x * -LOG2E, -126.0, 126.0)));
}

@compute @workgroup_size(WORKGROUP)
fn explore(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let splat = group_index(workgroup) * WORKGROUP + local;
    if splat >= chunk.splats {
        return;
    }
    let logit = splats[at(splat, ROW_OPACITY)];
    if logit > noise.most || splats[at(splat, ROW_SKY)] > 0.5 {
        return;
    }
    let gate = sigmoid(-100.0 * (sigmoid(logit) - 0.005));
    let index = 4u * (chunk.first_splat + splat);
    let normal = vec3<f32>(normals_at(index), normals_at(index + 2u).x);
    let w = splats[at(splat, ROW_QUAT)];
    let q = vec3<f32>(
        splats[at(splat, ROW_QUAT + 1u)], splats[at(splat, ROW_QUAT + 2u)], splats[at(splat, ROW_QUAT + 3u)],
    );
    let squared = w * w + dot(q, q);
    var turn = vec4<f32>(0.0, 0.0, 0.0, 1.0);
    if squared > 1e-30 {
        turn = vec4<f32>(q, w) / sqrt(squared);
    }
    // Into the splat's own axes, by their sizes, and back.
    let own = normal + 2.0 * cross(turn.xyz, cross(turn.xyz, normal) - turn.w * normal);
    var moved: vec3<f32>;
    for (var k = 0u; k < 3u; k++) {
        let size = exp2(clamp(splats[at(splat, ROW_SCALE + k)] * LOG2E, -126.0, 60.0));
        moved[k] = own[k] * size * min(noise.size * gate * size, 1.0);
    }
    let off = moved + 2.0 * cross(turn.xyz, cross(turn.xyz, moved) + turn.w * moved);
    for (var k = 0u; k < 3u; k++) {
        splats[at(splat, ROW_MEAN + k)] += off[k];
    }
}
