"""One simulated cell, which outlives the controllers that are started on it.

Devices, world and control port are the emulated cell's; a controller is `run_batch` with the real
drivers, on a journal in the cell's folder. Both live on one loop, so that a seed repeats them.
"""

import asyncio
import os
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from controller.cell.batch import (
    OrderedRecipe,
    Outfit,
    RunOrder,
    RunResult,
    jobs_of,
    new_run_id,
    run_batch,
)
from controller.cell.compute import Compute, Job, context
from controller.cell.devices import Devices
from controller.cell.devices.build import DeviceBuilder
from controller.cell.devices.clocks import FoundClock
from controller.cell.journal import JOURNAL_NAME, Stamps
from controller.cell.operator import NOBODY, Operator
from controller.config import Cell as CellFile
from controller.config import load_cell, load_recipe
from controller.planning import resting_pose
from controller.setup.drivers import read_settings
from drivers.attendance import BEAT_WALL_S
from drivers.clock import CellClock
from drivers.kinds import Arm
from drivers.umi_scara import DRIVER, LinkConfig, UmiScara
from emulators.clock import WorldClock
from emulators.in_process import Cell, CellOptions
from emulators.world.ground_truth import truth

from .cameras import Plugs, TruthCamera
from .loop import SimulatedLoop, SimulatedProcess
from .stand_ins import Noise, StandIns, turned_about
from .wires import ArmLine

Array = NDArray[np.float64]

ROOT: Final = Path(__file__).parents[1]
CELL_FILE: Final = ROOT / "recipes" / "cells" / "emulated.yaml"
STATE_HOME: Final = "XDG_STATE_HOME"  # folder in which a controller notes its journal
TAKES_S: Final = {  # cell time that the worker takes for a question, from and to [s]
    "prepare": (0.5, 3.0),
    "plan": (0.3, 4.0),
    "recognise": (0.3, 1.5),
    "inspect": (0.5, 3.0),
    "judge": (0.5, 3.0),
}
# Reading the inputs is a third of all that a simulated cell does; half as often will do here.
TIMING: Final = "\ntiming: {io_poll_s: 0.08, io_stale_s: 0.4}\n"
BEAT_S: Final = 2.0  # a loop on virtual time is never late: every timer is run at its instant
BEGAN: Final = datetime(2030, 1, 1, tzinfo=UTC)  # date of every simulation, so that rows repeat
PLACES: Final = ((360.0, 0.0, 0.5), (330.0, 40.0, -1.0), (390.0, -45.0, 2.2))  # x, y [mm], theta


@dataclass(frozen=True, slots=True)
class Scene:
    """The parts on the table.

    Attributes
    ----------
    recipe : name of a recipe of the project
    pose_index : stable pose of the part
    place : number in `PLACES`
    beside : the part of another recipe, which the same run is to take; None for none
    watchdog_s : time of a watchdog in the motors' supply; None for none [s]
    may_be_late : controllers may be stopped for a while, and look often for that
    outputs : 24 V signals that are wired to the I/O block, in the order of its outputs
    """

    recipe: str = "holder"
    pose_index: int = 0
    place: int = 0
    beside: "Scene | None" = None
    watchdog_s: float | None = None
    may_be_late: bool = False
    outputs: tuple[str, ...] = ()

    @property
    def each(self) -> "tuple[Scene, ...]":
        """The scene of each recipe, this one first."""
        return (self, *(() if self.beside is None else self.beside.each))


class SimulatedCell:
    """The cell; use it as an async context manager on a `SimulatedLoop`.

    Parameters
    ----------
    loop : loop that it lives on
    seed : seed of the world and of all noise
    scene : parts on the table
    folder : for the journal and the files of runs
    as_built : seed of how it differs from its file; None: it stands as drawn

    Attributes
    ----------
    cell : the emulated cell
    after_slice : called after each slice of the world
    operator : person who decides where controllers cannot
    """

    def __init__(
        self,
        loop: SimulatedLoop,
        seed: int,
        scene: Scene,
        folder: Path,
        as_built: int | None = None,
    ) -> None:
        self.loop = loop
        self.as_built = as_built
        self.seed = seed
        self.scene = scene
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        paths = [ROOT / "recipes" / f"{one.recipe}.yaml" for one in scene.each]
        self.ordered = tuple(OrderedRecipe(path, load_recipe(path), 1) for path in paths)
        self.jobs = jobs_of(self.ordered, CELL_FILE)
        self.contexts = tuple(context(job) for job in self.jobs)
        self.recipe_path, self.recipe = paths[0], self.ordered[0].recipe
        self.job, self.context = self.jobs[0], self.contexts[0]
        self.plugs = Plugs()
        self.process = SimulatedProcess("cell")
        self.after_slice: Callable[[], None] = lambda: None
        self.controller_count = 0
        self.operator: Operator = NOBODY
        self._rng = np.random.default_rng([seed, 1])
        self._made: list[Controller] = []
        self._state_home = os.environ.get(STATE_HOME)

    @property
    def journal_path(self) -> Path:
        """The cell's journal."""
        return self.folder / JOURNAL_NAME

    def now_s(self) -> float:
        """Return the cell's time [s]."""
        return self.cell.clock.now_s()

    async def __aenter__(self) -> "SimulatedCell":
        await self.loop.spawn(self.process, self._start())
        self.loop.spawn(self.process, self._step())
        return self

    async def __aexit__(self, *_: object) -> None:
        self.loop.kill(self.process)

    def close(self) -> None:
        """Release the world's resources; nothing of it can be read any more."""
        if self._state_home is None:
            os.environ.pop(STATE_HOME, None)
        else:
            os.environ[STATE_HOME] = self._state_home
        self.cell.world.close()

    async def _start(self) -> None:
        meshes = []
        for one in self.contexts:
            meshes.append(self.folder / f"{one.solid.name}.stl")
            one.solid.mesh.export(meshes[-1])
        drawn = self.folder / "drawn.yaml"
        drawn.write_text(self._drawn_text(), encoding="utf-8")
        options = CellOptions(
            cell=drawn,
            parts=tuple(meshes),
            is_empty=True,
            seed=self.seed,
            as_built=self.as_built,
            surfaces="plain",
        )
        clock = WorldClock(monotonic=self.loop.time)
        self.cell = Cell(options, self.folder, clock)
        self._lay()
        await self.cell.start_in_process(self.plugs)
        self.plugs.cameras = self.cell.cameras
        self.arm_line = ArmLine(self.cell.rtx.wire, self.loop, clock.now_s)
        self.arm_line.before_request = self.catch_up
        self.cell_path = self.folder / "cell.yaml"
        self.cell_path.write_text(self._cell_text(), encoding="utf-8")
        self.cell_file = load_cell(self.cell_path)

    def _drawn_text(self) -> str:
        text = CELL_FILE.read_text(encoding="utf-8")
        if self.scene.outputs:
            wired = ", ".join(f"{name}: {n}" for n, name in enumerate(self.scene.outputs))
            text += f"\noutputs: {{{wired}}}\n"
        if self.scene.watchdog_s is None:
            return text
        settings = f"{{motor_relay: 0, watchdog_s: {self.scene.watchdog_s:g}}}"
        head, _, rest = text.partition("  io:")
        return f"{head}  io:{rest.replace('}', f', settings: {settings}}}', 1)}"

    def _cell_text(self) -> str:
        text = self._drawn_text()
        lines = {
            "gripper": self.cell.gripper_line,
            "lights": self.cell.lights_line,
            "io": self.cell.io_line,
        }
        where = {name: "{}:{}".format(*line.address) for name, line in lines.items()}  # type: ignore[union-attr]  # TCP all of them
        where |= {name: f"simulated-{name}" for name in ("arm", "overhead", "inspection")}
        for name, address in where.items():
            head, _, rest = text.partition(f"  {name}:")
            text = f"{head}  {name}:{rest.replace('address: emulated', f'address: {address}', 1)}"
        return text + TIMING

    # --- the world ------------------------------------------------------------------------------

    def planned_poses(self, number: int = 0) -> tuple[Array, ...]:
        """Return the poses (4, 4) of which plans are kept, of a part by its number."""
        return (self._place(number),)

    def _place(self, number: int) -> Array:
        scene, known = self.scene.each[number], self.contexts[number]
        pose = next(p for p in known.poses if p.index == scene.pose_index)
        return resting_pose(known.solid, pose, *PLACES[scene.place % len(PLACES)])

    def _lay(self) -> None:
        """Lay each part down near its scene's place, as far off as recognition is."""
        for number, known in enumerate(self.contexts):
            T = self._place(number)
            centre = (T @ [*known.solid.centroid_mm, 1.0])[:3]
            noise = Noise()
            T = turned_about(T, centre, float(self._rng.normal(0.0, noise.turn_rad / 2)))
            T[:2, 3] += self._rng.normal(0.0, noise.place_mm / 2, 2)
            T[2, 3] += 0.5
            self.cell.world.place(number, T)
            self.cell.world.settle()

    def befall(self, verb: str, /, **order: Any) -> dict[str, Any]:  # noqa: ANN401  (verbs check)
        """Carry out a verb of docs/emulator-faults.md now; return its answer.

        Raises
        ------
        KeyError, TypeError, ValueError, IndexError, AttributeError : it makes no sense now
        """
        return self.cell.faults.do(verb, **order)

    def truth(self) -> dict[str, Any]:
        """Return the true state of the world."""
        return truth(self.cell.world)

    def catch_up(self) -> None:
        """Let the world come up to the present instant, in whole slices."""
        while self.cell.behind_s >= self.cell.step_s - 1e-9:
            self.cell.advance()
            self.after_slice()

    async def _step(self) -> None:
        while True:
            self.catch_up()
            await asyncio.sleep(self.cell.step_s)

    # --- controllers ----------------------------------------------------------------------------

    def controller(self, **options: Any) -> "Controller":  # noqa: ANN401  (of `RunOrder`)
        """Return a controller that is not started yet.

        Parameters
        ----------
        options : fields of `RunOrder` that differ from a plain run of one part
        """
        self.controller_count += 1
        made = Controller(self, self.controller_count, options)
        self._made.append(made)
        return made


class Controller:
    """One controller: a process that runs one batch, or is killed.

    Attributes
    ----------
    process : everything that it starts
    task : the batch, once started
    state : state of the cell, as the operator sees it
    notices : sentences for the operator
    row_count : rows it has written to the journal
    on_state : called with each state that the cell enters
    """

    def __init__(self, cell: SimulatedCell, number: int, options: Mapping[str, Any]) -> None:
        self.cell = cell
        self.number = number
        self.process = SimulatedProcess(f"controller {number}")
        self.notices: list[str] = []
        self.state = ""
        self.on_state: Callable[[str], None] = lambda state: None
        self.minds: StandIns | None = None
        self._all_minds: list[StandIns] = []
        self.dispatcher: Any = None
        self.row_count = -1  # the run's name takes the date once
        self._options = options
        self.task: asyncio.Task[RunResult]
        beat_s = BEAT_WALL_S if cell.scene.may_be_late else BEAT_S
        clock = FoundClock(monotonic=cell.loop.time, beat_wall_s=beat_s)
        stamps = self._stamps = Stamps(self._utc, cell.loop.time)
        self._order = replace(
            RunOrder(
                recipe_path=cell.recipe_path,
                cell_path=cell.cell_path,
                recipe=cell.recipe,
                cell=cell.cell_file,
                count=1,
                speed=1.0,
                emulated={},
                clock=clock,
                runs_dir=cell.folder,
                run_id=new_run_id(cell.recipe, stamps),
                beside=cell.ordered[1:],
            ),
            **options,
        )

    @property
    def run_id(self) -> str:
        """Name of the run."""
        return self._order.run_id

    def _utc(self) -> datetime:
        if not self.process.is_alive:
            raise OSError("the controller was killed")  # its journal takes no row without a date
        self.row_count += 1  # the date is asked for once a row
        return BEGAN + timedelta(seconds=self.cell.loop.time())

    def start(self) -> "asyncio.Task[RunResult]":
        """Start it; return the batch."""
        # notes of journals are the cell's: a simulated cell is nobody else's
        os.environ[STATE_HOME] = str(self.cell.folder / "state")
        outfit = Outfit(
            compute=self._compute,
            devices=self._devices,
            stamps=self._stamps,
        )
        work = run_batch(
            self._order,
            cast(Executor, None),  # the loop does all work here
            lambda progress: self._show(progress.state),
            self._on_dispatcher,
            self.notices.append,
            outfit,
            self.cell.operator,
        )
        self.task = self.cell.loop.spawn(self.process, work)
        return self.task

    def hold_up(self, duration_s: float) -> None:
        """Give it no turn for so long, as SIGSTOP or a pause of the collector does."""
        self.cell.loop.hold_up(self.process, duration_s)

    def kill(self) -> None:
        """End it where it stands, as SIGKILL does."""
        self.cell.loop.kill(self.process)

    def _show(self, state: str) -> None:
        if state != self.state:
            self.state = state
            self.on_state(state)

    def _on_dispatcher(self, dispatcher: Any) -> None:  # noqa: ANN401
        self.dispatcher = dispatcher

    def _compute(self, job: Job, pool: Executor) -> Compute:
        cell = self.cell
        rng = np.random.default_rng([cell.seed, 2, self.number])
        # the cell's own job: where its devices answer is nothing that a plan depends on
        paths = [one.recipe_path for one in cell.jobs]
        number = paths.index(job.recipe_path)
        planned = cell.planned_poses(number) if len(paths) == 1 else ()
        made = StandIns(cell.jobs[number], pool, Noise(), rng, planned, TAKES_S, number)
        self._all_minds.append(made)
        for one in self._all_minds:
            one.beside = tuple(other for other in self._all_minds if other is not one)
        self.minds = self.minds or made
        return made

    def _devices(
        self, cell_file: CellFile, where: Mapping[str, dict[str, Any]], clock: CellClock
    ) -> Devices:
        cell = self.cell
        settings = read_settings(DRIVER, cell_file.devices.arm.settings, "devices.arm")
        config = settings.config(LinkConfig().silence_s)
        builder = DeviceBuilder(cell_file, where, clock)
        devices = Devices(
            arm=cast(Arm, UmiScara(cell.arm_line.open, config=config, clock=clock)),
            gripper=builder.gripper(),
            lights=builder.lights(),
            io=builder.io(),
            overhead=TruthCamera("overhead", cell.cell, clock),
            inspection=TruthCamera("inspection", cell.cell, clock),
        )
        devices.links = builder.links
        return devices
