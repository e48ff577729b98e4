#!/usr/bin/env python3
"""This program's GPU back end beside gsplat's CUDA rasteriser: the same splats, the same camera, one run, one table.

    python3 benches/gsplat.py [SCENE ...] [--program target/release/weather-magician] [--device gpu] [--out TABLE.md]

A SCENE is a PLY, or a folder as a 3DGS training writes it, seen from its first camera; others are seen from where `bench` chooses. Without
any, made-up ones of 0.1, 1 and 3 million splats are measured. Needs numpy; and torch with CUDA and gsplat for gsplat's columns, which are
left empty, with a word, where these cannot be imported. Before anything is timed the pictures of both are compared: below 35 dB they do not
show the same, and the exit code is 1.

Times are medians of frames after a warm-up: *wall*, with the picture back in the computer's memory for ours and on the device for gsplat's;
and *GPU*, by the device's clock (timestamps of ours, CUDA events of gsplat's), of the same work. A training step is forward, L1 and SSIM,
backward and Adam over all parameters; gsplat's with torch's fused Adam, and fused_ssim where it is installed.
"""

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

# This file would be taken for the package of its name.
sys.path = [folder for folder in sys.path if Path(folder or ".").resolve() != Path(__file__).resolve().parent]

import numpy as np

SIZE = (1200, 800)
CASES = ["rgb", "rgb, fog", "rgb, rain 25 mm/h", "rgb, rain, more drops", "rgb, snow 2.5 mm/h", "rgb, snow cover 10 cm"]
# Frames a second of the paper's Table I on its RTX 4090: clear, fog, rain, cover.
PAPER = {"rgb": 83.0, "rgb, fog": 31.0, "rgb, rain 25 mm/h": 10.4, "rgb, snow cover 10 cm": 58.0}
WARM_UP, FRAMES = 10, 100


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:
        sys.exit(f"{program} {' '.join(map(str, arguments))} failed")
    return done.stdout


def read_ply(path):
    """The splats of a 3DGS PLY: stored parameters as float32 arrays."""
    with open(path, "rb") as file:
        names, count = [], 0
        for line in iter(file.readline, b"end_header\n"):
            words = line.decode("ascii", "replace").split()
            if words[:2] == ["element", "vertex"]:
                count = int(words[2])
            elif words[:2] == ["property", "float"]:
                names.append(words[2])
            elif words[:1] == ["property"]:
                sys.exit(f"{path}: a property of type {words[1]}; convert it to a plain PLY first")
        rows = np.fromfile(file, dtype="<f4", count=count * len(names)).reshape(count, len(names))
    columns = {name: i for i, name in enumerate(names)}
    take = lambda *wanted: np.ascontiguousarray(rows[:, [columns[name] for name in wanted]])
    rest = sorted((name for name in names if name.startswith("f_rest_")), key=lambda name: int(name[7:]))
    dc = take("f_dc_0", "f_dc_1", "f_dc_2")[:, None, :]
    higher = take(*rest).reshape(count, 3, -1).transpose(0, 2, 1) if rest else np.zeros((count, 0, 3), "f4")
    return {
        "means": take("x", "y", "z"),
        "quats": take("rot_0", "rot_1", "rot_2", "rot_3"),
        "log_scales": take("scale_0", "scale_1", "scale_2"),
        "logit_opacities": take("opacity")[:, 0],
        "sh": np.ascontiguousarray(np.concatenate([dc, higher], axis=1)),
    }


def look_at(text):
    """A camera of cameras.json from EYE:TARGET, roll towards the axis that is most across."""
    eye, target = (np.array([float(v) for v in part.split(",")]) for part in text.split(":"))
    forward = (target - eye) / np.linalg.norm(target - eye)
    down = -np.eye(3)[np.argmin(np.abs(forward))]
    right = np.cross(down, forward)
    right /= np.linalg.norm(right)
    focal = SIZE[1] / 2 / math.tan(math.radians(25))
    rotation = np.stack([right, np.cross(forward, right), forward], axis=1)
    return {"position": eye.tolist(), "rotation": rotation.tolist(), "fx": focal, "fy": focal}


def prepared(scene, number, args, work):
    """A folder with the scene and one camera, whose size is SIZE."""
    plys = sorted(scene.glob("point_cloud/iteration_*/point_cloud.ply")) if scene.is_dir() else [scene]
    if not plys:
        sys.exit(f"{scene}: no point_cloud/iteration_*/point_cloud.ply in it")
    if scene.is_dir() and (scene / "cameras.json").exists():
        camera = json.loads((scene / "cameras.json").read_text())[0]
        scale = SIZE[1] / camera["height"]
        camera |= {"fx": camera["fx"] * scale, "fy": camera["fy"] * scale}
    else:
        chosen = run(args.program, "bench", plys[-1], "--frames", 1, "--cases", "depth", "--json", "--device", "cpu")
        camera = look_at(json.loads(chosen)[0]["camera"])
    camera |= {"id": 0, "img_name": "0", "width": SIZE[0], "height": SIZE[1]}
    folder = work / f"scene-{number}"
    (folder / "point_cloud/iteration_0").mkdir(parents=True)
    os.symlink(plys[-1].resolve(), folder / "point_cloud/iteration_0/point_cloud.ply")
    (folder / "cameras.json").write_text(json.dumps([camera]))
    return folder, camera


class Gsplat:
    """gsplat with the splats of one scene."""

    def __init__(self, splats, camera):
        import gsplat
        import torch

        self.torch, self.rasterization = torch, gsplat.rasterization
        self.stored = {name: torch.tensor(value, device="cuda") for name, value in splats.items()}
        self.degree = math.isqrt(splats["sh"].shape[1]) - 1
        world_from_camera = np.eye(4)
        world_from_camera[:3, :3], world_from_camera[:3, 3] = camera["rotation"], camera["position"]
        self.viewmats = torch.tensor(np.linalg.inv(world_from_camera)[None], dtype=torch.float32, device="cuda")
        intrinsics = [[camera["fx"], 0, SIZE[0] / 2], [0, camera["fy"], SIZE[1] / 2], [0, 0, 1]]
        self.intrinsics = torch.tensor([intrinsics], dtype=torch.float32, device="cuda")
        self.version = gsplat.__version__

    def render(self, stored):
        colors, _, _ = self.rasterization(
            stored["means"], stored["quats"], stored["log_scales"].exp(), stored["logit_opacities"].sigmoid(), stored["sh"],
            self.viewmats, self.intrinsics, *SIZE, near_plane=0.2, sh_degree=self.degree, packed=False,
        )
        return colors[0]

    def timed(self, step):
        torch, walls, clocks = self.torch, [], []
        for i in range(WARM_UP + FRAMES):
            begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
            torch.cuda.synchronize()
            started = time.perf_counter()
            begin.record()
            step()
            end.record()
            torch.cuda.synchronize()
            if i >= WARM_UP:
                walls.append(1e3 * (time.perf_counter() - started))
                clocks.append(begin.elapsed_time(end))
        return statistics.median(walls), statistics.median(clocks)

    def frame(self):
        with self.torch.no_grad():
            # Activated once, as ours are when they are loaded.
            return self.timed(lambda: self.render(self.stored))

    def picture(self):
        with self.torch.no_grad():
            return self.render(self.stored).clamp(0, 1).cpu().numpy()

    def training_step(self):
        torch = self.torch
        learnt = {name: value.clone().requires_grad_() for name, value in self.stored.items()}
        optimizer = torch.optim.Adam([{"params": [value], "lr": 1e-15} for value in learnt.values()], eps=1e-15, fused=True)
        with torch.no_grad():
            photo = 0.8 * self.render(self.stored)
        try:
            from fused_ssim import fused_ssim
            ssim = lambda x: fused_ssim(x.permute(2, 0, 1)[None], photo.permute(2, 0, 1)[None])
        except ImportError:
            taps = torch.exp(-((torch.arange(11, device="cuda") - 5) / 1.5) ** 2 / 2)
            window = (taps[:, None] * taps / taps.sum() ** 2).expand(3, 1, 11, 11).contiguous()
            blur = lambda v: torch.nn.functional.conv2d(v.permute(2, 0, 1)[None], window, padding=5, groups=3)
            def ssim(x):
                mx, my = blur(x), blur(photo)
                xx, yy, xy = blur(x * x) - mx * mx, blur(photo * photo) - my * my, blur(x * photo) - mx * my
                return ((2 * mx * my + 1e-4) * (2 * xy + 9e-4) / ((mx * mx + my * my + 1e-4) * (xx + yy + 9e-4))).mean()

        def step():
            x = self.render(learnt)
            loss = 0.8 * (x - photo).abs().mean() + 0.2 * (1 - ssim(x))
            loss.backward()
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)

        return self.timed(step)


def display_referred(linear):
    """sRGB's encoding of linear light, which NPY pictures hold."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0) ** (1 / 2.4) - 0.055)


def psnr(a, b):
    return 10 * math.log10(1 / max(float(np.mean((a - b) ** 2)), 1e-12))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", type=Path)
    parser.add_argument("--program", default="target/release/weather-magician")
    parser.add_argument("--device", default="gpu", help="of ours: gpu or gpu:NAME")
    parser.add_argument("--frames", type=int, default=FRAMES, help="frames of ours to measure")
    parser.add_argument("--splats", nargs="*", type=int, default=[100_000, 1_000_000, 3_000_000], help="sizes of made-up scenes")
    parser.add_argument("--out", type=Path, help="write the table there too")
    args = parser.parse_args()
    lines = [
        f"{SIZE[0]}x{SIZE[1]} px, medians. Ours: {args.device}.",
        "",
        "| scene | splats | case | ours wall ms | ours GPU ms | to clear (GPU) | fps | paper fps | gsplat wall ms | gsplat GPU ms | ours / gsplat (GPU speed) |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        scenes = args.scenes or [made_up(args, count, work) for count in args.splats]
        for number, scene in enumerate(scenes):
            failed |= measure(scene, number, args, work, lines)
    table = "\n".join(lines) + "\n"
    print(table)
    if args.out:
        args.out.write_text(table)
    sys.exit(1 if failed else 0)


def made_up(args, count, work):
    """A random scene of SH degree 3: splats of all sizes through a ball, 12 units in front of a camera."""
    random = np.random.default_rng(7)
    # About as many splats over each pixel however many there are.
    size = 2.0 * count ** -0.5
    columns = [
        4 * random.standard_normal((count, 3)),
        0.3 * random.standard_normal((count, 3)),
        0.05 * random.standard_normal((count, 45)),
        random.standard_normal((count, 1)) + 1,
        np.log(size * random.uniform(0.2, 3, (count, 3))),
        random.standard_normal((count, 4)),
    ]
    rest = [f"f_rest_{i}" for i in range(45)]
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", *rest, "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    folder = work / f"made-up-{count}"
    (folder / "point_cloud/iteration_0").mkdir(parents=True)
    with open(folder / "point_cloud/iteration_0/point_cloud.ply", "wb") as file:
        header = ["ply", "format binary_little_endian 1.0", f"element vertex {count}", *(f"property float {name}" for name in names)]
        file.write("\n".join([*header, "end_header\n"]).encode())
        np.concatenate(columns, axis=1).astype("<f4").tofile(file)
    camera = look_at("0,-12,0:0,0,0") | {"id": 0, "img_name": "0", "width": SIZE[0], "height": SIZE[1]}
    (folder / "cameras.json").write_text(json.dumps([camera]))
    return folder


def measure(scene, number, args, work, lines):
    """Adds the rows of a scene; whether pictures differ."""
    folder, camera = prepared(scene, number, args, work)
    splats = read_ply(folder / "point_cloud/iteration_0/point_cloud.ply")
    shared = [folder, "--camera", 0, "--size", f"{SIZE[0]}x{SIZE[1]}", "--frames", args.frames, "--device", args.device, "--json"]
    named = [word for name in CASES[1:] for word in ("--cases", name)]
    ours = json.loads(run(args.program, "bench", *shared, *named))[0]
    training = json.loads(run(args.program, "bench", "--training", *shared))[0]
    theirs = None
    try:
        theirs = Gsplat(splats, camera)
    except ImportError as error:
        print(f"gsplat is left out: {error}", file=sys.stderr)
    differs = False
    if theirs:
        picture = work / f"picture-{number}.npy"
        run(args.program, "render", folder, "--camera", 0, "--size", f"{SIZE[0]}x{SIZE[1]}", "--near", 0.2, "--device", args.device,
            "--metres-per-unit", 1, "--background", "black", "-o", picture)
        found = psnr(display_referred(np.load(picture)[..., :3]).clip(0, 1), theirs.picture())
        print(f"{scene}: pictures agree to {found:.1f} dB", file=sys.stderr)
        differs = found < 35
    gpu_of = lambda case: sum(time for stage, time in case["stages_ms"].items() if stage != "gather")
    cases = {case["name"]: case for case in ours["cases"]}
    clear = gpu_of(cases["rgb"])
    frame = theirs.frame() if theirs else None
    number_or = lambda value, form="{:.2f}": form.format(value) if value is not None else ""
    for name in CASES:
        case, own = cases[name], gpu_of(cases[name])
        peer = frame if name == "rgb" else None
        lines.append(
            f"| {scene.name} | {ours['splats']} | {name} | {case['wall_ms']:.2f} | {own:.2f} | {own / clear:.3f} "
            f"| {1e3 / case['wall_ms']:.0f} | {number_or(PAPER.get(name), '{:g}')} | {number_or(peer and peer[0])} | {number_or(peer and peer[1])} "
            f"| {number_or(peer and peer[1] / own)} |"
        )
    step = theirs.training_step() if theirs else None
    own = sum(training["device_ms"].values()) if training.get("device_ms") else None
    lines.append(
        f"| {scene.name} | {ours['splats']} | training step | {training['wall_ms']:.2f} | {number_or(own)} | | {1e3 / training['wall_ms']:.0f} "
        f"| | {number_or(step and step[0])} | {number_or(step and step[1])} | {number_or(step and own and step[1] / own)} |"
    )
    if ours.get("device_memory_mb"):
        lines.append(f"| {scene.name} | {ours['splats']} | memory on the GPU, MB | {ours['device_memory_mb']:.0f} | | | | | | | |")
    return differs


if __name__ == "__main__":
    main()
