"""Sets of views of good parts: the block of `shown_part` in one view, each slipped a little."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import view_sets
from cad_solids import Body, mesh_of
from shown_part import blank, hand, moved, perfect, photograph

from controller.inspection import ViewPictures

VIEW = "v00"
SLIP_MM, TURN_DEG = 0.2, 0.2  # standard deviations of how a part lies in the jaws


@cache
def pictures(seed: int, body: str = "perfect") -> ViewPictures:
    """The pictures of one part; of a block without bores by another name."""
    rng = np.random.default_rng(seed)
    x, y, z = rng.normal(0.0, SLIP_MM, 3).tolist()
    T = moved(view_sets.POSES[VIEW], (x, y, z), float(rng.normal(0.0, TURN_DEG)))
    real: Body = perfect() if body == "perfect" else blank()
    return photograph(real, T, hand(T))


def tree() -> dict[str, Any]:
    """The set as its file has it."""
    return view_sets.tree() | {"views": [view_sets.view(VIEW, view_sets.POSES[VIEW])]}


def write_pictures(folder: Path, seed: int, body: str = "perfect") -> None:
    """Write the pictures of a part."""
    folder.mkdir(parents=True, exist_ok=True)
    shots = pictures(seed, body)
    for lamp, picture in {"backlight": shots.backlit, **shots.lit}.items():
        cv2.imwrite(str(folder / f"{VIEW}_{lamp}.png"), picture)


def write(folder: Path, seed: int, body: str = "perfect") -> Path:
    """Write part, pictures and set; return the set's file."""
    write_pictures(folder, seed, body)
    mesh_of(perfect()).export(folder / "shown.stl")
    path = folder / "SET.json"
    path.write_text(json.dumps(tree()), encoding="utf-8")
    return path


def write_some(folder: Path, count: int) -> list[Path]:
    """Write the sets of some good parts; return their files."""
    return [write(folder / f"p{seed}", seed) for seed in range(count)]
