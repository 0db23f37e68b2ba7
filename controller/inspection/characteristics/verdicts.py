"""Verdict on a characteristic, and the effect of all characteristics on a PASS (ADR 28)."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from messages import joined, key, say

from .._types import Verdict
from ._types import Characteristic, CharacteristicKind, Measured
from .limits import (
    CONFORMANCE_PROBABILITY,
    MAX_SHARE,
    Accuracy,
    Station,
    capability_of,
    decide,
    zone_mm,
)
from .limits.fits import UM_PER_MM

MAX_NAMED: Final = 3  # largest number of optional characteristics named one by one
# Number of a characteristic among similar ones.
OWN_NUMBER: Final = re.compile(r" (?:\(\d+\)|F\d+(?: \w+ F\d+)?)")
# Excess over its limits from which a general tolerance is plainly missed: half its width, and at
# most this value, so that a face 0.5 mm off counts as missed where 0.3 mm are allowed.
GROSS_SHARE: Final = 0.5
GROSS_MM: Final = 0.15
GROSS_PROBABILITY: Final = 0.99  # probability with which a value must exclude a plain miss
NOT_DEEP: Final = key("no picture shows how deep it is")
BADNESS: Final = {
    Verdict.PASS: 0,
    Verdict.NOT_EVALUATED: 1,
    Verdict.INDETERMINATE: 2,
    Verdict.FAIL: 3,
}


@dataclass(frozen=True, slots=True)
class Standing:
    """Verdict on a part by its characteristics.

    Attributes
    ----------
    verdict : FAIL where a characteristic is proven beyond its limits, INDETERMINATE where one
        that a PASS needs is open, else PASS
    reasons : reasons against a PASS, in sentences
    unproven : characteristics that a PASS does not cover since they were not verified, in sentences
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    unproven: tuple[str, ...]


def worse(one: Verdict, other: Verdict) -> Verdict:
    """Return the worse of two verdicts on a part."""
    return max(one, other, key=BADNESS.__getitem__)


def verdict_of(
    characteristic: Characteristic,
    measured_mm: float,
    U_mm: float,
    probability: float = CONFORMANCE_PROBABILITY,
) -> Verdict:
    """Return the verdict on a measured value; a deviation from an ideal has no lower limit.

    Parameters
    ----------
    characteristic : the characteristic, with its limits
    measured_mm, U_mm : value and expanded uncertainty (k = 2); rad for an angle
    probability : see `decide`
    """
    lower = None if characteristic.is_one_sided else characteristic.lower_mm
    return decide(measured_mm, U_mm, lower, characteristic.upper_mm, probability)


def with_capability(
    characteristics: Iterable[Characteristic], station: Station, accuracy: Accuracy
) -> tuple[Characteristic, ...]:
    """Return characteristics, with general tolerances that the cell cannot verify marked.

    Where twice the promised uncertainty exceeds the whole tolerance, the characteristic is not
    measured at all. Tolerances stated by a person or a drawing remain as they are: a recipe with
    narrower tolerances than the cell can verify is refused before it runs.

    Parameters
    ----------
    characteristics : characteristics of a part
    station, accuracy : station and accuracy of the cell
    """
    marked = []
    for one in characteristics:
        found = capability_of(one, station, accuracy)
        if one.is_general and not one.exempt and not found.is_capable:
            promise = say("the cell promises U = {u_um:.0f} um", u_um=found.U_mm * UM_PER_MM)
            if (
                found.share > 1.0 and not one.is_depth
            ):  # even a value within its limits would prove nothing
                exempt = say("{promise}, and 2 U is more than the whole tolerance", promise=promise)
                one = replace(one, exempt=exempt, is_measured=False)
            else:
                share = say(
                    "2 U is {share:.1%} of the tolerance, above {max_share:.0%}",
                    share=found.share,
                    max_share=MAX_SHARE,
                )
                one = replace(one, exempt=say("{promise}; {share}", promise=promise, share=share))
        marked.append(one)
    return tuple(marked)


def standing_of(measured: Sequence[Measured]) -> Standing:
    """Return the verdict on a part by its measured characteristics.

    Each characteristic that a PASS needs must be proven. Under a general tolerance, which nobody
    stated, a value within the limits is enough if it excludes a plain miss (`is_near_enough`); a
    value beyond the limits that is not proven wrong is left to a person. A characteristic that no
    picture shows, or that the recipe leaves out, is not needed. One that is not required may also
    remain unmeasured, and so may a depth under a general tolerance, which few views show and whose
    U often exceeds it: then only a plain miss stops a PASS.

    Parameters
    ----------
    measured : all measured characteristics of a part
    """
    failed, still_open, unproven = [], [], []
    optional: list[str] = []
    left_out: dict[str, list[str]] = {}
    for one in measured:
        asked = one.characteristic
        if not asked.is_measured:
            left_out.setdefault(asked.exempt, []).append(asked.label)
        elif one.verdict is Verdict.FAIL:
            failed.append(
                say(
                    "{label}: {value}, beyond {limits}",
                    label=asked.label,
                    value=_value(one),
                    limits=_limits(asked),
                )
            )
        elif one.verdict is Verdict.PASS:
            continue
        elif one.measured_mm is None and asked.is_depth and asked.is_general:
            left_out.setdefault(NOT_DEEP, []).append(asked.label)
        elif not asked.is_required and (
            one.measured_mm is None or _is_within(asked, one.measured_mm) or _says_nothing(one)
        ):
            optional.append(asked.label)
        elif one.measured_mm is None:
            still_open.append(
                say(
                    "{label}: not evaluated, {reason}",
                    label=asked.label,
                    reason=one.reason or key("no picture shows it"),
                )
            )
        elif is_near_enough(one) or (asked.is_depth and not one.is_disputed and _says_nothing(one)):
            why = asked.exempt or one.reason
            unproven.append(
                say(
                    "{label}: {value}, not proven; {why}",
                    label=asked.label,
                    value=_value(one),
                    why=why,
                )
            )
        else:
            still_open.append(
                say(
                    "{label}: {value}, {why_open}",
                    label=asked.label,
                    value=_value(one),
                    why_open=_why_open(one),
                )
            )
    verdict = Verdict.FAIL if failed else Verdict.INDETERMINATE if still_open else Verdict.PASS
    if optional:
        unproven.append(
            say("{named}: not verified, and not required by the recipe", named=_named(optional))
        )
    unproven += [
        say("{alike}: not measured, {why}", alike=_alike(labels), why=why)
        for why, labels in left_out.items()
    ]
    return Standing(verdict, (*failed, *still_open), tuple(unproven))


def is_near_enough(one: Measured) -> bool:
    """Return True if an unproven value does not stop a PASS (ADR 28).

    Its limits are general tolerances, it lies within them, no look contradicts it, and the true
    value does not miss them plainly, which is by half the tolerance or 0.15 mm, whichever is less,
    with a probability of 99 %.

    Parameters
    ----------
    one : a characteristic with a verdict that is neither PASS nor FAIL
    """
    asked = one.characteristic
    if (
        one.measured_mm is None
        or one.U_mm is None
        or one.is_disputed
        or asked.is_critical
        or not asked.is_general
        or asked.kind is CharacteristicKind.ANGLE  # its limits are no millimetres
        or not _is_within(asked, one.measured_mm)
    ):
        return False
    gross_mm = _gross_mm(asked)
    wider = replace(asked, lower_mm=asked.lower_mm - gross_mm, upper_mm=asked.upper_mm + gross_mm)
    return verdict_of(wider, one.measured_mm, one.U_mm, GROSS_PROBABILITY) is Verdict.PASS


def _says_nothing(one: Measured) -> bool:
    """Return True if a value beyond its limits is too uncertain to say anything.

    Twice its U is more than the whole tolerance, and it is not plainly beyond: by no more than its
    standard uncertainty, or than `is_near_enough` has it.
    """
    asked = one.characteristic
    if one.measured_mm is None or one.U_mm is None or not asked.is_general:
        return False
    beyond = max(asked.lower_mm - one.measured_mm, one.measured_mm - asked.upper_mm)
    not_plainly_mm = max(_gross_mm(asked), 0.5 * one.U_mm)
    return 2.0 * one.U_mm > zone_mm(asked) and beyond <= not_plainly_mm


def _gross_mm(asked: Characteristic) -> float:
    """Return the excess over its limits from which a general tolerance is plainly missed [mm]."""
    return min(GROSS_SHARE * zone_mm(asked), GROSS_MM)


def _why_open(one: Measured) -> str:
    """Return the reason why a value decides nothing."""
    asked = one.characteristic
    if one.is_disputed:
        return one.reason
    return say("too near the limits {limits} to decide", limits=_limits(asked))


def _named(labels: Sequence[str]) -> str:
    """Return the first few of some characteristics in words, and the number of the rest."""
    more = len(labels) - MAX_NAMED
    shown = joined("; ", labels[:MAX_NAMED])
    return say("{shown} and {more} more like these", shown=shown, more=more) if more > 0 else shown


def _alike(labels: Sequence[str]) -> str:
    """Return all of some characteristics in words, grouped where only their numbers differ."""
    groups: dict[str, list[str]] = {}
    for label in labels:
        groups.setdefault(OWN_NUMBER.sub("", label), []).append(label)
    return joined(
        "; ",
        (
            mine[0]
            if len(mine) == 1
            else say("{name} ({mine_count} of these)", name=name, mine_count=len(mine))
            for name, mine in groups.items()
        ),
    )


def _is_within(asked: Characteristic, value_mm: float) -> bool:
    return (asked.is_one_sided or value_mm >= asked.lower_mm) and value_mm <= asked.upper_mm


def _value(one: Measured) -> str:
    return say(
        "{measured_mm:.3f} mm with U = {u_mm:.3f} mm",
        measured_mm=one.measured_mm,
        u_mm=one.U_mm or 0.0,
    )


def _limits(asked: Characteristic) -> str:
    upper = say("{upper_mm:g} mm", upper_mm=asked.upper_mm)
    return (
        upper
        if asked.is_one_sided
        else say("{lower_mm:g} to {upper}", lower_mm=asked.lower_mm, upper=upper)
    )
