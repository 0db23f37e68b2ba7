"""The answers: one plain function for each question that the cell puts to its worker process.

`Compute` is made from these functions, so that a question has the name, arguments and documentation
of its function. Each function takes plain data and a `Job`, from which the worker builds, once, the
data that cannot be sent between processes (`job.context`). None of them moves anything.
"""

from .homing import homing_swept, path_home, proven_back
from .planning import Pickable, identify, pickable, plan, plan_to_trays, prepare, surface_share
from .table import SeenCode, read_codes, recognise, unseen_turns
from .views import Holder, Located, find_hold, inspect, inspect_on_table, judge, judge_ahead, locate

__all__ = [
    "Holder",
    "Located",
    "Pickable",
    "SeenCode",
    "find_hold",
    "homing_swept",
    "identify",
    "inspect",
    "inspect_on_table",
    "judge",
    "judge_ahead",
    "locate",
    "path_home",
    "pickable",
    "plan",
    "plan_to_trays",
    "prepare",
    "proven_back",
    "read_codes",
    "recognise",
    "surface_share",
    "unseen_turns",
]
