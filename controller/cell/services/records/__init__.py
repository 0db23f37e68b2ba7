"""The known facts on the current part and the batch, and the journal's rows made of them.

`part.py` is the part, `product.py` its recipe, `batch.py` all parts with their journal,
`progress.py` the progress shown to the operator, `describe.py` turns results into rows, `holds.py`
grasps into rows and back.
"""

from .batch import BatchRecord
from .describe import (
    findings_row,
    measured_row,
    plan_row,
    sightings_row,
    verdict_row,
    view_row,
    views_posed_row,
)
from .holds import grasp_of, matrix
from .part import AboveTray, PartInGripper, PartRecord, Shown, merged
from .product import INPUTS, RECIPE_COPY, BatchProduct, inputs_of
from .progress import RunProgress

__all__ = [
    "INPUTS",
    "RECIPE_COPY",
    "AboveTray",
    "BatchProduct",
    "BatchRecord",
    "PartInGripper",
    "PartRecord",
    "RunProgress",
    "Shown",
    "findings_row",
    "grasp_of",
    "inputs_of",
    "matrix",
    "measured_row",
    "merged",
    "plan_row",
    "sightings_row",
    "verdict_row",
    "view_row",
    "views_posed_row",
]
