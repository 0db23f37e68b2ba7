"""A gauge study as a page: what the data allow, the table, every value."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from ..pages import render_page
from ..value_chart import Chart, LevelLine, value_chart
from ..wording import utc
from ._evidence import StudySources
from ._study import CharacteristicGauge
from ._words import UM_PER_MM, in_um, said_of, said_of_all

TEMPLATE: Final = "gauge.html.j2"


def write_gauge_page(
    evidence: StudySources, gauges: Sequence[CharacteristicGauge], kept: Path, path: Path
) -> Path:
    """Write a gauge study as HTML and return the path.

    Parameters
    ----------
    evidence : readings it was made of
    gauges : results
    kept : the evidence's file, named on the page
    path : path of the page

    Raises
    ------
    OSError : the file cannot be written
    """
    return render_page(
        __package__,
        TEMPLATE,
        path,
        evidence=evidence,
        at=utc(evidence.at),
        file=kept.name,
        allow=said_of_all(gauges),
        rows=[gauge_row(gauge) for gauge in gauges],
        charts=[(gauge, value_chart(_chart(gauge))) for gauge in gauges],
    )


def gauge_row(gauge: CharacteristicGauge) -> tuple[str, ...]:
    """Return the row of a characteristic, for page and terminal alike."""
    percent = gauge.tolerance_percent
    indices = [f"{x:.2f}" for x in (gauge.cg, gauge.cgk) if x is not None]
    return (
        gauge.label,
        str(len(gauge.values)),
        in_um(gauge.in_grasp, gauge.unit),
        in_um(gauge.with_regrasps, gauge.unit),
        in_um(gauge.gauge, gauge.unit),
        "-"
        if percent is None
        else f"{percent.value:.1f} ({percent.lower:.1f} to {percent.upper:.1f})",
        "-" if gauge.ndc is None else str(gauge.ndc),
        _bias(gauge),
        ", ".join(indices) or "-",
        in_um(gauge.look_to_look, gauge.unit),
        "; ".join(said_of(gauge)),
    )


def _bias(gauge: CharacteristicGauge) -> str:
    if gauge.bias is None:
        return "-"
    scale, decimals = (UM_PER_MM, 0) if gauge.unit == "mm" else (1.0, 3)
    shown = f"{gauge.bias * scale:+.{decimals}f}"
    if gauge.U_bias is None:
        return f"{shown}, U unknown"
    return f"{shown} ± {gauge.U_bias * scale:.{decimals}f}"


def _chart(gauge: CharacteristicGauge) -> Chart:
    names = [" ".join(name for name in group[:2] if name) or "values" for group in gauge.groups]
    lines = [LevelLine(gauge.upper, "upper limit"), LevelLine(gauge.nominal, "nominal", "middle")]
    if gauge.nominal or gauge.lower:
        lines.append(LevelLine(gauge.lower, "lower limit"))
    return Chart(gauge.values, lines, groups=names)
