"""The offer of a driver to the cell: an entry point that names a `Driver`.

The entry point's name is ``KIND.NAME`` in the group ``cellctl.drivers``: kind ``arm``, ``gripper``,
``lights``, ``io`` or ``camera``, and the name that a cell file gives as ``driver:``. cellctl's own
drivers are offered the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Generic, TypeVar

from ..clock import CellClock
from ..wires import UNTAPPED, Wires
from .arm import Arm
from .camera import Capture
from .io_block import Polling
from .lights import Lamp

if TYPE_CHECKING:  # a program without Modbus devices does not load pymodbus
    import numpy as np
    from numpy.typing import NDArray

    from ..modbus_link import ModbusLink

GROUP: Final = "cellctl.drivers"

Device = TypeVar("Device", covariant=True)
Settings = TypeVar("Settings")
Shape = TypeVar("Shape")
Model = TypeVar("Model", covariant=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """The place of a device, and the cell's requirements on it.

    Attributes
    ----------
    name : name of the device in the cell file, such as ``gripper`` or ``overhead``
    address : as the cell file says, or as the emulator offers it
    section : the device's whole section of the cell file, ``address`` and ``settings`` among it
    clock : all durations and instants are its seconds
    open_link : returns the Modbus line of this section, one for all devices on it; it is closed
        by the cell
    polling : polling of an I/O block
    inputs : of an I/O block, by the name of the signal on each, counted from 0; a signal that is
        not here is where the driver has it
    outputs : of an I/O block, by the name of the 24 V signal on each, counted from 0; empty where
        the cell file names none
    lamps : lamps of a lamp unit
    capture : capture of a camera
    silence_s : silence of an arm: a line on which no byte has come back for so long is silent [cell
        s]
    wires : recorder or player of the device's wires; `open_link` has it in place already
    folder : folder of the cell file; an address that is a relative path begins here
    shape : of an arm, ``arm.shape`` of the cell file as the driver's own dataclass; None if it has
        none
    """

    name: str
    address: str
    section: Mapping[str, Any]
    clock: CellClock
    open_link: Callable[[], ModbusLink]
    polling: Polling | None = None
    inputs: Mapping[str, int] = field(default_factory=dict)
    outputs: Mapping[str, int] = field(default_factory=dict)
    lamps: tuple[Lamp, ...] = ()
    capture: Capture | None = None
    silence_s: float = 0.5
    wires: Wires = UNTAPPED
    folder: Path = Path()
    shape: Any = None


@dataclass(frozen=True, slots=True)
class NoSettings:
    """Settings of a driver that has none."""


@dataclass(frozen=True, slots=True)
class Driver(Generic[Device, Settings]):
    """A driver, as an entry point of the group ``cellctl.drivers`` offers it.

    Attributes
    ----------
    settings : dataclass of what may stand under ``settings:`` of the device in the cell file
    build : returns the device; opens nothing yet
    keeps_cell_time : its device has no time of its own, as a file has none: next to emulated
        devices it goes by their clock, at whatever speed
    max_force_n : largest force of a gripper: how hard it presses at the most [N], given its
        settings; None where the driver does not state it
    node_group : group whose members may open its device, where the address is a device node;
        empty where it is anything else
    is_recorded : what its device says goes through the site's wires or Modbus line, so that
        `run --record` has it and the run can be played back
    needs : returns what the driver needs of this computer beside Python, such as a library and its
        version; raises a `DeviceError` that says what to install where it is missing. None where it
        needs nothing
    """

    settings: type[Settings]
    build: Callable[[Site, Settings], Device]
    keeps_cell_time: bool = field(default=False, kw_only=True)
    max_force_n: Callable[[Settings], float] | None = field(default=None, kw_only=True)
    node_group: str = field(default="", kw_only=True)
    is_recorded: bool = field(default=True, kw_only=True)
    needs: Callable[[], str] | None = field(default=None, kw_only=True)


@dataclass(frozen=True, slots=True)
class ArmDescription(Generic[Model]):
    """The description of an arm for planning.

    Attributes
    ----------
    model : kinematics, limits, links and timing; fits the controller's `ArmModel`. A dataclass of
        numbers and arrays, by which cached plans are found again
    park_q : (6,) configuration in which the arm waits, out of the cameras' pictures [rad, mm]
    """

    model: Model
    park_q: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ArmDriver(Driver[Arm, Settings], Generic[Settings, Shape, Model]):
    """A driver that also describes its arm.

    Attributes
    ----------
    shape : dataclass of what may stand under ``shape:`` of the cell file's section ``arm``
    describe : returns the arm of that shape; asks no device
    """

    shape: type[Shape]
    describe: Callable[[Shape], ArmDescription[Model]]
