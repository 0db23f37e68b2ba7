"""Bounds on the depth of a blind hole from pictures: surely more than half its nominal depth.

Along the axis of a hole, its floor appears at the same place whatever its depth. The depth follows
from the offset of the floor's edges against the mouth's in a slightly turned view, or from the
amount of a lamp's light that reaches the floor (`rise_by_light`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import Recess

from ..dimensions import MeasuringSettings
from ..limits import SURE_SIGMAS
from ._edges import PartEdges
from ._looks import FORM_PX, EdgeLook, EdgeLooks, State

MIN_POINTS: Final = 6  # least number of points on the mouth, and on the floor, for a depth
# Least share of a floor's visible edge that must lie on the fitted one.
FOLLOWS: Final = 0.6
# Height of a floor, as a share of the depth, from which it is another hole's.
OTHER_HOLE_SHARE: Final = 0.5
LIT_SHARE: Final = 0.3  # the same share for a floor placed by light, whose model has larger errors
# Error from which a floor is wrong, as a share of the depth and at least in mm; general tolerances
# are narrower.
WRONG_SHARE: Final = 0.1
WRONG_MM: Final = 0.3
HIGH_COUNT: Final = 2  # number of pictures required for a floor in the upper half of its hole
# Largest `FloorLook.uneven` of a bare floor. In seven looks at floors 10 and 14 mm deep, 5 and 6 mm
# wide, it was 0.01 to 0.03, with a block of 3 x 3 x 2 mm on one 0.13.
UNEVEN: Final = 0.06


@dataclass(frozen=True, eq=False, slots=True)
class FloorLook:
    """Height of a blind hole's floor above nominal in one picture.

    Attributes
    ----------
    view_id, lamp : view and lamp of the picture
    off_mm : height above nominal; negative for a deeper floor
    u_mm : standard uncertainty
    is_by_light : True if derived from the light that gets in, not from edges
    uneven : of a look by light, how far the light at any place as large as the smallest defect is
        off what the depth explains, as a share of that on the surface about the mouth
    """

    view_id: str
    lamp: str
    off_mm: float
    u_mm: float
    is_by_light: bool = False
    uneven: float = 0.0

    @property
    def room_mm(self) -> float:
        """Largest possible error of the height."""
        return SURE_SIGMAS * self.u_mm

    @property
    def source(self) -> str:
        """What no other look shares its errors with: its view, or the model of light."""
        return "light" if self.is_by_light else self.view_id

    def agrees_with(self, other: "FloorLook") -> bool:
        """Return True if another look shows the floor at the same height, within what is sure."""
        return abs(self.off_mm - other.off_mm) <= SURE_SIGMAS * float(
            np.hypot(self.u_mm, other.u_mm)
        )


@dataclass(frozen=True, eq=False, slots=True)
class Floor:
    """The floor of a blind hole in all pictures that show it.

    Attributes
    ----------
    recess : the hole
    looks : looks whose uncertainty is less than the depth of the hole
    """

    recess: Recess
    looks: tuple[FloorLook, ...]

    @property
    def bound_mm(self) -> float:
        """Largest possible displacement of the floor; inf where it is too large.

        One picture is enough, unless any shows the floor out of place.
        """
        if self.is_doubted:
            return float("inf")
        return min((abs(one.off_mm) + one.room_mm for one in self._in_place), default=float("inf"))

    @property
    def is_doubted(self) -> bool:
        """True if any picture shows it out of place."""
        return bool(self._wrong)

    @property
    def is_lit(self) -> bool:
        """True if any picture shows the light on it."""
        return any(one.is_by_light for one in self.looks)

    @property
    def is_even(self) -> bool:
        """True if no picture shows other light at a place on it than its depth explains."""
        return all(one.uneven <= UNEVEN for one in self.looks)

    @property
    def elsewhere(self) -> tuple[FloorLook, ...]:
        """Looks that show it out of place, the surest first; none where others outweigh them.

        A hole too deep or too shallow by more than a tenth is another hole. An equal number of
        pictures with the floor in place outweighs these looks. In the upper half of the hole an
        edge may be the border of the mouth's own shadow, so one picture is no proof there.
        """
        wrong = self._wrong
        is_high = all(one.off_mm > OTHER_HOLE_SHARE * self.recess.depth_mm for one in wrong)
        if len(wrong) <= len(self._in_place) or (is_high and len(wrong) < HIGH_COUNT):
            return ()
        return tuple(sorted(wrong, key=lambda one: one.u_mm))

    @property
    def is_agreed(self) -> bool:
        """True if edges and light show it out of place, at one height: no one error does both."""
        return any(
            one.is_by_light and not other.is_by_light and one.agrees_with(other)
            for one in self.elsewhere
            for other in self.elsewhere
        )

    @property
    def off_mm(self) -> float:
        """Mean of the looks that show it out of place, weighted by their variances."""
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
        return (LIT_SHARE if look.is_by_light else OTHER_HOLE_SHARE) * self.recess.depth_mm


def find_floor(shown: EdgeLooks, recess: Recess, by_light: Sequence[FloorLook] = ()) -> Floor:
    """Return the floor of a blind hole from all pictures.

    Parameters
    ----------
    shown : looks at the part's edges
    recess : a blind recess
    by_light : looks that derive its depth from light
    """
    by_edges = (floor_look(shown.edges, one, recess, shown.settings) for one in shown.every)
    told = (one for one in by_light if _tells(one, recess))
    return Floor(recess, (*(one for one in by_edges if one is not None), *told))


def floor_look(
    edges: PartEdges,
    look: EdgeLook,
    recess: Recess,
    settings: MeasuringSettings,
    raised: tuple[float, PartEdges, EdgeLook] | None = None,
) -> FloorLook | None:
    """Return the height of a floor above nominal by its edges in a picture; None if not visible.

    Mouth and floor share the displacement of the recess across its axis. A height less certain than
    the depth of the hole is no evidence. A floor as high as the mouth is the mouth's own edge,
    which the search took for the floor's.

    Parameters
    ----------
    edges : edges of the part
    look : look at them
    recess : a blind recess
    settings : uncertainties from light
    raised : height by which the floor was raised for the search [mm], its edges there, and the look
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
        # An edge far off is another one.
        scale = max(1.5 * float(np.median(off)), settings.lit_edge_px)
        weight = base * np.minimum(1.0, scale / np.maximum(off, 1e-9))
    # The border of a shadow crosses the floor's expected edge and does not follow it.
    follows = off[len(mouth) :] <= FORM_PX + SURE_SIGMAS * at_floor.sigma_px[floor]
    shown = on_floor & (at_floor.state != State.HIDDEN)
    if follows.sum() < max(MIN_POINTS, FOLLOWS * shown.sum()):
        return None
    # Light moves the whole edge of a floor together, and the whole edge of a mouth.
    size = float(np.sqrt(np.mean(rise[len(mouth) :] ** 2)))
    light = settings.lit_edge_px * np.sqrt(2.0) / max(size, 1e-9)
    u_mm = float(np.hypot(np.sqrt(covariance[2, 2]), light))
    one = FloorLook(look.view_id, look.lamp, raised_mm + float(solution[2]), u_mm)
    return one if _tells(one, recess) else None


def _tells(look: FloorLook, recess: Recess) -> bool:
    """Return True if a picture surely places a floor below the mouth."""
    return max(look.off_mm, 0.0) + look.room_mm < recess.depth_mm


def _is_found(look: EdgeLook) -> BoolArray:
    return np.asarray(np.isfinite(look.offset_px) & (look.state != State.HIDDEN))
