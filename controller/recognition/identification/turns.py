"""Whether pictures of the table show how far a part is turned about an axis.

Of a shaft that stands on its end a backlit picture is the same at any turn, and a fit to it keeps
the turn it began with, which says nothing. All turns are then tried on the pictures under lamps;
where these leave it open, too, the turn is free. Of a shaft that lies on its side the turn about
its own axis, by which it has rolled, is left to the views in the gripper at once.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from controller.arrays import FloatArray

from ..fitting import FreeTurn, TurnPictures, likeliest_turn, refined_turn, twist
from .cutout import ObjectCutout
from .decide import DECIDES
from .hypotheses import OUTLINE_DECIDES, Hypothesis, look_inside, refitted

# Turns that no part has as a symmetry, unless it is round: an outline that fits at all of them
# fits at any.
GENERIC_RAD: Final = (1.0, 2.2, 4.1)
LEVEL: Final = 0.01  # a tilt below this says nothing of how high a point of the axis is
UP: Final = np.array([0.0, 0.0, 1.0])


def settle_turns(hypotheses: Sequence[Hypothesis], cutout: ObjectCutout) -> list[Hypothesis]:
    """Return hypotheses on a backlit outline at the turns that lamps show, best first.

    Unchanged where the outline shows the turn of the best one, or where that is round.

    Parameters
    ----------
    hypotheses : about an object, best first
    cutout : the object
    """
    settled = _settled(hypotheses[0], cutout) if hypotheses else None
    if settled is None:
        return list(hypotheses)
    best = hypotheses[0]
    if settled.free_turn is not None and not settled.free_turn.is_vertical(best.fit.T_world_part):
        # it lies on its side: what the outline shows of it, its ends say, stays as it is
        return [_settled(h, cutout) or h for h in hypotheses]
    found = {(best.part, best.pose): settled}
    for h in hypotheses[1:]:
        name = (h.part, h.pose)
        if name not in found and h.log_odds > best.log_odds - OUTLINE_DECIDES:
            found[name] = _settled(h, cutout) or h
    likely = sorted(found.values(), key=lambda h: -h.log_odds)
    return look_inside(likely, cutout)


def _settled(h: Hypothesis, cutout: ObjectCutout) -> Hypothesis | None:
    """Return a hypothesis at the turn that lamps show; None if the outline shows its turn."""
    entry = cutout.library.entries[h.part]
    roll = entry.roll_of(h.pose)
    if roll is not None:
        rolled = (h.fit.T_world_part @ roll.by(turn) for turn in (0.0, *GENERIC_RAD))
        return replace(h, free_turn=roll) if _alike(h, rolled, cutout) else None
    same_rad = entry.turns_of(h.pose)
    if len(same_rad) == 0:
        return None
    fits = _alike(h, (_turn(h, turn) for turn in (0.0, *GENERIC_RAD)), cutout)
    if not fits:
        return None
    free = FreeTurn(entry.pose(h.pose).R[2], _through(fits, entry.centroid_mm), same_rad)
    if not cutout.is_lit:
        return replace(fits[0], free_turn=free)
    views = [_lit(h, free, cutout)]
    found = likeliest_turn(free, views)
    if not found.is_decided:
        return replace(fits[0], free_turn=free)
    return refitted(h, _turn(h, refined_turn(views, found.turn_rad)), cutout)


def _turn(h: Hypothesis, turn_rad: float) -> FloatArray:
    """Return the pose (4, 4) of a hypothesis turned about the vertical through its place."""
    about = np.array([*h.place_mm, 0.0])
    return twist(turn_rad * UP, np.zeros(3), about) @ h.fit.T_world_part


def _alike(h: Hypothesis, poses: Iterable[FloatArray], cutout: ObjectCutout) -> list[Hypothesis]:
    """Return a hypothesis fitted from each pose (4, 4); none if the first one fits better."""
    fits: list[Hypothesis] = []
    for T_world_part in poses:
        fit = refitted(h, T_world_part, cutout)
        if fit is None or (fits and fits[0].log_odds - fit.log_odds >= DECIDES):
            return []
        fits.append(fit)
    return fits


def _through(fits: Sequence[Hypothesis], centroid_mm: FloatArray) -> FloatArray:
    """Return a point (3,) of the axis, CAD frame, about which some fits are turned.

    The centre of mass need not lie on it: it goes round it from fit to fit.
    """
    rows, places = [], []
    for one in fits:
        rows.append(np.hstack([np.eye(2), one.fit.T_world_part[:2, :3]]))
        places.append(one.place_mm)
    # place = axis + R off: of `off` what lies along the axis does not show, and is left at zero
    solution, *_ = np.linalg.lstsq(np.vstack(rows), np.concatenate(places), rcond=LEVEL)
    return np.asarray(centroid_mm - solution[2:])


def _lit(h: Hypothesis, free: FreeTurn, cutout: ObjectCutout) -> TurnPictures:
    """Return an object's pictures under lamps, in which a hypothesis may be turned."""
    return TurnPictures(
        free,
        cutout.library.model(h.part),
        h.fit.T_world_part,
        cutout.camera,
        cutout.crops[:-1],
        cutout.corner_px,
        cutout.inside,
    )
