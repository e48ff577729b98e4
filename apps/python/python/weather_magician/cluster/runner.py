"""Runs tasks on the nodes of a Ray cluster. Knows nothing of what the tasks do.

A task is a name, a small piece of data and a number of steps. Nothing large goes through Ray: data and results are small enough to travel
with their messages, and files go by a shared folder or a store. So no node needs room for Ray's object store.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from dataclasses import dataclass, field
from typing import Any, Callable, Iterable

import ray
from ray.exceptions import (
    NodeDiedError,
    OutOfMemoryError,
    RayError,
    RayTaskError,
    WorkerCrashedError,
)
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from .progress import Progress, Standing

# Least object store that Ray takes, bytes: nothing is put there.
LEAST_STORE = 80 << 20
# Seconds between two looks at what the tasks say.
LOOK = 0.5
# Seconds between two counts of the nodes.
COUNT = 2.0
# Seconds that tasks have to stop by themselves, each at its next step: then what they left is gone,
# or whole.
GRACE = 30.0


class ClusterError(Exception):
    """A problem in one line: what, where, and what to do."""


@dataclass(frozen=True)
class Task:
    """A piece of work.

    name: what messages call it. data: what the work is told; it is pickled, a few KiB at most. steps: how many steps it has, for the
    progress.
    """

    name: str
    data: Any
    steps: int = 1


@dataclass(frozen=True)
class Resources:
    """What a task holds of a node while it runs: CPUs, GPUs, and memory in bytes (None: not counted)."""

    cpus: float = 1
    gpus: float = 0
    memory: int | None = None

    def slots(self, node: dict[str, float]) -> int:
        """Returns how many tasks a node with these resources runs at a time."""
        wanted = {"CPU": self.cpus, "GPU": self.gpus, "memory": self.memory or 0}
        counts = [int(node.get(name, 0) / amount + 1e-9) for name, amount in wanted.items() if amount > 0]
        return min(counts, default=1)


@dataclass(frozen=True)
class Failure:
    """A task that failed after its retries: its name, the node of its last attempt, and the error in one line."""

    task: str
    node: str
    line: str


@dataclass
class Outcome:
    """What became of the tasks.

    results: tasks and what they returned, in the order in which they ended. not_begun: True if tasks were left out since too many had
    failed. work_seconds: wall time inside the tasks that succeeded, and cpu_seconds the CPU time of their processes. seconds: wall time
    of all. slots: the most tasks that ran at a time.
    """

    results: list[tuple[Task, Any]] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    not_begun: bool = False
    retries: int = 0
    work_seconds: float = 0.0
    cpu_seconds: float = 0.0
    seconds: float = 0.0
    slots: int = 0


class TaskFault(Exception):
    """An error of a task that another attempt would meet again, as one line; its attribute `node` is the node's id."""


class PassingFault(OSError):
    """An error of a task that another attempt may not meet, as one line; its attribute `node` is the node's id."""


class Stopped(Exception):
    """Raised by a task's report if the driver was stopped."""


def connect(address: str = "auto", *, say: Callable[[str], None] = lambda text: None) -> bool:
    """Connects to a Ray cluster; returns True if this call did, so that the caller disconnects.

    address: `auto` for the cluster that this machine is a node of, or else Ray on this machine alone; `local` for this machine alone;
    or HOST:PORT of a cluster's head.
    """
    if ray.is_initialized():
        return False
    if address.startswith("ray://"):
        raise ClusterError(
            f"--address {address}: start this on a node of the cluster (`ray job submit`): from outside, paths are those of another machine"
        )
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    common: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    if address != "local":
        try:
            ray.init(address=address, **common)
            return True
        except (ConnectionError, RuntimeError, ValueError) as error:
            if address != "auto":
                raise ClusterError(f"--address {address}: {line_of(error)}; `ray status` there says whether it runs") from None
        say("no Ray cluster was found: Ray is started on this machine alone")
    ray.init(address="local", include_dashboard=False, object_store_memory=LEAST_STORE, **common)
    return True


def nodes_alive() -> dict[str, dict[str, Any]]:
    """Returns the nodes that are alive, by their ids: Ray's own descriptions."""
    return {node["NodeID"]: node for node in ray.nodes() if node["Alive"]}


def run_tasks(
    tasks: Iterable[Task],
    work: Callable[[Any, Callable[[int], None]], Any],
    *,
    resources: Resources = Resources(),
    retries: int = 5,
    in_flight: int = 2,
    most_failures: int = 20,
    steps: int | None = None,
    progress: Progress | None = None,
    on_result: Callable[[Task, Any, float], None] | None = None,
) -> Outcome:
    """Runs tasks on all nodes of the cluster that `connect` has connected to.

    tasks: taken one by one as there is room, so a generator may decide late. work(data, report): is called on a node with the data of a
    task, and calls report(steps) with the steps that it has done; what it returns must be small. A function or class of a module that the
    nodes can import. An OSError, the death of its process or of its node begin a task again, up to `retries` times; any other exception
    is a failure at once. in_flight: tasks that are handed out for each that runs. After `most_failures` failures no more are handed out.
    steps: steps of all tasks together, if known. on_result(task, result, seconds): is called here with each result and the wall time of
    its task.

    After Ctrl-C, and after an exception of `on_result`, report raises an exception in the tasks that run; they have 30 s to end, and
    KeyboardInterrupt is raised here.
    """
    return _Run(work, resources, retries, in_flight, most_failures, steps, progress, on_result).run(iter(tasks))


class _Board:
    """An actor beside the driver: what tasks say while they run."""

    def __init__(self) -> None:
        self.said: dict[int, tuple[int, str, int]] = {}
        self.is_stopped = False

    def started(self, number: int, node: str) -> bool:
        """Counts an attempt; returns True if it should stop."""
        starts = self.said.get(number, (0, "", 0))[0]
        self.said[number] = (starts + 1, node, 0)
        return self.is_stopped

    def advanced(self, number: int, done: int) -> bool:
        """Notes the steps of a task; returns True if it should stop."""
        starts, node, _ = self.said.get(number, (1, "", 0))
        self.said[number] = (starts, node, done)
        return self.is_stopped

    def stop(self) -> None:
        """Tells all tasks to stop, each when it speaks next."""
        self.is_stopped = True

    def read(self, over: list[int]) -> dict[int, tuple[int, str, int]]:
        """Returns attempts, node and steps of each task; those of `over` are forgotten."""
        said = dict(self.said)
        for number in over:
            self.said.pop(number, None)
        return said


class _Report:
    """What a task calls with its steps.

    The board's answers are looked at when they are there, and by futures: a task that waits by `ray.get` or `ray.wait` gives its CPUs back
    meanwhile, and Ray would begin one task too many.
    """

    def __init__(self, board: Any, number: int, node: str) -> None:
        self.board, self.number, self.told = board, number, time.monotonic()
        self.answer = board.started.remote(number, node).future()

    def __call__(self, done: int) -> None:
        if self.answer is not None:
            if not self.answer.done():
                return
            # An error: the board is gone, and so is the driver.
            is_stopped = self.answer.exception() is not None or self.answer.result()
            self.answer = None
            if is_stopped:
                raise Stopped("stopped")
        now = time.monotonic()
        if now - self.told >= LOOK:
            self.told = now
            self.answer = self.board.advanced.remote(self.number, done).future()

    def end(self) -> None:
        """Waits until the board has heard of this attempt, so that whoever sees its result can count it."""
        if self.answer is not None:
            with contextlib.suppress(Exception):
                self.answer.result(timeout=10 * LOOK)


def _attempt(work: Callable, number: int, data: Any, board: Any) -> tuple[Any, float, float]:
    """One attempt at a task, on a node: its result, its wall time and its CPU time in seconds."""
    node = ray.get_runtime_context().get_node_id()
    report = _Report(board, number, node)
    wall, cpu = time.monotonic(), time.process_time()
    try:
        result = work(data, report)
    except Exception as error:
        # Not every exception can be pickled, and the driver may lack its class.
        fault = (PassingFault if isinstance(error, OSError) else TaskFault)(line_of(error))
        fault.node = node
        raise fault from None
    finally:
        report.end()
    return result, time.monotonic() - wall, time.process_time() - cpu


@dataclass
class _Run:
    work: Callable
    resources: Resources
    retries: int
    in_flight: int
    most_failures: int
    steps: int | None
    progress: Progress | None
    on_result: Callable[[Task, Any, float], None] | None

    def run(self, tasks: Iterable[Task]) -> Outcome:
        here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
        self.board = ray.remote(_Board).options(num_cpus=0, scheduling_strategy=here).remote()
        self.attempt = ray.remote(
            num_cpus=self.resources.cpus,
            num_gpus=self.resources.gpus,
            memory=self.resources.memory,
            max_retries=self.retries,
            retry_exceptions=[PassingFault],
            scheduling_strategy="SPREAD",
        )(_attempt)
        self.tasks, self.outcome = iter(tasks), Outcome()
        self.running: dict[Any, tuple[int, Task]] = {}
        self.said: dict[int, tuple[int, str, int]] = {}
        self.over: list[int] = []
        self.names: dict[str, str] = {}
        self.number, self.steps_done, self.retried, self.counted, self.looked = 0, 0, 0, -COUNT, 0.0
        self.exhausted, self.begun, self.waited = False, time.monotonic(), False
        try:
            self._loop()
        except BaseException:
            self._stop()
            raise
        finally:
            if self.progress:
                self.progress.end()
            ray.kill(self.board)
        self.outcome.seconds = time.monotonic() - self.begun
        return self.outcome

    def _loop(self) -> None:
        while True:
            self._count()
            self._hand_out()
            if not self.running:
                return
            ready, _ = ray.wait(list(self.running), num_returns=1, timeout=LOOK)
            if ready:
                # All that are there, so that a crowd of short tasks does not wait for one another.
                ready, _ = ray.wait(list(self.running), num_returns=len(self.running), timeout=0)
            if not ready or time.monotonic() - self.looked >= LOOK:
                self._look()
            for ref in ready:
                self._take(ref)
            self._show()

    def _count(self) -> None:
        """Counts nodes and slots: nodes come and go."""
        now = time.monotonic()
        if now - self.counted < COUNT:
            return
        self.counted = now
        alive = nodes_alive()
        self.nodes = len(alive)
        for id, node in alive.items():
            self.names[id] = f"{node.get('NodeManagerHostname') or node['NodeManagerAddress']} ({id[:6]})"
        self.slots = sum(self.resources.slots(node["Resources"]) for node in alive.values())
        self.outcome.slots = max(self.outcome.slots, self.slots)
        if self.slots == 0 and not self.waited and self.progress:
            self.waited = True
            asks = f"{self.resources.cpus:g} CPUs"
            asks += f", {self.resources.gpus:g} GPUs" if self.resources.gpus else ""
            asks += f", {self.resources.memory / 1e9:.1f} GB" if self.resources.memory else ""
            self.progress.say(f"no node has {asks} for a task: waiting for one")

    def _hand_out(self) -> None:
        # Some wait even without a slot: a cluster that grows by demand has to see it.
        while not self.exhausted and len(self.running) < max(self.slots, 1) * self.in_flight:
            if len(self.outcome.failures) >= self.most_failures:
                self.exhausted = True
                self.outcome.not_begun = next(self.tasks, None) is not None
                return
            task = next(self.tasks, None)
            if task is None:
                self.exhausted = True
                return
            ref = self.attempt.options(name=task.name).remote(self.work, self.number, task.data, self.board)
            self.running[ref] = (self.number, task)
            self.number += 1

    def _look(self) -> None:
        self.looked = time.monotonic()
        said = ray.get(self.board.read.remote(self.over))
        self.retried += sum(said[number][0] - 1 for number in self.over if number in said)
        self.over = []
        self.said = {number: said[number] for number, _ in self.running.values() if number in said}
        self.outcome.retries = self.retried + sum(starts - 1 for starts, _, _ in self.said.values())

    def _take(self, ref: Any) -> None:
        try:
            result, seconds, cpu = ray.get(ref)
        except RayError as error:
            self._look()
            number, task = self.running.pop(ref)
            node = getattr(getattr(error, "cause", None), "node", "") or self.said.get(number, (0, "", 0))[1]
            self.over.append(number)
            self.outcome.failures.append(Failure(task.name, self.names.get(node, node[:6] or "no node"), _fault_of(error)))
            return
        number, task = self.running.pop(ref)
        self.over.append(number)
        self.steps_done += task.steps
        self.outcome.results.append((task, result))
        self.outcome.work_seconds += seconds
        self.outcome.cpu_seconds += cpu
        if self.on_result:
            self.on_result(task, result, seconds)
        if not self.running and self.exhausted:
            self._look()

    def _show(self) -> None:
        if not self.progress:
            return
        running = {number for number, _ in self.running.values()}
        done = self.steps_done + sum(done for number, (_, _, done) in self.said.items() if number in running)
        failures = len(self.outcome.failures)
        self.progress.show(Standing(done, self.steps, len(self.outcome.results), self.nodes, self.outcome.retries, failures))

    def _stop(self) -> None:
        """Stops all tasks, each at its next step.

        `ray.cancel` would be shorter, but with a task that ends at that moment it kills the driver (Ray 2.60: "Tried to complete task that
        was not pending").
        """
        try:
            self.board.stop.remote()
            if self.running:
                ray.wait(list(self.running), num_returns=len(self.running), timeout=GRACE)
        except (RayError, KeyboardInterrupt):
            # A second Ctrl-C, or a cluster that is gone.
            return


def line_of(error: BaseException) -> str:
    """Returns an error as one line."""
    text = " ".join(str(error).split())
    if type(error).__module__.partition(".")[0] == "weather_magician" or isinstance(error, OSError):
        return text or type(error).__name__
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _fault_of(error: RayError) -> str:
    """Returns what Ray says of a task that failed, as one line."""
    if isinstance(error, RayTaskError):
        cause = getattr(error, "cause", None)
        return " ".join(str(cause).split()) if isinstance(cause, (TaskFault, PassingFault)) else line_of(cause or error)
    if isinstance(error, OutOfMemoryError):
        return "the node had no memory left: give --memory, so that fewer tasks run there at a time"
    if isinstance(error, WorkerCrashedError):
        return "its process died in every attempt: killed, or out of memory; see Ray's logs on the node (/tmp/ray/session_latest/logs)"
    if isinstance(error, NodeDiedError):
        return "its node died in every attempt"
    return line_of(error)


def stop(connected: bool) -> None:
    """Disconnects if `connect` connected; Ray that it started stops."""
    if connected:
        ray.shutdown()
        sys.stderr.flush()
