"""An emulated ACME gripper on Modbus TCP: a second reading of its manual, for tests.

It shares no constant with the driver: what both have misread alike no test would show. Run it with
`python -m controller.cli.project.starter.drivers.gripper.emulator`.
"""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from emulators.clock import WorldClock
from emulators.modbus import Bus, Point, PointMap, Stepper, TcpServer
from emulators.steered import serve_alone

SPEED_MM_PER_S = 60.0  # manual, 2.3
STROKE_MM = 80.0


class AcmeDevice:
    """The gripper's firmware and jaws; `advance` moves them.

    Attributes
    ----------
    unit : Modbus unit
    opening_mm : between the fingers
    part_mm : width of what is between them, 0 for nothing
    is_jammed : the jaws do not move
    """

    hears_broadcast = False

    def __init__(self, unit: int = 1) -> None:
        self.unit = unit
        self.opening_mm = self.target_mm = STROKE_MM
        self.part_mm = 0.0
        self.is_jammed = False
        self._goal = [0, 0]  # 0.01 mm, 0.1 N
        self._is_on = self._has_contact = False
        words = {
            0x0000: Point(self._status),
            0x0001: Point(lambda: round(100.0 * self.opening_mm)),
            0x000A: Point(write=lambda v: self._set(0, v), accepts=lambda v: v <= 8000),
            0x000B: Point(write=lambda v: self._set(1, v), accepts=lambda v: 50 <= v <= 1000),
            0x000C: Point(write=self._command, accepts=lambda v: v in (1, 2, 3)),
            0x0064: Point(lambda: 0xAC3E),
            0x0065: Point(lambda: 0x0102),
        }
        self._map = PointMap(frozenset({0x03, 0x06, 0x10}), holdings=words)

    def request(self, pdu: bytes, now_s: float) -> bytes | None:
        """Return the reply to one request."""
        del now_s
        return self._map.answer(pdu)

    def advance(self, dt_s: float) -> None:
        """Let time pass [s]: the jaws move until they are there, or the part stops them."""
        reach_mm = 0.0 if self.is_jammed else SPEED_MM_PER_S * dt_s
        way_mm = max(-reach_mm, min(reach_mm, self.target_mm - self.opening_mm))
        self.opening_mm += way_mm
        if way_mm < 0.0 and self.opening_mm <= self.part_mm:
            self.opening_mm = self.target_mm = self.part_mm
            self._has_contact = True
        elif self._has_contact and self.part_mm < self.opening_mm:  # the part was taken out
            self._has_contact = False

    def _status(self) -> int:
        is_moving = abs(self.target_mm - self.opening_mm) > 1e-6
        return is_moving | self._has_contact << 1 | self._is_on << 2

    def _set(self, which: int, value: int) -> None:
        self._goal[which] = value

    def _command(self, verb: int) -> None:
        if verb == 2:
            self.target_mm = self.opening_mm
        elif verb == 3:
            self._is_on = True
        elif self._is_on:
            self.target_mm, self._has_contact = self._goal[0] / 100.0, False


@asynccontextmanager
async def serve(device: AcmeDevice, port: int = 0) -> AsyncIterator[str]:
    """Serve a gripper on a port of this computer, 0 for a free one; yield its address."""
    clock = WorldClock()
    server = TcpServer(Bus([device]), clock, "127.0.0.1", port)
    stepper = Stepper(clock, [device])
    await server.start()
    await stepper.start()
    try:
        yield f"127.0.0.1:{server.address[1]}"
    finally:
        await stepper.aclose()
        await server.aclose()


def main() -> None:
    """Serve one until it is ended."""
    serve_alone(lambda port: serve(AcmeDevice(), port), __doc__)


if __name__ == "__main__":
    main()
