"""Scenes, weathers, sweeps, bakes, measurements, trainings and sets from Python."""

import ast
import inspect
import pathlib
import pickle
import subprocess
import sys

import numpy as np
import pytest
from conftest import needed

import weather_magician as wm

EXAMPLES = pathlib.Path(__file__).parents[4] / "examples" / "python"


def test_a_scene_of_arrays_is_the_scene(street, place):
    scene = wm.Scene.open(street)
    splats, used = scene.splats, scene.splats.activated()
    assert np.allclose(used["scales"], np.exp(splats.log_scales), rtol=1e-6)
    arrays = (splats.means, splats.quats, used["scales"], used["opacities"], splats.sh)
    facts = {"metres_per_unit": scene.metres_per_unit, "up": scene.up, "ground": scene.ground}
    again = wm.Scene.from_arrays(*arrays, **facts)
    assert len(again) == len(scene) and np.allclose(again.splats.log_scales, splats.log_scales, atol=1e-5)
    unpickled = pickle.loads(pickle.dumps(again))
    assert np.array_equal(unpickled.splats.sh, splats.sh) and unpickled.up == scene.up
    camera = place.camera(size=(96, 64))
    made = wm.Renderer(unpickled, device="cpu").picture("clear", camera).rgb
    # But for the sky behind it, which it does not know.
    assert np.median(np.abs(made.astype(int) - place.picture("clear", camera).rgb)) <= 1
    with pytest.raises(ValueError, match="quats: must have the shape"):
        wm.Scene.from_arrays(splats.means, splats.quats[:, :3], *arrays[2:])
    with pytest.raises(wm.Error, match="NaN"):
        wm.Scene.from_arrays(splats.means * np.nan, *arrays[1:])


def test_scenes_are_changed_and_converted(street, tmp_path):
    notes = wm.convert(street, tmp_path / "small.spz", sh_degree=0, scale=2.0)
    small = wm.Scene.open(tmp_path / "small.spz")
    assert small.splats.sh_degree == 0 and isinstance(notes, list)
    assert small.metres_per_unit == pytest.approx(0.5)
    facts = small.with_facts(metres_per_unit=3.0, up=[0, 0, 2])
    assert facts.metres_per_unit == 3.0 and facts.up == (0, 0, 1) and "small.spz" in repr(facts)
    assert pickle.loads(pickle.dumps(facts)).metres_per_unit == 3.0
    with pytest.raises(wm.Error, match="small.xyz"):
        small.save(tmp_path / "small.xyz")


def test_weathers_are_made_of_names_parameters_and_reports(tmp_path):
    parameters = {"fog.mor": 80, "wind.speed": {0: 2, 10: 8}, "sky": "overcast", "fog.airlight": (0.8, 0.8, 0.9)}
    fog = wm.Weather("fog", parameters)
    assert fog.parameters(5)["fog.mor"] == 80 and fog.parameters(5)["wind.speed"] == pytest.approx(5)
    assert pickle.loads(pickle.dumps(fog)) == fog == wm.Weather.parse(fog.to_toml()) != fog.set("fog.mor", 90)
    fog.save(tmp_path / "fog.toml")
    assert wm.Weather(tmp_path / "fog.toml") == fog
    metar = wm.Weather.from_report("EDDM 081150Z 24012KT 0350 R26L/P2000 FG VV002 03/03 Q1019")
    assert metar.parameters()["fog.mor"] < 500 and metar.notes
    assert "light-snow" in wm.Weather.presets()
    with pytest.raises(wm.Error, match="cannot set fog.mro"):
        wm.Weather("fog", {"fog.mro": 80})
    with pytest.raises(TypeError, match="a parameter is a number"):
        wm.Weather("fog", {"fog.mor": object()})


def test_a_lidar_sees_less_in_fog(place):
    clear, fog = place.scan("clear", "vlp-16", rays=1), place.scan("dense-fog", "vlp-16", rays=1)
    assert clear["position"].shape == (len(clear["range"]), 3) and clear["position"].dtype == np.float32
    surface = wm.LIDAR_CLASSES.index("surface")
    assert (fog["class"] == surface).sum() < (clear["class"] == surface).sum()
    lengths = np.linalg.norm(clear["position"].astype(float), axis=1)
    assert np.allclose(lengths, clear["range"], atol=0.05)
    axes = clear["world_from_sensor"][:3, :3]
    assert np.allclose(axes @ axes.T, np.eye(3))
    with pytest.raises(wm.Error, match="vlp-17"):
        place.scan("clear", "vlp-17")


def test_snow_is_baked_and_measured(place, tmp_path):
    baked = place.bake(wm.Weather(parameters={"snow_cover.depth": 0.1}))
    assert len(baked) > len(place.scene)
    baked.save(tmp_path / "snow.ply")
    assert len(wm.Scene.open(tmp_path / "snow.ply")) == len(baked)
    with pytest.raises(wm.Error, match="nothing lies"):
        place.bake("clear")
    readings = place.measure(wm.Weather("fog", {"fog.mor": 100}), instruments=["visibility"], size=(96, 64))
    assert readings and all(reading["passes"] for reading in readings)
    assert any(abs(reading["measured"] - 100) < 5 for reading in readings)
    assert place.picture("fog", size=(48, 32)).rgb.shape == (32, 48, 3), "the place is there again"


def test_a_video_is_written(place, tmp_path):
    place.video(tmp_path / "rain.mp4", "heavy-rain", move="orbit", seconds=1, fps=2, size=(96, 64))
    assert (tmp_path / "rain.mp4").read_bytes()[4:8] == b"ftyp"


def test_photos_become_a_scene(program, tmp_path):
    photos = tmp_path / "photos"
    program("demo", "--photos", photos, "--count", "6", "--size", "96x64")
    events = []
    options = {"preset": "draft", "steps": 30, "device": "cpu"}
    scene = wm.reconstruct(photos, **options, callback=lambda event, facts: events.append((event, facts)))
    steps = [facts for event, facts in events if event == "step"]
    assert len(steps) == 30 and steps[-1]["splats"] > 100 and ("finish", {}) in events and len(scene) > 100

    def stop(event, facts):
        if event == "step":
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        wm.reconstruct(photos, **options, callback=stop)
    with pytest.raises(wm.Error, match="nowhere"):
        wm.reconstruct(tmp_path / "nowhere")


PLAN = """
frames = 2
frame_rate = 4
block = 2

[[scene]]
file = "street.ply"

[[weather]]
from = ["fog", "heavy-rain"]

[rig]
size = [48, 32]
"""


def test_a_set_is_made_block_for_block(street, program, tmp_path):
    (tmp_path / "street.ply").write_bytes(street.read_bytes())
    (tmp_path / "plan.toml").write_text(PLAN)
    batch = wm.Batch(tmp_path / "plan.toml", tmp_path / "set", device="cpu")
    assert (batch.clips, batch.frames) == (2, 4) and batch.missing() == list(range(batch.blocks))
    done = []
    for index in range(2):
        pickle.loads(pickle.dumps(batch)).make_shard(index, 2, progress=lambda *of: done.append(of))
    assert batch.missing() == [] and done and batch.marker(0)["plan"] == batch.digest
    assert batch.merge(verify=True)["frames"] == 4
    program("batch", tmp_path / "plan.toml", "-o", tmp_path / "other", "--device", "cpu")

    def files(of):
        return {path.relative_to(of): path.read_bytes() for path in of.rglob("*") if path.is_file()}

    assert files(tmp_path / "set") == files(tmp_path / "other")
    with pytest.raises(IndexError):
        batch.make(99)
    (tmp_path / "plan.toml").write_text(PLAN.replace("block = 2", "blok = 2"))
    with pytest.raises(wm.Error, match="plan.toml, line 4: .*blok"):
        wm.Batch(tmp_path / "plan.toml")


def test_help_shows_the_docstrings_of_the_stub():
    stub = ast.parse((pathlib.Path(wm.__file__).parent / "_native.pyi").read_text())
    checked = 0
    for node in stub.body:
        for inner in [node, *node.body] if isinstance(node, ast.ClassDef) else [node]:
            if not isinstance(inner, (ast.FunctionDef, ast.ClassDef)) or inner.name.startswith("__"):
                continue
            known = getattr(wm if inner is node else getattr(wm, node.name, None), inner.name, None)
            text = ast.get_docstring(inner)
            if known is None or text is None:
                continue
            shown = (inspect.getdoc(known) or "").split()
            assert text.split() == shown[: len(text.split())], inner.name
            checked += 1
    assert checked > 60


def test_the_stub_is_that_of_the_package():
    needed("mypy")
    words = [sys.executable, "-m", "mypy.stubtest", "weather_magician._native"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


# The training is run in test_dataset.py, with a plan.
@pytest.mark.parametrize("script", sorted(set(EXAMPLES.glob("*.py")) - {EXAMPLES / "train_on_weather.py"}), ids=lambda path: path.stem)
def test_examples_run(script, tmp_path):
    text = script.read_text()
    assert len(text.splitlines()) <= 70, "an example is short"
    done = subprocess.run([sys.executable, script, "--quick"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
