"""A worker's data for a job: too large to send between processes, built once from files."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from controller import inspection as inspecting
from controller import recognition as recognising
from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid, StablePose, SurfaceSamples
from controller.cad.compiled import (
    CompiledPart,
    CompileOptions,
    load_part,
    options_among,
    part_name,
)
from controller.config import Cell, ConfigError, Recipe, load_cell, load_recipe
from controller.imaging import Camera
from controller.imaging.codes import can_read_codes
from controller.planning.model import CellLayout
from controller.recognition.stored import open_library
from controller.setup.faces import faces_left_out
from controller.setup.optics import table_corners
from controller.setup.planner import PlannerSetup, planner_setup
from controller.setup.samples import sampled_for
from controller.stored import learned_for

MAX_RECIPE_COUNT: Final = 16  # recipes of a batch; a worker keeps the parts of all of them


@dataclass(frozen=True, slots=True)
class Job:
    """The recipe and cell of a job; small enough to be sent with every call.

    Attributes
    ----------
    batch : all recipes of a batch of several, in its order; empty if the recipe is alone
    """

    recipe_path: Path
    cell_path: Path
    batch: tuple[Path, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Context:
    """A worker's data for a job.

    Attributes
    ----------
    files : CAD files of all parts that are known, in the order of the library
    wanted : names of the parts that the batch is to take, the recipe's among them
    """

    recipe: Recipe
    cell: Cell
    setup: PlannerSetup
    part: CompiledPart
    posed: inspecting.PosedPart
    library: recognising.Library
    glowing: BoolArray
    not_inspected: Mapping[int, str]
    files: tuple[tuple[Path, CompileOptions], ...]
    wanted: tuple[str, ...]

    @property
    def layout(self) -> CellLayout:
        """The cell in the planner's terms."""
        return self.setup.layout

    @property
    def overhead(self) -> Camera:
        """The camera over the table."""
        return self.layout.overhead

    @property
    def inspection(self) -> Camera:
        """The camera of the station."""
        return self.layout.inspection

    @property
    def solid(self) -> Solid:
        """The recipe's part."""
        return self.part.solid

    @property
    def samples(self) -> SurfaceSamples:
        """The sample points that measure the part's surface."""
        return self.part.samples

    @property
    def poses(self) -> tuple[StablePose, ...]:
        """The part's stable poses."""
        return self.part.poses


@lru_cache(maxsize=MAX_RECIPE_COUNT)
def context(job: Job) -> Context:
    """Return the job's context, built once per process.

    Raises
    ------
    ConfigError, CadError : recipe, cell or a CAD file is wrong
    """
    recipe = load_recipe(job.recipe_path)
    cell = load_cell(job.cell_path)
    if recipe.serial_code is not None and not can_read_codes():
        raise ConfigError(
            f"{job.recipe_path}: `serial_code`: zxing-cpp is not installed: pip install "
            "'cellctl[codes]'"
        )
    own, *_ = part_files(recipe)
    part = load_part(*own)
    if (learned := recipe.inspection.learned) is not None:
        learned_for(learned, recipe.part)  # that it fits is known before anything moves
    files, wanted = _known_parts(job, recipe)
    setup = planner_setup(recipe, cell, part)
    layout = setup.layout
    return Context(
        recipe=recipe,
        cell=cell,
        setup=setup,
        part=part,
        posed=inspecting.PosedPart(part.solid),
        library=open_library(files, layout.overhead),
        glowing=glowing_mask(layout.overhead, table_corners(cell)),
        not_inspected=faces_left_out(job.recipe_path, recipe, part.solid.faces, part.features),
        files=files,
        wanted=wanted,
    )


def _known_parts(
    job: Job, recipe: Recipe
) -> tuple[tuple[tuple[Path, CompileOptions], ...], tuple[str, ...]]:
    """Return the files of all parts that may lie on the table, and the names of those to take.

    In a batch these are the parts of all its recipes, then the other parts that any of them names;
    a part in both groups is compiled by its own recipe.
    """
    recipes = [load_recipe(path) for path in job.batch] or [recipe]
    each = [part_files(one) for one in recipes]
    known: dict[Path, tuple[Path, CompileOptions]] = {}
    for path, options in (*(own for own, *_ in each), *(o for _, *rest in each for o in rest)):
        known.setdefault(path.resolve(), (path, options))
    return tuple(known.values()), tuple(part_name(one.part) for one in recipes)


def load_parts(recipe: Recipe) -> list[CompiledPart]:
    """Return a recipe's part, then the other parts that may turn up.

    Raises
    ------
    CadError : a CAD file is wrong
    """
    return [load_part(path, options) for path, options in part_files(recipe)]


def part_files(recipe: Recipe) -> list[tuple[Path, CompileOptions]]:
    """Return the CAD files of a recipe's part and of the other parts, with their options."""
    return [
        (recipe.part, sampled_for(recipe, CompileOptions(unit=recipe.unit))),
        *((other, options_among(other, recipe.unit)) for other in recipe.others),
    ]


def glowing_mask(camera: Camera, corners_mm: FloatArray) -> BoolArray:
    """Return the mask of a backlit rectangle (4, 3) in the picture, shrunk by a few pixels."""
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


def inspection_limits(recipe: Recipe) -> inspecting.InspectionLimits:
    """Return the inspection limits that a recipe sets."""
    return inspecting.InspectionLimits(smallest_defect_mm=recipe.inspection.smallest_defect_mm)
