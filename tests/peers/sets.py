#!/usr/bin/env python3
"""Holds a set that `batch` made against the readers of its layouts: counts, intrinsics, poses, times, pictures and points must be those of the
set's manifest and of its layout `frames`, and all points of every fifth frame must fall on the same pixels of all cameras, by each reader's
own calibration and poses.

    weather-magician batch PLAN -o SET      # layouts = ["frames", and any of those below]
    python3 tests/peers/sets.py SET LAYOUT [REPOSITORY]

The rig has a lidar `top` and cameras `front` (ahead), `left` and `right` (45 to 60 degrees to the sides), all of the rate of the frames. What
each layout needs, from PyPI, or as a clone of a public repository that is given as REPOSITORY:

    nuscenes                              nuscenes-devkit==1.2.0 'numpy<2'
    kitti-raw, kitti-odometry             pykitti==0.3.1 opencv-python-headless
    kitti-object                          numpy pillow; github.com/open-mmlab/OpenPCDet
    semantic-kitti, wads                  numpy pillow pyyaml; github.com/PRBonn/semantic-kitti-api
    argoverse2                            av2==0.3.6
    ros2-mcap                             mcap-ros2-support==0.6.0 rosbags==0.11.9 numpy pillow
    tartanair                             numpy pillow scipy; github.com/castacks/tartanair_tools
    nerfstudio                            nerfstudio==1.1.5
    colmap, acdc, foggy-cityscapes        pycolmap cityscapesscripts numpy pillow

Layouts of KITTI take a fourth camera too. Layouts of pictures are in `picture_sets.py`. It takes seconds a layout and is no part of `cargo test`. The exit code is 1 if anything differs.
"""

import importlib.util
import io
import json
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

import picture_sets
from common import CLASSES, EVERY, EXACT, FLAKE, SURFACE, Differences, MadeSet, check, finish, matrix, moved, pixels, rotation, turn

# Packages have the names of scripts in this folder.
HERE = sys.path.pop(0)

import numpy as np
from PIL import Image


def script(name):
    """A script of this folder as a module."""
    sys.path.insert(0, HERE)
    module = __import__(name)
    sys.path.pop(0)
    return module


def shares(made):
    """Words on the classes of all points."""
    counts = sum(np.bincount(made.sweep(clip, frame)["class"], minlength=5) for clip in made.clips for frame in range(made.frames))
    return ", ".join(f"{count} {name}" for name, count in zip(CLASSES, counts) if count)


def nuscenes(made, folder, _):
    from nuscenes.nuscenes import NuScenes
    from nuscenes.utils.data_classes import LidarPointCloud
    from nuscenes.utils.data_io import load_bin_file
    from nuscenes.utils.geometry_utils import transform_matrix, view_points
    from nuscenes.utils.splits import get_scenes_of_split
    from pyquaternion import Quaternion

    nusc = NuScenes(version=f"v1.0-{made.manifest['name']}", dataroot=str(folder), verbose=False)
    channels = {"CAM_FRONT": "front", "CAM_FRONT_LEFT": "left", "CAM_FRONT_RIGHT": "right", "LIDAR_TOP": "top"}
    keys = range(0, made.frames, max(1, round(made.manifest["frame_rate"] / 2)))
    counts = (len(nusc.scene), len(nusc.sample), len(nusc.sample_data), len(nusc.lidarseg))
    expected = (len(made.clips), len(made.clips) * len(keys), len(made.readings), len(made.clips) * len(keys))
    check("counts", counts == expected, "{} scenes, {} samples, {} readings, {} classified sweeps".format(*counts))
    check("channels", {sensor["channel"] for sensor in nusc.sensor} == set(channels), ", ".join(channels))
    clips = {clip["name"]: clip for clip in made.clips}
    quarter = transform_matrix([0, 0, 0], Quaternion(axis=[0, 0, 1], angle=-np.pi / 2))
    far, poses, clouds, intrinsics, seen, keyed = Differences(made), {}, {}, {}, set(), 0
    for record in nusc.sample_data:
        clip = clips[nusc.get("scene", nusc.get("sample", record["sample_token"])["scene_token"])["name"]]
        sensor, path = channels[record["channel"]], folder / record["filename"]
        frame = [time // 1000 for time in made.times(clip, sensor)].index(record["timestamp"])
        seen.add((clip["name"], frame, sensor))
        keyed += record["is_key_frame"] == (frame in keys)
        calibration, ego = nusc.get("calibrated_sensor", record["calibrated_sensor_token"]), nusc.get("ego_pose", record["ego_pose_token"])
        pose = transform_matrix(ego["translation"], Quaternion(ego["rotation"])) @ transform_matrix(
            calibration["translation"], Quaternion(calibration["rotation"]))
        poses[clip["name"], frame, sensor] = pose
        far.add_pose("poses", pose, made.pose(clip, frame, sensor) @ (quarter if sensor == "top" else np.eye(4)))
        far.add("ego poses' times, us", 0, ego["timestamp"], record["timestamp"])
        if sensor == "top":
            cloud = LidarPointCloud.from_file(str(path)).points
            x, y, z, intensity = cloud
            sweep = made.sweep(clip, frame)
            far.add("points, m", 0, np.stack([y, -x, z], axis=1), made.points(clip, frame))
            far.add("intensities", 0, intensity, sweep["intensity"])
            rings = np.fromfile(path, np.float32).reshape(-1, 5)[:, 4]
            far.add("rings", 0, rings, made.sensors["top"]["rings"] - 1 - sweep["ring"].astype(int))
            clouds[clip["name"], frame] = cloud[:3].T
        else:
            intrinsics[sensor] = np.array(calibration["camera_intrinsic"])
            far.add("intrinsics, px", 1e-9, intrinsics[sensor], made.whole_k(sensor))
            assert (record["width"], record["height"]) == made.sensors[sensor]["size"]
            far.add_picture(clip, frame, sensor, Image.open(path), False)
    check("readings", len(seen) == len(made.readings) == keyed, f"{len(seen)} different ones, {keyed} rightly in samples or sweeps")
    for clip in made.clips:
        for frame in range(0, made.frames, EVERY):
            world = moved(poses[clip["name"], frame, "top"], clouds[clip["name"], frame])
            for camera in made.cameras:
                points = moved(np.linalg.inv(poses[clip["name"], frame, camera]), world)
                with np.errstate(all="ignore"):
                    found = view_points(points.T, intrinsics[camera], normalize=True)[:2].T
                far.add_pixels("view_points", EXACT, clip, frame, camera, found + 0.5)
    # The devkit's own chain keeps what is in the picture and works in f32.
    drawn, missed = 0, 0
    for sample in nusc.sample:
        clip = clips[nusc.get("scene", sample["scene_token"])["name"]]
        frame = [time // 1000 for time in made.times(clip, "top")].index(sample["timestamp"])
        for channel in list(channels)[:3]:
            found, _, picture = nusc.explorer.map_pointcloud_to_image(sample["data"]["LIDAR_TOP"], sample["data"][channel])
            expected, before = made.pixels(clip, frame, channels[channel])
            expected = expected - 0.5
            # Those that it keeps; points at its border may be on either side.
            inside = before & (expected > 1).all(axis=1) & (expected < np.array(picture.size) - 1).all(axis=1)
            if inside.sum() == found.shape[1]:
                far.add("points by map_pointcloud_to_image, px", 0.01, found[:2].T, expected[inside])
                drawn += 1
            else:
                missed += 1
        record = nusc.get("lidarseg", sample["data"]["LIDAR_TOP"])
        labels = load_bin_file(str(folder / record["filename"]))
        is_noise = labels == nusc.lidarseg_name2idx_mapping["noise"]
        far.add("noise against classes, points", 0, is_noise, made.sweep(clip, frame)["class"] != SURFACE)
    check("pictures with as many points", missed <= 2, f"{drawn} of {drawn + missed}")
    # Five sweeps in the axes of one, as detectors read them, by the chain of records.
    for sample in nusc.sample:
        clip = clips[nusc.get("scene", sample["scene_token"])["name"]]
        frame = [time // 1000 for time in made.times(clip, "top")].index(sample["timestamp"])
        if frame < 4:
            continue
        found, ages = LidarPointCloud.from_file_multisweep(nusc, sample, "LIDAR_TOP", "LIDAR_TOP", nsweeps=5)
        expected, seconds = [], []
        for before in range(frame, frame - 5, -1):
            # It leaves out what is near the sensor.
            far_ones = np.abs(made.points(clip, before)[:, :2]).max(axis=1) >= 1
            expected.append(moved(np.linalg.inv(made.pose(clip, frame, "top") @ quarter), made.world_points(clip, before)[far_ones]))
            seconds.append(np.full(far_ones.sum(), (made.time(clip, frame, "top") - made.time(clip, before, "top")) * 1e-9))
        far.add("points of five sweeps, m", 1e-3, found.points[:3].T, np.concatenate(expected))
        far.add("their ages, s", 1e-6, ages[0], np.concatenate(seconds))
    for scene in nusc.scene:
        is_rain = clips[scene["name"]]["weather"]["condition"] == "rain"
        check(f"description of {scene['name']}", ("rain" in scene["description"].lower()) == is_rain, scene["description"])
    for split in {clip["split"] for clip in made.clips}:
        names = get_scenes_of_split(f"{made.manifest['name']}_{split}", nusc)
        check(f"split {split}", names == [clip["name"] for clip in made.clips if clip["split"] == split], f"{len(names)} scenes")
    far.report()


def slots_of(made):
    """Numbers of KITTI's folders, by camera, and the camera whose axes are those of camera 0: the fourth, or else the first."""
    slots = dict(zip(made.cameras, (2, 3, 1, 0)))
    return slots, made.cameras[3 if len(slots) > 3 else 0]


def is_grey(slot):
    """True for cameras that are grey for pykitti, so that their files are opened as they are."""
    return slot < 2


def hold_velodyne(made, far, clip, frame, scan):
    """Points [N, 4] of KITTI against a sweep's."""
    far.add("points, m", 0, scan[:, :3], made.points(clip, frame))
    far.add("reflectances", 1e-7, scan[:, 3], made.sweep(clip, frame)["intensity"] / 255)


def kitti_calibration(made, far, p, camera0_from_velodyne):
    """`P_k` and `Tr` against the manifest."""
    slots, first = slots_of(made)
    camera0 = made.sensors[first]["rig_from_sensor"]
    far.add_pose("velodyne", camera0_from_velodyne, np.linalg.inv(camera0) @ made.sensors["top"]["rig_from_sensor"])
    for camera, slot in slots.items():
        pose = np.linalg.inv(made.sensors[camera]["rig_from_sensor"]) @ camera0
        far.add("P_k", 1e-9, p[slot], made.whole_k(camera) @ pose[:3])


def by_p(p, camera0_from_velodyne, points):
    """Pixels by `P_k Tr x`, the first pixel's centre at 0.5, 0.5."""
    camera0 = moved(camera0_from_velodyne, points)
    return pixels(1, camera0 @ p[:, :3].T + p[:, 3]) + 0.5


def kitti_raw(made, folder, _):
    from datetime import datetime, timedelta, timezone

    import pykitti

    far, (slots, first) = Differences(made), slots_of(made)
    for clip in made.clips:
        day = datetime.fromtimestamp(clip["start_ns"] // 10**9, timezone.utc).strftime("%Y_%m_%d")
        data = pykitti.raw(str(folder), day, f"{clip['clip']:04}")
        files = {camera: getattr(data, f"cam{slot}_files") for camera, slot in slots.items()}
        counts = {len(data), len(data.velo_files), len(data.oxts), *map(len, files.values())}
        check("counts", counts == {made.frames}, f"drive {clip['clip']:04}, {len(data)} frames of {len(files)} cameras, velodyne and oxts")
        epoch = datetime(1970, 1, 1)
        microseconds = [(time - epoch) // timedelta(microseconds=1) for time in data.timestamps]
        far.add("times, us", 0, microseconds, [time // 1000 for time in made.times(clip, "top")])
        drive = Path(data.data_path)
        for name, sensor in [(f"image_{slot:02}", camera) for camera, slot in slots.items()] + [("velodyne_points", "top"), ("oxts", "top")]:
            lines = (drive / name / "timestamps.txt").read_text().splitlines()
            found = [int((datetime.fromisoformat(line[:19]) - epoch).total_seconds()) * 10**9 + int(line[20:]) for line in lines]
            check(f"times of {name}", found == made.times(clip, sensor), f"{len(found)}") if found != made.times(clip, sensor) else None
        p = {slot: getattr(data.calib, f"P_rect_{slot}0") for slot in range(4)}
        kitti_calibration(made, far, p, data.calib.T_cam0_velo)
        far.add_pose("IMU", np.linalg.inv(data.calib.T_cam0_imu), made.sensors[first]["rig_from_sensor"])
        far.add("K_cam2, px", 1e-9, data.calib.K_cam2, made.whole_k("front"))
        own = pykitti.utils.read_calib_file(str(Path(data.calib_path) / "calib_cam_to_cam.txt"))
        start = made.rig(clip, 0)[:3, 3]
        places = [made.rig(clip, frame)[:3, 3] for frame in range(made.frames)]
        seconds = (np.array(made.times(clip, "top")) - made.time(clip, 0, "top")) * 1e-9
        speeds = [[packet.ve, packet.vn, packet.vu] for packet, _ in data.oxts]
        far.add("velocities by differences of places, m/s", 1e-5, speeds, np.gradient(places, seconds, axis=0))
        for frame, packet in enumerate(data.oxts):
            # The world of the packets has its origin at the first frame.
            expected = made.rig(clip, frame)
            expected[:3, 3] -= start
            far.add_pose("poses", packet.T_w_imu, expected, metres=1e-6)
            for camera, slot in slots.items():
                picture = Image.open(files[camera][frame]) if is_grey(slot) else getattr(data, f"get_cam{slot}")(frame)
                far.add_picture(clip, frame, camera, picture, True)
            scan = data.get_velo(frame)
            hold_velodyne(made, far, clip, frame, scan)
            if frame % EVERY:
                continue
            for camera, slot in slots.items():
                far.add_pixels("P_rect_k0 T_cam0_velo", EXACT, clip, frame, camera, by_p(p[slot], data.calib.T_cam0_velo, scan[:, :3]))
                turned = matrix(own[f"R_{slot:02}"].reshape(3, 3), own[f"T_{slot:02}"]) @ data.calib.T_cam0_velo
                far.add_pixels("K (R x + T)", EXACT, clip, frame, camera,
                               pixels(own[f"K_{slot:02}"].reshape(3, 3), moved(turned, scan[:, :3])) + 0.5)
            found = pixels(data.calib.K_cam2, moved(data.calib.T_cam2_velo, scan[:, :3])) + 0.5
            far.add_pixels("K_cam2 T_cam2_velo", EXACT, clip, frame, "front", found)
            # Through the packets: from the world to the rig, whose place in the first frame the
            # world leaves out.
            world = moved(packet.T_w_imu @ np.linalg.inv(data.calib.T_cam0_imu) @ data.calib.T_cam0_velo, scan[:, :3]) + start
            for camera in made.cameras:
                points = moved(np.linalg.inv(made.pose(clip, frame, camera)), world)
                far.add_pixels("oxts", 1e-3, clip, frame, camera, pixels(made.sensors[camera]["k"], points))
    far.report()


def kitti_odometry(made, folder, _):
    import pykitti

    far, (slots, first) = Differences(made), slots_of(made)
    for clip in made.clips:
        data = pykitti.odometry(str(folder), f"{clip['clip']:02}")
        files = {camera: getattr(data, f"cam{slot}_files") for camera, slot in slots.items()}
        counts = {len(data), len(data.poses), len(data.velo_files), *map(len, files.values())}
        check("counts", counts == {made.frames}, f"sequence {clip['clip']:02}, {len(data)} frames of {len(slots)} cameras, velodyne and poses")
        times = made.times(clip, "top")
        far.add("times, s", 2e-6, [time.total_seconds() for time in data.timestamps], [(time - times[0]) * 1e-9 for time in times])
        p = {slot: getattr(data.calib, f"P_rect_{slot}0") for slot in range(4)}
        kitti_calibration(made, far, p, data.calib.T_cam0_velo)
        start = made.pose(clip, 0, first)
        for frame, pose in enumerate(data.poses):
            far.add_pose("poses", pose, np.linalg.inv(start) @ made.pose(clip, frame, first))
            for camera, slot in slots.items():
                picture = Image.open(files[camera][frame]) if is_grey(slot) else getattr(data, f"get_cam{slot}")(frame)
                far.add_picture(clip, frame, camera, picture, True)
            scan = data.get_velo(frame)
            hold_velodyne(made, far, clip, frame, scan)
            if frame % EVERY:
                continue
            world = moved(start @ pose @ data.calib.T_cam0_velo, scan[:, :3])
            for camera, slot in slots.items():
                far.add_pixels("P_rect_k0 T_cam0_velo", EXACT, clip, frame, camera, by_p(p[slot], data.calib.T_cam0_velo, scan[:, :3]))
                points = moved(np.linalg.inv(made.pose(clip, frame, camera)), world)
                far.add_pixels("poses", EXACT, clip, frame, camera, pixels(made.sensors[camera]["k"], points))
    splits(made, folder)
    far.report()


def splits(made, folder):
    """`splits.json` of sequences."""
    expected = {}
    for clip in made.clips:
        expected.setdefault(clip["split"], []).append(f"{clip['clip']:02}")
    check("splits", json.loads((folder / "splits.json").read_text()) == expected, f"{expected}")


def module(root, path):
    """A module of OpenPCDet by itself: its package would import torch."""
    spec = importlib.util.spec_from_file_location(Path(path).stem, Path(root) / path)
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def kitti_object(made, folder, openpcdet):
    calibration_kitti = module(openpcdet, "pcdet/utils/calibration_kitti.py")
    object3d_kitti = module(openpcdet, "pcdet/utils/object3d_kitti.py")
    far, listed, data, (slots, _) = Differences(made), {}, folder / "training", slots_of(made)
    for clip in made.clips:
        for frame in range(made.frames):
            name = f"{clip['clip'] * made.frames + frame:06}"
            listed.setdefault(clip["split"], []).append(name)
            for camera, slot in slots.items():
                far.add_picture(clip, frame, camera, Image.open(data / f"image_{slot}/{name}.png"), True)
            scan = np.fromfile(data / f"velodyne/{name}.bin", np.float32).reshape(-1, 4)
            hold_velodyne(made, far, clip, frame, scan)
            assert object3d_kitti.get_objects_from_label(str(data / f"label_2/{name}.txt")) == []
            text = dict(line.split(": ") for line in (data / f"calib/{name}.txt").read_text().splitlines())
            text = {key: np.array(numbers.split(), float).reshape(3, -1) for key, numbers in text.items()}
            p = {slot: text[f"P{slot}"] for slot in range(4)}
            camera0_from_velodyne = matrix(text["R0_rect"], [0, 0, 0]) @ np.vstack([text["Tr_velo_to_cam"], [0, 0, 0, 1]])
            kitti_calibration(made, far, p, camera0_from_velodyne)
            if frame % EVERY:
                continue
            for camera, slot in slots.items():
                far.add_pixels("P_k R0_rect Tr_velo_to_cam", EXACT, clip, frame, camera, by_p(p[slot], camera0_from_velodyne, scan[:, :3]))
            calibration = calibration_kitti.Calibration(str(data / f"calib/{name}.txt"))
            with np.errstate(all="ignore"):
                found, depths = calibration.rect_to_img(calibration.lidar_to_rect(scan[:, :3]))
            _, before = made.pixels(clip, frame, "front")
            far.add("depths by OpenPCDet, m", 1e-4, depths[before], moved(camera0_from_velodyne, scan[:, :3])[before, 2])
            # It works in f32: pixels of points far outside of the picture have few digits after the
            # point.
            far.add_pixels("OpenPCDet in camera 2", 0.1, clip, frame, "front", found + 0.5)
            inside = before & (found >= 0).all(axis=1) & (found < made.sensors["front"]["size"]).all(axis=1)
            far.add("points by OpenPCDet in the picture, px", 1e-3, found[inside] + 0.5, made.pixels(clip, frame, "front")[0][inside])
    for split in ("train", "val", "test"):
        found = (folder / f"ImageSets/{split}.txt").read_text().split()
        check(f"list {split}", found == listed.get(split, []), f"{len(found)} frames")
    names = [*(f"image_{slot}" for slot in slots.values()), "velodyne", "calib", "label_2"]
    counts = {name: len(list((data / name).iterdir())) for name in names}
    check("counts", set(counts.values()) == {made.frames * len(made.clips)}, f"{counts}")
    far.report()


def semantic_kitti(made, folder, api):
    import yaml

    sys.path.insert(0, str(api))
    from auxiliary.laserscan import SemLaserScan
    from generate_sequential import parse_calibration, parse_poses

    config = yaml.safe_load((Path(api) / "config/semantic-kitti.yaml").read_text())
    outlier = flake = 1
    if folder.name == "wads":
        # WADS' classes are SemanticKITTI's and two of snow.
        config["labels"] |= {110: "active-snow", 111: "accumulated-snow"}
        config["color_map"] |= {110: [255, 255, 255], 111: [200, 200, 200]}
        flake = 110
    assert config["labels"][outlier] == "outlier"
    far, (slots, _) = Differences(made), slots_of(made)
    for clip in made.clips:
        sequence = folder / f"sequences/{clip['clip']:02}"
        calibration = parse_calibration(sequence / "calib.txt")
        poses = parse_poses(sequence / "poses.txt", calibration)
        scans, labels = (sorted((sequence / name).iterdir()) for name in ("velodyne", "labels"))
        check("counts", {len(scans), len(labels), len(poses)} == {made.frames}, f"sequence {sequence.name}, {len(scans)} scans, labels and poses")
        times = made.times(clip, "top")
        far.add("times, s", 1e-9, np.loadtxt(sequence / "times.txt"), [(time - times[0]) * 1e-9 for time in times])
        p = {slot: calibration[f"P{slot}"][:3] for slot in range(4)}
        kitti_calibration(made, far, p, calibration["Tr"])
        start = made.pose(clip, 0, "top")
        for frame, pose in enumerate(poses):
            far.add_pose("poses", pose, np.linalg.inv(start) @ made.pose(clip, frame, "top"))
            scan = SemLaserScan(config["color_map"], project=True)
            scan.open_scan(str(scans[frame]))
            scan.open_label(str(labels[frame]))
            scan.colorize()
            hold_velodyne(made, far, clip, frame, np.column_stack([scan.points, scan.remissions]))
            own = made.sweep(clip, frame)["class"]
            # The set has no names of labels: surfaces are unlabeled.
            expected = np.where(own == SURFACE, 0, np.where(own == FLAKE, flake, outlier))
            far.add("labels against classes", 0, scan.sem_label, expected)
            far.add("instances", 0, scan.inst_label)
            if frame % EVERY:
                continue
            world = moved(start @ pose, scan.points)
            for camera, slot in slots.items():
                far.add_pixels("P_k Tr", EXACT, clip, frame, camera, by_p(p[slot], calibration["Tr"], scan.points))
                points = moved(np.linalg.inv(made.pose(clip, frame, camera)), world)
                far.add_pixels("poses", EXACT, clip, frame, camera, pixels(made.sensors[camera]["k"], points))
    splits(made, folder)
    far.report()


# Argoverse's names of the cameras.
RING = {"front": "ring_front_center", "left": "ring_front_left", "right": "ring_front_right"}


def argoverse2(made, folder, _):
    from av2.datasets.sensor.av2_sensor_dataloader import AV2SensorDataLoader
    from av2.structures.sweep import Sweep
    from av2.torch.data_loaders.detection import DetectionDataLoader
    from av2.utils.io import read_feather, read_img

    far, logs, names = Differences(made), 0, RING
    for clip in made.clips:
        log = clip["name"]
        loader = AV2SensorDataLoader(data_dir=folder / clip["split"], labels_dir=folder / clip["split"])
        logs += log in loader.get_log_ids()
        times = loader.get_ordered_log_lidar_timestamps(log)
        found = {name: [int(path.stem) for path in loader.get_ordered_log_cam_fpaths(log, name)] for name in names.values()}
        good = times == made.times(clip, "top") and all(found[name] == made.times(clip, camera) for camera, name in names.items())
        check("counts and times", good, f"{len(times)} sweeps, {sum(map(len, found.values()))} pictures")
        rig_from_lidar = made.sensors["top"]["rig_from_sensor"]
        for name in ("up_lidar", "down_lidar"):
            table = read_feather(folder / clip["split"] / log / "calibration/egovehicle_SE3_sensor.feather")
            (row,) = [row for row in table.to_dict("records") if row["sensor_name"] == name]
            pose = matrix(rotation(*(row[f"q{axis}"] for axis in "wxyz")), [row[f"t{axis}_m"] for axis in "xyz"])
            far.add_pose("extrinsics", pose, rig_from_lidar)
        boxes = loader.get_labels_at_lidar_timestamp(log, times[0])
        check("boxes", len(boxes.cuboids) == 0, f"{len(boxes.cuboids)}")
        kinds = read_feather(loader.get_lidar_fpath(log, times[0])).dtypes.astype(str).to_dict()
        want = dict(x="float16", y="float16", z="float16", intensity="uint8", laser_number="uint8", offset_ns="int32")
        check("columns", kinds == want, f"{kinds}")
        for camera, name in names.items():
            pinhole = loader.get_log_pinhole_camera(log, name)
            far.add("intrinsics, px", 0, pinhole.intrinsics.K, made.whole_k(camera))
            far.add_pose("extrinsics", pinhole.ego_SE3_cam.transform_matrix, made.sensors[camera]["rig_from_sensor"])
            assert (pinhole.width_px, pinhole.height_px) == made.sensors[camera]["size"]
        for frame, time in enumerate(times):
            far.add_pose("poses", loader.get_city_SE3_ego(log, time).transform_matrix, made.rig(clip, frame))
            for camera, name in names.items():
                path = loader.get_closest_img_fpath(log, name, time)
                far.add_picture(clip, frame, camera, read_img(path), False)
            sweep, own = Sweep.from_feather(loader.get_lidar_fpath(log, time)), made.sweep(clip, frame)
            exact = moved(rig_from_lidar, made.points(clip, frame))
            # 11 bits of mantissa. The writer rounds by way of f32.
            rounded = exact.astype(np.float32).astype(np.float16)
            far.add("points against rounded ones, m", 0, sweep.xyz, rounded)
            far.add("points, m", 2**-5, sweep.xyz, exact)
            far.add("intensities", 0, sweep.intensity, np.floor(own["intensity"].astype(float) + 0.5))
            far.add("rings", 0, sweep.laser_number, own["ring"])
            far.add("offsets, ns", 1, sweep.offset_ns, own["time"].astype(float) * 1e9)
            if frame % EVERY:
                continue
            for camera, name in names.items():
                with np.errstate(all="ignore"):
                    found, _, _ = loader.project_ego_to_img_motion_compensated(
                        sweep.xyz.astype(float), name, made.time(clip, frame, camera), time, log)
                far.add_pixels("the reader against rounded ones", EXACT, clip, frame, camera, found + 0.5, moved(made.rig(clip, frame), rounded))
                # Half of a step of f16 is at most 1/2048 of a coordinate. With |x| <= |X|, |y| <=
                # |Y| and so on it moves a pixel by so much.
                expected, before = made.pixels(clip, frame, camera)
                steps = np.linalg.norm(np.spacing(np.abs(rounded)).astype(float) / 2, axis=1)
                local = moved(np.linalg.inv(made.pose(clip, frame, camera)), made.world_points(clip, frame))
                limit = made.sensors[camera]["k"][0, 0] * steps * np.linalg.norm(local, axis=1) / (local[:, 2] * (local[:, 2] - steps))
                off = np.linalg.norm(found + 0.5 - expected, axis=1)
                far.add("points by the reader, shares of what rounding gives", 1, off[before] / limit[before])
                far.add("points by the reader, px", np.inf, off[before])
                inside = before & (expected >= 0).all(axis=1) & (expected < made.sensors[camera]["size"]).all(axis=1)
                far.add("points by the reader in pictures, px", np.inf, off[inside])
    check("logs", logs == len(made.clips), f"{logs}")
    # The data loader in Rust, which has a reader of Feather of its own.
    with tempfile.TemporaryDirectory() as root:
        (Path(root) / "av2").mkdir()
        (Path(root) / "av2/sensor").symlink_to(folder.resolve())
        clips, count = {clip["name"]: clip for clip in made.clips}, 0
        for split in {clip["split"] for clip in made.clips}:
            sweeps = DetectionDataLoader(root_dir=Path(root), dataset_name="av2", split_name=split)
            for index in range(len(sweeps)):
                log, time = sweeps[index].sweep_uuid
                frame = made.times(clips[log], "top").index(time)
                exact = moved(rig_from_lidar, made.points(clips[log], frame))
                far.add("points by av2.torch, m", 2**-5, sweeps[index].lidar.as_tensor()[:, :3].numpy(), exact)
                count += 1
    check("sweeps by av2.torch", count == made.frames * len(made.clips), f"{count}")
    far.report()


def ros2_mcap(made, folder, _):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    def by_mcap(bag):
        for file in sorted(bag.glob("*.mcap")):
            with file.open("rb") as stream:
                reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
                for _, channel, message, decoded in reader.iter_decoded_messages():
                    yield channel.topic, message.log_time, decoded

    def by_rosbags(bag):
        store = get_typestore(Stores.ROS2_HUMBLE)
        with Reader(bag) as reader:
            # Its end is exclusive.
            times = (reader.start_time, reader.end_time - 1)
            files = len(list(bag.glob("*.mcap")))
            # A message of /tf_static in each file, of /tf in each frame, two of each camera and one
            # of the lidar.
            expected = files + made.frames * (2 + 2 * len(made.cameras))
            clip = next(clip for clip in made.clips if clip["name"] == bag.name)
            good = times == (made.time(clip, 0, "top"), made.time(clip, made.frames - 1, "top")) and reader.message_count == expected
            check("metadata.yaml", good, f"{bag.name}: {reader.message_count} messages in {reader.duration * 1e-9:.3f} s")
            for connection, time, data in reader.messages():
                yield connection.topic, time, store.deserialize_cdr(data, connection.msgtype)

    ros = script("ros2_mcap")
    for name, read in {"mcap-ros2-support": by_mcap, "rosbags": by_rosbags}.items():
        far = Differences(made)
        for clip in made.clips:
            bag = folder / clip["split"] / clip["name"]
            hold_bag(made, far, ros, clip, name, read(bag))
        far.report()


def hold_bag(made, far, ros, clip, name, messages):
    """Messages as (topic, log time, message) against a clip."""
    world, counts, static, clouds, infos = {}, {}, {}, {}, {}
    frames = {time: frame for frame, time in enumerate(made.times(clip, "top"))}
    for topic, time, message in messages:
        counts[topic] = counts.get(topic, 0) + 1
        if topic == "/tf_static":
            static = {t.child_frame_id: ros.pose(t.transform) for t in message.transforms}
            for frame, pose in static.items():
                far.add_pose("extrinsics", pose, made.sensors[frame]["rig_from_sensor"])
            continue
        frame = frames[time]
        if topic == "/tf":
            (t,) = message.transforms
            assert (t.header.frame_id, t.child_frame_id, ros.stamp(t)) == ("map", "base_link", time)
            world[frame] = ros.pose(t.transform)
            far.add_pose("poses", world[frame], made.rig(clip, frame))
            continue
        sensor = topic.split("/")[2]
        assert message.header.frame_id == sensor and ros.stamp(message) == time == made.time(clip, frame, sensor)
        if topic.endswith("compressed"):
            far.add_picture(clip, frame, sensor, Image.open(io.BytesIO(bytes(message.data))), False)
        elif topic.endswith("camera_info"):
            assert (message.width, message.height) == made.sensors[sensor]["size"] and message.distortion_model == "plumb_bob"
            k, p = np.array(message.k).reshape(3, 3), np.array(message.p).reshape(3, 4)
            far.add("intrinsics, px", 0, np.hstack([k, p, np.eye(3) - np.array(message.r).reshape(3, 3)]),
                    np.hstack([made.whole_k(sensor), made.whole_k(sensor), np.zeros((3, 4))]))
            far.add("distortion", 0, message.d)
            infos[frame, sensor] = p
        else:
            points, own = ros.cloud(message), made.sweep(clip, frame)
            xyz = np.stack([points[axis] for axis in "xyz"], axis=1)
            far.add("points, m", 0, xyz, made.points(clip, frame))
            far.add("intensities", 0, points["intensity"], np.floor(own["intensity"].astype(float) + 0.5))
            far.add("channels", 0, points["channel"], own["ring"])
            far.add("time stamps, ns", 1, points["time_stamp"], own["time"].astype(float) * 1e9)
            far.add("distances, m", 0, points["distance"], own["range"])
            # Points are in the axes of the start of the sweep, angles and distances are those of
            # the pulse.
            motion = [np.linalg.inv(made.pose(clip, f, "top")) @ made.pose(clip, f + 1, "top") for f in (frame, frame + 1) if f + 1 < made.frames]
            if len(motion) == 2 and np.abs(motion[0] - motion[1]).max() < 1e-9 and turn(motion[0], np.eye(4)) < 1e-9:
                seconds = points["time_stamp"].astype(float) * 1e-9
                at_pulse = xyz - seconds[:, None] * motion[0][:3, 3] * made.manifest["frame_rate"]
                azimuth, elevation, distance = (points[name].astype(float) for name in ("azimuth", "elevation", "distance"))
                ahead = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
                far.add("points by angles where the rig goes straight, m", 1e-4, np.stack(ahead, axis=1) * distance[:, None], at_pulse)
            clouds[frame] = xyz
    expected = {"/tf": made.frames, "/sensors/top/points": made.frames}
    expected |= {f"/sensors/{camera}/{end}": made.frames for camera in made.cameras for end in ("image/compressed", "camera_info")}
    found = {topic: count for topic, count in counts.items() if topic != "/tf_static"}
    check("counts", found == expected, f"{clip['name']} by {name}: {sum(counts.values())} messages of {len(counts)} topics, "
          f"{counts['/tf_static']} files")
    for frame in range(0, made.frames, EVERY):
        points = moved(world[frame] @ static["top"], clouds[frame])
        for camera in made.cameras:
            local = moved(np.linalg.inv(world[frame] @ static[camera]), points)
            far.add_pixels("tf and P", EXACT, clip, frame, camera, pixels(infos[frame, camera][:, :3], local) + 0.5)


# What holds each layout, and the packages from PyPI that read it.
LAYOUTS = {
    "nuscenes": (nuscenes, ["nuscenes-devkit"]),
    "kitti-raw": (kitti_raw, ["pykitti"]),
    "kitti-odometry": (kitti_odometry, ["pykitti"]),
    "kitti-object": (kitti_object, []),
    "semantic-kitti": (semantic_kitti, []),
    "wads": (semantic_kitti, []),
    "argoverse2": (argoverse2, ["av2"]),
    "ros2-mcap": (ros2_mcap, ["mcap-ros2-support", "rosbags"]),
    "tartanair": (picture_sets.tartanair, []),
    "nerfstudio": (picture_sets.nerfstudio, ["nerfstudio"]),
    "colmap": (picture_sets.colmap, ["pycolmap"]),
    "acdc": (picture_sets.acdc, []),
    "foggy-cityscapes": (picture_sets.foggy_cityscapes, ["cityscapesscripts"]),
}


def main():
    if len(sys.argv) not in (3, 4) or sys.argv[2] not in LAYOUTS:
        sys.exit(f"usage: sets.py SET LAYOUT [REPOSITORY], LAYOUT one of {', '.join(LAYOUTS)}")
    made, layout = MadeSet(sys.argv[1]), sys.argv[2]
    hold, packages = LAYOUTS[layout]
    readers = [f"{package} {version(package)}" for package in packages] + [Path(path).name for path in sys.argv[3:]]
    print(f"{layout} by {', '.join(readers) or 'its conventions'}: {len(made.clips)} clips of {made.frames} frames, {len(made.cameras)} cameras, "
          f"points of {shares(made)}")
    hold(made, made.folder / layout, sys.argv[3] if len(sys.argv) > 3 else None)
    finish()


if __name__ == "__main__":
    main()
