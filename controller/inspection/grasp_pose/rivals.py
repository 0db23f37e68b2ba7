"""Check for a mirrored part: the mirror image is fitted to the same outlines as a rival.

A mirrored part has all its dimensions right. Where the expected part leaves much of the outlines
unexplained, the mirror image is tried, also turned by half a turn about each axis, since it was
grasped as if it were the expected part. Both are compared by the likelihood of the outlines, in
which faces out of place count as improbable.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Solid
from messages import key

from .._pose import PosedPart
from ..limits import LOST_PX
from ._joint import fit_grasp
from ._types import GraspPose, OutlinedView, PoseSettings

SUSPECT_SHARE: Final = 0.985  # share of the outline in place below which the part is suspect
POINT_PX: Final = 3.0  # length along an outline that counts as one piece of evidence
DECIDED: Final = 20.0  # least logarithm of the odds for which a rival is accepted
EXPLAINS: Final = 0.97  # least share of the outlines explained by an accepted rival


@dataclass(frozen=True, slots=True)
class Rival:
    """A hypothesis that explains the outlines better than the expected part.

    Attributes
    ----------
    name : name of the rival
    log_odds : log odds against the expected part, from the outlines alone
    explained, expected_explained : share of the outlines in place for the rival, and for the
        expected part
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
    """Return True if the outlines leave doubt whether this is the expected part."""
    poses = [view for fit in fits if fit is not None for view in fit.views]
    if not poses or any(fit is None or fit.missing for fit in fits):
        return True
    return min(_explained([fit])[0] for fit in fits if fit is not None) < SUSPECT_SHARE


def find_rival(
    part: PosedPart,
    grasps: Sequence[Sequence[OutlinedView]],
    fits: Sequence[GraspPose | None],
    settings: PoseSettings,
) -> Rival | None:
    """Return the mirror image as a rival if the outlines prove it; otherwise None.

    Parameters
    ----------
    part : expected part
    grasps : its views, grasp by grasp
    fits : fits of the expected part to them
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
    # A part that is nearly its own mirror image explains almost exactly as much as its image.
    is_explained = expected >= min(explained, SUSPECT_SHARE)
    if log_odds < DECIDED or explained < EXPLAINS or is_explained:
        return None
    return Rival(key("its mirror image"), log_odds, explained, expected)


def _turned(views: Sequence[OutlinedView], part: PosedPart, axis: int) -> list[OutlinedView]:
    """Return the views with the expected pose turned by half a turn about an axis; 3 for none."""
    centre = part.solid.centroid_mm
    turn = np.eye(4)
    if axis < 3:
        signs = -np.ones(3)
        signs[axis] = 1.0
        turn[:3, :3] = np.diag(signs)
        turn[:3, 3] = centre - signs * centre
    return [view.turned(turn) for view in views]


def _offs(fit: GraspPose) -> list[tuple[FloatArray, float]]:
    """Return the outlines' offsets, lost points included and faces unmoved, and px per point."""
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
