"""Writes judged parts to a file; its suffix decides what it is."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from controller.cad import Solid

from .exports import csv_text, dfq_bytes, qif_bytes
from .judged import JudgedPart, result_json
from .pages import write_file
from .report import render_parts


def write_report(parts: Sequence[JudgedPart], path: Path, solid: Solid | None = None) -> Path:
    """Write a report of judged parts and return its path; the file is whole or not there.

    Parameters
    ----------
    parts : of one product, at least one
    path : its suffix is one of `SUFFIXES`
    solid : the product's CAD model, for the drawings of a page

    Raises
    ------
    ValueError : another suffix, no part, or parts of different products
    OSError : the file cannot be written
    """
    form = path.suffix.lower().removeprefix(".")
    if form not in FORMS:
        raise ValueError(f"{path.name}: the suffix of a report is one of {', '.join(SUFFIXES)}")
    return write_parts(parts, form, path, solid)


def write_parts(
    parts: Sequence[JudgedPart], form: str, path: Path, solid: Solid | None = None
) -> Path:
    """Write judged parts in a given form and return the path.

    Parameters
    ----------
    parts : of one product, at least one
    form : a key of `FORMS`
    path : any suffix
    solid : the product's CAD model, for the drawings of a page

    Raises
    ------
    ValueError : no part, or parts of different products
    OSError : the file cannot be written
    """
    if not parts:
        raise ValueError("there is no part to report on")
    return write_file(FORMS[form](parts, solid), path)


def _html(parts: Sequence[JudgedPart], solid: Solid | None) -> bytes:
    return render_parts(parts, solid).encode()


def _json(parts: Sequence[JudgedPart], solid: Solid | None) -> bytes:
    """Return one result as an object, several as a list."""
    found = [result_json(judged) for judged in parts]
    text = json.dumps(found[0] if len(found) == 1 else found, indent=1, ensure_ascii=False)
    return text.encode()


Writer = Callable[[Sequence[JudgedPart], Solid | None], bytes]
FORMS: Final[Mapping[str, Writer]] = {
    "html": _html,
    "json": _json,
    # marked, so that Excel reads it as UTF-8
    "csv": lambda parts, _: csv_text(parts).encode("utf-8-sig"),
    "qif": lambda parts, _: qif_bytes(parts),
    "dfq": lambda parts, _: dfq_bytes(parts),
}
SUFFIXES: Final = tuple(f".{form}" for form in FORMS)
