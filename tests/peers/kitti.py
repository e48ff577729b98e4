#!/usr/bin/env python3
"""Holds the layouts `kitti-raw`, `kitti-odometry` and `kitti-object` against their readers: loads sets with pykitti, and with the calibration
and label readers of OpenPCDet, and compares counts, intrinsics, poses, times, points and pixels with `truth.json`, the set's own numbers.

    for LAYOUT in kitti-raw kitti-odometry kitti-object; do
        cargo run -p wm-batch --features testing --example synthetic_set -- $LAYOUT SETS/$LAYOUT; done
    python3 -m venv VENV && VENV/bin/pip install pykitti==0.3.1 opencv-python-headless
    git clone --depth 1 https://github.com/open-mmlab/OpenPCDet        # for kitti-object; nothing of it is built
    VENV/bin/python tests/peers/kitti.py SETS [OpenPCDet]

It takes seconds and is no part of `cargo test`. The exit code is 1 if anything differs.
"""

import importlib.util
import json
import sys
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pykitti

from common import check, finish, turn

# The folders of the first to the fourth camera of the rig.
SLOTS = [2, 3, 1, 0]


def apart(poses, expected):
    """The largest distance, m, and angle, radians, between poses of two lists."""
    return (max(np.linalg.norm(a[:3, 3] - b[:3, 3]) for a, b in zip(poses, expected)), max(turn(a, b) for a, b in zip(poses, expected)))


class Truth:
    """Sensors and readings of a clip."""

    def __init__(self, folder):
        self.all = json.loads((folder / "truth.json").read_text())
        self.cameras = [s for s in self.all["sensors"] if s["kind"] == "camera"]
        self.lidar = next(s for s in self.all["sensors"] if s["kind"] == "lidar")

    def readings(self, clip, sensor):
        return [r for r in clip["readings"] if r["sensor"] == sensor["name"] and r["is_key"]]

    def pixels(self, clip, camera):
        """The pixel of the spot in each frame, and if it is before the camera."""
        spots = np.array([r["spot"] for r in self.readings(clip, camera)])
        pixels = spots[:, :2] / spots[:, 2:] * camera["focal"] + camera["center"]
        return pixels, spots[:, 2] > 1


def projection_error(truth, clip, points, project):
    """The largest distance of the spot, projected frame by frame, from where it should be, px, over all cameras that it is before."""
    worst, seen = 0, set()
    for slot, camera in zip(SLOTS, truth.cameras):
        expected, before = truth.pixels(clip, camera)
        for frame in np.flatnonzero(before):
            x, y, z = project(slot, np.append(points[frame], 1))
            worst = max(worst, np.linalg.norm([x / z, y / z] + np.array([0.5, 0.5]) - expected[frame]))
            seen.add(camera["name"])
    return worst, sorted(seen)


def red(truth, clip, picture):
    """Checks that the pixels at the spot are red; returns their number."""
    count = 0
    for slot, camera in zip(SLOTS, truth.cameras):
        for frame, reading in enumerate(truth.readings(clip, camera)):
            if reading["spot_pixel"] is not None:
                x, y = map(int, reading["spot_pixel"])
                pixel = picture(slot, frame)
                # Cameras 0 and 1 are grey for pykitti: 0.299 of red.
                if (pixel.getpixel((x, y)) if pixel.mode == "RGB" else (255, 0, 0) if pixel.getpixel((x, y)) == 76 else None) != (255, 0, 0):
                    return -1
                count += 1
    return count


def raw(folder):
    truth = Truth(folder)
    for clip in truth.all["clips"]:
        start = datetime.fromtimestamp(clip["start"] // 10**9, timezone.utc)
        data = pykitti.raw(str(folder), start.strftime("%Y_%m_%d"), f"{clip['number']:04}")
        lidar = truth.readings(clip, truth.lidar)
        frames = len(lidar)
        files = [len(getattr(data, f"cam{slot}_files")) for slot in SLOTS[: len(truth.cameras)]] + [len(data.velo_files), len(data.oxts)]
        check("counts", set(files) == {frames} == {len(data)}, f"{frames} frames")
        times = [datetime(1970, 1, 1) + timedelta(microseconds=r["timestamp"] // 1000) for r in lidar]
        check("times", data.timestamps == times, f"{times[0]} to {times[-1]}")
        scans = [data.get_velo(frame) for frame in range(frames)]
        spots = np.array([scan[0, :3] for scan in scans])
        far = np.abs(spots - [r["spot"] for r in lidar]).max()
        check("points", far < 1e-5 and {len(s) for s in scans} == {truth.all["points"]} and np.max(scans) < 40,
              f"{truth.all['points']} a sweep, the spot within {far:.1e} m")
        # Camera 0 is the fourth, or else the first.
        first = np.array(truth.cameras[3 if len(truth.cameras) > 3 else 0]["rig_from_sensor"])
        expected = np.linalg.inv(first) @ truth.lidar["rig_from_sensor"]
        metres, radians = apart([data.calib.T_cam0_velo, data.calib.T_cam0_imu], [expected, np.linalg.inv(first)])
        check("extrinsics", metres < 1e-9 and radians < 1e-9, f"camera 0 from velodyne and IMU, at most {metres:.1e} m, {radians:.1e} rad")
        (fx, fy), (cx, cy) = truth.cameras[0]["focal"], truth.cameras[0]["center"]
        far = np.abs(data.calib.K_cam2 - [[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]]).max()
        check("intrinsics", far < 1e-9, f"camera 2, at most {far:.1e} px")
        project = lambda slot, point: getattr(data.calib, f"P_rect_{slot}0") @ data.calib.T_cam0_velo @ point
        far, cameras = projection_error(truth, clip, spots, project)
        check("P_rect_k0 T_cam0_velo x", far < 0.01 and len(cameras) == len(truth.cameras), f"at most {far:.1e} px off, cameras {cameras}")
        by_parts = lambda slot, point: getattr(data.calib, f"K_cam{slot}") @ (getattr(data.calib, f"T_cam{slot}_velo") @ point)[:3]
        slot_2 = Truth(folder)
        slot_2.cameras = truth.cameras[:1]
        far, _ = projection_error(slot_2, clip, spots, by_parts)
        check("K_cam2 T_cam2_velo x", far < 0.01, f"at most {far:.1e} px off")
        text = pykitti.utils.read_calib_file(str(Path(data.calib_path) / "calib_cam_to_cam.txt"))
        own = lambda slot, point: text[f"K_{slot:02}"].reshape(3, 3) @ (
            text[f"R_{slot:02}"].reshape(3, 3) @ (data.calib.T_cam0_velo @ point)[:3] + text[f"T_{slot:02}"])
        far, cameras = projection_error(truth, clip, spots, own)
        check("K (R x + T)", far < 0.01, f"at most {far:.1e} px off, cameras {cameras}")
        count = red(truth, clip, lambda slot, frame: getattr(data, f"get_cam{slot}")(frame))
        check("colour", count > 0, f"the spot is red in {count} pictures")
        # The world of the packets has its origin at the first frame.
        poses = [np.array(r["world_from_rig"]) for r in lidar]
        for pose in poses[::-1]:
            pose[:3, 3] -= poses[0][:3, 3]
        metres, radians = apart([packet.T_w_imu for packet in data.oxts], poses)
        check("poses", metres < 1e-6 and radians < 1e-9, f"at most {metres:.1e} m, {radians:.1e} rad")
        speeds = np.array([[p.packet.ve, p.packet.vn, p.packet.vu] for p in data.oxts])
        seconds = np.array([r["timestamp"] - lidar[0]["timestamp"] for r in lidar]) * 1e-9
        far = np.abs(speeds - np.gradient([p[:3, 3] for p in poses], seconds, axis=0)).max()
        check("velocities", far < 1e-5, f"at most {far:.1e} m/s from differences of poses")


def odometry(folder):
    truth = Truth(folder)
    for clip in truth.all["clips"]:
        data = pykitti.odometry(str(folder), f"{clip['number']:02}")
        lidar, camera = truth.readings(clip, truth.lidar), truth.readings(clip, truth.cameras[3 if len(truth.cameras) > 3 else 0])
        counts = {len(data), len(data.poses), len(data.velo_files), *(len(getattr(data, f"cam{k}_files")) for k in SLOTS[: len(truth.cameras)])}
        check("counts", counts == {len(lidar)}, f"{len(lidar)} frames")
        spots = np.array([data.get_velo(frame)[0, :3] for frame in range(len(data))])
        project = lambda slot, point: getattr(data.calib, f"P_rect_{slot}0") @ data.calib.T_cam0_velo @ point
        far, cameras = projection_error(truth, clip, spots, project)
        check("P_rect_k0 T_cam0_velo x", far < 0.01 and len(cameras) == len(truth.cameras), f"at most {far:.1e} px off, cameras {cameras}")
        first = np.linalg.inv(camera[0]["world_from_sensor"])
        metres, radians = apart(data.poses, [first @ r["world_from_sensor"] for r in camera])
        check("poses", metres < 1e-9 and radians < 1e-8, f"at most {metres:.1e} m, {radians:.1e} rad")
        expected = first @ np.append(truth.all["spot"], 1)
        far = max(np.linalg.norm(pose @ data.calib.T_cam0_velo @ np.append(spot, 1) - expected) for pose, spot in zip(data.poses, spots))
        check("spot in the world", far < 1e-5, f"the same in all frames within {far:.1e} m")
        times = [(r["timestamp"] - lidar[0]["timestamp"]) * 1e-9 for r in lidar]
        far = max(abs(a.total_seconds() - b) for a, b in zip(data.timestamps, times))
        check("times", far < 2e-6, f"within {far:.1e} s")
        count = red(truth, clip, lambda slot, frame: getattr(data, f"get_cam{slot}")(frame))
        check("colour", count > 0, f"the spot is red in {count} pictures")


def module(root, path):
    """A module of OpenPCDet by itself: its package would import torch."""
    spec = importlib.util.spec_from_file_location(Path(path).stem, Path(root) / path)
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def objects(folder, openpcdet):
    truth = Truth(folder)
    calibration_kitti = module(openpcdet, "pcdet/utils/calibration_kitti.py")
    object3d_kitti = module(openpcdet, "pcdet/utils/object3d_kitti.py")
    frames = 0
    for clip in truth.all["clips"]:
        listed = (folder / f"ImageSets/{clip['split']}.txt").read_text().split()
        lidar = truth.readings(clip, truth.lidar)
        first = frames
        frames += len(lidar)
        check("list", listed == [f"{number:06}" for number in range(first, frames)], f"{clip['split']}: {listed[0]} to {listed[-1]}")
        data = folder / "training"
        calibration = calibration_kitti.Calibration(str(data / f"calib/{listed[0]}.txt"))
        spots = np.array([np.fromfile(data / f"velodyne/{name}.bin", np.float32).reshape(-1, 4)[0, :3] for name in listed])
        expected, before = truth.pixels(clip, truth.cameras[0])
        found, depths = calibration.rect_to_img(calibration.lidar_to_rect(spots))
        far = np.abs(found + 0.5 - expected)[before].max()
        check("OpenPCDet, camera 2", far < 0.01, f"at most {far:.1e} px off, depths {depths.min():.1f} to {depths.max():.1f} m")
        # It works in f32.
        back = calibration.rect_to_lidar(calibration.lidar_to_rect(spots))
        check("there and back", np.abs(back - spots).max() < 1e-4, f"within {np.abs(back - spots).max():.1e} m")
        text = {line.split(": ")[0]: np.array(line.split(": ")[1].split(), float).reshape(3, -1)
                for line in (data / f"calib/{listed[0]}.txt").read_text().splitlines()}
        square = np.eye(4)
        square[:3] = text["Tr_velo_to_cam"]
        square[:3] = text["R0_rect"] @ square[:3]
        far, cameras = projection_error(truth, clip, spots, lambda slot, point: text[f"P{slot}"] @ square @ point)
        check("P_k R0_rect Tr_velo_to_cam x", far < 0.01, f"at most {far:.1e} px off, cameras {cameras}")
        boxes = [object3d_kitti.get_objects_from_label(str(data / f"label_2/{name}.txt")) for name in listed]
        check("labels", not any(boxes), f"{len(boxes)} files, no boxes")


if __name__ == "__main__":
    sets = Path(sys.argv[1])
    print("kitti-raw")
    raw(sets / "kitti-raw")
    print("kitti-odometry")
    odometry(sets / "kitti-odometry")
    if len(sys.argv) > 2:
        print("kitti-object")
        objects(sets / "kitti-object", sys.argv[2])
    finish()
