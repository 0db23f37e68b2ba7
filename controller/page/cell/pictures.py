"""The pictures that a run took last, measured from their files: grey levels and sharpness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from controller.arrays import Grey
from controller.cell.journal import JOURNAL_NAME, JournalError, newest_run, read_rows_after, rows
from controller.config.files import file_within

from ..frame.drawn import grey_picture

BIN_COUNT: Final = 64
OVERHEAD, INSPECTION = "overhead", "inspection"


@dataclass(frozen=True, slots=True)
class TakenPicture:
    """A picture of a run.

    Attributes
    ----------
    camera : camera that took it
    lamp : lamp that was lit
    what : view, or table
    at : time, UTC
    file : its name within the run's folder
    """

    camera: str
    lamp: str
    what: str
    at: str
    file: str


class LastPictures:
    """Follows the newest run's rows, and keeps the last pictures of each camera.

    Parameters
    ----------
    runs_dir : folder of all runs
    """

    def __init__(self, runs_dir: Path) -> None:
        self._runs_dir = runs_dir
        self._path = runs_dir / JOURNAL_NAME
        self.run = ""
        self._seq = 0
        self._last: dict[str, tuple[TakenPicture, ...]] = {}

    def look(self) -> Sequence[TakenPicture]:
        """Return the last pictures of both cameras; rows that were read are not read again.

        Raises
        ------
        JournalError : the journal cannot be read
        """
        if not self._path.exists():
            return ()
        run = newest_run(self._path) or ""
        if run != self.run:
            self.run, self._seq, self._last = run, 0, {}
        for row in read_rows_after(self._path, self._seq, run):
            self._seq = row.seq
            at = row.t_utc
            if row.name == rows.ViewPicturesTaken.row_name:
                view, files = str(row.body.get("view", "")), row.body.get("pictures", {})
                self._last[INSPECTION] = _taken(INSPECTION, view, at, files)
            elif row.name == rows.TablePictures.row_name:
                self._last[OVERHEAD] = _taken(OVERHEAD, "", at, row.body)
        return [one for taken in self._last.values() for one in taken]

    def file(self, number: int) -> Path | None:
        """Return the file of a picture by its place in the last look, None if there is none."""
        shown = [one for taken in self._last.values() for one in taken]
        if number >= len(shown):
            return None
        return file_within(self._runs_dir / self.run, shown[number].file)

    def facts(self) -> dict[str, Any]:
        """Return the data for the screen: the run's name, and each picture with its values."""
        try:
            found = self.look()
        except JournalError as error:
            return {"run": "", "pictures": [], "problem": str(error)}
        shown = []
        for number, one in enumerate(found):
            path = self.file(number)
            shown.append(
                {
                    "number": number,
                    "camera": one.camera,
                    "lamp": one.lamp,
                    "view": one.what,
                    "at": one.at,
                    "measured": None if path is None else measured(path),
                }
            )
        return {"run": self.run, "pictures": shown, "problem": ""}


@lru_cache(maxsize=64)
def measured(path: Path) -> dict[str, Any] | None:
    """Return histogram and sharpness of a picture's file, None where it cannot be read.

    ``focus`` is the variance of the Laplacian over the mean grey level squared, in thousandths:
    it grows with sharpness, and compares pictures of one camera, one lamp and one scene only.
    ``dark`` and ``bright`` are the shares of pixels at the lowest and the highest level.
    """
    image = grey_picture(path)
    return None if image is None else measures_of(image)


def measures_of(image: Grey) -> dict[str, Any]:
    """Return histogram and sharpness of a grey picture (height, width), as `measured` does."""
    counts = np.bincount(image.ravel(), minlength=256)
    mean = float(image.mean())
    _, spread = cv2.meanStdDev(cv2.Laplacian(image, cv2.CV_16S))  # from -1020 to 1020, exactly
    return {
        "histogram": (counts.reshape(BIN_COUNT, -1).sum(axis=1) / image.size).tolist(),
        "mean": mean,
        "dark": float(counts[0] / image.size),
        "bright": float(counts[255] / image.size),
        "focus": 1000.0 * float(spread[0, 0]) ** 2 / max(mean, 1.0) ** 2,
    }


def live_facts(bodies: Sequence[dict[str, Any]], folder: Path) -> list[dict[str, Any]]:
    """Return the last picture of each camera and lamp that the doctor has taken, measured.

    Parameters
    ----------
    bodies : lines that it has printed so far
    folder : folder of its pictures
    """
    last = {(one["camera"], one["lamp"]): one for one in bodies if one.get("event") == "picture"}
    return [
        {
            "camera": camera,
            "lamp": lamp,
            "file": one["file"],
            "measured": measured(folder / one["file"]),
        }
        for (camera, lamp), one in last.items()
    ]


def _taken(camera: str, what: str, at: str, files: dict[str, Any]) -> tuple[TakenPicture, ...]:
    return tuple(
        TakenPicture(camera, str(lamp), what, at, str(file)) for lamp, file in files.items()
    )
