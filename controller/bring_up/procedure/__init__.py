"""The procedure of commissioning: its steps, their records, and what is still valid.

Independent of devices. `_record.py` is the record of a step, `_status.py` its validity,
`_taught.py` the results of teaching, `_files.py` the folder of all these, `_cell_file.py` the cell
file as commissioned.
"""

from ._cell_file import calibrated_text, cell_digest
from ._files import CommissioningFolder
from ._record import GivenAnswer, StepEnd, StepFigure, StepPicture, StepRecord, worst_of
from ._status import StepPlan, StepStanding, StepStatus, standings
from ._taught import AIM_MM, TRAYS, TrayName, taught_trays, with_values

__all__ = [
    "AIM_MM",
    "TRAYS",
    "CommissioningFolder",
    "GivenAnswer",
    "StepEnd",
    "StepFigure",
    "StepPicture",
    "StepPlan",
    "StepRecord",
    "StepStanding",
    "StepStatus",
    "TrayName",
    "calibrated_text",
    "cell_digest",
    "standings",
    "taught_trays",
    "with_values",
    "worst_of",
]
