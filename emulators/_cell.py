"""All devices of one emulated cell, the world behind them, and their addresses."""

import logging
import math
import os
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from emulators.added import AddedParts
from emulators.arms import RtxArm, make_arm
from emulators.as_built import as_drawn, draw_as_built
from emulators.cameras import Cameras
from emulators.clock import SharedClock, WorldClock
from emulators.codes import codes_of
from emulators.faults import CameraPlugs, SupplyChange, Verbs
from emulators.gripper_modbus import RobotiqDevice
from emulators.gripper_onrobot import RgDevice
from emulators.grippers import make_fixed_gripper
from emulators.io_blocks import make_io_block
from emulators.io_modbus import CellSignals
from emulators.lamp_units import ANALOG_UNIT, RELAY_UNIT, make_lamp_unit
from emulators.lighting_modbus import LampModel, LampWiring
from emulators.modbus import (
    Bus,
    RtuOverTcpServer,
    RtuPtyServer,
    Steppable,
    TcpGateway,
    TcpServer,
)
from emulators.reaping import reap
from emulators.tcp_listener import TcpListener
from emulators.world import (
    MAX_REST_OFF_RAD,
    PictureDesk,
    Rest,
    World,
    build_scene,
    coded,
    load_solid,
    part_surface,
    read_layout,
    tray_of,
)
from emulators.world import LayoutError as LayoutError
from emulators.world.matter.parts import AWAY, HELD, RESTING
from emulators.world.poses import transform

log = logging.getLogger(__name__)

STEP_S: Final = 1.0 / 240.0
SLICE_STEPS: Final = 4  # the world's longest step
IO_UNIT: Final = 1
GRIPPER_BAUD: Final = 115_200
LIGHTS_BAUD: Final = 9_600  # factory setting of the light modules
PICTURE_S: Final = 0.1  # longest time from exposure to buffer
DROP_TRY_COUNT: Final = 200
FEED_STREAM: Final = 7  # number of a random stream, apart from the world's
APART_MM: Final = 2.0  # least distance between the bounds of dropped parts
SUPPLY_CHANGES_KEPT: Final = 1000
_PRESENCE_S: Final = 0.05  # period of looks at the fixed gripper's light barrier

Line = TcpGateway | RtuOverTcpServer | RtuPtyServer | TcpServer


@dataclass(frozen=True, slots=True, kw_only=True)
class CellOptions:
    """The options of the emulated cell.

    Attributes
    ----------
    rest : number in each part's own ``rests``, None for a likely one at random
    orientation : (3, 3) CAD -> upright, of the first part at rest; None to take ``rest``
    at : x, y [mm] and turn [rad] of the first part, None for anywhere
    feed : number of times that each part is put back once one is in a tray, as if someone emptied
        the tray and brought the next part of a kind that the seed draws; 0 for further parts
    on_table : parts on the table at a time, the others wait; None for all
    as_built : seed of how the cell differs from its file; None for not at all
    code : code on each part, as ``KIND:TEXT``; final digits count up with each one that is brought;
        empty for none
    surfaces : surfaces of parts in pictures; None for machined where the cell is as built, else
        plain
    is_on_wall_clock : time waits neither for clients nor for pictures, as in a real cell
    """

    cell: Path
    parts: tuple[Path, ...] = ()
    is_empty: bool = False
    seed: int = 0
    speed: float = 1.0
    rest: int | None = None
    orientation: NDArray[np.float64] | None = None
    at: tuple[float, float, float] | None = None
    lines: Literal["tcp", "rtu-pty", "rtu-tcp"] = "tcp"
    camera_transport: Literal["auto", "fuse", "socket"] = "auto"
    feed: tuple[int, ...] = ()
    on_table: int | None = None
    as_built: int | None = None
    surfaces: Literal["plain", "machined"] | None = None
    is_on_wall_clock: bool = False
    code: str = ""

    @property
    def finish_seed(self) -> int | None:
        """The seed of the marks on machined surfaces; None if they are plain."""
        if (self.surfaces or ("plain" if self.as_built is None else "machined")) == "plain":
            return None
        return self.seed if self.as_built is None else self.as_built


class _FixedJaws:
    """The fixed gripper for the world: its firmware moves the jaws."""

    def __init__(self, device: RobotiqDevice | RgDevice) -> None:
        self._device = device

    @property
    def opening_mm(self) -> float:
        return self._device.jaws.opening_mm

    @property
    def grasp_limit_mm(self) -> float | None:
        return self._device.jaws.grasp_limit_mm

    @grasp_limit_mm.setter
    def grasp_limit_mm(self, limit_mm: float | None) -> None:
        self._device.jaws.grasp_limit_mm = limit_mm

    def advance(self, dt_s: float) -> None:
        self._device.advance(dt_s)


class Cell:
    """One emulated cell: `start`, then `advance` whenever `behind_s` says so, `aclose`.

    Parameters
    ----------
    options : options of the emulated cell
    folder : for what its wires need on the disk
    clock : world time, where that is not to be shared with other processes

    Raises
    ------
    LayoutError : the cell file or a part cannot be used
    """

    step_s: Final = STEP_S * SLICE_STEPS

    def __init__(self, options: CellOptions, folder: Path, clock: WorldClock | None = None) -> None:
        self.options = options
        drawn, seed = read_layout(options.cell), options.as_built
        self.as_built = as_drawn(drawn) if seed is None else draw_as_built(drawn, seed)
        self.layout = self.as_built.layout
        oversize_mm = self.as_built.oversize_mm
        self.solids = [load_solid(path, oversize_mm=oversize_mm) for path in options.parts]
        self._presence_s = 0.0
        self._feed_left = [*options.feed, *[0] * len(options.parts)][: len(options.parts)]
        self._feed_rng = np.random.default_rng([options.seed, FEED_STREAM])
        seed = options.seed
        self.arm_unit = make_arm(drawn.arm.shape, self.as_built.arm, seed)
        self.arm = self.arm_unit.body
        self._fixed = make_fixed_gripper(
            self.layout.drivers.get("gripper"), self.as_built.fixed_jaws
        )
        self.jaws, self.gripper = self._fixed.jaws, self._fixed.device
        self._lamp_unit = make_lamp_unit(self.layout.drivers.get("lights"))
        self.lamp_modules = self._lamp_unit.modules
        self.lamps = {
            name: LampModel(
                LampWiring(name, lamp.analog, lamp.relay),
                self._lamp_unit.supply,
                self.as_built.lamps[name],
            )
            for name, lamp in self.layout.lamps.items()
        }
        self.signals = CellSignals()
        self.io = make_io_block(
            self.layout.drivers.get("io"),
            self.signals,
            IO_UNIT,
            self.layout.inputs,
            self.layout.outputs,
        )
        self.gripper_bus = Bus(self._fixed.on_line)
        self.lights_bus = Bus([*self.lamp_modules.values()])
        self.io_bus = Bus([self.io])
        self.networks: dict[str, TcpListener] = {}
        self._steppable: list[Steppable] = [*self._lamp_unit.steppable, self.io]
        self._steppable += list(self.lamps.values())
        jaws = _FixedJaws(self.gripper)
        obstruct = self.arm_unit.obstruct
        self.world = World(self.layout, self.solids, self.arm, jaws, obstruct, seed)
        self._drop_parts(options)
        scene = build_scene(self.layout, self.solids, options.finish_seed)
        self.desk = PictureDesk(scene, self, seed, reap)
        self._codes = codes_of(options.code)
        for index in range(len(self.solids)):
            self._mark(index)
        self.added = AddedParts(self.world, self.desk)
        self._shared_clock: SharedClock | None = None
        if clock is None:
            self._shared_clock = SharedClock(options.speed, waits=not options.is_on_wall_clock)
        self.clock: WorldClock = self._shared_clock or clock or WorldClock()
        self._cameras = Cameras(
            self.layout.cameras, self.layout.drivers, self.desk, self.clock, options.seed
        )
        self.cameras = self._cameras.devices
        self.camera_plugs: CameraPlugs = self._cameras
        self._folder = folder
        self._supply_changes: deque[SupplyChange] = deque(maxlen=SUPPLY_CHANGES_KEPT)
        self.faults = Verbs(self)
        self._open: list[Any] = []

    @property
    def rtx(self) -> RtxArm:
        """Its UMI RTX.

        Raises
        ------
        ValueError : this cell has another arm
        """
        if not isinstance(self.arm_unit, RtxArm):
            raise ValueError("the arm of this cell is no UMI RTX")
        return self.arm_unit

    def _drop_parts(self, options: CellOptions) -> None:
        if options.is_empty:
            return
        waiting = self._drawn_to_wait()
        for index, solid in enumerate(self.solids):
            if options.rest is not None and not 0 <= options.rest < len(solid.rests):
                raise LayoutError(
                    f"--pose {options.rest}: {solid.name} has the numbers 0 to "
                    f"{len(solid.rests) - 1}"
                )
            if index in waiting:
                self._feed_left[index] += 1
                self.world.remove(index)
                continue
            is_first = index == 0
            x_mm, y_mm, theta_rad = options.at if options.at and is_first else (None,) * 3
            rest: int | Rest | None = options.rest
            if is_first and options.orientation is not None:
                rest = solid.rolled(
                    solid.rest_near(options.orientation), float(self._feed_rng.random())
                )
            T_world_part = self.world.draw(index, x_mm, y_mm, rest, theta_rad)
            if not is_first:
                T_world_part = self._kept_apart(index, T_world_part)
            self.world.place(index, T_world_part)
            self.world.settle()
            if isinstance(rest, Rest):
                self._require_kept(index, rest)

    def _drawn_to_wait(self) -> set[int]:
        """Return the parts not on the table yet; the first part is on it if it has a pose."""
        count = len(self.solids)
        over = 0 if self.options.on_table is None else max(count - self.options.on_table, 0)
        has_pose = self.options.at is not None or self.options.orientation is not None
        may_wait = np.arange(1 if has_pose else 0, count)
        return {int(k) for k in self._feed_rng.permutation(may_wait)[:over]}

    def _require_kept(self, index: int, rest: Rest) -> None:
        """Raise LayoutError if a part put down in a stable pose has tipped out of it."""
        part = self.world.parts[index]
        up = -part.T_world_part[2, :3]
        off_rad = min(
            math.acos(max(-1.0, min(1.0, float(up @ one.down))))
            for one in part.solid.curve_of(rest)
        )
        if off_rad > MAX_REST_OFF_RAD:
            raise LayoutError(
                f"{part.solid.name} does not stay in this stable pose on the emulated table: it "
                f"tips or rolls by {math.degrees(off_rad):.0f} deg; name another with --pose"
            )

    def _kept_apart(self, index: int, T_world_part: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a pose (4, 4) in which a part falls on no other one; redrawn until it does."""
        solid = self.world.parts[index].solid
        others = [
            part.bounds_mm
            for part in self.world.parts
            if part.index != index and part.state not in (AWAY, HELD)
        ]
        for _ in range(DROP_TRY_COUNT):
            corners = transform(T_world_part, solid.hull_mm)[:, :2]
            low, high = corners.min(axis=0) - APART_MM, corners.max(axis=0) + APART_MM
            if all((low > h[:2]).any() or (high < o[:2]).any() for o, h in others):
                break
            T_world_part = self.world.draw(index, rest=self.options.rest)
        return T_world_part

    def knock_camera(self, name: str, T: NDArray[np.float64]) -> None:
        """Move a camera by T (4, 4) in its own frame [mm].

        Raises
        ------
        KeyError : there is none of this name
        """
        numbers = {one: number for number, one in enumerate(self.layout.cameras)}
        self.desk.move_camera(numbers[name], T)

    # --- wires ----------------------------------------------------------------------------------

    async def start(self) -> None:
        """Open all wires and start the picture process."""
        self.desk.start()
        # the clock starts once the slow work is done and the parts are at rest
        if self._shared_clock is not None:
            self._shared_clock.begin()
        self._open.append(self.arm_unit)
        await self.arm_unit.start(self.clock)
        await self._start_lines()
        self._open.append(self._cameras)
        await self._cameras.start(self._folder / "cameras", self.options.camera_transport)

    async def start_in_process(self, camera_plugs: CameraPlugs) -> None:
        """Open the Modbus lines alone; arm and cameras are reached by their models.

        Parameters
        ----------
        camera_plugs : plugs in place of the cameras' wires
        """
        await self._start_lines()
        self.camera_plugs = camera_plugs

    async def _start_lines(self) -> None:
        self._origin_s = self.world.time_s
        self.gripper_line: Line = (
            TcpServer(self.gripper_bus, self.clock)
            if self._fixed.has_network
            else self._line(self.gripper_bus, GRIPPER_BAUD)
        )
        self.lights_line = self._line(self.lights_bus, LIGHTS_BAUD)
        self.io_line = TcpServer(self.io_bus, self.clock)
        lines = {"gripper": self.gripper_line, "lights": self.lights_line, "io": self.io_line}
        self.networks = {
            name: line for name, line in lines.items() if isinstance(line, TcpListener)
        }
        for server in (self.gripper_line, self.lights_line, self.io_line):
            await server.start()
            self._open.append(server)

    def _line(self, bus: Bus, baudrate: int) -> Line:
        if self.options.lines == "rtu-pty":
            return RtuPtyServer(bus, self.clock, baudrate)
        if self.options.lines == "rtu-tcp":
            return RtuOverTcpServer(bus, self.clock, baudrate=baudrate)
        return TcpGateway(bus, self.clock, baudrate=baudrate)

    async def run_cameras(self) -> None:
        """Let the cameras take frames, until cancelled."""
        await self._cameras.run()

    async def aclose(self) -> None:
        """Close all wires, end the picture process; may be called half-way through `start`."""
        for server in reversed(self._open):
            await server.aclose()
        self._open.clear()
        self.desk.close()
        self.world.close()
        if self._shared_clock is not None:
            self._shared_clock.close()

    def announcement(self) -> dict[str, Any]:
        """Return the addresses and settings that clients need."""
        host, port = self.io_line.address
        lights = self._where(self.lights_line)
        return {
            "event": "ready",
            "speed": self.options.speed,
            "wall_clock": self.options.is_on_wall_clock,
            "seed": self.options.seed,
            "as_drawn": self.options.as_built is None,
            "devices": {
                "arm": self.arm_unit.address,
                "gripper": {**self._where(self.gripper_line), "unit": self.gripper.unit},
                "lights": {**lights, "analog_unit": ANALOG_UNIT, "relay_unit": RELAY_UNIT},
                "io": {"transport": "tcp", "host": host, "port": port, "unit": IO_UNIT},
                **self._cameras.addresses,
            },
            "camera_transport": self._cameras.transport,
            "why_not_fuse": self._cameras.why_not_fuse,
            "pid": os.getpid(),
            "started_wall_s": self.clock.started_wall_s,
            "clock": str(self._shared_clock.path if self._shared_clock else ""),
        }

    def _where(self, line: Line) -> dict[str, Any]:
        if isinstance(line, RtuPtyServer):
            return {"transport": "rtu-pty", "path": line.path}
        host, port = line.address
        transport = "rtu-tcp" if isinstance(line, RtuOverTcpServer) else "tcp"
        return {"transport": transport, "host": host, "port": port}

    # --- time -----------------------------------------------------------------------------------

    @property
    def now_s(self) -> float:
        """World time on the clock's scale, up to which everything has been advanced."""
        return self.world.time_s - self._origin_s

    @property
    def behind_s(self) -> float:
        """The world's delay behind the clock [world s]."""
        return self.clock.now_s() - self.now_s

    def advance(self) -> None:
        """Let one slice of time pass for everything, and send off the pictures that fall due."""
        dt_s = self.step_s
        self.world.advance(dt_s)
        for device in self._steppable:
            device.advance(dt_s)
        self._pass_supply()
        self.faults.advance()
        self._presence_s += dt_s
        if self._presence_s >= _PRESENCE_S:
            self._presence_s = 0.0
            self.signals.is_part_between_jaws = self.world.is_part_in_fixed_gripper
            self._feed()
            if len(self.world.parts) > 1:
                self._empty_trays()
        self.desk.note(self.now_s)

    def _pass_supply(self) -> None:
        """Switch the motors' supply by the I/O block's relay."""
        self.arm.switch_supply("I/O block", self.io.passes_motor_supply)
        on, noted = self.arm.has_supply, self._supply_changes
        if on != (noted[-1].on if noted else True):
            noted.append(SupplyChange(self.now_s, on))

    def _feed(self) -> None:
        """Drop the next part, drawn by the seed, once one is in a tray and has been let go."""
        if not any(self._feed_left):
            return
        gone = [
            part.index
            for part in self.world.parts
            if part.state == AWAY or tray_of(self.world, part.index) is not None
        ]
        # parts and boards that a person has added are nobody's to bring again
        own = len(self._feed_left)
        waiting = [index for index in gone if index < own and self._feed_left[index] > 0]
        at_work = len(self.world.parts) - len(gone)
        room = len(self.world.parts) if self.options.on_table is None else self.options.on_table
        if waiting and at_work < room:
            index = int(self._feed_rng.choice(waiting))
            self._feed_left[index] -= 1
            self._mark(index)
            self.world.place(index, self._kept_apart(index, self.world.draw(index)))

    def _mark(self, index: int) -> None:
        """Put the next code on a part, where parts have one: what is brought again is another."""
        if self._codes is not None:
            plain = part_surface(f"part {index}", self.solids[index])
            self.desk.add(coded(plain, self._codes.next()))

    def _empty_trays(self) -> None:
        """Empty a tray without nests once the arm holds another part."""
        if self.world.arm_gripper.hold is None:
            return
        kept = {tray.name for tray in self.layout.trays if tray.has_nests}
        for part in self.world.parts:
            tray = tray_of(self.world, part.index)
            if part.state == RESTING and tray is not None and tray not in kept:
                self.world.empty(part.index, tray)

    @property
    def supply_changes(self) -> tuple[SupplyChange, ...]:
        """The last times at which the arm's motors lost their supply or got it back."""
        return tuple(self._supply_changes)

    def tick(self) -> None:
        """Let the clock run on, up to the world's time, and not past an overdue picture."""
        if self._shared_clock is not None:
            self._shared_clock.tick(self.now_s, self._picture_due_s(self._shared_clock))

    def _picture_due_s(self, clock: SharedClock) -> float | None:
        if clock.participant_count == 0:
            return None  # a client that only watches a camera does not hold the cell up
        ends = [camera.oldest_due_s for camera in self.cameras.values()]
        due = [end_s + PICTURE_S for end_s in ends if end_s is not None]
        return min(due, default=None)

    def timing(self) -> dict[str, Any]:
        """Return the world's time, and the losses."""
        return {
            "world_s": self.now_s,
            "behind_s": self.behind_s,
            "speed": self.clock.speed,
            "lost_frames": {name: one.lost_count for name, one in self.cameras.items()},
            "worker_pid": self.desk.worker_pid,
        }

    # --- what pictures show ----------------------------------------------------------------------

    def poses(self) -> dict[str, Any]:
        """Return the poses of all that moves."""
        return self.world.snapshot().poses

    def levels(self) -> dict[int, float]:
        """Return the light of each lamp, by number."""
        return {number: lamp.level for number, lamp in enumerate(self.lamps.values())}
