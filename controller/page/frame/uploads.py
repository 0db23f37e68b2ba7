"""Reads a file that a browser sends, within a size, a time and the room on the disk."""

import asyncio
import re
import shutil
import tempfile
import zipfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from starlette.requests import ClientDisconnect, Request

from messages import say

from .screens import RequestRefusedError, Upload

NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._+()-]{0,99}")
WALL_S: Final = 300.0
PIECE_WALL_S: Final = 10.0
SPARE_BYTES: Final = 1_000_000_000  # bytes that stay free on the disk
# Largest number of files in an archive (3MF is one): more than any sound part has, and less than
# the memory holds.
ENTRY_MAX_COUNT: Final = 1_000
UNPACKED_MAX_BYTES: Final = 1_000_000_000
UNPACKED_MAX_RATIO: Final = 200


@dataclass(frozen=True, slots=True)
class Uploaded:
    """A file that was taken.

    Attributes
    ----------
    name : file name given by the person: letters, digits and a few signs, no folder
    path : path of its bytes until the answer is made
    """

    name: str
    path: Path


@asynccontextmanager
async def received(request: Request, upload: Upload) -> AsyncIterator[Uploaded]:
    """Yield the file of a request, and delete it afterwards.

    Parameters
    ----------
    request : request with the file as its body, and its `name` in the query
    upload : limits of an upload

    Raises
    ------
    RequestRefusedError : name, size, time or content is not allowed, or the disk is full
    """
    name = request.query_params.get("name", "")
    if not NAME.fullmatch(name):
        raise RequestRefusedError(
            422, "a file's name has letters, digits and ` ._+()-`, 100 at most, and no folder"
        )
    suffix = Path(name).suffix.lower()
    if suffix not in upload.suffixes:
        allowed = ", ".join(sorted(upload.suffixes))
        raise RequestRefusedError(
            415,
            say("`{suffix}`: the file ends in one of {allowed}", suffix=suffix, allowed=allowed),
        )
    with tempfile.TemporaryDirectory(prefix="cellctl-upload-") as folder:
        path = Path(folder) / f"file{suffix}"
        length = int(request.headers.get("content-length", "0"))
        if shutil.disk_usage(folder).free < length + SPARE_BYTES:
            raise RequestRefusedError(507, "the disk has too little room for the file")
        try:
            async with asyncio.timeout(WALL_S):
                await _write(request, path, upload.max_bytes)
        except TimeoutError as error:
            raise RequestRefusedError(408, "the file did not arrive in time") from error
        except ClientDisconnect as error:
            raise RequestRefusedError(400, "the file did not arrive whole") from error
        except OSError as error:
            raise RequestRefusedError(
                507, say("the file cannot be kept: {strerror}", strerror=error.strerror)
            ) from error
        require_sound_archive(path)
        yield Uploaded(name, path)


async def _write(request: Request, path: Path, max_bytes: int) -> None:
    pieces = request.stream()
    size = 0
    with path.open("xb") as file:
        while True:
            async with asyncio.timeout(PIECE_WALL_S):
                piece = await anext(pieces, None)
            if piece is None:
                return
            size += len(piece)
            if size > max_bytes:
                raise RequestRefusedError(
                    413, say("a file has {max_bytes} bytes at most", max_bytes=max_bytes)
                )
            file.write(piece)


def require_sound_archive(path: Path) -> None:
    """Check that a file, if it is an archive, unpacks to something of sound size.

    Raises
    ------
    RequestRefusedError : it has too many entries, or they are too large or packed too well
    """
    if not zipfile.is_zipfile(path):
        return
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
    except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise RequestRefusedError(
            422, say("the archive is damaged: {error}", error=error)
        ) from error
    unpacked = sum(one.file_size for one in entries)
    packed = max(1, path.stat().st_size)
    if len(entries) > ENTRY_MAX_COUNT:
        raise RequestRefusedError(
            422,
            say(
                "the archive has {entries_count} entries, {entry_max_count} at most",
                entries_count=len(entries),
                entry_max_count=ENTRY_MAX_COUNT,
            ),
        )
    if unpacked > UNPACKED_MAX_BYTES or unpacked > UNPACKED_MAX_RATIO * packed + 1_000_000:
        raise RequestRefusedError(422, "the archive unpacks to more than a part has")
