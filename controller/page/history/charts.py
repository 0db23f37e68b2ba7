"""Run charts of a characteristic: values with limits and limits of control, as SVG."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from markupsafe import Markup

from controller.results.statistics.charts import RunChart, run_chart
from controller.results.value_chart import Chart, LevelLine, value_chart

from ..frame.words import word

VALUES_MAX: Final = 400  # values of a chart: the newest parts
LIMITS: Final = (("lower", word("lower limit")), ("upper", word("upper limit")))
CONTROLS: Final = (
    ("upper", word("upper control"), "control"),
    ("mean", word("mean"), "middle"),
    ("lower", word("lower control"), "control"),
)


@dataclass(frozen=True, slots=True)
class DrawnChart:
    """A chart, and its content in numbers.

    Attributes
    ----------
    svg : None where nothing was measured
    signals : rule of Nelson and the number of the value, from 1
    is_changed : the limits are not the same for all values
    """

    svg: Markup | None
    chart: RunChart | None
    count: int
    missing: int
    signals: tuple[tuple[int, int], ...]
    is_changed: bool


def drawn(
    values: Sequence[Mapping[str, Any]],
    in_words: Callable[[str], str],
    written: Callable[[float, int], str],
) -> DrawnChart:
    """Return the chart of values.

    Parameters
    ----------
    values : oldest first, as the store has them
    in_words : puts a text into the language of the person
    written : returns a number with so many digits as that language writes it
    """
    measured = [one for one in values if one["measured"] is not None]
    numbers = [float(one["measured"]) for one in measured]
    if not numbers:
        return DrawnChart(None, None, 0, len(values), (), is_changed=False)
    chart = run_chart(numbers)
    last = measured[-1]
    # limits as wide as nature sets them (a position has no lower one) are no lines
    lines = [
        LevelLine(float(last[key]), in_words(name))
        for key, name in LIMITS
        if last[key] != last["nominal"]
    ]
    if chart is not None and chart.sigma > 0:
        lines += [
            LevelLine(getattr(chart, key), in_words(name), style) for key, name, style in CONTROLS
        ]
    signals = () if chart is None else chart.signals
    marks: dict[int, str] = {}
    for signal in signals:
        marks[signal.at] = (
            f"{marks[signal.at]},{signal.rule}" if signal.at in marks else (str(signal.rule))
        )
    half_widths = [one["U"] for one in measured]
    svg = value_chart(Chart(numbers, lines, marks, half_widths=half_widths, written=written))
    limits = {(one["lower"], one["upper"]) for one in measured}
    return DrawnChart(
        svg,
        chart,
        len(numbers),
        len(values) - len(numbers),
        tuple((signal.rule, signal.at + 1) for signal in signals),
        is_changed=len(limits) > 1,
    )
