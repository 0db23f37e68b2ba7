"""`cellctl learn`: read accepted parts, learn, print how each is judged by the others, write."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from controller.cad import Solid
from controller.cad.compiled import CompiledPart
from controller.cell.journal import rows
from controller.config import ConfigError, Recipe, find_recipe, load_recipe
from controller.config.view_set import load_view_set
from controller.inspection import (
    GoodPart,
    InspectionLimits,
    Lesson,
    TooFewPartsError,
    Tried,
    learn,
)
from controller.results import RunRecord, list_runs, load_run
from controller.results.run import PartReport
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
from controller.stored.learned_file import SCHEMA

from ..inputs.checks import check_writable_folder, require_files
from ..terminal.output import emit, print_line, warn

# Newest parts taken: the pictures of one take some 30 MB, and more parts hardly change a median.
MAX_PARTS: Final = 24
MACHINE: Final = "the cell (PASS)"


@dataclass(frozen=True, slots=True)
class Source:
    """Views of an accepted part, with who accepted it."""

    path: Path
    accepted: AcceptedPart


def learn_parts(
    sets: Sequence[Path],
    runs: Path | None,
    recipe_path: Path | None,
    output: Path,
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
    as_json : print one JSON object instead of lines

    Returns
    -------
    exit code: 0

    Raises
    ------
    ConfigError : too few good parts, of different CAD files, or a file is wrong
    """
    check_writable_folder(output.parent, "-o in")
    recipe = None if recipe_path is None else load_recipe(find_recipe(recipe_path))
    wanted = None if recipe is None else cad_sha256(recipe.part)
    sources = [Source(path, AcceptedPart(name=str(path))) for path in sets]
    if runs is not None:
        sources = list(_accepted(runs, wanted))
    began = time.monotonic()
    parts, part, digest = _read(sources, recipe, wanted, as_json=as_json)
    try:
        lesson = learn(parts, told=lambda words: None if as_json else print_line(f"  {words}"))
    except TooFewPartsError as error:
        raise ConfigError(f"nothing learned: {error}") from error
    header = _header(lesson, sources, part.solid, digest)
    write_learned(output, lesson.appearance, header)
    _print(lesson, part.solid, output, time.monotonic() - began, as_json=as_json)
    return 0


def _read(
    sources: Sequence[Source], recipe: Recipe | None, wanted: str | None, *, as_json: bool
) -> tuple[list[GoodPart], CompiledPart, str]:
    """Return the parts with their pictures, the CAD model, and the hash of its file."""
    require_files([one.path for one in sources])
    parts: list[GoodPart] = []
    part: CompiledPart | None = None
    digest = wanted or ""
    for one in sources:
        file = load_view_set(one.path)
        own = cad_sha256(file.part)
        digest = digest or own
        if own != digest:
            raise ConfigError(
                f"{one.path}: the CAD file of its part differs from that of the parts before it; "
                "one file is learned for one CAD file"
            )
        # its samples are counted in the same way for all, so that one model serves
        part = part or compiled_part(one.path, file)
        judged_by = recipe or file.recipe
        limits = InspectionLimits()
        if judged_by is not None:
            limits = InspectionLimits(smallest_defect_mm=judged_by.inspection.smallest_defect_mm)
        if not as_json:
            print_line(f"reading {one.accepted.name}")
        views = build_view_set(file, part, read_pictures(one.path, file), limits)
        parts.append(GoodPart(one.accepted.name, views))
    if part is None:
        raise ConfigError("nothing learned: no accepted part was found")
    return parts, part, digest


def _accepted(runs: Path, wanted: str | None) -> Iterator[Source]:
    """Yield the newest accepted parts of a folder of runs, newest first."""
    found = 0
    for summary in list_runs(runs):
        record = load_run(runs, summary.run_id)
        for part in reversed(record.parts):
            source = _source(record, part)
            if source is None or found == MAX_PARTS:
                continue
            wanted = wanted or cad_sha256(load_view_set(source.path).part)
            if cad_sha256(load_view_set(source.path).part) == wanted:
                found += 1
                yield source


def _source(record: RunRecord, part: PartReport) -> Source | None:
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
        accepted = AcceptedPart(name=name, accepted_by=MACHINE, accepted_at=part.end)
    else:
        return None
    return Source(record.folder / inspected[-1].views, accepted)


def _header(lesson: Lesson, sources: Sequence[Source], solid: Solid, digest: str) -> LearnedHeader:
    by_name = {one.accepted.name: one.accepted for one in sources}
    x, y, z = lesson.appearance.p_part_mm.tolist()
    return LearnedHeader(
        schema=SCHEMA,
        part=solid.name,
        cad_sha256=digest,
        p_part_mm=(x, y, z),
        made=datetime.now(UTC),
        software=installed_version(),
        parts=tuple(by_name[one.name] for one in lesson.tried),
        left_out=tuple(by_name[one.name] for one in lesson.left_out),
        compared=_mean([one.compared for one in lesson.tried]),
        in_sight=_mean([one.in_sight for one in lesson.tried]),
    )


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _print(lesson: Lesson, solid: Solid, output: Path, seconds: float, *, as_json: bool) -> None:
    views = lesson.appearance.views
    pictures = sum(len(view.pictures) for view in views)
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
            + ("left out: " if one.odd else "no difference")
            + "; ".join(found.sentence(solid) for found in one.odd)
        )
    for words in lesson.unlearned:
        warn(f"not learned: {words}, too few")
    print_line(
        f"learned from {len(lesson.tried)} parts, {len(views)} views, {pictures} pictures, in "
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
