"""Statistics of measurements: over the parts of a recipe, and of the gauge itself.

`history.py` collects values from the journal, `charts.py` has the control limits and the rules that
detect a shift of the process, `capability.py` the capability indices; `page.py` draws them.
`gauge.py` and `nested.py` have the scatter of the measurement itself: a crossed study, a nested
one. Plain numbers in and out; nothing here decides upon a part.
"""

from .capability import MIN_COUNT, Interval, ProcessCapability, capability
from .charts import NelsonSignal, RunChart, nelson_signals, run_chart
from .gauge import Bias, GaugeStudy, bias_of, gauge_study
from .history import MeasuredValue, Series, series_json, series_of
from .nested import Component, NestedStudy, nested_study
from .page import interval_words, series_notes, write_series_page

__all__ = [
    "MIN_COUNT",
    "Bias",
    "Component",
    "GaugeStudy",
    "Interval",
    "MeasuredValue",
    "NelsonSignal",
    "NestedStudy",
    "ProcessCapability",
    "RunChart",
    "Series",
    "bias_of",
    "capability",
    "gauge_study",
    "interval_words",
    "nelson_signals",
    "nested_study",
    "run_chart",
    "series_json",
    "series_notes",
    "series_of",
    "write_series_page",
]
