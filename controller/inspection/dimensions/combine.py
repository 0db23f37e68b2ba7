"""Looks put together: one value, one uncertainty, or why there is none.

Looks are weighted by their uncertainties. What they have in common does not become smaller by
looking again: scale and temperature always, the pose within a grasp, the lens within a view, light
under the same lamp.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.arrays import FloatArray

from ..characteristics import Characteristic, Look
from ._looks import BLUR, FACETS, LENS, LIGHT, POSE, SCALE, TEMPERATURE, WALL, Estimate, value_of
from ._types import MeasuringSettings

COVERAGE: Final = 2.0  # k
MAX_DROPPED: Final = 1 / 3  # of the looks that may disagree with all others
NAMED: Final = 2  # reasons that are named; more say the same


@dataclass(frozen=True, eq=False, slots=True)
class Combined:
    """What all looks come to.

    Attributes
    ----------
    measured_mm, U_mm : value and expanded uncertainty; None where nothing was evaluated
    reason : why nothing was, or why it stays open
    is_open : there is a value, but not enough to decide upon
    views : it comes from
    looks : all of them; those left out say why
    """

    measured_mm: float | None
    U_mm: float | None
    reason: str
    is_open: bool
    views: tuple[str, ...]
    looks: tuple[Look, ...]


def combine(
    characteristic: Characteristic, estimates: Sequence[Estimate], settings: MeasuringSettings
) -> Combined:
    """Return what all looks at a characteristic come to.

    Parameters
    ----------
    characteristic : what is asked
    estimates : picture by picture
    settings : which looks are independent
    """
    good = [i for i, e in enumerate(estimates) if not e.look.reason and np.isfinite(e.look.u_mm)]
    looks = [e.look for e in estimates]
    if not good:
        return Combined(None, None, _why_none(looks), False, (), tuple(looks))
    reason = ""
    while len(good) > 1:
        worst, off, allowed = _worst([estimates[i] for i in good])
        if off <= allowed:
            break
        lost = len([look for look in looks if look.reason.startswith(DISAGREES)]) + 1
        total = len(good) + lost - 1
        if len(good) == 2 or lost > MAX_DROPPED * total:
            reason = f"looks disagree by {off:.3f} mm, their uncertainties allow {allowed:.3f} mm"
            break
        i = good.pop(worst)
        looks[i] = replace(
            looks[i], reason=f"{DISAGREES} by {off:.3f} mm, {allowed:.3f} mm is explained"
        )
    used = [estimates[i] for i in good]
    vector, covariance = _mean(used, settings)
    value, u = value_of(characteristic, vector, covariance)
    if characteristic.is_critical and not reason and not _has_two(used, settings):
        reason = "one look only, two independent ones are required"
    views = tuple(dict.fromkeys(e.look.view_id for e in used))
    return Combined(value, COVERAGE * u, reason, bool(reason), views, tuple(looks))


DISAGREES: Final = "disagrees with the other looks"


def is_independent(one: Estimate, other: Estimate, settings: MeasuringSettings) -> bool:
    """Return whether light errs differently in two looks.

    Parameters
    ----------
    one, other : the looks
    settings : how far two views must be apart
    """
    if one.look.lamp != other.look.lamp:
        return True
    return bool(float(one.towards @ other.towards) < np.cos(settings.independent_rad))


def _mean(used: Sequence[Estimate], settings: MeasuringSettings) -> tuple[FloatArray, FloatArray]:
    """Return the weighted mean of looks, and its covariance."""
    weight = np.array([1.0 / e.look.u_mm**2 for e in used])
    weight /= weight.sum()
    vector = np.sum([w * e.vector_mm for w, e in zip(weight, used, strict=True)], axis=0)
    size = len(vector)
    covariance = np.zeros((size, size))
    for i, one in enumerate(used):
        for j, other in enumerate(used):
            for name, part in one.parts.items():
                shared = 1.0 if i == j else _shared(name, one, other, settings)
                if shared:
                    both = _geometric(part, other.parts[name])
                    covariance += weight[i] * weight[j] * shared * both
    return vector, covariance


def _shared(name: str, one: Estimate, other: Estimate, settings: MeasuringSettings) -> float:
    """Return whether an error is the same in two looks, 1 or 0."""
    if name in (SCALE, TEMPERATURE, FACETS):
        return 1.0
    if name == POSE:
        return float(one.grasp == other.grasp)
    if name == LENS:
        return float(one.look.view_id == other.look.view_id)
    if name == LIGHT:
        return float(one.look.lamp == other.look.lamp)
    if name in (WALL, BLUR):
        return float(not is_independent(one, other, settings))
    return 0.0


def _geometric(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the covariance of two vectors whose errors are the same but for their size."""
    if one.shape == (1, 1):
        return np.sqrt(one * other)
    return np.asarray(np.eye(len(one)) * np.sqrt(_largest(one) * _largest(other)))


def _largest(covariance: FloatArray) -> float:
    return max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0)


def _worst(used: Sequence[Estimate]) -> tuple[int, float, float]:
    """Return the look that is farthest from the others, by how much, and what is allowed [mm]."""
    weight = np.array([1.0 / e.look.u_mm**2 for e in used])
    vectors = np.array([e.vector_mm for e in used])
    answers = []
    for i, one in enumerate(used):
        rest = weight.copy()
        rest[i] = 0.0
        mean = (rest[:, None] * vectors).sum(axis=0) / rest.sum()
        off = float(np.linalg.norm(one.vector_mm - mean))
        # the others' mean is no better than the best of them: they share errors
        best = min(e.look.u_mm for k, e in enumerate(used) if k != i)
        answers.append((off, COVERAGE * float(np.hypot(one.look.u_mm, best))))
    index = int(np.argmax([off / allowed for off, allowed in answers]))
    return index, *answers[index]


def _has_two(used: Sequence[Estimate], settings: MeasuringSettings) -> bool:
    return any(
        is_independent(one, other, settings) for i, one in enumerate(used) for other in used[:i]
    )


def _why_none(looks: Sequence[Look]) -> str:
    """Return why no look counts: the reasons of those that came closest."""
    if not looks:
        return "no view of it"
    rank = sorted(looks, key=lambda look: look.points_px is None or len(look.points_px) == 0)
    named: dict[str, str] = {}
    for look in rank:
        named.setdefault(look.reason, f"{look.view_id} {look.lamp}: {look.reason}")
    if len(named) == 1:
        return f"{looks[0].reason}, in no view" if len(looks) > 1 else next(iter(named.values()))
    return "; ".join(list(named.values())[:NAMED])
