"""Check for a wrong part: its mirror image, fitted to the same outlines, as a rival.

A part made the wrong way round has all its dimensions right. Where the part that was expected
leaves much of the outlines unexplained, the mirror image is tried, turned by half a turn about each
axis too, since it was taken for the part when it was grasped. Both are weighed by how probable the
outlines are if it is the one or the other: faces out of place count as what they are, improbable.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Solid

from .._pose import PosedPart
from ._joint import fit_grasp
from ._types import GraspPose, OutlineView, PoseSettings

SUSPECT_SHARE: Final = 0.985  # share of the outline in place below which the part is suspect
LOST_PX: Final = 6.0  # offset counted for an outline point without a partner
POINT_PX: Final = 3.0  # length along an outline that counts as one piece of evidence
DECIDED: Final = 20.0  # logarithm of the odds from which a rival is believed
EXPLAINS: Final = 0.97  # least share of the outlines that an accepted rival explains


@dataclass(frozen=True, slots=True)
class Rival:
    """A hypothesis that explains the outlines better than the expected part.

    Attributes
    ----------
    name : what it is
    log_odds : against the part expected, from the outlines alone
    explained, expected_explained : share of the outlines that lie where they should, for both
    """

    name: str
    log_odds: float
    explained: float
    expected_explained: float


def mirror_image(solid: Solid) -> Solid:
    """Return the mirror image of a solid, about its centroid, across x."""
    mesh = solid.mesh.copy()
    centre = solid.centroid_mm
    flip = np.array([-1.0, 1.0, 1.0])
    mesh.vertices = (np.asarray(mesh.vertices) - centre) * flip + centre
    mesh.faces = np.asarray(mesh.faces)[:, ::-1]
    faces = tuple(
        replace(
            face,
            normal=face.normal * flip,
            axis=face.axis * flip,
            centre_mm=(face.centre_mm - centre) * flip + centre,
        )
        for face in solid.faces
    )
    return replace(solid, mesh=mesh, faces=faces)


def is_suspect(fits: Sequence[GraspPose | None]) -> bool:
    """Return True if the outlines leave it open whether this is the part expected."""
    poses = [view for fit in fits if fit is not None for view in fit.views]
    if not poses or any(fit is None or fit.missing for fit in fits):
        return True
    return min(_explained([fit])[0] for fit in fits if fit is not None) < SUSPECT_SHARE


def find_rival(
    part: PosedPart,
    grasps: Sequence[Sequence[OutlineView]],
    fits: Sequence[GraspPose | None],
    settings: PoseSettings,
) -> Rival | None:
    """Return the mirror image if the outlines show that it is there, else None.

    Parameters
    ----------
    part : the part expected
    grasps : its views, grasp by grasp
    fits : the fits of the part expected to them
    settings : what is known of arm, parts and light
    """
    image = PosedPart(mirror_image(part.solid))
    best: list[GraspPose | None] = []
    for views in grasps:
        tried = [fit_grasp(image, _turned(views, part, k), settings) for k in range(4)]
        best.append(max(tried, key=lambda fit: _log_likelihood(fit, settings)))
    if any(fit is None for fit in best):
        return None
    log_odds = sum(_log_likelihood(fit, settings) for fit in best) - sum(
        _log_likelihood(fit, settings) for fit in fits
    )
    explained, _ = _explained(best)
    expected, _ = _explained(fits)
    # a part that is nearly its own mirror image explains what its image does, to a hair's breadth
    is_explained = expected >= min(explained, SUSPECT_SHARE)
    if log_odds < DECIDED or explained < EXPLAINS or is_explained:
        return None
    return Rival("its mirror image", log_odds, explained, expected)


def _turned(views: Sequence[OutlineView], part: PosedPart, axis: int) -> list[OutlineView]:
    """Return the views with the pose expected turned by half about an axis; 3 for not turned."""
    centre = part.solid.centroid_mm
    turn = np.eye(4)
    if axis < 3:
        signs = -np.ones(3)
        signs[axis] = 1.0
        turn[:3, :3] = np.diag(signs)
        turn[:3, 3] = centre - signs * centre
    return [replace(view, T_world_part=view.T_world_part @ turn) for view in views]


def _offs(fit: GraspPose) -> list[tuple[FloatArray, float]]:
    """Return the offsets of outlines with lost points counted, faces unmoved; and px a point."""
    out = []
    for view in fit.views:
        off = np.nan_to_num(np.abs(view.gap_px[view.judged]), nan=LOST_PX)
        out.append((off, view.step_px))
    return out


def _log_likelihood(fit: GraspPose | None, settings: PoseSettings) -> float:
    if fit is None:
        return -np.inf
    total = 0.0
    for (off, step_px), view in zip(_offs(fit), fit.views, strict=True):
        sigma = np.hypot(view.noise_px, settings.light_px) + settings.face_mm * view.px_per_mm
        pieces = step_px / POINT_PX
        total -= 0.5 * pieces * float(((np.minimum(off, LOST_PX) / sigma) ** 2).sum())
    return total


def _explained(fits: Sequence[GraspPose | None]) -> tuple[float, int]:
    every = [off for fit in fits if fit is not None for off, _ in _offs(fit)]
    if not every:
        return 0.0, 0
    off = np.concatenate(every)
    return float(np.mean(off < 0.5 * POINT_PX)), len(off)
