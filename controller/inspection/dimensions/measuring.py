"""Measurement of all characteristics of a part in all its views."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from messages import key, say

from .._pose import PosedPart
from .._types import Verdict
from ..characteristics import Characteristic, Measured, verdict_of
from ._features import Feature, FeatureFit
from ._looks import Estimate, Sought, estimate, features_of, seek
from ._pictures import fit_features, predict
from ._types import MeasuringSettings, PosedView
from .combine import Combined, combine

DEFAULT: Final = MeasuringSettings()
UNSURE: Final = key("a FAIL needs two independent looks, and more than two in three that agree")


def measure(
    part: PosedPart,
    characteristics: Sequence[Characteristic],
    views: Sequence[PosedView],
    settings: MeasuringSettings = DEFAULT,
) -> tuple[Measured, ...]:
    """Return the characteristics, in order, with value, uncertainty and verdict from all views.

    Parameters
    ----------
    part : the CAD model
    characteristics : characteristics to measure
    views : views with pictures, and the part's pose in them
    settings : limits of a valid measurement, and prior uncertainties
    """
    sought = seek_all(part, characteristics)
    by_view = [look_for(part, sought, view, settings) for view in views]
    return put_together(characteristics, sought, by_view, settings)


def seek_all(part: PosedPart, characteristics: Sequence[Characteristic]) -> tuple[Sought, ...]:
    """Return the features to seek in pictures, for the characteristics that one may show.

    Parameters
    ----------
    part : the CAD model
    characteristics : characteristics to measure
    """
    asked = (seek(c, part.solid) for c in characteristics if not _why_not(c))
    return tuple(one for one in asked if one is not None)


def put_together(
    characteristics: Sequence[Characteristic],
    sought: Sequence[Sought],
    by_view: Sequence[Sequence["DimensionLooks"]],
    settings: MeasuringSettings,
) -> tuple[Measured, ...]:
    """Return the characteristics, in order, from the looks of all views.

    Parameters
    ----------
    characteristics : characteristics to measure
    sought : their features, from `seek_all`
    by_view : looks of each view at all that is sought, from `look_for`
    settings : see `measure`
    """
    found = iter(_combined(sought, by_view, settings))
    return tuple(
        Measured(c, None, None, Verdict.NOT_EVALUATED, (), why)
        if (why := _why_not(c))
        else next(found)
        for c in characteristics
    )


def _why_not(characteristic: Characteristic) -> str:
    """Return the reason why no picture can show a characteristic; empty where one may."""
    if not characteristic.is_measured:
        return characteristic.exempt or key("it is not to be measured")
    if not features_of(characteristic):
        return key("no edge of the CAD model shows it")
    return ""


def _combined(
    sought: Sequence[Sought],
    by_view: Sequence[Sequence["DimensionLooks"]],
    settings: MeasuringSettings,
) -> list[Measured]:
    answers = []
    for i, one in enumerate(sought):
        whole = [e for view in by_view for e in view[i].whole]
        halves = [[e for view in by_view for e in view[i].halves[k]] for k in range(2)]
        found = combine(one.characteristic, whole, settings, halves if one.is_halved else ())
        answers.append(result_of(one.characteristic, found))
    return answers


def look(
    part: PosedPart,
    characteristics: Sequence[Characteristic],
    view: PosedView,
    settings: MeasuringSettings = DEFAULT,
) -> list[list[Estimate]]:
    """Return the estimates of each characteristic from each picture of a view.

    Parameters
    ----------
    part : the CAD model
    characteristics : characteristics to measure
    view : view with its pictures, and the part's pose
    settings : see `measure`
    """
    sought = [seek(c, part.solid) for c in characteristics]
    known = tuple(one for one in sought if one is not None)
    found = iter(look_for(part, known, view, settings))
    return [[] if one is None else next(found).whole for one in sought]


@dataclass(frozen=True, eq=False, slots=True)
class DimensionLooks:
    """Estimates of a characteristic, and of each of its features, from a view.

    Attributes
    ----------
    whole : from each picture
    halves : from each picture, for each of two features alone
    """

    whole: list[Estimate]
    halves: tuple[list[Estimate], list[Estimate]]


def look_for(
    part: PosedPart,
    sought: Sequence[Sought],
    view: PosedView,
    settings: MeasuringSettings,
) -> list[DimensionLooks]:
    """Return the estimates of all that is sought from a view's pictures.

    Parameters
    ----------
    part : the CAD model
    sought : features, from `seek_all`
    view : view with pictures, and the part's pose in them
    settings : see `measure`
    """
    features: dict[tuple[object, ...], Feature] = {}
    for one in sought:
        features = {**one.features, **features}
    answers = [DimensionLooks([], ([], [])) for _ in sought]
    if not features:
        return answers
    prediction = predict(part, view, tuple(features.values()))
    sharpness = None
    for lamp in view.lamps:
        fits, sharp = fit_features(part, prediction, lamp, sharpness, settings)
        sharpness = sharpness or sharp
        by_key: dict[tuple[object, ...], FeatureFit] = dict(zip(features, fits, strict=True))
        for one, found in zip(sought, answers, strict=True):
            own = [by_key[key] for key in one.features]
            found.whole.append(estimate(one, own, view, lamp, settings))
            if one.is_halved and found.whole[-1].look.reason:
                for k, half in enumerate(found.halves):
                    half.append(estimate(one, own, view, lamp, settings, k))
    return answers


def result_of(characteristic: Characteristic, found: Combined) -> Measured:
    """Return a characteristic with its verdict; a FAIL needs two looks, or one before the panel.

    Parameters
    ----------
    characteristic : the characteristic
    found : combined result of all looks
    """
    verdict, reason, is_disputed = Verdict.NOT_EVALUATED, found.reason, found.is_disputed
    if found.measured_mm is not None and found.U_mm is not None:
        verdict = Verdict.INDETERMINATE
        if not found.is_open:
            verdict = verdict_of(characteristic, found.measured_mm, found.U_mm)
            reason = _why(characteristic, found.measured_mm, found.U_mm, verdict)
            if verdict is Verdict.FAIL and not found.is_sure:
                verdict, reason, is_disputed = (
                    Verdict.INDETERMINATE,
                    say("{reason}; {unsure}", reason=reason, unsure=UNSURE),
                    True,
                )
    return Measured(
        characteristic=characteristic,
        measured_mm=found.measured_mm,
        U_mm=found.U_mm,
        verdict=verdict,
        views=found.views,
        reason=reason,
        looks=found.looks,
        is_disputed=is_disputed,
    )


def _why(characteristic: Characteristic, value: float, U: float, verdict: Verdict) -> str:
    """Return, in words, the limit that a value exceeds or comes too close to; empty if neither.

    Parameters
    ----------
    characteristic : the characteristic, with its limits
    value, U : measured value and expanded uncertainty
    verdict : verdict on it
    """
    if verdict is Verdict.PASS:
        return ""
    lower, upper = characteristic.lower_mm, characteristic.upper_mm
    is_upper = abs(value - upper) <= abs(value - lower) or characteristic.is_one_sided
    limit, side = (upper, key("upper")) if is_upper else (lower, key("lower"))
    word = key("beyond") if verdict is Verdict.FAIL else key("too near to")
    return say(
        "{value:.3f} is {word} the {side} limit {limit:.3f}, U {u:.3f}",
        value=value,
        word=word,
        side=side,
        limit=limit,
        u=U,
    )
