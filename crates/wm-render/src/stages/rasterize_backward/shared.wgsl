// Sums of threads through shared memory: eight threads, then eight of these.

// Splats whose sums are added together.
const TOGETHER: u32 = 2u;

// `[TOGETHER, QUARTERS, THREADS]`
var<workgroup> of_threads: array<vec4<f32>, 512>;
// `[TOGETHER, QUARTERS, 8]`
var<workgroup> of_eight: array<vec4<f32>, THREADS>;

// Takes a thread's sums of splat number `j` of those together.
fn keep(local: u32, j: u32, sums: Sums) {
    for (var k = 0u; k < QUARTERS; k++) {
        of_threads[(j * QUARTERS + k) * THREADS + local] = sums.numbers[k];
    }
}

// Writes the slots of the splats from `first` of a batch of `size` on.
fn add_up(local: u32, first: u32, size: u32) {
    workgroupBarrier();
    var total = vec4<f32>(0.0);
    for (var k = 0u; k < 8u; k++) {
        total += of_threads[local / 8u * THREADS + 8u * k + local % 8u];
    }
    of_eight[local] = total;
    workgroupBarrier();
    let own = first + local / QUARTERS;
    if local < TOGETHER * QUARTERS && own < size {
        total = vec4<f32>(0.0);
        for (var k = 0u; k < 8u; k++) {
            total += of_eight[8u * local + k];
        }
        slots[QUARTERS * batch_pairs[own] + local % QUARTERS] = total;
    }
}

@compute @workgroup_size(THREADS)
fn rasterize_backward(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    replay_tile(group_index(workgroup), local);
}
