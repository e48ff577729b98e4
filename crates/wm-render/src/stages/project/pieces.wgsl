// The splats of a training or a render, in pieces, and which of them are in view.

// A part of a set that one binding holds: whole blocks of 256 splats.
struct Chunk {
    // Its first block among all blocks of the frame.
    first_block: u32,
    blocks: u32,
    // Its first splat among its set's, and in `attributes`.
    first_splat: u32,
    // Its splats; the last block may be padded.
    splats: u32,
    // Rows of `sh_rest` a group of sixteen, and how many of them are in use.
    sh_rows: u32,
    sh_used: u32,
    // 1 where `attributes` holds those of each splat.
    has_attributes: u32,
    // 1 where these change the light.
    changes_light: u32,
    // 1 where all splats in stored form have one opacity, and its log2.
    fixed: u32,
    fixed_log2_opacity: f32,
}

// What a block of 256 splats shows: how many, and after the scan how many are before it; a bit for
// each splat.
struct Block {
    count: u32,
    mask: array<u32, 8>,
}

@group(0) @binding(1) var<uniform> chunk: Chunk;
@group(0) @binding(4) var<storage, read_write> blocks: array<Block>;

// The place of a splat that is not in view.
const NOT_IN_VIEW: u32 = 0xffffffffu;

// The place among all splats in view, after the scan, of the one of thread `local` in a block.
fn place_in(block: Block, local: u32) -> u32 {
    let own = block.mask[local / 32u];
    let bit = local % 32u;
    if ((own >> bit) & 1u) == 0u {
        return NOT_IN_VIEW;
    }
    var place = block.count + countOneBits(own & ((1u << bit) - 1u));
    for (var word = 0u; word < local / 32u; word++) {
        place += countOneBits(block.mask[word]);
    }
    return place;
}

// The same of block number `at`.
fn place_of(at: u32, local: u32) -> u32 {
    return place_in(blocks[at], local);
}
