"""Heavy computation, in a worker process, so that the event loop is never held.

`service.py` has the questions and `answers.py` the functions that answer them; `job.py` has what a
worker keeps of a job, `pool.py` the process, `held_search.py` the search for a part that slipped in
the jaws. `checking.py` checks a recipe in a cell from files alone.
"""

from .answers import Holder
from .job import Context, Job, context, glowing_mask, inspection_limits, load_parts, part_files
from .pool import make_pool, worker_pool
from .service import Compute

__all__ = [
    "Compute",
    "Context",
    "Holder",
    "Job",
    "context",
    "glowing_mask",
    "inspection_limits",
    "load_parts",
    "make_pool",
    "part_files",
    "worker_pool",
]
