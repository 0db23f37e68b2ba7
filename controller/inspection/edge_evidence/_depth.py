"""How deep a blind hole is, as far as pictures show it: never half as deep as it must be.

Seen along its axis a floor shows at the same place however deep it is. What shows its depth is how
its edges lie against those of the mouth, in a view that is turned a little; or how much of a lamp's
light gets in (`rise_by_light`).
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from controller.arrays import FloatArray

from ..dimensions import MeasuringSettings
from ._edges import PartEdges
from ._looks import FORM_PX, EdgeLook, State
from ._recesses import Recess

MIN_POINTS: Final = 6  # of the mouth, and of the floor; fewer show no depth
FOLLOWS: Final = 0.6  # of a floor's edge, where it must show, that must lie on the fitted one
K: Final = 3.0  # standard deviations
HALF: Final = 0.5  # of the depth: a floor that high is another hole's
# of the depth, and at least: a general tolerance is less, and a floor so far off is no good one's
WRONG_SHARE: Final = 0.1
WRONG_MM: Final = 0.3
LIT_SHARE: Final = 0.3  # the same of a floor that is placed by light, whose model may err by more


def floor_bound_mm(
    edges: PartEdges,
    looks: Sequence[EdgeLook],
    recess: Recess,
    settings: MeasuringSettings,
    by_light: Sequence[tuple[float, float]] = (),
) -> float:
    """Return how far out of place a floor may be at most [mm]; inf where that is too much.

    One picture that shows it is enough, unless any shows it out of place: a hole drilled too deep
    or too shallow by more than a tenth is another hole.

    Parameters
    ----------
    edges : of the part
    looks : at them
    recess : a blind one
    settings : how far light moves an edge
    by_light : how much higher than nominal light shows it, and how surely [mm], picture by picture
    """
    found = [lift for look in looks if (lift := _lift(edges, look, recess, settings)) is not None]
    told = [(abs(mm), K * u_mm, HALF * recess.depth_mm) for mm, u_mm in found]
    told += [(abs(mm), K * u_mm, LIT_SHARE * recess.depth_mm) for mm, u_mm in by_light]
    # what is less sure than the hole is deep says nothing
    told = [one for one in told if one[1] < recess.depth_mm]
    wrong_mm = max(WRONG_SHARE * recess.depth_mm, WRONG_MM)
    if any(off - room > wrong_mm for off, room, _ in told):
        return float("inf")
    shown = (off + room for off, room, limit in told if off + room < limit)
    return min(shown, default=float("inf"))


def _lift(
    edges: PartEdges, look: EdgeLook, recess: Recess, settings: MeasuringSettings
) -> tuple[float, float] | None:
    """Return how much higher than nominal a picture shows a floor, and how surely [mm].

    Mouth and floor share how far the recess is out of place across its axis.
    """
    is_found = np.isfinite(look.offset_px) & (look.state != State.HIDDEN)
    on_floor = np.isin(edges.edge, list(recess.floor))
    mouth = np.flatnonzero(np.isin(edges.edge, list(recess.mouths[0])) & is_found)
    floor = np.flatnonzero(on_floor & is_found)
    if min(len(mouth), len(floor)) < MIN_POINTS:
        return None
    points = np.concatenate([mouth, floor])
    rise = np.concatenate([np.zeros(len(mouth)), look.across[floor] @ recess.axis])
    design = np.column_stack([look.normals[points], rise])
    weight = base = 1.0 / np.hypot(look.sigma_px[points], settings.lit_edge_px)
    offset = look.offset_px[points]
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
    follows = off[len(mouth) :] <= FORM_PX + K * look.sigma_px[floor]
    if follows.sum() < max(MIN_POINTS, FOLLOWS * (on_floor & (look.state != State.HIDDEN)).sum()):
        return None
    # light moves all of a floor's edge together, and all of a mouth's
    size = float(np.sqrt(np.mean(rise[len(mouth) :] ** 2)))
    light = settings.lit_edge_px * np.sqrt(2.0) / max(size, 1e-9)
    return float(solution[2]), float(np.hypot(np.sqrt(covariance[2, 2]), light))
