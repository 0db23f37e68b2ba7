"""An emulated ACME arm on TCP: a second reading of its manual, for tests.

It shares no constant with the driver. Run it with
`python -m controller.cli.project.starter.drivers.arm.emulator`.
"""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from emulators.clock import WorldClock
from emulators.modbus import Stepper
from emulators.steered import serve_alone
from emulators.tcp_listener import TcpListener

SPEEDS_DEG_S = (90.0, 80.0, 100.0, 180.0, 180.0, 240.0)  # manual, 2.2
JAWS_MM_S = 100.0  # manual, 2.4


class AcmeDevice:
    """The arm's controller, joints and jaws; `advance` moves them.

    Attributes
    ----------
    joints_deg : where the joints are; they start folded
    opening_mm : between the fingers
    part_mm : width of what is between them, 0 for nothing
    is_blocked : the joints do not move, as if they had met something
    """

    def __init__(self) -> None:
        self.joints_deg = [0.0, 110.0, -110.0, 0.0, 90.0, 0.0]
        self.opening_mm, self.part_mm = 40.0, 0.0
        self.is_blocked = self._has_power = False
        self._goal_deg, self._goal_mm = list(self.joints_deg), self.opening_mm
        self._share = 1.0

    def answer(self, line: str) -> str:
        """Return the answer to a line."""
        match line.split():
            case ["STATE"]:
                flags = (self._is_moving, self._is_pressing, self._has_power)
                values = [f"{value:.4f}" for value in (*self.joints_deg, self.opening_mm)]
                return " ".join([*values, *(str(int(flag)) for flag in flags)])
            case ["POWER"]:
                self._has_power = True
                return "OK"
            case ["STOP"]:
                self._halt()
                return "OK"
            case ["MOVE", *numbers] if len(numbers) == 7:
                if not self._has_power:
                    return "NO power"
                *self._goal_deg, percent = map(float, numbers)
                self._share = percent / 100.0
                return "OK"
            case ["JAWS", opening_mm, _]:
                if not self._has_power:
                    return "NO power"
                self._goal_mm = float(opening_mm)
                return "OK"
        return "NO such order"

    def advance(self, dt_s: float) -> None:
        """Let time pass [s]; the slowest joint sets the time of all, as in its controller."""
        ways = [goal - at for goal, at in zip(self._goal_deg, self.joints_deg, strict=True)]
        left_s = max(abs(way) / speed for way, speed in zip(ways, SPEEDS_DEG_S, strict=True))
        if left_s > 0.0 and not self.is_blocked:
            step = min(1.0, self._share * dt_s / left_s)
            self.joints_deg = [
                at + step * way for at, way in zip(self.joints_deg, ways, strict=True)
            ]
        reach_mm = JAWS_MM_S * dt_s
        way_mm = max(-reach_mm, min(reach_mm, self._goal_mm - self.opening_mm))
        self.opening_mm = max(self.opening_mm + way_mm, self.part_mm)
        if self.opening_mm == self.part_mm:
            self._goal_mm = max(self._goal_mm, self.part_mm)

    def _halt(self) -> None:
        self._goal_deg, self._goal_mm = list(self.joints_deg), self.opening_mm

    @property
    def _is_moving(self) -> bool:
        goals, places = (*self._goal_deg, self._goal_mm), (*self.joints_deg, self.opening_mm)
        return any(abs(goal - at) > 1e-6 for goal, at in zip(goals, places, strict=True))

    @property
    def _is_pressing(self) -> bool:
        return not self._is_moving and self.opening_mm == self.part_mm


class _Server(TcpListener):
    """The controller's socket."""

    def __init__(self, device: AcmeDevice, port: int) -> None:
        super().__init__("127.0.0.1", port)
        self._device = device

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while line := await reader.readline():
            writer.write(f"{self._device.answer(line.decode('ascii', 'replace'))}\n".encode())
            await writer.drain()


@asynccontextmanager
async def serve(device: AcmeDevice, port: int = 0) -> AsyncIterator[str]:
    """Serve an arm on a port of this computer, 0 for a free one; yield its address."""
    server = _Server(device, port)
    stepper = Stepper(WorldClock(), [device])
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
