"""Files the tests read: CAD parts, pictures and board pictures that came from elsewhere.

`tests/data/README.md` names source and licence of each. A part that the recipes use, too, stands
in `recipes/parts` alone.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

DATA = Path(__file__).resolve().parent / "data"
PICTURES = DATA / "pictures"
BOARDS = DATA / "boards"
PART_FOLDERS = (DATA / "parts", Path(__file__).resolve().parents[1] / "recipes" / "parts")


def part_file(name: str) -> Path:
    """Return the CAD file of a name, such as `holder.stl`.

    Raises
    ------
    FileNotFoundError : neither folder has it
    """
    for folder in PART_FOLDERS:
        if (folder / name).is_file():
            return folder / name
    raise FileNotFoundError(name)


def listed_parts() -> list[dict[str, Any]]:
    """Return what the collector of the parts wrote down of each: volume, centroid, stable poses."""
    return list(json.loads((DATA / "parts" / "manifest.json").read_text())["parts"])


def true_pictures() -> dict[str, Any]:
    """Return what lies where in the pictures, and the camera that took them."""
    return dict(json.loads((PICTURES / "truth.json").read_text()))
