"""A plan's motions, lifted clear of everything, for a dry run.

Each waypoint is raised along the world's z until the arm, with both grippers open and nothing held,
is clear of everything in a cell whose bodies are thicker by their unmeasured errors. Waypoints that
no lift makes free are left out, with the reason.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.planning import (
    GiveStep,
    JointPath,
    NoMotionError,
    Park,
    Pick,
    Place,
    Plan,
    Present,
    ReceiveStep,
    SetDown,
    Step,
)
from controller.planning.model import CellLayout
from controller.planning.motion import MARGIN_MM, Scene, connect, path_free, tcp_pose
from messages import say

from ..bench import UNCALIBRATED_MM, with_clearance
from ..jogging import RefusedMotionError, near_by, shifted

LIFTS_MM: Final = (100.0, 150.0, 200.0, 250.0, 300.0)
# Above this height over the table nothing is reached for: a smaller lift is enough where the arm
# can rise no further.
HIGH_MM: Final = 300.0
LESS_MM: Final = (50.0, 0.0)
_PIECE_MM: Final = 25.0


@dataclass(frozen=True, slots=True, eq=False)
class LiftedStep:
    """The motions of one step, lifted.

    Attributes
    ----------
    label : label of the step
    path : waypoints (6,), from where the step before ended
    lifted_mm : least and most of what its waypoints were raised by
    left_out : sentences on why waypoints are left out, one for each
    """

    label: str
    path: JointPath
    lifted_mm: tuple[float, float]
    left_out: tuple[str, ...]


def motions_of(step: Step) -> JointPath:
    """Return all waypoints of a step in order; a look at the table has none."""
    match step:
        case Pick():
            return (*step.motion_in, *step.motion_down, *step.motion_up)
        case Present() | Park():
            return step.motion
        case GiveStep():
            return (*step.motion, *step.retreat)
        case ReceiveStep():
            return (*step.motion_in, *step.approach, *step.motion_out)
        case SetDown() | Place():
            return (*step.motion, *step.motion_down, *step.motion_up)
        case _:
            return ()


def lift_plan(layout: CellLayout, plan: Plan) -> Iterator[LiftedStep]:
    """Yield the motions of a plan, lifted: its steps, then each tray and the park.

    Parameters
    ----------
    layout : the cell, as far as it is known
    plan : plan of a part that is not there
    """
    scene = dry_scene(layout)
    q = np.asarray(layout.park_q, dtype=float)
    trays = [step for tray in plan.place for step in (plan.place[tray], plan.park[tray])]
    for step in (*plan.steps, *trays):
        waypoints = motions_of(step)
        if waypoints:
            lifted = _lift(scene, q, step.label, waypoints)
            q = lifted.path[-1] if lifted.path else q
            yield lifted


def dry_scene(layout: CellLayout) -> Scene:
    """Return the scene of a dry run: all fixed obstacles, thickened, and both grippers open."""
    thick = with_clearance(layout, UNCALIBRATED_MM)
    return Scene(thick, layout.arm_gripper.max_mm, layout.fixed_open_mm)


def _lift(scene: Scene, q: FloatArray, label: str, waypoints: JointPath) -> LiftedStep:
    path: list[FloatArray] = []
    lifts: list[float] = []
    left_out: list[str] = []
    for waypoint in waypoints:
        found = _raised(scene, q, waypoint, label)
        if isinstance(found, str):
            left_out.append(found)
            continue
        way, lift_mm = found
        lifts.append(lift_mm)
        if not (len(way) == 1 and np.allclose(way[0], q, atol=1e-9)):
            path += way
        q = way[-1]
    least_most = (min(lifts), max(lifts)) if lifts else (0.0, 0.0)
    return LiftedStep(label, tuple(path), least_most, tuple(left_out))


def _raised(
    scene: Scene, q: FloatArray, waypoint: FloatArray, label: str
) -> tuple[JointPath, float] | str:
    """Return a path to a waypoint, raised, and the height; or the reason why there is none."""
    places = [
        (raised, lift_mm)
        for lift_mm in _lifts(scene.layout, waypoint)
        if (raised := _up(scene.layout, waypoint, lift_mm)) is not None
        and scene.free(raised[None], MARGIN_MM)[0]
    ]
    x, y, z = tcp_pose(scene.layout, waypoint)[:3, 3]
    where = f"x {x:.0f} y {y:.0f} z {z:.0f} mm"
    if not places:
        return say("{label}: no lift of {where} is free and within reach", label=label, where=where)
    for raised, lift_mm in places:
        if path_free(scene, (q, raised)):
            return (raised,), lift_mm
    for is_searched in (False, True):
        for raised, lift_mm in places[:2]:
            try:
                return connect(q, raised, scene, label, search=is_searched), lift_mm
            except NoMotionError:
                continue
    return say("{label}: no path over {where} is free", label=label, where=where)


def _lifts(layout: CellLayout, waypoint: FloatArray) -> tuple[float, ...]:
    is_high = tcp_pose(layout, waypoint)[2, 3] >= HIGH_MM
    return (*LIFTS_MM, *LESS_MM) if is_high else LIFTS_MM


def _up(layout: CellLayout, q: FloatArray, lift_mm: float) -> FloatArray | None:
    """Return the configuration (6,) with the TCP higher by a distance; None if there is none."""
    T = tcp_pose(layout, q)
    count = max(1, int(np.ceil(lift_mm / _PIECE_MM)))
    try:
        for number in range(1, count + 1):
            q = near_by(layout, q, shifted(T, "z", lift_mm * number / count))
    except RefusedMotionError:
        return None
    return q if layout.arm.within_limits(q).all() else None
