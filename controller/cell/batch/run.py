"""Runs one batch from connecting to rest: builds the cell, runs the dispatcher, cleans up."""

import asyncio
import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from controller.cad.reading import files_of
from controller.config import Cell, Recipe
from controller.config.calibrations import read_calibrations, standing_of
from controller.config.view_set import SetCalibration
from controller.planning.motion import ProvenMove, Swept
from controller.setup.layout import build_layout
from controller.setup.software import software_versions
from drivers.clock import CellClock

from ..compute import Compute, Job
from ..custody import CellIdentity, Held, fold_custody, left_in_trays, where_it_is
from ..custody.known_journals import note_journal, rows_of_all_journals
from ..devices import Devices, resolve
from ..devices.clocks import Speed, devices_with_time
from ..journal import (
    HOST_STAMPS,
    JOURNAL_NAME,
    Journal,
    JournalError,
    Row,
    Stamps,
    is_of,
    open_cell_journal,
    read_rows_named,
    rows,
)
from ..journal.usage import usage_of
from ..operator import NOBODY, Journaled, Operator, require_acknowledged
from ..operator.notices import Notices
from ..recovery import Back, Beside, Bounds, Interrupted, Sweep
from ..services.records import RECIPE_COPY, PartRecord, Product, Progress, inputs_of
from .assembly import assemble, product_of
from .dispatcher import Dispatcher, Outcome
from .order import RunOrder
from .starting import recipe_for, refuse, start


@dataclass(frozen=True, slots=True)
class Outfit:
    """What a run works with on the computer it is on.

    Attributes
    ----------
    compute : returns the compute service of a job, given the worker process
    devices : returns the drivers, given cell file, addresses and clock
    stamps : the clocks that the journal's rows are stamped by
    on_row : called with number, kind and name of each row of the journal, from any thread
    """

    compute: Callable[[Job, Executor], Compute] = Compute
    devices: Callable[[Cell, Mapping[str, dict[str, Any]], CellClock], Devices] = Devices.build
    stamps: Stamps = HOST_STAMPS
    on_row: Callable[[int, str, str], None] | None = None


HOST: Final = Outfit()


@dataclass(frozen=True, slots=True)
class RunResult:
    """How the run ended.

    Attributes
    ----------
    parts : and what became of each
    speed : of the cell's time
    why_not_verified : why nobody knows that the cell stands as it is taken to; empty if it is
        verified, or emulated as drawn
    """

    outcome: Outcome
    parts: tuple[PartRecord, ...]
    speed: Speed
    why_not_verified: str = ""


def new_run_id(recipe: Recipe, stamps: Stamps = HOST_STAMPS, more: int = 0) -> str:
    """Return a name for a run that sorts by time.

    Parameters
    ----------
    recipe : the first of the run
    stamps : the clock
    more : recipes beside it
    """
    now = stamps.utc()
    others = f"+{more}" if more else ""
    return f"{now:%Y%m%d-%H%M%S}-{now.microsecond // 1000:03d}-{recipe.name}{others}"


async def run_batch(
    order: RunOrder,
    pool: Executor,
    on_progress: Callable[[Progress], None],
    on_dispatcher: Callable[[Dispatcher], None],
    on_notice: Callable[[str], None] = lambda text: None,
    outfit: Outfit = HOST,
    operator: Operator = NOBODY,
    ahead: Executor | None = None,
) -> RunResult:
    """Run a batch to rest and return its result; everything from here on is in the journal.

    Parameters
    ----------
    order : what to run, and where its files go
    pool : the worker process
    on_progress : called on the event loop with every change; must return at once
    on_dispatcher : called once before devices are connected, with what can stop the run
    on_notice : called with sentences that the operator should read
    outfit : what it works with on this computer
    operator : decides what the cell cannot
    ahead : a worker process for the next part, while the arm has the one before; None for none

    Raises
    ------
    JournalError : the journal cannot be written, and nothing may move without it
    DeviceError : a device does not answer; nothing has moved
    """
    order.folder.mkdir(parents=True, exist_ok=True)
    # in a thread, since a long journal takes a second to check
    place = order.runs_dir / JOURNAL_NAME
    opened = await asyncio.to_thread(open_cell_journal, place, order.run_id, outfit.stamps)
    journal = opened.journal
    journal.on_row = outfit.on_row
    if opened.notice:
        on_notice(opened.notice)
    try:
        decider = Journaled(operator, journal)
        where = resolve(order.cell, order.emulated.get("devices", {}))
        began = who_and_what(order, where)
        # on the disk, so that a power cut leaves a journal with a beginning and a head
        await journal.write_secured(began)
        journal.write(rows.FilesStored(await asyncio.to_thread(_keep_inputs, order)))
        calibration = await asyncio.to_thread(
            _note_standing, journal, order.cell_path, order.cell, outfit.stamps.utc()
        )
        known, left = await asyncio.to_thread(_left_by_runs, journal, began)
        for notice in left:
            journal.write(rows.EmulatedCellEnded(message=notice))
            on_notice(notice)
        stored = await asyncio.to_thread(_stand_in_trays, order, journal, began)
        journal.write(rows.TraysStood(stored=stored))
        clock = order.clock.open()
        journal.cell_clock = clock.now_s
        devices = outfit.devices(order.cell, where, clock)
        progress = Progress()
        speed = Speed(clock.speed)

        def show() -> None:
            if notice := speed.look(clock):
                on_notice(notice)
            progress.speed = speed
            on_progress(progress)

        notices = Notices(
            order.cell.on_alarm,
            order.cell.folder,
            {"run": order.run_id, "recipe": order.recipe.name, "cell": order.cell.name},
        )
        layout = build_layout(order.cell)
        products = tuple(
            product_of(
                outfit.compute(job, pool),
                one.recipe,
                order.cell,
                one.count,
                number,
                None if ahead is None else outfit.compute(job, ahead),
            )
            for number, (one, job) in enumerate(zip(order.ordered, order.jobs, strict=True))
        )
        batch = assemble(
            products,
            order.cell,
            layout,
            devices,
            clock,
            journal,
            order.folder,
            progress,
            show,
            decider,
            calibration,
            numbers=order.papers.numbers,
            stored=stored,
            on_alarm=notices.take,
            is_stepwise=order.is_stepwise,
        )
        dispatcher = batch.dispatcher
        on_dispatcher(dispatcher)
        try:
            async with clock.attending():
                try:
                    progress.label = "connecting"
                    show()
                    who = await devices.connect()
                    journal.write(rows.Connected(who))
                    found = await _barred(order, journal, decider) or await start(
                        order,
                        devices,
                        journal,
                        known,
                        began,
                        layout,
                        decider,
                        sweep_by(products, began),
                        back_by(products, began),
                    )
                    if isinstance(found, Outcome):
                        outcome = found
                    else:
                        if found is not None:
                            batch.resumption.accept(
                                found,
                                order.runs_dir / found.left.run,
                                _product_for(found.left, products, began),
                            )
                        outcome = await dispatcher.run()
                    show()
                finally:
                    await batch.taking.ahead.aclose()
                    await batch.ahead.aclose()
                    await devices.aclose()
        except BaseException as error:
            with suppress(JournalError):
                journal.write(
                    rows.RunBrokeOff(
                        error=str(error) or type(error).__name__,
                        where=where_it_is(batch.record.part.custody),
                    )
                )
            raise
        finally:
            journal.cell_clock = None
            clock.close()
            await asyncio.to_thread(notices.close)
        parts = batch.record.parts
        ended = rows.RunEnded(
            end=outcome.end,
            message=outcome.message,
            parts=len(parts),
            speed=rows.SpeedReached(**speed.as_json()),
        )
        with suppress(JournalError):  # the outcome says so; the operator is told either way
            journal.write(ended)
        is_as_drawn = order.emulated.get("as_drawn", False) and not order.cell.calibration
        why = "" if is_as_drawn else calibration.why_not_verified
        return RunResult(outcome, parts, speed, why)
    finally:
        await asyncio.to_thread(journal.close)


def _stand_in_trays(
    order: RunOrder, journal: Journal, began: rows.RunBegan
) -> tuple[rows.StoredFields, ...]:
    """Return what stands in the nests, by earlier runs at this cell; nothing if they are empty."""
    if order.are_trays_empty:
        return ()
    return left_in_trays(journal.path, journal.run, began)


def _product_for(left: Interrupted, products: Sequence[Product], began: rows.RunBegan) -> Product:
    """Return the product that an interrupted part is of; the first where the part is unknown."""
    return products[recipe_for(left, began) or 0]


def sweep_by(products: Sequence[Product], began: rows.RunBegan) -> Sweep:
    """Return what has the compute service prove the space that homing with a part sweeps.

    Parameters
    ----------
    products : of this run
    began : its first row
    """

    async def sweep(left: Interrupted, bounds: Bounds) -> Swept:
        compute = _product_for(left, products, began).compute
        return await compute.homing_swept(*bounds.arguments)

    return sweep


def back_by(products: Sequence[Product], began: rows.RunBegan) -> Back:
    """Return what has the compute service prove that an arm beside its path goes back to it.

    Parameters
    ----------
    products : of this run
    began : its first row
    """

    async def back(left: Interrupted, beside: Beside) -> ProvenMove:
        compute = _product_for(left, products, began).compute
        return await compute.proven_back(*beside.arguments)

    return back


def _keep_inputs(order: RunOrder) -> dict[str, str]:
    """Copy what a run is started with to its folder; return the SHA-256 of each file."""
    digests = {}
    for name, path in _inputs(order):
        data = path.read_bytes()
        target = order.folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(data)
        digests[str(name)] = hashlib.sha256(data).hexdigest()
    return digests


def _inputs(order: RunOrder) -> Iterator[tuple[Path, Path]]:
    """Yield where in the run's folder each file goes that it is started with, and that file."""
    for number, one in enumerate(order.ordered):
        cad = files_of(one.recipe.part)
        yield from ((inputs_of(number) / file.relative_to(cad[0].parent), file) for file in cad)
        yield inputs_of(number) / RECIPE_COPY, one.path
    yield inputs_of(0) / "cell.yaml", order.cell_path
    for name, path in _calibrations(order):
        yield inputs_of(0) / f"calibration-{name}.json", path


def _calibrations(order: RunOrder) -> list[tuple[str, Path]]:
    """Return the calibration files that the cell file refers to, by name."""
    folder = order.cell_path.parent
    return [(name, folder / one.file) for name, one in order.cell.calibration.items()]


def _note_standing(journal: Journal, cell_path: Path, cell: Cell, now: datetime) -> SetCalibration:
    """Journal whether the cell's calibrations count; return what of them does not.

    Parameters
    ----------
    journal : of the cell, with the runs before this one
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
        for row in (read_rows_named(journal.path, names) if found else ())
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
    """Return which grippers may hold a part, and notices of parts gone with an emulated cell."""
    note_journal(journal.path, began)
    here = CellIdentity.of(began)
    found = rows_of_all_journals(journal.path, began)
    return fold_custody(found, here), _gone_with_its_emulator(found, here, journal.run)


def _gone_with_its_emulator(found: Sequence[Row], here: CellIdentity, run: str) -> list[str]:
    began = [row for row in found if row.run != run and is_of(row, rows.RunBegan)]
    if not began:
        return []
    last = CellIdentity.of(rows.RunBegan.model_validate(began[-1].body))
    return [
        f"Run {one.run} may have left a part in the {one.gripper.value} of an emulated cell. That "
        "cell has ended, and the part with it; on a real cell this start would be refused."
        for one in fold_custody(found, last)
        if one.gripper in last.emulated and not here.shares(one.gripper, last)
    ]


async def _barred(order: RunOrder, journal: Journal, operator: Operator) -> Outcome | None:
    """Return the outcome of a start after a stop that nobody has acknowledged, else None."""
    latch = await require_acknowledged(journal, order.cell.name, operator)
    if latch is None:
        return None
    return refuse(journal, latch.words, code="not_acknowledged", where="Nothing has moved.")


def input_files(order: RunOrder) -> tuple[Path, ...]:
    """Return the files that a run is started with."""
    parts = [part for one in order.ordered for part in (one.recipe.part, *one.recipe.others)]
    return (
        order.recipe_path,
        order.cell_path,
        *dict.fromkeys(file for part in parts for file in files_of(part)),
        *(path for _, path in _calibrations(order)),
        *(one.path for one in order.beside),
    )


def who_and_what(order: RunOrder, where: Mapping[str, dict[str, Any]]) -> rows.RunBegan:
    """Return the first row of a run: recipe, cell, devices, software.

    Parameters
    ----------
    order : what to run
    where : the devices' settings, as `resolve` found them
    """
    # all devices on an emulator's clock are emulated, also those whose address was given by hand;
    # pictures from files count as emulated too: whatever they show, it is not this cell now
    real = set(devices_with_time(order.cell)) - set(order.cell.emulated_devices)
    emulated_names = [name for name in where if order.clock.path is not None or name not in real]
    files = input_files(order)
    return rows.RunBegan(
        recipe=order.recipe.model_dump(mode="json", by_alias=True),
        files={str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files},
        cell=order.cell.model_dump(mode="json", by_alias=True),
        devices={
            name: dict(settings) | {"emulated": name in emulated_names}
            for name, settings in where.items()
        },
        emulated_devices=tuple(emulated_names),
        emulator={k: v for k, v in order.emulated.items() if k != "devices"},
        operator=order.papers.operator,
        lot=order.papers.lot,
        serials=order.papers.serials,
        part_temperature_c=order.papers.part_temperature_c,
        speed=order.speed,
        clock=None if order.clock.path is None else str(order.clock.path),
        count=order.part_count,
        software=software_versions(),
        **_several(order),
    )


def _several(order: RunOrder) -> dict[str, tuple[rows.RecipeOrdered, ...]]:
    """Return the recipes of an order of several; nothing where it has one."""
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
