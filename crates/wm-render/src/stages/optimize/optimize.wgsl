// Adam over the splats in view, with what pulls on splats whatever a picture shows: a thread a
// splat; see the contract in `mod.rs`.

struct Step {
    rate_means: f32,
    rate_quats: f32,
    rate_log_scales: f32,
    rate_opacities: f32,
    rate_dc: f32,
    rate_rest: f32,
    // 1 - beta^step of both betas.
    correction1: f32,
    correction2: f32,
    // Weights of the terms for one splat.
    opacity: f32,
    scale: f32,
    flatness: f32,
    // Number of the step, from 1.
    number: u32,
    // Half the picture, px.
    half_size: vec2<f32>,
}

@group(0) @binding(2) var<storage, read_write> splats: array<f32>;
@group(0) @binding(3) var<storage, read_write> sh_rest: array<f32>;
// First moments, then second ones, of each group: `[groups][2][SPLAT_ROWS][16]`,
// `[groups][2][sh_rows][16]`.
@group(0) @binding(5) var<storage, read_write> moments: array<f32>;
@group(0) @binding(6) var<storage, read_write> sh_moments: array<f32>;
// See `project_backward.wgsl` and `shade_backward.wgsl`.
@group(0) @binding(7) var<storage, read> gradients: array<f32>;
@group(0) @binding(8) var<storage, read> by_sh: array<f32>;
// `[splats][4]`: sum of pulls, steps in view, largest radius, last step in view.
@group(0) @binding(9) var<storage, read_write> known: array<f32>;
@group(0) @binding(10) var<uniform> plan: Step;

fn at(splat: u32, row: u32) -> u32 {
    return (splat / GROUP * SPLAT_ROWS + row) * GROUP + splat % GROUP;
}

// By how much a value moves whose moments are these, with the gradient `g` added to them.
fn adam(first: ptr<function, f32>, second: ptr<function, f32>, g: f32) -> f32 {
    let m = BETA1 * *first + (1.0 - BETA1) * g;
    let v = BETA2 * *second + (1.0 - BETA2) * g * g;
    *first = m;
    *second = v;
    return (m / plan.correction1) / (sqrt(v / plan.correction2) + ADAM_EPS);
}

fn move_row(splat: u32, row: u32, g: f32, rate: f32) {
    let group = splat / GROUP * (2u * SPLAT_ROWS) * GROUP + splat % GROUP;
    let first_at = group + row * GROUP;
    let second_at = group + (SPLAT_ROWS + row) * GROUP;
    var first = moments[first_at];
    var second = moments[second_at];
    splats[at(splat, row)] -= rate * adam(&first, &second, g);
    moments[first_at] = first;
    moments[second_at] = second;
}

fn move_coefficient(splat: u32, row: u32, g: f32) {
    let rows = chunk.sh_rows;
    let group = splat / GROUP * (2u * rows) * GROUP + splat % GROUP;
    let first_at = group + row * GROUP;
    let second_at = group + (rows + row) * GROUP;
    var first = sh_moments[first_at];
    var second = sh_moments[second_at];
    sh_rest[(splat / GROUP * rows + row) * GROUP + splat % GROUP] -= plan.rate_rest * adam(&first, &second, g);
    sh_moments[first_at] = first;
    sh_moments[second_at] = second;
}

@compute @workgroup_size(WORKGROUP)
fn optimize(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = group_index(workgroup);
    if block >= chunk.blocks {
        return;
    }
    let place = place_of(chunk.first_block + block, local);
    if place == NOT_IN_VIEW {
        return;
    }
    let splat = block * WORKGROUP + local;
    let row = place * GRADIENT_ROW;
    let is_sky = splats[at(splat, ROW_SKY)] > 0.5;

    let known_at = 4u * (chunk.first_splat + splat);
    let pull = vec2<f32>(gradients[row + GRADIENT_MEAN2D], gradients[row + GRADIENT_MEAN2D + 1u]);
    known[known_at] += length(pull * plan.half_size);
    known[known_at + 1u] += 1.0;
    known[known_at + 2u] = max(known[known_at + 2u], gradients[row + GRADIENT_RADIUS]);
    known[known_at + 3u] = f32(plan.number);

    // The sky does not learn.
    for (var k = 0u; k < 3u; k++) {
        move_row(splat, ROW_MEAN + k, select(gradients[row + GRADIENT_MEAN + k], 0.0, is_sky), plan.rate_means);
    }
    for (var k = 0u; k < 4u; k++) {
        move_row(splat, ROW_QUAT + k, select(gradients[row + GRADIENT_QUAT + k], 0.0, is_sky), plan.rate_quats);
    }
    var log_scales: array<f32, 3>;
    for (var k = 0u; k < 3u; k++) {
        log_scales[k] = splats[at(splat, ROW_SCALE + k)];
    }
    // Of equal ones the first is the shortest, and the first of the others is next.
    var shortest = 0u;
    for (var k = 1u; k < 3u; k++) {
        shortest = select(shortest, k, log_scales[k] < log_scales[shortest]);
    }
    var next = select(0u, 1u, shortest == 0u);
    for (var k = next + 1u; k < 3u; k++) {
        next = select(next, k, k != shortest && log_scales[k] < log_scales[next]);
    }
    let ratio = exp2(min((log_scales[shortest] - log_scales[next]) * LOG2E, 0.0));
    let flatten = select(0.0, plan.flatness * ratio, ratio > FLAT);
    for (var k = 0u; k < 3u; k++) {
        var g = gradients[row + GRADIENT_SCALE + k] + plan.scale * exp2(clamp(log_scales[k] * LOG2E, -126.0, 126.0));
        g += select(0.0, flatten, k == shortest) - select(0.0, flatten, k == next);
        move_row(splat, ROW_SCALE + k, select(g, 0.0, is_sky), plan.rate_log_scales);
    }
    let odds = exp2(clamp(splats[at(splat, ROW_OPACITY)] * -LOG2E, -60.0, 60.0));
    let spread = odds / ((1.0 + odds) * (1.0 + odds));
    let by_opacity = gradients[row + GRADIENT_OPACITY] + plan.opacity * spread;
    move_row(splat, ROW_OPACITY, select(by_opacity, 0.0, is_sky), plan.rate_opacities);

    let sh = place * (chunk.sh_used + 3u);
    for (var k = 0u; k < 3u; k++) {
        move_row(splat, ROW_DC + k, select(by_sh[sh + k], 0.0, is_sky), plan.rate_dc);
    }
    for (var k = 0u; k < chunk.sh_used; k++) {
        move_coefficient(splat, k, select(by_sh[sh + 3u + k], 0.0, is_sky));
    }
}
