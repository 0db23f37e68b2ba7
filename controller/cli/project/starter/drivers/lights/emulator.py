"""An emulated ACME lamp unit on Modbus TCP: a second reading of its manual, for tests.

It shares no constant with the driver: what both have misread alike no test would show. Run it with
`python -m controller.cli.project.starter.drivers.lights.emulator`.
"""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from emulators.clock import WorldClock
from emulators.modbus import Bus, Point, PointMap, TcpServer
from emulators.steered import serve_alone


class AcmeDevice:
    """The lamp unit's firmware.

    Attributes
    ----------
    unit : Modbus unit
    thousandths : brightness of each channel
    """

    hears_broadcast = False

    def __init__(self, unit: int = 1) -> None:
        self.unit = unit
        self.thousandths = [0] * 8
        words = {0xC8: Point(lambda: 0xAC11)} | {k: self._channel(k) for k in range(8)}
        self._map = PointMap(frozenset({0x03, 0x06}), holdings=words)

    def request(self, pdu: bytes, now_s: float) -> bytes | None:
        """Return the reply to one request."""
        del now_s
        return self._map.answer(pdu)

    def _channel(self, k: int) -> Point:
        def put(value: int) -> None:
            self.thousandths[k] = value

        return Point(lambda: self.thousandths[k], put, lambda value: value <= 1000)


@asynccontextmanager
async def serve(device: AcmeDevice, port: int = 0) -> AsyncIterator[str]:
    """Serve a lamp unit on a port of this computer, 0 for a free one; yield its address."""
    server = TcpServer(Bus([device]), WorldClock(), "127.0.0.1", port)
    await server.start()
    try:
        yield f"127.0.0.1:{server.address[1]}"
    finally:
        await server.aclose()


def main() -> None:
    """Serve one until it is ended."""
    serve_alone(lambda port: serve(AcmeDevice(), port), __doc__)


if __name__ == "__main__":
    main()
