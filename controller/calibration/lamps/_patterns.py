"""Which lamp is lit, by the pattern of its light: over the table and on the panel of the station.

A pattern is the mean grey level in each field of a grid over both pictures, less that in the dark.
The expected pattern follows from the lamp's position: a matt surface is lit by the cosine of the
angle and the inverse square of the distance, a ring shines ahead; a panel glows by itself. Shadows
are left out, so patterns only agree roughly, and by far best with those of the right lamp.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from controller.arrays import FloatArray, Grey
from controller.imaging import Camera

GRID: Final = (4, 4)  # fields down and across


@dataclass(frozen=True, slots=True, eq=False)
class PatternLamp:
    """A lamp of the cell.

    Attributes
    ----------
    name : as the cell file has it
    points_mm : (n, 3) in the world, where its light comes from; none of a panel
    glows_in : the camera in whose picture it is itself the background; empty if in none
    axis : (3,) along which its light is brightest; None if it shines alike to all sides
    """

    name: str
    points_mm: FloatArray
    glows_in: str = ""
    axis: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class CameraBackground:
    """Background of a camera behind all parts.

    Attributes
    ----------
    name : name of the camera
    camera : rough pose of the camera
    point_mm, normal : (3,) a point of the surface in the world, and its direction
    """

    name: str
    camera: Camera
    point_mm: FloatArray
    normal: FloatArray


@dataclass(frozen=True, slots=True)
class Assignment:
    """Which lamp is lit when one is switched by its name.

    Attributes
    ----------
    switched : the name that was switched
    lit : the lamp whose pattern it makes
    agreement : agreement of the pattern seen with that of `lit`, 1 for the same, 0 for nothing
        alike
    own_agreement : the same with the pattern of `switched`
    """

    switched: str
    lit: str
    agreement: float
    own_agreement: float


def seen_pattern(pictures: Sequence[Grey], dark: Sequence[Grey]) -> FloatArray:
    """Return the pattern (cameras x fields,) of pictures (height, width), one for each camera.

    Parameters
    ----------
    pictures : with one lamp lit
    dark : the same with none
    """
    return np.concatenate(
        [_fields(lit) - _fields(unlit) for lit, unlit in zip(pictures, dark, strict=True)]
    )


def _fields(picture: Grey) -> FloatArray:
    rows, columns = GRID
    bands = np.array_split(picture.astype(np.float64), rows, axis=0)
    return np.array([field.mean() for b in bands for field in np.array_split(b, columns, axis=1)])


def expected_pattern(light: PatternLamp, surfaces: Sequence[CameraBackground]) -> FloatArray:
    """Return the pattern that a lamp makes, up to its brightness."""
    return np.concatenate([_expected_in(light, surface) for surface in surfaces])


def _expected_in(light: PatternLamp, surface: CameraBackground) -> FloatArray:
    rows, columns = GRID
    if light.glows_in:
        return np.full(rows * columns, float(light.glows_in == surface.name))
    width, height = surface.camera.size_px
    v = (np.arange(rows) + 0.5) / rows * height - 0.5
    u = (np.arange(columns) + 0.5) / columns * width - 0.5
    pixels = np.array([(x, y) for y in v for x in u])
    d = surface.camera.sight_lines(pixels)
    eye = surface.camera.position_mm
    share = ((surface.point_mm - eye) @ surface.normal) / (d @ surface.normal)
    points = eye + share[:, None] * d
    to_lamp = light.points_mm[None] - points[:, None]
    distance = np.linalg.norm(to_lamp, axis=2)
    cosine = np.clip(to_lamp @ surface.normal / distance, 0.0, None)
    if light.axis is not None:
        cosine = cosine * np.clip(-to_lamp @ light.axis / distance, 0.0, None)
    out: FloatArray = (cosine / distance**2).mean(axis=1)
    return out


def assign(
    seen: Mapping[str, FloatArray], expected: Mapping[str, FloatArray]
) -> tuple[Assignment, ...]:
    """Return the lamp that each name switches, for the best agreement of all together.

    Parameters
    ----------
    seen : the pattern of each name that was switched; a lamp that gives no light is left out
    expected : the pattern of each lamp
    """
    names, lamps = list(seen), list(expected)
    agreement = np.array(
        [[_agreement(seen[name], expected[lamp]) for lamp in lamps] for name in names]
    )
    if not names:
        return ()
    rows, columns = linear_sum_assignment(agreement, maximize=True)
    return tuple(
        Assignment(
            names[row],
            lamps[column],
            float(agreement[row, column]),
            float(agreement[row, lamps.index(names[row])]),
        )
        for row, column in zip(rows, columns, strict=True)
    )


def _agreement(seen: FloatArray, expected: FloatArray) -> float:
    """Return 1 less the share of a pattern that another one, at the best brightness, leaves.

    Sums of absolute differences, not of squares: fields in a shadow then weigh little against all
    others.
    """
    total = float(np.abs(seen).sum())
    there = expected > 0
    if not total or not there.any():
        return 0.0
    # the best brightness makes one field fit exactly: the sum is linear between these
    scales = np.unique(np.clip(seen[there] / expected[there], 0.0, None))
    left = np.abs(seen - scales[:, None] * expected).sum(axis=1)
    return float(1.0 - left.min() / total)
