"""Semantic tolerances: the kernel's account and the file's text, side by side.

The kernel provides each tolerance and its surfaces. Of its numbers it loses the sign of lower
deviations, the unit of nominal values (it converts tolerances, but nominal values and limits only
where they have no number of decimals), and widths written as complex records. These are read from
the text and matched with the kernel's data. Traps: cell-facts.md 4.
"""

import json
import re
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from controller.arrays import FloatArray, IntArray

from ...surfaces.tolerances import Datum, Dimension, GeometricTolerance, Tolerance
from .part21 import Part21, Part21Error, Written

SAME_MM: Final = 1e-3  # faces of two runs of the kernel on one file are equal to the last digits
SAME: Final = 1e-6  # relative difference of one number read by two readers
PLAIN: Final = (  # whose keyword is the kernel's name and _TOLERANCE
    *("Angularity", "Coaxiality", "Concentricity", "Cylindricity", "Flatness", "Parallelism"),
    *("Perpendicularity", "Position", "Straightness", "Symmetry"),
)
KEYWORDS: Final = {f: f"{f.upper()}_TOLERANCE" for f in PLAIN} | {
    "ProfileOfLine": "LINE_PROFILE_TOLERANCE",
    "ProfileOfSurface": "SURFACE_PROFILE_TOLERANCE",
    "CircularityOrRoundness": "ROUNDNESS_TOLERANCE",
    "CircularRunout": "CIRCULAR_RUNOUT_TOLERANCE",
    "TotalRunout": "TOTAL_RUNOUT_TOLERANCE",
}


def tolerances_from(
    found: Mapping[str, Any],
    text: bytes,
    area_mm2: FloatArray,
    mean_mm: FloatArray,
    rank: IntArray,
    *,
    is_whole_file: bool = True,
) -> tuple[tuple[Tolerance, ...], tuple[str, ...]]:
    """Return the tolerances with our face ids, and sentences on those left out.

    Parameters
    ----------
    found : output of `_step_pmi_child`
    text : text of the file
    area_mm2, mean_mm, rank : (f,), (f, 3), (f,) of the solid's faces in the file's order, and
        their ids
    is_whole_file : whether the solid is the file's only one; otherwise what names no surface of it
        is another's
    """
    stated = json.loads(str(found["pmi"]))
    ids = _match(found["area_mm2"], found["mean_mm"], area_mm2, mean_mm, rank)
    warnings: list[str] = []
    try:
        part = Part21(text.decode("latin-1"))
        dimensions = _dimensions(stated["dimensions"], part.dimensions(), ids, warnings)
        tolerances = _tolerances(stated["tolerances"], part, ids, warnings)
        datums = _datums(stated, part, ids, rank)
    except (Part21Error, IndexError, KeyError, TypeError, ValueError, RecursionError) as error:
        return (), (f"its tolerances were not read: the text is not as it should be ({error})",)
    every: tuple[Tolerance, ...] = (*dimensions, *tolerances, *datums)
    if is_whole_file:
        bare = sum(not d.faces for d in dimensions)
        if bare:
            warnings.append(f"{bare} of {len(dimensions)} dimensions name no surface")
        letters = sorted(datum.letter for datum in datums if not datum.faces)
        if letters:
            warnings.append(f"datum {', '.join(letters)} names no surface")
        return every, tuple(warnings)
    of_others = [f"of all bodies of the file: {warning}" for warning in warnings]
    return tuple(one for one in every if one.faces), tuple(of_others)


def _match(
    area: FloatArray,
    mean: FloatArray,
    area_mm2: FloatArray,
    mean_mm: FloatArray,
    rank: IntArray,
) -> list[int | None]:
    """Return our id of each face of the other run; None where the solid has no such face."""
    if len(area) == 0:
        return []
    ours = np.column_stack([mean_mm, np.sqrt(np.abs(area_mm2))])
    theirs = np.column_stack([mean, np.sqrt(np.abs(area))])
    distance, nearest = cKDTree(ours).query(theirs)
    close = np.asarray(distance <= SAME_MM)
    return [int(rank[n]) if c else None for n, c in zip(np.asarray(nearest), close, strict=True)]


def _faces(numbers: list[int], ids: list[int | None]) -> tuple[int, ...]:
    return tuple(sorted({i for n in numbers if (i := ids[n]) is not None}))


def _snake(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower().replace("__", "_")


def _dimensions(
    stated: list[dict[str, Any]],
    written: list[Written],
    ids: list[int | None],
    warnings: list[str],
) -> list[Dimension]:
    left = list(written)
    found: list[Dimension] = []
    lost: list[str] = []
    for each in stated:
        match = next((w for w in left if _is_same(each, w)), None)
        if match is None:
            lost.append(f"{_snake(each['kind'])} {each['value']:g}")
            continue
        left.remove(match)
        lower, upper = match.deviations or (None, None)
        nominal = match.nominal
        if match.limits is not None:
            middle = sum(match.limits) / 2
            nominal = middle if nominal is None else nominal
            lower, upper = match.limits[0] - nominal, match.limits[1] - nominal
        if nominal is None:
            lost.append(str(match))
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
        warnings.append(
            f"{len(lost)} of {len(stated)} dimensions have no value in the text: {', '.join(lost)}"
        )
    if left:
        warnings.append(
            f"{len(left)} of {len(written)} dimensions of the text are not among the kernel's: "
            + ", ".join(str(one) for one in left)
        )
    return found


def _is_same(stated: dict[str, Any], written: Written) -> bool:
    """Return True if the kernel's dimension, unsigned and half converted, can be the text's."""
    limits, deviations = stated.get("limits"), stated.get("deviations")
    if limits is not None and written.deviations is not None and written.nominal is not None:
        # of deviations whose upper one comes first the kernel makes these limits
        upper = abs(written.deviations[1])
        return _are_close(limits[:1], [written.nominal], written.raw[:1]) and _are_close(
            limits[1:], [upper], np.abs(written.raw[-1:])
        )
    if limits is not None:
        return written.limits is not None and _are_close(
            np.sort(limits), written.limits, np.sort(written.raw[-2:])
        )
    if written.limits is not None or (deviations is None) != (written.deviations is None):
        return False
    nominal = [written.nominal or 0.0]
    if not _are_close([stated["value"]], nominal, written.raw[:1]):
        return False
    if deviations is None or written.deviations is None:
        return True
    stated_size, size, raw_size = (
        np.sort(np.abs(values)) for values in (deviations, written.deviations, written.raw[-2:])
    )
    return _are_close(stated_size, size, raw_size)


def _are_close(stated: ArrayLike, converted: ArrayLike, raw: ArrayLike) -> bool:
    """Return True if numbers are those of the text; the kernel converts only some records."""
    return any(
        bool(np.allclose(stated, written, rtol=SAME, atol=1e-12)) for written in (converted, raw)
    )


def _tolerances(
    stated: list[dict[str, Any]], part: Part21, ids: list[int | None], warnings: list[str]
) -> list[GeometricTolerance]:
    found: list[GeometricTolerance] = []
    lost = 0
    of_kind: dict[str, int] = {}
    for each in stated:
        kind = each["kind"]
        place = of_kind.get(kind, 0)
        of_kind[kind] = place + 1
        value = float(each["value_mm"])
        if value == 0.0:  # the kernel passes over widths written as complex records
            widths = part.magnitudes_mm(KEYWORDS[kind]) if kind in KEYWORDS else []
            if len(widths) == sum(t["kind"] == kind for t in stated):
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
        warnings.append(f"{lost} of {len(stated)} geometric tolerances have no positive width")
    in_text = sum(len(part.magnitudes_mm(keyword)) for keyword in KEYWORDS.values())
    if in_text > len(stated):
        warnings.append(
            f"{in_text - len(stated)} of {in_text} geometric tolerances are passed over"
        )
    return found


def _datums(
    stated: dict[str, Any],
    part: Part21,
    ids: list[int | None],
    rank: IntArray,
) -> list[Datum]:
    """Return each datum letter once; the kernel lists it for every tolerance that uses it."""
    faces: dict[str, set[int]] = {}
    for each in stated["datums"]:
        if each["letter"]:
            faces.setdefault(each["letter"], set()).update(_faces(each["faces"], ids))
    # the kernel keeps their order
    place = {face: int(rank[i]) for i, face in enumerate(part.faces_of_solid(len(rank)))}
    if place:
        for letter, surfaces in part.datum_surfaces().items():
            faces.setdefault(letter, set()).update(place[f] for f in surfaces if f in place)
    return [Datum(letter, tuple(sorted(faces[letter]))) for letter in sorted(faces)]
