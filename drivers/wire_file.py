"""The file that keeps the wires of a run: appended block by block, readable after a kill.

Layout (docs/wires.md): a line that names the format, then blocks. A block is length and CRC-32 of
what follows (``<II``) and a zlib stream of rows. A row is ``<II`` (length of its head, length of
its data), the head as JSON ``[at_s, wire, kind, info]``, and the data. A block that is not whole
ends the file: it was being written when the writer was killed.
"""

import json
import queue
import struct
import threading
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final

from messages import say

MAGIC: Final = b"cellctl.wires/2\n"
_PAIR: Final = struct.Struct("<II")
GATHER_WALL_S: Final = 0.2  # longest part of a recording that a kill may lose
BLOCK_BYTES: Final = 4 << 20
MAX_WAITING_BYTES: Final = 1 << 30  # a disk that falls behind by this much ends the recording
LEVEL: Final = 1  # the lowest bits of pictures are noise: more effort gains little


class WireFileError(Exception):
    """The file is not one of wires, or cannot be written."""


@dataclass(frozen=True, slots=True)
class WireRow:
    """Something that happened.

    Attributes
    ----------
    at_s : instant on the cell's clock [s]
    wire : name of the wire, or what else it is about
    kind : kind of the event, see docs/wires.md
    info : further fields
    size : size of its data [bytes]
    place : place of its data, for `WireReader.data`
    """

    at_s: float
    wire: str
    kind: str
    info: Any
    size: int
    place: tuple[int, int]


class WireWriter:
    """Appends rows in a thread of its own, so that no driver waits for the disk.

    Parameters
    ----------
    path : path of the file

    Raises
    ------
    WireFileError : it exists already, or cannot be made
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file: IO[bytes] = path.open("xb")
            self._file.write(MAGIC)
            self._file.flush()
        except FileExistsError:
            raise WireFileError(
                say("{path}: exists already; name another file", path=path)
            ) from None
        except OSError as error:
            raise WireFileError(f"{path}: {error.strerror}") from error
        self._rows: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._waiting_bytes = 0
        self._lock = threading.Lock()
        self.problem: str | None = None
        self.row_count = 0
        self._thread = threading.Thread(target=self._write, name="wires", daemon=True)
        self._thread.start()

    def write(self, at_s: float, wire: str, kind: str, info: Any = None, data: bytes = b"") -> None:  # noqa: ANN401  (JSON)
        """Append a row; returns at once. Safe from any thread.

        Parameters
        ----------
        at_s : instant on the cell's clock [s]
        wire, kind : wire and kind of the row
        info : plain JSON values
        data : bytes
        """
        head = json.dumps([at_s, wire, kind, info], separators=(",", ":")).encode()
        row = _PAIR.pack(len(head), len(data)) + head + data
        with self._lock:
            if self.problem is not None:
                return
            self._waiting_bytes += len(row)
            if self._waiting_bytes > MAX_WAITING_BYTES:
                self.problem = "the disk is too slow"
                return
            self.row_count += 1
            self._rows.put(row)

    def close(self) -> None:
        """Write the waiting rows, and close the file."""
        self._rows.put(None)
        self._thread.join()
        self._file.close()

    def _write(self) -> None:
        is_open = True
        while is_open:
            row = self._rows.get()
            gathered, size = [], 0
            until_s = time.monotonic() + GATHER_WALL_S
            while row is not None:
                gathered.append(row)
                size += len(row)
                if size >= BLOCK_BYTES:
                    break
                try:
                    row = self._rows.get(timeout=max(0.0, until_s - time.monotonic()))
                except queue.Empty:
                    break
            is_open = row is not None
            if gathered:
                self._append(b"".join(gathered))

    def _append(self, rows: bytes) -> None:
        packed = zlib.compress(rows, LEVEL)
        try:
            if self.problem is None:
                self._file.write(_PAIR.pack(len(packed), zlib.crc32(packed)) + packed)
                self._file.flush()
        except OSError as error:
            with self._lock:
                self.problem = error.strerror or str(error)
        finally:
            with self._lock:
                self._waiting_bytes -= len(rows)


class WireReader:
    """Reads a file of wires. Data stay on the disk until requested.

    Parameters
    ----------
    path : path of the file

    Attributes
    ----------
    rows : all rows, in order
    is_whole : True if the writer closed it

    Raises
    ------
    WireFileError : it is missing or is no file of wires
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise WireFileError(f"{path}: {error.strerror}") from error
        if self._file.read(len(MAGIC)) != MAGIC:
            self._file.close()
            raise WireFileError(
                say("{path}: this is no file that `cellctl run --record` writes", path=path)
            )
        self._block: tuple[int, bytes] = (-1, b"")
        self.is_whole = False
        self.rows = tuple(self._read())

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def data(self, row: WireRow) -> bytes:
        """Return the data of a row."""
        start, at = row.place
        return self._rows_at(start)[at : at + row.size]

    def _rows_at(self, start: int) -> bytes:
        if self._block[0] != start:
            self._file.seek(start)
            rows = self._next_block()
            assert rows is not None, "a block that was read once is there"
            self._block = (start, rows)
        return self._block[1]

    def _next_block(self) -> bytes | None:
        pair = self._file.read(_PAIR.size)
        if len(pair) < _PAIR.size:
            return None
        size, crc = _PAIR.unpack(pair)
        packed = self._file.read(size)
        if len(packed) < size or zlib.crc32(packed) != crc:
            return None
        return zlib.decompress(packed)

    def _read(self) -> Iterator[WireRow]:
        while True:
            start = self._file.tell()
            block = self._next_block()
            if block is None:
                return
            at = 0
            while at < len(block):
                head_size, size = _PAIR.unpack_from(block, at)
                at += _PAIR.size
                at_s, wire, kind, info = json.loads(block[at : at + head_size])
                at += head_size
                yield WireRow(at_s, wire, kind, info, size, (start, at))
                at += size
                self.is_whole = (wire, kind) == ("run", "end")
