"""Driver of the ACME gripper: a device nobody sells, as an example for drivers of others.

It speaks lines of text over TCP. ``?`` is answered with ``ACME opening_mm moving contact active``,
``ON`` activates, ``MOVE mm`` opens or closes, ``GRIP mm newtons`` closes on something, ``STOP``
stops; all but ``?`` are answered with ``OK``.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from drivers.clock import CellClock
from drivers.errors import BadReplyError, LinkError, ReplyTimeoutError, StalledError
from drivers.kinds import Driver, FixedGripper, Hold, Site

REPLY_S = 1.0
POLL_S = 0.05
SLIP_MM = 1.5
MIN_FORCE_N, MAX_FORCE_N = 5.0, 100.0


@dataclass(frozen=True, slots=True)
class Settings:
    """What the cell file says under ``settings:``."""

    max_opening_mm: float
    move_s: float = 5.0


@dataclass(frozen=True, slots=True)
class Reading:
    """How the gripper stands."""

    opening_mm: float
    is_moving: bool
    has_contact: bool
    is_activated: bool
    has_fault: bool = False

    @property
    def has_arrived(self) -> bool:
        """Whether the last move met nothing."""
        return self.is_activated and not self.is_moving and not self.has_contact


@dataclass(frozen=True, slots=True)
class Grasp:
    """How a grip ended."""

    object_detected: bool
    opening_mm: float


class AcmeGripper:
    """One ACME gripper."""

    model = "ACME gripper"

    def __init__(self, host: str, port: int, settings: Settings, clock: CellClock) -> None:
        self._address = host, port
        self._settings = settings
        self._clock = clock
        self._line: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None
        self._is_open = False
        self._turn = asyncio.Lock()  # one request in flight
        self._gripped_mm: float | None = None

    @property
    def max_opening_mm(self) -> float:
        """How far it opens [mm]."""
        return self._settings.max_opening_mm

    async def connect(self) -> Reading:
        """Open the line; nothing moves."""
        await self._hang_up()
        await self._dial()
        return await self.status()

    async def aclose(self) -> None:
        """Close the line; nothing moves."""
        await self._hang_up()
        self._is_open = False

    async def _dial(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        host, port = self._address
        try:
            self._line = await asyncio.open_connection(host, port)
        except OSError as error:
            raise LinkError(f"ACME gripper: {host}:{port}: {error.strerror or error}") from error
        self._is_open = True
        return self._line

    async def _hang_up(self) -> None:
        if self._line is not None:
            self._line[1].close()
            self._line = None

    async def status(self) -> Reading:
        """Ask how it stands."""
        words = (await self._ask("?")).split()
        if len(words) != 5 or words[0] != "ACME":
            raise BadReplyError(f"ACME gripper: `{' '.join(words)}` is no status")
        moving, contact, active = (word == "1" for word in words[2:])
        return Reading(float(words[1]), moving, contact, active)

    async def hold(self) -> Hold:
        """Ask whether the part of the last grip is still there."""
        status = await self.status()
        if self._gripped_mm is None:
            return Hold.NOTHING
        if not status.is_activated or status.is_moving:
            return Hold.UNKNOWN
        is_there = status.has_contact and abs(status.opening_mm - self._gripped_mm) < SLIP_MM
        return Hold.HELD if is_there else Hold.LOST

    async def wait_lost(self) -> None:
        """Wait until the gripped part is gone."""
        while await self.hold() is not Hold.LOST:
            await self._clock.sleep(POLL_S)

    async def activate(self) -> None:
        """Make it ready to move."""
        await self._ask("ON")

    async def open_to(self, opening_mm: float) -> None:
        """Move the jaws to an opening."""
        self._check(opening_mm)
        self._gripped_mm = None
        await self._ask(f"MOVE {opening_mm:.2f}")
        await self._at_rest(opening_mm)

    async def close_on(self, opening_mm: float, *, force_n: float) -> Grasp:
        """Close on a part."""
        self._check(opening_mm)
        if not MIN_FORCE_N <= force_n <= MAX_FORCE_N:
            raise ValueError(
                f"ACME gripper: {MIN_FORCE_N:g} to {MAX_FORCE_N:g} N, not {force_n:g} N"
            )
        self._gripped_mm = None
        await self._ask(f"GRIP {max(0.0, opening_mm - 5.0):.2f} {force_n:.0f}")
        status = await self._at_rest()
        self._gripped_mm = status.opening_mm if status.has_contact else None
        return Grasp(status.has_contact, status.opening_mm)

    async def stop(self) -> None:
        """Stop the jaws where they are."""
        await self._ask("STOP")

    def _check(self, opening_mm: float) -> None:
        if not 0.0 <= opening_mm <= self.max_opening_mm:
            raise ValueError(
                f"ACME gripper: it opens 0 to {self.max_opening_mm:g} mm, not {opening_mm:g} mm"
            )

    async def _at_rest(self, target_mm: float | None = None) -> Reading:
        try:
            async with self._clock.timeout(self._settings.move_s):
                while (status := await self.status()).is_moving:
                    await self._clock.sleep(POLL_S)
        except TimeoutError as error:
            await self.stop()
            raise StalledError("ACME gripper: did not arrive; stopped") from error
        except asyncio.CancelledError:
            await asyncio.shield(self.stop())
            raise
        if target_mm is not None and abs(status.opening_mm - target_mm) > SLIP_MM:
            raise StalledError(f"ACME gripper: ended at {status.opening_mm:.1f} mm")
        return status

    async def _ask(self, request: str) -> str:
        if not self._is_open:
            raise LinkError("ACME gripper: not connected")
        async with self._turn:
            reply = b""
            try:
                async with self._clock.timeout(REPLY_S):
                    reader, writer = self._line or await self._dial()
                    writer.write(f"{request}\n".encode())
                    await writer.drain()
                    reply = await reader.readline()
            except TimeoutError as error:
                raise ReplyTimeoutError(f"ACME gripper: no reply to `{request}`") from error
            except OSError as error:
                raise LinkError(f"ACME gripper: {error.strerror or error}") from error
            finally:
                if not reply.endswith(b"\n"):  # a late reply must not be the next one's
                    await self._hang_up()
        if not reply.endswith(b"\n"):
            raise LinkError("ACME gripper: the line was closed")
        return reply.decode("ascii", "replace").strip()


def build(site: Site, settings: Settings) -> AcmeGripper:
    """Return the gripper of a cell file."""
    host, _, port = site.address.rpartition(":")
    return AcmeGripper(host, int(port), settings, site.clock)


DRIVER: Driver[FixedGripper, Settings] = Driver(Settings, build)
