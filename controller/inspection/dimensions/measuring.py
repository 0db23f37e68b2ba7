"""All characteristics of a part measured in all its views."""

from collections.abc import Sequence
from typing import Final

from .._pose import PosedPart
from ..characteristics import Characteristic
from ._features import Feature, FeatureFit
from ._looks import Estimate, estimate, feature_key, features_of
from ._pictures import fit_features, predict
from ._types import BACKLIT, MeasuringSettings, PosedView
from .combine import Combined, combine

DEFAULT: Final = MeasuringSettings()


def measure(
    part: PosedPart,
    characteristics: Sequence[Characteristic],
    views: Sequence[PosedView],
    settings: MeasuringSettings = DEFAULT,
) -> tuple[Combined, ...]:
    """Return each characteristic's value and uncertainty from all views, in order.

    Parameters
    ----------
    part : the CAD model
    characteristics : what is asked
    views : with pictures, and the part's pose in them
    settings : when a measurement counts, and what is uncertain before any picture
    """
    estimates: list[list[Estimate]] = [[] for _ in characteristics]
    for view in views:
        for mine, found in zip(estimates, look(part, characteristics, view, settings), strict=True):
            mine += found
    return tuple(
        combine(characteristic, found, settings)
        for characteristic, found in zip(characteristics, estimates, strict=True)
    )


def look(
    part: PosedPart,
    characteristics: Sequence[Characteristic],
    view: PosedView,
    settings: MeasuringSettings = DEFAULT,
) -> list[list[Estimate]]:
    """Return what each picture of a view says of each characteristic.

    Parameters
    ----------
    part : the CAD model
    characteristics : what is asked
    view : with its pictures, and the part's pose
    settings : see `measure`
    """
    features: dict[tuple[object, ...], Feature] = {}
    for characteristic in characteristics:
        for feature in features_of(characteristic):
            features.setdefault(feature_key(feature), feature)
    answers: list[list[Estimate]] = [[] for _ in characteristics]
    if not features:
        return answers
    prediction = predict(part, view, tuple(features.values()))
    sharpness = None
    for lamp in (BACKLIT, *view.pictures.lit):
        fits, sharp = fit_features(part, prediction, lamp, sharpness, settings)
        sharpness = sharpness or sharp
        by_key: dict[tuple[object, ...], FeatureFit] = dict(zip(features, fits, strict=True))
        for characteristic, found in zip(characteristics, answers, strict=True):
            mine = [by_key[feature_key(f)] for f in features_of(characteristic)]
            found.append(estimate(characteristic, mine, view, lamp, part.solid, settings))
    return answers
