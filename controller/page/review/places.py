"""Findings of a part by place: one chip in a dozen pictures needs one decision."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.arrays import FloatArray
from controller.inspection import by_place


@dataclass(frozen=True, slots=True)
class FindingsPlace:
    """One place of a part, with the findings there.

    Attributes
    ----------
    plainest : the finding that tells most, as `controller.history` has it
    others : the rest
    said : person's verdict on all of them; empty without one, or where they differ
    """

    plainest: Mapping[str, Any]
    others: tuple[Mapping[str, Any], ...]
    said: str

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of all findings there."""
        return tuple(int(one["number"]) for one in (self.plainest, *self.others))


@dataclass(frozen=True, eq=False, slots=True)
class _Seen:
    kind: str
    face_ids: Sequence[str]
    size_mm: float
    p_part_mm: FloatArray


def places_of(findings: Sequence[Mapping[str, Any]]) -> list[FindingsPlace]:
    """Return a part's findings place by place, by the rule of its verdict; proven ones first.

    A finding without a known place on the part is listed alone.

    Parameters
    ----------
    findings : findings of one part, as `controller.history` has them
    """
    placed = [one for one in findings if _point(one) is not None]
    groups = [[placed[i] for i in members] for members in by_place([_seen(one) for one in placed])]
    groups += [[one] for one in findings if _point(one) is None]
    found = [_place(sorted(group, key=_rank)) for group in groups]
    return sorted(found, key=lambda place: _rank(place.plainest))


def _place(group: Sequence[Mapping[str, Any]]) -> FindingsPlace:
    said = {str(one["review"] or "") for one in group}
    return FindingsPlace(group[0], tuple(group[1:]), said.pop() if len(said) == 1 else "")


def _rank(one: Mapping[str, Any]) -> tuple[bool, float, int]:
    return one["verdict"] != "fail", -float(one["size_mm"]), int(one["number"])


def _point(one: Mapping[str, Any]) -> FloatArray | None:
    at = [one["x_mm"], one["y_mm"], one["z_mm"]]
    return None if None in at else np.array(at, dtype=float)


def _seen(one: Mapping[str, Any]) -> _Seen:
    point = _point(one)
    assert point is not None
    return _Seen(str(one["kind"]), one["faces"], float(one["size_mm"]), point)
