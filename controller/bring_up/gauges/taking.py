"""Gauges between the jaws of either gripper: handed over by a person, grasped, taken back."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from controller.calibration.target import BoardSection
from controller.cell.custody import Custody
from drivers.kinds import Hold
from messages import key, say

from ..bench import Bench
from ..boards import PLATE_FORCE, put_away
from ..errors import StepFailedError
from ..person import Errand

WIDE_MM: Final = 40.0  # least opening of the jaws before a gauge is put between them
ROOM_MM: Final = 10.0  # clearance of the jaws round a gauge, if they open that far
OFF_MM: Final = 2.0  # largest difference of a grasp's opening from the gauge's thickness


async def take_in_arm(bench: Bench, board: BoardSection, file: Path, seed: int) -> float:
    """Have a gauge put between the arm's jaws and close them; return their opening [mm].

    Parameters
    ----------
    bench : bench of the step, whose arm is at its park
    board, file : board and file of the gauge
    seed : seed of how an emulated person holds it

    Raises
    ------
    StepFailedError : the jaws closed on something else, or on nothing
    DeclinedError, NobodyThereError, CellError, DeviceError : it cannot be done
    """
    await _open_arm(bench, board)
    await _hand_over(bench, file, "arm", key("arm gripper"), seed)
    opening_mm = 0.0

    async def close() -> None:
        nonlocal opening_mm
        opening_mm = await bench.arm.grasp(PLATE_FORCE)

    await bench.move_jaws("the arm gripper closes on the gauge", close)
    _require_between("arm", opening_mm, board.thickness_mm)
    return opening_mm


async def give_back_from_arm(bench: Bench, board: BoardSection, file: Path) -> None:
    """Have a person take the object in the arm gripper at its park.

    Parameters
    ----------
    bench : bench of the step
    board, file : board and file of the gauge

    Raises
    ------
    DeclinedError, NobodyThereError, CellError, DeviceError : it cannot be done
    """
    await bench.person.confirm("take_gauge", "The arm's jaws open next: hold the gauge. Do you?")
    await _open_arm(bench, board)
    await put_away(bench, file, "Put the gauge away. Is it away?")


async def take_in_fixed(
    bench: Bench, board: BoardSection, file: Path, seed: int, force_n: float
) -> float:
    """Have a gauge put between the fixed jaws and close them; return their opening [mm].

    Parameters
    ----------
    bench : bench of the step, whose arm is at its park
    board, file : board and file of the gauge
    seed : seed of how an emulated person holds it
    force_n : force of the jaws

    Raises
    ------
    StepFailedError : the jaws closed on something else, or on nothing
    DeclinedError, NobodyThereError, CellError, DeviceError : it cannot be done
    """
    gripper = bench.devices.gripper
    await _open_fixed(bench, _wide_mm(board, bench.devices.gripper.max_opening_mm))
    await _hand_over(bench, file, "fixture", key("fixed gripper"), seed)
    is_met, opening_mm = False, 0.0

    async def close() -> None:
        nonlocal is_met, opening_mm
        found = await gripper.close_on(board.thickness_mm, force_n=force_n)
        is_met, opening_mm = found.object_detected, found.opening_mm

    await bench.move_jaws("the fixed gripper closes on the gauge", close)
    _require_between("fixed", opening_mm if is_met else 0.0, board.thickness_mm)
    bench.handed.custody = Custody.IN_FIXED
    return opening_mm


async def require_fixed_holds(bench: Bench) -> None:
    """Require that the fixed gripper still holds the part it grasped.

    Raises
    ------
    StepFailedError : it reports that it has not
    """
    found = await bench.devices.gripper.hold()
    if found is not Hold.HELD:
        raise StepFailedError(
            say(
                "the fixed gripper reports `{value}` with the plate; clean pads "
                "and plate, check that the jaws grasp it fully, and repeat the step",
                value=found.value,
            )
        )


async def give_back_from_fixed(bench: Bench, file: Path) -> None:
    """Have a person take the object in the fixed gripper; leave it wide open for runs."""
    await bench.person.confirm(
        "take_gauge", "The fixed gripper opens next: hold what is in it. Do you?"
    )
    await _open_fixed(bench, bench.devices.gripper.max_opening_mm)
    await put_away(bench, file, "Put it away. Is it away?")


def _wide_mm(board: BoardSection, widest_mm: float) -> float:
    """Return the jaw opening [mm] for a person to put a gauge between the jaws."""
    return min(max(WIDE_MM, board.thickness_mm + ROOM_MM), widest_mm)


async def _open_arm(bench: Bench, board: BoardSection) -> None:
    opening_mm = _wide_mm(board, bench.arm.max_opening_mm)
    await bench.move_jaws(
        say("the arm gripper opens to {opening_mm:.0f} mm", opening_mm=opening_mm),
        lambda: bench.arm.move_gripper_mm(opening_mm),
    )


async def _open_fixed(bench: Bench, opening_mm: float) -> None:
    await bench.move_jaws(
        say("the fixed gripper opens to {opening_mm:.0f} mm", opening_mm=opening_mm),
        lambda: bench.devices.gripper.open_to(opening_mm),
    )
    bench.handed.custody = Custody.NONE


async def _hand_over(bench: Bench, file: Path, key: str, which: str, seed: int) -> None:
    order = {"do": "give", "file": str(file), "gripper": key, "seed": seed}
    text = (
        f"Hold `{file.stem}` between the jaws of the {which}: its bare side between the pads, its "
        "faces along the jaws, its print beyond the fingers. The jaws close next. Is it there?"
    )
    await bench.person.have_done(Errand(f"give_{key}", text, (order,)))


CLOSED_ON_GAUGE: Final[Mapping[str, str]] = {
    "arm": key(
        "the arm gripper closed to {opening_mm:.1f} mm, the gauge is {thickness_mm:g} mm thick: "
        "hold it between the jaws, or give the file of the gauge in use"
    ),
    "fixed": key(
        "the fixed gripper closed to {opening_mm:.1f} mm, the gauge is {thickness_mm:g} mm thick: "
        "hold it between the jaws, or give the file of the gauge in use"
    ),
}


def _require_between(which: str, opening_mm: float, thickness_mm: float) -> None:
    if abs(opening_mm - thickness_mm) > OFF_MM:
        raise StepFailedError(
            say(CLOSED_ON_GAUGE[which], opening_mm=opening_mm, thickness_mm=thickness_mm)
        )
