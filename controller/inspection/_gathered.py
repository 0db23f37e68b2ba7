"""Merge findings of several pictures into one finding per place of the part.

One chip shows in a dozen pictures: as missing material before the panel, as a pit under lamps. The
verdict must report it once.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Solid
from messages import joined, say

from ._types import Finding, FindingKind, Verdict

# Smallest area reported for a finding, a few pixels. Areas have one decimal in the report, and a
# smaller one would read as zero.
MIN_AREA_MM2: Final = 0.1
# Distance allowed between the findings of one place: poses have errors, and each view sees another
# portion of a defect.
BETWEEN_MM: Final = 1.0
# Kinds from the most to the least informative: findings of shape before findings of brightness.
TELLING: Final = (
    FindingKind.CHIP,
    FindingKind.BURR,
    FindingKind.MISSING,
    FindingKind.EXTRA,
    FindingKind.DIMENSION,
    FindingKind.MISSING_EDGE,
    FindingKind.SURFACE,
    FindingKind.SCRATCH,
    FindingKind.PIT,
    FindingKind.DENT,
    FindingKind.STAIN,
)
MAX_FACES: Final = 2  # largest number of faces named in a sentence


class Seen(Protocol):
    """Location of a finding; its faces by number or by name."""

    @property
    def kind(self) -> str:
        """One of `FindingKind`."""

    @property
    def face_ids(self) -> Sequence[int | str]:
        """Faces that it lies on."""

    @property
    def size_mm(self) -> float:
        """Longest extent."""

    @property
    def p_part_mm(self) -> FloatArray:
        """Centre (3,) in the part's frame."""


@dataclass(frozen=True, eq=False, slots=True)
class PlacedFinding:
    """A place where the part differs from the CAD model, with all looks at it.

    Attributes
    ----------
    view_id, plainest : view and finding of the most informative look
    looks : all looks, with their views
    verdict : FAIL where it is proven, INDETERMINATE where it may be something else
    size_mm, area_mm2 : largest values of all looks
    face_ids : surfaces it lies on; those shown by most looks first
    """

    view_id: str
    plainest: Finding
    looks: tuple[tuple[str, Finding], ...]
    verdict: Verdict
    size_mm: float
    area_mm2: float
    face_ids: tuple[int, ...]

    def sentence(self, solid: Solid) -> str:
        """Return the finding as a sentence without a full stop."""
        where = joined(" and ", (solid.faces[i].label for i in self.face_ids[:MAX_FACES]))
        one = self.plainest
        size = say(
            "{size_mm:.1f} mm across, {area_words} mm2",
            size_mm=self.size_mm,
            area_words=area_words(self.area_mm2),
        )
        words = say(
            "{kind} at {where}: {words}, view {view_id}, {lamp}",
            kind=one.kind,
            where=where,
            words=one.words or size,
            view_id=self.view_id,
            lamp=one.lamp,
        )
        pictures = {(view_id, f.lamp) for view_id, f in self.looks}
        if len(pictures) > 1:
            words += say("; shown in {pictures_count} pictures", pictures_count=len(pictures))
        return words


def area_words(area_mm2: float) -> str:
    """Return an area with two digits, or one for a small area."""
    if area_mm2 >= 9.5:
        return say("{area_mm2:.0f}", area_mm2=area_mm2)
    return say("{area_mm2:.1f}", area_mm2=area_mm2)


def gather(looks: Sequence[tuple[str, Finding, Verdict]]) -> tuple[PlacedFinding, ...]:
    """Return the findings of all pictures merged by place: proven ones first, then by area.

    Parameters
    ----------
    looks : view, finding, and its verdict
    """
    places = by_place([finding for _, finding, _ in looks])
    found = [_placed([looks[i] for i in members]) for members in places]
    return tuple(sorted(found, key=lambda f: (f.verdict is not Verdict.FAIL, -f.area_mm2)))


def by_place(findings: Sequence[Seen]) -> list[list[int]]:
    """Return the indices of findings grouped by place; places in the order of their first finding.

    Parameters
    ----------
    findings : findings of one part
    """
    place = list(range(len(findings)))
    for i, one in enumerate(findings):
        for j in range(i):
            if place[i] != place[j] and _is_one(one, findings[j]):
                low, high = sorted((place[i], place[j]))
                place = [low if number == high else number for number in place]
    return [[i for i, own in enumerate(place) if own == n] for n in dict.fromkeys(place)]


def _placed(looks: Sequence[tuple[str, Finding, Verdict]]) -> PlacedFinding:
    view_id, plainest, verdict = min(looks, key=_rank)
    # Among faces shown by equally many looks, those of the plainest look come first.
    shown = Counter(
        face for _, f, _ in ((view_id, plainest, verdict), *looks) for face in f.face_ids
    )
    return PlacedFinding(
        view_id,
        plainest,
        tuple((view, f) for view, f, _ in looks),
        verdict,
        max(f.size_mm for _, f, _ in looks),
        max(MIN_AREA_MM2, *(f.area_mm2 for _, f, _ in looks)),
        tuple(face for face, _ in shown.most_common()),
    )


def _rank(look: tuple[str, Finding, Verdict]) -> tuple[bool, bool, int, float]:
    _, finding, verdict = look
    is_proven = verdict is Verdict.FAIL
    return not is_proven, not finding.words, TELLING.index(finding.kind), -finding.area_mm2


def _is_one(one: Seen, other: Seen) -> bool:
    """Return True if two findings show the same thing: their extents meet.

    An edge or a face that is out of place is long, and a finding near its middle need not belong to
    it. Such a finding must also share a face with it.
    """
    far = {FindingKind.DIMENSION, FindingKind.MISSING_EDGE} & {one.kind, other.kind}
    if far and not set(one.face_ids) & set(other.face_ids):
        return False
    reach = BETWEEN_MM + 0.5 * (one.size_mm + other.size_mm)
    return bool(np.linalg.norm(other.p_part_mm - one.p_part_mm) <= reach)
