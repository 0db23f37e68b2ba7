"""Views of a part whose turn about an axis is a guess, once their lit pictures show it."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from controller.arrays import FloatArray
from controller.imaging import render_maps, view_roi
from controller.recognition.fitting import (
    RIM_PX,
    FreeTurn,
    TurnPictures,
    likeliest_turn,
    refined_turn,
)

from .._pose import PosedPart
from ._joint import fit_grasp
from ._types import OutlinedView, PoseSettings, ViewPose

Grasps = tuple[tuple[OutlinedView, ...], ...]


def settle_turn(
    part: PosedPart, grasps: Grasps, settings: PoseSettings, is_last: bool = True
) -> Grasps:
    """Return views, grasp by grasp, expected at the turn that their lit pictures show.

    Unchanged where the pictures leave it open. Grasps are looked at until they are sure of it; each
    has its own about that, since round jaws let a round part turn.

    Parameters
    ----------
    part : the part
    grasps : views of one guess, by their grasps
    settings : prior knowledge of arm, parts and light
    is_last : no view has shown another turn since; else what was shown of this one was wrong, and
        pictures that leave it open leave it open
    """
    free = grasps[0][0].task.facts.free_turn
    assert free is not None
    if free.is_shown and not is_last:
        free = replace(free, is_shown=False)
        grasps = tuple(tuple(_with_turn(view, free) for view in views) for views in grasps)
    looks = [_looks(part, free, views, settings) for views in grasps]
    turn = likeliest_turn(free, looks[0])
    for count in range(2, len(looks) + 1):
        if turn.is_sure:
            break
        turn = likeliest_turn(free, [look for mine in looks[:count] for look in mine])
    if not turn.is_decided:
        return grasps
    turns = (refined_turn(mine, turn.turn_rad) for mine in looks)
    return tuple(
        tuple(_with_turn(view.turned(free.by(own)), None) for view in views)
        for own, views in zip(turns, grasps, strict=True)
    )


def _looks(
    part: PosedPart, free: FreeTurn, views: Sequence[OutlinedView], settings: PoseSettings
) -> list[TurnPictures]:
    """Return the lit pictures of a grasp's views in which the part is found."""
    fit = fit_grasp(part, views, settings)
    posed = [] if fit is None else [(view, fit.view(view.task.view_id)) for view in views]
    found = (_look(part, free, view, pose) for view, pose in posed if pose is not None)
    return [look for look in found if look is not None]


def _turn_between(T_from: FloatArray, T_to: FloatArray, free: FreeTurn) -> float:
    """Return the turn [rad] about an axis of the part between two poses (4, 4) that are alike."""
    rotation, _ = cv2.Rodrigues(np.ascontiguousarray(T_from[:3, :3].T @ T_to[:3, :3]))
    return float(rotation[:, 0] @ free.axis)


def _with_turn(view: OutlinedView, free: FreeTurn | None) -> OutlinedView:
    facts = replace(view.task.facts, free_turn=free)
    return view.with_task(replace(view.task, facts=facts))


def _look(
    part: PosedPart, free: FreeTurn, view: OutlinedView, pose: ViewPose
) -> TurnPictures | None:
    """Return a view's lit pictures, cut to the part at its pose; None if it is out of sight.

    The pose is at the turn that is expected: an outline of many bores fits at wrong turns, too.
    """
    camera, T_measured = view.task.camera, pose.T_world_part_measured
    turn_rad = _turn_between(view.task.T_world_part_expected, T_measured, free)
    T_world_part = T_measured @ free.by(-turn_rad)
    roi = view_roi(np.asarray(part.solid.mesh.vertices), T_world_part, camera, RIM_PX)
    if roi is None:
        return None
    x0, y0, x1, y1 = roi
    own = render_maps(part.caster, T_world_part, camera, roi).mask.astype(np.uint8)
    rim = np.ones((2 * RIM_PX + 1,) * 2, np.uint8)
    inside = np.asarray(cv2.erode(own, rim) > 0) & ~view.scene.holder_mask[y0:y1, x0:x1]
    crops = tuple(picture[y0:y1, x0:x1] for picture in view.view.pictures.lit.values())
    return TurnPictures(free, part.edges, T_world_part, camera, crops, (x0, y0), inside)
