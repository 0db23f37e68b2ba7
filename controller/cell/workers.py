"""Heavy computation, run in worker processes so that the event loop is never held.

Every function takes plain data and a `Job`, from which a worker builds, once, what cannot travel
between processes (meshes with their ray casters, tables of sight lines).
"""

import ctypes
import os
import signal
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing import active_children, get_context
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from controller import inspection as inspecting
from controller import planning
from controller import recognition as recognising
from controller.cad import Solid, StablePose, SurfaceSamples
from controller.cad.compiled import (
    CompiledPart,
    CompileOptions,
    load_part,
    options_among,
)
from controller.config import Cell, Recipe, load_cell, load_recipe
from controller.imaging import Camera, RayCaster, inverse_pose
from controller.planning import (
    Box,
    Doubt,
    Motion,
    OnTable,
    Plan,
    PreparedPart,
    Reading,
    Start,
    plan_part,
)
from controller.planning.model import CellLayout
from controller.planning.motion import Scene, connect
from controller.recognition.stored import open_library
from controller.setup.faces import faces_left_out
from controller.setup.optics import build_lamps, panel_corners, table_corners
from controller.setup.planner import PlannerSetup, planner_setup

from . import slipped
from .plans import Planning

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

TABLE_LAMPS = ("table_ring", "table_side")
STATION_LAMPS = ("station_ring", "station_side")
PR_SET_PDEATHSIG = 1  # linux/prctl.h


@dataclass(frozen=True, slots=True)
class Job:
    """Which recipe on which cell; small enough to travel with every call."""

    recipe_path: Path
    cell_path: Path


@dataclass(frozen=True, eq=False, slots=True)
class Context:
    """What a worker keeps of a job."""

    recipe: Recipe
    cell: Cell
    setup: PlannerSetup
    part: CompiledPart
    caster: RayCaster
    overhead: Camera
    inspection: Camera
    library: recognising.Library
    glowing: NDArray[np.bool_]
    not_inspected: Mapping[int, str]

    @property
    def layout(self) -> CellLayout:
        """Return the cell as planning sees it."""
        return self.setup.layout

    @property
    def solid(self) -> Solid:
        """Return the recipe's part."""
        return self.part.solid

    @property
    def samples(self) -> SurfaceSamples:
        """Return the points its surface is counted by."""
        return self.part.samples

    @property
    def poses(self) -> tuple[StablePose, ...]:
        """Return the ways it may lie."""
        return self.part.poses


def make_pool() -> ProcessPoolExecutor:
    """Return the pool; fresh processes, since a fork would copy open devices into them.

    Its worker ends with this process, however that ends. To be used first from the main thread.
    """
    return ProcessPoolExecutor(
        max_workers=1,
        mp_context=get_context("spawn"),
        initializer=_belong_to,
        initargs=(os.getpid(),),
    )


@contextmanager
def worker_pool() -> Iterator[ProcessPoolExecutor]:
    """Yield the pool; what its worker is still at when it is no longer needed is thrown away."""
    pool = make_pool()
    try:
        yield pool
    finally:
        for child in active_children():
            child.terminate()
        pool.shutdown(cancel_futures=True)


def _belong_to(parent: int) -> None:
    """Tie a worker's life to its parent's, and leave the terminal's signals to that."""
    for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP, signal.SIGTSTP):
        signal.signal(number, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it has died before that
        os._exit(1)


@lru_cache(maxsize=2)
def context(job: Job) -> Context:
    """Return the job's context, built once per process.

    Raises
    ------
    ConfigError, CadError : recipe, cell or a CAD file is wrong
    """
    cv2.setNumThreads(1)  # two cores, and an emulated cell beside us
    recipe = load_recipe(job.recipe_path)
    cell = load_cell(job.cell_path)
    files = part_files(recipe)
    part = load_part(*files[0])
    setup = planner_setup(recipe, cell, part)
    layout = setup.layout
    return Context(
        recipe=recipe,
        cell=cell,
        setup=setup,
        part=part,
        caster=RayCaster(part.solid.mesh),
        overhead=layout.overhead,
        inspection=layout.inspection,
        library=open_library(files, layout.overhead),
        glowing=glowing_mask(layout.overhead, table_corners(cell)),
        not_inspected=faces_left_out(job.recipe_path, recipe, part.solid.faces),
    )


def load_parts(recipe: Recipe) -> list[CompiledPart]:
    """Return a recipe's part, then the others that may turn up.

    Raises
    ------
    CadError : a CAD file is wrong
    """
    return [load_part(path, options) for path, options in part_files(recipe)]


def part_files(recipe: Recipe) -> list[tuple[Path, CompileOptions]]:
    """Return the CAD files of a recipe's part and of the others, with their options."""
    return [
        (recipe.part, CompileOptions(unit=recipe.unit)),
        *((other, options_among(other, recipe.unit)) for other in recipe.others),
    ]


def glowing_mask(camera: Camera, corners_mm: Array) -> NDArray[np.bool_]:
    """Return where in the picture a glowing rectangle (4, 3) is, a few pixels shrunk."""
    width, height = camera.size_px
    mask = np.zeros((height, width), dtype=np.uint8)
    along = np.linspace(0, 1, 30, endpoint=False)
    edge = np.vstack(
        [
            corners_mm[i] + along[:, None] * (corners_mm[(i + 1) % 4] - corners_mm[i])
            for i in range(4)
        ]
    )
    cv2.fillPoly(mask, [np.round(camera.project(edge)).astype(np.int32)], 1)
    shrunk = cv2.erode(mask, np.ones((7, 7), np.uint8), borderValue=1) > 0
    return np.asarray(shrunk)


def recognise(job: Job, backlit: Grey, lit: Mapping[str, Grey]) -> tuple[recognising.Sighting, ...]:
    """Return what lies on the table."""
    c = context(job)
    pictures = [lit[lamp] for lamp in TABLE_LAMPS if lamp in lit]
    seen = recognising.recognise(
        backlit, c.overhead, c.library, "backlit", usable=c.glowing, lit=pictures
    )
    return seen.sightings


def prepare(job: Job) -> float:
    """Do all planning that does not depend on where the part lies; return its seconds."""
    started = time.monotonic()
    _prepared(job)
    return time.monotonic() - started


def plan(job: Job, pose_index: int, T_world_part: Array) -> Plan:
    """Return the plan for a part at rest.

    Raises
    ------
    NoPlanError : and why not
    """
    c = context(job)
    pose = next(p for p in c.poses if p.index == pose_index)
    return plan_part(c.solid, c.samples, pose, T_world_part, c.layout, prepared=_prepared(job))


def plan_from(
    job: Job,
    start: Start,
    seen: NDArray[np.bool_] | None,
    avoid: frozenset[str],
    candidates: tuple[recognising.Alternative, ...],
) -> Plan:
    """Return the plan from whoever has the part; see `experts.Experts.plan`.

    Raises
    ------
    NoPlanError : and why not
    """
    prepared, layout = _prepared(job), context(job).layout
    if isinstance(start, OnTable) and candidates:
        others = _readings(job, candidates)
        return planning.plan_in_doubt(prepared, layout, start, others, seen=seen, avoid=avoid)
    return planning.plan_from(prepared, layout, start, seen=seen, avoid=avoid)


def _readings(job: Job, candidates: tuple[recognising.Alternative, ...]) -> list[Reading]:
    """Return what else lies there, if it is that, with its solid."""
    c = context(job)
    solids = {part.solid.name: part.solid for part in load_parts(c.recipe)}
    solids[c.solid.name] = c.solid
    return [Reading(a.part, solids[a.part], a.T_world_part) for a in candidates]


def tell(
    job: Job, doubt: Doubt, q: Array, opening_mm: float, backlit: Grey, lit: tuple[Grey, ...]
) -> tuple[int, ...]:
    """Return which candidates of a doubt a view leaves; see `experts.Experts.tell`."""
    return planning.told(doubt, context(job).layout, q, opening_mm, backlit, lit).left


def way_home(
    job: Job, q: Array, hand_mm: float, fixture_mm: float, T_part_hand: Array | None
) -> Motion:
    """Return a way to the park position; see `experts.Experts.way_home`.

    Raises
    ------
    NoMotionError : no way free of contact
    """
    c = context(job)
    carried = None
    if T_part_hand is not None:
        low, high = c.solid.mesh.bounds
        box = Box.from_bounds(*np.column_stack([low, high]).ravel())
        carried = box.placed(inverse_pose(T_part_hand))
    scene = Scene(c.layout, hand_mm, fixture_mm, carried)
    return connect(q, c.layout.park_q, scene, f"{c.solid.name}: way home")


def share(job: Job, samples: NDArray[np.bool_]) -> float:
    """Return how much of the surface some samples (n,) stand for."""
    areas = context(job).samples.areas_mm2
    return float(areas[samples].sum() / areas.sum())


@lru_cache(maxsize=2)
def _prepared(job: Job) -> PreparedPart:
    c = context(job)
    return Planning(c.part, c.layout, c.setup.options).prepared()


def inspect(
    job: Job,
    view_id: str,
    T_world_part: Array,
    holder: tuple[inspecting.WorldBox, ...],
    backlit: Grey,
    lit: Mapping[str, Grey],
    is_hold_seen: bool,
) -> inspecting.ViewResult:
    """Judge one view."""
    c = context(job)
    task = inspecting.ViewTask(
        view_id=view_id,
        camera=c.inspection,
        T_world_part=T_world_part,
        holder=holder,
        panel_mm=panel_corners(c.cell, "station_backlight"),
        lamps=build_lamps(c.cell, tuple(lit)),
        limits=inspection_limits(c.recipe),
        is_hold_seen=is_hold_seen,
    )
    part = recognising.PosedPart(c.solid, c.caster)
    return inspecting.inspect_view(
        part, c.samples, task, inspecting.ViewPictures(backlit=backlit, lit=lit)
    )


def inspect_lying(
    job: Job, view_id: str, T_world_part: Array, glowing: Grey, lit: Mapping[str, Grey]
) -> inspecting.ViewResult:
    """Judge the pictures of the table as a view; nothing stands before the part there."""
    c = context(job)
    task = inspecting.ViewTask(
        view_id=view_id,
        camera=c.overhead,
        T_world_part=T_world_part,
        holder=(),
        panel_mm=table_corners(c.cell),
        lamps=build_lamps(c.cell, tuple(lit)),
        limits=inspection_limits(c.recipe),
        is_hold_seen=True,
    )
    part = recognising.PosedPart(c.solid, c.caster)
    return inspecting.inspect_view(
        part, c.samples, task, inspecting.ViewPictures(backlit=glowing, lit=lit)
    )


def find_hold(
    job: Job,
    T_world_part: Array,
    T_part_hand: Array,
    holder: tuple[inspecting.WorldBox, ...],
    backlit: Grey,
) -> Array | None:
    """Look for a held part about where it should be; see `_slipped.find_hold`."""
    c = context(job)
    task = inspecting.ViewTask(
        view_id="hold",
        camera=c.inspection,
        T_world_part=T_world_part,
        holder=holder,
        panel_mm=panel_corners(c.cell, "station_backlight"),
        lamps=(),
        limits=inspection_limits(c.recipe),
    )
    part = recognising.PosedPart(c.solid, c.caster)
    return slipped.find_hold(part, c.samples, task, T_part_hand, backlit)


def inspection_limits(recipe: Recipe) -> inspecting.Limits:
    """Return inspection's tolerances a recipe asks for."""
    return inspecting.Limits(smallest_defect_mm=recipe.inspection.smallest_defect_mm)


def judge(
    job: Job,
    views: tuple[inspecting.ViewResult, ...],
    unseen: Mapping[int, str],
    planned: Mapping[str, NDArray[np.bool_]],
) -> inspecting.PartVerdict:
    """Weigh all views of a part; see `experts.Experts.judge`."""
    c = context(job)
    return inspecting.judge(
        c.solid,
        c.samples,
        views,
        unseen,
        c.recipe.inspection.min_coverage,
        inspection_limits(c.recipe),
        c.not_inspected,
        planned,
    )
