"""Reach of the calibrated arm: places with its fingers down, beyond all uncertainty."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.planning.model import CellLayout
from controller.planning.motion import Scene, inverse_rows

HEADINGS: Final = 36
MARGIN_MM: Final = 10.0


@dataclass(frozen=True, slots=True)
class Unreached:
    """A place that the arm does not get to.

    Attributes
    ----------
    name : name of the place
    why : in words
    """

    name: str
    why: str


def rows_down(layout: CellLayout, place_mm: FloatArray) -> FloatArray:
    """Return the configurations (n, 6) with the TCP at a place (3,) and the fingers down.

    Down is along the arm's own column: there it has all headings, however its base leans.
    """
    T = np.zeros((HEADINGS, 4, 4))
    T[:, 3, 3] = 1.0
    for i, a in enumerate(np.linspace(-pi, pi, HEADINGS, endpoint=False)):
        c, s = np.cos(a), np.sin(a)
        down = np.array([[0.0, s, c], [0.0, c, -s], [-1.0, 0.0, 0.0]])
        T[i, :3, :3] = layout.T_world_arm[:3, :3] @ down
        T[i, :3, 3] = place_mm
    return inverse_rows(layout, T)[2]


def unreached(
    layout: CellLayout, scene: Scene, places: Mapping[str, FloatArray], u_mm: float
) -> tuple[Unreached, ...]:
    """Return the places that the arm does not get to with its fingers down.

    A place counts as reached if one configuration there is free of contact, and the joints also get
    to all that is within its expanded uncertainty.

    Parameters
    ----------
    layout : as calibrated
    scene : scene that has to be free
    places : (3,) in the world, by name
    u_mm : expanded uncertainty (k = 2) of where the arm is against the places
    """
    found = []
    beside = np.vstack([np.eye(3), -np.eye(3)]) * u_mm
    for name, place in places.items():
        rows = rows_down(layout, place)
        if not len(rows):
            found.append(Unreached(name, "beyond the reach or the limits of the joints"))
        elif not scene.free(rows, MARGIN_MM).any():
            found.append(Unreached(name, f"in contact with {_touched(scene, rows)} on every side"))
        elif not all(len(rows_down(layout, place + off)) for off in beside):
            found.append(
                Unreached(name, f"within {u_mm:.1f} mm (k = 2) of the limits of the joints")
            )
    return tuple(found)


def _touched(scene: Scene, rows: FloatArray) -> str:
    """Return the obstacle that most of the configurations (n, 6) come too close to."""
    names = scene.contacts(rows, MARGIN_MM)
    most = int(np.bincount(names[names >= 0]).argmax())
    return scene.names()[most].replace("_", " ")
