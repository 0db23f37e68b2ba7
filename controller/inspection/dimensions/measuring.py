"""Measurement of all characteristics of a part in all its views."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from .._pose import PosedPart
from .._types import Verdict
from ..characteristics import Characteristic, Measured, verdict_of
from ..kept import Kept
from ._features import Feature, FeatureFit
from ._looks import Estimate, Sought, estimate, features_of, seek
from ._pictures import fit_features, predict
from ._types import BACKLIT, MeasuringSettings, PosedView
from .combine import Combined, combine

DEFAULT: Final = MeasuringSettings()
UNSURE: Final = "one look under one lamp says so, and a FAIL needs two"


def measure(
    part: PosedPart,
    characteristics: Sequence[Characteristic],
    views: Sequence[PosedView],
    settings: MeasuringSettings = DEFAULT,
    kept: Kept | None = None,
) -> tuple[Measured, ...]:
    """Return the characteristics, in order, with value, uncertainty and verdict from all views.

    Parameters
    ----------
    part : the CAD model
    characteristics : characteristics to measure
    views : views with pictures, and the part's pose in them
    settings : limits of a valid measurement, and prior uncertainties
    kept : results computed before; None for none
    """
    kept = kept or Kept()
    sought = _sought(part, tuple(characteristics), kept)
    by_view = [_kept_looks(part, sought, view, settings, kept) for view in views]
    found = iter(_put_together(sought, by_view, settings))
    return tuple(
        Measured(c, None, None, Verdict.NOT_EVALUATED, (), why)
        if (why := _why_not(c))
        else next(found)
        for c in characteristics
    )


def measure_ahead(
    part: PosedPart,
    characteristics: tuple[Characteristic, ...],
    view: PosedView,
    settings: MeasuringSettings,
    kept: Kept,
) -> None:
    """Compute the results that `measure` will need from a view in advance.

    Parameters
    ----------
    part : the CAD model
    characteristics : characteristics to measure
    view : view with pictures, and the part's pose in them
    settings : see `measure`
    kept : store for the results
    """
    _kept_looks(part, _sought(part, characteristics, kept), view, settings, kept)


def _sought(
    part: PosedPart, characteristics: tuple[Characteristic, ...], kept: Kept
) -> tuple[Sought, ...]:
    """Return the features to seek in pictures, for the characteristics that one may show."""
    return kept.once(partial(_all_sought, part, characteristics), _all_sought, characteristics)


def _all_sought(part: PosedPart, characteristics: tuple[Characteristic, ...]) -> tuple[Sought, ...]:
    asked = (seek(c, part.solid) for c in characteristics if not _why_not(c))
    return tuple(one for one in asked if one is not None)


def _kept_looks(
    part: PosedPart,
    sought: tuple[Sought, ...],
    view: PosedView,
    settings: MeasuringSettings,
    kept: Kept,
) -> "list[_Looks]":
    return kept.once(
        partial(_looks, part, sought, view, settings), *(_looks, sought, view, settings)
    )


def _why_not(characteristic: Characteristic) -> str:
    """Return the reason why no picture can show a characteristic; empty where one may."""
    if not characteristic.is_measured:
        return characteristic.exempt or "it is not to be measured"
    if not features_of(characteristic):
        return "no edge of the CAD model shows it"
    return ""


def _put_together(
    sought: Sequence[Sought],
    by_view: Sequence[Sequence["_Looks"]],
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
    found = iter(_looks(part, known, view, settings))
    return [[] if one is None else next(found).whole for one in sought]


@dataclass(frozen=True, eq=False, slots=True)
class _Looks:
    """Estimates of a characteristic, and of each of its features, from a view."""

    whole: list[Estimate]
    halves: tuple[list[Estimate], list[Estimate]]


def _looks(
    part: PosedPart,
    sought: Sequence[Sought],
    view: PosedView,
    settings: MeasuringSettings,
) -> list[_Looks]:
    features: dict[tuple[object, ...], Feature] = {}
    for one in sought:
        features = {**one.features, **features}
    answers = [_Looks([], ([], [])) for _ in sought]
    if not features:
        return answers
    prediction = predict(part, view, tuple(features.values()))
    sharpness = None
    for lamp in (BACKLIT, *view.pictures.lit):
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
                verdict, reason, is_disputed = Verdict.INDETERMINATE, f"{reason}; {UNSURE}", True
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
    limit, side = (upper, "upper") if is_upper else (lower, "lower")
    word = "beyond" if verdict is Verdict.FAIL else "too near to"
    return f"{value:.3f} is {word} the {side} limit {limit:.3f}, U {U:.3f}"
