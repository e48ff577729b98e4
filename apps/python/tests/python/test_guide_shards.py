"""The scripts of the guide's pages on SLURM and Kubernetes run as they stand, with stand-ins for `sbatch` and `kubectl`."""

import importlib.util
import os
import re
import stat
import subprocess
import sys
from pathlib import Path
from typing import Callable

import pytest
from conftest import needed

HERE = Path(__file__).parent
ROOT = HERE.parents[3]
sys.path.insert(0, str(HERE))
from cluster_place import tree_hash, write_place  # noqa: E402

# Runs the tasks of a job one after the other, and jobs that depend on it if all of its tasks ended
# well.
SBATCH = r"""
import os, pathlib, re, subprocess, sys
script = pathlib.Path(sys.argv[-1])
words = [line.split(None, 1)[1].split(" #")[0].strip() for line in script.read_text().splitlines() if line.startswith("#SBATCH")]
options = dict(word.lstrip("-").partition("=")[::2] for word in words + sys.argv[1:-1])
jobs = pathlib.Path(".jobs")
jobs.mkdir(exist_ok=True)
id = len(list(jobs.iterdir())) + 1
if "dependency" in options:
    kind, _, other = options["dependency"].partition(":")
    assert kind == "afterok" and "kill-on-invalid-dep" in options
    if (jobs / other).read_text() != "0":
        sys.exit("DependencyNeverSatisfied")
first, last = map(int, options["array"].split("-")) if "array" in options else (0, 0)
worst = 0
for index in range(first, last + 1):
    own = {"SLURM_JOB_ID": str(id), "SLURM_CPUS_PER_TASK": options["cpus-per-task"]}
    if "array" in options:
        own |= {"SLURM_ARRAY_TASK_ID": str(index), "SLURM_ARRAY_TASK_COUNT": str(last + 1 - first)}
    with open(options["output"].replace("%a", str(index)), "w") as output:
        done = subprocess.run([script.resolve()], env=os.environ | own, stdout=output, stderr=subprocess.STDOUT)
    worst = max(worst, done.returncode)
(jobs / str(id)).write_text(str(worst))
print(id if "parsable" in options else f"Submitted batch job {id}")
"""

# A cluster whose volume is the folder DATA: `apply` runs the pods of a job, `wait` looks whether
# all ended well.
KUBECTL = r"""
import os, pathlib, shutil, subprocess, sys, yaml
data, jobs = os.environ["DATA"], pathlib.Path(".jobs")
jobs.mkdir(exist_ok=True)
verb, *rest = sys.argv[1:]
if verb == "apply":
    for own in yaml.safe_load_all(open(rest[1])):
        if own["kind"] != "Job":
            (jobs / f"{own['kind']}-{own['metadata']['name']}").write_text("0")
            continue
        pod = own["spec"]["template"]["spec"]
        (volume,), (container,) = pod["volumes"], pod["containers"]
        assert (jobs / f"PersistentVolumeClaim-{volume['persistentVolumeClaim']['claimName']}").exists()
        assert container["volumeMounts"] == [{"name": volume["name"], "mountPath": "/data"}] and pod["restartPolicy"] == "Never"
        words = [word.replace("/data", data) for word in container["command"] + container["args"]]
        is_indexed = own["spec"].get("completionMode") == "Indexed"
        worst = 0
        for index in range(own["spec"].get("completions", 1)):
            env = os.environ | ({"JOB_COMPLETION_INDEX": str(index)} if is_indexed else {})
            worst = max(worst, subprocess.run(words, env=env).returncode)
        (jobs / f"job-{own['metadata']['name']}").write_text(str(worst))
elif verb == "wait":
    sys.exit((jobs / rest[1].replace("pod/", "Pod-").replace("job/", "job-")).read_text() != "0")
elif verb == "cp":
    source, to = (word.replace("files:/data", data) for word in rest)
    shutil.copytree(source, to, dirs_exist_ok=True)
else:
    sys.exit(f"{verb}?")
"""


def put_program(path: Path) -> None:
    """Puts the program at a path: WM_PROGRAM, what Cargo built, or that of the package."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    places = [Path(os.environ["WM_PROGRAM"])] if "WM_PROGRAM" in os.environ else []
    places += [target / profile / "weather-magician" for profile in ("release", "debug")]
    for place in places:
        if place.exists():
            path.symlink_to(place.resolve())
            return
    if not (importlib.util.find_spec("weather_magician") and importlib.util.find_spec("weather_magician.__main__")):
        assert os.environ.get("WM_REQUIRE_PYTHON") != "1", "no program: set WM_PROGRAM, or `cargo build`"
        pytest.skip("no program: set WM_PROGRAM, or `cargo build`")
    path.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m weather_magician "$@"\n')
    path.chmod(0o755)


def blocks_of(page: str) -> tuple[dict[str, str], str]:
    """Returns the files of a page by their names, and the commands at its end."""
    text = (ROOT / "docs/guide" / page).read_text(encoding="utf-8")
    files = dict(re.findall(r"^`([\w.]+)`[^`]*?:\n\n```\w+\n(.*?)^```", text, re.MULTILINE | re.DOTALL))
    bash = re.findall(r"^```bash\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    return files, bash[-1]


def run_page(page: str, tmp_path: Path, stand_in: tuple[str, str], place: str) -> Callable[[], str]:
    """Does what a page says, with the plan in a folder `place` of an empty folder, and compares the set with that of one process.

    Returns a function that gives the commands once more, and their output.
    """
    work, tools = tmp_path / "work", tmp_path / "tools"
    work.mkdir()
    tools.mkdir()
    plan = write_place(work / place) if place else write_place(tmp_path / "place")
    if not place:
        for own in plan.parent.iterdir():
            own.rename(work / own.name)
        plan = work / "plan.toml"
    put_program(tools / "weather-magician")
    subprocess.run([tools / "weather-magician", "batch", plan, "--out", tmp_path / "alone", "--device", "cpu"], check=True, capture_output=True)
    name, code = stand_in
    (tools / name).write_text(f"#!{sys.executable}\n{code}")
    (tools / name).chmod(0o755)
    files, commands = blocks_of(page)
    assert files and commands
    for name, text in files.items():
        (work / name).write_text(text)
        (work / name).chmod(stat.S_IRWXU)
    env = os.environ | {"PATH": f"{tools}{os.pathsep}{os.environ['PATH']}", "DATA": str(tmp_path / "volume")}

    def run() -> str:
        done = subprocess.run(["bash", "-e", "-c", commands], cwd=work, env=env, capture_output=True, text=True)
        return f"{done.returncode} {done.stdout}{done.stderr}"

    said = run()
    assert said.startswith("0 "), said
    assert tree_hash(work / "set") == tree_hash(tmp_path / "alone")
    return run


def test_slurm(tmp_path):
    again = run_page("slurm.md", tmp_path, ("sbatch", SBATCH), "")
    work = tmp_path / "work"
    # A scene that is gone: a task fails, and no merge comes after it.
    (work / "set/done/000011.json").unlink()
    (work / "set/manifest.json").unlink()
    scene = work / "scenes/yard.ply"
    scene.rename(work / "yard.ply")
    assert again().startswith("1 DependencyNeverSatisfied")
    assert "error: " in (work / "make-15.log").read_text() and "yard.ply" in (work / "make-15.log").read_text()
    # The same lines go on from there.
    (work / "yard.ply").rename(scene)
    assert again().startswith("0 ")
    assert tree_hash(work / "set") == tree_hash(tmp_path / "alone")


def test_kubernetes(tmp_path):
    needed("yaml")
    files, _ = blocks_of("kubernetes.md")
    shards = {int(files["make.yaml"].split("completions: ")[1].split()[0]), int(files["make.yaml"].split("INDEX/")[1].split('"')[0])}
    assert len(shards) == 1, "as many completions as shards"
    run_page("kubernetes.md", tmp_path, ("kubectl", KUBECTL), "place")
