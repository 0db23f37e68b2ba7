"""Depth of a blind hole, as far as pictures show it: never half as deep as it must be.

Seen along its axis a floor shows at the same place however deep it is. What shows its depth is how
its edges lie against those of the mouth, in a view that is turned a little; or how much of a lamp's
light gets in (`rise_by_light`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray

from ..dimensions import MeasuringSettings
from ._edges import PartEdges
from ._looks import FORM_PX, EdgeLook, State
from ._recesses import Recess

MIN_POINTS: Final = 6  # least number of points of the mouth, and of the floor, to show a depth
FOLLOWS: Final = 0.6  # share of a floor's edge, where it must show, that must lie on the fitted one
K: Final = 3.0  # standard deviations in the bound of a floor's height
HALF: Final = 0.5  # share of the depth; a floor that high is another hole's
# Error from which a floor is wrong, as a share of the depth and at least in mm: a general
# tolerance is less.
WRONG_SHARE: Final = 0.1
WRONG_MM: Final = 0.3
HIGH_COUNT: Final = 2  # pictures that have to show a floor in the upper half of its hole
LIT_SHARE: Final = 0.3  # the same share for a floor placed by light, whose model may err by more


@dataclass(frozen=True, eq=False, slots=True)
class FloorLook:
    """Height of a blind hole's floor above nominal in one picture.

    Attributes
    ----------
    view_id, lamp : which picture
    off_mm : out of the material; negative where it lies deeper
    u_mm : standard uncertainty
    is_by_light : by how much light gets in, not by edges
    """

    view_id: str
    lamp: str
    off_mm: float
    u_mm: float
    is_by_light: bool = False

    @property
    def room_mm(self) -> float:
        """Possible error of the height."""
        return K * self.u_mm


@dataclass(frozen=True, eq=False, slots=True)
class Floor:
    """The floor of a blind hole, by all pictures that show it.

    Attributes
    ----------
    recess : the hole
    looks : pictures that place its floor more surely than the hole is deep
    """

    recess: Recess
    looks: tuple[FloorLook, ...]

    @property
    def bound_mm(self) -> float:
        """Largest possible displacement of the floor; inf where that is too much.

        One picture that shows it is enough, unless any shows it out of place.
        """
        if self.is_doubted:
            return float("inf")
        return min((abs(one.off_mm) + one.room_mm for one in self._in_place), default=float("inf"))

    @property
    def is_doubted(self) -> bool:
        """True if a picture shows it out of place."""
        return bool(self._wrong)

    @property
    def elsewhere(self) -> tuple[FloorLook, ...]:
        """Pictures that show it out of place, the surest first; none where others outweigh them.

        A hole drilled too deep or too shallow by more than a tenth is another hole. As many
        pictures that show the floor in place outweigh them. In the upper half of the hole an edge
        may be the border of the mouth's own shadow: one picture does not prove it there.
        """
        wrong = self._wrong
        is_high = all(one.off_mm > HALF * self.recess.depth_mm for one in wrong)
        if len(wrong) <= len(self._in_place) or (is_high and len(wrong) < HIGH_COUNT):
            return ()
        return tuple(sorted(wrong, key=lambda one: one.u_mm))

    @property
    def off_mm(self) -> float:
        """Mean of the pictures that show it out of place, weighted by their variances."""
        looks = self.elsewhere
        weights = [1.0 / max(one.u_mm, 1e-6) ** 2 for one in looks]
        return float(np.average([one.off_mm for one in looks], weights=weights))

    @property
    def _wrong(self) -> list[FloorLook]:
        wrong_mm = max(WRONG_SHARE * self.recess.depth_mm, WRONG_MM)
        return [one for one in self.looks if abs(one.off_mm) - one.room_mm > wrong_mm]

    @property
    def _in_place(self) -> list[FloorLook]:
        wrong = self._wrong
        return [
            one
            for one in self.looks
            if one not in wrong and abs(one.off_mm) + one.room_mm < self._limit_mm(one)
        ]

    def _limit_mm(self, look: FloorLook) -> float:
        return (LIT_SHARE if look.is_by_light else HALF) * self.recess.depth_mm


def find_floor(
    edges: PartEdges,
    looks: Sequence[EdgeLook],
    recess: Recess,
    settings: MeasuringSettings,
    by_light: Sequence[FloorLook] = (),
) -> Floor:
    """Return the floor of a blind hole as the pictures show it.

    Parameters
    ----------
    edges : of the part
    looks : at them
    recess : a blind one
    settings : how far light moves an edge
    by_light : the pictures that show by light how deep it is
    """
    by_edges = (floor_look(edges, look, recess, settings) for look in looks)
    told = (one for one in by_light if _tells(one, recess))
    return Floor(recess, (*(one for one in by_edges if one is not None), *told))


def floor_look(
    edges: PartEdges,
    look: EdgeLook,
    recess: Recess,
    settings: MeasuringSettings,
    raised: tuple[float, PartEdges, EdgeLook] | None = None,
) -> FloorLook | None:
    """Return the height of a floor above nominal by its edges in a picture, None if not shown.

    Mouth and floor share how far the recess is out of place across its axis. What is less sure than
    the hole is deep says nothing. What lies as high as the mouth is the mouth's own edge, which the
    search took for the floor's.

    Parameters
    ----------
    edges : of the part
    look : at them
    recess : a blind one
    settings : how far light moves an edge
    raised : by how much the floor was raised to be looked for [mm], its edges there, and the look
        at these; None for its nominal place
    """
    raised_mm, floor_edges, at_floor = raised or (0.0, edges, look)
    mouth = np.flatnonzero(np.isin(edges.edge, list(recess.mouths[0])) & _is_found(look))
    on_floor = np.isin(floor_edges.edge, list(recess.floor))
    floor = np.flatnonzero(on_floor & _is_found(at_floor))
    if min(len(mouth), len(floor)) < MIN_POINTS:
        return None
    rise = np.concatenate([np.zeros(len(mouth)), at_floor.across[floor] @ recess.axis])
    normals = np.concatenate([look.normals[mouth], at_floor.normals[floor]])
    design = np.column_stack([normals, rise])
    sigma = np.concatenate([look.sigma_px[mouth], at_floor.sigma_px[floor]])
    weight = base = 1.0 / np.hypot(sigma, settings.lit_edge_px)
    offset = np.concatenate([look.offset_px[mouth], at_floor.offset_px[floor]])
    for _ in range(3):
        scaled = design * weight[:, None]
        try:
            covariance = np.linalg.inv(scaled.T @ scaled)
        except np.linalg.LinAlgError:
            return None
        solution: FloatArray = covariance @ (scaled.T @ (offset * weight))
        off = np.abs(offset - design @ solution)
        # what lies far off is another edge
        scale = max(1.5 * float(np.median(off)), settings.lit_edge_px)
        weight = base * np.minimum(1.0, scale / np.maximum(off, 1e-9))
    # the border of a shadow crosses where a floor must show, and does not follow it
    follows = off[len(mouth) :] <= FORM_PX + K * at_floor.sigma_px[floor]
    shown = on_floor & (at_floor.state != State.HIDDEN)
    if follows.sum() < max(MIN_POINTS, FOLLOWS * shown.sum()):
        return None
    # light moves all of a floor's edge together, and all of a mouth's
    size = float(np.sqrt(np.mean(rise[len(mouth) :] ** 2)))
    light = settings.lit_edge_px * np.sqrt(2.0) / max(size, 1e-9)
    u_mm = float(np.hypot(np.sqrt(covariance[2, 2]), light))
    one = FloorLook(look.view_id, look.lamp, raised_mm + float(solution[2]), u_mm)
    return one if _tells(one, recess) else None


def _tells(look: FloorLook, recess: Recess) -> bool:
    """Return True if a picture places a floor below the mouth, surely."""
    return max(look.off_mm, 0.0) + look.room_mm < recess.depth_mm


def _is_found(look: EdgeLook) -> BoolArray:
    return np.asarray(np.isfinite(look.offset_px) & (look.state != State.HIDDEN))
