"""An emulated UR arm whose time a test lets pass, and programs for it."""

from collections.abc import Callable

from emulators.gripper_modbus import RobotiqDevice
from emulators.ur_arm import CYCLE_S, MODELS, Message, Program, ScriptError, ScriptReader, UrArm

FOLDED = (0.0, -1.5, 1.5, -1.5, -1.5, 0.0)


def running_arm(model: str = "ur5e", *, gripper: RobotiqDevice | None = None) -> UrArm:
    """Return an arm with power and without brakes, at `FOLDED`."""
    arm = UrArm(MODELS[model], gripper=gripper)
    arm.start_running()
    arm.place(FOLDED)
    return arm


def programs(text: str) -> list[Program | ScriptError]:
    """Return what a reader makes of a text that ends with a newline."""
    return ScriptReader().feed(f"{text}\n".encode())


def run(arm: UrArm, text: str) -> str:
    """Start a program; return why it is refused, empty if it is not."""
    (program,) = programs(text)
    assert isinstance(program, Program), program
    return arm.start(program)


def shifted(joint: int, by_rad: float) -> list[float]:
    """Return `FOLDED` with one joint elsewhere."""
    return [q + by_rad * (number == joint) for number, q in enumerate(FOLDED)]


def until(arm: UrArm, is_so: Callable[[], bool], at_most_s: float = 60.0) -> float:
    """Let time pass until something is so; return how much has passed [world s]."""
    for cycle in range(round(at_most_s / CYCLE_S)):
        if is_so():
            return cycle * CYCLE_S
        arm.advance(CYCLE_S)
    raise AssertionError(f"not within {at_most_s} s")


def is_at_rest(arm: UrArm) -> bool:
    """Return whether no joint moves or is about to."""
    return not any(arm.qd_rad_per_s) and arm.q_rad == arm.target.q and not any(arm.target.qd)


def said(arm: UrArm) -> list[Message]:
    """Return the list into which everything goes that the arm says from now on."""
    messages: list[Message] = []
    arm.on_message.append(messages.append)
    return messages
