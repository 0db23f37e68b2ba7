"""Views of an interrupted run, judged again from stored pictures."""

import asyncio
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from controller.arrays import Grey
from controller.cell.compute import Compute
from controller.cell.devices.lamps import STATION_PANEL, TABLE_LAMPS, TABLE_PANEL
from controller.cell.journal.rows import FilesStored, TablePictures
from controller.cell.recovery import Interrupted, TakenView
from controller.cell.services.records import BatchRecord, PartInGripper, Shown, grasp_of
from controller.config.files import read_sha256
from controller.config.view_set import unpacked
from controller.planning.model import CellLayout
from drivers.pictures import BrokenPictureError
from drivers.pictures import decode as decode_picture
from messages import say

from .judging import Background, judge_held, judge_on_table


@dataclass(frozen=True, slots=True, eq=False)
class StoredViews:
    """Takes the pictures of an interrupted part over into this run, and has them judged.

    Attributes
    ----------
    record : record that gets the views as views being judged
    compute : judges them
    background : queue for questions that do not hold up the arm
    layout : layout with camera, arm and fixed gripper
    folder : folder of this run
    """

    record: BatchRecord
    compute: Compute
    background: Background
    layout: CellLayout
    folder: Path

    async def take_over(self, left: Interrupted, source: Path) -> tuple[str, ...]:
        """Copy pictures, journal them, begin to judge every view; return the views left out.

        A view with missing or changed pictures is left out.

        Parameters
        ----------
        left : the interrupted part
        source : folder of the interrupted run
        """
        if left.table_pictures is not None:
            copied = await self._copied(left, source, left.table_pictures.root)
            if copied is not None:
                self.record.note(FilesStored(copied))
                self.record.note(TablePictures(left.table_pictures.root))
        if left.sightings is not None:
            self.record.note(left.sightings)
        missing = []
        holds: dict[int, PartInGripper] = {}
        for taken in left.views:
            row = taken.row
            copied = await self._copied(left, source, row.pictures)
            if copied is None or not row.planned:
                missing.append(row.view)
                continue
            self.record.note(FilesStored(copied))
            self.record.note(row)
            part = self.record.part
            part.files[row.view] = row.pictures
            part.planned[row.view] = unpacked(row.planned, row.sample_count)
            pictures = {
                lamp: await asyncio.to_thread(_read, self.folder / file)
                for lamp, file in row.pictures.items()
            }
            shown = self._held(taken, left, holds, pictures)
            part.pending.append(shown or self._on_table(taken, pictures))
            part.unlearned.append(part.pending[-1])
        return tuple(missing)

    async def _copied(
        self, left: Interrupted, source: Path, files: Mapping[str, str]
    ) -> dict[str, str] | None:
        """Copy files to this run's folder; return their digests, None if one has changed."""
        wanted = {file: left.digests.get(file) for file in files.values()}
        found = await asyncio.to_thread(_copy, source, self.folder, tuple(wanted))
        return found if found == wanted else None

    def _held(
        self,
        taken: TakenView,
        left: Interrupted,
        holds: dict[int, PartInGripper],
        pictures: Mapping[str, Grey],
    ) -> Shown | None:
        row = taken.row
        if row.hold is None:
            return None
        known = left.arm_hold or left.expected_hold
        assert known is not None, "a held part has had a hold"
        by_then = PartInGripper(
            grasp_of(known.grasp),
            np.array(row.hold.T_part_tcp),
            row.hold.opening_mm,
            is_measured=row.hold.is_measured,
            number=row.hold.number,
        )
        lit = {lamp: image for lamp, image in pictures.items() if lamp != STATION_PANEL}
        return judge_held(
            self.compute,
            self.background,
            self.layout,
            row.view,
            holds.setdefault(by_then.number, replace(by_then)),
            np.array(row.q),
            pictures[STATION_PANEL],
            lit,
            by_then,
            self.record.part.facts,
        )

    def _on_table(self, taken: TakenView, pictures: Mapping[str, Grey]) -> Shown:
        row, sighting = taken.row, taken.sighting
        assert sighting is not None, "a view of the table follows a sighting"
        assert sighting.T_world_part is not None
        T = np.array(sighting.T_world_part)
        # as in the run that took them: only the ring's light is judged on the table
        lit = {lamp: pictures[lamp] for lamp in TABLE_LAMPS[:1] if lamp in pictures}
        planned = self.record.part.planned[row.view]
        panel = pictures[TABLE_PANEL]
        facts = self.record.part.facts
        return judge_on_table(
            self.compute, self.background, row.view, T, planned, panel, lit, facts
        )


def _read(path: Path) -> Grey:
    """Return a picture written by this program; its digest has been checked."""
    try:
        return np.asarray(decode_picture(path.read_bytes(), "grey"), dtype=np.uint8)
    except BrokenPictureError as error:
        raise OSError(
            0, say("was written as a picture, but {error}", error=error), str(path)
        ) from error


def _copy(source: Path, target: Path, files: tuple[str, ...]) -> dict[str, str]:
    """Copy files from one run's folder to another's; return the SHA-256 of those that exist.

    Raises
    ------
    OSError : a file cannot be written
    """
    found: dict[str, str] = {}
    for file in files:
        if not (source / file).is_file():
            continue
        (target / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source / file, target / file)
        found[file] = read_sha256(target / file)
    return found
