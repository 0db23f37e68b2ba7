"""The arm of the emulated cell: the one that the cell file describes, with its controller."""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Protocol

from emulators.clock import WorldClock
from emulators.gripper_modbus import JawModel, JawScale, RobotiqConfig, RobotiqDevice
from emulators.umi_scara import (
    COUNTS_PER_DEG,
    ZED_COUNTS_PER_MM,
    ArmErrors,
    ArmModel,
    ArmServer,
    ArmWire,
    Axis,
)
from emulators.ur_arm import JOINTS, STANDARD_PORTS, UrArm, UrServer, UrVerbs
from emulators.world import ArmBody
from emulators.world.arms import UrShape
from emulators.world.layout import ArmShape

FLANGE_GRIPPER_UNIT = 9
# counts of each motor of the RTX that a person moves by the gripper, per rad or mm of its joint
_PER_JOINT: Final[Mapping[str, tuple[Axis, float]]] = {
    "shoulder": (Axis.SHOULDER, math.degrees(COUNTS_PER_DEG[Axis.SHOULDER])),
    "elbow": (Axis.ELBOW, math.degrees(COUNTS_PER_DEG[Axis.ELBOW])),
    "zed": (Axis.ZED, ZED_COUNTS_PER_MM),
}


class SuppliedArm(ArmBody, Protocol):
    """An arm whose motors have a supply that contacts cut."""

    @property
    def has_supply(self) -> bool:
        """Whether all of them are closed."""
        ...

    def switch_supply(self, contact: str, is_closed: bool) -> None:
        """Close or open one of them, by its name."""
        ...

    def press_estop(self) -> None:
        """Open the emergency stop's contact."""
        ...

    def release_estop(self) -> None:
        """Close it again."""
        ...


class EmulatedArm(Protocol):
    """An arm in the world, and its controller on its wires."""

    is_powered: bool
    """Whether its controller has its supply."""

    @property
    def body(self) -> SuppliedArm:
        """The arm as the world and people meet it."""
        ...

    @property
    def verbs(self) -> Mapping[str, Callable[..., dict[str, Any] | None]]:
        """What may befall this make of arm alone, by verb."""
        ...

    @property
    def address(self) -> str:
        """Where clients find it, once started."""
        ...

    def obstruct(self, motor: str, direction: int, blocked: bool) -> None:
        """Block a motor in a direction, or free it.

        Parameters
        ----------
        motor : its name in the chain
        direction : +1 or -1
        blocked : False frees it
        """
        ...

    @property
    def led(self) -> Sequence[str]:
        """Names of the joints that a person turns who leads its gripper."""
        ...

    def lead(self, step: Mapping[str, float]) -> None:
        """Move joints by hand, by their names [rad, mm]; an arm that holds stays."""
        ...

    async def start(self, clock: WorldClock) -> None:
        """Open its wires.

        Raises
        ------
        OSError : an address is taken
        """
        ...

    async def aclose(self) -> None:
        """Close them; may be called half-way through `start`."""
        ...


class RtxArm:
    """A UMI RTX on its serial line.

    Parameters
    ----------
    seed : seed of where it stands
    errors : its differences from its description
    """

    def __init__(self, seed: int, errors: ArmErrors) -> None:
        self.body = ArmModel(seed, errors)
        self.wire = ArmWire(self.body)
        self.verbs: Mapping[str, Callable[..., dict[str, Any] | None]] = {}
        self._server: ArmServer | None = None

    @property
    def is_powered(self) -> bool:
        """Whether its boards have their supply."""
        return self.wire.is_powered

    @is_powered.setter
    def is_powered(self, is_powered: bool) -> None:
        self.wire.is_powered = is_powered

    @property
    def address(self) -> str:
        """Path of its terminal.

        Raises
        ------
        ValueError : it has not been started
        """
        if self._server is None:
            raise ValueError("not started")
        return str(self._server.path)

    def obstruct(self, motor: str, direction: int, blocked: bool) -> None:
        """Block a motor in a direction, or free it.

        Parameters
        ----------
        motor, direction, blocked : as `EmulatedArm.obstruct`
        """
        self.body.obstruct(Axis(motor), direction, blocked)

    @property
    def led(self) -> Sequence[str]:
        """Shoulder, elbow and zed: its gripper keeps pointing down."""
        return tuple(_PER_JOINT)

    def lead(self, step: Mapping[str, float]) -> None:
        """Move joints by hand, by their names [rad, mm]; motors that hold do not yield."""
        for joint, by in step.items():
            axis, per_unit = _PER_JOINT[joint]
            self.body.push(axis, by * per_unit)

    async def start(self, clock: WorldClock) -> None:
        """Open its terminal."""
        self._server = ArmServer(self.wire, clock)
        await self._server.start()

    async def aclose(self) -> None:
        """Close it."""
        if self._server is not None:
            await self._server.aclose()


class UrCellArm:
    """A Universal Robots arm with a 2F-85 on its flange, at an address of its own on this machine.

    It stands as it was left: in the park position of the cell file.

    Parameters
    ----------
    shape : the arm as the cell file describes it
    wider_mm : how much wider the jaws are open than they read
    """

    def __init__(self, shape: UrShape, wider_mm: float = 0.0) -> None:
        scale = JawScale(wider_mm=wider_mm)
        gripper = RobotiqDevice(JawModel(), FLANGE_GRIPPER_UNIT, RobotiqConfig(scale=scale))
        self.body = UrArm(shape.facts, gripper=gripper)
        self.body.place(shape.park_q)
        self._server = UrServer(self.body, _own_host(), STANDARD_PORTS)
        of_arm = UrVerbs(self.body, self._server).verbs
        # `power` and `estop` are the cell's: they reach its other devices, too
        self.verbs = {name: do for name, do in of_arm.items() if name not in ("estop", "arm_power")}

    @property
    def is_powered(self) -> bool:
        """Whether its controller has its supply."""
        return self._server.is_powered

    @is_powered.setter
    def is_powered(self, is_powered: bool) -> None:
        self._server.is_powered = is_powered

    @property
    def address(self) -> str:
        """The address of its controller, with the standard ports."""
        return self._server.host

    def obstruct(self, motor: str, direction: int, blocked: bool) -> None:
        """Block a joint in a direction, or free it.

        Parameters
        ----------
        motor, direction, blocked : as `EmulatedArm.obstruct`
        """
        self.body.obstruct(motor, direction, blocked)

    @property
    def led(self) -> Sequence[str]:
        """All of them."""
        return JOINTS

    def lead(self, step: Mapping[str, float]) -> None:
        """Move joints by hand, by their names [rad]; an arm out of freedrive stays."""
        self.body.lead([step[joint] for joint in JOINTS])

    async def start(self, clock: WorldClock) -> None:
        """Open its ports; they keep the time of the arm's control cycles."""
        await self._server.start()

    async def aclose(self) -> None:
        """Close them."""
        await self._server.aclose()


def make_arm(drawn: ArmShape, errors: ArmErrors, seed: int) -> EmulatedArm:
    """Return the arm that the cell file describes.

    Parameters
    ----------
    drawn : the arm as the cell file describes it, which its controller goes by
    errors : differences of a UMI RTX from its description; of any other arm, those of its jaws
    seed : seed of where a UMI RTX stands
    """
    if isinstance(drawn, UrShape):
        return UrCellArm(drawn, errors.jaw_zero_mm)
    return RtxArm(seed, errors)


def _own_host() -> str:
    """Return an address of this machine that no other process of ours takes: its number in it."""
    pid = os.getpid()
    return f"127.{64 + (pid >> 16) % 128}.{pid >> 8 & 255}.{pid & 255}"
