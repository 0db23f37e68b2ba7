"""Writes judged parts to a file; its suffix decides what it is."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from .exports import csv_text, dfq_bytes, qif_bytes
from .judged import JudgedPart, result_json
from .pages import write_file


def write_report(parts: Sequence[JudgedPart], path: Path) -> Path:
    """Write a report of judged parts and return its path; the file is whole or not there.

    Parameters
    ----------
    parts : of one product, at least one
    path : its suffix is one of `SUFFIXES`

    Raises
    ------
    ValueError : another suffix, no part, or parts of different products
    OSError : the file cannot be written
    """
    form = path.suffix.lower().removeprefix(".")
    if form not in FORMS:
        raise ValueError(f"{path.name}: the suffix of a report is one of {', '.join(SUFFIXES)}")
    return write_parts(parts, form, path)


def write_parts(parts: Sequence[JudgedPart], form: str, path: Path) -> Path:
    """Write judged parts in a given form and return the path.

    Parameters
    ----------
    parts : of one product, at least one
    form : a key of `FORMS`
    path : any suffix

    Raises
    ------
    ValueError : no part, or parts of different products
    OSError : the file cannot be written
    """
    if not parts:
        raise ValueError("there is no part to report on")
    return write_file(FORMS[form](parts), path)


def _json(parts: Sequence[JudgedPart]) -> bytes:
    """Return one result as an object, several as a list."""
    found = [result_json(judged) for judged in parts]
    text = json.dumps(found[0] if len(found) == 1 else found, indent=1, ensure_ascii=False)
    return text.encode()


FORMS: Final[Mapping[str, Callable[[Sequence[JudgedPart]], bytes]]] = {
    "json": _json,
    "csv": lambda parts: csv_text(parts).encode("utf-8-sig"),  # so that Excel reads it as UTF-8
    "qif": qif_bytes,
    "dfq": dfq_bytes,
}
SUFFIXES: Final = tuple(f".{form}" for form in FORMS)
