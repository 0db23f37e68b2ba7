"""Reach of the arm: configurations near others, and places with its fingers down."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from controller.arrays import FloatArray
from controller.planning.model import CellLayout
from controller.planning.motion import Scene, inverse_rows, slides, tcp_pose
from messages import key, say

HEADINGS: Final = 36
MARGIN_MM: Final = 10.0
LEVER_MM: Final = 200.0  # mm that one radian counts as: about the distance from wrist to part
_STEP_MM: Final = 0.02  # of a joint, for derivatives; a turn by its lever
_TRIES: Final = 40
_NEAR_MM: Final = 0.01
# a direction that needs joints to go a thousand times as far counts as unreachable
_WEAK: Final = 1e-3


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


def near_rows(layout: CellLayout, q: FloatArray, T_world_tcp: FloatArray) -> FloatArray:
    """Return the joints (n, 6) near others that bring the TCP to poses; NaN where there are none.

    Forward kinematics are followed numerically, so that no elbow changes sides, and a joint that a
    pose leaves free stays where it is.

    Parameters
    ----------
    layout : the cell
    q : (n, 6) joints to go from
    T_world_tcp : (n, 4, 4), each near to where the TCP is at them
    """
    weights = np.where(slides(layout.arm), 1.0, 1.0 / LEVER_MM)
    steps = _STEP_MM * np.diag(weights)
    rows = np.array(q, dtype=np.float64)
    for _ in range(_TRIES):
        off = _twist(tcp_pose(layout, rows), T_world_tcp)
        is_off = np.linalg.norm(off, axis=1) >= _NEAR_MM
        if not is_off.any():
            break
        here = rows[is_off][:, None]
        twists = _twist(tcp_pose(layout, here - steps), tcp_pose(layout, here + steps))
        jacobian = np.swapaxes(twists, 1, 2) / (2.0 * _STEP_MM)
        change = np.linalg.pinv(jacobian, rcond=_WEAK) @ off[is_off][..., None]
        rows[is_off] += weights * change[..., 0]
    return np.where(is_off[:, None], np.nan, rows)


def shifted(layout: CellLayout, q: FloatArray, by_mm: FloatArray) -> FloatArray:
    """Return joints (n, 6) near others with the TCP elsewhere and turned as it was; NaN if none.

    Parameters
    ----------
    layout : the cell
    q : (n, 6) joints
    by_mm : (3,) shift of the TCP in the world
    """
    T = tcp_pose(layout, q)
    T[:, :3, 3] += by_mm
    return near_rows(layout, q, T)


def _twist(T_from: FloatArray, T_to: FloatArray) -> FloatArray:
    """Return the twists from poses to others (..., 6): shift [mm], rotation [rad x lever]."""
    R = T_to[..., :3, :3] @ np.swapaxes(T_from[..., :3, :3], -1, -2)
    turn = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(*R.shape[:-2], 3)
    return np.concatenate([T_to[..., :3, 3] - T_from[..., :3, 3], LEVER_MM * turn], axis=-1)


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
            found.append(Unreached(name, key("beyond the reach or the limits of the joints")))
        elif not scene.free(rows, MARGIN_MM).any():
            found.append(
                Unreached(
                    name,
                    say("in contact with {touched} on every side", touched=_touched(scene, rows)),
                )
            )
        elif not all(len(rows_down(layout, place + off)) for off in beside):
            found.append(
                Unreached(
                    name, say("within {u_mm:.1f} mm (k = 2) of the limits of the joints", u_mm=u_mm)
                )
            )
    return tuple(found)


def _touched(scene: Scene, rows: FloatArray) -> str:
    """Return the obstacle that most of the configurations (n, 6) come too close to."""
    names = scene.contacts(rows, MARGIN_MM)
    most = int(np.bincount(names[names >= 0]).argmax())
    return scene.names()[most].replace("_", " ")
