"""A power cut of the controller's computer: rows that were not secured may be gone.

SQLite's write-ahead log holds one transaction per row. What was synced stays; of what came after, a
power cut leaves any number of whole transactions (docs/cell-facts.md 2).
"""

import random
import shutil
import struct
from pathlib import Path
from typing import Final

from controller.cell.journal import read_rows

HEADER_BYTES: Final = 32
FRAME_HEADER_BYTES: Final = 24


def cut_power(journal: Path, rng: random.Random) -> int:
    """Take unsecured rows off a journal without writer; return the first that may be gone.

    Parameters
    ----------
    journal : journal of a controller that was killed
    rng : draws how many of them are lost
    """
    head = journal.with_name(journal.name + ".head")
    log = journal.with_name(journal.name + "-wal")
    secured = int(head.read_text().partition('"seq":')[2].partition(",")[0]) if head.exists() else 0
    last = max((row.seq for row in read_rows(journal)), default=0)
    lost_count = rng.randint(0, max(0, last - secured))
    data = log.read_bytes() if log.exists() else b""
    kept = _shortened(data, lost_count)
    for path in (journal, head):
        if path.exists():
            # a new file: the killed controller's handles are those of the old one
            copy = path.with_name(path.name + ".copy")
            shutil.copyfile(path, copy)
            copy.replace(path)
    for end in ("-wal", "-shm"):
        journal.with_name(journal.name + end).unlink(missing_ok=True)
    if kept:
        log.write_bytes(kept)
    return secured + 1


def _shortened(data: bytes, count: int) -> bytes:
    """Return a write-ahead log without its last transactions."""
    if len(data) < HEADER_BYTES:
        return b""
    (page_bytes,) = struct.unpack(">I", data[8:12])
    salt = data[16:24]
    frame_bytes = FRAME_HEADER_BYTES + page_bytes
    ends = []  # of transactions: their last frame names the size of the database
    place = HEADER_BYTES
    while place + frame_bytes <= len(data):
        (_, size), frame_salt = (
            struct.unpack(">II", data[place : place + 8]),
            data[place + 8 : place + 16],
        )
        if frame_salt != salt:
            break  # left behind by an earlier round of the log
        place += frame_bytes
        if size:
            ends.append(place)
    return data[: ends[-1 - count]] if count < len(ends) else b""
