"""What was said of a specimen against what is true of it: verdict, place, sizes; rates with limits.

Truth is a truth.json as benchmarks/trace_held.py writes it; what was said are the lines of
`cellctl inspect --json`. Nothing of the room is imported: the judge is judged from outside.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

Array = NDArray[np.float64]
Words = dict[str, Any]

CONFIDENCE = 0.95
NEAR_MM = 4.0  # of a finding to the place of the defect, beyond half of their sizes
ON_AXIS_MM = 1.5  # of a characteristic to the axis of the hole that it is of
END_MM = 1.0  # beyond the ends of the hole
SAME_SIZE_MM = 0.06  # of nominal diameters
ANYWHERE = ("mirrored", "wrong_part", "wrong_revision")  # the whole part is wrong
HOLES = (
    "hole_missing",
    "hole_filled",
    "hole_half_deep",
    "hole_depth_off",
    "hole_too_deep",
    "hole_position",
    "hole_small",
    "hole_large",
)


@dataclass(frozen=True)
class Compared:
    """One value against truth.

    Attributes
    ----------
    kind : diameter, position or distance
    error_mm, U_mm : measured less true, and the uncertainty stated (k = 2)
    nominal_mm : size of the feature
    """

    kind: str
    error_mm: float
    U_mm: float
    nominal_mm: float


def upper_limit(count: int, total: int) -> float:
    """Return the exact one-sided upper limit of a rate (Clopper and Pearson), 95 %."""
    if count >= total:
        return 1.0
    return float(beta.ppf(CONFIDENCE, count + 1, total - count))


def lower_limit(count: int, total: int) -> float:
    """Return the exact one-sided lower limit of a rate, 95 %."""
    return 0.0 if count == 0 else float(beta.ppf(1 - CONFIDENCE, count, total - count + 1))


def compare(truth: Words, lines: Iterable[Words]) -> list[Compared]:
    """Return what was measured against truth, as far as truth is known.

    Parameters
    ----------
    truth : of the specimen
    lines : of the command
    """
    out = []
    for line in lines:
        if line.get("event") != "characteristic" or line.get("measured_mm") is None:
            continue
        true = true_value(truth, line)
        if true is not None and line.get("U_mm"):
            out.append(
                Compared(line["kind"], line["measured_mm"] - true, line["U_mm"], line["nominal_mm"])
            )
    return out


def true_value(truth: Words, line: Words) -> float | None:
    """Return the true value of a characteristic; None where it is not known.

    Parameters
    ----------
    truth : of the specimen
    line : of the characteristic
    """
    axis = np.array(line["axis"])
    hole = hole_of(truth, line) if line["kind"] in ("diameter", "position") else None
    if line["kind"] == "diameter":
        return None if hole is None or not hole["exists"] else float(hole["true_d_mm"])
    if line["kind"] == "position":
        if hole is None or not hole["exists"] or "dims" not in truth:
            return None
        off = np.mean(hole["true_ends"], axis=0) - np.mean(hole["nominal_ends"], axis=0)
        along = np.array(hole["axis"])
        return float(np.linalg.norm(off - (off @ along) * along))
    if line["kind"] in ("distance", "length") and truth["cls"] != "defect":
        return float(line["nominal_mm"] * np.linalg.norm(np.array(truth["scale"]) * axis))
    return None


def hole_of(truth: Words, line: Words) -> Words | None:
    """Return the hole that a characteristic is of, by its axis; None where there is none.

    Parameters
    ----------
    truth : of the specimen
    line : of the characteristic
    """
    axis, at = np.array(line["axis"]), np.array(line["p_part_mm"])
    for hole in truth.get("holes", []):
        along = np.array(hole["axis"])
        if abs(along @ axis) < 0.99:
            continue
        if line["kind"] == "diameter" and (
            abs(hole["nominal_d_mm"] - line["nominal_mm"]) > SAME_SIZE_MM
        ):
            continue
        mouth, bottom = np.array(hole["nominal_ends"])
        off = at - mouth
        s, length = float(off @ along), float((bottom - mouth) @ along)
        is_beside = np.linalg.norm(off - s * along) > ON_AXIS_MM
        if not is_beside and min(length, 0.0) - END_MM < s < max(length, 0.0) + END_MM:
            found: Words = hole
            return found
    return None


def is_at_place(truth: Words, line: Words) -> bool:
    """Whether a finding or a characteristic is where the defect is.

    Parameters
    ----------
    truth : of the specimen
    line : of the finding, or of the characteristic
    """
    if truth["kind"] in ANYWHERE:
        return True
    if truth.get("place_mm") is None:
        return False
    place, at = np.array(truth["place_mm"]), np.array(line["p_part_mm"])
    if line["event"] == "characteristic":
        if truth["kind"] in HOLES:
            hole = hole_of(truth, {**line, "kind": "position"})
            return hole is not None and hole["id"] in truth["faces"]
        if truth["kind"] == "face_off":
            normal = np.array(truth["faces"][0]["normal"])
            return bool(abs(normal @ np.array(line["axis"])) > 0.9)
    reach = NEAR_MM + 0.5 * (truth["size_mm"] or 0.0) + 0.5 * line.get("size_mm", 0.0)
    places = np.array([place, *truth.get("places_mm", [])])
    if truth["kind"] in HOLES:  # anywhere along the hole
        for hole in truth.get("holes", []):
            if hole["id"] in truth["faces"]:
                mouth, bottom = np.array(hole["nominal_ends"])
                places = np.vstack(
                    [places, mouth + np.linspace(0, 1, 9)[:, None] * (bottom - mouth)]
                )
                reach += 0.5 * hole["nominal_d_mm"]
    if truth["kind"] == "face_off":  # the whole face, and the edges round it
        normal = np.array(truth["faces"][0]["normal"])
        return bool(abs((at - place) @ normal) < NEAR_MM)
    return bool(np.linalg.norm(places - at, axis=1).min() < reach)


def accused(lines: Iterable[Words]) -> list[Words]:
    """Return findings and characteristics that failed."""
    return [line for line in lines if line.get("verdict") == "fail" and line["event"] != "verdict"]


@dataclass(frozen=True)
class Judged:
    """One specimen's outcome.

    Attributes
    ----------
    specimen : its folder's name
    cls, kind, part : what it is
    verdict : pass, fail, indeterminate or error
    is_shown : a view shows the defect
    is_found : something at the right place was failed
    is_hinted : something at the right place was failed or left open
    elsewhere : how much was failed that is not at the right place
    seconds : by the command, a view
    compared : measured against truth
    message : of an error
    """

    specimen: str
    cls: str
    kind: str
    part: str
    verdict: str
    is_shown: bool
    is_found: bool
    is_hinted: bool
    elsewhere: int
    seconds: float
    compared: tuple[Compared, ...]
    message: str = ""


def judged(truth: Words, lines: Sequence[Words], view_count: int, message: str = "") -> Judged:
    """Return what lines of the command are worth.

    Parameters
    ----------
    truth : of the specimen
    lines : the command's, none where it failed
    view_count : of the set
    message : what it said where it failed
    """
    ends = [line for line in lines if line["event"] == "verdict"]
    failed = accused(lines)
    at_place = [line for line in failed if is_at_place(truth, line)]
    is_defect = truth["cls"] == "defect"
    hinted = [
        line
        for line in lines
        if line["event"] != "verdict"
        and line["verdict"] in ("fail", "indeterminate")
        and is_at_place(truth, line)
    ]
    return Judged(
        specimen=truth["specimen"],
        cls=truth["cls"],
        kind=truth["kind"],
        part=truth["part"],
        verdict=ends[-1]["verdict"] if ends else "error",
        is_shown=bool(truth.get("visible_views")),
        is_found=is_defect and bool(at_place),
        is_hinted=is_defect and bool(hinted),
        elsewhere=len(failed) - (len(at_place) if is_defect else 0),
        seconds=ends[-1]["seconds"] / max(view_count, 1) if ends else float("nan"),
        compared=tuple(compare(truth, lines)),
        message=message,
    )
