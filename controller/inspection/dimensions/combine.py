"""Combination of looks into one value with its uncertainty, or the reason why there is none.

Looks are weighted by their uncertainties. Common errors do not average out: scale and temperature
in all looks, the pose within a grasp, the lens within a view, light under the same lamp.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from statistics import NormalDist
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from messages import joined, key, say

from .._types import Verdict
from ..characteristics import Characteristic, Look, verdict_of
from ..characteristics.limits.decision import COVERAGE_FACTOR
from ._looks import (
    BLUR,
    FACETS,
    LENS,
    LIGHT,
    POSE,
    SCALE,
    TEMPERATURE,
    WALL,
    Estimate,
    largest_eigenvalue,
    value_of,
)
from ._types import BACKLIT, MeasuringSettings

DISAGREES: Final = key("disagrees with the other looks")
NOT_COVERED: Final = 1.0 - NormalDist().cdf(COVERAGE_FACTOR)  # on either side
MAX_DROPPED: Final = 1 / 3  # largest share of looks that may disagree with all others
NAMED: Final = 2  # largest number of named reasons; more would only repeat them


@dataclass(frozen=True, eq=False, slots=True)
class Combined:
    """Combined result of all looks.

    Attributes
    ----------
    measured_mm, U_mm : value and expanded uncertainty; None where nothing was evaluated
    reason : reason why nothing was evaluated, or why the value remains open
    is_open : True if there is a value that is not enough for a verdict
    is_disputed : True if it is open since looks contradict each other, or a required one is missing
    views : views that contributed
    looks : all looks; those left out give the reason
    is_sure : True if two independent looks agree and fewer are left out than may be, or there is
        one before the panel, where no shadow looks like an edge: enough for a FAIL
    """

    measured_mm: float | None
    U_mm: float | None
    reason: str
    is_open: bool
    is_disputed: bool
    views: tuple[str, ...]
    looks: tuple[Look, ...]
    is_sure: bool = False


def combine(
    characteristic: Characteristic,
    estimates: Sequence[Estimate],
    settings: MeasuringSettings,
    halves: Sequence[Sequence[Estimate]] = (),
) -> Combined:
    """Return the combined value of all looks at a characteristic.

    Looks that show too little of an edge give a value only if there are no others and they agree;
    this value remains open.

    Parameters
    ----------
    characteristic : the characteristic
    estimates : estimates picture by picture
    settings : settings, with the independence of looks
    halves : estimates of each feature of a difference alone, picture by picture, used where no
        picture shows both; their common errors then do not cancel
    """
    looks = [e.look for e in estimates]
    whole, part = _together(estimates, settings, halves), ""
    if whole is None:
        whole, part = _together(estimates, settings, halves, parts=True), "light hides too much"
        every = chain(estimates, *halves)
        if whole is not None and whole.reason and all(e.look.reason for e in every):
            # None of them would decide alone, so a contradiction among them adds nothing.
            whole = None
    if whole is None:
        return Combined(None, None, _why_none(looks), False, False, (), tuple(looks))
    value, u = value_of(characteristic, whole.vector_mm, _total(whole.parts))
    for i, reason in whole.dropped:
        if whole.is_direct:
            looks[i] = replace(looks[i], reason=reason)
    U = COVERAGE_FACTOR * u
    reason = whole.reason
    if not characteristic.is_critical and verdict_of(characteristic, value, U) is Verdict.PASS:
        reason = ""  # whichever look is right, the value is within its limits
    if characteristic.is_critical and not reason and not whole.is_twice:
        reason = key("one look only, two independent ones are required")
    is_disputed = bool(reason)
    if part and not reason:
        reason = say(
            "light hides too much of its edge to decide: {why_none}", why_none=_why_none(looks)
        )
    return Combined(
        value, U, reason, bool(reason), is_disputed, whole.views, tuple(looks), whole.is_sure
    )


@dataclass(frozen=True, eq=False, slots=True)
class _Mean:
    """Mean of agreeing looks; `dropped` are the others, by number, with the reason.

    `is_twice`: two of them are independent; `is_sure`: see `Combined`.
    """

    vector_mm: FloatArray
    parts: Mapping[str, FloatArray]
    reason: str
    is_twice: bool
    is_sure: bool
    is_direct: bool
    views: tuple[str, ...]
    dropped: tuple[tuple[int, str], ...]


def _together(
    estimates: Sequence[Estimate],
    settings: MeasuringSettings,
    halves: Sequence[Sequence[Estimate]],
    *,
    parts: bool = False,
) -> _Mean | None:
    """Return the surer of the mean of whole looks and the sum of looks at each half.

    Parameters
    ----------
    estimates, settings, halves : see `combine`
    parts : True to include looks that show too little of an edge
    """
    whole = _chosen(estimates, settings, parts=parts)
    if not halves or (whole is not None and whole.reason):
        return whole
    found = [_chosen(half, settings, parts=parts) for half in halves]
    sides = [side for side in found if side is not None]
    if len(sides) < 2 or len(sides) < len(found):
        return whole
    both = _sum(sides)
    if whole is None or _largest(_total(both.parts)) < _largest(_total(whole.parts)):
        return both
    return whole


def _chosen(
    estimates: Sequence[Estimate], settings: MeasuringSettings, *, parts: bool
) -> _Mean | None:
    """Return the mean of the looks that count; None where there is none.

    Parameters
    ----------
    estimates, settings : see `combine`
    parts : True to include looks that show too little of an edge
    """
    good = [
        i
        for i, e in enumerate(estimates)
        if (not e.look.reason or (parts and e.is_part)) and np.isfinite(e.look.u_mm)
    ]
    if not good:
        return None
    count = len(good)
    dropped: list[tuple[int, str]] = []
    reason, against = "", list[tuple[float, float]]()
    while len(good) > 1:
        against = _against_others([estimates[i] for i in good])
        worst = int(np.argmax([off / allowed for off, allowed in against]))
        off, allowed = against[worst]
        if off <= allowed:
            break
        if len(good) == 2 or len(dropped) + 1 > MAX_DROPPED * count:
            reason = say(
                "looks disagree by {off:.3f} mm, their uncertainties allow {allowed:.3f} mm",
                off=off,
                allowed=allowed,
            )
            break
        why = say(
            "{disagrees} by {off:.3f} mm, {allowed:.3f} mm is explained",
            disagrees=DISAGREES,
            off=off,
            allowed=allowed,
        )
        dropped.append((good.pop(worst), why))
    used = [estimates[i] for i in good]
    vector, shares = _mean(used, settings)
    is_twice, is_backlit = _has_two(used, settings), any(e.look.lamp == BACKLIT for e in used)
    is_sure = is_proven = is_twice or is_backlit
    if not is_proven:
        if _is_outvoted(used, estimates, vector):
            return None
        if not parts:
            is_sure, is_contradicted = _beside(used, estimates, vector, settings)
            if is_contradicted:
                return None
    if (not is_sure or any(e.is_part for e in used)) and LIGHT in shares:
        # Nothing confirms that the edge under the lamp belongs to the part and not to its shadow.
        shares[LIGHT] = shares[LIGHT] * settings.unconfirmed_light**2
    if reason:
        scale = max(1.0, _reach(used, vector, against) ** 2 / _largest(_total(shares)))
        shares = {name: share * scale for name, share in shares.items()}
    views = tuple(dict.fromkeys(e.look.view_id for e in used))
    # Of three looks at a textured edge two may err alike, and leave out the one that is right.
    is_enough = is_backlit or (is_twice and len(dropped) < MAX_DROPPED * count)
    return _Mean(vector, shares, reason, is_twice, is_enough, True, views, tuple(dropped))


def _sum(halves: Sequence[_Mean]) -> _Mean:
    """Return a difference combined from the values of its two features."""
    one, other = halves
    parts = {}
    for name in dict.fromkeys([*one.parts, *other.parts]):
        both = [half.parts[name] for half in halves if name in half.parts]
        if name in (LIGHT, FACETS) and len(both) == 2:
            # Light moves both edges in the same sense, out of the material or into it.
            parts[name] = both[0] + both[1] + 2.0 * _geometric(both[0], both[1])
        else:
            parts[name] = np.sum(both, axis=0)
    return _Mean(
        one.vector_mm + other.vector_mm,
        parts,
        one.reason or other.reason,
        one.is_twice and other.is_twice,
        one.is_sure and other.is_sure,
        False,
        tuple(dict.fromkeys([*one.views, *other.views])),
        (),
    )


def _total(parts: Mapping[str, FloatArray]) -> FloatArray:
    return np.asarray(np.sum(list(parts.values()), axis=0))


def is_independent(one: Estimate, other: Estimate, settings: MeasuringSettings) -> bool:
    """Return True if the errors from light are independent in two looks.

    Parameters
    ----------
    one, other : the looks
    settings : settings, with the least angle between the views
    """
    if one.look.lamp != other.look.lamp:
        return True
    return bool(float(one.towards @ other.towards) < np.cos(settings.independent_rad))


def _mean(
    used: Sequence[Estimate], settings: MeasuringSettings
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the weighted mean of looks, and its covariances by name."""
    weight = np.array([1.0 / e.look.u_mm**2 for e in used])
    weight /= weight.sum()
    vector = np.sum([w * e.vector_mm for w, e in zip(weight, used, strict=True)], axis=0)
    shares: list[float] = weight.tolist()
    parts: dict[str, FloatArray] = {}
    for name in used[0].parts:
        largest = [_largest(e.parts[name]) for e in used]
        total = 0.0
        for i, one in enumerate(used):
            for j, other in enumerate(used):
                if i == j or _is_shared(name, one, other, settings):
                    total += shares[i] * shares[j] * math.sqrt(largest[i] * largest[j])
        parts[name] = np.eye(len(vector)) * total
    return vector, parts


def _is_shared(name: str, one: Estimate, other: Estimate, settings: MeasuringSettings) -> bool:
    """Return True if two looks share an error."""
    if name in (SCALE, TEMPERATURE, FACETS):
        return True
    if name == POSE:
        return one.grasp == other.grasp
    if name == LENS:
        return one.look.view_id == other.look.view_id
    if name == LIGHT:
        return one.look.lamp == other.look.lamp
    if name in (WALL, BLUR):
        return not is_independent(one, other, settings)
    return False


def _geometric(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the covariance of two vectors with the same errors at different scales."""
    return np.asarray(np.eye(len(one)) * np.sqrt(_largest(one) * _largest(other)))


def _largest(covariance: FloatArray) -> float:
    return max(largest_eigenvalue(covariance), 0.0)


def _against_others(used: Sequence[Estimate]) -> list[tuple[float, float]]:
    """Return each look's distance from the mean of the others, and what is explained [mm]."""
    weight = np.array([1.0 / e.look.u_mm**2 for e in used])
    vectors = np.array([e.vector_mm for e in used])
    # of n looks the worst counts: each is asked at a share of what a single pair would be
    count = len(used)
    factor = COVERAGE_FACTOR if count == 2 else NormalDist().inv_cdf(1.0 - NOT_COVERED / count)
    answers = []
    for i, one in enumerate(used):
        rest = weight.copy()
        rest[i] = 0.0
        mean = (rest[:, None] * vectors).sum(axis=0) / rest.sum()
        off = float(np.linalg.norm(one.vector_mm - mean))
        # The mean of the others is no better than the best of them, since they share errors.
        best = min(e.look.u_mm for k, e in enumerate(used) if k != i)
        answers.append((off, factor * float(np.hypot(one.look.u_mm, best))))
    return answers


def _beside(
    used: Sequence[Estimate],
    estimates: Sequence[Estimate],
    vector_mm: FloatArray,
    settings: MeasuringSettings,
) -> tuple[bool, bool]:
    """Return two flags: looks at a portion of the edge confirm the others, or contradict them.

    An independent look confirms if it finds the edge at the same place. The others are contradicted
    if none confirms them and one that is as sure finds the edge elsewhere. This needs no
    independence, since the same light moves an edge in the same way.

    Parameters
    ----------
    used, vector_mm : the looks that count, and their mean
    estimates, settings : all looks, and the settings
    """
    best_mm = min(e.look.u_mm for e in used)
    confirming = contradicting = False
    for e in estimates:
        if e.is_part:
            agrees = not _are_apart(e.vector_mm, vector_mm, e.look.u_mm, best_mm)
            confirming |= agrees and all(is_independent(e, one, settings) for one in used)
            contradicting |= not agrees and e.look.u_mm <= best_mm
    return confirming, contradicting and not confirming


def _is_outvoted(
    used: Sequence[Estimate], estimates: Sequence[Estimate], vector_mm: FloatArray
) -> bool:
    """Return True if two looks that do not count agree on a different place of the edge.

    Each is as sure as those that count, but failed a check, mostly since a portion of its edge lies
    elsewhere. Together they indicate that those that count may be on another edge.

    Parameters
    ----------
    used, vector_mm : the looks that count, and their mean
    estimates : all looks
    """
    best_mm = min(e.look.u_mm for e in used)
    against = [
        e
        for e in estimates
        if e.look.reason
        and all(e is not one for one in used)
        and e.look.u_mm <= best_mm
        and _are_apart(e.vector_mm, vector_mm, e.look.u_mm, best_mm)
    ]
    return any(
        not _are_apart(one.vector_mm, other.vector_mm, one.look.u_mm, other.look.u_mm)
        for i, one in enumerate(against)
        for other in against[:i]
    )


def _reach(
    used: Sequence[Estimate], vector_mm: FloatArray, against: Sequence[tuple[float, float]]
) -> float:
    """Return the standard uncertainty that covers the looks that disagree with the others [mm].

    Whichever of them is right, its value lies within.

    Parameters
    ----------
    used, vector_mm : looks that disagree, and their mean
    against : distance of each from the others, and what is explained, from `_against_others`
    """
    return max(
        float(np.linalg.norm(e.vector_mm - vector_mm)) / COVERAGE_FACTOR + e.look.u_mm
        for e, (off, allowed) in zip(used, against, strict=True)
        if off > allowed
    )


def _are_apart(one: FloatArray, other: FloatArray, u_one: float, u_other: float) -> bool:
    """Return True if two values differ by more than their standard uncertainties explain."""
    return float(np.linalg.norm(one - other)) > COVERAGE_FACTOR * float(np.hypot(u_one, u_other))


def _has_two(used: Sequence[Estimate], settings: MeasuringSettings) -> bool:
    return any(
        is_independent(one, other, settings) for i, one in enumerate(used) for other in used[:i]
    )


def _why_none(looks: Sequence[Look]) -> str:
    """Return the reason why no look counts, from the looks that came closest."""
    if not looks:
        return key("no view of it")
    rank = sorted(looks, key=lambda look: look.points_px is None or len(look.points_px) == 0)
    named: dict[str, str] = {}
    for look in rank:
        named.setdefault(
            look.reason,
            say(
                "{view_id} {lamp}: {reason}",
                view_id=look.view_id,
                lamp=look.lamp,
                reason=look.reason,
            ),
        )
    if len(named) == 1:
        return (
            say("{reason}, in no view", reason=looks[0].reason)
            if len(looks) > 1
            else next(iter(named.values()))
        )
    return joined("; ", list(named.values())[:NAMED])
