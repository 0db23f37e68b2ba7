"""The bench of a step: devices, services, the person, its evidence, and its permits to move."""

from collections.abc import Awaitable, Callable, Mapping
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from controller.arrays import FloatArray
from controller.cell.custody import Custody
from controller.cell.devices import Devices
from controller.cell.devices.interlocks import check_interlocks
from controller.cell.journal import Body
from controller.cell.journal.rows import FirstMotion
from controller.cell.services import Gate, Imaging, Interlocks, Motion, Mover
from controller.config import Cell
from controller.config.calibration_reference import CalibrationName
from controller.planning import JointPath, NoMotionError
from controller.planning.geometry import Box
from controller.planning.model import CellLayout
from controller.planning.motion import Scene, connect
from controller.setup.software import software_versions
from drivers.clock import CellClock
from drivers.kinds import Arm, FirstContact
from messages import say

from .errors import StepFailedError
from .evidence import StepEvidence
from .person import Person

PERMIT: Final = "commission"
# A cell that nobody has measured: 3 mm and 0.5 degrees of the base, 0.5 degrees of each joint and
# 0.5 mm of the tool come to some 15 mm at the TCP of the stretched arm.
UNCALIBRATED_MM: Final = 20.0
SLOW: Final = 0.25  # share of the usual speed


@dataclass(slots=True)
class HandedOver:
    """The gripper that has something a person handed over, for the interlock rules."""

    custody: Custody = Custody.NONE


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """The bench of a step.

    Attributes
    ----------
    cell : as commissioned so far
    layout : the cell as planning sees it
    devices : connected and halted
    arm : arm of the devices; it knows whether it is being used
    clock : clock of the cell
    motion, imaging, gate, interlocks : services
    person : answers and lends a hand
    evidence : keeps what is found
    emulated : names of the devices that are
    by : name of the person who commissions
    based_on : hashes of the calibrations that the step uses
    note : takes a row of the journal
    recipes : files of those that the cell is to run
    handed : gripper with the object handed over, while that limits the arm's motions
    """

    cell: Cell
    layout: CellLayout
    devices: Devices
    arm: Arm
    clock: CellClock
    motion: Motion
    imaging: Imaging
    gate: Gate
    interlocks: Interlocks
    person: Person
    evidence: StepEvidence
    emulated: frozenset[str]
    by: str
    based_on: Mapping[CalibrationName, str]
    note: Callable[[Body], object]
    recipes: tuple[Path, ...] = ()
    handed: HandedOver = field(default_factory=HandedOver)

    async def permit_motion(self, what: str) -> None:
        """Have a person agree to motion, then permit it.

        Raises
        ------
        DeclinedError : they do not
        InterlockError : a safety copy is not healthy
        """
        check_interlocks(self.devices.io)
        await self.person.confirm(
            "may_move",
            f"{what} The cell has to be clear of people and loose objects, and somebody has "
            "to stand at the emergency stop. Is that so?",
        )
        check_interlocks(self.devices.io)
        self.gate.permits.issue(PERMIT)

    async def home_and_park(self) -> None:
        """Home the arm, open its jaws half, and park it out of both cameras' sight.

        Raises
        ------
        NoPermitError : nothing may move
        DeviceError : it does not
        """
        self.evidence.show(self.motion.homing_words)
        await self.motion.home()
        await self.park()

    async def park(self) -> None:
        """Open the homed arm's jaws half and move it to its park.

        From where homing leaves it; an arm that moved no joint to home may stand anywhere, and
        takes a path that is proven free.

        Raises
        ------
        StepFailedError : there is no such path
        """
        opening_mm = self.layout.arm_gripper.max_mm * 0.5
        await self.move_jaws(
            say("the arm gripper opens to {opening_mm:.0f} mm", opening_mm=opening_mm),
            lambda: self.arm.move_gripper_mm(opening_mm),
        )
        if not self.motion.sweeps_to_home:
            await self.go(self.layout.park_q, "to its park")
        await self.motion.start_from(self.layout.park_q)

    async def move_jaws(self, what: str, verb: Callable[[], Awaitable[object]]) -> None:
        """Carry out a verb that moves jaws.

        Parameters
        ----------
        what : text for the person who decides
        verb : moves them

        Raises
        ------
        InterlockError, NoPermitError, DeviceError : it may not, or does not
        """
        self.interlocks.admit_jaws()
        async with self.moving(what, is_arm=False):
            await verb()

    def moving(self, what: str, *, is_arm: bool) -> AbstractAsyncContextManager[None]:
        """Return the gate's block that a motion has to be in.

        Parameters
        ----------
        what : text for the person who decides
        is_arm : the arm moves, not jaws alone
        """

        async def preview() -> FirstMotion:
            return FirstMotion(words=what)

        return self.gate.moving(preview, Mover.ARM if is_arm else Mover.ARM_JAWS)

    async def home_in_turn(self) -> None:
        """Home axis by axis, where the arm offers it; a person confirms each.

        Raises
        ------
        DeclinedError : they do not
        InterlockError, NoPermitError, DeviceError : it may not move, or does not
        """
        arm = self.devices.arm

        async def confirm(what: str) -> None:
            await self.person.confirm("home_axis", f"Homing: {what}. Ready?")

        async with self.moving("the arm homes, axis by axis", is_arm=True):
            await self.arm.enable_power()
            if isinstance(arm, FirstContact):
                await arm.home_in_turn(confirm)
            else:
                await confirm(
                    "the arm sweeps its whole reach"
                    if self.motion.sweeps_to_home
                    else "the arm opens and closes its jaws"
                )
                await self.arm.home()

    async def go(self, q: FloatArray, what: str, *, speed: float = SLOW) -> None:
        """Move the arm to a configuration (6,) by a path proven free with the extra clearance.

        Parameters
        ----------
        q : target joints
        what : purpose of the motion, as a message begins
        speed : share of the usual speed

        Raises
        ------
        StepFailedError : no such path is proven free
        """
        for waypoint in await self.path_to(q, self.scene(), what):
            await self.motion.follow((waypoint,), first_speed=speed)

    async def path_to(self, q: FloatArray, scene: Scene, what: str) -> JointPath:
        """Return a path from the arm's position to a configuration (6,), free in a scene.

        Parameters
        ----------
        q : target joints
        scene : load on the arm, and the obstacles
        what : purpose of the motion, as a message begins

        Raises
        ------
        StepFailedError : no such path is proven free
        """
        try:
            return connect(await self.arm.read_q(), q, scene, what)
        except NoMotionError as error:
            raise StepFailedError(str(error)) from error

    def scene(self) -> Scene:
        """Return the empty cell with all obstacles thicker by the unmeasured uncertainty."""
        layout = with_clearance(self.layout, UNCALIBRATED_MM)
        return Scene(layout, layout.arm_gripper.max_mm, layout.fixed_open_mm)

    def header(self, **more: Any) -> dict[str, Any]:  # noqa: ANN401  (fields of a calibration)
        """Return the header of a calibration that this step writes."""
        return {
            "measured": datetime.now(UTC).replace(microsecond=0),
            "by": self.by,
            "software": f"cellctl {software_versions()['cellctl']}",
            "cell": self.cell.name,
            "evidence": f"evidence/{self.evidence.folder.name}",
            "based_on": dict(self.based_on),
            **more,
        }


def with_clearance(layout: CellLayout, by_mm: float) -> CellLayout:
    """Return a layout in which all obstacles are thicker by a margin on all sides."""

    def grown(box: Box) -> Box:
        return Box(box.T, box.half_mm + by_mm)

    fixed = layout.fixed_gripper
    if fixed is not None:
        fixed = replace(fixed, body=tuple(grown(box) for box in fixed.body))
    return replace(
        layout,
        obstacles={name: grown(box) for name, box in layout.obstacles.items()},
        fixed_gripper=fixed,
    )
