"""Sets on many machines: a cluster of two nodes in this machine, that lose processes and one node."""

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from conftest import needed

HERE = Path(__file__).parent
fsspec, ray = needed("fsspec"), needed("ray")
from ray.cluster_utils import Cluster  # noqa: E402

import weather_magician  # noqa: E402

sys.path.insert(0, str(HERE))
from cluster_place import Misbehaving, tree_hash, write_place  # noqa: E402

from weather_magician.cluster import ClusterError, Progress, Resources, Standing, Task, run_blocks, run_plan, run_tasks  # noqa: E402
from weather_magician.cluster import shards as cut  # noqa: E402
from weather_magician.cluster.__main__ import main  # noqa: E402
from weather_magician.cluster.cache import NodeCache  # noqa: E402
from weather_magician.cluster.inputs import inputs_of  # noqa: E402
from weather_magician.cluster.store import SetStore, marker_name  # noqa: E402
from weather_magician.cluster.work import _retried  # noqa: E402

STORE = 80 << 20


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return write_place(tmp_path_factory.mktemp("place"))


@pytest.fixture(scope="module")
def alone(place, tmp_path_factory):
    """The set as one process makes it."""
    out = tmp_path_factory.mktemp("alone") / "set"
    batch = weather_magician.Batch(str(place), str(out), device="cpu")
    for block in batch.missing():
        batch.make(block)
    batch.merge()
    return out


@pytest.fixture(scope="module")
def cluster():
    """Two nodes of one CPU each."""
    paths = [str(HERE), *filter(None, [os.environ.get("PYTHONPATH")])]
    os.environ["PYTHONPATH"] = os.pathsep.join(paths)
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    # Nodes that are gone are missed sooner than by default.
    checks = {"health_check_period_ms": 500, "health_check_failure_threshold": 6}
    head = {"num_cpus": 1, "object_store_memory": STORE, "_system_config": checks}
    made = Cluster(initialize_head=True, head_node_args=head)
    made.second = made.add_node(num_cpus=1, object_store_memory=STORE)
    ray.init(address=made.address, log_to_driver=False, logging_level="ERROR")
    yield made
    ray.shutdown()
    made.shutdown()


def test_blocks_are_cut_by_their_pace_and_end_together():
    pace, scenes = cut.Pace(), {block: ("a" if block < 30 else "b", 10) for block in range(60)}
    parts, got = cut.by_pace(range(60), scenes.get, pace, lambda: 2), []
    for part in parts:
        # Ten frames take 15 s, so a shard of 90 s has six blocks.
        pace.tell(10 * len(part), 15.0 * len(part))
        got.append(part)
    assert [block for part in got for block in part] == list(range(60))
    assert [len(part) for part in got[:3]] == [1, 6, 6] and max(map(len, got)) == 6
    assert all(len({scenes[block][0] for block in part}) == 1 for part in got)
    assert [len(part) for part in got[-3:]] == [1, 1, 1]
    assert list(cut.by_count([1, 2, 9], [range(0, 4), range(4, 8), range(8, 12)])) == [[1, 2], [9]]


def test_progress_is_one_line_on_a_terminal_and_lines_elsewhere():
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    now = [0.0]
    for out in (Terminal(), io.StringIO()):
        now[0] = 0.0
        progress = Progress("frames", "shards", out, lambda: now[0])
        for second in range(30):
            now[0] = float(second)
            progress.show(Standing(4 * second, 400, second // 10, 2, second // 20, 0))
        progress.end()
        lines = out.getvalue().replace("\r", "\n").strip().splitlines()
        assert lines[-1].strip() == "116/400 frames, 4.00/s, 1 min 11 s left, 2 shards, 2 nodes, 1 retry"
        assert len(lines) == (30 if out.isatty() else 4)


def test_inputs_are_the_files_that_a_plan_names(tmp_path):
    plan = write_place(tmp_path / "plans")
    scenes = tmp_path / "plans/scenes"
    (scenes / "yard.ply.cameras.json").write_text("[]")
    (scenes / "yard.ply.assets").mkdir()
    (scenes / "yard.ply.assets/cover.wmasset").write_text("large")
    (scenes / "other.ply").write_text("")
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared/rig.toml").write_text('[[sensor]]\nlens = "lens.toml"\nmodel = "/etc/hosts"\n')
    (tmp_path / "shared/lens.toml").write_text("")
    plan.write_text(plan.read_text().replace("size = [48, 32]", 'file = "../shared/rig.toml"'))
    inputs = inputs_of(plan)
    assert inputs.plan == "plans/plan.toml"
    assert [file.name for file in inputs.files] == [
        "plans/mist.toml",
        "plans/plan.toml",
        "plans/scenes/yard.ply",
        "plans/scenes/yard.ply.cameras.json",
        "shared/lens.toml",
        "shared/rig.toml",
    ]
    # By way of a store they come to the same names on a node, each fetched once by however many
    # workers.
    store, cache, fetched = SetStore("memory://inputs/set"), NodeCache(tmp_path / "cache"), []
    digest = store.put_inputs(inputs)
    fetch = store.fetch
    store.fetch = lambda name, to: (fetched.append(name), time.sleep(0.05), fetch(name, to))
    found = []
    workers = [threading.Thread(target=lambda: found.append(store.plan_on(cache, digest))) for _ in range(4)]
    [worker.start() for worker in workers]
    [worker.join() for worker in workers]
    # The lens and the cameras differ, so seven fetches: six files and their list.
    assert len(fetched) == len(set(fetched)) == 7
    assert set(found) == {tmp_path / "cache/inputs" / digest / "plans/plan.toml"}
    assert found[0].read_bytes() == plan.read_bytes()


def test_scratch_of_processes_that_are_gone_is_removed(tmp_path):
    cache = NodeCache(tmp_path)
    mine = cache.scratch()
    left = tmp_path / "scratch/1.left"
    left.mkdir()
    (left / "block.png").write_text("")
    other = cache.scratch()
    assert mine.path.exists() and other.path.exists() and not left.exists()


def test_a_store_has_whole_blocks_only(tmp_path, alone, place):
    plan = json.loads((alone / marker_name(0)).read_bytes())["plan"]
    store, moved = SetStore("memory://whole/set"), []
    made = tmp_path / "made"
    shutil.copytree(alone, made)
    store.put_block(made, 0)
    store.put_block(made, 1)
    assert [block for block, _, _ in store.markers(12, plan)] == [0, 1]
    # Files lie in the store before the marker is there, and are gone from the node after.
    write, put = store.write, store.put
    store.write = lambda name, data: (moved.append(name), write(name, data))
    store.put = lambda folder, names: (moved.extend(names), put(folder, names))
    store.put_block(made, 2)
    assert len(moved) > 1 and moved.index(marker_name(2)) == len(moved) - 1 and not (made / marker_name(2)).exists()
    store.fs.rm(store.path(marker_name(2)))
    # A file that is not whole, a marker that is not whole: made again.
    marker = store.marker(1, plan)
    store.fs.pipe_file(store.path(marker["files"][0]["path"]), b"")
    store.fs.pipe_file(store.path(marker_name(3)), (alone / marker_name(3)).read_bytes()[:100])
    assert [block for block, _, _ in store.markers(12, plan)] == [0] and store.marker(3, plan) is None
    with pytest.raises(ClusterError, match="is of another plan; give another store"):
        list(store.markers(12, "0" * 64))


def test_a_store_that_fails_is_tried_again_and_one_of_a_process_is_refused(place):
    store = SetStore("memory://fails/set")

    def fail(path):
        raise ValueError("the store\nslept")

    store.fs = type("Fs", (), {"cat_file": staticmethod(fail)})
    with pytest.raises(OSError, match="memory://fails/set/done/000001.json: the store slept"):
        store.marker(1, "")
    with pytest.raises(ClusterError, match="is the memory of one process"):
        run_plan(place, "memory://set")
    with pytest.raises(ClusterError, match="nosuch"):
        run_plan(place, "nosuch://set")


def test_errors_of_disks_are_tried_again_and_others_are_not():
    assert isinstance(_retried(weather_magician.Error("set/done: No space left on device (os error 28)")), OSError)
    for text in ("scene.ply: No such file or directory (os error 2)", "plan.toml, line 3: unknown key"):
        assert not isinstance(_retried(weather_magician.Error(text)), OSError)


def count_letters(text, report):
    report(1)
    if text == "wrong":
        raise KeyError("what")
    return len(text)


def note_times(number, report):
    begun = time.monotonic()
    for step in range(200):
        report(step)
        time.sleep(0.005)
    return begun, time.monotonic()


def test_tasks_that_report_hold_their_slots(cluster):
    outcome = run_tasks([Task(f"{number}", number) for number in range(6)], note_times)
    spans = [span for _, span in outcome.results]
    together = max(sum(begun <= other < end for begun, end in spans) for other, _ in spans)
    assert outcome.slots == 2 and together == 2, spans


def test_tasks_of_any_kind_run_and_their_faults_are_told_in_a_line(cluster):
    tasks = [Task(f"word {text}", text) for text in ("a", "to", "wrong", "long")]
    outcome = run_tasks(tasks, count_letters, resources=Resources(cpus=1))
    assert sorted((task.data, result) for task, result in outcome.results) == [("a", 1), ("long", 4), ("to", 2)]
    (failure,) = outcome.failures
    assert (failure.task, failure.line) == ("word wrong", "KeyError: 'what'") and "(" in failure.node
    # A task that is asked for late is not begun after too many failures.
    outcome = run_tasks((Task("w", "wrong") for _ in range(100)), count_letters, most_failures=3)
    assert outcome.not_begun and 3 <= len(outcome.failures) <= 7


# Stands for the program: writes a plan of three blocks, trains them and joins them; block 1 is
# killed the first time.
TRAINING = """
import json, os, pathlib, signal, sys
run, step = pathlib.Path(sys.argv[sys.argv.index("--run-folder") + 1]), sys.argv[-1]
if step == "plan":
    run.mkdir(exist_ok=True)
    (run / "blocks.json").write_text(json.dumps({"blocks": [{}, {}, {}]}))
elif step == "join":
    out = pathlib.Path(sys.argv[sys.argv.index("--out") + 1])
    out.write_text(" ".join((run / f"block-{block}").read_text() for block in range(3)))
elif "--wrong" in sys.argv:
    print("error: no photo is left", file=sys.stderr)
    sys.exit(1)
elif step == "1" and not (run / "killed").exists():
    (run / "killed").touch()
    os.kill(os.getpid(), signal.SIGKILL)
else:
    assert "--overwrite" not in sys.argv
    (run / f"block-{step}").write_text(step)
"""


def test_blocks_of_a_training_are_joined_after_a_kill(cluster, tmp_path):
    program = [sys.executable, "-c", TRAINING]
    out = tmp_path / "place.ply"
    outcome = run_blocks(tmp_path / "photos", out, blocks=3, options=["--overwrite"], command=program)
    assert out.read_text() == "0 1 2" and outcome.retries == 1 and len(outcome.results) == 3
    with pytest.raises(ClusterError, match="block . on .*: .*no photo is left"):
        run_blocks(tmp_path / "photos", out, options=["--wrong"], command=program)


def test_a_set_in_a_store_is_made_moved_verified_and_kept(cluster, place, alone, tmp_path, capfd):
    out = tmp_path / "bucket/set"
    url, cache = f"file://{out}", tmp_path / "cache"
    (tmp_path / "attempts").mkdir()
    batch = Misbehaving(str(tmp_path / "attempts"), at=5, how="disk")
    report = run_plan(place, url, shards=4, cache=cache, merge=False, batch=batch)
    assert (report.made, report.kept, report.failures, report.merged) == (12, 0, [], None)
    assert report.outcome.retries == 1 and not (out / "manifest.json").exists()
    assert {path.name: path.stat().st_size for path in (tmp_path / "attempts").iterdir()}["5"] == 2
    # A block that was moved by half, and one whose file is gone.
    marker = json.loads((out / marker_name(7)).read_bytes())
    (out / marker_name(7)).unlink()
    (out / marker["files"][0]["path"]).write_bytes(b"half")
    (out / json.loads((out / marker_name(2)).read_bytes())["files"][0]["path"]).unlink()
    assert main([str(place), "--out", url, "--cache", str(cache), "--verify"]) == 0
    said = capfd.readouterr().out
    assert "2 of 12 blocks made, 10 kept, 4 frames" in said and "6 clips, 24 frames, 24 readings" in said
    assert tree_hash(out) == tree_hash(alone)
    # A second run makes nothing.
    assert main([str(place), "--out", url, "--cache", str(cache)]) == 0
    assert "12 of 12 blocks done already" in capfd.readouterr().out
    assert tree_hash(out) == tree_hash(alone)
    assert not any((cache / "files").glob(".*"))
    # Same length, other bytes.
    file = out / marker["files"][0]["path"]
    file.write_bytes(bytes(file.stat().st_size))
    assert main([str(place), "--out", url, "--cache", str(cache), "--verify"]) == 1
    assert "1 files are not as they were made" in capfd.readouterr().err


def test_failures_are_listed_with_shard_and_node(cluster, place, tmp_path):
    (tmp_path / "attempts").mkdir()
    batch = Misbehaving(str(tmp_path / "attempts"), at=4, how="always")
    report = run_plan(place, tmp_path / "set", shards=12, batch=batch)
    (failure,) = report.failures
    assert (failure.task, failure.line) == ("blocks 4", "ValueError: block 4 is bewitched") and failure.node.endswith(")")
    assert report.made == 11 and report.merged is None
    # The rest of it by the command's words.
    report = run_plan(place, tmp_path / "set")
    assert (report.made, report.kept, report.merged["frames"]) == (1, 11, 24)


def test_ctrl_c_leaves_whole_blocks(cluster, place, alone, tmp_path):
    out, attempts = tmp_path / "set", tmp_path / "attempts"
    attempts.mkdir()
    code = (
        "import sys; from cluster_place import Misbehaving; from weather_magician.cluster import connect, run_plan; "
        f"run_plan({str(place)!r}, {str(out)!r}, address={cluster.address!r}, shards=2, batch=Misbehaving({str(attempts)!r}, seconds=0.8))"
    )
    driver = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + 60
    while not any((out / "done").glob("*.json")) and driver.poll() is None and time.monotonic() < end:
        time.sleep(0.05)
    driver.send_signal(signal.SIGINT)
    said = driver.communicate(timeout=60)[1]
    assert "KeyboardInterrupt" in said
    time.sleep(0.5)
    batch = weather_magician.Batch(str(place), str(out), device="cpu")
    missing = batch.missing()
    assert 0 < len(missing) < 12
    attempted = len(list(attempts.iterdir()))
    time.sleep(1.0)
    assert len(list(attempts.iterdir())) == attempted, "tasks run on after Ctrl-C"
    for block in missing:
        batch.make(block)
    batch.merge(verify=True)
    assert tree_hash(out) == tree_hash(alone)


def test_killed_workers_and_a_node_that_goes_cost_nothing_but_time(cluster, place, alone, tmp_path):
    (tmp_path / "attempts").mkdir()
    batch = Misbehaving(str(tmp_path / "attempts"), at=3, how="kill", seconds=0.2)

    class Removing(Progress):
        """Removes a node once half of the shards are there."""

        def show(self, standing):
            super().show(standing)
            if standing.tasks >= 6 and cluster.second:
                node, cluster.second = cluster.second, None
                cluster.remove_node(node, allow_graceful=False)

    out = io.StringIO()
    report = run_plan(place, tmp_path / "set", shards=12, progress=Removing("frames", "shards", out), batch=batch)
    assert cluster.second is None and len(ray.nodes()) == 2
    assert (report.kept, report.failures, report.frames) == (0, [], 24)
    assert report.outcome.retries >= 1 and {task.name for task, _ in report.outcome.results} == {f"blocks {n}" for n in range(12)}
    # A third time if it was on the node that went.
    assert (tmp_path / "attempts/3").stat().st_size >= 2
    assert tree_hash(tmp_path / "set") == tree_hash(alone)
