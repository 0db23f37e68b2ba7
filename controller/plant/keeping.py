"""Keeps the runs' pictures as the cell asks, between runs: copies new ones, deletes old ones.

`cellctl history --keep-pictures` does it, in a process of its own: the bridge stays small, and a
store of objects that hangs keeps no result from its receiver.
"""

import asyncio
import logging
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Final

from controller.cell.journal import JOURNAL_NAME
from controller.launching import CELLCTL

from .plant import Plant, PlantError

log = logging.getLogger(__name__)
PERIOD_WALL_S: Final = 600.0  # between two looks for pictures to copy or to delete
LOOK_WALL_S: Final = 0.5  # between two looks whether a run has begun meanwhile
# Time of a copy to end once it is asked to; a shell that starts jobs in the background has them
# ignore the signal that asks.
END_WALL_S: Final = 10.0
IDLE: Final = ("free", "left")  # states without a run


class PictureKeeper:
    """Keeps pictures; as a wire, an error ends it alone, and it is begun again.

    Parameters
    ----------
    runs_dir : folder of all runs
    program : begins the command line of cellctl
    period_s : pause between two looks [s of the wall]
    end_s : time of a copy to end once it is asked to [s of the wall]; then it is killed
    """

    name = "pictures"

    def __init__(
        self,
        runs_dir: Path,
        program: Sequence[str] = CELLCTL,
        period_s: float = PERIOD_WALL_S,
        end_s: float = END_WALL_S,
    ) -> None:
        self._command = (*program, "history", "--keep-pictures", "--json", "--runs", str(runs_dir))
        self._journal = runs_dir / JOURNAL_NAME
        self._period_s = period_s
        self._end_s = end_s

    async def serve(self, plant: Plant) -> None:
        """Keep the pictures until cancelled; a run that begins meanwhile goes before it.

        Raises
        ------
        PlantError : they could not be kept; the message is the command's
        """
        while True:
            if (await plant.state()).state in IDLE and self._journal.is_file():
                await self._keep(plant)
            await asyncio.sleep(self._period_s)

    async def _keep(self, plant: Plant) -> None:
        with TemporaryFile() as out, TemporaryFile() as said:
            process = self._begun(out, said)
            try:
                while process.poll() is None:
                    await asyncio.sleep(LOOK_WALL_S)
                    if (await plant.state()).state not in IDLE:
                        log.info("pictures: a run begins, the rest is kept after it")
                        return
            finally:
                await asyncio.shield(asyncio.to_thread(self._end, process))
            for line in _lines(out):
                log.info("pictures: %s", line)
            if process.returncode:
                *_, last = (f"ended with {process.returncode}", *_lines(said))
                raise PlantError(last)

    def _end(self, process: subprocess.Popen[bytes]) -> None:
        """End the command; what is copied is noted, the rest is copied next time."""
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(self._end_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _begun(self, out: IO[bytes], said: IO[bytes]) -> subprocess.Popen[bytes]:
        nothing = subprocess.DEVNULL
        return subprocess.Popen(self._command, stdin=nothing, stdout=out, stderr=said)


def _lines(file: IO[bytes]) -> list[str]:
    file.seek(0)
    return file.read().decode(errors="replace").strip().splitlines()
