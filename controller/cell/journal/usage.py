"""The runs' use of calibrations: how many used each, and how well arm and camera agreed."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np

from controller.config.calibrations import Usage

from . import rows
from ._form import Row
from .rows import is_of

MIN_VIEWS: Final = 3  # views of a grasp; fewer always agree


def usage_of(found: Iterable[Row]) -> Mapping[str, Usage]:
    """Return the runs' use of calibrations, by the hash of the calibration's file.

    Parameters
    ----------
    found : rows of runs that began, and of how views were posed; others are passed over
    """
    used_by: dict[str, tuple[str, ...]] = {}
    off_mm: dict[str, list[float]] = defaultdict(list)
    for row in found:
        if is_of(row, rows.RunBegan):
            used = row.body.get("cell", {}).get("calibration", {})
            used_by[row.run] = tuple(one.get("sha256", "") for one in used.values())
        elif is_of(row, rows.ViewsPosed):
            off = views_off_mm(rows.ViewsPosed.model_validate(row.body))
            if off is not None:
                for digest in used_by.get(row.run, ()):
                    off_mm[digest].append(off)
    counts: dict[str, int] = defaultdict(int)
    for digests in used_by.values():
        for digest in digests:
            counts[digest] += 1
    return {digest: Usage(count, tuple(off_mm[digest])) for digest, count in counts.items()}


def views_off_mm(posed: rows.ViewsPosed) -> float | None:
    """Return the root mean square of the disagreement of arm and camera [mm].

    Grasps shown in fewer than three views are not counted; None if all are such.
    """
    by_grasp: dict[int, list[float]] = defaultdict(list)
    for one in posed.views:
        by_grasp[one.grasp].append(one.off_mm)
    kept = [off for views in by_grasp.values() if len(views) >= MIN_VIEWS for off in views]
    return float(np.sqrt(np.mean(np.square(kept)))) if kept else None
