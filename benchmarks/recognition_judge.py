"""Answers of a recogniser against what truly lay on the table: pairing, verdicts, figures.

Knows pictures' truth.json, the lines `cellctl recognise --json` prints, and the parts' meshes;
imports nothing of the recogniser. What counts:

- Answers and objects of a picture are paired one to one, the sum of distances least. A pair lies
  within `GATE_MM`, or `FAR_MM` where a side is unknown: an unknown blob has no centre of mass.
  What is left after that and lies within `FAR_MM` is paired too, so that a misplaced answer can be
  named, but never right. The rest is missed or spurious.
- Right part: the names are equal.
- Right pose: right part, and some turn about the vertical takes the part, lying as answered, into
  it lying as it truly did (`recognition_symmetry`). No shift or tilt is made up for. Surfaces that
  nowhere differ by more than 0.5 mm are one, so a nearly symmetric part counts as symmetric.
- Position error: between the centres of mass over the table. Angle error: to the nearest of the
  turns that take one surface into the other; none for a part that is round about the vertical.
  Both over the objects with the right pose, as what was called something else lies nowhere.
- With alternatives: what `ambiguous_with` lists is right too.
- Rates are of all objects of the kind, the missed ones included.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from recognition_symmetry import Surface, Turns
from scipy.optimize import linear_sum_assignment

Array = NDArray[np.float64]

GATE_MM = 15.0  # a centre of mass answered further away is of something else
FAR_MM = 40.0
UNKNOWN = "unknown"
NOTHING = "nothing"


@dataclass(frozen=True, eq=False, slots=True)
class Thing:
    """What truly lies on the table; R (3, 3) CAD -> upright, the centre of mass over (x, y)."""

    image: str
    part: str
    is_known: bool
    R: Array
    x_mm: float
    y_mm: float
    theta_deg: float


@dataclass(frozen=True, eq=False, slots=True)
class Alternative:
    """Another part or pose that an answer allows; R is None where it names the part alone."""

    part: str
    R: Array | None


@dataclass(frozen=True, eq=False, slots=True)
class Answer:
    """One line of the recogniser; part is None for an object that is none of the catalogue's."""

    image: str
    part: str | None
    R: Array | None
    x_mm: float
    y_mm: float
    theta_deg: float
    score: float
    alternatives: tuple[Alternative, ...]
    seconds: float
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class Verdict:
    """One object and the answer to it; either may be missing.

    Attributes
    ----------
    kind : right, wrong pose, wrong part, called unknown, missed; for objects in no catalogue
        refused, named, overlooked; for answers to nothing spurious, spurious unknown
    position_mm, angle_deg : None unless the pose is right; the angle also where the part is round
    fold : turns that take the resting part into itself, 0 for a round one; None unless right
    with_alternatives : the kind if the answer's alternatives count as answered
    """

    thing: Thing | None
    answer: Answer | None
    kind: str
    with_alternatives: str
    distance_mm: float | None
    position_mm: float | None = None
    angle_deg: float | None = None
    fold: int | None = None


def read_things(truth: Mapping[str, Any]) -> list[Thing]:
    """Return the objects of a truth.json, picture by picture."""
    return [
        Thing(
            entry["image"],
            o["part"],
            bool(o["known"]),
            np.asarray(o["stable_pose_R"], dtype=np.float64),
            float(o["x_mm"]),
            float(o["y_mm"]),
            float(o["theta_deg"]),
        )
        for entry in truth["images"]
        for o in entry["objects"]
    ]


def read_answer(
    body: Mapping[str, Any], poses: Callable[[str, int], Array | None] | None = None
) -> Answer:
    """Return an answer from its JSON line.

    Parameters
    ----------
    poses : orientation of a part's stable pose by number, for alternatives told by number
    """
    R, theta_deg = body["stable_pose_R"], body.get("theta_deg")
    if body.get("lies_on"):  # it leans, as no stable pose does
        R, theta_deg = np.asarray(body["T_world_part"])[:3, :3], 0.0
    readings = []
    for other in body.get("ambiguous_with", ()):
        turned = other.get("stable_pose_R")
        if turned is None and poses is not None and other.get("pose_index") is not None:
            turned = poses(other["part"], int(other["pose_index"]))
        readings.append(Alternative(other["part"], None if turned is None else np.asarray(turned)))
    return Answer(
        body["image"],
        body["part"],
        None if R is None else np.asarray(R, dtype=np.float64),
        _number(body.get("x_mm")),
        _number(body.get("y_mm")),
        _number(theta_deg),
        _number(body.get("score")),
        tuple(readings),
        _number(body.get("seconds")),
        str(body.get("reason", "")),
    )


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else math.nan


class Judge:
    """Judges answers about parts whose surfaces it is given.

    Parameters
    ----------
    surface_of : a part's surface by its name; asked for only where an answer names the right part
    """

    def __init__(self, surface_of: Callable[[str], Surface]) -> None:
        self._surface_of = surface_of

    def judge(self, things: Iterable[Thing], answers: Iterable[Answer]) -> list[Verdict]:
        """Return a verdict on every object and on every answer to nothing, picture by picture."""
        by_image: dict[str, tuple[list[Thing], list[Answer]]] = {}
        for thing in things:
            by_image.setdefault(thing.image, ([], []))[0].append(thing)
        for answer in answers:
            by_image.setdefault(answer.image, ([], []))[1].append(answer)
        return [
            verdict
            for there, told in by_image.values()
            for verdict in self._judge_picture(there, told)
        ]

    def _judge_picture(self, things: Sequence[Thing], answers: Sequence[Answer]) -> list[Verdict]:
        verdicts = []
        pairs = pair(things, answers)
        for i, j, is_near in pairs:
            verdicts.append(self._verdict(things[i], answers[j], is_near))
        missed = set(range(len(things))) - {i for i, _, _ in pairs}
        for i in sorted(missed):
            kind = "missed" if things[i].is_known else "overlooked"
            verdicts.append(Verdict(things[i], None, kind, kind, None))
        spurious = set(range(len(answers))) - {j for _, j, _ in pairs}
        for j in sorted(spurious):
            kind = "spurious" if answers[j].part is not None else "spurious unknown"
            verdicts.append(Verdict(None, answers[j], kind, kind, None))
        return verdicts

    def _verdict(self, thing: Thing, answer: Answer, is_near: bool) -> Verdict:
        apart = _distance_mm(thing, answer)
        if not thing.is_known:
            kind = "refused" if answer.part is None else "named"
            return Verdict(thing, answer, kind, kind, apart)
        kind = "called unknown"
        if answer.part is not None:
            kind = "wrong part"
            if is_near and answer.part == thing.part:
                turns = self._turns(thing, answer.R)
                if turns is not None and turns.exist:
                    angle, fold = None, 0
                    if not turns.is_round:
                        off = thing.theta_deg - answer.theta_deg + np.degrees(turns.turns_rad)
                        angle = float(np.abs((off + 180) % 360 - 180).min())
                        fold = len(turns.turns_rad)
                    return Verdict(thing, answer, "right", "right", apart, apart, angle, fold)
                kind = "wrong pose"
        best = kind
        if is_near and answer.part is not None:
            for other in answer.alternatives:
                if other.part == thing.part:
                    turns = self._turns(thing, other.R)
                    if turns is not None and turns.exist:
                        best = "right"
                    elif best == "wrong part":
                        best = "wrong pose"
        return Verdict(thing, answer, kind, best, apart)

    def _turns(self, thing: Thing, R: Array | None) -> Turns | None:
        """Return the turns that take the part lying as answered to how it truly does.

        None for what is no orientation.
        """
        if R is None or R.shape != (3, 3) or not np.isfinite(R).all():
            return None
        if np.abs(R @ R.T - np.eye(3)).max() > 1e-3 or np.linalg.det(R) < 0:
            return None
        # Rz(theta) R P = Rz(theta_true) R_true P  <=>  Rz(theta - theta_true) R P = R_true P
        return self._surface_of(thing.part).turns(R, thing.R)


def pair(things: Sequence[Thing], answers: Sequence[Answer]) -> list[tuple[int, int, bool]]:
    """Return (object, answer, within the gate) of the pairs, one to one, distances least."""
    far = np.array([[_distance_mm(t, a) for a in answers] for t in things])
    far = np.where(np.isfinite(far.reshape(len(things), len(answers))), far, np.inf)
    gates = np.array(
        [
            [GATE_MM if t.is_known and a.part is not None else FAR_MM for a in answers]
            for t in things
        ]
    ).reshape(far.shape)
    near = _assign(far, far <= gates)
    left = far <= FAR_MM
    for i, j in near:
        left[i, :] = left[:, j] = False
    return [(i, j, True) for i, j in near] + [(i, j, False) for i, j in _assign(far, left)]


def _assign(far: Array, allowed: NDArray[np.bool_]) -> list[tuple[int, int]]:
    # more pairs before shorter ones: a forbidden pair costs more than all allowed ones together
    cost = np.where(allowed, far, 1e6)
    rows, columns = linear_sum_assignment(cost)
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if allowed[i, j]]


def _distance_mm(thing: Thing, answer: Answer) -> float:
    return math.hypot(answer.x_mm - thing.x_mm, answer.y_mm - thing.y_mm)


def figures(verdicts: Sequence[Verdict]) -> dict[str, Any]:
    """Return the issue's table for some verdicts: rates, errors, tallies."""
    known = [v for v in verdicts if v.thing is not None and v.thing.is_known]
    strangers = [v for v in verdicts if v.thing is not None and not v.thing.is_known]
    kinds = [v.kind for v in verdicts]
    loose = [v.with_alternatives for v in known]
    right = [v for v in known if v.kind == "right"]
    return {
        "objects": len(known),
        "right_part": _share(v.kind in ("right", "wrong pose") for v in known),
        "right_pose": _share(v.kind == "right" for v in known),
        "right_part_with_alternatives": _share(k in ("right", "wrong pose") for k in loose),
        "right_pose_with_alternatives": _share(k == "right" for k in loose),
        "position_mm": _spread([v.position_mm for v in right]),
        "angle_asymmetric_deg": _spread([v.angle_deg for v in right if v.fold == 1]),
        "angle_deg": _spread([v.angle_deg for v in right if v.angle_deg is not None]),
        "strangers": len(strangers),
        "unknown_called_unknown": _share(v.kind == "refused" for v in strangers),
        "known_called_unknown": _share(v.kind == "called unknown" for v in known),
        "ambiguous_answers": sum(
            bool(v.answer.alternatives) for v in verdicts if v.answer is not None
        ),
        "tally": {kind: kinds.count(kind) for kind in sorted(set(kinds))},
    }


def _share(claims: Iterable[bool]) -> float | None:
    held = list(claims)
    return sum(held) / len(held) if held else None


def _spread(values: Sequence[float | None]) -> dict[str, float] | None:
    if not values:
        return None
    found = np.array(values, dtype=np.float64)
    return {
        "median": float(np.median(found)),
        "p95": float(np.percentile(found, 95)),
        "worst": float(found.max()),
        "count": len(found),
    }


def confusion(verdicts: Sequence[Verdict]) -> dict[str, dict[str, int]]:
    """Return how often each part (row) was answered as which (column).

    Objects in no catalogue are the row "unknown", answers to nothing the row "nothing", objects
    without an answer the column "nothing".
    """
    table: dict[str, dict[str, int]] = {}
    for v in verdicts:
        row = NOTHING if v.thing is None else v.thing.part if v.thing.is_known else UNKNOWN
        told = NOTHING if v.answer is None else v.answer.part or UNKNOWN
        cells = table.setdefault(row, {})
        cells[told] = cells.get(told, 0) + 1
    return {row: dict(sorted(cells.items())) for row, cells in sorted(table.items())}


def reliability(verdicts: Sequence[Verdict]) -> dict[str, Any]:
    """Return what share of the named answers was right, by score, and the expected error of it.

    Answers to strangers and to nothing count, as wrong ones. The error is the mean over answers
    of how far their bin's mean score is from the share right in it.
    """
    named = [v for v in verdicts if v.answer is not None and v.answer.part is not None]
    named = [v for v in named if v.answer is not None and math.isfinite(v.answer.score)]
    score = np.array([v.answer.score for v in named if v.answer is not None])
    strict = np.array([v.kind == "right" for v in named], dtype=np.float64)
    loose = np.array([v.with_alternatives == "right" for v in named], dtype=np.float64)
    # most scores are high: the bins are those of 1 - score, ever narrower towards 1
    edges = np.array([-np.inf, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, np.inf])
    at = np.digitize(score, edges) - 1
    bins, errors = [], np.zeros(2)
    for k in range(len(edges) - 1):
        here = at == k
        if here.any():
            mean = float(score[here].mean())
            shares = np.array([strict[here].mean(), loose[here].mean()])
            errors += here.sum() * np.abs(shares - mean)
            bins.append(
                {
                    "from": max(float(edges[k]), 0.0),
                    "to": min(float(edges[k + 1]), 1.0),
                    "answers": int(here.sum()),
                    "mean_score": mean,
                    "right": float(shares[0]),
                    "right_with_alternatives": float(shares[1]),
                }
            )
    count = max(len(named), 1)
    return {
        "answers": len(named),
        "bins": bins,
        "expected_error": float(errors[0] / count) if named else None,
        "expected_error_with_alternatives": float(errors[1] / count) if named else None,
    }


def failures(verdicts: Sequence[Verdict]) -> list[dict[str, Any]]:
    """Return what went wrong, one row each."""
    rows = []
    for v in verdicts:
        if v.kind in ("right", "refused", "spurious unknown"):
            continue
        t, a = v.thing, v.answer
        rows.append(
            {
                "image": (t or a).image if (t or a) is not None else "",
                "kind": v.kind,
                "with_alternatives": v.with_alternatives,
                "truth": None if t is None else t.part,
                "truth_R": None if t is None else t.R.tolist(),
                "answer": None if a is None else a.part or UNKNOWN,
                "answer_R": None if a is None or a.R is None else a.R.tolist(),
                "truth_xy_mm": None if t is None else [t.x_mm, t.y_mm],
                "distance_mm": v.distance_mm,
                "score": None if a is None or not math.isfinite(a.score) else a.score,
                "alternatives": 0 if a is None else len(a.alternatives),
                "reason": "" if a is None else a.reason,
            }
        )
    return rows
