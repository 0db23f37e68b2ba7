"""Work of the records' own process: filling the store, and drawing findings."""

import multiprocessing
import os
import signal
import threading
import time
from pathlib import Path
from typing import Final, Protocol

from controller.cell.journal import JournalError
from controller.history import HistoryError, fill, folded, open_store
from controller.memory import map_large_arrays
from controller.results.review import CROPS, Crop, PartCrops, jpeg
from controller.results.run import ResultsError

NICENESS: Final = 10


class ParentProcess(Protocol):
    """The process that this one was started by."""

    def join(self) -> None:
        """Wait until it has ended."""


def begin() -> None:
    """End with the page, however that ends; a Ctrl-C at its terminal is not for this process.

    A run on the same machine goes before it.
    """
    os.nice(NICENESS)
    map_large_arrays()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    page = multiprocessing.parent_process()
    if page is not None:
        threading.Thread(target=_end_with, args=(page,), daemon=True).start()


def _end_with(page: ParentProcess) -> None:
    page.join()
    os._exit(0)


def fill_store(url: str, runs_dir: Path) -> tuple[tuple[str, ...], float]:
    """Fill the store; return sentences on the data left out, and the processor's time [s].

    Parameters
    ----------
    url : URL of the store
    runs_dir : folder of all runs
    """
    began_s = time.process_time()
    try:
        store = open_store(url)
        try:
            problems = tuple(fill(store, runs_dir).problems)
        finally:
            store.close()
    except HistoryError as error:
        problems = (str(error),)
    return problems, time.process_time() - began_s


def draw_crop(journal: Path, run: str, part: int, finding: int, which: str) -> bytes | str:
    """Return a crop of a finding as JPEG, or why there is none.

    Parameters
    ----------
    journal : the journal of the run
    run, part, finding : names and numbers
    which : one of the crops
    """
    wanted: Crop | None = next((one for one in CROPS if one == which), None)
    if wanted is None:
        return "there is no such crop"
    try:
        record = folded(journal, run, [part])
        crops = PartCrops.of_part(record, part)
        if crops is None:
            return "there is no such part"
        found = crops.of(finding)
        if found is None:
            return "there is no such finding"
        seen = crops.marked(found, wanted)
    except (JournalError, ResultsError, OSError) as error:
        return str(error)
    return seen.why_missing if seen.image is None else jpeg(seen.image)
