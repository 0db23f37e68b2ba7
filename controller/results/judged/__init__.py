"""A judged part with everything for a report on it, from a run's journal or an inspection.

`_model.py` has the data, `_sources.py` collects it of a run, `inspected.py` of an inspection,
`_json.py` prints it for machines, `cad.py` finds the CAD model for its drawings.
"""

from ._json import (
    RESULT_SCHEMA,
    RESULT_SCHEMA_VERSION,
    characteristic_json,
    result_json,
    reviews_json,
)
from ._model import DECISION_RULE, Header, JudgedPart, shared_characteristics
from ._sources import counted_parts, judged_parts

__all__ = [
    "DECISION_RULE",
    "RESULT_SCHEMA",
    "RESULT_SCHEMA_VERSION",
    "Header",
    "JudgedPart",
    "characteristic_json",
    "counted_parts",
    "judged_parts",
    "result_json",
    "reviews_json",
    "shared_characteristics",
]
