"""Many parts at once: the pool of processes, here or on a Dask cluster, and work ahead of a run.

Work ahead only fills the cache (docs/parts.md, "Catalogues"). The process that prints or plans
reads the cache as ever, and computes missing entries itself; so a process that ends early costs
time, not correctness. `results_of` gives any other orders to the pool, and yields their results.
"""

from .ahead import Ahead, Made
from .pool import LOCAL, Jobs, jobs_among, open_pool
from .software import software_key
from .tasks import PartWork, is_made
from .working import PoolLostError, TaskPool, WorkPool, in_order, results_of

__all__ = [
    "LOCAL",
    "Ahead",
    "Jobs",
    "Made",
    "PartWork",
    "PoolLostError",
    "TaskPool",
    "WorkPool",
    "in_order",
    "is_made",
    "jobs_among",
    "open_pool",
    "results_of",
    "software_key",
]
