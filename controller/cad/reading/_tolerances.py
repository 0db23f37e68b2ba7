"""Semantic tolerances: the kernel's account and the file's text laid side by side.

The kernel knows what each tolerance is and which surfaces it is of. Of its numbers it loses the
sign of lower deviations, the unit of nominal values (its tolerances are converted, its nominals
are not), and widths that are written as complex records. These come from the text, by what the
kernel did keep. Traps: inspection.md 4.4.
"""

import json
import re
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..surfaces.tolerances import Datum, Dimension, GeometricTolerance, Tolerance
from ._part21 import Part21, Part21Error, Written

Array = NDArray[np.float64]

SAME_MM: Final = 1e-3  # faces of two runs of the kernel on one file are equal to the last digits
SAME: Final = 1e-6  # relative: one number through two readers
KEYWORDS: Final = {
    "ProfileOfLine": "LINE_PROFILE_TOLERANCE",
    "ProfileOfSurface": "SURFACE_PROFILE_TOLERANCE",
    "CircularityOrRoundness": "ROUNDNESS_TOLERANCE",
    "CircularRunout": "CIRCULAR_RUNOUT_TOLERANCE",
    "TotalRunout": "TOTAL_RUNOUT_TOLERANCE",
}


def tolerances_from(
    found: Mapping[str, Any], text: bytes, area_mm2: Array, mean_mm: Array, rank: NDArray[np.int64]
) -> tuple[tuple[Tolerance, ...], tuple[str, ...]]:
    """Return the tolerances with our face ids, and what was left out, in sentences.

    Parameters
    ----------
    found : what `_step_pmi_child` leaves
    text : of the file
    area_mm2, mean_mm, rank : (f,), (f, 3), (f,) of the solid's faces in the file's order, and
        their ids
    """
    told = json.loads(str(found["told"]))
    ids = _match(found["area_mm2"], found["mean_mm"], area_mm2, mean_mm, rank)
    warnings: list[str] = []
    try:
        part = Part21(text.decode("latin-1"))
        dimensions = _dimensions(told["dimensions"], part.dimensions(), ids, warnings)
        tolerances = _tolerances(told["tolerances"], part, ids, warnings)
        datums = _datums(told, part, ids, rank, warnings)
    except (Part21Error, IndexError, KeyError, TypeError, ValueError, RecursionError) as error:
        return (), (f"its tolerances were not read: the text is not as it should be ({error})",)
    return (*dimensions, *tolerances, *datums), tuple(warnings)


def _match(
    area: Array, mean: Array, area_mm2: Array, mean_mm: Array, rank: NDArray[np.int64]
) -> list[int | None]:
    """Return our id of each face of the other run; None where the solid has no such face."""
    if len(area) == 0:
        return []
    ours = np.column_stack([mean_mm, np.sqrt(np.abs(area_mm2))])
    theirs = np.column_stack([mean, np.sqrt(np.abs(area))])
    distance, nearest = cKDTree(ours).query(theirs)
    close = distance <= SAME_MM
    return [int(rank[n]) if c else None for n, c in zip(nearest, close, strict=True)]


def _faces(numbers: list[int], ids: list[int | None]) -> tuple[int, ...]:
    return tuple(sorted({i for n in numbers if (i := ids[n]) is not None}))


def _snake(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower().replace("__", "_")


def _dimensions(
    told: list[dict[str, Any]],
    written: list[Written],
    ids: list[int | None],
    warnings: list[str],
) -> list[Dimension]:
    left = list(written)
    found: list[Dimension] = []
    lost = 0
    for each in told:
        match = next((w for w in left if _is_same(each, w)), None)
        if match is None:
            lost += 1
            continue
        left.remove(match)
        lower, upper = match.deviations or (None, None)
        nominal = match.nominal
        if match.limits is not None:
            middle = sum(match.limits) / 2
            nominal = middle if nominal is None else nominal
            lower, upper = match.limits[0] - nominal, match.limits[1] - nominal
        if nominal is None or (lower is not None and upper is not None and lower > upper):
            lost += 1
            continue
        found.append(
            Dimension(
                kind=_snake(each["kind"]),
                nominal=nominal,
                lower=lower,
                upper=upper,
                faces=_faces(each["faces"], ids),
                other_faces=_faces(each["others"], ids),
                is_angle=match.is_angle,
                fit=match.fit,
            )
        )
    if lost:
        warnings.append(f"{lost} of {len(told)} dimensions have no sound value in the text")
    bare = sum(not d.faces for d in found)
    if bare:
        warnings.append(f"{bare} of {len(found)} dimensions name no surface")
    return found


def _is_same(told: dict[str, Any], written: Written) -> bool:
    """Whether the kernel's dimension, unsigned and half converted, can be that of the text."""
    limits = told.get("limits")
    if limits is not None:
        raw = written.raw[-2:] if written.limits is not None else ()
        return len(raw) == 2 and bool(np.allclose(limits, raw, rtol=SAME, atol=0))
    if written.limits is not None or not np.isclose(told["value"], written.raw[0], rtol=SAME):
        return False
    deviations = told.get("deviations")
    if deviations is None or written.deviations is None:
        return deviations is None and written.deviations is None
    sizes = np.abs(deviations)
    converted, plain = np.abs(written.deviations), np.abs(written.raw[-2:])
    return bool(
        np.allclose(sizes, converted, rtol=SAME, atol=1e-12)
        or np.allclose(sizes, plain, rtol=SAME, atol=1e-12)  # of angles
    )


def _tolerances(
    told: list[dict[str, Any]], part: Part21, ids: list[int | None], warnings: list[str]
) -> list[GeometricTolerance]:
    found: list[GeometricTolerance] = []
    lost = 0
    of_kind: dict[str, int] = {}
    for each in told:
        kind = each["kind"]
        place = of_kind.get(kind, 0)
        of_kind[kind] = place + 1
        value = float(each["value_mm"])
        if value == 0.0:  # the kernel passes over widths written as complex records
            keyword = KEYWORDS.get(kind, f"{_snake(kind).upper()}_TOLERANCE")
            widths = part.magnitudes_mm(keyword)
            if len(widths) == sum(t["kind"] == kind for t in told):
                value = widths[place]
        if not value > 0.0:  # real files hold negative ones
            lost += 1
            continue
        found.append(
            GeometricTolerance(
                kind=_snake(kind),
                value_mm=value,
                is_diameter=each["zone"] in {"Diameter", "SphericalDiameter"},
                datums=tuple(each["datums"]),
                faces=_faces(each["faces"], ids),
                at_maximum_material=each["material"] == "M",
            )
        )
    if lost:
        warnings.append(f"{lost} of {len(told)} geometric tolerances have no positive width")
    return found


def _datums(
    told: dict[str, Any],
    part: Part21,
    ids: list[int | None],
    rank: NDArray[np.int64],
    warnings: list[str],
) -> list[Datum]:
    """Return each letter once; the kernel lists it once per tolerance that refers to it."""
    faces: dict[str, set[int]] = {}
    for each in told["datums"]:
        if each["letter"]:
            faces.setdefault(each["letter"], set()).update(_faces(each["faces"], ids))
    shell = part.shell_faces()
    if len(shell) == len(rank):  # the kernel keeps their order
        place = {face: int(rank[i]) for i, face in enumerate(shell)}
        for letter, surfaces in part.datum_surfaces().items():
            faces.setdefault(letter, set()).update(place[f] for f in surfaces if f in place)
    bare = [letter for letter, of in faces.items() if not of]
    if bare:
        warnings.append(f"datum {', '.join(sorted(bare))} names no surface")
    return [Datum(letter, tuple(sorted(faces[letter]))) for letter in sorted(faces)]
