"""Statistics of what was measured: over the parts of a recipe, and of the gauge itself.

`history.py` collects values from the journal, `charts.py` has the limits of control and the rules
that see a process move, `capability.py` what a process keeps within, `gauge.py` and `nested.py`
what the measuring itself scatters: a crossed study, a nested one. Plain numbers in and out; nothing
here decides upon a part.
"""

from .capability import MIN_COUNT, Capability, Interval, capability
from .charts import NelsonSignal, RunChart, nelson_signals, run_chart
from .gauge import Bias, GaugeStudy, bias_of, gauge_study
from .history import Series, Value, series_json, series_of
from .nested import Component, NestedStudy, nested_study

__all__ = [
    "MIN_COUNT",
    "Bias",
    "Capability",
    "Component",
    "GaugeStudy",
    "Interval",
    "NelsonSignal",
    "NestedStudy",
    "RunChart",
    "Series",
    "Value",
    "bias_of",
    "capability",
    "gauge_study",
    "nelson_signals",
    "nested_study",
    "run_chart",
    "series_json",
    "series_of",
]
