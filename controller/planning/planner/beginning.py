"""Beginnings of a plan: the part on the table, in the arm gripper, in the fixed gripper."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.imaging import RayCaster, inverse_pose
from messages import key

from ..model import (
    CellLayout,
    Grasp,
    InArm,
    InFixedGripper,
    Look,
    NoMotionError,
    OnTable,
    PreparedPart,
)
from ..motion import segment_seconds
from ..regrasps import PickPath, hand_offs, pick_paths
from ..views import table_views
from .build import Build, Builder, RefutedError
from .costs import RegraspSite, first_seconds, take_seconds

PICK_COUNT = 3  # pick paths of one grasp that are tried, the nearest first
AMONG_COUNT = 8  # the same number among neighbours, which block many paths


@dataclass(frozen=True, slots=True, eq=False)
class Beginning:
    """Beginning of a plan: the place of the part, and the ways into an arm grasp.

    Attributes
    ----------
    where : place of the part, for messages
    q : (6,) joint values of the arm
    first_s : (g,) cost of having the part in each arm grasp [s], inf where it cannot be had
    take : adds to a build the steps that bring the part into an arm grasp, given by its number;
        raises `RefutedError` where that cannot be driven
    pose_index : index of the stable pose the part has, -1 in a gripper
    look : information from the overhead camera so far; None if there is nothing new
    """

    where: str
    q: FloatArray
    first_s: FloatArray
    take: Callable[[Builder, Build, int], None]
    pose_index: int = -1
    look: Look | None = None


def from_table(
    part: PreparedPart, layout: CellLayout, start: OnTable, inspected: BoolArray
) -> Beginning:
    """Return the beginning of a plan for a part on the table.

    Parameters
    ----------
    part : prepared for this cell
    layout : the cell
    start : state of the part and of the arm at the start
    inspected : (n,) samples that need not be shown again

    Raises
    ------
    NoPlanError : and its kinds: no grasp takes the part from where it is
    """
    q = layout.park_q if start.q is None else start.q
    picks: dict[int, list[PickPath]] = {}
    for path in pick_paths(part, layout, start.T_world_part):
        picks.setdefault(path.grasp, []).append(path)
    for paths in picks.values():
        paths.sort(key=lambda p: float(segment_seconds(layout, q, p.down[0])))
        del paths[AMONG_COUNT if layout.neighbours else PICK_COUNT :]

    def pick(builder: Builder, build: Build, g: int) -> None:
        builder.pick(build, picks[g], start.T_world_part)

    return Beginning(
        where=key("on the table"),
        q=q,
        first_s=first_seconds(part, layout, q, picks),
        take=pick,
        pose_index=start.pose_index,
        look=_overhead_look(part, layout, start.T_world_part, inspected),
    )


def from_arm(part: PreparedPart, layout: CellLayout, start: InArm) -> Beginning:
    """Return the beginning of a plan for a part in the arm gripper.

    Parameters
    ----------
    part : prepared for this cell; the last of its arm grasps is the one that holds it
    layout : the cell
    start : the grasp as measured, and where the arm is
    """
    first_s = np.full(len(part.arm_grasps), np.inf)
    first_s[-1] = float(segment_seconds(layout, start.q, part.home_q[-1]))
    return Beginning(key("in the arm gripper"), start.q, first_s, _keep)


def from_fixed_gripper(part: PreparedPart, layout: CellLayout, start: InFixedGripper) -> Beginning:
    """Return the beginning of a plan for a part in the fixed gripper.

    Parameters
    ----------
    part : prepared for this cell
    layout : the cell
    start : the grasp as measured, and where the arm is
    """
    site = RegraspSite(-1, -1, hand_offs(layout, part.shape, start.grasp, part.arm_grasps))
    T_world_part = layout.T_world_fixed_tcp @ inverse_pose(start.grasp.T_part_tcp)
    return Beginning(
        where=key("in the fixed gripper"),
        q=start.q,
        first_s=take_seconds(part, layout, start.q, site),
        take=partial(_receive, site=site, held=start.grasp, T_world_part=T_world_part),
    )


def _keep(builder: Builder, build: Build, g: int) -> None:
    """Add no step: the arm gripper holds the part already."""


def _receive(
    builder: Builder,
    build: Build,
    g: int,
    *,
    site: RegraspSite,
    held: Grasp,
    T_world_part: FloatArray,
) -> None:
    try:
        builder.receive(build, g, site.paths[g], held, T_world_part)
    except NoMotionError as error:
        raise RefutedError(error, firsts=[g]) from error


def _overhead_look(
    part: PreparedPart, layout: CellLayout, T_world_part: FloatArray, inspected: BoolArray
) -> Look | None:
    options = part.options
    # a neighbour may hide the part's sides, and throws light on them
    if not options.table_views or layout.neighbours:
        return None
    (seen,) = table_views(
        part.samples,
        RayCaster(part.solid.mesh),
        T_world_part[None],
        layout.overhead,
        layout.overhead_sharp_mm,
        float(np.radians(options.max_incidence_deg)),
        options.min_px_per_mm,
    )
    if not (seen & ~inspected).any():
        return None
    eye = inverse_pose(T_world_part) @ np.append(layout.overhead.position_mm, 1.0)
    towards = eye[:3] - part.solid.centroid_mm
    return Look(
        seconds=0.0,
        label=key("view it on the table"),
        view_id="T0",
        T_world_part=T_world_part,
        direction_part=towards / np.linalg.norm(towards),
        seen=seen,
    )
