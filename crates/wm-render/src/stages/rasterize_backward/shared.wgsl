// Sums of threads through shared memory: eight threads, then eight of these.

// Splats whose sums are added together.
const SPLATS_PER_SUM: u32 = 2u;

// `[SPLATS_PER_SUM, SLOT_VECTORS, THREADS]`
var<workgroup> of_threads: array<vec4<f32>, 512>;
// `[SPLATS_PER_SUM, SLOT_VECTORS, 8]`
var<workgroup> of_eight: array<vec4<f32>, THREADS>;

// Takes a thread's sums of splat number `j` of those together.
fn keep(local: u32, j: u32, sums: Sums) {
    for (var k = 0u; k < SLOT_VECTORS; k++) {
        of_threads[(j * SLOT_VECTORS + k) * THREADS + local] = sums.numbers[k];
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
    let own = first + local / SLOT_VECTORS;
    if local < SPLATS_PER_SUM * SLOT_VECTORS && own < size {
        total = vec4<f32>(0.0);
        for (var k = 0u; k < 8u; k++) {
            total += of_eight[8u * local + k];
        }
        slots[SLOT_VECTORS * batch_pairs[own] + local % SLOT_VECTORS] = total;
    }
}

@compute @workgroup_size(THREADS)
fn rasterize_backward(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    replay_tile(group_index(workgroup), local);
}
