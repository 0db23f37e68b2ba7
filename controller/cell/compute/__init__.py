"""Heavy computation in a worker process, so that it never blocks the event loop.

`service.py` declares the questions and `answers/` has the functions that answer them. `job.py`
has a worker's data for a job, and `held_search.py` finds a part that slipped in the jaws.
`one_task.py` holds optional work. `checking.py` checks a recipe in a cell from files alone.
"""

from .answers import Holder, Located, Pickable, SeenCode
from .job import (
    MAX_RECIPE_COUNT,
    Context,
    Job,
    context,
    glowing_mask,
    inspection_limits,
    load_parts,
    part_files,
)
from .one_task import OneTask
from .service import Compute, PartCompute, begin

__all__ = [
    "MAX_RECIPE_COUNT",
    "Compute",
    "Context",
    "Holder",
    "Job",
    "Located",
    "OneTask",
    "PartCompute",
    "Pickable",
    "SeenCode",
    "begin",
    "context",
    "glowing_mask",
    "inspection_limits",
    "load_parts",
    "part_files",
]
