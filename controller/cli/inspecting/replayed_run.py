"""`cellctl replay`: the stored pictures of a run judged again, and the changes."""

import time
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from controller.cell.journal import rows
from controller.cell.services.records import findings_row, measured_row, verdict_row
from controller.config import ConfigError
from controller.config.view_set import ViewSetFile, load_view_set
from controller.inspection import PartInspection
from controller.results.run import RunRecord, load_run, prove_run
from controller.stored import compiled_part, judge_views, judging_of, lines_digest, read_pictures

from ..inputs.checks import require_files
from ..inputs.run_pictures import bring_back
from ..terminal.output import emit, print_line, warn

Items = Mapping[Hashable, Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class Judged:
    """The journal's record of a judged part."""

    number: int
    inspected: rows.PartInspected
    verdict: rows.PartJudged
    measured: rows.PartMeasured
    found: rows.PartFindings


@dataclass(frozen=True, slots=True)
class ResultChange:
    """A result that differs in another judging; None on the side where it is missing."""

    what: str
    name: str
    was: str | None
    now: str | None
    details: Mapping[str, Any]


def replay_run(runs_dir: Path, run: str | None, recipe_path: Path | None, *, as_json: bool) -> int:
    """Judge the parts of a run again.

    Parameters
    ----------
    runs_dir : folder of all runs
    run : id, the beginning of an id, or folder of the run; None for the newest
    recipe_path : recipe to judge by, None for the run's own
    as_json : print JSON lines instead of sentences

    Returns
    -------
    exit code: 0 where nothing changes, else 1

    Raises
    ------
    ConfigError : the run kept no views, or its files are wrong
    """
    record = load_run(runs_dir, run)
    judged = list(_judged_parts(record))
    if not judged:
        raise ConfigError(
            f"run {record.run_id}: no part was judged from stored views; there is nothing to judge "
            "again"
        )
    sets = [record.folder / part.inspected.views for part in judged]
    require_files(sets)
    files = [load_view_set(path) for path in sets]
    pictures = [one for file in files for view in file.views for one in view.pictures.values()]
    bring_back(record, pictures)
    require_files(pictures)
    tampered = prove_run(record.folder.parent, record.run_id).tampered
    for one in tampered:
        warn(f"{one.subject}: {one.problem}; the results below are of the files as they are now")
    changed = [
        _replay(part, set_path, file, recipe_path, as_json=as_json)
        for part, set_path, file in zip(judged, sets, files, strict=True)
    ]
    return 1 if any(changed) or tampered else 0


def _judged_parts(record: RunRecord) -> Iterator[Judged]:
    """Yield the parts of a run with the journal's record of their judging."""
    by_part: dict[int, dict[type, Any]] = {}
    for entry in record.log:
        if entry.part is not None and entry.row is not None:
            by_part.setdefault(entry.part, {})[type(entry.row)] = entry.row
    for number, found in by_part.items():
        if rows.PartInspected in found:
            yield Judged(
                number,
                found[rows.PartInspected],
                found[rows.PartJudged],
                found[rows.PartMeasured],
                found[rows.PartFindings],
            )


def _replay(
    part: Judged, set_path: Path, file: ViewSetFile, recipe_path: Path | None, *, as_json: bool
) -> bool:
    """Judge one part again, print the changes; return whether there are any."""
    started = time.monotonic()
    judging = judging_of(set_path, file, recipe_path, warn=warn)
    found = judge_views(file, compiled_part(set_path, file), read_pictures(set_path, file), judging)
    changes = list(_changes(part, found))
    is_equal = lines_digest(found) == part.inspected.lines_sha256
    was, now = part.verdict.verdict, found.verdict.value
    if as_json:
        for change in changes:
            what = {"name": change.name, "was": change.was, "now": change.now}
            about = {"event": "change", "part": part.number, "what": change.what}
            emit({**about, **what, **change.details})
        emit(
            {
                "event": "replayed",
                "part": part.number,
                "was": was,
                "now": now,
                "bit_equal": is_equal,
                "reasons": list(found.reasons),
                "seconds": round(time.monotonic() - started, 3),
            }
        )
        return bool(changes) or (not is_equal and recipe_path is None)
    for change in changes:
        print_line(
            f"part {part.number}, {change.what} {change.name}: {change.was or 'none'} -> "
            f"{change.now or 'none'}"
        )
    equal = "every number is the same to the last bit" if is_equal else "numbers differ"
    turned = now.upper() if was == now else f"{was.upper()} -> {now.upper()}"
    print_line(f"part {part.number}: {turned}; {equal}")
    for reason in found.reasons[:6] if was != now else ():
        print_line(f"  {reason}")
    return bool(changes) or (not is_equal and recipe_path is None)


def _changes(part: Judged, found: PartInspection) -> Iterator[ResultChange]:
    """Yield the changes: characteristics, findings, faces, at the end the verdict."""
    verdict = verdict_row(replace(found.ledger, verdict=found.verdict, reasons=found.reasons))
    yield from _turned(
        "characteristic",
        {c.id: c.model_dump(mode="json") for c in part.measured.characteristics},
        {c.id: c.model_dump(mode="json") for c in measured_row(found.measured).characteristics},
        ("lower", "upper", "measured", "U", "reason"),
    )
    yield from _turned(
        "finding",
        {_finding_key(f): f.model_dump(mode="json") for f in part.found.findings},
        {_finding_key(f): f.model_dump(mode="json") for f in findings_row(found.findings).findings},
        ("view", "lamp", "p_part_mm", "size_mm"),
    )
    yield from _turned(
        "face",
        {f.label: f.model_dump(mode="json") for f in part.verdict.faces},
        {f.label: f.model_dump(mode="json") for f in verdict.faces},
        ("reason",),
    )
    if part.verdict.verdict != verdict.verdict:
        yield ResultChange("verdict", "of the part", part.verdict.verdict, verdict.verdict, {})


def _finding_key(finding: rows.PartFindingFields) -> str:
    at = ", ".join(f"{x:.2f}" for x in finding.p_part_mm)
    return f"{finding.kind} at {at} in {finding.view}, {finding.lamp}"


def _turned(
    what: str, before: Items, after: Items, keys: tuple[str, ...]
) -> Iterator[ResultChange]:
    """Yield the items whose verdict or limits have changed.

    Parameters
    ----------
    what : kind of the items
    before, after : by name, with a verdict each
    keys : keys printed with a change
    """
    for name in dict.fromkeys([*before, *after]):
        old, new = before.get(name), after.get(name)
        limits = [None if i is None else (i.get("lower"), i.get("upper")) for i in (old, new)]
        was, now = (None if i is None else str(i["verdict"]) for i in (old, new))
        if was == now and limits[0] == limits[1]:
            continue
        shown = new or old or {}
        yield ResultChange(what, str(name), was, now, {key: shown[key] for key in keys})
