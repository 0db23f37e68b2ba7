"""Values of a recipe's parts from the journal, in the order measured; read only."""

import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from controller.cell.journal import JournalError, Row, read_row, read_rows_counted, rows
from controller.cell.journal.usage import views_off_mm
from controller.config.calibrations import MAX_OFF_MM
from messages import say

from ..run import ResultsError, whole_journal
from .capability import Interval, ProcessCapability, capability
from .charts import RunChart, run_chart

AGREEMENT: Final = "arm against station camera"
ONE_SIDED: Final = frozenset({"position", "straightness", "roundness", AGREEMENT})
NAMES: Final = tuple(
    body.row_name
    for body in (rows.RunBegan, rows.PartIdentified, rows.PartMeasured, rows.ViewsPosed)
)


@dataclass(frozen=True, slots=True)
class MeasuredValue:
    """A measured value: its part, its run and its verdict."""

    run: str
    part: int
    at: datetime
    measured: float
    U: float | None
    verdict: str


@dataclass(slots=True)
class Series:
    """All values of a characteristic; limits and unit are those of the newest part.

    Attributes
    ----------
    missing : parts for which there is no value
    is_changed : nominal value or limits were not the same for all parts
    """

    id: str
    label: str
    kind: str
    unit: str
    nominal: float
    lower: float
    upper: float
    values: list[MeasuredValue] = field(default_factory=list)
    missing: int = 0
    is_changed: bool = False

    @property
    def chart(self) -> RunChart | None:
        """The chart of the values."""
        return run_chart([v.measured for v in self.values])

    @property
    def capability(self) -> ProcessCapability:
        """The process capability."""
        lower = None if self.kind in ONE_SIDED else self.lower
        return capability([v.measured for v in self.values], lower, self.upper)


def series_of(runs_dir: Path, recipe: str) -> tuple[Series, ...]:
    """Return the series of all characteristics measured in runs of a recipe, oldest value first.

    A part that went on in a later run has its values once, in the run that has its record.

    Parameters
    ----------
    runs_dir : folder with the journal
    recipe : name of the recipe

    Raises
    ------
    ResultsError : no journal, one that cannot be read or was changed, or no run of this recipe
    """
    path = whole_journal(runs_dir)
    found: dict[str, Series] = {}
    names: dict[str, str] = {}  # names in the first recipe, by run
    of_part: dict[tuple[str, int | None], str] = {}

    def is_wanted(row: Row) -> bool:
        return of_part.get((row.run, row.part), names.get(row.run)) == recipe

    try:
        for row in read_rows_counted(path, NAMES):
            if row.name == rows.RunBegan.row_name:
                names[row.run] = str(row.body.get("recipe", {}).get("name", ""))
            elif row.name == rows.PartIdentified.row_name:
                of_part[row.run, row.part] = str(row.body.get("name", ""))
            elif row.name == rows.PartMeasured.row_name and is_wanted(row):
                said = read_row(row.kind, row.name, row.body)
                assert isinstance(said, rows.PartMeasured)
                for c in said.characteristics:
                    _take(found, c, row.run, row.part or 0, datetime.fromisoformat(row.t_utc))
            elif row.name == rows.ViewsPosed.row_name and is_wanted(row):
                posed = read_row(row.kind, row.name, row.body)
                assert isinstance(posed, rows.ViewsPosed)
                at = datetime.fromisoformat(row.t_utc)
                _take(found, _agreement(posed), row.run, row.part or 0, at)
    except (JournalError, sqlite3.Error, ValueError) as error:
        raise ResultsError(say("journal {path}: {error}", path=path, error=error)) from error
    known_names = {*names.values(), *of_part.values()}
    if recipe not in known_names:
        known = ", ".join(sorted(known_names)) or "it has none"
        raise ResultsError(f"no run of the recipe `{recipe}` in {runs_dir}: there are {known}")
    return tuple(found.values())


def _take(
    found: dict[str, Series], c: rows.CharacteristicFields, run: str, part: int, at: datetime
) -> None:
    asked = (c.nominal, c.lower, c.upper)
    series = found.setdefault(c.id, Series(c.id, c.label, c.kind, c.unit, *asked))
    if (series.nominal, series.lower, series.upper) != asked:
        series.nominal, series.lower, series.upper = asked
        series.is_changed = True
    if c.measured is None:
        series.missing += 1
    else:
        series.values.append(MeasuredValue(run, part, at, c.measured, c.U, c.verdict))


def _agreement(posed: rows.ViewsPosed) -> rows.CharacteristicFields:
    """Return the disagreement of arm and station camera while a part was shown, as a series."""
    return rows.CharacteristicFields(
        id=AGREEMENT,
        balloon=0,
        label=AGREEMENT,
        kind=AGREEMENT,
        unit="mm",
        nominal=0.0,
        lower=0.0,
        upper=MAX_OFF_MM,
        source="views",
        measured=views_off_mm(posed),
        verdict="",
    )


def series_json(series: Series) -> Mapping[str, Any]:
    """Return a series with chart and capability as plain JSON values."""
    chart, found = series.chart, series.capability
    return {
        "id": series.id,
        "label": series.label,
        "kind": series.kind,
        "unit": series.unit,
        "nominal": series.nominal,
        "lower": series.lower,
        "upper": series.upper,
        "n": found.n,
        "missing": series.missing,
        "limits_changed": series.is_changed,
        "mean": found.mean,
        "sigma": found.sigma,
        "cp": _interval(found.cp),
        "cpk": _interval(found.cpk),
        "pp": _interval(found.pp),
        "ppk": _interval(found.ppk),
        "normality_p": found.normality_p,
        "note": found.note,
        "chart": None
        if chart is None
        else {
            "mean": chart.mean,
            "lower": chart.lower,
            "upper": chart.upper,
            "mean_range": chart.mean_range,
            "upper_range": chart.upper_range,
            "signals": [{"rule": s.rule, "at": s.at} for s in chart.signals],
        },
        "values": [
            {
                "run": v.run,
                "part": v.part,
                "at": v.at.isoformat(),
                "measured": v.measured,
                "U": v.U,
                "verdict": v.verdict,
            }
            for v in series.values
        ],
    }


def _interval(found: Interval | None) -> Mapping[str, float] | None:
    if found is None:
        return None
    return {"value": found.value, "lower": found.lower, "upper": found.upper}
