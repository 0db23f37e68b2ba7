"""The emulated cell as matter: table, arm, two grippers and parts, with time handed in.

Knows no wire. The arm and the jaws are models that somebody else commands; the world lets them
advance, follows them, tells them what is in their way, and lets parts lie, fall, slide and be
held. What a test may know about it is at the end; nothing of that goes over a wire.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np

from ._bodies import STEP_S, Bodies
from ._collide import (
    BOX_MM,
    PIECE_MM,
    PUSH_MM,
    BoxSet,
    Collision,
    Obstruct,
    Stall,
    Touch,
    values_of,
)
from ._grip import (
    TEAR_MM,
    TEAR_RAD,
    Gripper,
    apart,
    bears,
    make_gripper,
    relative,
)
from ._layout import Array, Box, Layout
from ._parts import AWAY, FALLING, HELD, LYING, Part
from ._poses import Joints, forward, transform, turn_z
from ._solid import Solid

QUIET_STEPS: Final = 4  # with nothing falling and no jaw moving, steps are this much longer
DROP_HEIGHT_MM: Final = 2.0
_NEAR_MM: Final = 2.0  # a finger this near wakes a lying part
_TABLE_MM: Final = 0.3
_FIXTURE_FORCE_N: Final = 100.0
_ARM_FORCE_N: Final = 150.0  # at MAX_FORCE 100; a choice, umi_rtx.md gives none
_DEFAULT_FORCE_FRACTION: Final = 0.4


class ArmBody(Protocol):
    """The arm as the world sees it."""

    grip_limit_mm: float | None

    def advance(self, dt_s: float) -> None:
        """Let time pass [s]."""
        ...

    def joints(self) -> Joints:
        """Return where the joints truly are."""
        ...


class JawBody(Protocol):
    """The fixed gripper's jaws as the world sees them."""

    grip_limit_mm: float | None

    @property
    def opening_mm(self) -> float:
        """How far the jaws are apart."""
        ...

    def advance(self, dt_s: float) -> None:
        """Let time pass [s]."""
        ...


@dataclass(frozen=True, slots=True)
class Event:
    """Something happened to a part: ``gripped``, ``released``, ``fell_out``, ``torn``, ``lies``."""

    at_s: float
    what: str
    part: int
    by: str


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """Where everything that moves was at one instant: poses ``T_world_*`` by name [mm].

    Parts are ``part 0``, ``part 1`` ...; the arm's links ``upper``, ``fore``, ``tip``,
    ``carriage``; fingers ``arm finger +`` and so on.
    """

    at_s: float
    poses: dict[str, Array]


class World:
    """One cell; ``advance`` lets time pass, ``snapshot`` is what a camera would see."""

    def __init__(
        self,
        layout: Layout,
        solids: Sequence[Solid],
        arm: ArmBody,
        jaws: JawBody,
        obstruct: Obstruct,
        seed: int = 0,
    ) -> None:
        self.layout = layout
        self.time_s = 0.0
        self.collisions: list[Collision] = []
        self.events: list[Event] = []
        self._arm, self._jaws = arm, jaws
        self._rng = np.random.default_rng(seed)
        self._stall = Stall(layout.arm, obstruct)
        self._touching: set[tuple[str, str]] = set()
        self._owed_s = 0.0
        self._awake = False
        self._jaw_moved = False
        joints = arm.joints()
        self._joints = values_of(joints)
        self._links = forward(layout.arm, joints)
        self.bodies = Bodies()
        self.parts = [Part(i, solid, *self.bodies.add_part(solid)) for i, solid in enumerate(solids)]
        self.hand = make_gripper("arm", layout.arm.hand, joints.jaw_opening_mm)
        self.fixture = make_gripper("fixture", layout.fixture, jaws.opening_mm)
        self._build()

    def close(self) -> None:
        """Give pybullet's client back."""
        self.bodies.close()

    def _build(self) -> None:
        identity = np.eye(4)
        arm = self.layout.arm
        fixed: list[tuple[Box, Array]] = [(arm.column, identity), (self.layout.post, identity)]
        fixed += [(box, identity) for box in self.layout.obstacles]
        fixed += [(box, self.fixture.T_world_tip) for box in self.layout.fixture.boxes]
        moving: list[tuple[str, Box]] = [("upper", arm.upper), ("fore", arm.fore)]
        moving += [("tip", box) for box in arm.hand.boxes]
        self._fixed_names = [box.name for box, _ in fixed]
        self._fixed_bodies = [self.bodies.add_box(box, T) for box, T in fixed]
        self._moving = [
            (frame, box, self.bodies.add_box(box, self._links[frame])) for frame, box in moving
        ]
        for gripper in (self.hand, self.fixture):
            one, two = (
                self.bodies.add_box(box, gripper.T_world_finger(side))
                for side, box in enumerate(gripper.finger_boxes)
            )
            gripper.finger_bodies = (one, two)
        self._fixed_names += [box.name for box in self.fixture.finger_boxes]
        self._fixed_bodies += list(self.fixture.finger_bodies)
        self._fixed_boxes = BoxSet([box for box, _ in fixed] + list(self.fixture.finger_boxes))
        self._fixed_frames = [T for _, T in fixed]
        self._moving_names = [box.name for _, box, _ in self._moving]
        self._moving_names += [box.name for box in self.hand.finger_boxes]
        self._moving_boxes = BoxSet(
            [box for _, box, _ in self._moving] + list(self.hand.finger_boxes)
        )
        self._follow_arm(self._arm.joints())
        self._place_fixture_fingers()

    # --- time -------------------------------------------------------------------------------

    def advance(self, dt_s: float) -> None:
        """Let time pass [s]; what is less than a step is kept for the next call."""
        self._owed_s += dt_s
        while self._owed_s >= STEP_S - 1e-9:
            count = 1
            if not (self._awake or self._jaw_moved):
                count = max(1, min(QUIET_STEPS, int(self._owed_s / STEP_S + 1e-6)))
            self._owed_s -= count * STEP_S
            self._tick(count)

    def _tick(self, count: int) -> None:
        dt_s = count * STEP_S
        self._arm.advance(dt_s)
        self._jaws.advance(dt_s)
        self.time_s += dt_s
        joints = values_of(self._arm.joints())
        before, arm_moved = self._joints, joints != self._joints
        self._joints = joints
        for gripper, opening_mm in (
            (self.hand, joints.jaw_opening_mm),
            (self.fixture, self._jaws.opening_mm),
        ):
            gripper.before_mm, gripper.opening_mm = gripper.opening_mm, opening_mm
        hand_jaws = self.hand.opening_mm != self.hand.before_mm
        fixture_jaws = self.fixture.opening_mm != self.fixture.before_mm
        self._jaw_moved = hand_jaws or fixture_jaws
        if arm_moved:
            self._follow_arm(joints)
        if fixture_jaws:
            self._place_fixture_fingers()
        if self._jaw_moved:
            self._work_jaws(self.hand)
            self._work_jaws(self.fixture)
        if arm_moved or self._jaw_moved or self._any_uneasy():
            self._carry(dt_s)
        if arm_moved or self._jaw_moved:
            self._check_touches(before, arm_moved)
        if self._awake:
            for _ in range(count):
                self.bodies.step()
            self._watch_falling(dt_s)

    def _follow_arm(self, joints: Joints) -> None:
        self._links = forward(self.layout.arm, joints)
        self.hand.T_world_tip = self._links["tip"]
        for frame, box, body in self._moving:
            self.bodies.place_box(body, box, self._links[frame])
        for side, box in enumerate(self.hand.finger_boxes):
            self.bodies.place_box(
                self.hand.finger_bodies[side], box, self.hand.T_world_finger(side)
            )

    def _place_fixture_fingers(self) -> None:
        for side, box in enumerate(self.fixture.finger_boxes):
            self.bodies.place_box(
                self.fixture.finger_bodies[side], box, self.fixture.T_world_finger(side)
            )

    # --- holding ----------------------------------------------------------------------------

    def _other(self, gripper: Gripper) -> Gripper:
        return self.fixture if gripper is self.hand else self.hand

    def _force_n(self, gripper: Gripper) -> float:
        if gripper is self.fixture:
            return _FIXTURE_FORCE_N
        fraction = float(getattr(self._arm, "jaw_force_fraction", _DEFAULT_FORCE_FRACTION))
        return _ARM_FORCE_N * (fraction or _DEFAULT_FORCE_FRACTION)

    def _work_jaws(self, gripper: Gripper) -> None:
        if gripper.hold is not None:
            part = self.parts[gripper.hold.part]
            was_seated = gripper.hold.is_seated
            if gripper.follow_jaws():
                self._let_go(gripper, "released")
            elif gripper.hold.is_seated and not was_seated:
                self._note("gripped", part, gripper)
        elif gripper.must_open:
            gripper.must_open = not gripper.opening_mm > gripper.before_mm
        elif gripper.is_closing:
            self._feel(gripper)
        limit = gripper.limit_mm
        if gripper is self.hand:
            self._arm.grip_limit_mm = limit
        else:
            self._jaws.grip_limit_mm = limit

    def _feel(self, gripper: Gripper) -> None:
        """Look for a part that both pads are on."""
        centre_mm, radius_mm = gripper.jaw_region_mm()
        for part in self.parts:
            if part.state == AWAY or not part.is_within(centre_mm, radius_mm):
                continue
            T_tip_part = relative(gripper.T_world_tip, part.T_world_part)
            felt = gripper.pads.feel(part.scene, T_tip_part, gripper.opening_mm)
            if not felt.is_between:
                continue
            held = part.state == HELD
            both = not held and all(
                self.bodies.deepest(body, part.falling, 0.2) for body in gripper.finger_bodies
            )
            if bears(felt, gripper.opening_mm, both, held):
                seat = gripper.pads.seat(part.scene, T_tip_part, gripper.opening_mm)
                gripper.capture(part.index, seat, T_tip_part, self._force_n(gripper))
                self._take(part, gripper)
                return
            upper_mm, lower_mm = felt.gaps_mm(gripper.opening_mm)
            if held and min(upper_mm, lower_mm) <= 0.0:
                gripper.limit_mm = gripper.opening_mm  # one finger pushes at what cannot give way
                gripper.must_open = True
                return

    def _take(self, part: Part, gripper: Gripper) -> None:
        if part.state != HELD:
            self.bodies.switch(part.falling, False)
            self.bodies.switch(part.carried, True)
            part.state = HELD
            part.holder = gripper.name
        for body in gripper.finger_bodies:
            self.bodies.pair(body, part.carried, False)

    def _let_go(self, gripper: Gripper, what: str) -> None:
        hold = gripper.hold
        if hold is None:
            return
        part = self.parts[hold.part]
        gripper.hold, gripper.limit_mm = None, None
        for body in gripper.finger_bodies:
            self.bodies.pair(body, part.carried, True)
        self._note(what, part, gripper)
        other = self._other(gripper)
        if other.hold is not None and other.hold.part == part.index:
            if part.holder != other.name:
                part.holder = other.name
                other.hold.T_tip_part = relative(other.T_world_tip, part.T_world_part)
            return
        for body in gripper.finger_bodies:
            self.bodies.pair(body, part.falling, False)
        gripper.passing.add(part.index)
        self._set_free(part)

    def _set_free(self, part: Part) -> None:
        part.state, part.holder, part.calm_s = FALLING, "", 0.0
        self.bodies.switch(part.carried, False)
        self.bodies.switch(part.falling, True)
        self.bodies.place_part(part.falling, part.solid, part.T_world_part)
        self.bodies.halt(part.falling)
        self._wake()

    def _any_uneasy(self) -> bool:
        return any(
            gripper.hold is not None
            and (
                not gripper.hold.is_seated
                or gripper.hold.T_tip_part is not gripper.hold.seat.T_tip_part
            )
            for gripper in (self.hand, self.fixture)
        )

    def _carry(self, dt_s: float) -> None:
        """Move held parts with who holds them, to the last digit; see what the grip can bear."""
        for part in self.parts:
            if part.state != HELD:
                continue
            holder = self.hand if part.holder == "arm" else self.fixture
            hold = holder.hold
            if hold is None:
                continue
            other = self._other(holder)
            is_shared = other.hold is not None and other.hold.part == part.index
            if not is_shared:
                holder.settle_into_seat(dt_s)
            part.move(holder.T_world_tip @ hold.T_tip_part)
            self.bodies.place_part(part.carried, part.solid, part.T_world_part)
            if is_shared:
                self._pull(part, holder, other)
            elif part.lowest_mm > _TABLE_MM and holder.bear(
                part.centre_mm, part.solid.mass_kg, dt_s
            ):
                holder.must_open = True
                self._let_go(holder, "fell_out")

    def _pull(self, part: Part, holder: Gripper, other: Gripper) -> None:
        """Both hold one part: beyond what pads give, it is torn from the arm, which is weaker."""
        if other.hold is None:
            return
        T_tip_part = relative(other.T_world_tip, part.T_world_part)
        off_mm, off_rad = apart(T_tip_part, other.hold.seat.T_tip_part)
        if off_mm <= TEAR_MM and off_rad <= TEAR_RAD:
            return
        if holder is self.hand:  # the fixture keeps it where its seat is
            part.holder = other.name
            other.hold.T_tip_part = other.hold.seat.T_tip_part
            part.move(other.T_world_tip @ other.hold.T_tip_part)
            self.bodies.place_part(part.carried, part.solid, part.T_world_part)
        self.hand.must_open = True
        self._let_go(self.hand, "torn")

    # --- running into things ------------------------------------------------------------------

    def _check_touches(self, before: Joints, arm_moved: bool) -> None:
        frames = [self._links[frame] for frame, _, _ in self._moving]
        frames += [self.hand.T_world_finger(0), self.hand.T_world_finger(1)]
        low, high = self._moving_boxes.bounds(frames)
        touches = self._touches_of_boxes(low, high) + self._touches_of_part()
        touches += self._touches_of_parts_lying(low, high)
        pairs = {(touch.moving, touch.other) for touch in touches}
        for touch in touches:
            if (touch.moving, touch.other) not in self._touching:
                self.collisions.append(
                    Collision(self.time_s, touch.moving, touch.other, touch.depth_mm)
                )
        self._touching = pairs
        if arm_moved and (touches or self._stall.is_blocking):
            self._stall.apply(touches, values_of(before), self._joints)

    def _moving_body(self, index: int) -> tuple[int, str]:
        if index < len(self._moving):
            return self._moving[index][2], self._moving[index][0]
        return self.hand.finger_bodies[index - len(self._moving)], "tip"

    def _touches_of_boxes(self, low: Array, high: Array) -> list[Touch]:
        touches: list[Touch] = []
        for index in np.flatnonzero(low[:, 2] < -BOX_MM):
            point = (low[index] + high[index]) / 2.0
            point[2] = low[index, 2]
            name, frame = self._moving_names[index], self._moving_body(index)[1]
            up = np.array((0.0, 0.0, 1.0))
            touches.append(Touch(name, "table", frame, -float(low[index, 2]), point, up))
        fixed_low, fixed_high = self._fixed_bounds()
        for i, j in np.argwhere(_overlap(low, high, fixed_low, fixed_high)):
            body, frame = self._moving_body(i)
            nearest = self.bodies.deepest(body, self._fixed_bodies[j])
            if nearest is not None and nearest[0] < -BOX_MM:
                name, other = self._moving_names[i], self._fixed_names[j]
                touches.append(Touch(name, other, frame, -nearest[0], nearest[1], nearest[2]))
        return touches

    def _fixed_bounds(self) -> tuple[Array, Array]:
        fingers = [self.fixture.T_world_finger(0), self.fixture.T_world_finger(1)]
        return self._fixed_boxes.bounds(self._fixed_frames + fingers)

    def _touches_of_part(self) -> list[Touch]:
        """What the arm's part runs into; where the fixture holds it too, its fingers are no foe."""
        hold = self.hand.hold
        if hold is None:
            return []
        part = self.parts[hold.part]
        touches: list[Touch] = []
        if part.lowest_mm < -_TABLE_MM:
            touches.append(
                Touch(
                    part.name,
                    "table",
                    "tip",
                    -part.lowest_mm,
                    part.lowest_point_mm,
                    np.array((0.0, 0.0, 1.0)),
                )
            )
        low, high = part.bounds_mm
        fixed_low, fixed_high = self._fixed_bounds()
        for _, j in np.argwhere(_overlap(low[None], high[None], fixed_low, fixed_high)):
            body = self._fixed_bodies[j]
            if body in self.fixture.finger_bodies and self._is_at_fixture(part):
                continue
            nearest = self.bodies.deepest(part.carried, body)
            if nearest is not None and nearest[0] < -PIECE_MM:
                other = self._fixed_names[j]
                touches.append(Touch(part.name, other, "tip", -nearest[0], nearest[1], nearest[2]))
        return touches

    def _is_at_fixture(self, part: Part) -> bool:
        return self.fixture.hold is not None and self.fixture.hold.part == part.index

    def _touches_of_parts_lying(self, low: Array, high: Array) -> list[Touch]:
        """Arm against parts it does not hold: they wake, and what cannot give way stops the arm."""
        touches: list[Touch] = []
        held = -1 if self.hand.hold is None else self.hand.hold.part
        for part in self.parts:
            if part.state == AWAY or part.index == held:
                continue
            p_low, p_high = part.bounds_mm
            near = _overlap(low, high, p_low[None] - _NEAR_MM, p_high[None] + _NEAR_MM)
            body = part.carried if part.state == HELD else part.falling
            for i in np.flatnonzero(near[:, 0]):
                moving, frame = self._moving_body(i)
                if moving in self.hand.finger_bodies and part.index in self.hand.passing:
                    continue
                nearest = self.bodies.deepest(moving, body, _NEAR_MM)
                if nearest is None:
                    continue
                if part.state != HELD:
                    self._wake()
                if nearest[0] < -PUSH_MM:
                    name = self._moving_names[i]
                    touch = Touch(name, part.name, frame, -nearest[0], nearest[1], nearest[2])
                    touches.append(touch)
            if held >= 0 and part.state != HELD:
                mine = self.parts[held]
                m_low, m_high = mine.bounds_mm
                if _overlap(m_low[None], m_high[None], p_low[None], p_high[None])[0, 0]:
                    nearest = self.bodies.deepest(mine.carried, body, _NEAR_MM)
                    if nearest is not None:
                        self._wake()
                        if nearest[0] < -PUSH_MM:
                            depth_mm, point, normal = nearest
                            touches.append(
                                Touch(mine.name, part.name, "tip", -depth_mm, point, normal)
                            )
        return touches

    # --- falling and lying --------------------------------------------------------------------

    def _wake(self) -> None:
        if not self._awake:
            self._awake = True
            for part in self.parts:
                if part.state == LYING:
                    part.state, part.calm_s = FALLING, 0.0

    def _watch_falling(self, dt_s: float) -> None:
        falling = [part for part in self.parts if part.state == FALLING]
        for part in falling:
            part.move(self.bodies.part_pose(part.falling, part.solid))
            part.watch(self.bodies.speed(part.falling), dt_s)
        for gripper in (self.hand, self.fixture):
            for index in list(gripper.passing):
                self._end_passing(gripper, self.parts[index])
        if all(part.is_calm for part in falling):
            for part in falling:
                self._come_to_rest(part)
            self._awake = False

    def _end_passing(self, gripper: Gripper, part: Part) -> None:
        if part.state == FALLING and any(
            self.bodies.deepest(body, part.falling, 0.0) for body in gripper.finger_bodies
        ):
            return
        gripper.passing.discard(part.index)
        for body in gripper.finger_bodies:
            self.bodies.pair(body, part.falling, True)

    def _come_to_rest(self, part: Part) -> None:
        part.state = LYING
        T = part.rest_on_table()
        if T is not None:
            part.move(T)
            self.bodies.place_part(part.falling, part.solid, T)
        self.bodies.halt(part.falling)
        self._note("lies", part, None)

    def _note(self, what: str, part: Part, by: Gripper | None) -> None:
        self.events.append(Event(self.time_s, what, part.index, "" if by is None else by.name))

    # --- putting parts there -------------------------------------------------------------------

    def drop(
        self,
        index: int,
        x_mm: float | None = None,
        y_mm: float | None = None,
        rest: int | None = None,
        theta_rad: float | None = None,
    ) -> None:
        """Let a part fall a little way onto the table.

        Parameters
        ----------
        x_mm, y_mm : its centre of mass; in the layout's drop area at random where None
        rest : number in ``solid.rests``; by default a stable one, by its solid angle
        theta_rad : turn about z; at random where None
        """
        part = self.parts[index]
        low, high = self.layout.drop_low_mm, self.layout.drop_high_mm
        spot, turn, choice = self._rng.uniform(low, high), self._rng.uniform(), self._rng.uniform()
        stable = part.solid.stable_rests or part.solid.rests
        if rest is None:
            weights = np.cumsum([one.solid_angle for one in stable])
            chosen = stable[min(int(np.searchsorted(weights, choice * weights[-1])), len(stable) - 1)]
        else:
            chosen = part.solid.rests[rest]
        theta = math.tau * turn if theta_rad is None else theta_rad
        T = turn_z(theta)
        T[:3, :3] = T[:3, :3] @ chosen.R
        x = float(spot[0]) if x_mm is None else x_mm
        y = float(spot[1]) if y_mm is None else y_mm
        T[:2, 3] = np.array((x, y)) - T[:2, :3] @ part.solid.centre_mm
        T[2, 3] = DROP_HEIGHT_MM - float((part.solid.hull_mm @ T[2, :3]).min())
        self.place(index, T)

    def place(self, index: int, T_world_part: Array) -> None:
        """Put a part anywhere and let it fall from there."""
        part = self.parts[index]
        self._lose(part)
        part.move(T_world_part)
        self._set_free(part)

    def remove(self, index: int) -> None:
        """Take a part out of the cell."""
        part = self.parts[index]
        self._lose(part)
        self.bodies.switch(part.falling, False)
        self.bodies.switch(part.carried, False)
        part.state = AWAY

    def _lose(self, part: Part) -> None:
        for gripper in (self.hand, self.fixture):
            if gripper.hold is not None and gripper.hold.part == part.index:
                self.lose_grip(gripper.name)

    def lose_grip(self, name: str) -> None:
        """Let a part fall out of a gripper (``arm``, ``fixture``); its jaws must open first."""
        gripper = self.hand if name == "arm" else self.fixture
        if gripper.hold is not None:
            gripper.must_open = True
            self._let_go(gripper, "fell_out")
            if gripper is self.hand:
                self._arm.grip_limit_mm = None
            else:
                self._jaws.grip_limit_mm = None

    def slip(self, name: str, along_mm: float) -> None:
        """Let a part slip in a gripper along its approach axis."""
        gripper = self.hand if name == "arm" else self.fixture
        T = np.eye(4)
        T[0, 3] = along_mm
        gripper.shift_hold(T)
        self._carry(STEP_S)

    def settle(self, limit_s: float = 10.0) -> bool:
        """Advance until nothing falls any more; False if that takes longer than ``limit_s``."""
        end_s = self.time_s + limit_s
        while self._awake and self.time_s < end_s:
            self.advance(STEP_S)
        return not self._awake

    # --- what can be seen, and what only a test may know ----------------------------------------

    def snapshot(self) -> Snapshot:
        """Return where everything that moves is now."""
        poses = dict(self._links)
        for gripper in (self.hand, self.fixture):
            for side, box in enumerate(gripper.finger_boxes):
                poses[box.name] = gripper.T_world_finger(side)
        for part in self.parts:
            if part.state != AWAY:
                poses[part.name] = part.T_world_part
        return Snapshot(self.time_s, poses)

    @property
    def part_in_fixture(self) -> bool:
        """Whether something is between the fixed gripper's pads, as a light barrier sees it."""
        centre_mm, _ = self.fixture.jaw_region_mm()
        for part in self.parts:
            if part.state == AWAY or not part.is_within(centre_mm, self.fixture.opening_mm):
                continue
            T_tip_part = relative(self.fixture.T_world_tip, part.T_world_part)
            felt = self.fixture.pads.feel(part.scene, T_tip_part, self.fixture.opening_mm)
            if np.isfinite(felt.upper_mm).any():
                return True
        return False

    @property
    def is_at_rest(self) -> bool:
        """Whether nothing falls, slides or rolls."""
        return not self._awake

    def part_pose(self, index: int) -> Array | None:
        """Return T_world_part [mm] of a part; None if it is not in the cell. Truth: tests only."""
        part = self.parts[index]
        return None if part.state == AWAY else part.T_world_part.copy()

    def custody(self, index: int) -> str:
        """Return who has a part: away, free, arm, fixture or both. Truth: tests only."""
        part = self.parts[index]
        if part.state == AWAY:
            return "away"
        holders = [
            gripper.name
            for gripper in (self.hand, self.fixture)
            if gripper.hold is not None and gripper.hold.part == index
        ]
        return "both" if len(holders) == 2 else (holders[0] if holders else "free")

    def tray_of(self, index: int) -> str | None:
        """Return the tray a part lies in, by its centre of mass. Truth: tests only."""
        part = self.parts[index]
        if part.state in (AWAY, HELD):
            return None
        for tray in self.layout.trays:
            if np.all(np.abs(part.centre_mm[:2] - tray.centre_mm) <= tray.size_mm / 2.0):
                return tray.name
        return None

    def truth(self) -> dict[str, Any]:
        """Return all of that as plain values. Tests only."""
        parts = []
        for part in self.parts:
            T = self.part_pose(part.index)
            parts.append(
                {
                    "name": part.solid.name,
                    "custody": self.custody(part.index),
                    "tray": self.tray_of(part.index),
                    "at_rest": part.state == LYING,
                    "T_world_part": None if T is None else T.tolist(),
                }
            )
        return {
            "time_s": self.time_s,
            "at_rest": self.is_at_rest,
            "parts": parts,
            "collisions": [
                {"at_s": c.at_s, "moving": c.moving, "other": c.other, "depth_mm": c.depth_mm}
                for c in self.collisions
            ],
            "events": [
                {"at_s": e.at_s, "what": e.what, "part": e.part, "by": e.by} for e in self.events
            ],
        }


def _overlap(low: Array, high: Array, other_low: Array, other_high: Array) -> Array:
    """Return which boxes' bounds overlap, (n, m) bool."""
    overlaps: Array = np.all(
        (low[:, None] < other_high[None]) & (high[:, None] > other_low[None]), axis=2
    )
    return overlaps
