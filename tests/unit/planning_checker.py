"""A second opinion on plans: triangles and FCL where the planner uses boxes and its own test.

Shares no geometry code with `controller.planning`: the arm's links are placed from the formulas
of umi_rtx.md 6.4, the part is its mesh, contacts are FCL's.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import fcl
import numpy as np

from controller.cad import Solid
from controller.planning import CellLayout, Grip, HandOver, Pick, Plan, Present, TakeBack

# the part touches what holds it; neighbours in the arm's chain are kept apart by joint limits
Named = tuple[str, fcl.CollisionObject]


def rz(angle: float) -> np.ndarray:
    T = np.eye(4)
    T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return T


def shift(x: float, y: float, z: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def ry(angle: float) -> np.ndarray:
    T = np.eye(4)
    T[0, 0] = T[2, 2] = np.cos(angle)
    T[0, 2], T[2, 0] = np.sin(angle), -np.sin(angle)
    return T


def rx(angle: float) -> np.ndarray:
    T = np.eye(4)
    T[1, 1] = T[2, 2] = np.cos(angle)
    T[1, 2], T[2, 1] = -np.sin(angle), np.sin(angle)
    return T


class Checker:
    def __init__(self, layout: CellLayout, solid: Solid) -> None:
        self.layout = layout
        model = fcl.BVHModel()
        model.beginModel(len(solid.mesh.faces), len(solid.mesh.vertices))
        model.addSubModel(np.asarray(solid.mesh.vertices), np.asarray(solid.mesh.faces))
        model.endModel()
        self.mesh = model
        self.vertices = np.asarray(solid.mesh.vertices)
        self.states = 0

    def frames(self, q: np.ndarray) -> dict[str, np.ndarray]:
        arm = self.layout.arm
        base = self.layout.T_world_arm @ shift(0, 0, arm.wrist_height_mm + q[3])
        upper = base @ rz(q[0])
        fore = upper @ shift(arm.upper_mm, 0, 0) @ rz(q[1])
        # the yaw belt takes back half of the elbow's turn (umi_rtx.md 5.4)
        wrist = fore @ shift(arm.fore_mm, 0, 0) @ rz(q[2] - q[1] / 2)
        tip = wrist @ ry(-q[4]) @ rx(q[5]) @ shift(arm.tool_mm, 0, 0)
        return {"carriage": base, "upper": upper, "fore": fore, "tip": tip}

    @staticmethod
    def solid_box(box: Any, T: np.ndarray) -> fcl.CollisionObject:
        placed = T @ box.T
        return fcl.CollisionObject(
            fcl.Box(*(2 * box.half_mm)), fcl.Transform(placed[:3, :3], placed[:3, 3])
        )

    def part(self, T: np.ndarray) -> fcl.CollisionObject:
        return fcl.CollisionObject(self.mesh, fcl.Transform(T[:3, :3], T[:3, 3]))

    def state(
        self,
        q: np.ndarray,
        opening: float,
        fixture_opening: float,
        T_world_part: np.ndarray,
        held_by: tuple[str, ...],
    ) -> list[str]:
        """Return the contacts of one instant; the part stands at T_world_part."""
        self.states += 1
        cell = self.layout
        f = self.frames(q)
        eye = np.eye(4)
        arm: list[Named] = [
            ("carriage", self.solid_box(cell.carriage, f["carriage"])),
            ("upper", self.solid_box(cell.upper, f["upper"])),
            ("fore", self.solid_box(cell.fore, f["fore"])),
            *(("hand", self.solid_box(b, f["tip"])) for b in cell.hand.body),
            *(("finger", self.solid_box(b, f["tip"])) for b in cell.hand.fingers(opening)),
        ]
        still: list[Named] = [
            ("column", self.solid_box(cell.column, eye)),
            *((n, self.solid_box(b, eye)) for n, b in cell.obstacles.items()),
            *(("fixture", self.solid_box(b, cell.T_world_fixture)) for b in cell.fixture.body),
            *(
                ("fixture finger", self.solid_box(b, cell.T_world_fixture))
                for b in cell.fixture.fingers(fixture_opening)
            ),
        ]
        part = ("part", self.part(T_world_part))
        pairs = [(a, s) for a in arm for s in still]
        pairs += [(a, b) for a in arm[3:] for b in arm[:2]]
        pairs += [(a, arm[2]) for a in arm if a[0] == "finger"]
        pairs += [
            (part, s) for s in still if not (s[0] == "fixture finger" and "fixture" in held_by)
        ]
        pairs += [(part, a) for a in arm if not (a[0] == "finger" and "arm" in held_by)]
        skip = {("carriage", "column"), ("upper", "column")}
        found = []
        for (name_a, a), (name_b, b) in pairs:
            if (name_a, name_b) in skip:
                continue
            if fcl.collide(a, b, fcl.CollisionRequest(), fcl.CollisionResult()):
                found.append(f"{name_a} - {name_b}")
        for name, box in [("fore", cell.fore), *(("hand", b) for b in cell.hand.body)] + [
            ("finger", b) for b in cell.hand.fingers(opening)
        ]:
            T = f["fore" if name == "fore" else "tip"] @ box.T
            corners = np.array(np.meshgrid(*[[-h, h] for h in box.half_mm])).reshape(3, -1)
            if (T[2, :3] @ corners + T[2, 3]).min() < 0:
                found.append(f"{name} - table")
        if (self.vertices @ T_world_part[2, :3] + T_world_part[2, 3]).min() < -0.2:
            found.append("part - table")
        return found

    def drive(
        self,
        path: list[np.ndarray],
        opening: float,
        fixture_opening: float,
        carried: Grip | None,
        T_still: np.ndarray | None,
        held_by: tuple[str, ...],
        what: str,
    ) -> list[str]:
        trouble = []
        for a, b in pairwise(path):
            change = np.abs(b - a) / np.array([0.03, 0.03, 0.06, 10.0, 0.06, 0.06])
            for s in np.linspace(0, 1, max(2, int(np.ceil(change.max())))):
                q = a + s * (b - a)
                T = (
                    self.frames(q)["tip"] @ np.linalg.inv(carried.T_part_hand)
                    if carried
                    else T_still
                )
                assert T is not None
                trouble += [
                    f"{what}: {c}" for c in self.state(q, opening, fixture_opening, T, held_by)
                ]
        return sorted(set(trouble))


def check(plan: Plan, layout: CellLayout, solid: Solid, T_world_part: np.ndarray) -> list[str]:
    """Return every contact found along a whole plan, each named once."""
    c = Checker(layout, solid)
    wide = layout.fixture.max_mm
    q = layout.park_q
    opening = layout.hand.max_mm
    trouble: list[str] = []
    T = T_world_part
    for step in plan.steps:
        if isinstance(step, Pick):
            g = step.grip
            path = [q, *step.motion_in, *step.motion_down]
            trouble += c.drive(path, step.pre_open_mm, wide, None, T, (), step.label)
            path = [path[-1], *step.motion_up]
            trouble += c.drive(path, g.opening_mm, wide, g, None, ("arm",), step.label)
            q = path[-1]
        elif isinstance(step, Present):
            path = [q, *step.motion]
            g = step.grip
            trouble += c.drive(path, g.opening_mm, wide, g, None, ("arm",), step.label)
            q = path[-1]
        elif isinstance(step, HandOver):
            path = [q, *step.motion]
            g = step.grip
            trouble += c.drive(
                path, g.opening_mm, step.fixture_pre_open_mm, g, None, ("arm",), step.label
            )
            T = c.frames(path[-1])["tip"] @ np.linalg.inv(g.T_part_hand)
            held = step.fixture_expected_opening_mm
            path = [path[-1], *step.retreat]
            opening = step.hand_open_mm
            trouble += c.drive(path, opening, held, None, T, ("fixture",), step.label)
            q = path[-1]
        elif isinstance(step, TakeBack):
            held = step.fixture_grip.opening_mm
            # the jaws are still as they let go; they open where the straight way begins
            path = [q, *step.motion_in]
            trouble += c.drive(path, opening, held, None, T, ("fixture",), step.label)
            for between in np.linspace(opening, step.pre_open_mm, 9):
                found = c.state(path[-1], float(between), held, T, ("fixture",))
                trouble += [f"{step.label}: {contact}" for contact in found]
            path = [path[-1], *step.approach]
            trouble += c.drive(path, step.pre_open_mm, held, None, T, ("fixture",), step.label)
            g = step.grip
            path = [path[-1], *step.motion_out]
            trouble += c.drive(
                path, g.opening_mm, step.fixture_open_mm, g, None, ("arm",), step.label
            )
            q = path[-1]
    for name, place in plan.place.items():
        g = place.grip
        path = [q, *place.motion, *place.motion_down]
        trouble += c.drive(path, g.opening_mm, wide, g, None, ("arm",), place.label)
        T = place.T_world_part
        path = [path[-1], *place.motion_up]
        trouble += c.drive(path, place.open_mm, wide, None, T, (), place.label)
        path = [path[-1], *plan.park[name].motion]
        trouble += c.drive(path, place.open_mm, wide, None, T, (), place.label)
    return sorted(set(trouble))
