"""The figures of an arm that its calibration found, put into its model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final, Protocol, Self, runtime_checkable

import numpy as np

from controller.arrays import FloatArray
from controller.config import ConfigError
from controller.planning.model import ArmModel

if TYPE_CHECKING:  # a run loads no fits
    from controller.calibration.kinematics import KinematicArm

# An arm whose figures are farther off than this many times their bounds is another arm.
MAX_BOUNDS: Final = 10.0


@runtime_checkable
class MeasurableArm(Protocol):
    """A model whose figures can be measured; it also is an `ArmModel`."""

    @property
    def figures(self) -> KinematicArm:
        """What a calibration finds of it."""

    def measured(self, values: FloatArray) -> Self:
        """Return the arm with other values (k,) of its figures."""


def as_measured(model: ArmModel, figures: Mapping[str, float]) -> ArmModel:
    """Return an arm with figures as they were measured, by name.

    Parameters
    ----------
    model : as drawn
    figures : all of them, or none

    Raises
    ------
    ConfigError : they are of another arm
    """
    if not figures:
        return model
    if not isinstance(model, MeasurableArm):
        raise ConfigError("`arm.figures`: the driver of this arm names no figures to be measured")
    known = model.figures.unknowns
    names = [one.name for one in known]
    if set(names) != figures.keys():
        other = sorted(set(names) ^ figures.keys())[0]
        raise ConfigError(
            f"`arm.figures`: `{other}` is a figure of this arm or of the calibration, and not of "
            "both: it was measured on another arm, or with another driver; calibrate this one"
        )
    for one in known:
        far = MAX_BOUNDS * one.bound
        if not abs(figures[one.name] - one.nominal) <= far:
            raise ConfigError(
                f"`arm.figures.{one.name}`: {figures[one.name]:g}, within {far:.3g} of the "
                f"drawing's {one.nominal:g} allowed: it was measured on another arm"
            )
    return model.measured(np.array([figures[name] for name in names]))
