"""The sources of a gauge study: parts of runs as measured then, sets of views measured now."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from math import hypot
from pathlib import Path
from typing import Any, Final

from controller.cell.journal import rows
from controller.config import ConfigError, split_cad
from controller.config.cad_files import cad_identity
from controller.config.files import file_sha256
from controller.config.view_set import load_view_set
from controller.results.gauge import Reading
from controller.results.judged import Header, JudgedPart, counted_parts
from controller.results.judged.inspected import judged_part
from controller.results.run import RunRecord, SightingReport, load_run
from controller.stored import (
    compiled_part,
    grasp_numbers,
    judge_views,
    judging_of,
    read_pictures,
    repeated_sets,
)

from ..terminal.output import warn

# A part put down on a mark by hand lies as exactly as this; farther away is another start pose.
SAME_START_MM: Final = 3.0
SAME_START_DEG: Final = 3.0


@dataclass(slots=True)
class Sources:
    """The sources read.

    Attributes
    ----------
    readings : in the order given
    inputs : source, groups and hashes of each reading, for the evidence
    part, cad_sha256 : the product
    remarks : assumptions made, as sentences
    """

    readings: list[Reading] = field(default_factory=list)
    inputs: list[Mapping[str, Any]] = field(default_factory=list)
    part: str = ""
    cad_sha256: str = ""
    remarks: list[str] = field(default_factory=list)
    starts: dict[str, list[SightingReport]] = field(default_factory=dict)

    def require_product(self, source: str, part: str, cad_sha256: str) -> None:
        """Require that a source shows the same product as those before it.

        Parameters
        ----------
        source : named in the message
        part, cad_sha256 : part shown, and the hash of its CAD file

        Raises
        ------
        ConfigError : it shows another product
        """
        if not self.part:
            self.part, self.cad_sha256 = part, cad_sha256
        elif cad_sha256 != self.cad_sha256:
            raise ConfigError(
                f"{source}: the CAD file of its part, {part}, is not that of the sources before "
                f"it, {self.part}; a study takes one product"
            )

    def take(self, reading: Reading, sha256: Mapping[str, str]) -> None:
        """Add a reading with the hashes of its source files."""
        self.readings.append(reading)
        self.inputs.append(
            {
                "source": reading.source,
                "part": reading.part,
                "start_pose": reading.start,
                "grasp": reading.grasp,
                "sha256": dict(sha256),
            }
        )

    def remark(self, sentence: str) -> None:
        """Add a sentence, unless it is there already."""
        if sentence not in self.remarks:
            self.remarks.append(sentence)


def read_sources(words: Sequence[str], recipe_path: Path | None, runs_dir: Path) -> Sources:
    """Return the readings of all sources.

    Parameters
    ----------
    words : sets of views and runs, each with the names of its groups before an ``=`` or without
    recipe_path : recipe to measure sets by; None for their own
    runs_dir : folder of all runs

    Raises
    ------
    ConfigError : no source, names in a wrong form, a wrong file, or sources of two products
    UnknownRunError : no such run
    """
    if not words:
        raise ConfigError("name what was measured: sets of views (SET.json) or runs")
    found = Sources()
    for number, word in enumerate(words, 1):
        names, source = _split(word)
        if Path(source).is_file():
            _take_set(found, Path(source), names, number, recipe_path)
        else:
            _take_run(found, load_run(runs_dir, source), names)
    return found


def _split(word: str) -> tuple[tuple[str, ...], str]:
    """Return the names of part, start pose and grasp, as far as given, and the source."""
    label, sign, source = word.partition("=")
    if not sign or Path(word).exists():
        return (), word
    names = tuple(name.strip() for name in label.split("/"))
    if not source or len(names) > 3 or not all(names):
        raise ConfigError(
            f"{word}: must be PART=SOURCE, PART/START=SOURCE or PART/START/GRASP=SOURCE"
        )
    return names, source


def _take_set(
    found: Sources, path: Path, names: tuple[str, ...], number: int, recipe_path: Path | None
) -> None:
    file = load_view_set(path)
    judging = judging_of(path, file, recipe_path, warn=warn)
    part = compiled_part(path, file)
    cad = split_cad(file.part)
    identity = cad_identity(cad.name, file_sha256(cad.file))
    found.require_product(str(path), part.solid.name, identity)
    name, start, grasp = (*names, *("", "", str(number))[len(names) :])
    if not names:
        found.remark("Sets of views without a name of their part are taken as one part.")
    repeats = repeated_sets(file)
    grasps = grasp_numbers(file)
    for k, once in enumerate(repeats, 1):
        judged = judge_views(once, part, read_pictures(path, once), judging)
        now = datetime.now(UTC)
        header = Header(part=part.solid.name, start=now, end=now)
        kept = judged_part(judged, header, path.parent, {})
        pictures = [picture for view in once.views for picture in view.pictures.values()]
        source = str(path) if len(repeats) == 1 else f"{path}, repeat {k} of {len(repeats)}"
        found.take(
            Reading(name, start, grasp, source, kept.part.characteristics, grasps),
            {file.name: file_sha256(file) for file in (path, cad.file, *pictures)},
        )


def _take_run(found: Sources, record: RunRecord, names: tuple[str, ...]) -> None:
    if record.first_broken_row is not None:
        raise ConfigError(
            f"run {record.run_id}: the chain of hashes breaks at row {record.first_broken_row}; "
            "its numbers may have been changed and cannot be used"
        )
    if record.emulated_devices:
        found.remark("Runs of an emulated cell: its figures hold for no real one.")
    measured = [judged for judged in counted_parts(record) if judged.part.characteristics]
    if not measured:
        raise ConfigError(f"run {record.run_id}: no part was measured in it; leave it out")
    for judged in measured:
        source = f"{record.run_id} part {judged.header.number}"
        cad = cad_identity(judged.header.cad, judged.header.cad_sha256)
        found.require_product(source, judged.header.part, cad)
        if not names and not judged.header.serial:
            found.remark("Parts without a serial number are taken as one part.")
        part = names[0] if names else judged.header.serial
        start = names[1] if len(names) > 1 else _start(found, part, judged)
        grasp = names[2] if len(names) > 2 else source
        views, lines = _inspected(record, judged.header.number)
        values = json.dumps([[c.id, c.measured, c.U] for c in judged.part.characteristics])
        found.take(
            Reading(
                part,
                start,
                grasp,
                source,
                judged.part.characteristics,
                _grasps_in(record.folder / views) if views else {},
            ),
            {"values": hashlib.sha256(values.encode()).hexdigest()}
            | ({"lines": lines} if lines else {}),
        )


def _start(found: Sources, part: str, judged: JudgedPart) -> str:
    """Return the name of the start pose: the one a part lay in before, or the next number."""
    seen = [s for s in judged.part.sightings if s.part is not None]
    if len(seen) != 1:
        return ""
    known = found.starts.setdefault(part, [])
    for number, other in enumerate(known, 1):
        if _is_same_start(seen[0], other):
            return str(number)
    known.append(seen[0])
    return str(len(known))


def _is_same_start(one: SightingReport, other: SightingReport) -> bool:
    turn = abs((one.theta_deg - other.theta_deg + 180) % 360 - 180)
    away = hypot(one.x_mm - other.x_mm, one.y_mm - other.y_mm)
    return one.pose_index == other.pose_index and away <= SAME_START_MM and turn <= SAME_START_DEG


def _inspected(record: RunRecord, number: int) -> tuple[str, str]:
    """Return file of the views and hash of the lines of a part; empty if a run has none."""
    for entry in record.log:
        if entry.part == number and isinstance(entry.row, rows.PartInspected):
            return entry.row.views, entry.row.lines_sha256
    return "", ""


def _grasps_in(views: Path) -> Mapping[str, int]:
    """Return the grasp of each view; none if the file of the views is gone or damaged."""
    try:
        return grasp_numbers(load_view_set(views))
    except ConfigError:
        return {}
