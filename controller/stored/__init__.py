"""Stored pictures of a part, judged alike for a run, for stored sets and for a replay.

`pictures.py` reads them, `view_set.py` builds the views of a set, `judging.py` has the part
inspected by a recipe, `lines.py` turns the results into JSON. Nothing here knows a device.
"""

from .judging import (
    Judging,
    cad_sha256,
    compiled_part,
    judge_ahead,
    judge_views,
    judging_by,
    judging_of,
    learned_for,
    read_pictures,
)
from .learned_file import AcceptedPart, Learned, LearnedHeader, read_learned, write_learned
from .lines import face_lines, in_unit, json_lines, lines_digest
from .view_set import build_pose, build_view_set, grasp_numbers, repeated_sets

__all__ = [
    "AcceptedPart",
    "Judging",
    "Learned",
    "LearnedHeader",
    "build_pose",
    "build_view_set",
    "cad_sha256",
    "compiled_part",
    "face_lines",
    "grasp_numbers",
    "in_unit",
    "json_lines",
    "judge_ahead",
    "judge_views",
    "judging_by",
    "judging_of",
    "learned_for",
    "lines_digest",
    "read_learned",
    "read_pictures",
    "repeated_sets",
    "write_learned",
]
