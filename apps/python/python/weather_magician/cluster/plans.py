"""Makes the data set of a plan on a cluster."""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Callable, Iterator

from . import shards as cut
from .inputs import inputs_of
from .progress import Progress
from .runner import ClusterError, Failure, Outcome, Resources, Task, connect, nodes_alive, run_tasks, stop
from .store import DONE, OF_ONE_PROCESS, WORK, SetStore, is_url, marker_name
from .work import BlockWork, RemoteSet, VerifyWork

# Most CPUs of a task if nothing is said: threads of one frame wait for each other, and processes do
# not.
MOST_CPUS = 4
# Seconds until a file that another node wrote into a shared folder is seen here: NFS keeps what it
# knows for a minute.
SEEN = 70.0
# Blocks of a task that compares hashes.
VERIFIED = 20


@dataclass
class SetReport:
    """What a run did.

    out: the set. blocks: blocks of the plan; made: those that this run made; kept: those that were done before. failures: shards that
    failed after their retries. merged: clips, frames, readings and bytes of the set; None if it was not merged. outcome: what the runner
    says: retries, times and slots.
    """

    out: str
    blocks: int
    made: int
    kept: int
    frames: int
    failures: list[Failure]
    merged: dict | None
    warnings: list[str]
    outcome: Outcome = field(repr=False)


def run_plan(
    plan: str | os.PathLike,
    out: str | os.PathLike | None = None,
    *,
    address: str = "auto",
    shards: int | None = None,
    cpus: int | None = None,
    gpus: float | None = None,
    memory: int | None = None,
    device: str = "cpu",
    retries: int = 5,
    verify: bool = False,
    merge: bool = True,
    cache: str | os.PathLike | None = None,
    storage_options: dict[str, Any] | None = None,
    progress: Progress | None = None,
    batch: Callable | None = None,
) -> SetReport:
    """Makes the data set of a plan on a Ray cluster; the bytes are those of `weather-magician batch plan.toml`.

    plan: the plan's TOML file. out: a folder that all nodes share (default: named after the plan, in this folder), or the URL of a store
    that fsspec knows. address: `auto`, `local` or HOST:PORT. shards: parts of the work (default: as many as take some 90 s each). cpus,
    gpus, memory (bytes): what a shard holds of a node; cpus are its threads too. device: as the program's --device. retries: how often a
    shard is begun again whose process, node or disk failed. verify: compare the hashes of all files at the end. merge: write tables,
    manifest and summary. cache: the folder of each node for what it fetches from a store. storage_options: further arguments of fsspec's
    file system. batch: a class in the place of `weather_magician.Batch`.

    Blocks that are done are kept. Shards that fail are in the report, and then the set is not merged. Raises ClusterError for what no
    retry can mend, and KeyboardInterrupt: only whole blocks are in the set then, and the next run goes on from there.
    """
    progress = progress or Progress("frames", "shards")
    plan = os.path.abspath(plan)
    if out is not None and os.fspath(out).partition("://")[0].lower() in OF_ONE_PROCESS:
        raise ClusterError(f"--out {out}: is the memory of one process, and each task has its own; give a folder or a store")
    batch = batch or _native_batch()
    is_remote = out is not None and is_url(os.fspath(out))
    place = _Remote(plan, os.fspath(out), storage_options, cache, batch) if is_remote else _Folder(plan, out, batch)
    missing = place.missing()
    blocks = place.batch.blocks
    outcome = Outcome()
    connected = False
    try:
        if missing or (verify and place.verifies):
            connected = connect(address, say=progress.say)
            cpus = cpus or _cpus()
            gpus = (1.0 if device.startswith("gpu") else 0.0) if gpus is None else gpus
            resources = Resources(cpus, gpus, memory)
        if missing:
            work = place.work(device, cpus)
            outcome = _make(place, work, missing, resources, shards, retries, progress)
        made = sum(len(task.data) for task, _ in outcome.results)
        warnings = list(dict.fromkeys(text for _, result in outcome.results for text in result["warnings"]))
        merged = None
        if merge and not outcome.failures:
            if verify and place.verifies:
                _verify(place, resources, retries, progress)
            merged = place.merge(verify)
            warnings.extend(merged["warnings"])
    finally:
        stop(connected)
    frames = sum(task.steps for task, _ in outcome.results)
    kept = blocks - len(missing)
    return SetReport(place.out, blocks, made, kept, frames, outcome.failures, merged, warnings, outcome)


def _native_batch() -> Callable:
    try:
        from weather_magician import Batch
    except ImportError as error:
        raise ClusterError(f"weather_magician.Batch is not there ({error}): install the package with `pip install .`") from None
    return Batch


def _cpus() -> int:
    """CPUs of a shard if nothing is said: up to 4, so many that least CPUs of the nodes are idle."""
    nodes = [int(node["Resources"].get("CPU", 0)) for node in nodes_alive().values()]
    used = lambda cpus: sum(own // cpus * cpus for own in nodes)
    return max(range(MOST_CPUS, 0, -1), key=used)


def _make(place, work, missing, resources, count, retries, progress) -> Outcome:
    blocks, pace = place.batch, cut.Pace()

    def about(block: int) -> tuple[str, int]:
        found = blocks.block(block)
        first, end = found["frames"]
        return found["scene"], end - first

    if count:
        parts = cut.by_count(missing, [blocks.shard(index, count) for index in range(count)])
    else:
        slots = lambda: sum(resources.slots(node["Resources"]) for node in nodes_alive().values())
        parts = cut.by_pace(missing, about, pace, slots)

    def tasks() -> Iterator[Task]:
        for own in parts:
            yield Task(f"blocks {_runs(own)}", own, sum(about(block)[1] for block in own))

    def on_result(task: Task, result: dict, seconds: float) -> None:
        pace.tell(task.steps, seconds)
        place.check(task.data, result["node"])

    steps = sum(about(block)[1] for block in missing)
    return run_tasks(
        tasks(), work, resources=resources, retries=retries, steps=steps, progress=progress, on_result=on_result
    )


def _verify(place, resources, retries, progress) -> None:
    """Compares the hashes of all files in a store, on all nodes."""
    blocks = range(place.batch.blocks)
    parts = [list(blocks[at : at + VERIFIED]) for at in range(0, len(blocks), VERIFIED)]
    tasks = (Task(f"hashes of blocks {_runs(own)}", own, len(own)) for own in parts)
    counted = Progress("blocks compared", "tasks", progress.out)
    outcome = run_tasks(
        tasks, place.verifying(), resources=Resources(1), retries=retries, steps=len(blocks), progress=counted
    )
    if outcome.failures:
        first = outcome.failures[0]
        raise ClusterError(f"{first.task}: {first.line}")
    wrong = [file for _, result in outcome.results for file in result]
    if wrong:
        raise ClusterError(
            f"{place.out}: {len(wrong)} files are not as they were made, the first {wrong[0]}; remove the markers of their blocks in done/ "
            "and run the plan again"
        )


class _Folder:
    """A set in a folder that all nodes share: blocks are made in it, as by the program."""

    verifies = False

    def __init__(self, plan: str, out: str | os.PathLike | None, batch: Callable) -> None:
        self.factory, self.batch = batch, batch(plan, None if out is None else os.fspath(out), device="cpu")
        self.plan, self.out = plan, os.path.abspath(self.batch.out)

    def missing(self) -> list[int]:
        os.makedirs(os.path.join(self.out, DONE), exist_ok=True)
        return self.batch.missing()

    def work(self, device: str, threads: int) -> BlockWork:
        return BlockWork(self.plan, self.out, self.batch.digest, device, threads, self.factory)

    def check(self, blocks: list[int], node: str) -> None:
        """Looks for the markers here: a folder of the same name on another machine is no shared folder."""
        end = time.monotonic() + SEEN
        for block in blocks:
            path = os.path.join(self.out, marker_name(block))
            while not os.path.exists(path):
                if time.monotonic() > end:
                    raise ClusterError(
                        f"{path}: node {node} has made block {block}, and it is not here: --out must be a folder that all nodes "
                        "share, or a store such as s3://bucket/set"
                    )
                time.sleep(0.5)
                os.listdir(os.path.join(self.out, DONE))

    def merge(self, verify: bool) -> dict:
        return self.batch.merge(verify=verify)


class _Remote:
    """A set in a store: nodes fetch what the plan reads, make blocks on their disks, and move them."""

    verifies = True

    def __init__(self, plan: str, out: str, options: dict | None, cache: str | os.PathLike | None, batch: Callable) -> None:
        self.plan, self.out, self.options = plan, out.rstrip("/"), options
        self.cache = None if cache is None else os.path.abspath(cache)
        self.factory, self.batch = batch, batch(plan, None, device="cpu")
        self.store = SetStore(out, options)

    def missing(self) -> list[int]:
        done = {block for block, _, _ in self.store.markers(self.batch.blocks, self.batch.digest)}
        missing = [block for block in range(self.batch.blocks) if block not in done]
        # Nodes go by the marker alone.
        self.store.unmark(missing)
        return missing

    def work(self, device: str, threads: int) -> BlockWork:
        inputs = self.store.put_inputs(inputs_of(self.plan))
        remote = RemoteSet(self.out, inputs, self.options, self.cache)
        return BlockWork(self.plan, None, self.batch.digest, device, threads, self.factory, remote)

    def check(self, blocks: list[int], node: str) -> None:
        return

    def verifying(self) -> VerifyWork:
        return VerifyWork(self.out, self.options, self.batch.digest)

    def merge(self, verify: bool) -> dict:
        """Writes the tables of all layouts from the markers, and copies them to the store, the manifest last.

        Tables follow from markers alone. What else a merge asks is whether every file is there with its length: the store has told that, and
        files of these lengths without contents stand in for them, so nothing is fetched but markers.
        """
        own, stands = set(), set()
        with tempfile.TemporaryDirectory(prefix="weather-magician-merge-") as folder:
            for block, marker, text in self.store.markers(self.batch.blocks, self.batch.digest):
                own.add(marker_name(block))
                _write(Path(folder, marker_name(block)), text)
                for file in marker["files"]:
                    stands.add(file["path"])
                    _stand_in(Path(folder, file["path"]), file["bytes"])
            merged = self.factory(self.plan, folder, device="cpu").merge(verify=False)
            paths = (path.relative_to(folder).as_posix() for path in Path(folder).rglob("*") if path.is_file())
            made = sorted(name for name in paths if name not in own and name not in stands and not name.startswith(f"{WORK}/"))
            made.sort(key=lambda name: name == "manifest.json")
            self.store.put(Path(folder), made[:-1])
            self.store.put(Path(folder), made[-1:])
        self.store.remove(WORK)
        return merged


def _write(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def _stand_in(path: Path, size: int) -> None:
    """Makes a file of a length that holds nothing, and takes no room where the disk knows sparse files."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "wb") as file:
        file.truncate(size)


def _runs(numbers: list[int]) -> str:
    """Returns numbers as runs: `0-3, 7`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and runs[-1][1] + 1 == number:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return ", ".join(f"{first}" if first == last else f"{first}-{last}" for first, last in runs)
