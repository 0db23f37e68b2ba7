"""An emulated ACME camera on TCP: a second reading of its manual, for tests.

It shares no constant with the driver. Run it with
`python -m controller.cli.project.starter.drivers.camera.emulator`.
"""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

from emulators.steered import serve_alone
from emulators.tcp_listener import TcpListener


@dataclass
class AcmeDevice:
    """The camera.

    Attributes
    ----------
    width, height : of its pictures [px]
    brightness : grey level that it sees now, everywhere; a lamp is a change of it
    is_blind : exposures never end
    """

    width: int = 1280
    height: int = 1024
    brightness: int = 90
    is_blind: bool = False


class _Server(TcpListener):
    """The camera's socket."""

    ended_by = (ConnectionError, asyncio.IncompleteReadError)

    def __init__(self, device: AcmeDevice, port: int) -> None:
        super().__init__("127.0.0.1", port)
        self._device = device

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        device = self._device
        while line := await reader.readline():
            match line.decode("ascii", "replace").split():
                case ["ID"]:
                    writer.write(f"ACME {device.width} {device.height}\n".encode())
                case ["SNAP", microseconds]:
                    begun_with = device.brightness
                    await asyncio.sleep(float(microseconds) / 1e6)
                    if device.is_blind:
                        continue
                    # light that changed in mid-exposure shows in part
                    grey = (begun_with + device.brightness) // 2
                    count = device.width * device.height
                    writer.write(f"FRAME {count}\n".encode() + bytes((grey,)) * count)
                case _:
                    writer.write(b"WHAT\n")
            await writer.drain()


@asynccontextmanager
async def serve(device: AcmeDevice, port: int = 0) -> AsyncIterator[str]:
    """Serve a camera on a port of this computer, 0 for a free one; yield its address."""
    server = _Server(device, port)
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
