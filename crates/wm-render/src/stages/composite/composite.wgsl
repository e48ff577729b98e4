// What stands behind the splats, and what falls before them.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read_write> rgb: array<f32>;
@group(0) @binding(2) var<storage, read> alpha: array<f32>;
// One colour, or `[H, W, 3]`.
@group(0) @binding(3) var<storage, read> background: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn composite(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let at = group_index(workgroup) * WORKGROUP + local;
    if at >= view.width * view.height {
        return;
    }
    let behind = select(3u * at, 0u, UNIFORM_BACKGROUND);
    let open = 1.0 - alpha[at];
    var color: vec3<f32>;
    for (var k = 0u; k < 3u; k++) {
        color[k] = rgb[3u * at + k] + open * background[behind + k];
    }
    color = with_falling(at, color);
    for (var k = 0u; k < 3u; k++) {
        rgb[3u * at + k] = color[k];
    }
}
