"""`cellctl learn`: read accepted parts, learn, print how each is judged by the others, write."""

import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Final

from controller.cad import Solid
from controller.cad.compiled import CompiledPart
from controller.catalogue import Jobs, in_order, open_pool
from controller.cell.journal import rows
from controller.config import ConfigError, Recipe, find_recipe, load_recipe, split_cad
from controller.config.view_set import ViewSetFile, load_view_set
from controller.inspection import (
    MIN_PARTS,
    GoodPart,
    InspectionLimits,
    Lesson,
    TooFewPartsError,
    Tried,
    learn,
)
from controller.results.run import PartReport, RunRecord, list_runs, load_run, prove_run
from controller.setup.software import installed_version
from controller.stored import (
    AcceptedPart,
    LearnedHeader,
    build_view_set,
    cad_sha256,
    compiled_part,
    read_pictures,
    write_learned,
)
from controller.stored.learned_file import BY_VERDICT, SCHEMA

from ..inputs.ahead import told_of_workers
from ..inputs.checks import check_writable_folder, require_files
from ..inputs.run_pictures import bring_back
from ..terminal.output import emit, print_line, warn

# Newest parts taken: the pictures of one take some 30 MB, and more parts hardly change a median.
MAX_PARTS: Final = 24
MAX_NAMED: Final = 3  # views that a line names


@dataclass(frozen=True, slots=True)
class AcceptedViews:
    """Views of an accepted part, with who accepted it."""

    path: Path
    file: ViewSetFile
    cad_sha256: str
    accepted: AcceptedPart

    @classmethod
    def of(cls, path: Path, accepted: AcceptedPart) -> "AcceptedViews":
        """Return an accepted part with the file of its views read.

        Parameters
        ----------
        path : the file
        accepted : the part

        Raises
        ------
        ConfigError : it or its CAD file is wrong
        """
        file = load_view_set(path)
        return cls(path, file, cad_sha256(file.part), accepted)


def learn_parts(
    sets: Sequence[Path],
    runs: Path | None,
    recipe_path: Path | None,
    output: Path,
    jobs: Jobs,
    *,
    as_json: bool,
) -> int:
    """Learn what good parts look like, and write it.

    Parameters
    ----------
    sets : views of good parts
    runs : folder of runs, whose accepted parts are taken; None for `sets`
    recipe_path : recipe whose part is learned, with the limits; None for that of the first part
    output : file to write
    jobs : processes that learn
    as_json : print one JSON object instead of lines

    Returns
    -------
    exit code: 0

    Raises
    ------
    ConfigError : too few good parts, of different CAD files, or a file is wrong, or the output
        cannot be written
    PoolLostError : the processes ended early; nothing is written
    """
    if output.is_dir():
        raise ConfigError(f"-o {output}: is a directory; name a file in it")
    check_writable_folder(output.parent, "-o in")
    recipe = None if recipe_path is None else load_recipe(find_recipe(recipe_path))
    wanted = None if recipe is None else cad_sha256(recipe.part)
    began = time.monotonic()
    sources = list(_named(sets) if runs is None else _accepted(runs, wanted))
    if len(sources) < MIN_PARTS:
        raise ConfigError(
            f"nothing learned: {len(sources)} good parts{'' if runs is None else f' in {runs}'}, "
            f"{MIN_PARTS} are needed to tell what is usual"
        )
    parts, part, digest = _read(sources, recipe, wanted, as_json=as_json)
    try:
        with open_pool(jobs, told_of_workers) as pool:
            lesson = learn(
                parts,
                told=lambda words: None if as_json else print_line(f"  {words}"),
                spread=partial(in_order, pool),
            )
    except TooFewPartsError as error:
        raise ConfigError(f"nothing learned: {error}") from error
    if not lesson.appearance.views:
        raise ConfigError(
            f"nothing learned: {MIN_PARTS} parts in the same view are needed; "
            + "; ".join(lesson.unlearned)
        )
    write_learned(output, lesson.appearance, _header(lesson, sources, part.solid, digest))
    _print(lesson, part.solid, output, time.monotonic() - began, as_json=as_json)
    return 0


def _read(
    sources: Sequence[AcceptedViews], recipe: Recipe | None, wanted: str | None, *, as_json: bool
) -> tuple[list[GoodPart], CompiledPart, str]:
    """Return the parts with their pictures, the CAD model, and the hash of its file."""
    first = sources[0]
    digest = wanted or first.cad_sha256
    # its samples are counted in the same way for all, so that one model serves
    part = compiled_part(first.path, first.file)
    parts: list[GoodPart] = []
    for one in sources:
        if (one.cad_sha256, one.file.unit) != (digest, first.file.unit):
            raise ConfigError(
                f"{one.path}: its part has another CAD file or unit than the recipe or the sets "
                "before it; learn a file for each CAD file"
            )
        judged_by = recipe or one.file.recipe
        limits = InspectionLimits()
        if judged_by is not None:
            limits = InspectionLimits(smallest_defect_mm=judged_by.inspection.smallest_defect_mm)
        if not as_json:
            print_line(f"reading {one.accepted.name}")
        views = build_view_set(one.file, part, read_pictures(one.path, one.file), limits)
        parts.append(GoodPart(one.accepted.name, views))
    return parts, part, digest


def _named(sets: Sequence[Path]) -> Iterator[AcceptedViews]:
    """Yield the sets that a person named; raise ConfigError if one is not there, or named twice."""
    require_files(sets)
    known: set[Path] = set()
    for path in sets:
        if path.resolve() in known:
            raise ConfigError(f"{path}: is named twice; name a set of views of each good part once")
        known.add(path.resolve())
        yield AcceptedViews.of(path, AcceptedPart(name=str(path)))


def _accepted(runs: Path, wanted: str | None) -> Iterator[AcceptedViews]:
    """Yield the newest accepted parts of one CAD file in a folder of runs, newest first."""
    found = 0
    for summary in list_runs(runs):
        record = load_run(runs, summary.run_id)
        if record.first_broken_row is not None:
            raise ConfigError(
                f"{runs}: the chain of hashes breaks at row {record.first_broken_row} of the "
                "journal; who accepted a part is no longer known from it"
            )
        sources = [one for part in reversed(record.parts) if (one := _source(record, part))]
        tampered = prove_run(runs, record.run_id).tampered if sources else ()
        changed = {one.subject for one in tampered}
        for source in sources:
            pictures = [file for view in source.file.views for file in view.pictures.values()]
            files = {
                os.path.relpath(file, record.folder)
                for file in (source.path, split_cad(source.file.part).file, *pictures)
            }
            wanted = wanted or source.cad_sha256
            if source.cad_sha256 != wanted:
                continue
            bring_back(record, pictures)
            if files & changed or not all(file.is_file() for file in pictures):
                warn(f"{source.accepted.name}: its pictures changed or are gone; it is left out")
                continue
            found += 1
            yield source
            if found == MAX_PARTS:
                return


def _source(record: RunRecord, part: PartReport) -> AcceptedViews | None:
    """Return an accepted part's views; None for one that is not accepted, or has none."""
    if not part.is_counted or part.verdict is None:
        return None
    inspected = [
        entry.row
        for entry in record.log
        if entry.part == part.number and isinstance(entry.row, rows.PartInspected)
    ]
    if not inspected or not inspected[-1].views:
        return None
    name = f"{record.run_id} part {part.number}"
    if part.reviews:
        last = part.reviews[-1]
        if last.verdict != "accept":
            return None
        accepted = AcceptedPart(name=name, accepted_by=last.who, accepted_at=last.at)
    elif part.verdict.verdict == "pass":
        accepted = AcceptedPart(name=name, accepted_by=BY_VERDICT, accepted_at=part.end)
    else:
        return None
    try:
        return AcceptedViews.of(record.folder / inspected[-1].views, accepted)
    except ConfigError as error:
        warn(f"{name} is left out: {error}")
        return None


def _header(
    lesson: Lesson, sources: Sequence[AcceptedViews], solid: Solid, digest: str
) -> LearnedHeader:
    by_name = {one.accepted.name: one.accepted for one in sources}
    x, y, z = lesson.appearance.p_part_mm.tolist()
    return LearnedHeader(
        schema=SCHEMA,
        part=solid.name,
        cad_sha256=digest,
        p_part_mm=(x, y, z),
        made=datetime.now(UTC),
        software=installed_version(),
        # a part none of whose views could be used has taught nothing
        parts=tuple(by_name[one.name] for one in lesson.tried if one.compared),
        left_out=tuple(by_name[one.name] for one in lesson.left_out),
        compared=_mean([one.compared for one in lesson.tried]),
        in_sight=_mean([one.in_sight for one in lesson.tried]),
    )


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _print(lesson: Lesson, solid: Solid, output: Path, seconds: float, *, as_json: bool) -> None:
    views = lesson.appearance.views
    pictures = sum(len(view.pictures) for view in views)
    count = sum(1 for one in lesson.tried if one.compared)
    if as_json:
        emit(
            {
                "learned": str(output),
                "parts": [_body(one, solid) for one in lesson.tried],
                "left_out": [_body(one, solid) for one in lesson.left_out],
                "unlearned": list(lesson.unlearned),
                "views": len(views),
                "pictures": pictures,
                "seconds": round(seconds, 1),
            }
        )
        return
    print_line("each part judged by the others:")
    for one in (*lesson.tried, *lesson.left_out):
        share = one.compared / one.in_sight if one.in_sight else 0.0
        print_line(
            f"  {one.name}: {100 * share:.1f} % of what is in sight compared; "
            + ("left out: " if one.odd else "no difference" if one.compared else "no view of use")
            + "; ".join(found.sentence(solid) for found in one.odd)
        )
    if lesson.unlearned:
        shown = "; ".join(lesson.unlearned[:MAX_NAMED])
        more = len(lesson.unlearned) - MAX_NAMED
        warn(f"not learned: {shown}{f'; and {more} more views' if more > 0 else ''}")
    print_line(
        f"learned from {count} parts, {len(views)} views, {pictures} pictures, in "
        f"{seconds:.0f} s: {output}"
    )
    print_line(f"to judge by it: `learned: {output.name}` under `inspection:` of the recipe")


def _body(one: Tried, solid: Solid) -> dict[str, object]:
    return {
        "name": one.name,
        "compared": round(one.compared, 4),
        "in_sight": round(one.in_sight, 4),
        "odd": [found.sentence(solid) for found in one.odd],
    }
