"""Inspection of the part in a set of views, under a recipe."""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Final

from controller.arrays import BoolArray, Grey
from controller.cad.compiled import CompiledPart, load_part, options_among, part_name
from controller.cad.reading import digests_of
from controller.config import ConfigError, Recipe, find_recipe, load_recipe, split_cad
from controller.config.cad_files import MAX_CAD_BYTES, STEP_FORMATS, cad_identity
from controller.config.files import read_bytes
from controller.config.view_set import ViewSetFile
from controller.imaging import transform
from controller.inspection import (
    OUTLINE,
    InspectionLimits,
    Kept,
    PartInspection,
    PartSettings,
    PicturedView,
    ViewSet,
    inspect_part,
    work_ahead,
)
from controller.inspection.characteristics import Characteristic, with_capability
from controller.setup.characteristics import (
    build_accuracy,
    measuring_settings,
    part_characteristics,
    station_at,
)
from controller.setup.faces import faces_left_out
from controller.setup.samples import sampled_for
from messages import joined, say

from .as_calibrated import as_calibrated
from .learned_file import Learned, read_learned
from .pictures import read_grey
from .view_set import (
    Pictures,
    build_view_set,
    planned_samples,
)

MAX_PROBLEM_COUNT: Final = 10  # wrong pictures named at once
MAX_NAMED: Final = 6  # pictures that a sentence names


@dataclass(frozen=True, slots=True)
class Judging:
    """Rules for judging a set.

    Attributes
    ----------
    recipe : with the limits; None for a recipe's defaults
    path : the file that has the recipe, for messages
    set_path : the set, for messages
    learned : file of what good parts look like; None for none
    """

    recipe: Recipe | None
    path: Path
    set_path: Path
    learned: Path | None = None


def judging_of(
    set_path: Path,
    file: ViewSetFile,
    recipe_path: Path | None,
    learned: Path | None = None,
    warn: Callable[[str], None] = lambda _: None,
) -> Judging:
    """Return the basis that a set is judged on: the recipe named, else the set's own.

    Parameters
    ----------
    set_path : the set
    file : its content
    recipe_path : a recipe file, or the name of a recipe that comes with cellctl
    learned : file of what good parts look like; None for the recipe's
    warn : gets a sentence where the recipe's CAD file is another one than the set's

    Raises
    ------
    ConfigError : the recipe is wrong, or for another part
    """
    if recipe_path is None:
        return Judging(file.recipe, set_path, set_path, learned or file.learned)
    path = find_recipe(recipe_path)
    return judging_by(set_path, file, load_recipe(path), path, learned, warn)


def judging_by(
    set_path: Path,
    file: ViewSetFile,
    recipe: Recipe,
    path: Path,
    learned: Path | None = None,
    warn: Callable[[str], None] = lambda _: None,
) -> Judging:
    """Return the basis that a set is judged on by a recipe that was read.

    Parameters
    ----------
    set_path : the set
    file : its content
    recipe : the recipe
    path : its file, for messages
    learned : file of what good parts look like; None for the recipe's
    warn : gets a sentence where the recipe's CAD file is another one than the set's

    Raises
    ------
    ConfigError : the recipe is for another part, or a CAD file cannot be read
    """
    if part_name(recipe.part) != part_name(file.part):
        raise ConfigError(
            f"{path}: `part`: the recipe is for {part_name(recipe.part)}, the set shows "
            f"{part_name(file.part)}; choose the recipe of this part"
        )
    own, other = (
        read_bytes(split_cad(cad).file, MAX_CAD_BYTES, "a CAD file")
        for cad in (recipe.part, file.part)
    )
    if own != other:
        warn(
            say(
                "{path}: its CAD file differs from {part}; the part is judged by the latter",
                path=path,
                part=file.part,
            )
        )
    return Judging(recipe, path, set_path, learned or recipe.inspection.learned)


def compiled_part(set_path: Path, file: ViewSetFile) -> CompiledPart:
    """Return the part of a set.

    Raises
    ------
    ConfigError : there is no such CAD file
    CadError : it is wrong
    """
    if not split_cad(file.part).file.is_file():
        raise ConfigError(f"{set_path}: `part`: no file {file.part}; a CAD file is expected")
    options = options_among(file.part, file.unit)
    # of the recipe that the set was taken with, as its views name samples; not of the judging one
    return load_part(file.part, sampled_for(file.recipe, options))


def read_pictures(
    set_path: Path, file: ViewSetFile, kept: Kept | None = None
) -> dict[str, dict[str, Grey]]:
    """Return the pictures of a set, by view id and lamp.

    Parameters
    ----------
    set_path : named in messages
    file : the set
    kept : pictures that were read before are taken from here; None for none

    Raises
    ------
    ConfigError : pictures are missing, cut off, of another size or not grey of 8 bits; all are
        named at once
    """
    kept = kept or Kept()
    found: dict[str, dict[str, Grey]] = {}
    problems: list[str] = []
    for i, view in enumerate(file.views):
        size_px = file.camera_of(view).size_px
        of_view = found[view.id] = {}
        for lamp, path in view.pictures.items():
            try:
                of_view[lamp] = kept.once(
                    partial(read_grey, path, size_px), read_grey, path, size_px
                )
            except ConfigError as error:
                problems.append(
                    say(
                        "{set_path}: `views.{i}.pictures.{lamp}`: {error}",
                        set_path=set_path,
                        i=i,
                        lamp=lamp,
                        error=error,
                    )
                )
    if len(problems) > MAX_PROBLEM_COUNT:
        more = say(
            "{set_path}: and {more} more like these",
            set_path=set_path,
            more=len(problems) - MAX_PROBLEM_COUNT,
        )
        problems = [*problems[:MAX_PROBLEM_COUNT], more]
    if problems:
        raise ConfigError(joined("\n", problems))
    return found


def judge_views(
    file: ViewSetFile,
    part: CompiledPart,
    pictures: Pictures,
    judging: Judging,
    kept: Kept | None = None,
) -> PartInspection:
    """Return the inspection result of a part from all its views.

    Parameters
    ----------
    file : the set
    part : its part
    pictures : by view id and lamp
    judging : basis of the judgement
    kept : part of it computed before; None for none

    Raises
    ------
    ConfigError : the recipe names what the part does not have, or the set expects the part where
        no camera can see it
    """
    kept = kept or Kept()
    views, characteristics, settings = _asked(file, part, pictures, judging, kept)
    found = inspect_part(views, characteristics, settings, kept)
    if judging.learned is not None:
        # behind the verdict's own, before what a terminal leaves to `--json`
        first, others = found.reasons[:1], found.reasons[1:]
        found = replace(found, reasons=(*first, _by_learned(found, judging.learned), *others))
    return as_calibrated(found, file.calibration, judging.recipe)


def _by_learned(found: PartInspection, path: Path) -> str:
    """Return in how many pictures good parts decided, and where not, in words."""
    checks = [
        (view.view_id, check)
        for view in found.views
        for check in view.checks
        if check.name != OUTLINE and not check.reason
    ]
    without = [f"{view_id}/{check.name}" for view_id, check in checks if not check.learned_from]
    words = say(
        "{sentence}: it decided on surfaces in {decided} of {pictures} lit pictures",
        sentence=learned_for(path).sentence,
        decided=len(checks) - len(without),
        pictures=len(checks),
    )
    if without:
        more = (
            say(" and {more} more", more=len(without) - MAX_NAMED)
            if len(without) > MAX_NAMED
            else ""
        )
        words += say(
            "; not in {without}{more}, which no learned view fits",
            without=", ".join(without[:MAX_NAMED]),
            more=more,
        )
    return words


def learned_for(path: Path, cad: Path | None = None) -> Learned:
    """Return what good parts look like, from a cache.

    Parameters
    ----------
    path : its file
    cad : CAD file of the part that will be judged by it; None if that is known to fit

    Raises
    ------
    ConfigError : there is no such file, it is damaged, or it was learned from another CAD file
    """
    try:
        state = path.stat()
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}; `cellctl learn` writes this file") from error
    learned = _read_once(path, state.st_mtime_ns, state.st_size)
    if cad is not None and cad_sha256(cad) != learned.header.cad_sha256:
        raise ConfigError(
            f"{path}: was learned with another CAD model ({learned.header.part}) than {cad}; learn "
            "again with `cellctl learn` from parts that were judged with this one"
        )
    return learned


@lru_cache(maxsize=4)
def _read_once(path: Path, time_ns: int, size: int) -> Learned:
    return read_learned(path)


def cad_sha256(cad: Path) -> str:
    """Return the hash of a CAD file and of those that it names, with the body's name if it has one.

    Parameters
    ----------
    cad : as a recipe names it

    Raises
    ------
    ConfigError : it cannot be read
    """
    source = split_cad(cad)
    digest = hashlib.sha256(read_bytes(source.file, MAX_CAD_BYTES, "a CAD file")).hexdigest()
    # only a STEP file names others
    digests = digests_of(cad) if source.ending in STEP_FORMATS else (digest,)
    if len(digests) > 1:
        digest = hashlib.sha256("".join(digests).encode()).hexdigest()
    return cad_identity(source.name, digest)


def judge_ahead(
    file: ViewSetFile,
    part: CompiledPart,
    judging: Judging,
    kept: Kept,
    view_count: int,
) -> Iterator[None]:
    """Do the work of `judge_views` on these views in advance; yield after each piece.

    Parameters
    ----------
    file : views of grasps that are over
    part : its part
    judging : basis of the judgement to come
    kept : gets it
    view_count : number of views planned

    Raises
    ------
    ConfigError : as in `read_pictures` and `judge_views`
    """
    pictures = read_pictures(judging.set_path, file, kept)
    yield from work_ahead(*_asked(file, part, pictures, judging, kept), kept, view_count)


def _asked(
    file: ViewSetFile, part: CompiledPart, pictures: Pictures, judging: Judging, kept: Kept
) -> tuple[ViewSet, tuple[Characteristic, ...], PartSettings]:
    """Return the inputs of a part's inspection: views, characteristics, settings."""
    try:
        planned = planned_samples(file, part)
        views = build_view_set(file, part, pictures, _limits(judging), kept)
    except ConfigError as error:
        raise ConfigError(f"{judging.set_path}: {error}") from error
    return (
        views,
        _characteristics(file, part, judging, views, kept),
        _settings(file, part, judging, planned),
    )


def _limits(judging: Judging) -> InspectionLimits:
    if judging.recipe is None:
        return InspectionLimits()
    return InspectionLimits(smallest_defect_mm=judging.recipe.inspection.smallest_defect_mm)


def _settings(
    file: ViewSetFile,
    part: CompiledPart,
    judging: Judging,
    planned: Mapping[str, BoolArray],
) -> PartSettings:
    settings = PartSettings(
        _limits(judging),
        unseen_reasons=file.unseen,
        planned=planned,
        measuring=measuring_settings(file.accuracy),
    )
    if judging.learned is not None:
        learned = learned_for(judging.learned, file.part)
        settings = replace(settings, appearance=learned.appearance)
    if judging.recipe is None:
        return settings
    return replace(
        settings,
        min_coverage=judging.recipe.inspection.min_coverage,
        not_inspected=faces_left_out(judging.path, judging.recipe, part.solid.faces, part.features),
        find_mm={str(kind): mm for kind, mm in judging.recipe.inspection.find.items()},
    )


def _characteristics(
    file: ViewSetFile, part: CompiledPart, judging: Judging, views: ViewSet, kept: Kept
) -> tuple[Characteristic, ...]:
    """Return the characteristics to measure: the set's own, else those of CAD file and recipe.

    General tolerances that the camera cannot verify are marked, by the first view in a gripper.
    """
    first = [*(v for v in views.views if v.task.holder), *views.views][:1]
    asked = "" if judging.recipe is None else judging.recipe.model_dump_json()
    given = [one.model_dump_json() for one in file.characteristics or ()]
    return kept.once(
        partial(_found, file, part, judging, first),
        *(Characteristic, asked, file.accuracy.model_dump_json(), *first, *given),
    )


def _found(
    file: ViewSetFile, part: CompiledPart, judging: Judging, first: Sequence[PicturedView]
) -> tuple[Characteristic, ...]:
    found = part_characteristics(judging.path, judging.recipe, part, file.characteristics or None)
    if not first:
        return found
    held = first[0].task
    p_mm = transform(held.T_world_part_expected, part.solid.centroid_mm[None])[0]
    station = station_at(held.camera, p_mm)
    return with_capability(found, station, build_accuracy(file.accuracy))
