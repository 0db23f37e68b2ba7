"""Gauge studies: the scatter of measuring itself, from values the cell has measured.

`_study.py` turns readings into a study per characteristic, `_words.py` states the conclusions that
the data allow, `_reference.py` reads reference values, `_evidence.py` writes a study to a dated
file and finds it again, `_page.py` draws it.
"""

from ._evidence import FOLDER, KeptStudy, StudySources, kept_studies, study_json, write_evidence
from ._page import gauge_row, write_gauge_page
from ._reference import Reference, read_references
from ._study import CharacteristicGauge, Reading, study_readings
from ._words import in_um, said_of, said_of_all

__all__ = [
    "FOLDER",
    "CharacteristicGauge",
    "KeptStudy",
    "Reading",
    "Reference",
    "StudySources",
    "gauge_row",
    "in_um",
    "kept_studies",
    "read_references",
    "said_of",
    "said_of_all",
    "study_json",
    "study_readings",
    "write_evidence",
    "write_gauge_page",
]
