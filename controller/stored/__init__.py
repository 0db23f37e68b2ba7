"""Stored pictures of a part, judged alike for a run, for stored sets and for a replay.

`pictures.py` reads them, `view_set.py` builds the views of a set, `judging.py` has the part
inspected by a recipe, `lines.py` turns the results into JSON. Nothing here knows a device.
"""

from .judging import Judging, compiled_part, judge_ahead, judge_views, read_pictures
from .lines import face_lines, in_unit, json_lines, lines_digest
from .view_set import build_pose, build_view_set, grasp_numbers, repeated_sets

__all__ = [
    "Judging",
    "build_pose",
    "build_view_set",
    "compiled_part",
    "face_lines",
    "grasp_numbers",
    "in_unit",
    "json_lines",
    "judge_ahead",
    "judge_views",
    "lines_digest",
    "read_pictures",
    "repeated_sets",
]
