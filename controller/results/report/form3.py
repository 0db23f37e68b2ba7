"""Judged parts in the layout of AS9102 Form 3, characteristic accountability.

Source: docs/references.md S26. Fields have the names and numbers of revision C, in our own words.
Measured fields are filled in; fields that only a person can fill in remain empty. Characteristics
have the numbers of the balloons in the drawing, which follows each form, with the signature after
it. The layout is no claim of conformity.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

from jinja2 import Template

from controller.cad import Solid
from controller.cell.journal.rows import CharacteristicFields

from ..judged import JudgedPart, counted_parts
from ..pages import make_environment
from ..run import ResultsError, RunRecord
from ._words import cautions
from .html import FILTERS, NO_CAD, solids_of
from .signed.balloons import BalloonDrawing, balloon_drawing
from .signed.table import TableRow, rows_of

TEMPLATES: Final = ("form3.html.j2", "signed.html.j2", "part.html.j2", "report.css")
NOT_MEASURED: Final = "not measured"


@dataclass(frozen=True, slots=True)
class FormRow:
    """Fields 5 to 12 of a characteristic; a person fills in 10 and 11.

    Attributes
    ----------
    reference : view of the drawing with the balloon, else faces of the CAD model
    requirement, name : dimension with its tolerance; its feature, and the source of the tolerance
    comments : verdict, uncertainty and reason
    """

    number: int
    reference: str
    designator: str
    requirement: str
    name: str
    results: str
    verdict: str
    comments: str


@dataclass(frozen=True, slots=True)
class PartForm:
    """Form of one part, with its drawing.

    Attributes
    ----------
    part_number, part_name, serial, report : fields 1 to 4
    made_with : drawing, order, gauge, recipe and software, as far as known
    no_drawing : reason why there is no drawing; empty where there is one
    """

    part_number: str
    part_name: str
    serial: str
    report: str
    made_with: tuple[tuple[str, str], ...]
    rows: tuple[FormRow, ...]
    drawing: BalloonDrawing | None
    no_drawing: str


def render_form3(record: RunRecord) -> str:
    """Return the forms of all parts of a run as one HTML page.

    Raises
    ------
    ResultsError : the run has no part
    """
    parts = counted_parts(record)
    if not parts:
        raise ResultsError(f"run {record.run_id}: has no part; Form 3 is of a part")
    return _page(parts, solids_of(record), record)


def render_form3_parts(parts: Sequence[JudgedPart], solid: Solid | None = None) -> str:
    """Return the forms of judged parts as one HTML page.

    Parameters
    ----------
    parts : one or more judged parts
    solid : CAD model of their product, for the drawing; None if unavailable
    """
    return _page(parts, lambda _: solid or NO_CAD, None)


def make_form(judged: JudgedPart, solid: Solid | str) -> PartForm:
    """Return the form of a part.

    Parameters
    ----------
    judged : the judged part
    solid : its CAD model, or the reason why there is none
    """
    h, found = judged.header, judged.part.characteristics
    drawing = balloon_drawing(solid, found) if isinstance(solid, Solid) else None
    shown = {
        balloon.number: side.words if side.border else f"view {side.words}"
        for side in (drawing.sides if drawing else ())
        for callout in side.callouts
        for balloon in callout.balloons
    }
    named = (
        ("Drawing", h.papers.get("drawing_number", "")),
        ("Revision", h.papers.get("revision", "")),
        ("Order", h.papers.get("order_number", "")),
        ("Lot", h.lot),
        ("Gauge", h.papers.get("gauge_id", "") or f"cell {h.cell}"),
        ("Recipe", h.recipe),
        ("Software", f"cellctl {h.software.get('cellctl', '')}".strip()),
        ("Operator", h.operator),
    )
    return PartForm(
        h.papers.get("part_number", ""),
        h.part,
        h.serial,
        f"{h.run_id}/{h.number}" if h.run_id else "",
        tuple((name, text) for name, text in named if text),
        tuple(_row(row, shown) for row in rows_of(found)),
        drawing,
        solid if isinstance(solid, str) else "",
    )


def _row(row: TableRow, shown: Mapping[int, str]) -> FormRow:
    c = row.c
    return FormRow(
        c.balloon,
        shown.get(c.balloon, "") or _faces(c),
        "critical" if c.is_critical else "",
        row.requirement,
        f"{c.label or c.id}; {c.source}",
        NOT_MEASURED if c.measured is None else f"{row.actual} {row.unit}",
        c.verdict,
        "; ".join(filter(None, ("" if c.U is None else f"U {row.U} (k = 2)", row.note))),
    )


def _faces(c: CharacteristicFields) -> str:
    return ", ".join(f"F{face}" for face in c.faces)


@cache
def _template() -> Template:
    """Return the template of the page, compiled once."""
    return make_environment(__package__, TEMPLATES, FILTERS).get_template(TEMPLATES[0])


def _page(
    parts: Sequence[JudgedPart],
    solid: Callable[[JudgedPart], Solid | str],
    record: RunRecord | None,
) -> str:
    first = parts[0].header
    return _template().render(
        record=record,
        software=first.software,
        emulated=record.emulated_devices if record else first.emulated_devices,
        document=f"{first.part}, {record.run_id if record else first.serial or first.cad}",
        cautions=cautions(record) if record else [],
        forms=[make_form(judged, solid(judged)) for judged in parts],
    )
