"""Pictures and arrays: those of the program, without copies, in any process and thread."""

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pytest
from conftest import needed

import weather_magician as wm

SIZE = (96, 64)


@pytest.mark.parametrize("weather", ["fog", "heavy-rain", "snow"])
def test_a_picture_has_the_bytes_of_the_program(street, place, program, tmp_path, weather):
    place.picture(weather, size=SIZE).save(tmp_path / "python.png")
    out = tmp_path / "program.png"
    program("render", street, "--weather", weather, "--size", "96x64", "--device", "cpu", "-o", out)
    assert (tmp_path / "python.png").read_bytes() == out.read_bytes()


def test_scenes_in_levels_are_drawn_under_a_budget(street, program, tmp_path):
    levels, own = tmp_path / "levels" / "lod-meta.json", ["--device", "cpu", "--splats", "3000"]
    program("convert", street, levels)
    out = tmp_path / "program.png"
    program("render", levels, "--weather", "fog", "--size", "96x64", *own, "-o", out)
    place = wm.Renderer(levels, device="cpu", splats=3000)
    assert place.scene is None
    # What is pickled is the path.
    for renderer in (place, pickle.loads(pickle.dumps(place))):
        renderer.picture("fog", size=SIZE).save(tmp_path / "python.png")
        assert (tmp_path / "python.png").read_bytes() == out.read_bytes()
    whole = wm.Renderer(levels, device="cpu").picture("fog", size=SIZE)
    assert not np.array_equal(whole.rgb, place.picture("fog", size=SIZE).rgb)
    with pytest.raises(ValueError, match="2GiB"):
        wm.Renderer(levels, memory="much")
    with pytest.raises(ValueError, match="path"):
        wm.Renderer(wm.Scene.open(levels), splats=3000)
    # Data sets too, and a frame alone is that of the run.
    plan = tmp_path / "set.toml"
    plan.write_text(
        'frames = 3\nalso = ["depth.npy"]\n[rig]\nsize = [96, 64]\n[[path]]\npath = "dolly"\n[[weather]]\nfrom = ["snow-covered"]\n'
        f"[[scene]]\nfile = {str(levels)!r}\nsplats = 3000\n"
    )
    program("batch", plan, "-o", tmp_path / "set", "--device", "cpu")
    alone = wm.Batch(plan, tmp_path / "alone", device="cpu").sample(2, layers=["depth"])
    depths = sorted((tmp_path / "set").glob("**/*.depth.npy"))
    assert len(depths) == 3 and np.array_equal(alone["depth"], np.load(depths[2]))


def test_arrays_have_the_shapes_and_the_values_of_pictures(place):
    cameras = [place.camera(size=SIZE), place.camera("0,0,2:0,10,2", size=SIZE)]
    viewmats, ks = np.stack([c.viewmat for c in cameras]), np.stack([c.K for c in cameras])
    outputs = ("rgb", "rgb_linear", "depth", "normal", "alpha", "transmittance", "label")
    made = place.render("fog", viewmats, ks, *SIZE, outputs=outputs, near=cameras[0].near)
    assert {name: (array.shape, array.dtype) for name, array in made.items()} == {
        "rgb": ((2, 64, 96, 3), np.uint8),
        "rgb_linear": ((2, 64, 96, 3), np.float32),
        "depth": ((2, 64, 96, 1), np.float32),
        "normal": ((2, 64, 96, 3), np.float32),
        "alpha": ((2, 64, 96, 1), np.float32),
        "transmittance": ((2, 64, 96, 3), np.float32),
        "label": ((2, 64, 96, 1), np.uint16),
    }
    for index, camera in enumerate(cameras):
        alone = place.picture("fog", camera, outputs=["depth"])
        assert np.array_equal(alone.rgb, made["rgb"][index])
        assert np.array_equal(alone["depth"], made["depth"][index, ..., 0])
    assert made["depth"].max() > 5 and made["depth"].min() >= 0


def test_memory_is_moved_and_lent_not_copied(place, street):
    camera = place.camera(size=SIZE)
    rgb = place.render("fog", camera.viewmat, camera.K, *SIZE)["rgb"]
    assert rgb.flags.writeable and np.from_dlpack(rgb).ctypes.data == rgb.ctypes.data
    splats = wm.Scene.open(street).splats
    means = splats.means
    assert means.ctypes.data == splats.means.ctypes.data, "a view of the same memory"
    assert means.shape == (len(splats), 3) and splats.sh.shape[2] == 3
    with pytest.raises(ValueError):
        means[0, 0] = 1.0
    first = means[0].copy()
    del splats
    assert np.array_equal(means[0], first), "the view keeps the scene alive"


def test_torch_takes_the_same_memory(place):
    torch = needed("torch")
    camera = place.camera(size=SIZE)
    linear = place.render("fog", camera.viewmat, camera.K, *SIZE, outputs=["rgb_linear"])["rgb_linear"]
    tensor = torch.from_dlpack(linear)
    assert tensor.data_ptr() == linear.ctypes.data == torch.from_numpy(linear).data_ptr()
    viewmats, ks = torch.from_numpy(camera.viewmat)[None], torch.from_numpy(camera.K)[None]
    assert place.render("fog", viewmats, ks, *SIZE)["rgb"].shape == (1, 64, 96, 3)


def test_arguments_of_the_wrong_shape_are_named(place):
    camera = place.camera(size=SIZE)
    viewmat, k = camera.viewmat, camera.K
    with pytest.raises(ValueError, match=r"viewmats: must have the shape \[C, 4, 4\], not \[3, 4\]"):
        place.render("fog", viewmat[:3], k, *SIZE)
    with pytest.raises(ValueError, match="Ks: there are 1 for 2 viewmats"):
        place.render("fog", [viewmat] * 2, k, *SIZE)
    with pytest.raises(ValueError, match="skew"):
        place.render("fog", viewmat, k + np.eye(3)[[1, 2, 0]], *SIZE)
    with pytest.raises(ValueError, match="outputs: `dept` is not"):
        place.render("fog", viewmat, k, *SIZE, outputs=["dept"])
    with pytest.raises(ValueError, match=r"time: must have the shape \[\] or \[1\]"):
        place.render("fog", viewmat, k, *SIZE, time=[0, 1, 2])
    with pytest.raises(KeyError, match="normal: was not rendered"):
        place.picture("fog", size=SIZE)["normal"]
    with pytest.raises(wm.Error, match="there is no weather `fgo`, did you mean `fog`"):
        place.picture("fgo")


def test_errors_are_the_lines_of_the_program(street, program, tmp_path):
    damaged = tmp_path / "damaged.ply"
    damaged.write_bytes(street.read_bytes()[:1000])
    for path in (damaged, tmp_path / "nowhere.ply"):
        with pytest.raises(wm.Error) as error:
            wm.Renderer(path)
        said = program("render", path, "-o", tmp_path / "no.png", check=False)
        assert said.returncode == 1 and said.stderr.strip() == f"error: {error.value}"


def pictured(renderer):
    """The picture of a renderer, in another process."""
    return renderer.picture("fog", size=SIZE).rgb


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_renderers_go_to_other_processes(place, method):
    expected = pictured(place)
    assert len(pickle.dumps(place)) < 1000, "a path and a hash, not splats"
    with multiprocessing.get_context(method).Pool(1) as pool:
        assert np.array_equal(pool.apply(pictured, (place,)), expected)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_renderer_goes_on_in_a_fork(place):
    """As torch's DataLoader has it: nothing is pickled, and the threads of the parent are not there."""
    expected = pictured(place)
    here, there = multiprocessing.Pipe()
    context = multiprocessing.get_context("fork")
    process = context.Process(target=lambda: there.send_bytes(pictured(place).tobytes()))
    process.start()
    assert here.poll(120) and here.recv_bytes() == expected.tobytes()
    process.join(60)
    assert process.exitcode == 0
    assert np.array_equal(pictured(place), expected), "and in the parent"


def test_a_changed_file_is_not_what_was_pickled(street, tmp_path):
    path = tmp_path / "scene.ply"
    path.write_bytes(street.read_bytes())
    pickled = pickle.dumps(wm.Scene.open(path))
    scene, _ = wm.Scene.open(path).changed(scale=2.0)
    scene.save(path)
    with pytest.raises(wm.Error, match="is not the file that was pickled"):
        pickle.loads(pickled)


def test_threads_of_python_go_on_while_a_picture_is_made(street):
    renderer = wm.Renderer(street, device="cpu", threads=1)
    camera = renderer.camera(size=SIZE)
    counted, done = [0], threading.Event()

    def count():
        while not done.is_set():
            counted[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    before = counted[0]
    renderer.render("heavy-rain", [camera.viewmat] * 20, [camera.K] * 20, *SIZE, time=np.arange(20.0))
    during = counted[0] - before
    done.set()
    thread.join()
    assert during > 5


def test_ctrl_c_stops_a_long_render(street):
    code = textwrap.dedent(f"""
        import weather_magician as wm
        renderer = wm.Renderer({str(street)!r}, device="cpu")
        camera = renderer.camera(size=(96, 64))
        def progress(done, total, task):
            if task == "frames" and done == 1:
                print("begun", flush=True)
        many = [[camera.viewmat] * 50000, [camera.K] * 50000]
        try:
            renderer.render("fog", *many, 96, 64, outputs=["label"], progress=progress)
        except KeyboardInterrupt:
            print("stopped", renderer.picture("fog", size=(96, 64)).rgb.shape)
    """)
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "begun\n"
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=60)[0] == "stopped (64, 96, 3)\n"


def test_an_exception_of_a_callback_comes_back(place):
    camera = place.camera(size=SIZE)

    def progress(done, total, task):
        if done == 2:
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        place.render("fog", [camera.viewmat] * 9, [camera.K] * 9, *SIZE, progress=progress)
    # Also that of the last call.
    with pytest.raises(RuntimeError, match="enough"):
        place.render("fog", [camera.viewmat] * 2, [camera.K] * 2, *SIZE, progress=progress)


def test_frames_are_counted_though_other_tasks_come_in_between(street):
    place, told = wm.Renderer(street, device="cpu", assets=False), []
    camera = place.camera(size=SIZE)
    snow = wm.Weather(parameters={"snow_cover.depth": 0.1})
    place.render(snow, [camera.viewmat] * 2, [camera.K] * 2, *SIZE, progress=lambda *of: told.append(of))
    assert [of for of in told if of[2] == "frames"] == [(0, 2, "frames"), (1, 2, "frames"), (2, 2, "frames")]
    assert any(of[2] != "frames" for of in told)


def test_a_camera_of_ones_own_is_used_as_it_is_or_as_is_asked(place, tmp_path):
    camera = place.camera("0,0,2:0,10,2", size=SIZE, fov=70)
    again = pickle.loads(pickle.dumps(camera))
    assert np.array_equal(again.viewmat, camera.viewmat) and np.array_equal(again.K, camera.K)
    assert (again.width, again.near) == (camera.width, camera.near)
    assert np.array_equal(place.camera(camera).K, camera.K) and place.camera(camera).near == camera.near
    assert place.camera(camera, fov=30).K[1, 1] == pytest.approx(32 / np.tan(np.radians(15)))
    place.video(tmp_path / "orbit.mp4", "clear", camera, move="orbit", seconds=0.2, fps=10)
    data = (tmp_path / "orbit.mp4").read_bytes()
    header = data[data.index(b"tkhd") + 4 :]
    # Version 0 ends with width and height, 16.16, after 76 bytes.
    assert (int.from_bytes(header[76:78], "big"), int.from_bytes(header[80:82], "big")) == SIZE


def test_time_and_seed_alone_decide_a_frame(place):
    camera, weather = place.camera(size=SIZE), wm.Weather("heavy-rain")
    times = [0.0, 1.5, 0.0]
    made = place.render(weather, [camera.viewmat] * 3, [camera.K] * 3, *SIZE, time=times)["rgb"]
    assert np.array_equal(made[0], made[2]) and not np.array_equal(made[0], made[1])
    assert np.array_equal(place.picture(weather, camera, time=1.5).rgb, made[1])
