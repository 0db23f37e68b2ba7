"""A driver of your own: a lamp unit that takes lines of text over TCP, and answers each with OK.

Installed beside cellctl (`pip install examples/lamp_driver`), it is `driver: bright` of `lights` in
a cell file. docs/drivers.md has the rules; `pytest --cell FILE` tries whether they are kept.
"""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass

from drivers.errors import BadReplyError, LinkError, ReplyTimeoutError
from drivers.kinds import Driver, LampUnit, Site


@dataclass(frozen=True)
class Settings:
    """What may stand under `settings:`."""

    settle_s: float = 0.05
    reply_s: float = 0.5


class BrightLamps:
    """One unit: `DIM channel percent`, answered with `OK`."""

    model = "Bright lamps"

    def __init__(self, site: Site, settings: Settings) -> None:
        self._site, self._settings = site, settings
        self._channels = {lamp.name: lamp for lamp in site.lamps}
        self._turn = asyncio.Lock()  # one line of text in flight

    @property
    def names(self) -> tuple[str, ...]:
        """Of all lamps."""
        return tuple(self._channels)

    async def connect(self) -> str:
        """Ask who it is; switch nothing."""
        return await self._ask("ID")

    async def set(self, levels: Mapping[str, float], *, settle: bool = False) -> float:
        """Set lamps to levels 0 to 1; return the instant from which on the light is so."""
        if wrong := [name for name, level in levels.items() if not 0 <= level <= 1]:
            raise ValueError(f"{self.model}: {', '.join(wrong)}: a level is 0 to 1")
        for name, level in levels.items():
            lamp = self._channels[name]
            await self._ask(f"DIM {lamp.analog} {100 * level * lamp.drive:.0f}")
        steady_s = self._site.clock.now_s() + self._settings.settle_s
        if settle:
            await self._site.clock.sleep(self._settings.settle_s)
        return steady_s

    async def all_off(self) -> float:
        """Switch every lamp off."""
        return await self.set(dict.fromkeys(self.names, 0.0))

    async def _ask(self, words: str) -> str:
        host, _, port = self._site.address.rpartition(":")
        async with self._turn:
            try:
                async with self._site.clock.timeout(self._settings.reply_s):
                    reader, writer = await asyncio.open_connection(host, int(port))
                    writer.write(f"{words}\n".encode())
                    reply = (await reader.readline()).decode().strip()
                    writer.close()
            except TimeoutError as error:
                raise ReplyTimeoutError(f"{self.model}: no answer to `{words}`") from error
            except OSError as error:
                raise LinkError(f"{self.model}: {self._site.address}: {error}") from error
        if not reply.startswith("OK"):
            raise BadReplyError(f"{self.model}: `{words}` was answered with `{reply}`")
        return reply


DRIVER: Driver[LampUnit, Settings] = Driver(Settings, BrightLamps)
