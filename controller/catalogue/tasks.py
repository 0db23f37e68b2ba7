"""A worker's tasks for one part: each fills the cache and returns little."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from controller.cad import CadError
from controller.cad.compiled import (
    CompiledPart,
    CompileOptions,
    cached_part,
    is_kept,
    load_part,
    make_part,
)
from controller.cell.plans import PlanCache
from controller.config import Recipe, load_cell
from controller.imaging import Camera
from controller.planning import NoPlanError
from controller.recognition.stored import is_entry_kept, keep_entry
from controller.setup.planner import planner_setup


@dataclass(frozen=True, slots=True)
class PartWork:
    """Work to do on one part.

    Attributes
    ----------
    path, options : CAD file and how it is compiled
    cell : cell file, to plan in it; None to plan nowhere
    recipe : recipe whose values apply to plans
    density_g_cm3 : density from the command line, None for the recipe's or the file's
    camera : overhead, to keep the part's views as it sees them; None to keep none
    """

    path: Path
    options: CompileOptions
    cell: Path | None = None
    recipe: Recipe | None = None
    density_g_cm3: float | None = None
    camera: Camera | None = None


@dataclass(frozen=True, slots=True)
class Compiled:
    """Result of compiling.

    Attributes
    ----------
    seconds : time it took, on the worker's clock
    was_kept : True if it was in the cache already
    error : reason why the part is refused; None if it is not
    distinct : stable poses to certify, by index: of those that a symmetry makes one, the first
    """

    seconds: float
    was_kept: bool = False
    error: CadError | None = None
    distinct: tuple[int, ...] = ()


def is_made(work: PartWork) -> bool:
    """Return whether the cache has all that is to be made of a part, as far as its files say.

    Parameters
    ----------
    work : operations to run on the part
    """
    path, options, camera = work.path, work.options, work.camera
    if not is_kept(path, options):
        return False
    if camera is not None and not is_entry_kept(path, options, camera):
        return False
    if work.cell is None:
        return True
    part, planning = _planning(work)
    return all(planning.is_certified(pose) for pose in part.poses if pose.is_distinct)


def compile_one(work: PartWork) -> Compiled:
    """Compile a part into the cache, with its views if there is a camera; return the result.

    Parameters
    ----------
    work : operations to run on the part
    """
    began = time.perf_counter()
    try:
        kept = cached_part(work.path, work.options)
        part = kept or make_part(work.path, work.options)
        if work.camera is not None:
            keep_entry(work.path, work.options, work.camera)
    except CadError as error:
        return Compiled(time.perf_counter() - began, error=error)
    distinct = tuple(p.index for p in part.poses if p.is_distinct)
    return Compiled(time.perf_counter() - began, kept is not None, distinct=distinct)


def prepare_one(work: PartWork) -> None:
    """Prepare a compiled part for the cell; certificates give the reason if nothing can hold it.

    Parameters
    ----------
    work : operations to run on the part
    """
    _, planning = _planning(work)
    try:
        planning.prepared()
    except NoPlanError:
        return


def certify_some(work: PartWork, poses: Sequence[int]) -> None:
    """Certify stable poses of a compiled part; prepare the part first if that is not done yet.

    Parameters
    ----------
    work : operations to run on the part
    poses : indices of the stable poses
    """
    part, planning = _planning(work)
    for pose in part.poses:
        if pose.index in poses:
            planning.certified(pose)


_last: list[tuple[PartWork, CompiledPart, PlanCache]] = []


def _planning(work: PartWork) -> tuple[CompiledPart, PlanCache]:
    """Return a part and its plans; a worker continues with its previous part."""
    assert work.cell is not None
    of_plans = replace(work, camera=None)
    known = _last[-1:]  # once: another thread of a worker may put its part there
    if known and known[0][0] == of_plans:
        return known[0][1:]
    part = load_part(work.path, work.options)
    setup = planner_setup(work.recipe, load_cell(work.cell), part, work.density_g_cm3)
    planning = PlanCache(part, setup.layout, setup.options)
    _last[:] = [(of_plans, part, planning)]
    return part, planning
