"""Capability of a cell before any measurement: the uncertainty that it can promise.

It is the uncertainty of one length between two edges in one picture, from the camera, the lens, the
depth at which the part is held, scale and temperature (shares: docs/characteristics.md). The actual
uncertainty of a measurement comes with its result.
"""

from dataclasses import dataclass
from math import atan, hypot, radians, sin
from typing import Final

import numpy as np

from .._types import Characteristic, CharacteristicKind, EdgePairGeometry, RimGeometry
from .decision import COVERAGE_FACTOR

MAX_SHARE: Final = 0.30  # largest share of the tolerance for 2 U: the limit of VDA 5 (S17)
# Angle to the axis of a recess, the middle of the 10 to 30 degrees at which views show its floor.
DEPTH_VIEW_RAD: Final = radians(20.0)
EXPANSION_PER_K: Final = 23e-6  # aluminium, which expands most of the metals in the cell


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Accuracy of measurement in a cell: standard uncertainties.

    Attributes
    ----------
    edge_px : noise of a found edge, over many rays
    light_px : place on a real edge at which light shows it
    lens_px : residual of distortion and focal length after calibration
    depth_mm : depth of the part along the line of sight, with one pose fitted to all views
    scale : scale of the calibration, as a share of a length
    temperature_k : deviation of the part's temperature from 20 degrees Celsius
    """

    edge_px: float
    light_px: float
    lens_px: float
    depth_mm: float
    scale: float
    temperature_k: float


@dataclass(frozen=True, slots=True)
class Station:
    """Camera at the station: pixel size on the part, distance, width of its picture [mm]."""

    mm_per_px: float
    distance_mm: float
    field_mm: float


@dataclass(frozen=True, slots=True)
class Capability:
    """Capability of a cell to verify a characteristic.

    Attributes
    ----------
    U_mm : expanded uncertainty (k = 2) that the cell can promise
    share : twice this uncertainty, as a share of the tolerance
    min_tolerance_mm : width of the narrowest tolerance that the cell can verify
    """

    U_mm: float
    share: float
    min_tolerance_mm: float

    @property
    def is_capable(self) -> bool:
        """True if the cell can verify the tolerance."""
        return self.share <= MAX_SHARE


def promised_budget_mm(length_mm: float, station: Station, accuracy: Accuracy) -> dict[str, float]:
    """Return the standard uncertainties of a length by name [mm].

    Parameters
    ----------
    length_mm : between two edges, square to the line of sight
    station, accuracy : of the cell
    """
    # The effects of lens and light differ more from edge to edge the farther apart the edges are.
    apart = hypot(1.0, length_mm / station.field_mm) * station.mm_per_px
    return {
        "edge": accuracy.edge_px * apart,
        "light": accuracy.light_px * apart,
        "lens": accuracy.lens_px * apart,
        "depth": length_mm * accuracy.depth_mm / station.distance_mm,
        "scale": length_mm * accuracy.scale,
        "temperature": length_mm * EXPANSION_PER_K * accuracy.temperature_k,
    }


def promised_mm(length_mm: float, station: Station, accuracy: Accuracy) -> float:
    """Return the expanded uncertainty (k = 2) of a length that a cell can promise.

    Parameters
    ----------
    length_mm : between two edges, square to the line of sight
    station, accuracy : of the cell
    """
    return COVERAGE_FACTOR * hypot(*promised_budget_mm(length_mm, station, accuracy).values())


def capability_of(
    characteristic: Characteristic, station: Station, accuracy: Accuracy
) -> Capability:
    """Return the capability of a cell to verify a characteristic.

    Parameters
    ----------
    characteristic : the characteristic, with its limits
    station, accuracy : station and accuracy of the cell
    """
    length = characteristic.length_mm or characteristic.nominal_mm
    U = promised_mm(length, station, accuracy) * _factor(characteristic)
    tolerance = zone_mm(characteristic)
    smallest = 2 * U / MAX_SHARE
    return Capability(U, 2 * U / tolerance if tolerance > 0 else np.inf, smallest)


def zone_mm(characteristic: Characteristic) -> float:
    """Return the width of a value's tolerance zone; for a position, its diameter."""
    if characteristic.kind == CharacteristicKind.POSITION:
        return 2 * characteristic.upper_mm
    return characteristic.tolerance_mm


def _factor(characteristic: Characteristic) -> float:
    """Return the ratio of a value's uncertainty to that of its edges.

    An error d of an edge changes the height of an arc by d, and the radius by d / (1 - cos(half the
    sweep)). From a half circle on, it changes the radius by d itself. At an angle a to its axis the
    same error changes the depth of a recess by d / sin(a).
    """
    geometry = characteristic.geometry
    if isinstance(geometry, EdgePairGeometry) and geometry.is_depth:
        # At a larger angle its near wall hides more than half of a deep floor.
        half_open = atan(_half_width_mm(geometry) / max(characteristic.nominal_mm, 1e-9))
        return 1.0 / sin(min(DEPTH_VIEW_RAD, half_open))
    if characteristic.kind != CharacteristicKind.RADIUS or not isinstance(geometry, RimGeometry):
        return 1.0
    sweep = min(max((rim.sweep_rad for rim in geometry.rims), default=np.pi), np.pi)
    return float(1.0 / (2 * sin(sweep / 4) ** 2))


def _half_width_mm(geometry: EdgePairGeometry) -> float:
    """Return the least distance of a mouth's edges from its middle, across its axis."""
    middles = [0.5 * (line.start_mm + line.end_mm) for line in geometry.other]
    off = [p - geometry.middle_mm for p in middles]
    across = [float(np.linalg.norm(d - (d @ geometry.direction) * geometry.direction)) for d in off]
    return min([*across, *(rim.radius_mm for rim in geometry.other_rims)])
