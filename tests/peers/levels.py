#!/usr/bin/env python3
"""Holds scenes in levels of detail against programs that others wrote: what is written here is read by splat-transform and by the octree of
the PlayCanvas engine, what splat-transform writes is read here, and all must find the same splats of each level in the same order. 3D Tiles are
held against the validator of 3D Tiles and the SPZ decoder of CesiumJS, and their splats, where the tiles put them, against the finest level.

    python3 tests/peers/levels.py PROGRAM SCENE.ply [--levels FOLDER/lod-meta.json] [--validator MAIN.js] [--work FOLDER]

PROGRAM is a build of weather-magician. SCENE.ply is converted to levels first, or --levels are taken that are there. It installs
@playcanvas/splat-transform, playcanvas, @spz-loader/core and 3d-tiles-validator (npm) and numpy (pip, in a virtual environment) into FOLDER, a temporary one unless
given; --validator is a 3D Tiles validator that is there. It takes minutes and needs the registries. The exit code is 1 if anything differs.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from formats import check, failures, install, read_ply, run, same

NPM = ["@playcanvas/splat-transform@latest", "playcanvas", "@spz-loader/core"]

OCTREE = """
import fs from 'fs';
import { GSplatOctree } from './node_modules/playcanvas/build/playcanvas/src/scene/gsplat-unified/gsplat-octree.js';
const octree = new GSplatOctree(process.argv[2], JSON.parse(fs.readFileSync(process.argv[2])));
const table = octree.acquireLodTable(0, octree.lodLevels - 1);
const runs = octree.nodes.flatMap((node, leaf) => node.lods.map((lod, level) => [leaf, level, lod.fileIndex, lod.offset, lod.count]));
console.log(JSON.stringify({
    leaves: octree.nodes.length, levels: octree.lodLevels, files: octree.files.map(file => file.url), environment: octree.environmentUrl,
    runs: runs.filter(run => run[4] > 0), finest: table.totalFinestCount, coarsest: table.totalCoarsestCount,
    bounds: octree.nodes.map(node => [node.bounds.getMin(), node.bounds.getMax()].flatMap(v => [v.x, v.y, v.z])),
}));
"""

# The decoder and its options in CesiumJS; it is bundled for browsers. Prints the range of the
# positions in each tile.
SPZ = """
import fs from 'fs';
const files = process.argv.slice(2), print = console.log;
Object.defineProperty(globalThis, 'process', {value: undefined, configurable: true});
globalThis.location = {href: 'http://localhost/'}; globalThis.self = globalThis; globalThis.window = globalThis; globalThis.document = {};
const {loadSpz} = await import('@spz-loader/core');
for (const file of files) {
    const bytes = fs.readFileSync(file), length = bytes.readUInt32LE(12);
    const gltf = JSON.parse(bytes.subarray(20, 20 + length)), packed = bytes.subarray(28 + length, 28 + length + gltf.bufferViews[0].byteLength);
    const cloud = await loadSpz(new Uint8Array(packed), {unpackOptions: {coordinateSystem: 'UNSPECIFIED'}});
    const min = [Infinity, Infinity, Infinity], max = [-Infinity, -Infinity, -Infinity];
    cloud.positions.forEach((v, i) => { min[i % 3] = Math.min(min[i % 3], v); max[i % 3] = Math.max(max[i % 3], v); });
    const {POSITION} = gltf.meshes[0].primitives[0].attributes, {count, min: low, max: high} = gltf.accessors[POSITION];
    print(JSON.stringify({count, decoded: cloud.numPoints, stated: [...low, ...high], found: [...min, ...max]}));
}
"""


def first(splats, count):
    """The splats before the environment, which is read last."""
    return {key: values[:count] for key, values in splats.items()}


def hold_levels(name, main, program, theirs, out):
    """Every level of an index, read here and by splat-transform."""
    index = json.loads(main.read_text())
    for level in range(index["lodLevels"]):
        run([program, "convert", main, out / "ours.ply", "--level", level, "--overwrite"])
        run([*theirs, "-L", level, main, out / "theirs.ply"])
        ours, other = read_ply(out / "ours.ply"), read_ply(out / "theirs.ply")
        check(f"{name}, level {level}, splats", len(other["means"]) == index["counts"][level], f"{len(other['means'])}")
        same(f"{name}, level {level}", first(ours, len(other["means"])), other)
    return index


def leaves_of(node):
    return [node] if "lods" in node else [leaf for child in node["children"] for leaf in leaves_of(child)]


def hold_octree(name, main, index, work, program, out):
    """What the engine's octree makes of an index."""
    import numpy as np

    octree = json.loads(run(["node", "octree.mjs", main], cwd=work)[0])
    leaves = leaves_of(index["tree"])
    runs = sorted([i, int(level), r["file"], r["offset"], r["count"]] for i, leaf in enumerate(leaves) for level, r in leaf["lods"].items())
    check(f"{name}, leaves and runs in the engine", octree["leaves"] == len(leaves) and sorted(octree["runs"]) == runs, f"{octree['leaves']} leaves, {len(runs)} runs")
    good = (octree["finest"], octree["coarsest"]) == (index["counts"][0], index["counts"][-1])
    check(f"{name}, splats of the finest and the coarsest level in the engine", good, f"{octree['finest']}, {octree['coarsest']}")
    # Runs are apart and cover their files.
    ends = {}
    for _, level, file, offset, count in sorted(runs, key=lambda run: (run[2], run[3])):
        before, its_level = ends.get(file, (0, level))
        if before != offset or its_level != level:
            check(f"{name}, runs", False, f"{index['filenames'][file]} has a gap at {before}, or two levels")
        ends[file] = (offset + count, level)
    sizes = {file: json.loads((main.parent / index["filenames"][file]).read_text())["count"] for file in ends}
    check(f"{name}, runs cover the files", all(ends[file][0] == size for file, size in sizes.items()), f"{len(sizes)} files")
    # Boxes hold the middles of their splats.
    splats = read_ply(out / "finest.ply")["means"] if (out / "finest.ply").exists() else None
    if splats is not None:
        firsts, far = {}, 0
        order = sorted((leaf["lods"]["0"]["file"], leaf["lods"]["0"]["offset"], i) for i, leaf in enumerate(leaves) if "0" in leaf["lods"])
        at = 0
        for _, _, i in order:
            count = leaves[i]["lods"]["0"]["count"]
            part, bounds = splats[at : at + count], np.array(octree["bounds"][i])
            far = max(far, (bounds[:3] - part).max(), (part - bounds[3:]).max())
            at += count
        check(f"{name}, boxes hold their splats", far < 1e-3 * np.abs(splats).max(), f"at most {far:.1e} outside")


def hold_tiles(main, program, work, out, validator):
    """3D Tiles of an index: the validator, and each finest splat where the tiles put it."""
    import numpy as np

    tiles = out / "tiles/tileset.json"
    tiles.parent.mkdir()
    print("  " + run([program, "convert", main, tiles])[0].strip().replace("\n", "\n  "))
    report = out / "report.json"
    subprocess.run(["node", validator, "-t", tiles, "-r", report], capture_output=True, text=True, check=True)
    real, known = [], 0

    def walk_issues(issues):
        nonlocal known
        for issue in issues:
            if issue.get("causes"):
                walk_issues(issue["causes"])
            elif issue["severity"] != "INFO":
                # The glTF validator knows no names of this extension's attributes, nor their types.
                is_own = "KHR_gaussian_splatting" in issue.get("path", "") + issue["message"]
                known += is_own
                real.extend([] if is_own else [issue])

    walk_issues(json.loads(report.read_text()).get("issues", []))
    check("the validator of 3D Tiles", not real, f"{len(real)} errors and warnings but for {known} names that its glTF validator does not know {real[:2]}")

    files = sorted((tiles.parent / "tiles").glob("*.glb"))
    lines = [json.loads(line) for line in run(["node", "spz.mjs", *files], cwd=work)[0].splitlines()]
    counts = all(line["count"] == line["decoded"] for line in lines)
    far = max(np.abs(np.subtract(line["stated"], line["found"])).max() / np.abs(line["stated"]).max() for line in lines)
    check("CesiumJS' decoder finds the splats and the range that each tile states", counts and far < 1e-4, f"{len(lines)} tiles, ranges at most {far:.1e} of their size off")

    tileset, found, outside, tiles_seen, wrong = json.loads(tiles.read_text()), [], 0.0, 0, 0

    def walk(tile, above, error):
        nonlocal outside, tiles_seen, wrong
        here = above @ np.array(tile.get("transform", np.eye(4).T.ravel())).reshape(4, 4).T
        wrong += tile["geometricError"] > error
        if "content" in tile:
            tiles_seen += 1
            run([program, "convert", tiles.parent / tile["content"]["uri"], out / "tile.ply", "--overwrite"])
            x, y, z = read_ply(out / "tile.ply")["means"].T
            # glTF's axes, y up, are a PLY's after half a turn about z; those of tiles have z up.
            local = np.stack([-x, -z, -y], 1)
            box = np.array(tile["boundingVolume"]["box"])
            outside = max(outside, (np.abs(local - box[:3]) - np.abs(box[3:].reshape(3, 3)).sum(0)).max())
            if not tile.get("children"):
                found.append(local @ here[:3, :3].T + here[:3, 3])
        for child in tile.get("children", []):
            walk(child, here, tile["geometricError"])

    walk(tileset["root"], np.eye(4), tileset["geometricError"])
    found = np.concatenate(found)
    index = json.loads(main.read_text())
    expected = first(read_ply(out / "finest.ply"), index["counts"][0])["means"]
    check("finest splats in tiles", len(found) == len(expected), f"{len(found)} in {tiles_seen} tiles")
    check("boxes of tiles hold the middles of their splats", outside < 1e-2, f"{outside:.1e} m at most outside")
    check("errors fall from tile to tile", wrong == 0, f"{wrong} do not")
    # The place on the globe is one rigid motion and scale of the scene: distances from the middle
    # stay but for it.
    spread = lambda points: np.sort(np.linalg.norm(points - points.mean(0), axis=1))
    a, b = spread(found), spread(expected)
    scale = a.sum() / b.sum()
    far = np.abs(a - scale * b).max()
    check("their distances from the middle", far < 1e-4 * a.max(), f"{far:.1e} m at most off, {scale:.4f} m a unit")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=Path)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--levels", type=Path)
    parser.add_argument("--validator", type=Path)
    parser.add_argument("--work", type=Path)
    arguments = parser.parse_args()
    work = (arguments.work or Path(tempfile.mkdtemp(prefix="peers-"))).resolve()
    work.mkdir(parents=True, exist_ok=True)
    install(work, [*NPM, *([] if arguments.validator else ["3d-tiles-validator"])], {"octree.mjs": OCTREE, "spz.mjs": SPZ})
    program, scene = arguments.program.resolve(), arguments.scene.resolve()
    validator = (arguments.validator or work / "node_modules/3d-tiles-validator/build/main.js").resolve()
    theirs = ["node", work / "node_modules/@playcanvas/splat-transform/bin/cli.mjs", "-q", "-w", "-g", "cpu"]
    out = work / "levels"
    shutil.rmtree(out, ignore_errors=True)
    (out / "theirs").mkdir(parents=True)
    levels = arguments.levels.resolve() if arguments.levels else out / "ours/lod-meta.json"
    if not arguments.levels:
        levels.parent.mkdir()
        run([program, "convert", scene, levels])

    print("levels written here")
    run([program, "convert", levels, out / "finest.ply", "--level", 0])
    index = hold_levels("written here", levels, program, theirs, out)
    hold_octree("written here", levels, index, work, program, out)
    is_flag = index.get("lodErrors", False) is True
    rising = all(leaf["errors"] == sorted(leaf["errors"]) and len(leaf["errors"]) == index["lodLevels"] for leaf in leaves_of(index["tree"]) if is_flag)
    check("written here, errors", is_flag and rising, "each leaf has one a level, which do not fall" if is_flag else "there are none")

    print("3D Tiles")
    hold_tiles(levels, program, work, out, validator)
    (out / "finest.ply").unlink()

    print("levels written by splat-transform")
    coarse = min(2, index["lodLevels"] - 1)
    run([program, "convert", levels, out / "coarse.ply", "--level", coarse])
    other = out / "theirs/lod-meta.json"
    run([*theirs, "--lod-chunk-count", "64", scene, "-l", "0", out / "coarse.ply", "-l", "1", out / "coarse.ply", "-l", "-1", other])
    index = hold_levels("written by splat-transform", other, program, theirs, out)
    hold_octree("written by splat-transform", other, index, work, program, out)

    print(f"{len(failures)} differences" + "".join(f"\n  {failure}" for failure in failures))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
