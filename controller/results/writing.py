"""Writes judged parts to a file, in the format of its suffix."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Final

from controller.cad import Solid

from .exports import csv_text, dfq_bytes, qif_bytes
from .judged import JudgedPart, counted_parts, result_json
from .pages import write_file, write_page
from .report import (
    PdfError,
    pdf_bytes,
    render,
    render_form3,
    render_form3_parts,
    render_parts,
)
from .run import RunRecord


def write_report(parts: Sequence[JudgedPart], path: Path, solid: Solid | None = None) -> Path:
    """Write a report of judged parts and return its path; the file is whole or not there.

    Parameters
    ----------
    parts : parts of one product, at least one
    path : its suffix is one of `SUFFIXES`
    solid : the product's CAD model, for the drawings of a page

    Raises
    ------
    ValueError : another suffix, no part, or parts of different products
    PdfError : this machine can make no PDF; the page stands beside it as HTML
    OSError : the file cannot be written
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{path.name}: the suffix of a report is one of {', '.join(SUFFIXES)}")
    return write_parts(parts, path.suffix.lower().removeprefix("."), path, solid)


def write_parts(
    parts: Sequence[JudgedPart], form: str, path: Path, solid: Solid | None = None
) -> Path:
    """Write judged parts in a given form and return the path.

    Parameters
    ----------
    parts : parts of one product, at least one
    form : a suffix without its dot
    path : any suffix
    solid : the product's CAD model, for the drawings of a page

    Raises
    ------
    ValueError : no part, or parts of different products
    PdfError : this machine can make no PDF; the page stands beside it as HTML
    OSError : the file cannot be written
    """
    if not parts:
        raise ValueError("there is no part to report on")
    if form == "pdf":
        paper = render_parts(parts, solid, on_paper=True)
        return _write_pdf(paper, parts[0].header.part, parts[-1].header.end, path)
    return write_file(FORMS[form](parts, solid), path)


def write_html(record: RunRecord, path: Path) -> Path:
    """Write the report of a run as HTML and return its path; the file is whole or not there.

    Raises
    ------
    OSError : the file cannot be written
    """
    return write_page(render(record, qif_sha256=_qif_sha256(record)), path)


def write_run_pdf(record: RunRecord, path: Path) -> Path:
    """Write the printed pages of a run as PDF and return the path.

    Raises
    ------
    PdfError : this machine can make no PDF; the page stands beside it as HTML
    OSError : the file cannot be written
    """
    paper = render(record, on_paper=True, qif_sha256=_qif_sha256(record))
    return _write_pdf(paper, record.recipe_name, record.end, path)


def write_form3(
    made_of: RunRecord | Sequence[JudgedPart], form: str, path: Path, solid: Solid | None = None
) -> Path:
    """Write parts in the layout of Form 3 of AS9102 and return the path.

    Parameters
    ----------
    made_of : a run, or parts of one product
    form : one of `FORM3_FORMATS`
    path : any suffix
    solid : CAD model of parts without their run, for the drawing

    Raises
    ------
    ResultsError : the run has no part
    PdfError : this machine can make no PDF; the page stands beside it as HTML
    OSError : the file cannot be written
    """
    if isinstance(made_of, RunRecord):
        page, name, end = render_form3(made_of), made_of.recipe_name, made_of.end
    else:
        page, header = render_form3_parts(made_of, solid), made_of[-1].header
        name, end = header.part, header.end
    if form == "html":
        return write_page(page, path)
    return _write_pdf(page, f"{name}, characteristic accountability", end, path)


def _qif_sha256(record: RunRecord) -> str:
    """Return the SHA-256 of a run's QIF file, if it has the same bytes each time; else empty."""
    try:
        return hashlib.sha256(qif_bytes(counted_parts(record))).hexdigest()
    except ValueError:
        return ""  # no part, or parts of different products: there is no such file


def _write_pdf(paper: str, title: str, at: datetime, path: Path) -> Path:
    try:
        return write_file(pdf_bytes(paper, f"Inspection report {title}", at), path)
    except PdfError as error:
        page = write_file(paper.encode(), path.with_suffix(".html"))
        raise PdfError(f"{error}: {page}") from error


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
FORM3_FORMATS: Final = ("html", "pdf")
SUFFIXES: Final = tuple(f".{form}" for form in ("pdf", *FORMS))
