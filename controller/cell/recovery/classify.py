"""The actual state, by journal and devices: each unresolved intent is done, not done or unknown.

One rule leads from there to the permitted actions: the giver of a hand-off opens only if the
receiver was never needed or reports its hold, and an unclear case is resolved by the gripper that
surely holds. Plain decisions; nothing here reads a device.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final, Literal

from drivers.kinds import Signal
from messages import key, say

from ..custody import Custody
from ..journal import Once, rows
from .homing import why_not_home
from .interrupted import Interrupted
from .world import Jaws, World, judge_jaws

Done = Literal["done", "not done", "unknown"]


class Opens(StrEnum):
    """The gripper that has to open before the arm leaves, and the reason why that is safe."""

    NONE = ""
    FIXED = key("the fixed gripper opens, once the arm gripper has confirmed its hold by pressing")
    ARM = key("the arm gripper opens, once the fixed gripper reports that it holds the part")
    ARM_ON_TABLE = key("the arm gripper opens: the part rests on the table")
    ARM_OVER_TRAY = key("the arm gripper opens: the part is over its tray")


class WayOut(StrEnum):
    """The path by which the arm leaves its place."""

    BY_TRAIL = key("along its path")
    BY_RETREAT = key("by the retreat of the step that was cut off")


@dataclass(frozen=True, slots=True)
class Case:
    """The actual state, and the steps that follow from it.

    Attributes
    ----------
    custody : custody of the part
    opens, leaves : actions required first
    holds_as_expected : the arm gripper holds it by the grasp that was expected, not by the last one
    done : outcome of the unresolved intent; None without one
    evidence : sentences
    person : reason why a person has to look; empty if the cell can go on
    was : last custody in the journal
    homes : the arm has to home first, with what its gripper holds
    is_fixed_unconfirmed : the fixed gripper stands on the part, and has to press once more first
    activates_fixed : the fixed gripper lost its power, empty, and has to be activated at the end
    """

    custody: Custody
    opens: Opens = Opens.NONE
    leaves: WayOut = WayOut.BY_TRAIL
    holds_as_expected: bool = False
    done: Done | None = None
    evidence: tuple[str, ...] = ()
    person: str = ""
    was: Custody = Custody.UNKNOWN
    homes: bool = False
    is_fixed_unconfirmed: bool = False
    activates_fixed: bool = False

    @property
    def relies_on_fixed(self) -> bool:
        """Whether the fixed gripper keeps the part."""
        is_kept = self.custody is Custody.IN_BOTH and self.opens is Opens.ARM
        return not self.person and (is_kept or self.custody is Custody.IN_FIXED)

    @property
    def now(self) -> Custody:
        """The part's place before anything has moved; UNKNOWN if a person has to look."""
        if self.person:
            return Custody.UNKNOWN
        is_undone = self.custody is Custody.IN_BOTH and self.was is not Custody.IN_BOTH
        # the receiver was to close: what it did is undone, and the giver has never let go
        return self.was if is_undone and self.done != "done" else self.custody


Rule = Callable[[Interrupted, World], Case]


def classify(left: Interrupted, world: World) -> Case:
    """Return the case of a part that a run left, with the evidence."""
    activates = not world.is_fixed_ready and _may_activate(left, world)
    if not world.is_fixed_ready and not activates:
        return Case(left.custody, evidence=_evidence(left, world), person=_NOT_ACTIVE)
    if world.q is None:
        why = why_not_home(left, world)
        return Case(
            left.custody,
            evidence=_evidence(left, world),
            person=why,
            was=left.custody,
            homes=not why,
            is_fixed_unconfirmed=not why and _is_unconfirmed(left, world),
            activates_fixed=activates,
        )
    rule = _INTENTS.get(left.intent.name) if left.intent else _CUSTODIES.get(left.custody)
    if rule is None:
        what = left.intent.name.replace("_", " ") if left.intent else left.custody.value
        case = Case(left.custody, person=say("no rule of recovery begins with: {what}", what=what))
    else:
        case = rule(left, world)
    if activates and not case.person and case.opens is not Opens.NONE:
        case = replace(case, person=_NOT_ACTIVE)  # its jaws would close round the arm's fingers
    return Case(
        custody=case.custody,
        opens=case.opens,
        leaves=case.leaves,
        holds_as_expected=case.holds_as_expected,
        done=case.done,
        evidence=_evidence(left, world),
        person=case.person,
        was=left.custody,
        is_fixed_unconfirmed=case.relies_on_fixed and not world.does_fixed_hold,
        activates_fixed=activates,
    )


_NOT_ACTIVE: Final = key("the fixed gripper is not active, and activating it would move its jaws")


def _may_activate(left: Interrupted, world: World) -> bool:
    """Return whether the fixed gripper may be activated once the arm stands free with the part."""
    return world.is_fixed_asleep and left.custody is Custody.IN_ARM and left.intent is None


def _is_unconfirmed(left: Interrupted, world: World) -> bool:
    return left.custody is Custody.IN_FIXED and not world.does_fixed_hold


def _is_fixed_on_part(left: Interrupted, world: World) -> bool:
    """Return whether the fixed gripper reports its hold, or needs a press to confirm it."""
    return world.does_fixed_hold or world.may_fixed_hold(_mm(left.fixed_hold))


# --- without an unresolved intent ---------------------------------------------------------------


def _in_arm(left: Interrupted, world: World) -> Case:
    jaws = world.arm_jaws(_mm(left.arm_hold))
    if world.does_fixed_hold and left.intent is None:
        return _contradiction(left, key("the fixed gripper reports that it holds something, too"))
    if jaws is Jaws.ON_PART:
        # the giver may have been stopped before it stood wide enough for the retreat
        opens = Opens.FIXED if _gave(left, Once.RELEASE_FIXED) else Opens.NONE
        return Case(Custody.IN_ARM, opens=opens, leaves=_leaves(left))
    if jaws is Jaws.CLOSED:
        return Case(Custody.LOST, leaves=_leaves(left))
    return _contradiction(left, say("the arm gripper's jaws {value}", value=jaws.value))


def _in_both(left: Interrupted, world: World) -> Case:
    jaws = world.arm_jaws(_mm(left.arm_hold))
    if _is_receiving(left):
        if _is_fixed_on_part(left, world):
            return Case(Custody.IN_BOTH, opens=Opens.ARM)
        if jaws is Jaws.ON_PART:
            return _contradiction(left, key("the fixed gripper does not report its hold any more"))
    elif jaws is Jaws.ON_PART:
        return Case(Custody.IN_BOTH, opens=Opens.FIXED)
    return _contradiction(left, say("the arm gripper's jaws {value}", value=jaws.value))


def _in_fixed(left: Interrupted, world: World) -> Case:
    if _is_fixed_on_part(left, world):
        opens = Opens.ARM if _gave(left, Once.RELEASE_ARM) else Opens.NONE
        return Case(Custody.IN_FIXED, opens=opens, leaves=_leaves(left))
    if world.is_fixed_clear:
        return Case(Custody.LOST, leaves=_leaves(left))
    return _contradiction(left, key("the fixed gripper does not report its hold"))


def _lost(left: Interrupted, world: World) -> Case:
    """Return the case of two grippers that must be empty: closed on nothing, or wide open."""
    jaws = world.arm_jaws(_mm(left.arm_hold))
    if jaws in (Jaws.CLOSED, Jaws.WIDER) and world.is_fixed_clear:
        return Case(Custody.LOST, leaves=_leaves(left))
    return _contradiction(
        left,
        say("the arm gripper's jaws {value}: it may hang in one of the grippers", value=jaws.value),
    )


def _in_no_gripper(left: Interrupted, world: World) -> Case:
    """Return the case in which only the arm has to leave; the part is then sought as usual.

    Homing from low over the table, or from beside a tray, would meet the column.
    """
    if world.does_fixed_touch:
        return _contradiction(left, key("the fixed gripper reports that it holds something"))
    return Case(Custody.ON_TABLE, leaves=_leaves(left))


_CUSTODIES: Final[Mapping[Custody, Rule]] = {
    Custody.ON_TABLE: _in_no_gripper,
    Custody.IN_ARM: _in_arm,
    Custody.IN_BOTH: _in_both,
    Custody.IN_FIXED: _in_fixed,
    Custody.LOST: _lost,
    Custody.PLACED: _in_no_gripper,
}

# --- with one -------------------------------------------------------------------------------------


def _grasp(left: Interrupted, world: World) -> Case:
    """Return the case of a grasp off the table, where the part rests until the arm leaves."""
    jaws = world.arm_jaws(_mm(left.expected_hold))
    if jaws is Jaws.ON_PART and world.is_arm_pressing:
        return Case(Custody.IN_ARM, leaves=WayOut.BY_RETREAT, holds_as_expected=True, done="done")
    done: Done = "not done" if jaws is Jaws.WIDER else "unknown"
    return Case(Custody.ON_TABLE, opens=Opens.ARM_ON_TABLE, leaves=WayOut.BY_RETREAT, done=done)


def _hand_off(left: Interrupted, world: World) -> Case:
    """Undo it: the fixed gripper was to close, and the arm gripper never opened."""
    jaws = world.arm_jaws(_mm(left.arm_hold))
    expected_mm = None if left.intent is None else left.intent.expected_mm
    done: Done = "unknown"
    if world.does_fixed_hold:
        done = "done"
    elif not world.does_fixed_touch and judge_jaws(world.fixed_mm, expected_mm) is Jaws.WIDER:
        done = "not done"
    if jaws is Jaws.ON_PART:
        return Case(Custody.IN_BOTH, opens=Opens.FIXED, done=done)
    return _contradiction(left, say("the arm gripper's jaws {value}", value=jaws.value), done)


def _release_arm(left: Interrupted, world: World) -> Case:
    """Return the case of a run that stopped while the arm gripper opened to give the part."""
    jaws = world.arm_jaws(_mm(left.arm_hold))
    if jaws is Jaws.ON_PART:
        return Case(Custody.IN_BOTH, opens=Opens.FIXED, done="not done")
    if jaws in (Jaws.WIDER, Jaws.BETWEEN) and _is_fixed_on_part(left, world):
        done: Done = "done" if jaws is Jaws.WIDER else "unknown"
        return Case(Custody.IN_FIXED, opens=Opens.ARM, leaves=WayOut.BY_RETREAT, done=done)
    if world.is_fixed_clear and jaws is Jaws.WIDER:
        return Case(Custody.LOST, leaves=WayOut.BY_RETREAT, done="done")
    return _contradiction(left, say("the arm gripper's jaws {value}", value=jaws.value), "unknown")


def _receive(left: Interrupted, world: World) -> Case:
    """Undo it: the arm gripper was to close, and the fixed gripper never opened."""
    jaws = world.arm_jaws(_mm(left.expected_hold))
    done: Done = "unknown"
    if jaws is Jaws.ON_PART and world.is_arm_pressing:
        done = "done"
    elif jaws is Jaws.WIDER:
        done = "not done"
    if _is_fixed_on_part(left, world):
        return Case(Custody.IN_BOTH, opens=Opens.ARM, done=done)
    return _contradiction(left, key("the fixed gripper does not report its hold"), done)


def _release_fixed(left: Interrupted, world: World) -> Case:
    """Return the case of a run that stopped while the fixed gripper opened to give the part."""
    jaws = world.arm_jaws(_mm(left.arm_hold))
    if world.does_fixed_hold:
        return Case(Custody.IN_BOTH, opens=Opens.ARM, done="not done")
    if jaws is Jaws.ON_PART:
        return Case(Custody.IN_ARM, opens=Opens.FIXED, leaves=WayOut.BY_RETREAT, done="done")
    return _contradiction(left, say("the arm gripper's jaws {value}", value=jaws.value), "unknown")


def _put(custody: Custody, opens: Opens) -> Rule:
    """Return the rule of a release that leaves the part where it is meant to stay."""

    def rule(left: Interrupted, world: World) -> Case:
        jaws = world.arm_jaws(_mm(left.arm_hold))
        if jaws is Jaws.ON_PART:
            return Case(Custody.IN_ARM, done="not done")
        if jaws in (Jaws.WIDER, Jaws.BETWEEN):
            done: Done = "done" if jaws is Jaws.WIDER else "unknown"
            return Case(custody, opens=opens, leaves=WayOut.BY_RETREAT, done=done)
        return _contradiction(
            left, say("the arm gripper's jaws {value}", value=jaws.value), "unknown"
        )

    return rule


_INTENTS: Final[Mapping[str, Rule]] = {
    Once.GRASP: _grasp,
    Once.HAND_OFF: _hand_off,
    Once.RELEASE_ARM: _release_arm,
    Once.RECEIVE: _receive,
    Once.RELEASE_FIXED: _release_fixed,
    Once.SET_DOWN: _put(Custody.ON_TABLE, Opens.ARM_ON_TABLE),
    Once.SORT: _put(Custody.PLACED, Opens.ARM_OVER_TRAY),
}

# --- words ----------------------------------------------------------------------------------------


def _contradiction(left: Interrupted, found: str, done: Done | None = None) -> Case:
    cut = ""
    if left.intent is not None:
        cut = say(", cut off while it did: {name}", name=left.intent.name.replace("_", " "))
    words = say(
        "the journal has the part {value}{cut}; {found}",
        value=left.custody.value,
        cut=cut,
        found=found,
    )
    return Case(left.custody, done=done, person=words)


# Who has the part once an intent was done that the arm then leaves by its retreat.
AFTER: Final[Mapping[str, Custody]] = {
    Once.GRASP: Custody.IN_ARM,
    Once.RELEASE_ARM: Custody.IN_FIXED,
    Once.RELEASE_FIXED: Custody.IN_ARM,
    Once.SORT: Custody.PLACED,
}


def _leaves(left: Interrupted) -> WayOut:
    """Return the arm's way out: by retreat if the run stopped right before one, else by trail."""
    last = left.last_intent
    is_due = left.trail.retreat and last is not None and AFTER.get(last.name) is left.custody
    return WayOut.BY_RETREAT if is_due else WayOut.BY_TRAIL


def _gave(left: Interrupted, name: Once) -> bool:
    """Return whether this release gave the part away and the arm has not left since."""
    return (
        _leaves(left) is WayOut.BY_RETREAT
        and left.last_intent is not None
        and left.last_intent.name == name
    )


def _is_receiving(left: Interrupted) -> bool:
    """Return whether the part in both grippers is being handed back to the arm gripper."""
    return left.custody_before is Custody.IN_FIXED


def _mm(hold: rows.HoldNoted | None) -> float | None:
    return None if hold is None else hold.opening_mm


def _evidence(left: Interrupted, world: World) -> tuple[str, ...]:
    """Return the evidence, one sentence each: journal first, then the devices."""
    cut = ""
    if left.intent is not None:
        outcome = key(", which was reported done") if left.has_outcome else ""
        cut = say(
            "; then it was about to: {name}{outcome}",
            name=left.intent.name.replace("_", " "),
            outcome=outcome,
        )
    said: list[str] = [
        say(
            "journal: part {part} of run {run} was {value}{cut}",
            part=left.part,
            run=left.run,
            value=left.custody.value,
            cut=cut,
        )
    ]
    is_named = world.positions.startswith("arm: ")
    said.append(world.positions if is_named else say("arm: {positions}", positions=world.positions))
    if world.arm_mm is not None:
        hold = left.arm_hold or left.expected_hold
        known = (
            ""
            if hold is None
            else say("; on the part they stand at {opening_mm:.1f} mm", opening_mm=hold.opening_mm)
        )
        press = "press" if world.is_arm_pressing else key("do not press")
        said.append(
            say(
                "arm gripper: its jaws stand at {arm_mm:.1f} mm and {press}{known}",
                arm_mm=world.arm_mm,
                press=press,
                known=known,
            )
        )
    touch = key("touch something") if world.does_fixed_touch else key("report no contact")
    sees = {Signal.OK: key("sees something"), Signal.NOT_OK: key("sees nothing")}.get(
        world.barrier, key("gives no reading")
    )
    ready = "" if world.is_fixed_ready else key("; it is not ready")
    if left.fixed_hold is not None and left.custody in (Custody.IN_FIXED, Custody.IN_BOTH):
        ready = say(
            "; on the part its jaws stood at {opening_mm:.1f} mm{ready}",
            opening_mm=left.fixed_hold.opening_mm,
            ready=ready,
        )
    said.append(
        say(
            "fixed gripper: its jaws stand at {fixed_mm:.1f} mm and {touch}; "
            "its light barrier {sees}{ready}",
            fixed_mm=world.fixed_mm,
            touch=touch,
            sees=sees,
            ready=ready,
        )
    )
    return tuple(said)
