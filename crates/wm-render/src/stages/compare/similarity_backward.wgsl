// From the slopes of one channel's similarity to the derivative of its weighted mean by the exposed
// picture.

@group(0) @binding(4) var<storage, read> slopes: array<f32>;
// By colour, `[H, W, 3]`, and others behind.
@group(0) @binding(6) var<storage, read_write> upstream: array<f32>;

var<workgroup> around: array<array<f32, 676>, 3>;
// Windows down their columns.
var<workgroup> columns: array<array<f32, 416>, 3>;

@compute @workgroup_size(WORKGROUP)
fn similarity_backward(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let tile = group_index(workgroup);
    if tile >= view.tiles {
        return;
    }
    let pixels = view.width * view.height;
    for (var i = local; i < SURROUNDINGS_SIDE * SURROUNDINGS_SIDE; i += WORKGROUP) {
        let at = about(tile, i);
        for (var k = 0u; k < 3u; k++) {
            around[k][i] = 0.0;
            if at >= 0 {
                around[k][i] = slopes[k * pixels + u32(at)];
            }
        }
    }
    workgroupBarrier();
    for (var i = local; i < SURROUNDINGS_SIDE * u32(TILE_SIDE); i += WORKGROUP) {
        var sum = vec3<f32>(0.0);
        for (var k = 0u; k <= 2u * WINDOW_RADIUS; k++) {
            let first = i + k * SURROUNDINGS_SIDE;
            sum += WINDOW[k] * vec3<f32>(around[0][first], around[1][first], around[2][first]);
        }
        columns[0][i] = sum.x;
        columns[1][i] = sum.y;
        columns[2][i] = sum.z;
    }
    workgroupBarrier();
    var windows = vec3<f32>(0.0);
    for (var k = 0u; k <= 2u * WINDOW_RADIUS; k++) {
        let first = window_begin(local) + k;
        windows += WINDOW[k] * vec3<f32>(columns[0][first], columns[1][first], columns[2][first]);
    }
    let at = about(tile, middle(local));
    if at >= 0 {
        let truth = wanted(u32(at));
        let x = truth.w * exposed(u32(at))[comparison.channel];
        let y = truth.w * truth[comparison.channel];
        let slope = windows.x + 2.0 * x * windows.y + y * windows.z;
        upstream[3u * u32(at) + comparison.channel] = -comparison.dssim * truth.w * slope;
    }
}
