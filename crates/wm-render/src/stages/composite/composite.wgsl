// What stands behind the splats, and what falls before them.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read_write> rgb: array<f32>;
@group(0) @binding(2) var<storage, read> alpha: array<f32>;
// See `behind`, of which there is one a kind.
@group(0) @binding(3) var<storage, read> background: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn composite(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let at = group_index(workgroup) * WORKGROUP + local;
    if at >= view.width * view.height {
        return;
    }
    let drawn = vec3<f32>(rgb[3u * at], rgb[3u * at + 1u], rgb[3u * at + 2u]);
    let color = with_falling(at, drawn + (1.0 - alpha[at]) * behind(at));
    for (var k = 0u; k < 3u; k++) {
        rgb[3u * at + k] = color[k];
    }
}
