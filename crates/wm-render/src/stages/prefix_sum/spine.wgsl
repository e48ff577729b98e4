// The prefix sums of what blocks of splats counted, and the sizes of the dispatches that follow.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read_write> counters: Counters;
@group(0) @binding(2) var<storage, read_write> dispatches: array<u32>;
@group(0) @binding(3) var<storage, read_write> sums: array<u32>;

fn dispatch_over(at: u32, groups: u32) {
    dispatches[at] = min(groups, DISPATCH_ROW);
    dispatches[at + 1u] = (groups + DISPATCH_ROW - 1u) / DISPATCH_ROW;
    dispatches[at + 2u] = 1u;
}

const MAX_U32: u32 = 0xffffffffu;
// Whether a sum is so large that 256 of them may not fit a word.
var<workgroup> too_many: atomic<u32>;

// Makes `sums[stride * i]`, i < count, their exclusive prefix sums; returns the total, MAX_U32 if
// it is more than that.
fn scan_sums(local: u32, count: u32, stride: u32) -> u32 {
    if local == 0u {
        atomicStore(&too_many, 0u);
    }
    workgroupBarrier();
    var before = 0u;
    for (var first = 0u; first < count; first += WORKGROUP) {
        let i = first + local;
        var own = 0u;
        if i < count {
            own = sums[stride * i];
        }
        if own > MAX_U32 / WORKGROUP {
            atomicStore(&too_many, 1u);
        }
        let scanned = scan(local, own);
        if i < count {
            sums[stride * i] = before + scanned.x;
        }
        if before > MAX_U32 - scanned.y {
            atomicStore(&too_many, 1u);
        }
        before += scanned.y;
    }
    return select(before, MAX_U32, workgroupUniformLoad(&too_many) != 0u);
}

@compute @workgroup_size(WORKGROUP)
fn spine_visible(@builtin(local_invocation_index) local: u32) {
    let total = scan_sums(local, view.blocks, BLOCK_WORDS);
    if local == 0u {
        let visible = min(total, view.visible_capacity);
        counters.visible = visible;
        counters.visible_needed = total;
        dispatch_over(VISIBLE_GROUPS, (visible + WORKGROUP - 1u) / WORKGROUP);
        dispatch_over(VISIBLE_SORT, (visible + SORT_BLOCK - 1u) / SORT_BLOCK);
    }
}

var<workgroup> groups: u32;

@compute @workgroup_size(WORKGROUP)
fn spine_entries(@builtin(local_invocation_index) local: u32) {
    if local == 0u {
        groups = (counters.visible + WORKGROUP - 1u) / WORKGROUP;
    }
    let total = scan_sums(local, workgroupUniformLoad(&groups), 1u);
    if local == 0u {
        let entries = min(total, view.entry_capacity);
        counters.entries = entries;
        counters.entries_needed = total;
        dispatch_over(ENTRY_SORT, (entries + SORT_BLOCK - 1u) / SORT_BLOCK);
    }
}
