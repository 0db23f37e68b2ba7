"""The boxes of the cell, fixed and moving, as bodies: their places and overlaps."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..chain import TCP
from ..layout import Layout
from ..shapes import Array, Box
from .bodies import Bodies
from .collide import BOX_MM, PIECE_MM, PUSH_MM, BoxSet, Touch
from .grasp import Gripper
from .parts import AWAY, FALLING, HELD, PROPPED, Part

Mask = NDArray[np.bool_]

_NEAR_MM = 2.0  # a finger this near wakes a part at rest
_TABLE_MM = 0.3
_GRAZES_MM = 0.3  # distance of a part at rest from the face of a finger that slides along it
_GIVES_MM = 1.5  # the other gripper's pads yield by this and more
_UP = np.array((0.0, 0.0, 1.0))


class CellBoxes:
    """All boxes of the cell but the parts; follows arm and jaws, and reports contacts.

    Parameters
    ----------
    layout : arm, post, grippers, obstacles and chute of the cell
    bodies : the pybullet client that gets the boxes
    links : (4, 4) pose of each frame of the arm in the world [mm], by name
    arm_gripper, fixed_gripper : both grippers
    """

    def __init__(
        self,
        layout: Layout,
        bodies: Bodies,
        links: Mapping[str, Array],
        arm_gripper: Gripper,
        fixed_gripper: Gripper,
    ) -> None:
        self._bodies, self._links = bodies, links
        self._arm_gripper, self._fixed_gripper = arm_gripper, fixed_gripper
        identity = np.eye(4)
        arm = layout.arm
        fixed: list[tuple[Box, Array]] = [(arm.column, arm.T_world_column), (layout.post, identity)]
        fixed += [(box, identity) for box in layout.obstacles]
        fixed += [(one.box, one.T_world_box) for one in layout.chute]
        fixed += [(box, fixed_gripper.T_world_tcp) for box in layout.fixed_gripper.boxes]
        solid = [link for link in arm.chain.links if link.is_solid]
        moving = [(link.name, box) for link in solid for box in link.boxes]
        moving += [(TCP, box) for box in arm.gripper.boxes]
        meets_base = [link.meets_base for link in solid for _ in link.boxes]
        self._fixed_names = [box.name for box, _ in fixed]
        self._fixed_bodies = [bodies.add_box(box, T) for box, T in fixed]
        self._moving = [
            (frame, box.centre_mm, bodies.add_box(box, links[frame])) for frame, box in moving
        ]
        for gripper in (arm_gripper, fixed_gripper):
            one, two = (
                bodies.add_box(box, gripper.T_world_finger(side))
                for side, box in enumerate(gripper.finger_boxes)
            )
            gripper.finger_bodies = (one, two)
        self._fixed_names += [box.name for box in fixed_gripper.finger_boxes]
        self._fixed_bodies += list(fixed_gripper.finger_bodies)
        self._fixed_boxes = BoxSet([box for box, _ in fixed] + list(fixed_gripper.finger_boxes))
        self._fixed_frames = [T for _, T in fixed]
        self._finger_centres = {
            gripper.name: [box.centre_mm for box in gripper.finger_boxes]
            for gripper in (arm_gripper, fixed_gripper)
        }
        # which of them may run into which fixed box; the column is the first of those
        self._may_meet = np.ones((len(moving) + 2, len(self._fixed_names)), dtype=bool)
        self._may_meet[: len(meets_base), 0] = meets_base
        self._moving_names = [box.name for _, box in moving]
        self._moving_names += [box.name for box in arm_gripper.finger_boxes]
        self._moving_boxes = BoxSet([box for _, box in moving] + list(arm_gripper.finger_boxes))
        self.follow_arm(links)
        self.place_fixed_fingers()
        self._fingers_before = [arm_gripper.T_world_finger(side)[:3, 3] for side in (0, 1)]
        self._entered: dict[tuple[int, int], Array] = {}

    def follow_arm(self, links: Mapping[str, Array]) -> None:
        """Put the arm's boxes where its links are, its fingers where its jaws are."""
        self._links = links
        for frame, centre_mm, body in self._moving:
            self._bodies.place_box(body, centre_mm, links[frame])
        self._place_fingers(self._arm_gripper)

    def place_fixed_fingers(self) -> None:
        """Put the fixed gripper's fingers where its jaws are."""
        self._place_fingers(self._fixed_gripper)
        gripper = self._fixed_gripper
        fingers = [gripper.T_world_finger(0), gripper.T_world_finger(1)]
        self._fixed_bounds = self._fixed_boxes.bounds(self._fixed_frames + fingers)

    def _place_fingers(self, gripper: Gripper) -> None:
        for side, centre_mm in enumerate(self._finger_centres[gripper.name]):
            body = gripper.finger_bodies[side]
            self._bodies.place_box(body, centre_mm, gripper.T_world_finger(side))

    def touches(self, parts: Sequence[Part], wake: Callable[[], None]) -> list[Touch]:
        """Return the touches of the arm and its part; wake the parts that it comes near."""
        frames = [self._links[frame] for frame, _, _ in self._moving]
        fingers = [self._arm_gripper.T_world_finger(0), self._arm_gripper.T_world_finger(1)]
        low, high = self._moving_boxes.bounds(frames + fingers)
        fixed = self._fixed_bounds
        held = None if self._arm_gripper.hold is None else parts[self._arm_gripper.hold.part]
        touches = self._of_boxes(low, high, fixed)
        if held is not None:
            touches += self._of_held(held, fixed)
        for part in parts:
            if part.state != AWAY and part is not held:
                touches += self._near_part(part, low, high, wake)
                if held is not None and part.state != HELD:
                    touches += self._held_on_part(held, part, wake)
        self._fingers_before = [T[:3, 3] for T in fingers]
        return touches

    def _moving_body(self, index: int) -> tuple[int, str]:
        if index < len(self._moving):
            return self._moving[index][2], self._moving[index][0]
        return self._arm_gripper.finger_bodies[index - len(self._moving)], TCP

    def _of_boxes(self, low: Array, high: Array, fixed: tuple[Array, Array]) -> list[Touch]:
        touches: list[Touch] = []
        for index in np.flatnonzero(low[:, 2] < -BOX_MM):
            point = (low[index] + high[index]) / 2.0
            point[2] = low[index, 2]
            name, frame = self._moving_names[index], self._moving_body(int(index))[1]
            touches.append(Touch(name, "table", frame, -float(low[index, 2]), point, _UP))
        for i, j in np.argwhere(_overlap(low, high, *fixed) & self._may_meet):
            body, frame = self._moving_body(int(i))
            nearest = self._bodies.deepest(body, self._fixed_bodies[j])
            if nearest is not None and nearest[0] < -BOX_MM:
                name, other = self._moving_names[i], self._fixed_names[j]
                touches.append(Touch(name, other, frame, -nearest[0], nearest[1], nearest[2]))
        return touches

    def _of_held(self, part: Part, fixed: tuple[Array, Array]) -> list[Touch]:
        """Return the touches of the arm's part; fingers that hold it as well do not count."""
        touches: list[Touch] = []
        depth_mm = -part.lowest_mm
        if depth_mm > _TABLE_MM:
            touches.append(Touch(part.name, "table", TCP, depth_mm, part.lowest_point_mm, _UP))
        hold = self._fixed_gripper.hold
        is_shared = hold is not None and hold.part == part.index
        low, high = part.bounds_mm
        for _, j in np.argwhere(_overlap(low[None], high[None], *fixed)):
            body = self._fixed_bodies[j]
            if is_shared and body in self._fixed_gripper.finger_bodies:
                continue
            # the fixed gripper's fingers close on it and open beside it: they meet the exact mesh
            if body in self._fixed_gripper.finger_bodies and not self._is_in_finger(part, body):
                continue
            nearest = self._bodies.deepest(part.carried, body)
            if nearest is not None and nearest[0] < -PIECE_MM:
                other = self._fixed_names[j]
                touches.append(Touch(part.name, other, TCP, -nearest[0], nearest[1], nearest[2]))
        return touches

    def _is_in_finger(self, part: Part, body: int) -> bool:
        side = self._fixed_gripper.finger_bodies.index(body)
        box = _shrunk(self._fixed_gripper.finger_boxes[side], _GIVES_MM)
        return part.overlaps(box, self._fixed_gripper.T_world_finger(side))

    def _near_part(
        self, part: Part, low: Array, high: Array, wake: Callable[[], None]
    ) -> list[Touch]:
        """Return the touches of the arm with a part that it does not hold and that cannot yield."""
        touches: list[Touch] = []
        p_low, p_high = part.bounds_mm
        near = _overlap(low, high, p_low[None] - _NEAR_MM, p_high[None] + _NEAR_MM)[:, 0]
        for i in np.flatnonzero(near):
            body, frame = self._moving_body(int(i))
            if body in self._arm_gripper.finger_bodies:
                touches += self._finger_on_part(self._arm_gripper.finger_bodies.index(body), part)
                continue
            nearest = self._bodies.deepest(body, part.body, _NEAR_MM)
            if nearest is None:
                continue
            if part.state != HELD:
                wake()
            if nearest[0] < -PUSH_MM:
                name = self._moving_names[i]
                touches.append(Touch(name, part.name, frame, -nearest[0], nearest[1], nearest[2]))
        return touches

    def _finger_on_part(self, side: int, part: Part) -> list[Touch]:
        """Slide a part along with a finger; return a touch if the part cannot yield. Exact mesh."""
        if part.state == FALLING:  # it falls out of the way
            return []
        if part.index in self._arm_gripper.passing:
            # it was let go and fell past the fingers: they part from it before they push it
            fingers = enumerate(self._arm_gripper.finger_boxes)
            if any(part.overlaps(box, self._arm_gripper.T_world_finger(i)) for i, box in fingers):
                return []
            self._arm_gripper.passing.discard(part.index)
        is_held = part.state in (HELD, PROPPED)  # it cannot yield
        box, T = self._arm_gripper.finger_boxes[side], self._arm_gripper.T_world_finger(side)
        way = T[:3, 3] - self._fingers_before[side]
        length_mm = float(np.linalg.norm(way))
        key = (side, part.index)
        if not part.overlaps(_shrunk(box, _GIVES_MM if is_held else _GRAZES_MM), T):
            self._entered.pop(key, None)
            return []
        # it can always go back out: what counts is how the finger came in
        into = self._entered.setdefault(key, way / length_mm if length_mm > 1e-9 else -_UP)
        end = box.centre_mm.copy()
        end[0] = box.high_mm[0]
        end_mm = T[:3, :3] @ end + T[:3, 3]
        is_level = abs(into[2]) < np.hypot(into[0], into[1])
        if is_held or (into[2] < 0.0 and not is_level):
            return [Touch(box.name, part.name, TCP, length_mm, end_mm, -into)]
        if is_level and way @ into > 0.0:
            part.slide(end_mm, way)
            self._bodies.place_part(part.falling, part.solid, part.T_world_part)
        return []

    def _held_on_part(self, held: Part, part: Part, wake: Callable[[], None]) -> list[Touch]:
        low, high = held.bounds_mm
        p_low, p_high = part.bounds_mm
        if not _overlap(low[None], high[None], p_low[None], p_high[None])[0, 0]:
            return []
        nearest = self._bodies.deepest(held.carried, part.body, _NEAR_MM)
        if nearest is None:
            return []
        wake()
        if nearest[0] >= -PUSH_MM:
            return []
        return [Touch(held.name, part.name, TCP, -nearest[0], nearest[1], nearest[2])]


def _shrunk(box: Box, by_mm: float) -> Box:
    return Box(box.name, box.low_mm + by_mm, box.high_mm - by_mm)


def _overlap(low: Array, high: Array, other_low: Array, other_high: Array) -> Mask:
    """Return whether each pair of boxes' bounds overlaps, (n, m) bool."""
    overlaps = (low[:, None] < other_high) & (high[:, None] > other_low)
    return overlaps[:, :, 0] & overlaps[:, :, 1] & overlaps[:, :, 2]
