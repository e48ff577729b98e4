"""Data sets on many machines, by Ray.

`python -m weather_magician.cluster plan.toml` makes the set of a plan on a cluster, `run_plan` is the same as a function, `run_blocks` trains
a scene in blocks, and `run_tasks` runs any other tasks in the same way. Needs `ray` and, for stores, `fsspec` with the store's package (`s3fs`, `gcsfs`, ...).
"""

try:
    import ray as _ray  # noqa: F401
except ImportError as _error:
    raise ImportError("weather_magician.cluster needs Ray: `pip install ray fsspec`") from _error

from .plans import SetReport, run_plan
from .progress import Progress, Standing
from .runner import ClusterError, Failure, Outcome, Resources, Task, connect, run_tasks
from .training import run_blocks

__all__ = [
    "ClusterError",
    "Failure",
    "Outcome",
    "Progress",
    "Resources",
    "SetReport",
    "Standing",
    "Task",
    "connect",
    "run_blocks",
    "run_plan",
    "run_tasks",
]
