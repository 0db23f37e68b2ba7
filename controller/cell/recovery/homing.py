"""Homing with the part in a gripper, after the arm has lost its positions.

The arm's last path in the journal is an estimate: a person may have moved an arm without power. So
it is never proven safe, and the operator is told what to check.
"""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np

from controller.arrays import FloatArray
from controller.planning.model import CellLayout
from controller.planning.motion import SWEEP_MARGIN_MM, Swept, segment_seconds, tcp_pose
from messages import key, say

from ..custody import Custody
from .carried import Carried, part_in_gripper
from .interrupted import Interrupted
from .trail import OFF_PATH, THERE
from .world import World


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HomingBounds(Carried):
    """The bounds on the arm's position, and the parts in the grippers.

    Attributes
    ----------
    low, high : (6,) bounds of the joints
    known : (6,) bool, the joints that counters still prove
    """

    low: FloatArray
    high: FloatArray
    known: np.ndarray

    @property
    def arguments(self) -> tuple[Any, ...]:
        """The arguments of the compute service's `homing_swept`."""
        return self.low, self.high, *self.carried

    @property
    def q_estimate(self) -> FloatArray:
        """The joints (6,) in the middle."""
        return np.asarray((self.low + self.high) / 2)


# A restarted board answers its next request with its restart code; in motion each board is polled
# many times a second.
NOTICED_S: Final = 0.5

# Proves that homing from anywhere within bounds, with the part of a run, touches nothing.
Sweep = Callable[[Interrupted, HomingBounds], Awaitable[Swept]]


@dataclass(frozen=True, slots=True, eq=False)
class HomingWithPart:
    """Homing with the part that was found free of contact."""

    bounds: HomingBounds
    swept: Swept


def lost_bounds(left: Interrupted, world: World, layout: CellLayout) -> HomingBounds:
    """Return the bounds on an arm whose positions are lost, and the parts it holds.

    Parameters
    ----------
    left : state with the path that the arm was sent along last, which is known to exist
    world : state with the joints that are still known
    layout : layout with the arm's timing
    """
    kept = np.full(6, np.nan) if world.q_kept is None else world.q_kept
    known = np.isfinite(kept)
    low, high = _along(left.trail.standing, kept, layout)
    low, high = low - OFF_PATH, high + OFF_PATH
    low, high = np.where(known, kept - THERE, low), np.where(known, kept + THERE, high)
    T_part_tcp, T_part_fixed = part_in_gripper(left, left.custody)
    in_arm = None if T_part_tcp is None else left.arm_hold
    return HomingBounds(
        low=low,
        high=high,
        known=known,
        arm_opening_mm=None if in_arm is None else in_arm.opening_mm,
        T_part_tcp=T_part_tcp,
        fixed_opening_mm=world.fixed_mm,
        T_part_fixed=T_part_fixed,
        around=left.around,
    )


def _along(
    points: FloatArray, kept: FloatArray, layout: CellLayout
) -> tuple[FloatArray, FloatArray]:
    """Return the bounds (6,) on the lost joints along waypoints (n, 6).

    All joints of a move run side by side, and arrive before the next begins. So the known joints
    show the progress of the lost ones, which stopped earlier by up to the detection time.

    Parameters
    ----------
    points : the waypoints
    kept : (6,) joints that are known, NaN for the lost ones
    layout : layout with the arm's timing
    """
    known = np.isfinite(kept)
    found: list[FloatArray] = []
    for a, b in pairwise(points):
        share = np.array([0.0, 1.0])
        for joint in np.flatnonzero(known):
            way, off = b[joint] - a[joint], OFF_PATH[joint]
            if abs(way) <= off:
                if abs(kept[joint] - a[joint]) > 2 * off:
                    share = np.array([1.0, 0.0])
                continue
            ends = np.sort((kept[joint] - a[joint] + np.array([-off, off])) / way)
            share = np.array([max(share[0], ends[0]), min(share[1], ends[1])])
        if share[0] <= share[1]:
            late = NOTICED_S / max(float(segment_seconds(layout, a, b)), NOTICED_S)
            share[0] = max(0.0, share[0] - late) if known.any() else 0.0
            found.extend(a + share[:, None] * (b - a))
    among = np.array(found) if found else points
    return among.min(axis=0), among.max(axis=0)


def why_not_home(left: Interrupted, world: World) -> str:
    """Return why an arm that lost its positions cannot home as loaded; empty if it can."""
    if left.is_homing:
        return key("homing with the part was interrupted, so the position of the arm is unknown")
    if not left.is_homed or not len(left.trail.between):
        return world.positions
    if left.intent is not None:
        doing = left.intent.name.replace("_", " ")
        return say(
            "{positions}; and it was cut off while it did: {doing}, so that "
            "only the arm gripper's opening would show who holds the part",
            positions=world.positions,
            doing=doing,
        )
    if left.custody is Custody.IN_ARM:
        if left.arm_hold is None:
            return key("the journal does not record the grasp of the arm gripper")
        if not world.is_fixed_clear:
            return key(
                "the fixed gripper is not clear, and the arm would home with the part beside it"
            )
        return ""
    if left.custody is Custody.IN_FIXED:
        if left.fixed_hold is None:
            return key("the journal does not record the grasp of the fixed gripper")
        holds = world.does_fixed_hold or world.may_fixed_hold(left.fixed_hold.opening_mm)
        if not holds:
            return key("the fixed gripper does not report its hold")
        return ""
    return say(
        "{positions}; the part is {value}", positions=world.positions, value=left.custody.value
    )


def why_not_free(swept: Swept | None) -> str:
    """Return the reason why the space that homing sweeps is not free; empty if it is."""
    if swept is None:
        return key("the space that homing sweeps was not checked")
    if swept.is_free:
        return ""
    x, y, z = swept.tcp_mm
    return say(
        "homing is not proven free of contact: where {phase}, the arm or "
        "what it holds would come too close to {touches} (TCP about "
        "{x:.0f}, {y:.0f}, {z:.0f} mm)",
        phase=swept.phase,
        touches=swept.touches.replace("_", " "),
        x=x,
        y=y,
        z=z,
    )


def homing_evidence(homing: HomingWithPart, layout: CellLayout) -> tuple[str, ...]:
    """Return the known, unknown and checked facts on the arm, as sentences."""
    bounds = homing.bounds
    x, y, z = tcp_pose(layout, bounds.q_estimate)[:3, 3]
    off = (bounds.high - bounds.low) / 2
    turn_deg = np.degrees(np.delete(off, 3)).max()
    kept = key("none of its axes") if not bounds.known.any() else key("only some of its axes")
    jaws = (
        key("the force of the arm gripper on the part is unknown: its motor may have had no power")
        if bounds.T_part_tcp is not None
        else key("the arm gripper is taken to be empty")
    )
    return (
        say(
            "arm: by the path it was sent along it is taken to stand with its "
            "TCP near ({x:.0f}, {y:.0f}, {z:.0f}) mm, each axis up to "
            "{turn_deg:.0f} degrees or {off:.0f} mm off; its counters prove "
            "{kept}, and nothing proves that nobody has moved it",
            x=x,
            y=y,
            z=z,
            turn_deg=turn_deg,
            off=off[3],
            kept=kept,
        ),
        jaws,
        say(
            "swept space: homing from anywhere there keeps "
            "{sweep_margin_mm:.0f} mm from table, column, fixed gripper, "
            "cameras, panels and walls ({pieces} pieces of joint space checked)",
            sweep_margin_mm=SWEEP_MARGIN_MM,
            pieces=homing.swept.pieces,
        ),
    )


def what_to_look_at(homing: HomingWithPart, layout: CellLayout) -> str:
    """Return the sentence on what the operator has to look at before they accept."""
    x, y, z = tcp_pose(layout, homing.bounds.q_estimate)[:3, 3]
    held = (
        key("the arm gripper holds the part, straight and between its pads; ")
        if homing.bounds.T_part_tcp is not None
        else key(
            "nothing is between the arm gripper's jaws, and they do not reach round the part; "
        )
    )
    return say(
        "Look before you accept: the fingertips of the arm are near x "
        "{x:.0f}, y {y:.0f}, z {z:.0f} mm, where the run has left them, "
        "and nobody has moved the arm; {held}nothing lies or hangs above "
        "the arm; nobody is within its reach.",
        x=x,
        y=y,
        z=z,
        held=held,
    )


HOMING_STEPS = (
    key("the arm gripper presses: it closes, and opens nothing"),
    key(
        "the arm homes slowly, without opening a jaw: first zed goes up to its stop, then the arm "
        "straightens, then elbow, yaw, shoulder and wrist go to their stops, and it parks"
    ),
)
FIRST_MOTION = key("first zed goes straight up to its stop, all other axes stand still")
