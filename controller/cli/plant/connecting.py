"""Connects the cell to a plant, if its file names a wire; shows deliveries and orders."""

import getpass
from pathlib import Path

from controller.config import ConfigError, load_cell
from controller.plant.model import OrderState
from controller.plant.orders import all_orders, release
from controller.plant.outbox import FOLDER, Book, OutboxError, behind, resume
from controller.plant.plant import PlantError

from ..inputs.cell_files import cell_of_this_folder
from ..serving.server import require_packages
from ..terminal.output import emit, print_line


def connect_cell(
    runs_dir: Path,
    cell_path: Path | None,
    project_dir: Path,
    speed: float,
    seed: int | None,
    *,
    from_start: bool,
    as_json: bool,
) -> int:
    """Serve the wires of a cell until a signal ends it; return 0.

    Parameters
    ----------
    runs_dir : folder of all runs
    cell_path : cell file; None for that of this folder
    project_dir : folder of recipes
    speed, seed : of the emulated cell, for runs that orders start
    from_start : receivers that are new get all that the journals have
    as_json : print what is served as JSON

    Raises
    ------
    ConfigError : a file is wrong, a package is missing, or another bridge serves this folder
    """
    from controller.plant.assembly import BridgeOptions, serve_bridge

    path = cell_path or cell_of_this_folder()
    cell = load_cell(path)
    if cell.connect is not None and cell.connect.rest is not None:
        require_packages()
    options = BridgeOptions(
        runs_dir=runs_dir,
        project_dir=project_dir,
        cell=cell,
        cell_path=path,
        from_start=from_start,
        run_options=(
            *([] if speed == 1 else [f"--speed={speed:g}"]),
            *([] if seed is None else [f"--seed={seed}"]),
        ),
    )

    def tell(wires: list[str]) -> None:
        cell, may = options.cell.name, options.cell.connect
        permit = "never" if may is None else may.may_start
        if as_json:
            emit({"event": "ready", "cell": cell, "wires": wires, "may_start": permit})
            return
        print_line(f"cell {cell} is connected: {', '.join(wires)}")
        print_line(f"orders start runs: {permit}; ctrl-c ends the connection, not the cell")

    try:
        serve_bridge(options, tell)
    except (PlantError, OutboxError) as error:
        raise ConfigError(str(error)) from error
    return 0


def show_deliveries(runs_dir: Path, resumed: str, dropped: str, *, as_json: bool) -> int:
    """Print how far each receiver is; return 0, or 1 where one is away or has refused something.

    Parameters
    ----------
    runs_dir : folder of all runs
    resumed : receiver that goes on from the journal's end; empty for none
    dropped : key of a refused notice to forget; empty for none
    as_json : print one JSON object for each

    Raises
    ------
    ConfigError : nothing was delivered from this folder, or there is no such receiver or notice
    JournalError : the journal cannot be read
    """
    book = _book(runs_dir)
    if dropped:
        found = [one for one in book.refused() if one.key == dropped]
        if not found:
            raise ConfigError(f"--drop {dropped}: no receiver has refused this")
        for one in found:
            book.drop_refused(one.courier, one.key)
    if resumed:
        known = {confirmed.courier for confirmed in book.confirmed_heads()}
        if resumed not in known:
            raise ConfigError(f"--resume {resumed}: there are {', '.join(sorted(known)) or 'none'}")
        resume(runs_dir, book, resumed)
    problems = book.problems()
    for confirmed in book.confirmed_heads():
        if not confirmed.journal:
            continue
        rows = behind(runs_dir, confirmed)
        why, since = problems.get(confirmed.courier, ("", ""))
        if as_json:
            emit(
                {"event": "receiver", "receiver": confirmed.courier, "journal": confirmed.journal,
                 "row": confirmed.head.seq, "behind": rows, "problem": why, "since": since}
            )  # fmt: skip
        else:
            words = "its journal is gone" if rows is None else f"{rows} rows behind"
            print_line(f"{confirmed.courier}: row {confirmed.head.seq}, {words}")
            if why:
                print_line(f"  since {since}: {why}")
    refused = book.refused()
    for notice in refused:
        if as_json:
            emit(
                {"event": "refused", "receiver": notice.courier, "key": notice.key,
                 "why": notice.why, "at": notice.at}
            )  # fmt: skip
        else:
            print_line(f"refused by {notice.courier} at {notice.at}: {notice.key}: {notice.why}")
    return 1 if refused or problems else 0


def show_orders(runs_dir: Path, released: tuple[str, ...], *, as_json: bool) -> int:
    """Print the orders, or those that are released; return 0.

    Parameters
    ----------
    runs_dir : folder of all runs
    released : numbers of orders to release; () for none
    as_json : print one JSON object for each

    Raises
    ------
    ConfigError : there is no such order, or it asks for no release
    """
    book = _book(runs_dir)
    try:
        found = (
            release(book, released, getpass.getuser())
            if released
            else list(all_orders(book).values())
        )
    except PlantError as error:
        raise ConfigError(str(error)) from error
    for order in found:
        if as_json:
            emit({"event": "order", **order.model_dump(mode="json", by_alias=True)})
        else:
            print_line(_words(order))
    if not found and not as_json:
        print_line("no order has come")
    return 0


def _words(order: OrderState) -> str:
    what = ", ".join(
        one.recipe if one.quantity is None else f"{one.quantity} {one.recipe}"
        for one in order.request.wanted
    )
    done = f", {order.done} of {order.quantity or '?'} done" if order.started else ""
    why = f": {order.reason}" if order.reason else ""
    return f"{order.number}: {order.state}{done}, {what}, from {order.source}{why}"


def _book(runs_dir: Path) -> Book:
    if not (runs_dir / FOLDER).is_dir():
        raise ConfigError(f"{runs_dir}: was never connected to a plant (`cellctl connect`)")
    try:
        return Book(runs_dir)
    except OutboxError as error:
        raise ConfigError(str(error)) from error
