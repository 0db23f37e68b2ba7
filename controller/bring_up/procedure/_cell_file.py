"""The cell file as commissioned: the drawing's text, with a section that names the calibrations."""

import hashlib
import json
import re
from collections.abc import Mapping

from controller.config import Cell
from controller.config.calibration_reference import CalibrationName, CalibrationReference

KEY = "calibration"
_TOP_LEVEL = re.compile(r"^[^\s#]")
HEADER = """
# Measured by `cellctl commission`: these values take the place of those above. Each file is named
# with its hash, so that neither changes without the other.
"""


def cell_digest(cell: Cell) -> str:
    """Return the SHA-256 of a cell file's content without comments, addresses and calibrations.

    Defaults are left out too: a key that a later version adds does not change the cell.

    Parameters
    ----------
    cell : as its file has it, without what calibrations changed
    """
    tree = cell.model_dump(mode="json", by_alias=True, exclude_defaults=True)
    tree.pop(KEY, None)
    tree.pop("clock", None)
    for section in tree["devices"].values():
        section.pop("address", None)
    return hashlib.sha256(json.dumps(tree, sort_keys=True).encode()).hexdigest()


def calibrated_text(text: str, references: Mapping[CalibrationName, CalibrationReference]) -> str:
    """Return a cell file's text with its calibrations in place of those it had.

    All else stays to the letter, comments included.

    Parameters
    ----------
    text : text of the cell file
    references : file and hash of each calibration; empty takes the section out
    """
    kept = without_calibrations(text)
    if not references:
        return kept
    rows = [
        f"  {name}: {{file: {json.dumps(one.file)}, sha256: {one.sha256}}}"
        for name, one in references.items()
    ]
    return "\n".join([kept.rstrip("\n"), HEADER.rstrip("\n"), f"{KEY}:", *rows]) + "\n"


def without_calibrations(text: str) -> str:
    """Return a cell file's text without the section that names calibrations."""
    kept: list[str] = []
    is_inside = False
    for line in text.replace(HEADER, "\n").splitlines(keepends=True):
        if _TOP_LEVEL.match(line):
            is_inside = line.split(":")[0].strip("\"' ") == KEY
        if not is_inside:
            kept.append(line)
    return "".join(kept).rstrip("\n") + "\n"
