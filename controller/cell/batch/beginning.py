"""The rows of a run before anything moves: its identity, its files, and the state it finds."""

import asyncio
import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from controller.cad.reading import files_of
from controller.config import Cell
from controller.config.calibrations import read_calibrations, standing_of
from controller.config.files import file_sha256
from controller.config.view_set import SetCalibration
from controller.setup.software import software_versions
from messages import key, say

from ..custody import CellIdentity, GripperName, Held, fold_custody, left_in_trays
from ..custody.known_journals import note_journal, rows_of_all_journals
from ..devices.clocks import devices_with_time
from ..journal import Journal, Row, Stamps, is_of, read_rows_counted, rows
from ..journal.usage import usage_of
from ..services.records import RECIPE_COPY, inputs_of
from .order import RunOrder


@dataclass(frozen=True, slots=True)
class RunStart:
    """The state that a run finds before it builds anything, as in its first rows.

    Attributes
    ----------
    began : the first row
    calibration : calibrations of the cell that do not count
    known : grippers that may hold a part, by the journals of all runs
    stored : contents of the trays
    """

    began: rows.RunBegan
    calibration: SetCalibration
    known: tuple[Held, ...]
    stored: tuple[rows.StoredFields, ...]


async def begin(
    order: RunOrder,
    began: rows.RunBegan,
    journal: Journal,
    stamps: Stamps,
    on_notice: Callable[[str], None],
) -> RunStart:
    """Write the first rows of a run, and keep its files; return the state left by earlier runs.

    Parameters
    ----------
    order : order to run
    began : the first row
    journal : journal of the cell
    stamps : the clock that calibrations age by
    on_notice : called with sentences that the operator should read

    Raises
    ------
    ConfigError : a calibration was changed since the cell file was read
    JournalError : the journal cannot be written
    """
    # on the disk, so that a power cut leaves a journal with a beginning and a head
    await journal.write_secured(began)
    journal.write(rows.FilesStored(await asyncio.to_thread(keep_inputs, order)))
    calibration = await asyncio.to_thread(
        _note_standing, journal, order.cell_path, order.cell, stamps.utc()
    )
    known, left = await asyncio.to_thread(_left_by_runs, journal, began)
    for notice in left:
        journal.write(rows.EmulatedCellEnded(message=notice))
        on_notice(notice)
    stored = await asyncio.to_thread(_stand_in_trays, order, journal, began)
    journal.write(rows.TraysStood(stored=stored))
    return RunStart(began, calibration, known, stored)


def input_files(order: RunOrder) -> tuple[Path, ...]:
    """Return the paths of all files that a run is started with."""
    parts = [part for one in order.ordered for part in (one.recipe.part, *one.recipe.others)]
    learned = [one.recipe.inspection.learned for one in order.ordered]
    return (
        order.recipe_path,
        order.cell_path,
        *dict.fromkeys(file for part in parts for file in files_of(part)),
        *dict.fromkeys(one for one in learned if one is not None),
        *(path for _, path in _calibrations(order)),
        *(one.path for one in order.beside),
    )


def who_and_what(order: RunOrder, where: Mapping[str, dict[str, Any]]) -> rows.RunBegan:
    """Return the first row of a run: recipe, cell, devices, software.

    Parameters
    ----------
    order : order to run
    where : the devices' settings, as `resolve` found them
    """
    # all devices on an emulator's clock are emulated, also those whose address was given by hand;
    # pictures from files count as emulated too: whatever they show, it is not this cell now
    real = set(devices_with_time(order.cell)) - set(order.cell.emulated_devices)
    emulated_names = [name for name in where if order.clock.path is not None or name not in real]
    files = input_files(order)
    return rows.RunBegan(
        recipe=order.recipe.model_dump(mode="json", by_alias=True),
        files={str(path): file_sha256(path) for path in files},
        cell=order.cell.model_dump(mode="json", by_alias=True),
        devices={
            name: dict(settings) | {"emulated": name in emulated_names}
            for name, settings in where.items()
        },
        emulated_devices=tuple(emulated_names),
        emulator={k: v for k, v in order.emulated.items() if k != "devices"},
        operator=order.papers.operator,
        lot=order.papers.lot,
        order_number=order.papers.order_number,
        serials=order.papers.serials,
        part_temperature_c=order.papers.part_temperature_c,
        speed=order.speed,
        clock=None if order.clock.path is None else str(order.clock.path),
        count=order.part_count,
        software=software_versions(),
        **_several(order),
    )


def _several(order: RunOrder) -> dict[str, tuple[rows.RecipeOrdered, ...]]:
    """Return the recipes of an order of several; empty if it has one."""
    if not order.beside:
        return {}
    each = tuple(
        rows.RecipeOrdered(
            recipe=one.recipe.model_dump(mode="json", by_alias=True),
            file=str(one.path),
            count=one.count,
        )
        for one in order.ordered
    )
    return {"recipes": each}


def keep_inputs(order: RunOrder) -> dict[str, str]:
    """Copy a run's input files to its folder; return the SHA-256 of each.

    Parameters
    ----------
    order : order to run

    Returns
    -------
    by name in that folder
    """
    digests = {}
    for name, path in _inputs(order):
        data = path.read_bytes()
        target = order.folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(data)
        digests[str(name)] = hashlib.sha256(data).hexdigest()
    return digests


def _inputs(order: RunOrder) -> Iterator[tuple[Path, Path]]:
    """Yield each input file of a run, and its place in the run's folder."""
    for number, one in enumerate(order.ordered):
        cad = files_of(one.recipe.part)
        yield from ((inputs_of(number) / file.relative_to(cad[0].parent), file) for file in cad)
        yield inputs_of(number) / RECIPE_COPY, one.path
        if (learned := one.recipe.inspection.learned) is not None:
            yield inputs_of(number) / learned.name, learned
    yield inputs_of(0) / "cell.yaml", order.cell_path
    for name, path in _calibrations(order):
        yield inputs_of(0) / f"calibration-{name}.json", path


def _calibrations(order: RunOrder) -> list[tuple[str, Path]]:
    """Return the calibration files that the cell file refers to, by name."""
    folder = order.cell_path.parent
    return [(name, folder / one.file) for name, one in order.cell.calibration.items()]


def _note_standing(journal: Journal, cell_path: Path, cell: Cell, now: datetime) -> SetCalibration:
    """Journal whether the cell's calibrations are valid; return those that are not.

    Parameters
    ----------
    journal : journal of the cell, with the runs before this one
    cell_path, cell : the cell file, and what it holds
    now : with its offset from UTC

    Raises
    ------
    ConfigError : a calibration was changed since the cell file was read
    """
    found = read_calibrations(cell_path, cell.calibration)
    names = (rows.RunBegan.row_name, rows.ViewsPosed.row_name)
    before = (
        row
        for row in (read_rows_counted(journal.path, names) if found else ())
        if row.run != journal.run
    )
    standing = standing_of(cell.calibration, found, now, usage_of(before))
    each = {
        one.name: rows.CalibrationFields(measured=one.measured.isoformat(), why_stale=one.why_stale)
        for one in standing.each
    }
    journal.write(
        rows.CalibrationsStood(
            each=each,
            why_not_verified=standing.why_not_verified,
            sentences=standing.sentences,
        )
    )
    return SetCalibration(stale=standing.stale, why_not_verified=standing.why_not_verified)


def _left_by_runs(journal: Journal, began: rows.RunBegan) -> tuple[tuple[Held, ...], list[str]]:
    """Return the grippers that may hold a part, and notices of parts gone with an emulated cell."""
    note_journal(journal, began)
    here = CellIdentity.of(began)
    found = rows_of_all_journals(journal.path, began)
    return fold_custody(found, here), _gone_with_its_emulator(found, here, journal.run)


GONE: Final[Mapping[GripperName, str]] = {
    GripperName.ARM: key(
        "Run {run} may have left a part in the arm gripper of an emulated cell. That cell has "
        "ended, and the part with it; on a real cell this start would be refused."
    ),
    GripperName.FIXED: key(
        "Run {run} may have left a part in the fixed gripper of an emulated cell. That cell has "
        "ended, and the part with it; on a real cell this start would be refused."
    ),
}


def _gone_with_its_emulator(found: Sequence[Row], here: CellIdentity, run: str) -> list[str]:
    began = [row for row in found if row.run != run and is_of(row, rows.RunBegan)]
    if not began:
        return []
    last = CellIdentity.of(rows.RunBegan.model_validate(began[-1].body))
    return [
        say(GONE[one.gripper], run=one.run)
        for one in fold_custody(found, last)
        if one.gripper in last.emulated and not here.shares(one.gripper, last)
    ]


def _stand_in_trays(
    order: RunOrder, journal: Journal, began: rows.RunBegan
) -> tuple[rows.StoredFields, ...]:
    """Return the parts that earlier runs at this cell left in the nests; () if those are empty."""
    if order.are_trays_empty:
        return ()
    return left_in_trays(journal.path, journal.run, began)
