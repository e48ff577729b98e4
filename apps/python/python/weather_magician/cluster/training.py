"""A training in blocks (`reconstruct --blocks`) on the nodes of a cluster, which share the folders of photos and scene."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from typing import Callable, Sequence

from .progress import Progress
from .runner import ClusterError, Outcome, Resources, Task, run_tasks

# Seconds between two looks at the program.
LOOK = 0.5
# Seconds that the program has to save what it learnt.
GRACE = 60.0


@dataclass(frozen=True)
class ProgramWork:
    """Runs the program on a node. Called with the arguments of a task; returns nothing.

    A program that is killed is an OSError, which is tried again: a block goes on from its checkpoint. Its own errors are RuntimeErrors.
    """

    command: tuple[str, ...]

    def __call__(self, arguments: list[str], report: Callable[[int], None]) -> None:
        with tempfile.TemporaryFile() as said:
            program = subprocess.Popen([*self.command, *arguments], stdin=subprocess.DEVNULL, stdout=said, stderr=said)
            try:
                while program.poll() is None:
                    time.sleep(LOOK)
                    report(0)
            except BaseException:
                program.send_signal(signal.SIGINT)
                try:
                    program.wait(GRACE)
                except subprocess.TimeoutExpired:
                    program.kill()
                    program.wait()
                raise
            said.seek(0)
            lines = said.read().decode("utf-8", "replace").strip().splitlines()
        line = lines[-1] if lines else "no word of it"
        if program.returncode < 0:
            raise OSError(f"the program was ended by signal {-program.returncode}: {line}")
        if program.returncode > 0:
            raise RuntimeError(line.removeprefix("error: "))


def run_blocks(
    dataset: str | os.PathLike,
    out: str | os.PathLike,
    *,
    blocks: int | str = "auto",
    options: Sequence[str] = (),
    resources: Resources = Resources(),
    retries: int = 5,
    progress: Progress | None = None,
    command: Sequence[str] = (sys.executable, "-m", "weather_magician"),
) -> Outcome:
    """Reconstructs a scene in blocks, each on some node of the cluster that `connect` has connected to.

    dataset, out: as for `reconstruct`, in folders that all nodes see under the same paths. blocks: their number, or `auto`. options: further
    options of `reconstruct`, such as `["--preset", "best"]`; the run folder is OUT.run. command: the program on the nodes.

    The plan and the join run here. Blocks that are trained already are kept; a block whose process or node dies goes on from its checkpoint.
    Raises ClusterError if a block fails.
    """
    dataset, out = os.path.abspath(dataset), os.path.abspath(out)
    common = ["reconstruct", dataset, "--out", out, "--run-folder", f"{out}.run", *options, "--blocks", str(blocks)]
    _here(command, [*common, "--block", "plan"])
    with open(f"{out}.run/blocks.json", encoding="utf-8") as file:
        count = len(json.load(file)["blocks"])
    once = [option for option in common if option != "--overwrite"]
    tasks = (Task(f"block {block}", [*once, "--block", str(block)]) for block in range(count))
    work = ProgramWork(tuple(command))
    outcome = run_tasks(tasks, work, resources=resources, retries=retries, steps=count, progress=progress)
    if outcome.failures:
        first = outcome.failures[0]
        raise ClusterError(f"{first.task} on {first.node}: {first.line}")
    _here(command, [*common, "--block", "join"])
    return outcome


def _here(command: Sequence[str], arguments: list[str]) -> None:
    done = subprocess.run([*command, *arguments], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        raise ClusterError((lines[-1] if lines else f"the program ended with {done.returncode}").removeprefix("error: "))
