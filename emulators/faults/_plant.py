"""The verbs' requirements on a cell: devices, wires, world. `emulators._cell.Cell` is one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from emulators.added import AddedParts
from emulators.arms import EmulatedArm, RtxArm
from emulators.gripper_modbus import JawModel
from emulators.io_modbus import CellSignals, E1214Device
from emulators.lamp_units import LampModule
from emulators.lighting_modbus import LampModel
from emulators.modbus import Bus
from emulators.world import World


@dataclass(frozen=True, slots=True)
class SupplyChange:
    """The arm's motors have lost their supply, or have it back.

    Attributes
    ----------
    at_s : time [world s]
    on : they have it
    """

    at_s: float
    on: bool


class Network(Protocol):
    """A Modbus line that is reached over a network."""

    is_reachable: bool

    def drop_connections(self) -> None:
        """End every connection now."""


class Camera(Protocol):
    """A camera as faults know it.

    Attributes
    ----------
    faults : a frozen dataclass, of the camera's own kind
    """

    faults: Any

    @property
    def is_plugged(self) -> bool:
        """Whether the camera is there."""
        ...


class CameraPlugs(Protocol):
    """The plugs of the cameras."""

    def unplug(self, name: str) -> None:
        """Pull a camera's cable."""

    def plug(self, name: str) -> str:
        """Put an unplugged camera back; return its address."""
        ...


class GripperController(Protocol):
    """The firmware of the fixed gripper, whichever it is."""

    unit: int

    @property
    def is_powered(self) -> bool:
        """Whether its supply is on."""
        ...

    def raise_fault(self, fault: int) -> None:
        """Let a fault happen, by the gripper's own number for it."""
        ...


class Installation(Protocol):
    """The true state of an installed cell."""

    def truth(self) -> dict[str, Any]:
        """Return the true parameters of the installation as plain values."""
        ...


class Plant(Protocol):
    """A cell in which faults are caused.

    Attributes
    ----------
    networks : the lines ``gripper``, ``lights`` and ``io`` that are connections, not cables
    """

    arm_unit: EmulatedArm
    jaws: JawModel
    gripper_bus: Bus
    lights_bus: Bus
    signals: CellSignals
    io: E1214Device
    io_bus: Bus
    world: World
    added: AddedParts
    camera_plugs: CameraPlugs

    @property
    def rtx(self) -> RtxArm:
        """Its UMI RTX.

        Raises
        ------
        ValueError : it has another arm
        """
        ...

    @property
    def gripper(self) -> GripperController:
        """Of the fixed gripper."""
        ...

    @property
    def supply_changes(self) -> Sequence[SupplyChange]:
        """Of the supply of the arm's motors, the last ones."""
        ...

    @property
    def as_built(self) -> Installation:
        """The true installation."""
        ...

    @property
    def networks(self) -> Mapping[str, Network]:
        """Carry out the order; see the class."""
        ...

    @property
    def lamp_modules(self) -> Mapping[str, LampModule]:
        """Modules of the lamp unit: ``dimmer`` and ``relays`` of a Waveshare."""
        ...

    @property
    def lamps(self) -> Mapping[str, LampModel]:
        """By their names in the cell file."""
        ...

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """By their names in the cell file."""
        ...

    def knock_camera(self, name: str, T: NDArray[np.float64]) -> None:
        """Move a camera by T (4, 4) in its own frame [mm]."""

    def timing(self) -> dict[str, Any]:
        """Return the world's time, and the losses."""
        ...
