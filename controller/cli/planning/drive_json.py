"""A plan as the cell's actions: arm, grippers, motions and jaws of each step, custody, samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Solid, SurfaceSamples
from controller.cell.custody import Custody
from controller.planning import (
    CellLayout,
    GiveStep,
    Grasp,
    JointPath,
    Look,
    Park,
    Pick,
    Place,
    Plan,
    Present,
    ReceiveStep,
    SetDown,
    Step,
)
from controller.planning.model import Jaw
from controller.planning.motion import segment_seconds, travel_seconds

STILL_S = 1e-12  # a shorter move at full speed counts as none
ARM, FIXED = "arm", "fixture"


class Deeds:
    """Writes down the cell's actions step by step, and the places of arm and part meanwhile.

    Parameters
    ----------
    layout : the cell
    q : (6,) first joints of the arm
    custody : first custody of the part
    """

    def __init__(
        self, layout: CellLayout, q: FloatArray, custody: Custody = Custody.ON_TABLE
    ) -> None:
        self._layout = layout
        self._q = q
        self._custody = custody
        self._actions: list[dict[str, Any]] = []

    def branched(self) -> Deeds:
        """Return a copy to continue from."""
        return Deeds(self._layout, self._q, self._custody)

    def step_json(self, step: Step) -> dict[str, Any]:
        """Return custody before and after a step, and its actions in order; go on from its end."""
        self._actions = []
        before = self._custody
        self._do(step)
        custody = {"before": before.key, "after": self._custody.key}
        return {"custody": custody, "actions": self._actions}

    def _do(self, step: Step) -> None:
        match step:
            case Pick():
                self._open(ARM, step.pre_open_mm)
                self._move("motion_in", step.motion_in)
                self._move("motion_down", step.motion_down)
                self._close(ARM, step.expected_opening_mm, Custody.IN_ARM)
                self._move("motion_up", step.motion_up)
            case Present():
                self._move("motion", step.motion)
                self._note("look", camera="inspection")
            case Look():
                self._note("look", camera="overhead")
            case GiveStep():
                self._open(FIXED, step.fixed_pre_open_mm)
                self._move("motion", step.motion)
                self._close(FIXED, step.fixed_expected_opening_mm, Custody.IN_BOTH)
                self._open(ARM, step.arm_open_mm, Custody.IN_FIXED)
                self._move("retreat", step.retreat)
            case ReceiveStep():
                self._move("motion_in", step.motion_in)
                self._open(ARM, step.pre_open_mm)
                self._move("approach", step.approach)
                self._close(ARM, step.expected_opening_mm, Custody.IN_BOTH)
                self._open(FIXED, step.fixed_open_mm, Custody.IN_ARM)
                self._move("motion_out", step.motion_out)
                self._open(FIXED, self._layout.fixed_open_mm)
            case SetDown() | Place():
                self._move("motion", step.motion)
                self._move("motion_down", step.motion_down)
                is_placed = isinstance(step, Place)
                self._open(ARM, step.open_mm, Custody.PLACED if is_placed else Custody.ON_TABLE)
                self._move("motion_up", step.motion_up)
            case Park():
                self._move("motion", step.motion)
            case _:
                raise ValueError(f"no actions are known of a {type(step).__name__}")

    def _move(self, what: str, path: JointPath) -> None:
        waypoints = []
        for q in path:
            at_full_s = float(travel_seconds(self._layout, self._q, q))
            travel = np.abs(q - self._q)
            speeds = travel / at_full_s if at_full_s > STILL_S else np.zeros_like(travel)
            seconds = float(segment_seconds(self._layout, self._q, q))
            waypoints.append({"q": q.tolist(), "seconds": seconds, "speeds": speeds.tolist()})
            self._q = q
        if waypoints:
            self._note("move", path=what, waypoints=waypoints)

    def _open(self, gripper: str, opening_mm: float, custody: Custody | None = None) -> None:
        self._custody = custody or self._custody
        self._note("open", gripper=gripper, opening_mm=opening_mm)

    def _close(self, gripper: str, opening_mm: float, custody: Custody) -> None:
        jaw = self._layout.arm_gripper if gripper == ARM else self._layout.fixed_gripper
        assert jaw is not None
        self._custody = custody
        self._note("close", gripper=gripper, opening_mm=opening_mm, force_n=jaw.force_n)

    def _note(self, action: str, **more: Any) -> None:  # noqa: ANN401 - what an action has
        self._actions.append({"action": action, **more, "custody": self._custody.key})


def arm_json(layout: CellLayout) -> dict[str, Any]:
    """Return joints, limits and full speeds of the arm, and its first position."""
    arm = layout.arm
    speeds = arm.timing.joint_speeds
    return {
        "joints": [
            {"name": name, "unit": name.rsplit("_", 1)[1], "full_speed": float(speed)}
            for name, speed in zip(arm.joint_names, speeds, strict=True)
        ],
        "limits": [
            {"name": x.name, "weights": x.weights.tolist(), "low": x.low, "high": x.high}
            for x in arm.joint_limits
        ],
        "start_q": layout.park_q.tolist(),
    }


def grippers_json(layout: CellLayout) -> dict[str, Any]:
    """Return both grippers; the second is null if the cell has none."""
    fixed = layout.fixed_gripper
    return {
        ARM: _jaw_json(layout.arm_gripper),
        FIXED: None
        if fixed is None
        else _jaw_json(fixed) | {"T_world_tcp": layout.T_world_fixed_tcp.tolist()},
    }


def grasps_json(grasps: Sequence[Grasp]) -> list[dict[str, Any]]:
    """Return each grasp that a plan uses once, in the order of their first use."""
    return [
        {
            "id": grasp.id,
            "gripper": grasp.holder,
            "T_part_tcp": grasp.T_part_tcp.tolist(),
            "opening_mm": grasp.opening_mm,
            "pre_open_mm": grasp.pre_open_mm,
            "from_inside": grasp.is_inner,
            "contact_mm2": grasp.contact_mm2,
            "load": grasp.load,
        }
        for grasp in {(g.holder, g.id): g for g in grasps}.values()
    ]


def samples_json(solid: Solid, samples: SurfaceSamples) -> dict[str, Any]:
    """Return the samples that measure coverage, and the faces that they lie on."""
    return {
        "points_mm": np.round(samples.points_mm, 6).tolist(),
        "normals": np.round(samples.normals, 6).tolist(),
        "areas_mm2": samples.areas_mm2.tolist(),
        "faces": samples.face_ids.tolist(),
        "face_labels": {str(face.id): face.label for face in solid.faces},
    }


def _jaw_json(jaw: Jaw) -> dict[str, Any]:
    return {
        "max_opening_mm": jaw.max_mm,
        "force_n": jaw.force_n,
        "pad_mm": [jaw.pad_length_mm, jaw.finger_width_mm],
    }


def trays_json(plan: Plan, deeds: Deeds) -> dict[str, Any]:
    """Return for each tray the steps that end the plan there: placing, then parking.

    Parameters
    ----------
    plan : the plan
    deeds : actions at the end of the plan's steps
    """
    found = {}
    for tray, place in plan.place.items():
        own = deeds.branched()
        found[tray] = [
            {"kind": kind, "label": step.label, "seconds": step.seconds} | own.step_json(step)
            for kind, step in (("place", place), ("park", plan.park[tray]))
        ]
    return found
