"""Which grips to hold the part with, one after the other: by what they show, then by seconds.

One hand-off is the floor wherever pads hide surface, and for this cell's parts it is enough
(planning.md 0.3), so sequences have one grip or two with the fixture between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..layout import CellLayout, FloatArray
from ..prepared import PreparedPart
from ._cover import View, cover

SQUARE_WORTH = 0.3  # a main face seen square counts this much of its area on top
RANKED_N = 24  # grip sequences whose views are worked out


@dataclass(frozen=True, slots=True)
class GripSequence:
    """A grip to pick with and, unless it does alone, a fixture grip and a grip after."""

    first: int
    fixture: int = -1
    second: int = -1

    @property
    def grips(self) -> tuple[int, ...]:
        return (self.first,) if self.second < 0 else (self.first, self.second)


def ranked_sequences(
    part: PreparedPart, layout: CellLayout, pickable: Sequence[int]
) -> list[tuple[GripSequence, list[View]]]:
    """Return grip sequences with their views, the best first."""
    options, weights = part.options, part.weights
    covered = part.covered.astype(np.float32) * weights.astype(np.float32)
    own = covered.sum(axis=1)
    both = own[:, None] + own[None] - covered @ part.covered.T.astype(np.float32)
    faces, square = _squares(part)
    single = own + SQUARE_WORTH * (square @ faces)
    pair = (
        both
        + SQUARE_WORTH * np.einsum("gf,hf,f->gh", 1.0 - square, 1.0 - square, -faces)
        + SQUARE_WORTH * faces.sum()
    )
    found: list[tuple[float, float, GripSequence]] = []
    able = set(pickable)
    for f, table in enumerate(part.hand_offs):
        members = sorted(table)
        for g in members:
            if g not in able:
                continue
            for h in members:
                if h != g:
                    turn_s = np.abs(table[g].retreat[-1] - table[h].retreat[-1])
                    seconds = float((turn_s / np.array(layout.pace.joint_per_s)).max())
                    risk = 3.0 - sum(
                        x.score
                        for x in (part.arm_grips[g], part.arm_grips[h], part.fixture_grips[f])
                    )
                    found.append((float(pair[g, h]), seconds + 6.0 * risk, GripSequence(g, f, h)))
    alone = [
        (float(single[g]), 6.0 * (1.0 - part.arm_grips[g].score), GripSequence(g)) for g in pickable
    ]
    best_pair = max((v for v, *_ in found), default=-1.0)
    best_alone = max((v for v, *_ in alone), default=-1.0)
    # nearly equal worth is equal: then the quicker and surer one
    found.sort(key=lambda c: (-np.floor((c[0] - best_pair) / 0.004), c[1], c[2].grips))
    alone.sort(key=lambda c: (-np.floor((c[0] - best_alone) / 0.004), c[1], c[2].grips))
    if best_pair >= best_alone + options.hand_off_gain:
        ordered = _varied(found)[:RANKED_N] + alone[:3]
    else:
        ordered = alone[:RANKED_N] + _varied(found)[:3]
    result = []
    for place, (_, seconds, sequence) in enumerate(ordered):
        views = cover(part, sequence.grips)
        if views:
            cost = seconds + len(views) * (layout.pace.look_s + 2.0)
            kind = 0 if place < RANKED_N else 1
            seen = np.zeros(len(weights), dtype=bool)
            for phase, v in views:
                seen |= part.shown_by(sequence.grips[phase])[v]
            result.append((kind, -round(float(weights[seen].sum()), 2), cost, sequence, views))
    result.sort(key=lambda r: (r[0], r[1], r[2], r[3].grips, r[3].fixture))
    return [(sequence, views) for *_, sequence, views in result]


def _varied(
    ranked: list[tuple[float, float, GripSequence]], per_last: int = 3
) -> list[tuple[float, float, GripSequence]]:
    """Keep few sequences per last grip: if it cannot reach a tray, none of them can."""
    count: dict[int, int] = {}
    kept = []
    for entry in ranked:
        last = entry[2].grips[-1]
        count[last] = count.get(last, 0) + 1
        if count[last] <= per_last:
            kept.append(entry)
    return kept


def _squares(part: PreparedPart) -> tuple[FloatArray, FloatArray]:
    """Return the area share of each main face (f,) and which grips show it square (g, f)."""
    main = [
        (v, int(face_id))
        for v, face_id in enumerate(part.directions.square_to)
        if face_id >= 0 and part.solid.faces[face_id].kind == "plane"
    ]
    shares, square = [], np.zeros((len(part.arm_grips), len(main)))
    for column, (v, face_id) in enumerate(main):
        of_face = (part.samples.face_ids == face_id) & part.visible[v]
        shares.append(float(part.weights[of_face].sum()))
        for g in range(len(part.arm_grips)):
            if v in part.view_q[g] and of_face.any():
                share = float(part.shown_by(g)[v][of_face].mean())
                square[g, column] = share if share >= part.options.square_share else 0.0
    return np.array(shares), square
