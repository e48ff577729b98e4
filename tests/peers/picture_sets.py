"""The layouts of pictures alone for `sets.py`: points of the lidar are taken from `frames/`.

No reader was found of ACDC's paths and of Cityscapes' camera files, so these conventions are written out here, as are the axes of TartanAir's
cameras, whose tools read poses alone.
"""

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from common import EVERY, EXACT, SURFACE, Differences, check, matrix, moved, pixels


def tartanair(made, folder, tools):
    sys.path.insert(0, str(Path(tools) / "evaluation"))
    from transformation import pos_quats2SE_matrices

    # The world has x north and y east, a camera x forward, y right and z down.
    ned_from_world = matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]], [0, 0, 0])
    ned_from_camera = matrix([[0, 0, 1], [1, 0, 0], [0, 1, 0]], [0, 0, 0])
    far, all_depths = Differences(made), {}
    width, height = made.sensors["front"]["size"]
    v, u = np.mgrid[:height, :width] + 0.5
    for clip in made.clips:
        root = folder / clip["name"] / clip["split"] / "P000"
        poses = [np.array(pose) for pose in pos_quats2SE_matrices(np.loadtxt(root / "pose_left.txt"))]
        pictures = sorted(root.glob("image_left/*_left.png"))
        counts = [len(poses), len(pictures), len(list(root.glob("depth_left/*.npy"))), len(list(root.glob("flow/*_flow.npy"))) + 1]
        check("counts", set(counts) == {made.frames}, f"{clip['name']}, {made.frames} poses, pictures and depths, {counts[3] - 1} flows")
        fx, fy, cx, cy, baseline = np.loadtxt(root / "intrinsics.txt")
        far.add("intrinsics, px", 0, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], made.sensors["front"]["k"])

        def project(pose, points):
            """Pixels and depths of points in the world of TartanAir."""
            x, y, z = moved(np.linalg.inv(pose), points).T
            with np.errstate(all="ignore"):
                return np.stack([fx * y / x + cx, fy * z / x + cy], axis=1), x

        depths, flows, outside = [], [], []
        for frame, pose in enumerate(poses):
            far.add_pose("poses", pose, ned_from_world @ made.pose(clip, frame, "front") @ np.linalg.inv(ned_from_camera))
            far.add_picture(clip, frame, "front", Image.open(pictures[frame]), True)
            if frame % EVERY:
                continue
            found, x = project(pose, moved(ned_from_world, made.world_points(clip, frame)))
            far.add_pixels("poses and intrinsics", EXACT, clip, frame, "front", found)
            # Surfaces that the lidar sees: most are what the camera sees there too.
            is_inside = (x > 1) & (found >= 0).all(axis=1) & (found < [width, height]).all(axis=1) & (made.sweep(clip, frame)["class"] == SURFACE)
            column, row = found[is_inside].astype(int).T
            depth = np.load(root / f"depth_left/{frame:06}_left_depth.npy")
            assert depth.shape == (height, width) and depth.dtype == np.float32
            all_depths[clip["clip"], frame] = depth
            depths.append(np.abs(depth[row, column] / x[is_inside] - 1))
            if frame + 1 < made.frames:
                flow, mask = (np.load(root / f"flow/{frame:06}_{frame + 1:06}_{name}.npy") for name in ("flow", "mask"))
                assert flow.shape == (height, width, 2) and mask.shape == (height, width) and mask.dtype == np.uint8
                # Nothing moves: flow follows from depth, poses and intrinsics.
                points = np.stack([depth, (u - cx) / fx * depth, (v - cy) / fy * depth], axis=2).reshape(-1, 3)
                moves = project(poses[frame + 1], moved(pose, points))[0].reshape(height, width, 2) - np.stack([u, v], axis=2)
                flows.append(np.linalg.norm(flow - moves, axis=2)[mask == 0])
                to = (np.stack([u, v], axis=2) + flow)[mask == 0]
                outside.append(((to < 0) | (to > [width, height])).any(axis=1).mean())
        depths, flows = np.concatenate(depths), np.concatenate(flows)
        check("depth at lidar points", np.median(depths) < 0.05,
              f"|depth / z - 1|, median {np.median(depths):.3f}, 90 % {np.percentile(depths, 90):.3f}, {len(depths)} points")
        check("flow by depth and poses", np.percentile(flows, 90) < 0.5, "px off at 50, 90 and 99 %: {:.3f} {:.3f} {:.3f}".format(
            *np.percentile(flows, [50, 90, 99])))
        check("flow mask", np.max(outside) < 1e-3, f"{np.mean(outside):.1%} of pixels with mask 0 go out of the picture")
    for a, b in same_views(made):
        both = [(all_depths[a["clip"], frame], all_depths[b["clip"], frame]) for frame in range(0, made.frames, EVERY)]
        differ = np.mean([np.abs(one / other - 1) > 0.01 for one, other in both])
        sky = [np.mean([pair[k] > 9999 for pair in both]) for k in (0, 1)]
        check(f"depth in {a['weather']['name']} and {b['weather']['name']}", differ < 1e-3,
              f"{differ:.1%} of pixels differ by more than 1 %; 10000 m in {sky[0]:.1%} and {sky[1]:.1%}")
    far.report()


def same_views(made):
    """Pairs of clips with the same scene and path."""
    pairs = [(a, b) for a in made.clips for b in made.clips if a["clip"] < b["clip"] and a["scene"] == b["scene"]]
    return [(a, b) for a, b in pairs if np.array_equal(made.pose(a, 0, "front"), made.pose(b, 0, "front"))]


def nerfstudio(made, folder, _):
    import torch
    from nerfstudio.data.dataparsers.nerfstudio_dataparser import NerfstudioDataParserConfig

    far = Differences(made)
    for clip in made.clips:
        root = folder / clip["split"] / clip["name"]
        as_they_are = {"orientation_method": "none", "center_method": "none", "auto_scale_poses": False, "eval_mode": "all"}
        parser = NerfstudioDataParserConfig(data=root, load_3D_points=False, downscale_factor=1, **as_they_are).setup()
        outputs = parser.get_dataparser_outputs("train")
        cameras = outputs.cameras
        check("counts", len(cameras) == len(outputs.image_filenames) == made.frames * len(made.cameras), f"{clip['name']}, {len(cameras)} frames")
        times = {frame["file_path"]: frame["time"] for frame in json.loads((root / "transforms.json").read_text())["frames"]}
        for index, path in enumerate(outputs.image_filenames):
            camera, frame = path.parent.name, int(path.stem)
            reading = made.readings[clip["clip"], frame, camera]
            far.add("times, s", 0, times[str(path.relative_to(root))], reading["time"])
            far.add_picture(clip, frame, camera, Image.open(path), False)
            pose = np.vstack([cameras.camera_to_worlds[index].numpy().astype(float), [0, 0, 0, 1]])
            fx, fy, cx, cy = (float(getattr(cameras, name)[index]) for name in ("fx", "fy", "cx", "cy"))
            # It has f32.
            far.add("intrinsics, px", 1e-5, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], made.sensors[camera]["k"])
            far.add("distortion", 0, cameras.distortion_params[index].numpy())
            assert (int(cameras.width[index]), int(cameras.height[index])) == made.sensors[camera]["size"]
            far.add_pose("poses", pose @ np.diag([1, -1, -1, 1]), made.pose(clip, frame, camera), metres=1e-5, radians=1e-6)
            if frame % EVERY:
                continue
            # x right, y up, z backward.
            world = made.world_points(clip, frame)
            x, y, z = moved(np.linalg.inv(pose), world).T
            with np.errstate(all="ignore"):
                found = np.stack([cx - fx * x / z, cy + fy * y / z], axis=1)
            far.add_pixels("poses and intrinsics of f32", 0.02, clip, frame, camera, found)
            # Its own rays through the pixels of points must meet the points.
            expected, before = made.pixels(clip, frame, camera)
            inside = before & (expected >= 0).all(axis=1) & (expected < made.sensors[camera]["size"]).all(axis=1)
            coordinates = torch.tensor(expected[inside][:, ::-1].copy(), dtype=torch.float32)
            rays = cameras.generate_rays(camera_indices=torch.full((len(coordinates), 1), index), coords=coordinates)
            ahead = world[inside] - made.pose(clip, frame, camera)[:3, 3]
            ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
            beside = np.linalg.norm(np.cross(rays.directions.numpy().astype(float), ahead), axis=1)
            far.add("points by generate_rays in pictures, px", 1e-3, fx * beside)
    far.report()


def colmap(made, folder, _):
    import pycolmap

    far = Differences(made)
    for clip in made.clips:
        root = folder / clip["split"] / clip["name"]
        model = pycolmap.Reconstruction(root / "sparse/0")
        counts = (len(model.cameras), len(model.images))
        check("counts", counts == (len(made.cameras), len(made.cameras) * made.frames), "{}, {} cameras, {} images".format(clip["name"], *counts))
        for image in model.images.values():
            camera, frame = image.name.split("/")[0], int(Path(image.name).stem)
            far.add_picture(clip, frame, camera, Image.open(root / "images" / image.name), False)
            assert (image.camera.width, image.camera.height) == made.sensors[camera]["size"]
            far.add("intrinsics, px", 0, image.camera.calibration_matrix(), made.sensors[camera]["k"])
            pose = image.cam_from_world()
            far.add_pose("poses", np.linalg.inv(np.vstack([pose.matrix(), [0, 0, 0, 1]])), made.pose(clip, frame, camera))
            if frame % EVERY:
                continue
            world = made.world_points(clip, frame)
            expected, before = made.pixels(clip, frame, camera)
            expected[before] = image.camera.img_from_cam(pose * world[before])
            far.add_pixels("img_from_cam", EXACT, clip, frame, camera, expected)
    far.report()


def acdc(made, folder, _):
    far, clean, paths = Differences(made), {}, set()
    for clip in made.clips:
        root = folder / "rgb_anon" / clip["weather"]["condition"]
        for camera in made.cameras:
            for frame in range(made.frames):
                sequence = f"{clip['name']}-{camera}"
                path = root / clip["split"] / sequence / f"{sequence}_frame_{frame:06}_rgb_anon.png"
                reference = root / f"{clip['split']}_ref" / sequence / f"{sequence}_frame_{frame:06}_rgb_ref_anon.png"
                paths |= {path, reference}
                far.add_picture(clip, frame, camera, Image.open(path), True)
                clean[clip["clip"], camera, frame] = np.array(Image.open(reference))
    found = set(folder.glob("rgb_anon/*/*/*/*.png"))
    check("counts", found == paths, f"{len(found)} pictures, half of them references")
    hold_clean(made, clean)
    far.report()


def hold_clean(made, clean):
    """Pictures without weather of one scene and path must not depend on the weather."""
    far = [np.abs(clean[a["clip"], camera, frame].astype(int) - clean[b["clip"], camera, frame])
           for a, b in same_views(made) for camera in made.cameras for frame in range(made.frames)]
    check("clean pictures in two weathers", not np.max(far, initial=0),
          f"at most {np.max(far, initial=0)} of 255 apart, on average {np.mean(far):.1f}, {len(far)} pairs")
    weathered = [np.array_equal(picture, made.picture(made.clips[clip], frame, camera)) for (clip, camera, frame), picture in clean.items()]
    check("clean pictures are no weathered ones", not any(weathered), f"{sum(weathered)} of {len(weathered)} are")


def foggy_cityscapes(made, folder, _):
    from cityscapesscripts.helpers.csHelpers import getCsFileInfo

    far, clean, seen = Differences(made), {}, set()
    for path in sorted(folder.glob("leftImg8bit/*/*/*.png")):
        name = getCsFileInfo(str(path))
        clip, camera, frame = made.clips[int(name.sequenceNb)], name.city.split("-")[-1], int(name.frameNb)
        assert (name.type, name.city, path.parent.parent.name) == ("leftImg8bit", f"{clip['scene']}-{camera}", clip["split"])
        seen.add((clip["clip"], frame, camera))
        clean[clip["clip"], camera, frame] = np.array(Image.open(path))
        stem = f"{clip['split']}/{name.city}/{name.city}_{name.sequenceNb}_{name.frameNb}"
        (foggy,) = folder.glob(f"leftImg8bit_foggy/{stem}_leftImg8bit_foggy_beta_*.png")
        # Two digits.
        far.add("beta against the visibility", 0.05, float(foggy.stem.split("_")[-1]) * clip["weather"]["mor"] / -np.log(0.05), 1)
        far.add_picture(clip, frame, camera, Image.open(foggy), True)
        numbers = json.loads((folder / f"camera/{stem}_camera.json").read_text())
        extrinsic, intrinsic = numbers["extrinsic"], numbers["intrinsic"]
        k = np.array([[intrinsic["fx"], 0, intrinsic["u0"]], [0, intrinsic["fy"], intrinsic["v0"]], [0, 0, 1]])
        far.add("intrinsics, px", 0, k, made.whole_k(camera))
        (cy, sy), (cp, sp), (cr, sr) = [(np.cos(extrinsic[a]), np.sin(extrinsic[a])) for a in ("yaw", "pitch", "roll")]
        axes = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]) @ [[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]] @ [[1, 0, 0], [0, cr, -sr], [0, sr, cr]]
        # From x forward, y left, z up to x right, y down, z forward.
        rig_from_camera = matrix(axes, [extrinsic[axis] for axis in "xyz"]) @ matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0, 0, 0])
        far.add_pose("extrinsics", rig_from_camera, made.sensors[camera]["rig_from_sensor"])
        if frame % EVERY == 0:
            points = moved(np.linalg.inv(made.rig(clip, frame) @ rig_from_camera), made.world_points(clip, frame))
            far.add_pixels("camera files", EXACT, clip, frame, camera, pixels(k, points) + 0.5)
    counts = [len(list(folder.glob(f"{name}/*/*/*"))) for name in ("leftImg8bit", "leftImg8bit_foggy", "camera")]
    check("counts", len(seen) == counts[0] == counts[1] == counts[2] == len(made.clips) * made.frames * len(made.cameras),
          f"{counts[0]} pictures in fog, without, and camera files")
    hold_clean(made, clean)
    far.report()
