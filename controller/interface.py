"""The Python interface: what scripts may rely on (docs/python.md).

`open_cell` opens the devices of a cell one by one, when a script first uses them.
`recognise_picture`, `judge_pictures` and `plan_part` need no device. A script is not supervised:
the checks that `cellctl run` makes before and during each motion are up to the script.
"""

import tempfile
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Literal

from controller.arrays import Grey
from controller.cad import CadError
from controller.cad.compiled import CompileOptions, load_part, options_among
from controller.cell.devices import DeviceBuilder, resolve
from controller.cell.devices.clocks import find_clock
from controller.cell.devices.emulator import (
    EmulatorError,
    emulated_cell,
    emulator_args,
    emulator_command,
)
from controller.cell.devices.interlocks import REQUIRED_SIGNALS, check_interlocks, settled_signal
from controller.cell.errors import InterlockError
from controller.cell.lock import CellBusyError, hold_cell
from controller.cell.plans import PlanCache
from controller.cell.services import CameraName, Imaging
from controller.config import EMULATED_CELL, SHIPPED, Cell, ConfigError, load_cell, load_recipe
from controller.config.view_set import load_view_set
from controller.imaging import Camera as CameraModel
from controller.inspection import PartInspection
from controller.planning import NoPlanError, Plan
from controller.recognition import Sighting, recognise
from controller.recognition.stored import open_library
from controller.setup.drivers import require_drivers
from controller.setup.optics import build_camera
from controller.setup.planner import planner_setup
from controller.setup.samples import sampled_for
from controller.stored import compiled_part, judge_views, judging_of, read_pictures
from drivers.clock import CellClock
from drivers.errors import DeviceError
from drivers.kinds import Arm, Camera, FixedGripper, IoBlock, LampUnit

__all__ = [
    "CadError",
    "CellBusyError",
    "ConfigError",
    "DeviceError",
    "EmulatorError",
    "InterlockError",
    "NoPlanError",
    "OpenCell",
    "PartInspection",
    "Picture",
    "Plan",
    "Sighting",
    "judge_pictures",
    "open_cell",
    "plan_part",
    "recognise_picture",
    "shipped_file",
]

FileName = str | PathLike[str]


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A picture, and the camera that took it.

    Attributes
    ----------
    grey : (height, width)
    camera : its calibration and its pose in the world
    """

    grey: Grey
    camera: CameraModel


class OpenCell:
    """A cell whose devices a script drives; see `open_cell`.

    Each device is connected when it is first used, and closed at the end.

    Attributes
    ----------
    config : the cell file
    clock : `sleep`, `timeout` and `now_s` in the cell's time
    """

    def __init__(
        self, config: Cell, builder: DeviceBuilder, clock: CellClock, stack: AsyncExitStack
    ) -> None:
        self.config = config
        self.clock = clock
        self._builder = builder
        self._stack = stack
        self._arm: Arm | None = None
        self._gripper: FixedGripper | None = None
        self._io: IoBlock | None = None
        self._lights: LampUnit | None = None
        self._cameras: dict[CameraName, Camera] = {}

    async def arm(self) -> Arm:
        """Return the arm, connected and allowed to move; it is stopped at the end.

        Raises
        ------
        InterlockError : a safety copy is not healthy
        DeviceError : the arm does not answer
        """
        if self._arm is None:
            await self._require_interlocks()
            arm = self._builder.arm()
            self._stack.push_async_callback(arm.aclose)
            await arm.connect()
            await arm.enable_power()
            self._arm = arm
        return self._arm

    async def _require_interlocks(self) -> None:
        io = await self.io()
        for name in REQUIRED_SIGNALS:
            await settled_signal(io, name, self.clock)
        check_interlocks(io)

    async def gripper(self) -> FixedGripper:
        """Return the fixed gripper, connected; at the end it stays as it is.

        Raises
        ------
        DeviceError : the gripper does not answer
        """
        if self._gripper is None:
            gripper = self._builder.gripper()
            self._stack.push_async_callback(gripper.aclose)
            await gripper.connect()
            self._gripper = gripper
        return self._gripper

    async def io(self) -> IoBlock:
        """Return the I/O block, connected.

        Raises
        ------
        DeviceError : the block does not answer
        """
        if self._io is None:
            io = self._builder.io()
            self._stack.push_async_callback(io.aclose)
            await io.connect()
            self._io = io
        return self._io

    async def lights(self) -> LampUnit:
        """Return the lamp unit, connected; all lamps are switched off at the end.

        Raises
        ------
        DeviceError : the lamp unit does not answer
        """
        if self._lights is None:
            lights = self._builder.lights()
            await lights.connect()
            self._stack.push_async_callback(lights.all_off)
            self._lights = lights
        return self._lights

    async def camera(self, name: CameraName) -> Camera:
        """Return a camera, connected.

        Raises
        ------
        DeviceError : the camera does not answer
        """
        if name not in self._cameras:
            camera = self._builder.camera(name)
            self._stack.push_async_callback(camera.close)
            await camera.connect()
            self._cameras[name] = camera
        return self._cameras[name]

    async def take_picture(self, camera: CameraName, lamps: Mapping[str, float]) -> Picture:
        """Set the lamps and return a picture that was exposed wholly after they had settled.

        Parameters
        ----------
        camera : ``overhead`` or ``inspection``
        lamps : level 0 to 1 by name; all others are dark

        Raises
        ------
        DeviceError : a lamp does not confirm, or no frame comes
        """
        cameras = {camera: await self.camera(camera)}
        imaging = Imaging(await self.lights(), cameras, frozenset(), Path())
        grey = await imaging.shoot(camera, lamps)
        return Picture(grey, build_camera(getattr(self.config.cameras, camera)))


@asynccontextmanager
async def open_cell(
    cell_file: FileName | None = None,
    *,
    parts: Sequence[FileName] = (),
    at: str | None = None,
    seed: int = 1,
    speed: float = 1.0,
) -> AsyncIterator[OpenCell]:
    """Open a cell and yield it; emulated devices start beside the script and end with it.

    Until it is closed, no other controller on this machine can use the cell. Nothing moves.

    Parameters
    ----------
    cell_file : cell file (default: the emulated cell)
    parts : CAD files of parts on the emulated table
    at : planar pose of the first of them, ``X,Y,THETA_DEG`` [mm, degrees] (default: by the seed)
    seed : seed of the emulated cell
    speed : speed of the emulated cell, in times real time; real devices keep real time

    Raises
    ------
    ConfigError : a file is wrong, or a driver is not installed
    CellBusyError : another controller has the cell
    EmulatorError : the emulated cell did not start
    """
    path = EMULATED_CELL if cell_file is None else Path(cell_file)
    config = load_cell(path)
    require_drivers(path, config)
    async with AsyncExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="cellctl-")))
        stack.enter_context(hold_cell(folder, config, "a Python script"))
        ready = {}
        if config.emulated_devices:
            is_mixed = find_clock(config, {}).is_mixed
            command = emulator_command(
                path,
                [Path(part) for part in parts],
                speed=1.0 if is_mixed else speed,
                seed=seed,
                more=emulator_args(None, at, None),
            )
            ready = stack.enter_context(emulated_cell(command, folder / "emulator.log"))
        clock = find_clock(config, ready).open()
        stack.callback(clock.close)
        builder = DeviceBuilder(config, resolve(config, ready.get("devices", {})), clock)
        async with clock.attending(), AsyncExitStack() as devices:
            devices.push_async_callback(_close_links, builder)
            yield OpenCell(config, builder, clock, devices)


async def _close_links(builder: DeviceBuilder) -> None:
    for link in builder.links:
        await link.aclose()


def shipped_file(name: str) -> Path:
    """Return a file that comes with cellctl, such as ``parts/holder.stl`` or ``holder.yaml``.

    Raises
    ------
    ConfigError : no file of this name
    """
    path = SHIPPED / name
    if not path.is_file():
        raise ConfigError(f"{name}: no such file comes with cellctl")
    return path


def recognise_picture(
    picture: Picture,
    parts: Sequence[FileName],
    lighting: Literal["backlit", "front", "auto"] = "auto",
) -> tuple[Sighting, ...]:
    """Return the objects on the table, largest first; () if it is empty.

    Parameters
    ----------
    picture : picture of the table
    parts : CAD files of the parts it may show; any other object has ``part`` None
    lighting : ``backlit`` for a light table, ``front`` for lamps above a matt one, ``auto`` to
        decide by the picture

    Raises
    ------
    CadError : a CAD file is wrong
    """
    files = [(Path(part), options_among(Path(part), None)) for part in parts]
    library = open_library(files, picture.camera)
    return recognise(picture.grey, picture.camera, library, lighting).sightings


def judge_pictures(view_set: FileName, *, recipe: FileName | None = None) -> PartInspection:
    """Return the verdict on the stored pictures of a part, as `cellctl inspect` gives it.

    Parameters
    ----------
    view_set : file of the form that docs/inspect.md describes, as a run writes it for each part
    recipe : recipe with the limits (default: the set's own, else a recipe's default limits)

    Raises
    ------
    ConfigError, CadError : a file is wrong, a picture is missing or damaged
    """
    path = Path(view_set)
    file = load_view_set(path)
    by = judging_of(path, file, None if recipe is None else Path(recipe))
    return judge_views(file, compiled_part(path, file), read_pictures(path, file), by)


def plan_part(
    part: FileName,
    *,
    recipe: FileName | None = None,
    cell_file: FileName | None = None,
    pose_index: int | None = None,
) -> Plan:
    """Return the plan to show a part that stands in the middle of the drop area.

    A new part takes seconds to minutes; its plan is kept in the cache.

    Parameters
    ----------
    part : CAD file
    recipe : recipe with density, grasp and views (default: a recipe's default figures)
    cell_file : cell file (default: the recipe's, else the emulated cell)
    pose_index : stable pose in which it stands (default: the most likely one)

    Raises
    ------
    ConfigError, CadError : a file is wrong
    NoPlanError : it cannot be grasped or shown from this pose
    """
    wanted = None if recipe is None else load_recipe(Path(recipe))
    beside = EMULATED_CELL if wanted is None else wanted.cell
    cell = load_cell(beside if cell_file is None else Path(cell_file))
    options = CompileOptions(unit=None if wanted is None else wanted.unit)
    compiled = load_part(Path(part), sampled_for(wanted, options))
    poses = {pose.index: pose for pose in compiled.poses}
    if not poses:
        raise NoPlanError(f"{compiled.solid.name} has no stable pose")
    if pose_index is None:
        pose_index = max(poses.values(), key=lambda pose: pose.probability).index
    if pose_index not in poses:
        raise ConfigError(
            f"{compiled.solid.name} has no stable pose {pose_index}; it has {sorted(poses)}"
        )
    setup = planner_setup(wanted, cell, compiled)
    certificate = (
        PlanCache(compiled, setup.layout, setup.options).certified(poses[pose_index]).certificate
    )
    if certificate.plan is None:
        raise NoPlanError(certificate.reason)
    return certificate.plan
