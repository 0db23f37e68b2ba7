"""Acquiring: the pictures of the table."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import Grey
from controller.cell.custody import TrayRecord
from controller.cell.devices.lamps import TABLE_LAMPS, TABLE_PANEL
from controller.cell.errors import CellError, PartProblemError
from controller.cell.journal.rows import FirstMotion, TablePictures
from controller.cell.machine import Event
from controller.cell.services import Gate, Imaging
from controller.cell.services.records import BatchRecord
from controller.cell.services.table import Labels
from messages import joined, key, say, say_counted

# Grey level, 0..255; a light table is at 150 and more.
MIN_GLOW = 60


@dataclass(frozen=True, slots=True, eq=False)
class AcquireAction:
    """Takes the pictures of the table: backlit, then under each of its lamps.

    Attributes
    ----------
    imaging : lamps and camera
    gate : gate; nothing looks at the table during a pause: somebody may reach over it
    record : keeps the pictures with the part
    labels : have the number of the part read off it, if that is where numbers come from
    """

    imaging: Imaging
    gate: Gate
    record: BatchRecord
    labels: Labels

    async def run(self) -> Event:
        """Take the pictures of the next part, or of this one again; return ``PICTURE_TAKEN``.

        Raises
        ------
        CellError : the light table is dark
        PartProblemError : a tray that the part may have to go to is full, or nobody reads the
            serial number of the part
        """
        await self.gate.wait(_look)
        require_room(self.record.trays)
        self.record.begin_part()
        await self._read_number()
        self.record.show(
            key("taking pictures of the table"), step=0, step_count=0, remaining_s=None
        )
        part = self.record.part
        try:
            glowing = await self.imaging.shoot("overhead", {TABLE_PANEL: 1.0})
            _require_glow(glowing)
            part.pictures = {TABLE_PANEL: glowing}
            for lamp in TABLE_LAMPS:
                part.pictures[lamp] = await self.imaging.shoot("overhead", {lamp: 1.0})
        finally:
            await self.imaging.pause("overhead")
        part.look_count += 1
        again = f"_look{part.look_count}" if part.look_count > 1 else ""
        part.picture_names = {
            lamp: await self.imaging.save(part.number, lamp + again, image)
            for lamp, image in part.pictures.items()
        }
        self.record.note(TablePictures(part.picture_names))
        return Event.PICTURE_TAKEN

    async def _read_number(self) -> None:
        part = self.record.part
        if self.labels.is_wanted(part):
            self.record.show(key("waiting for the serial number of the next part"))
        await self.labels.read(part)


async def _look() -> FirstMotion:
    return FirstMotion(words=key("nothing moves yet: the cell takes pictures of the table"))


def require_room(trays: TrayRecord) -> None:
    """Check that each tray has a free nest, since no verdict is known yet.

    Raises
    ------
    PartProblemError : a tray has none
    """
    full = trays.full()
    if full:
        named = (
            say("tray {name} ({nest_count} parts)", name=name, nest_count=trays.nest_counts[name])
            for name in full
        )
        message = say_counted(
            "{trays} is full; the next part may have to go there",
            "{trays} are full; the next part may have to go there",
            count=len(full),
            trays=joined(" and ", named),
        )
        raise PartProblemError("tray_full", message)


def _require_glow(picture: Grey) -> None:
    """Raise CellError if the light table is dark: a dark table is not an empty one."""
    level = float(np.quantile(picture[::8, ::8], 0.9))
    if level < MIN_GLOW:
        raise CellError(
            say(
                "the light table is dark (grey level {level:.0f}; at least "
                "{min_glow} is required): check the lamp table_backlight, its "
                "relay and its supply, and the lens cap",
                level=level,
                min_glow=MIN_GLOW,
            )
        )
