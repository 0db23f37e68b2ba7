"""The procedure of commissioning: its steps, their records, and what is still valid.

Independent of devices. `_record.py` is the record of a step, `_status.py` its validity,
`_taught.py` the results of teaching, `_files.py` the folder of all these, `_cell_file.py` the cell
file as commissioned.
"""

from ._cell_file import calibrated_text, cell_digest
from ._files import Folder
from ._record import Figure, GivenAnswer, Outcome, Picture, StepRecord, worst_of
from ._status import Standing, Status, StepPlan, standings
from ._taught import AIM_MM, TRAYS, TrayName, taught_trays, with_values

__all__ = [
    "AIM_MM",
    "TRAYS",
    "Figure",
    "Folder",
    "GivenAnswer",
    "Outcome",
    "Picture",
    "Standing",
    "Status",
    "StepPlan",
    "StepRecord",
    "TrayName",
    "calibrated_text",
    "cell_digest",
    "standings",
    "taught_trays",
    "with_values",
    "worst_of",
]
