// Similarity of one channel, a workgroup per tile and a thread per pixel: its sum over the tile,
// and its slopes by the windowed means. See the contract in `mod.rs`.

// `[3, H, W]`: by mx, exx and exy.
@group(0) @binding(4) var<storage, read_write> slopes: array<f32>;
// `[3, tiles]`
@group(0) @binding(5) var<storage, read_write> sums: array<f32>;

// Both pictures.
var<workgroup> pairs: array<vec2<f32>, 676>;
// Windows down the columns of x, y, x^2 + y^2 and x y.
var<workgroup> columns: array<vec4<f32>, 416>;
var<workgroup> totals: array<f32, WORKGROUP>;

@compute @workgroup_size(WORKGROUP)
fn similarity(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let tile = group_index(workgroup);
    if tile >= view.tiles {
        return;
    }
    for (var i = local; i < SURROUNDINGS_SIDE * SURROUNDINGS_SIDE; i += WORKGROUP) {
        let at = about(tile, i);
        var pair = vec2<f32>(0.0);
        if at >= 0 {
            let truth = wanted(u32(at));
            pair = truth.w * vec2<f32>(exposed(u32(at))[comparison.channel], truth[comparison.channel]);
        }
        pairs[i] = pair;
    }
    workgroupBarrier();
    for (var i = local; i < SURROUNDINGS_SIDE * u32(TILE_SIDE); i += WORKGROUP) {
        var sum = vec4<f32>(0.0);
        for (var k = 0u; k <= 2u * WINDOW_RADIUS; k++) {
            let pair = pairs[i + k * SURROUNDINGS_SIDE];
            sum += WINDOW[k] * vec4<f32>(pair, dot(pair, pair), pair.x * pair.y);
        }
        columns[i] = sum;
    }
    workgroupBarrier();
    var means = vec4<f32>(0.0);
    for (var k = 0u; k <= 2u * WINDOW_RADIUS; k++) {
        means += WINDOW[k] * columns[window_begin(local) + k];
    }
    let squares = means.x * means.x + means.y * means.y;
    let product = means.x * means.y;
    let a1 = 2.0 * product + SIMILARITY_C1;
    let a2 = 2.0 * (means.w - product) + SIMILARITY_C2;
    let b1 = squares + SIMILARITY_C1;
    // Variances are not below 0 but for rounding.
    let b2 = max(means.z - squares, 0.0) + SIMILARITY_C2;
    let over = 1.0 / (b1 * b2);
    let s = a1 * a2 * over;
    let at = about(tile, middle(local));
    totals[local] = select(0.0, s, at >= 0);
    if at >= 0 {
        let pixels = view.width * view.height;
        slopes[at] = 2.0 * (means.y * (a2 - a1) * over - means.x * s * over * (b2 - b1));
        slopes[pixels + u32(at)] = -s * over * b1;
        slopes[2u * pixels + u32(at)] = 2.0 * a1 * over;
    }
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            totals[local] += totals[local + half];
        }
    }
    if local == 0u {
        sums[comparison.channel * view.tiles + tile] = totals[0];
    }
}
