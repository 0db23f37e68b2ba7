"""The emulated cell as matter: table, arm, two grippers and parts, with time handed in.

Knows no wire. Arm and jaws are models that the devices command; the world advances and follows
them, sets their obstacles, and lets parts rest, fall, slide and be held. Knowledge reserved for
tests is at the end of the class; none of it goes over a wire.
"""

import logging
import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from ._models import ArmBody, Event, JawBody, Snapshot
from .chain import TCP
from .layout import Layout
from .matter.bodies import STEP_S, Bodies
from .matter.boxes import CellBoxes
from .matter.collide import Collision, Obstruct, Stall, values_of
from .matter.grasp import TEAR_MM, TEAR_RAD, Gripper, apart, bears, make_gripper, relative
from .matter.parts import AWAY, FALLING, HELD, PROPPED, RESTING, Part
from .matter.solid import Rest, Solid
from .poses import JointValues, forward, rotation_about, turn_z
from .shapes import Array

log = logging.getLogger(__name__)

QUIET_STEPS: Final = 4  # factor of longer steps while nothing falls and no jaw moves
_TABLE_MM: Final = 0.3
_FIXED_FORCE_N: Final = 100.0
_ARM_FORCE_N: Final = 60.0  # of jaws that state none, or have no drive


class World:
    """One cell; ``advance`` lets time pass, ``snapshot`` is a camera's view.

    Parameters
    ----------
    layout : cell, cameras and lamps
    solids : the parts; none of them is in the cell before `drop`
    arm : joints of the arm; the world lets it advance
    jaws : the fixed gripper's jaws; the world lets them advance
    obstruct : called to block a motor of the arm in a direction, or to free it
    seed : decides where parts fall
    """

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
        # when each of them moved last [world s]; now and then is too seldom to see it
        self.last_motion_s = {"arm": 0.0, "arm gripper": 0.0, "fixed gripper": 0.0}
        self._arm, self._jaws = arm, jaws
        self._rng = np.random.default_rng(seed)
        self._stall = Stall(layout.arm, obstruct)
        self._touching: set[tuple[str, str]] = set()
        self._owed_s = 0.0
        self._awake = False
        self._jaw_moved = False
        # the part's pose and the opening of the last feeling between the fixed jaws, and its answer
        self._felt_before: tuple[Array | None, float, bool] = (None, 0.0, False)
        joints = arm.joints()
        self._joints = values_of(joints)
        self._links = forward(layout.arm, joints)
        self.bodies = Bodies()
        self.parts: list[Part] = []
        self.arm_gripper = make_gripper("arm", layout.arm.gripper, joints.jaw_opening_mm)
        self.arm_gripper.T_world_tcp = self._links[TCP]
        self.fixed_gripper = make_gripper("fixture", layout.fixed_gripper, jaws.opening_mm)
        grippers = (self.arm_gripper, self.fixed_gripper)
        self._boxes = CellBoxes(layout, self.bodies, self._links, *grippers)
        for solid in solids:
            self.add(solid)

    def close(self) -> None:
        """Give pybullet's client back."""
        self.bodies.close()

    # --- time -------------------------------------------------------------------------------

    def advance(self, dt_s: float) -> None:
        """Let time pass [s]; time short of a step is kept for the next call."""
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
            (self.arm_gripper, joints.jaw_opening_mm),
            (self.fixed_gripper, self._jaws.opening_mm),
        ):
            gripper.before_mm, gripper.opening_mm = gripper.opening_mm, opening_mm
        arm_jaws_moved = self.arm_gripper.opening_mm != self.arm_gripper.before_mm
        fixed_jaws_moved = self.fixed_gripper.opening_mm != self.fixed_gripper.before_mm
        self._jaw_moved = arm_jaws_moved or fixed_jaws_moved
        for name, moved in (
            ("arm", arm_moved and joints.q != before.q),
            ("arm gripper", arm_jaws_moved),
            ("fixed gripper", fixed_jaws_moved),
        ):
            if moved:
                self.last_motion_s[name] = self.time_s
        if arm_moved:
            self._links = forward(self.layout.arm, joints)
            self.arm_gripper.T_world_tcp = self._links[TCP]
            self._boxes.follow_arm(self._links)
        if fixed_jaws_moved:
            self._boxes.place_fixed_fingers()
        if self._jaw_moved:
            self._work_jaws(self.arm_gripper)
            self._work_jaws(self.fixed_gripper)
        if arm_moved or self._jaw_moved or self._any_uneasy():
            self._carry(dt_s)
        if arm_moved or self._jaw_moved:
            self._check_touches(before, arm_moved)
        if self._awake:
            for _ in range(count):
                self.bodies.step()
            self._watch_falling(dt_s)

    # --- holding ----------------------------------------------------------------------------

    def _other(self, gripper: Gripper) -> Gripper:
        return self.fixed_gripper if gripper is self.arm_gripper else self.arm_gripper

    def _force_n(self, gripper: Gripper) -> float:
        if gripper is self.fixed_gripper:
            return _FIXED_FORCE_N
        return float(getattr(self._arm, "jaw_force_n", _ARM_FORCE_N)) or _ARM_FORCE_N

    def _work_jaws(self, gripper: Gripper) -> None:
        if gripper.hold is not None:
            part = self.parts[gripper.hold.part]
            was_seated = gripper.hold.is_seated
            if gripper.follow_jaws():
                self._let_go(gripper, "released")
            elif gripper.hold.is_seated and not was_seated:
                self._note("gripped", part, gripper.name)
        elif gripper.must_open:
            if gripper.opening_mm > gripper.before_mm:
                # what had stopped one finger stops it no more
                gripper.must_open, gripper.limit_mm = False, None
        elif gripper.is_closing:
            self._feel(gripper)
        self._block_jaws(gripper)

    def _block_jaws(self, gripper: Gripper) -> None:
        """Let a part between the pads stop the jaws; without a part they are free."""
        if gripper is self.arm_gripper:
            self._arm.grasp_limit_mm = gripper.limit_mm
        else:
            self._jaws.grasp_limit_mm = gripper.limit_mm

    def _feel(self, gripper: Gripper) -> None:
        """Look for a part that both pads are on."""
        centre_mm, radius_mm = gripper.jaw_region_mm()
        for part in self.parts:
            if part.state == AWAY or not part.is_within(centre_mm, radius_mm):
                continue
            T_tcp_part = relative(gripper.T_world_tcp, part.T_world_part)
            felt = gripper.pads.feel(part.scene, T_tcp_part, gripper.opening_mm)
            if not felt.is_between:
                continue
            if gripper.misses:
                gripper.misses, gripper.must_open = False, True
                self._note("missed", part, gripper.name)
                return
            held = part.state == HELD
            if bears(felt, gripper.opening_mm, is_held=held):
                seat = gripper.pads.seat(part.scene, T_tcp_part, gripper.opening_mm)
                gripper.capture(part.index, seat, T_tcp_part, self._force_n(gripper))
                self._take(part, gripper)
                return
            upper_mm, lower_mm = felt.gaps_mm(gripper.opening_mm)
            if held and min(upper_mm, lower_mm) <= 0.0:
                gripper.limit_mm = gripper.opening_mm  # one finger pushes, the part cannot yield
                gripper.must_open = True
                return
            push = gripper.pads.push(felt, gripper.opening_mm)
            if part.state == RESTING and push is not None:
                point, push_mm = push
                T = gripper.T_world_tcp
                part.slide(T[:3, :3] @ point + T[:3, 3], push_mm * T[:3, 1])
                self.bodies.place_part(part.falling, part.solid, part.T_world_part)

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
        gripper.hold, gripper.limit_mm, gripper.last_hold = None, None, hold
        for body in gripper.finger_bodies:
            self.bodies.pair(body, part.carried, True)
        self._note(what, part, gripper.name)
        other = self._other(gripper)
        if other.hold is not None and other.hold.part == part.index:
            if part.holder != other.name:
                part.holder = other.name
                other.hold.T_tcp_part = relative(other.T_world_tcp, part.T_world_part)
            return
        if gripper is self.fixed_gripper:
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
                or gripper.hold.T_tcp_part is not gripper.hold.seat.T_tcp_part
            )
            for gripper in (self.arm_gripper, self.fixed_gripper)
        )

    def _carry(self, dt_s: float) -> None:
        """Move held parts exactly with their gripper; drop those that its grasp cannot bear."""
        for part in self.parts:
            if part.state != HELD:
                continue
            holder = self.arm_gripper if part.holder == "arm" else self.fixed_gripper
            hold = holder.hold
            if hold is None:
                continue
            other = self._other(holder)
            is_shared = other.hold is not None and other.hold.part == part.index
            if not is_shared:
                holder.settle_into_seat(dt_s)
            part.move(holder.T_world_tcp @ hold.T_tcp_part)
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
        T_tcp_part = relative(other.T_world_tcp, part.T_world_part)
        off_mm, off_rad = apart(T_tcp_part, other.hold.seat.T_tcp_part)
        if off_mm <= TEAR_MM and off_rad <= TEAR_RAD:
            return
        if holder is self.arm_gripper:  # the fixed gripper keeps it where its seat is
            part.holder = other.name
            other.hold.T_tcp_part = other.hold.seat.T_tcp_part
            part.move(other.T_world_tcp @ other.hold.T_tcp_part)
            self.bodies.place_part(part.carried, part.solid, part.T_world_part)
        self.arm_gripper.must_open = True
        self._let_go(self.arm_gripper, "torn")

    def _check_touches(self, before: JointValues, arm_moved: bool) -> None:
        touches = self._boxes.touches(self.parts, self._wake)
        for touch in touches:
            if (touch.moving, touch.other) not in self._touching:
                self.collisions.append(
                    Collision(self.time_s, touch.moving, touch.other, touch.depth_mm)
                )
                words = "%.3f s: %s ran into %s (%.1f mm)"
                log.warning(words, self.time_s, touch.moving, touch.other, touch.depth_mm)
        self._touching = {(touch.moving, touch.other) for touch in touches}
        if arm_moved and (touches or self._stall.is_blocking):
            self._stall.apply(touches, before, self._joints)

    # --- falling and coming to rest -----------------------------------------------------------

    def _wake(self) -> None:
        if not self._awake:
            self._awake = True
            for part in self.parts:
                if part.state == RESTING:
                    part.state, part.calm_s = FALLING, 0.0

    def _watch_falling(self, dt_s: float) -> None:
        falling = [part for part in self.parts if part.state == FALLING]
        for part in falling:
            part.move(self.bodies.part_pose(part.falling, part.solid))
            part.watch(self.bodies.speed(part.falling), dt_s)
        for index in list(self.fixed_gripper.passing):
            self._end_passing(self.fixed_gripper, self.parts[index])
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
        part.state = RESTING
        T = part.rest_on_table()
        if T is not None:
            part.move(T)
            self.bodies.place_part(part.falling, part.solid, T)
        self.bodies.halt(part.falling)
        self._note("lies", part)

    def _note(self, what: str, part: Part, by: str = "") -> None:
        is_held = any(
            one.hold is not None and one.hold.part == part.index
            for one in (self.arm_gripper, self.fixed_gripper)
        )
        self.events.append(Event(self.time_s, what, part.index, by, part.lowest_mm, is_held))

    # --- putting parts there -------------------------------------------------------------------

    def add(self, solid: Solid) -> int:
        """Take one more part, which is not in the cell yet; return its number."""
        part = Part(len(self.parts), solid, *self.bodies.add_part(solid))
        # the arm gripper's fingers meet the exact mesh, not the fatter pieces
        for body in self.arm_gripper.finger_bodies:
            self.bodies.pair(body, part.falling, False)
        self.parts.append(part)
        return part.index

    def drop(
        self,
        index: int,
        x_mm: float | None = None,
        y_mm: float | None = None,
        rest: int | Rest | None = None,
        theta_rad: float | None = None,
    ) -> None:
        """Let a part fall a few millimetres onto the table, at the place of `draw`.

        Parameters
        ----------
        index : number of the part
        x_mm, y_mm : its centre of mass; in the layout's drop area at random where None
        rest : a rest or its number in ``solid.rests``; None for a stable one, by its solid angle
        theta_rad : turn about z; at random where None
        """
        self.place(index, self.draw(index, x_mm, y_mm, rest, theta_rad))

    def draw(
        self,
        index: int,
        x_mm: float | None = None,
        y_mm: float | None = None,
        rest: int | Rest | None = None,
        theta_rad: float | None = None,
    ) -> Array:
        """Return the pose to drop a part at, (4, 4); values not given are drawn at random.

        Parameters
        ----------
        index, x_mm, y_mm, rest, theta_rad : as `drop`
        """
        low, high = self.layout.drop_low_mm, self.layout.drop_high_mm
        # the same draws whatever is given: an order for one part does not move the next one
        spot, turn, choice = self._rng.uniform(low, high), self._rng.uniform(), self._rng.uniform()
        solid = self.parts[index].solid
        if isinstance(rest, int):
            rest = solid.rests[rest]
        chosen = solid.likely_rest(choice) if rest is None else rest
        theta = math.tau * turn if theta_rad is None else theta_rad
        x = float(spot[0]) if x_mm is None else x_mm
        y = float(spot[1]) if y_mm is None else y_mm
        return solid.pose_at_rest(chosen, x, y, theta)

    def place(self, index: int, T_world_part: Array) -> None:
        """Put a part anywhere and let it fall from there."""
        part = self.parts[index]
        self._lose(part)
        part.move(T_world_part)
        self._set_free(part)

    def lay(self, index: int, T_world_part: Array, *, is_propped: bool = False) -> None:
        """Put a part down exactly at a pose, in which it stays.

        Parameters
        ----------
        index : number of the part
        T_world_part : (4, 4) on the table [mm]
        is_propped : something that is not seen holds it up; otherwise it lies on a facet
        """
        part = self.parts[index]
        self._lose(part)
        part.move(T_world_part)
        at_rest = FALLING if self._awake else RESTING
        part.state, part.calm_s = PROPPED if is_propped else at_rest, 0.0
        for body in (part.falling, part.carried):
            self.bodies.switch(body, body == part.body)
        self.bodies.place_part(part.body, part.solid, T_world_part)
        self.bodies.halt(part.body)
        self._note("lies", part)

    def give(self, index: int, name: str, T_tcp_part: Array) -> None:
        """Let a person hold a part between open jaws until they close on it.

        Parameters
        ----------
        index : number of the part
        name : ``arm`` for the gripper on the arm, ``fixture`` for the fixed one
        T_tcp_part : (4, 4) between the pads [mm]; the closing jaws ease it into its seat

        Raises
        ------
        ValueError : the jaws hold something, stand too narrow, or there is nothing to hold there
        """
        gripper = self.arm_gripper if name == "arm" else self.fixed_gripper
        if gripper.hold is not None:
            raise ValueError(f"the {name} gripper holds part {gripper.hold.part}")
        part, wide_mm = self.parts[index], gripper.layout.jaw_max_mm
        if not gripper.pads.feel(part.scene, T_tcp_part, wide_mm).is_between:
            raise ValueError(f"part {index} is not between the pads of the {name} gripper there")
        seat = gripper.pads.seat(part.scene, T_tcp_part, wide_mm)
        if seat.opening_mm > gripper.opening_mm:
            raise ValueError(
                f"the {name} gripper stands at {gripper.opening_mm:.1f} mm: part {index} needs "
                f"{seat.opening_mm:.1f} mm"
            )
        self._lose(part)
        gripper.must_open = False
        gripper.passing.discard(index)
        gripper.capture(index, seat, T_tcp_part, self._force_n(gripper))
        part.move(gripper.T_world_tcp @ T_tcp_part)
        self._take(part, gripper)
        self.bodies.place_part(part.carried, part.solid, part.T_world_part)
        self._block_jaws(gripper)

    def remove(self, index: int) -> None:
        """Take a part out of the cell."""
        part = self.parts[index]
        self._lose(part)
        self.bodies.switch(part.falling, False)
        self.bodies.switch(part.carried, False)
        part.state = AWAY

    def empty(self, index: int, tray: str) -> None:
        """Take a part out of a tray, as a person who empties it does."""
        self._note("emptied", self.parts[index], tray)
        self.remove(index)

    def _lose(self, part: Part) -> None:
        for gripper in (self.arm_gripper, self.fixed_gripper):
            if gripper.hold is not None and gripper.hold.part == part.index:
                self.lose_grasp(gripper.name, "taken")

    def lose_grasp(self, name: str, what: str = "fell_out") -> None:
        """Let a part fall out of a gripper; its jaws must open before they close again.

        Parameters
        ----------
        name : ``arm`` for the gripper on the arm, ``fixture`` for the fixed one
        what : its name among the events
        """
        gripper = self.arm_gripper if name == "arm" else self.fixed_gripper
        if gripper.hold is not None:
            gripper.must_open = True
            self._let_go(gripper, what)
            self._block_jaws(gripper)

    def put_back(self, index: int, name: str) -> None:
        """Put a part by hand back between the jaws that had it last.

        Parameters
        ----------
        index : number of the part
        name : ``arm`` for the gripper on the arm, ``fixture`` for the fixed one

        Raises
        ------
        ValueError : these jaws did not have it last, hold something, or are no longer as wide
        """
        gripper = self.arm_gripper if name == "arm" else self.fixed_gripper
        last = gripper.last_hold
        if last is None or last.part != index or gripper.hold is not None:
            raise ValueError(f"the {name} gripper has not lost part {index}")
        if not gripper.is_as_wide_as(last):
            raise ValueError(
                f"the {name} gripper has moved from {last.seat.opening_mm:.1f} mm to "
                f"{gripper.opening_mm:.1f} mm: part {index} does not fit in as it was"
            )
        part = self.parts[index]
        self._lose(part)
        gripper.resume(last)
        part.move(gripper.T_world_tcp @ last.seat.T_tcp_part)
        self._take(part, gripper)
        self.bodies.place_part(part.carried, part.solid, part.T_world_part)
        self._block_jaws(gripper)
        self._note("gripped", part, gripper.name)

    def shift(self, index: int, by_mm: tuple[float, float], turn_rad: float) -> None:
        """Move a part that lies somewhere, by hand: it stays in its stable pose.

        Parameters
        ----------
        index : number of the part
        by_mm : shift in x and y of the world
        turn_rad : about the vertical through its centre of mass

        Raises
        ------
        ValueError : it does not lie anywhere
        """
        part = self.parts[index]
        if part.state not in (RESTING, FALLING):
            raise ValueError(f"part {index} is {part.state}: it cannot be moved about")
        centre_mm = part.centre_mm
        T = turn_z(turn_rad)
        T[:3, 3] = centre_mm + np.array((*by_mm, 0.0)) - T[:3, :3] @ centre_mm
        self.place(index, T @ part.T_world_part)

    def slip(self, name: str, along_mm: float, turn_rad: float = 0.0) -> None:
        """Let a part slip in a gripper along its approach axis, and turn about its jaws' axis.

        Parameters
        ----------
        name : ``arm`` for the gripper on the arm, ``fixture`` for the fixed one
        along_mm : shift along the approach axis, positive towards the TCP's +x
        turn_rad : angle about the TCP's y, along which the pads open
        """
        gripper = self.arm_gripper if name == "arm" else self.fixed_gripper
        T = np.eye(4)
        T[:3, :3] = rotation_about(np.array((0.0, 1.0, 0.0)), turn_rad)
        T[0, 3] = along_mm
        gripper.shift_hold(T)
        self._carry(STEP_S)

    def miss(self, name: str) -> None:
        """Let the next closing of a gripper miss the part that is between its jaws."""
        gripper = self.arm_gripper if name == "arm" else self.fixed_gripper
        gripper.misses = True

    def settle(self, limit_s: float = 10.0) -> bool:
        """Advance until nothing falls any more; return whether that took at most ``limit_s``."""
        end_s = self.time_s + limit_s
        while self._awake and self.time_s < end_s:
            self.advance(STEP_S)
        return not self._awake

    # --- what can be seen, and what only a test may know ----------------------------------------

    def snapshot(self) -> Snapshot:
        """Return the present poses of all that moves."""
        poses = dict(self._links)
        for gripper in (self.arm_gripper, self.fixed_gripper):
            for side, box in enumerate(gripper.finger_boxes):
                poses[box.name] = gripper.T_world_finger(side)
        for part in self.parts:
            if part.state != AWAY:
                poses[part.name] = part.T_world_part
        return Snapshot(self.time_s, poses)

    @property
    def is_part_in_fixed_gripper(self) -> bool:
        """Whether something is between the fixed gripper's pads, as a light barrier sees it."""
        gripper = self.fixed_gripper
        centre_mm, _ = gripper.jaw_region_mm()
        for part in self.parts:
            if part.state == AWAY or not part.is_within(centre_mm, gripper.opening_mm):
                continue
            T, opening_mm, is_between = self._felt_before
            if part.T_world_part is not T or gripper.opening_mm != opening_mm:
                T_tcp_part = relative(gripper.T_world_tcp, part.T_world_part)
                is_between = gripper.pads.is_seen(part.scene, T_tcp_part, gripper.opening_mm)
                self._felt_before = part.T_world_part, gripper.opening_mm, is_between
            if is_between:
                return True
        return False

    @property
    def is_at_rest(self) -> bool:
        """Whether nothing falls, slides or rolls."""
        return not self._awake
