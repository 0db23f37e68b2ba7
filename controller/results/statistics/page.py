"""The values of a recipe's parts as a page: run charts with limits, ranges, capability."""

from collections.abc import Sequence
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Final

from ..pages import render_page
from ..value_chart import Chart, LevelLine, value_chart
from ..wording import count_of, utc
from .capability import Interval
from .charts import NelsonSignal
from .history import ONE_SIDED, Series

TEMPLATE: Final = "series.html.j2"
RULES: Final = {
    1: "1: a value beyond three standard deviations",
    2: "2: nine values in a row on one side of the mean",
    3: "3: six in a row that rise, or fall",
    4: "4: fourteen in a row that go up and down in turn",
}


def write_series_page(recipe: str, series: Sequence[Series], at: datetime, path: Path) -> Path:
    """Write the run charts of a recipe as HTML and return the path.

    Parameters
    ----------
    recipe : its name
    series : series of its characteristics
    at : now, UTC
    path : path of the page

    Raises
    ------
    OSError : the file cannot be written
    """
    return render_page(
        __package__,
        TEMPLATE,
        path,
        recipe=recipe,
        at=utc(at),
        rows=[(one, _facts(one), *_charts(one), _broken(one)) for one in series],
    )


def interval_words(index: Interval | None) -> str:
    """Return an index with its interval; a dash for none."""
    if index is None:
        return "-"
    return f"{index.value:.2f} ({index.lower:.2f} to {index.upper:.2f})"


def series_notes(series: Series) -> list[str]:
    """Return the remarks on the numbers of a series."""
    found = series.capability
    notes = [found.note] if found.note else []
    if series.is_changed:
        notes.append("limits changed on the way")
    if series.missing:
        notes.append(f"{count_of(series.missing, 'part')} without a value")
    return notes


def _facts(series: Series) -> list[tuple[str, str]]:
    found = series.capability
    facts = [("n", str(found.n))]
    if found.mean is not None:
        facts.append(("mean", f"{found.mean:.4f} {series.unit}"))
    if found.sigma is not None:
        facts.append(("sigma", f"{found.sigma:.4f} {series.unit}"))
    for name, index in (
        ("Cp", found.cp), ("Cpk", found.cpk), ("Pp", found.pp), ("Ppk", found.ppk),
    ):  # fmt: skip
        if index is not None:
            facts.append((name, interval_words(index)))
    if found.normality_p is not None:
        facts.append(("normal", f"p = {found.normality_p:.3f}"))
    return facts


def _charts(series: Series) -> tuple[str, str]:
    """Return the chart of the values, and that of their moving ranges, empty for fewer than two."""
    values = [v.measured for v in series.values]
    if not values:
        return "", ""
    lines = [LevelLine(series.upper, "upper limit"), LevelLine(series.nominal, "nominal", "middle")]
    if series.kind not in ONE_SIDED:
        lines.append(LevelLine(series.lower, "lower limit"))
    chart = series.chart
    if chart is None:
        return value_chart(Chart(values, lines, half_widths=[v.U for v in series.values])), ""
    lines += [
        LevelLine(chart.upper, "control", "control"),
        LevelLine(chart.lower, "control", "control"),
    ]
    lines.append(LevelLine(chart.mean, "mean", "middle"))
    ranges = [abs(b - a) for a, b in pairwise(values)]
    high = {i: "R" for i, r in enumerate(ranges) if r > chart.upper_range}
    return (
        value_chart(
            Chart(values, lines, _marks(chart.signals), half_widths=[v.U for v in series.values])
        ),
        value_chart(
            Chart(
                ranges,
                [
                    LevelLine(chart.upper_range, "control", "control"),
                    LevelLine(chart.mean_range, "mean range", "middle"),
                ],
                high,
            )
        ),
    )


def _marks(signals: Sequence[NelsonSignal]) -> dict[int, str]:
    """Return the numbers of the rules that each value breaks, by its index."""
    rules: dict[int, set[int]] = {}
    for signal in signals:
        rules.setdefault(signal.at, set()).add(signal.rule)
    return {at: ", ".join(map(str, sorted(broken))) for at, broken in rules.items()}


def _broken(series: Series) -> list[str]:
    chart = series.chart
    rules = sorted({signal.rule for signal in chart.signals}) if chart else []
    return [f"Nelson's rule {RULES[rule]}" for rule in rules] + series_notes(series)
