"""Builds the bridge of a cell from its cell file: each wire that the section `connect` names."""

import asyncio
import os
import signal
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.config import Cell
from controller.config.cell.connect import ConnectSection
from controller.config.files import file_sha256
from controller.launching import Launcher
from controller.memory import share_one_heap
from controller.page.security import Accounts, accounts_path
from controller.setup.software import software_versions

from .bridge import CellPlant, serve
from .keeping import PictureKeeper
from .orders import OrderBook
from .outbox import Book, Outbox
from .plant import Courier, PlantError, Wire
from .standing import StateReader

NICENESS: Final = 10  # a run on the same machine goes before it


@dataclass(frozen=True, slots=True, kw_only=True)
class BridgeOptions:
    """How the bridge is started.

    Attributes
    ----------
    runs_dir, project_dir : folders of runs and of recipes
    cell, cell_path : the cell file, read, and where it is
    from_start : receivers that are new get all that the journals have
    run_options : options of `cellctl run` that every run gets
    """

    runs_dir: Path
    project_dir: Path
    cell: Cell
    cell_path: Path
    from_start: bool = False
    run_options: tuple[str, ...] = ()


def wires_of(connect: ConnectSection, folder: Path) -> list[Wire]:
    """Return the wires that a section names; their modules are loaded here.

    Parameters
    ----------
    connect : the section
    folder : folder of the cell file, from which its files are named

    Raises
    ------
    PlantError : a wire cannot be built: a file is wrong, or a package is missing
    """
    wires: list[Wire] = []
    if connect.webhook:
        from .wires.webhook import Webhook

        wires += [Webhook(one, folder) for one in connect.webhook]
    if connect.folder:
        from .wires.folder import Folder

        wires += [Folder(one, folder) for one in connect.folder]
    if connect.mqtt is not None:
        try:
            from .wires.mqtt import mqtt_wires
        except ImportError as error:
            raise PlantError(
                f"`connect.mqtt` needs {error.name}: pip install 'cellctl[mqtt]'"
            ) from error

        wires += mqtt_wires(connect.mqtt, folder)
    if connect.plc is not None:
        from .wires.plc import PlcWire

        wires.append(PlcWire(connect.plc))
    if connect.rest is not None:
        from .wires.rest import RestWire

        wires.append(RestWire(connect.rest, folder))
    if connect.opcua is not None:
        try:
            from .wires.opcua import OpcuaWire
        except ImportError as error:
            raise PlantError(
                f"`connect.opcua` needs {error.name}: pip install 'cellctl[opcua]'"
            ) from error
        wires.append(OpcuaWire(connect.opcua, folder))
    return wires


def serve_bridge(options: BridgeOptions, ready: Callable[[list[str]], None]) -> None:
    """Serve the wires of a cell until SIGINT or SIGTERM.

    Parameters
    ----------
    options : what to serve
    ready : called with the names of the wires, once they begin

    Raises
    ------
    PlantError : the cell file names no wire, or one that cannot be built
    OutboxError : another bridge serves this folder, or the bridge's own file cannot be used
    """
    connect = options.cell.connect
    if connect is None:
        raise PlantError(
            f"{options.cell_path}: has no section `connect`; add one with a wire, such as "
            "`connect: {rest: {}}` (docs/plant.md)"
        )
    wires = wires_of(connect, options.cell.folder)
    if connect.pictures is not None:
        wires.append(PictureKeeper(options.runs_dir))
    if not wires:
        raise PlantError(f"{options.cell_path}: `connect` names no wire (docs/plant.md)")
    share_one_heap()
    book = Book(options.runs_dir)
    with book.hold(), ThreadPoolExecutor(1) as spawner:
        # a priority is a thread's own: a run that is started keeps that of this one
        spawner.submit(int).result()
        os.nice(NICENESS)
        asyncio.run(_serve(options, connect, book, wires, spawner, ready))


async def _serve(
    options: BridgeOptions,
    connect: ConnectSection,
    book: Book,
    wires: list[Wire],
    spawner: Executor,
    ready: Callable[[list[str]], None],
) -> None:
    cell, runs_dir = options.cell.name, options.runs_dir
    more = (f"--cell={options.cell_path.absolute()}", *options.run_options)
    launcher = Launcher(runs_dir, options.project_dir, more=more, executor=spawner)
    reader = StateReader(runs_dir, cell, connect.may_start)
    orders = OrderBook(runs_dir, book, cell, launcher, connect.may_start, reader.standing)
    plant = CellPlant(
        runs_dir,
        options.project_dir,
        cell,
        software_versions().get("cellctl", ""),
        file_sha256(options.cell_path),
        reader,
        orders,
        launcher,
        Accounts(accounts_path()),
    )
    boxes = [
        Outbox(runs_dir, book, wire, cell, from_start=options.from_start)
        for wire in wires
        if isinstance(wire, Courier)
    ]
    serving = asyncio.create_task(serve(plant, orders, wires, boxes))
    loop = asyncio.get_running_loop()
    for one in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(one, serving.cancel)
    ready([wire.name for wire in wires])
    with suppress(asyncio.CancelledError):
        await serving
