"""Many parts at once: results computed ahead of a run by other processes.

They only fill the cache (docs/parts.md, "Catalogues"). The process that prints or plans reads the
cache as ever, and computes missing entries itself; so a process that ends early costs time, not
correctness.
"""

from .ahead import Ahead, Made
from .pool import LOCAL, Jobs, TaskPool, jobs_among, open_pool
from .tasks import PartWork, is_made

__all__ = [
    "LOCAL",
    "Ahead",
    "Jobs",
    "Made",
    "PartWork",
    "TaskPool",
    "is_made",
    "jobs_among",
    "open_pool",
]
