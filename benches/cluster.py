"""Wall time of a plan on a Ray cluster of one and of two nodes with one CPU each: python benches/cluster.py SCENE [FRAMES] [SHARDS]

All processes of a cluster are kept to as many processors as it has nodes, since a shard writes on a thread of its own and would take a
part of the second processor too. Without SHARDS the runner cuts the plan as it finds the pace. Prints the share of the slots' time that is the tasks' own work: the rest is Ray, the start of processes, and waiting at the end.
"""

import os
import pathlib
import sys
import tempfile
import time

from ray.cluster_utils import Cluster

from weather_magician.cluster import run_plan

scene = sys.argv[1]
frames = int(sys.argv[2]) if len(sys.argv) > 2 else 480
shards = int(sys.argv[3]) if len(sys.argv) > 3 else None
WEATHERS = ["light-snow", "heavy-rain", "snow", "drizzle"]
folder = pathlib.Path(tempfile.mkdtemp())
plan = folder / "plan.toml"
plan.write_text(f"""
frames = {frames // len(WEATHERS)}
block = {frames // len(WEATHERS) // 8}
[[scene]]
file = "{pathlib.Path(scene).resolve()}"
[[path]]
speed = 5
[rig]
size = [1200, 800]
[[weather]]
from = {WEATHERS}
""")
walls = []
for nodes in (1, 2):
    os.sched_setaffinity(0, range(nodes))
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "object_store_memory": 80 << 20})
    for _ in range(nodes - 1):
        cluster.add_node(num_cpus=1, object_store_memory=80 << 20)
    started = time.perf_counter()
    report = run_plan(plan, folder / f"set{nodes}", address=cluster.address, shards=shards, cpus=1)
    wall = time.perf_counter() - started
    cluster.shutdown()
    walls.append(wall)
    outcome = report.outcome
    own = outcome.work_seconds / (outcome.seconds * outcome.slots)
    print(
        f"{nodes} nodes: {report.frames} frames in {len(outcome.results)} shards, {wall:.1f} s, {outcome.cpu_seconds:.1f} CPU s, "
        f"{outcome.work_seconds / len(outcome.results):.1f} s a shard, own work {own:.3f} of the slots' time",
        flush=True,
    )
print(f"two nodes: {walls[0] / walls[1]:.2f} times as fast as one")
