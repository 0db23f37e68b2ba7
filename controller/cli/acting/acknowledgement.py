"""`cellctl ack`: to the run that waits for it, or into the journal if no run does."""

from datetime import UTC, datetime
from pathlib import Path

from controller.cell.control import MAX_WHO, MAX_WHY, AckOrder, NoRunError, RunningCell
from controller.cell.custody.known_journals import open_noted_journal
from controller.cell.journal import JOURNAL_NAME
from controller.cell.lock import hold_cell
from controller.cell.operator import acknowledge, fold_latch
from controller.config import ConfigError, load_cell

from ..terminal.output import emit, print_line, warn
from .orders import print_decision


def acknowledge_stop(cell_file: Path, runs_dir: Path, who: str, why: str, *, as_json: bool) -> int:
    """Acknowledge what bars the next start; return 0, or 1 if nothing does.

    Parameters
    ----------
    cell_file : cell file
    runs_dir : folder of all runs and of the journal
    who : name beside the user's name
    why : the reason; not empty
    as_json : print one JSON object instead of a sentence

    Raises
    ------
    ConfigError : a text is empty or too long, or the cell file is wrong
    JournalError : the journal cannot be written
    """
    if not why.strip() or len(why) > MAX_WHY or len(who) > MAX_WHO:
        raise ConfigError(f"--why needs 1 to {MAX_WHY} characters, --who at most {MAX_WHO}")
    cell = load_cell(cell_file)
    try:
        reply = RunningCell(runs_dir).order("ack", AckOrder(who=who, why=why))
    except NoRunError:
        pass
    else:
        return print_decision(reply, "acknowledged", as_json=as_json)
    latch = fold_latch(runs_dir / JOURNAL_NAME, cell.name)
    if latch is None:
        if as_json:
            emit({"event": "ack", "acknowledged": None})
        else:
            warn("cellctl: there is nothing to acknowledge")
        return 1
    run = f"{datetime.now(UTC):%Y%m%d-%H%M%S}-ack"
    with hold_cell(runs_dir, cell, run) as holder:
        journal = open_noted_journal(runs_dir / JOURNAL_NAME, run).journal
        try:
            name = f"{who} ({holder.user})" if who else holder.user
            journal.write(acknowledge(latch, name, why))
        finally:
            journal.close()
    if as_json:
        emit({"event": "ack", "acknowledged": {"run": latch.run, "code": latch.code}})
    else:
        print_line(f"acknowledged: {latch.code} of run {latch.run} ({latch.message})")
    return 0
