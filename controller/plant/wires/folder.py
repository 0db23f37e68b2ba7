"""A file of each result in a folder that others watch: seen only whole, and never overwritten.

A file is written under a name that begins with a dot, brought to the disk and renamed. That is done
by a child process with a deadline, since a share that hangs hangs whoever writes to it.
"""

import asyncio
import json
import logging
import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

from controller.config.cell.connect import FolderSection

from ..model import Notice, PartResult
from ..plant import Plant, PlantError, RejectedError

log = logging.getLogger(__name__)
WRITE_WALL_S: Final = 30.0
KILL_WALL_S: Final = 2.0
UNSAFE: Final = re.compile(r"[^\w.+-]+")
EMPTY: Final = "none"
NAME_MAX: Final = 120
SUFFIX_MAX: Final = 1000
# Reads where and what from its standard input, so that nothing of it is a program's argument.
WRITER: Final = """
import json, os, sys
asked = json.loads(sys.stdin.buffer.readline())
content = sys.stdin.buffer.read()
folder, stem, ending = asked["folder"], asked["stem"], asked["ending"]
at = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
part = f".{stem}{ending}.part"
fd = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, 0o644, dir_fd=at)
with os.fdopen(fd, "wb") as file:
    file.write(content)
    file.flush()
    os.fsync(file.fileno())
for number in range(asked["most"]):
    name = f"{stem}{ending}" if number == 0 else f"{stem}~{number}{ending}"
    try:
        with open(name, "rb", opener=lambda p, f: os.open(p, f, dir_fd=at)) as there:
            same = there.read(len(content) + 1) == content
    except FileNotFoundError:
        os.rename(part, name, src_dir_fd=at, dst_dir_fd=at)
        os.fsync(at)
        break
    if same:
        os.unlink(part, dir_fd=at)
        break
else:
    sys.exit(f"{folder}: has {number} files named {stem}")
"""


class FolderError(OSError):
    """The folder cannot be written now; the notice is tried again."""


class Folder:
    """A folder that gets a file of each result.

    Parameters
    ----------
    section : the folder, and what it gets
    folder : folder of the cell file, from which it is named
    """

    def __init__(self, section: FolderSection, folder: Path) -> None:
        self._path = (folder / section.path).absolute()
        self._section = section
        self._plant: Plant | None = None
        self._has_plant = asyncio.Event()
        self._hung: asyncio.subprocess.Process | None = None
        self.name = f"folder {section.path}"

    async def serve(self, plant: Plant) -> None:
        """Keep what makes the files of other kinds than JSON."""
        if not await asyncio.to_thread(self._path.is_dir):
            log.warning("%s: is not there yet; results wait for it", self._path)
        self._plant = plant
        self._has_plant.set()
        await asyncio.Event().wait()

    async def deliver(self, notice: Notice) -> None:
        """Write the files of a result; return once they are on the disk. Alarms have no file.

        Raises
        ------
        RejectedError : the result cannot be written as such a file
        FolderError : the folder cannot be written now
        """
        if not isinstance(notice, PartResult):
            return
        await self._has_plant.wait()
        assert self._plant is not None
        stem = stem_of(self._section.name, notice)
        for kind in self._section.formats:
            if kind == "json":
                content = (notice.model_dump_json(by_alias=True, indent=1) + "\n").encode()
            else:
                try:
                    content = await self._plant.export(notice, kind)
                except PlantError as error:
                    raise RejectedError(f"{kind}: {error}") from error
            await self._write(stem, f".{kind}", content)

    async def _write(self, stem: str, ending: str, content: bytes) -> None:
        if self._hung is not None and self._hung.returncode is None:
            raise FolderError(f"{self._path}: hangs; the last file is not written yet")
        asked = {"folder": str(self._path), "stem": stem, "ending": ending, "most": SUFFIX_MAX}
        child = await asyncio.create_subprocess_exec(
            sys.executable, "-I", "-S", "-c", WRITER,
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE, start_new_session=True,
        )  # fmt: skip
        try:
            async with asyncio.timeout(WRITE_WALL_S):
                _, said = await child.communicate(json.dumps(asked).encode() + b"\n" + content)
        except TimeoutError:
            self._hung = child
            raise FolderError(f"{self._path}: hangs for {WRITE_WALL_S:.0f} s") from None
        finally:
            if child.returncode is None:
                with suppress(ProcessLookupError, TimeoutError):
                    child.kill()
                    # one that waits for a disk cannot be killed, and is left to the system
                    async with asyncio.timeout(KILL_WALL_S):
                        await child.wait()
        if child.returncode:
            lines = said.decode(errors="replace").strip().splitlines() or ["cannot be written"]
            raise FolderError(f"{self._path}: {lines[-1]}")


def stem_of(name: str, result: PartResult) -> str:
    """Return the name of a result's files without their ending; safe in every file system.

    Parameters
    ----------
    name : with the blanks of `FolderSection`
    result : fills them
    """
    values = {
        "order": result.order, "recipe": result.recipe, "serial": result.serial,
        "lot": result.lot, "run": result.run, "part": str(result.part),
        "revision": str(result.revision),
    }  # fmt: skip
    filled = name.format_map(
        {key: UNSAFE.sub("-", value or EMPTY).strip(".-") or EMPTY for key, value in values.items()}
    )
    if "{revision}" not in name and result.revision > 1:
        filled += f"_r{result.revision}"
    return UNSAFE.sub("-", filled).lstrip(".")[:NAME_MAX]
