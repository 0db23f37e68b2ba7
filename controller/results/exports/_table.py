"""Judged parts as one flat table: a row for each characteristic of each part (RFC 4180)."""

import csv
import io
from collections.abc import Sequence
from typing import Final

from ..judged import JudgedPart

COLUMNS: Final = (
    "run", "number", "part", "serial", "lot", "operator", "recipe", "recipe_sha256", "cad_sha256",
    "start", "end", "emulated", "part_verdict", "balloon", "id", "label", "kind", "unit", "nominal",
    "lower", "upper", "source", "measured", "deviation", "U_k2", "verdict", "views", "reason",
    "review", "review_who", "review_why", "review_at", "part_number", "drawing_number", "revision",
    "order_number", "gauge_id",
)  # fmt: skip
PAPER_COLUMNS: Final = COLUMNS[COLUMNS.index("part_number") :]
# first characters from which a spreadsheet takes a text for a formula
FORMULA_STARTS: Final = ("=", "+", "-", "@", "\t", "\r")


def csv_text(parts: Sequence[JudgedPart]) -> str:
    """Return the table; numbers have a decimal point, unknown values are empty."""
    out = io.StringIO()
    writer = csv.writer(out)
    writer.writerow(COLUMNS)
    for judged in parts:
        h = judged.header
        about = (
            h.run_id, h.number, h.part, h.serial, h.lot, h.operator, h.recipe, h.recipe_sha256,
            h.cad_sha256, h.start.isoformat(), h.end.isoformat(),
            "yes" if h.emulated_devices else "no", judged.verdict,
        )  # fmt: skip
        review = judged.part.review
        by_person: tuple[str, ...] = ("",) * 4
        if review is not None:
            by_person = (review.verdict, review.who, review.why, review.at.isoformat())
        for c in judged.part.characteristics:
            row = (
                *about, c.balloon, c.id, c.label, c.kind, c.unit, c.nominal, c.lower, c.upper,
                c.source, c.measured, c.deviation, c.U, c.verdict, " ".join(c.views), c.reason,
                *by_person, *(h.papers.get(key, "") for key in PAPER_COLUMNS),
            )  # fmt: skip
            writer.writerow([csv_cell(value) for value in row])
    return out.getvalue()


def csv_cell(value: str | float | None) -> str:
    """Return a value in the table's format: a decimal point, and no text like a formula."""
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.6f}".rstrip("0").rstrip(".")
    text = str(value)
    return "'" + text if isinstance(value, str) and text.startswith(FORMULA_STARTS) else text
