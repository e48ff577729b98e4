#!/usr/bin/env python3
"""Holds the layouts of pictures against other readers: `tartanair`, `nerfstudio`, `colmap`, `acdc` and `foggy-cityscapes` of the synthetic
set, each in a folder of its name below FOLDER.

    for layout in tartanair nerfstudio colmap acdc foggy-cityscapes; do
        cargo run -p wm-batch --features testing --example synthetic_set -- $layout FOLDER/$layout
    done
    python3 -m venv VENV && VENV/bin/pip install pycolmap cityscapesscripts numpy pillow
    VENV/bin/python tests/peers/pictures.py FOLDER

COLMAP's model is read by pycolmap, names of Cityscapes by cityscapesscripts. The others have no reader that comes without PyTorch or
without a download of their data, so their conventions are written out here: nerfstudio 1.1.5 (`data/dataparsers/nerfstudio_dataparser.py`,
OpenGL's axes, pixel centres at 0.5), the turn between TartanAir's and OpenCV's axes of tartanair 1.4.0 (`customizer.py`), paths of ACDC as
public configurations glob them. Compared are counts, intrinsics, poses, and the pixel of a known point; in PNG files that pixel must be
red, and in their clean twins it must not.

It is no part of `cargo test`. The exit code is 1 if anything differs.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pycolmap
from cityscapesscripts.helpers.csHelpers import getCsFileInfo
from PIL import Image

from common import check, finish, rotation


def picture(path):
    return np.array(Image.open(path).convert("RGB")).astype(int)


def is_red(path, pixel):
    """True if the pixel is the red of the spot."""
    x, y = np.floor(pixel).astype(int)
    return picture(path)[y, x].tolist() == [255, 0, 0]


def pictures_of(clip, cameras, sensor=None):
    """Readings of cameras, of one if it is named."""
    return [r for r in clip["readings"] if r["sensor"] in cameras and sensor in (None, r["sensor"])]


class Pixels:
    """The largest difference between pixels, and how many there were."""

    def __init__(self):
        self.worst, self.seen = 0.0, 0

    def add(self, pixel, reading):
        if reading["spot_pixel"]:
            self.worst = max(self.worst, np.abs(np.array(pixel) - reading["spot_pixel"]).max())
            self.seen += 1

    def check(self):
        check("spot", self.seen > 10 and self.worst < 1e-6, f"{self.seen} pictures, {self.worst:.1e} px from truth")


def tartan_air(folder, clip, cameras, spot):
    root = folder / clip["name"] / clip["split"] / "P000"
    readings = pictures_of(clip, cameras, "front")
    poses = np.loadtxt(root / "pose_left.txt")
    check("counts", len(poses) == len(readings) == len(list(root.glob("image_left/*_left.png"))), f"{len(poses)} poses and pictures")
    fx, fy, cx, cy, _ = np.loadtxt(root / "intrinsics.txt")
    camera = cameras["front"]
    check("intrinsics", [fx, fy, cx, cy] == [*camera["focal"], *camera["center"]], f"{fx} {fy} {cx} {cy}")
    # Camera axes of OpenCV to those of TartanAir, as its package has them.
    ned_from_cv = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    # North, east and down of the spot, whose world has x east and y north.
    target = np.array([spot[1], spot[0], -spot[2]])
    pixels, red = Pixels(), []
    for index, (pose, reading) in enumerate(zip(poses, readings)):
        x, y, z = (rotation(pose[6], *pose[3:6]) @ ned_from_cv).T @ (target - pose[:3])
        pixels.add([fx * x / z + cx, fy * y / z + cy], reading)
        if reading["spot_pixel"]:
            red.append(is_red(root / f"image_left/{index:06}_left.png", reading["spot_pixel"]))
        depth = np.load(root / f"depth_left/{index:06}_left_depth.npy")
        assert depth.dtype == np.float32 and depth.shape == (40, 64) and depth[7, 3] == 12
    pixels.check()
    check("red", all(red), f"{sum(red)} of {len(red)}")
    flows = sorted(root.glob("flow/*_flow.npy"))
    flow, mask = np.load(flows[-1]), np.load(str(flows[-1]).replace("_flow", "_mask"))
    good = flow.shape == (40, 64, 2) and (flow == 0.5).all() and mask.dtype == np.uint8 and not mask.any()
    check("flow", good and len(flows) == len(poses) - 1, f"{len(flows)} files, the last {flows[-1].name}")


def nerfstudio(folder, clip, cameras, spot):
    root = folder / clip["split"] / clip["name"]
    meta = json.loads((root / "transforms.json").read_text())
    readings = pictures_of(clip, cameras)
    pixels, intrinsics, poses, files = Pixels(), 0.0, 0.0, 0
    for frame, reading in zip(meta["frames"], readings):
        camera = cameras[reading["sensor"]]
        world = np.array(frame["transform_matrix"])
        poses = max(poses, np.abs(world * [1, -1, -1, 1] - reading["world_from_sensor"]).max())
        want = [*camera["focal"], *camera["center"], *camera["size"], 0, 0, 0, 0, 0]
        names = ["fl_x", "fl_y", "cx", "cy", "w", "h", "k1", "k2", "k3", "p1", "p2"]
        intrinsics = max(intrinsics, np.abs(np.array([frame[name] for name in names]) - want).max())
        x, y, z = (np.linalg.inv(world) @ [*spot, 1])[:3]
        # y is up and z backward.
        pixels.add([frame["fl_x"] * x / -z + frame["cx"], frame["fl_y"] * y / z + frame["cy"]], reading)
        files += picture(root / frame["file_path"]).shape == (frame["h"], frame["w"], 3)
    check("counts", len(meta["frames"]) == len(readings) == files, f"{files} frames, {meta['camera_model']}")
    check("intrinsics", intrinsics == 0, f"{intrinsics:.1e} px from truth")
    check("poses", poses < 1e-12, f"{poses:.1e} from truth")
    pixels.check()


def colmap(folder, clip, cameras, spot):
    root = folder / clip["split"] / clip["name"]
    model = pycolmap.Reconstruction(root / "sparse/0")
    readings = pictures_of(clip, cameras)
    pixels, intrinsics, poses = Pixels(), 0.0, 0.0
    by_name = {image.name: image for image in model.images.values()}
    for reading in readings:
        name = f"{reading['sensor']}/{reading['index']:06}.jpg"
        image = by_name[name]
        camera = cameras[reading["sensor"]]
        assert picture(root / "images" / name).shape == (image.camera.height, image.camera.width, 3)
        intrinsics = max(intrinsics, np.abs(image.camera.params - [*camera["focal"], *camera["center"]]).max())
        pose = np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]])
        poses = max(poses, np.abs(np.linalg.inv(pose) - reading["world_from_sensor"]).max())
        if reading["spot_pixel"]:
            pixels.add(image.project_point(spot), reading)
    check("counts", len(model.images) == len(readings) and len(model.cameras) == len(cameras), f"{model.summary().splitlines()[1:4]}")
    check("intrinsics", intrinsics == 0, f"{intrinsics:.1e} px from truth")
    check("poses", poses < 1e-9, f"{poses:.1e} from truth")
    pixels.check()


def acdc(folder, clip, cameras, spot):
    root = folder / "rgb_anon" / clip["condition"]
    found = sorted((root / clip["split"]).glob("**/*_rgb_anon.png"))
    red, clean = [], []
    for reading in pictures_of(clip, cameras):
        sequence = f"{clip['name']}-{reading['sensor']}"
        path = root / clip["split"] / sequence / f"{sequence}_frame_{reading['index']:06}_rgb_anon.png"
        reference = Path(str(path).replace(f"/{clip['split']}/", f"/{clip['split']}_ref/").replace("_rgb_anon", "_rgb_ref_anon"))
        assert path in found and reference.exists(), path
        if reading["spot_pixel"]:
            red.append(is_red(path, reading["spot_pixel"]))
            clean.append(is_red(reference, reading["spot_pixel"]))
    check("counts", len(found) == len(pictures_of(clip, cameras)), f"{len(found)} pictures with references")
    check("red", all(red) and not any(clean) and len(red) > 10, f"{sum(red)} of {len(red)}, {sum(clean)} of the references")


def foggy_cityscapes(folder, clip, cameras, spot):
    pixels, red, clean, count = Pixels(), [], [], 0
    for path in sorted(folder.glob(f"leftImg8bit/{clip['split']}/*/*.png")):
        name = getCsFileInfo(str(path))
        assert (name.type, name.sequenceNb, name.city) == ("leftImg8bit", f"{clip['number']:06}", path.parent.name)
        sensor = name.city.split("-")[-1]
        (reading,) = [r for r in pictures_of(clip, cameras, sensor) if r["index"] == int(name.frameNb)]
        stem = f"{clip['split']}/{name.city}/{name.city}_{name.sequenceNb}_{name.frameNb}"
        (foggy,) = folder.glob(f"leftImg8bit_foggy/{stem}_leftImg8bit_foggy_beta_*.png")
        # 900 m.
        assert foggy.stem.endswith("_beta_0.0033")
        camera = json.loads((folder / f"camera/{stem}_camera.json").read_text())
        extrinsic, intrinsic = camera["extrinsic"], camera["intrinsic"]
        (cy, sy), (cp, sp), (cr, sr) = [(np.cos(extrinsic[a]), np.sin(extrinsic[a])) for a in ("yaw", "pitch", "roll")]
        rotation = (
            np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
            @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
            @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
        )
        rig = (np.linalg.inv(reading["world_from_rig"]) @ [*spot, 1])[:3]
        forward, left, up = rotation.T @ (rig - [extrinsic["x"], extrinsic["y"], extrinsic["z"]])
        u = intrinsic["fx"] * -left / forward + intrinsic["u0"] + 0.5
        v = intrinsic["fy"] * -up / forward + intrinsic["v0"] + 0.5
        pixels.add([u, v], reading)
        if reading["spot_pixel"]:
            red.append(is_red(foggy, reading["spot_pixel"]))
            clean.append(is_red(path, reading["spot_pixel"]))
        count += 1
    check("counts", count == len(pictures_of(clip, cameras)), f"{count} pictures in fog, without, and camera files")
    check("red", all(red) and not any(clean) and len(red) > 10, f"{sum(red)} of {len(red)}, {sum(clean)} of the clean ones")
    pixels.check()


LAYOUTS = {
    "tartanair": tartan_air,
    "nerfstudio": nerfstudio,
    "colmap": colmap,
    "acdc": acdc,
    "foggy-cityscapes": foggy_cityscapes,
}


def main():
    for name, hold in LAYOUTS.items():
        folder = Path(sys.argv[1]) / name
        truth = json.loads((folder / "truth.json").read_text())
        cameras = {sensor["name"]: sensor for sensor in truth["sensors"] if sensor["kind"] == "camera"}
        for clip in truth["clips"]:
            print(f"{name} {clip['name']}")
            hold(folder, clip, cameras, np.array(truth["spot"]))
    finish()


if __name__ == "__main__":
    main()
