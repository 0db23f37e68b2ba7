"""The ACME gripper of the example in `tests/data/acme`, as a device on a TCP port."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass


@dataclass
class AcmeDevice:
    """Jaws that are where they were sent at the second look, or where the part stops them.

    With a speed they take their time.
    """

    opening_mm: float = 60.0
    target_mm: float = 60.0
    part_mm: float | None = None
    is_active: bool = False
    port: int = 0
    speed_mm_s: float | None = None
    looked_s: float = 0.0

    def answer(self, line: str) -> str:
        word, *values = line.split()
        if word == "?":
            reply = f"ACME {self.opening_mm:.2f} {int(self.is_moving)} {int(self.has_contact)} "
            reply += str(int(self.is_active))
            limit_mm = self.part_mm if self.part_mm is not None else 0.0
            self.advance(max(self.target_mm, limit_mm))
            return reply
        self.advance(self.opening_mm)
        if word == "ON":
            self.is_active = True
        elif word == "STOP":
            self.target_mm = self.opening_mm
        elif self.is_active:
            self.target_mm = float(values[0])
        return "OK"

    def advance(self, towards_mm: float) -> None:
        """Move the jaws for the time since the last look."""
        now_s = time.monotonic()
        way_mm, since_s = towards_mm - self.opening_mm, now_s - self.looked_s
        self.looked_s = now_s
        if self.speed_mm_s is not None:
            most_mm = self.speed_mm_s * since_s
            way_mm = max(-most_mm, min(most_mm, way_mm))
        self.opening_mm += way_mm

    @property
    def has_contact(self) -> bool:
        return self.part_mm is not None and self.opening_mm == self.part_mm > self.target_mm

    @property
    def is_moving(self) -> bool:
        return self.opening_mm != self.target_mm and not self.has_contact

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while line := await reader.readline():
            writer.write(f"{self.answer(line.decode())}\n".encode())
        writer.close()


@asynccontextmanager
async def acme_device() -> AsyncIterator[AcmeDevice]:
    device = AcmeDevice()
    server = await asyncio.start_server(device.serve, "127.0.0.1", 0)
    device.port = server.sockets[0].getsockname()[1]
    async with server:
        yield device
