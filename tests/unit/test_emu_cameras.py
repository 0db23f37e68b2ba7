"""The cameras of an emulated cell: of which kind, what they order, what they send over UDP."""

from __future__ import annotations

import asyncio
import socket
import struct
import threading
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emulators.camera_genicam import GenicamDevice
from emulators.camera_genicam.features import Sensor, features_of
from emulators.camera_genicam.features.table import address_of
from emulators.camera_genicam.protocol import bootstrap as boot
from emulators.camera_genicam.protocol.gvcp import PORT
from emulators.cameras import Cameras
from emulators.clock import WorldClock
from emulators.world import LayoutError, read_layout
from emulators.world.layout import DriverChoice

CELLS = Path(__file__).parents[2] / "recipes" / "cells"
LAYOUT = read_layout(CELLS / "genicam.yaml")
SENSOR = Sensor(1280, 1024, 5.0)
ADDRESSES = {one.name: address_of(k) for k, one in enumerate(features_of(SENSOR))}
PATIENCE_S = 60.0
TRAILER = 2  # of a block of packets


class Desk:
    """Takes orders, and delivers from a thread of its own, as the picture desk does."""

    def __init__(self) -> None:
        self.orders: list[tuple[int, float, float, float, int]] = []
        self.threads: list[threading.Thread] = []

    def order(
        self,
        camera: int,
        due_s: float,
        exposure_s: float,
        gain: float,
        bits: int,
        deliver: Callable[[Hashable, Any], None],
    ) -> int:
        self.orders.append((camera, due_s, exposure_s, gain, bits))
        number = len(self.orders)
        picture = self.picture(bits)
        thread = threading.Thread(target=deliver, args=(number, picture))
        self.threads.append(thread)
        thread.start()
        return number

    @staticmethod
    def picture(bits: int) -> Any:
        rng = np.random.default_rng(3)
        return rng.integers(0, 1 << bits, (1024, 1280), dtype=np.uint8 if bits == 8 else np.uint16)


def cameras_of(desk: Desk, drivers: Mapping[str, DriverChoice]) -> Cameras:
    return Cameras(LAYOUT.cameras, drivers, desk, WorldClock(), 0)  # type: ignore[arg-type]  # a desk's part


class Client:
    """Controls a camera by a socket of its own, and hears its stream on another."""

    def __init__(self, host: str) -> None:
        self._host, self._number = host, 0
        self._control = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._control.bind(("127.0.0.1", 0))
        self._stream = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._stream.bind(("127.0.0.1", 0))
        for one in (self._control, self._stream):
            one.setblocking(False)

    async def write(self, where: str | int, value: float) -> None:
        address = ADDRESSES[where] if isinstance(where, str) else where
        word = struct.pack(">f" if isinstance(value, float) else ">I", value)
        self._number += 1
        request = struct.pack(">BBHHHI", 0x42, 1, 0x82, 8, self._number, address) + word
        loop = asyncio.get_running_loop()
        await loop.sock_sendto(self._control, request, (self._host, PORT))
        async with asyncio.timeout(PATIENCE_S):
            reply = await loop.sock_recv(self._control, 600)
        assert reply[:2] == b"\0\0", where

    async def take(self) -> tuple[int, bytes]:
        """Wait for triggers, trigger once, and return the block's number and its pixels."""
        port = self._stream.getsockname()[1]
        settings: dict[str | int, float] = {
            boot.PRIVILEGE: 2,
            "ExposureAuto": 0,
            "GainAuto": 0,
            "Gamma": 1.0,
            "ExposureTime": 8000.0,
            "TriggerMode": 1,
            "TriggerSource": 1,
            boot.STREAM_PACKET_SIZE: 8000,
            boot.STREAM_ADDRESS: 0x7F000001,
            boot.STREAM_PORT: port,
            "AcquisitionStart": 1,
            "TriggerSoftware": 1,
        }
        for where, value in settings.items():
            await self.write(where, value)
        packets: dict[int, bytes] = {}
        last = None
        async with asyncio.timeout(PATIENCE_S):
            while last is None or len(packets) <= last:
                one = await asyncio.get_running_loop().sock_recv(self._stream, 9000)
                packets[int.from_bytes(one[5:8], "big")] = one
                if one[4] == TRAILER:
                    last = int.from_bytes(one[5:8], "big")
                    # a socket's buffer is smaller than a picture: what it had no room for
                    for number in set(range(last)) - set(packets):
                        await self._ask_again(one[2:4], number)
        in_order = [packets[number] for number in range(1, last)]
        return int.from_bytes(packets[0][2:4], "big"), b"".join(one[8:] for one in in_order)

    async def _ask_again(self, block: bytes, number: int) -> None:
        self._number += 1
        request = struct.pack(">BBHHH", 0x42, 0, 0x40, 12, self._number) + b"\0\0" + block
        request += struct.pack(">II", number, number)
        await asyncio.get_running_loop().sock_sendto(self._control, request, (self._host, PORT))

    def close(self) -> None:
        self._control.close()
        self._stream.close()


def test_the_genicam_cell_is_the_emulated_cell_with_one_line_changed_for_each_camera() -> None:
    one, other = (
        (CELLS / f"{name}.yaml").read_text(encoding="utf-8").splitlines()
        for name in ("emulated", "genicam")
    )
    changed = [pair for pair in zip(one, other, strict=True) if pair[0] != pair[1]]
    assert [pair[0].split(":")[0].strip() for pair in changed] == ["name", "overhead", "inspection"]
    for before, after in changed[1:]:
        assert after.replace("driver: genicam, ", "") == before


def test_a_driver_without_an_emulated_camera_is_refused() -> None:
    with pytest.raises(LayoutError, match=r"devices\.overhead\.driver `basler`.*genicam, v4l2"):
        cameras_of(Desk(), {"overhead": DriverChoice("basler")})


async def test_a_triggered_picture_shows_the_middle_of_its_exposure_and_arrives_over_udp(
    tmp_path: Path,
) -> None:
    desk = Desk()
    cameras = cameras_of(desk, LAYOUT.drivers)
    await cameras.start(tmp_path, "auto")
    running = asyncio.create_task(cameras.run())
    client = Client(cameras.addresses["inspection"])
    try:
        block, pixels = await client.take()
        assert (block, pixels) == (1, desk.picture(8).tobytes())
        (camera, due_s, exposure_s, gain, bits) = desk.orders[0]
        device = cameras.devices["inspection"]
        assert isinstance(device, GenicamDevice)
        assert (camera, gain, bits) == (1, 1.0, 8)
        assert exposure_s == pytest.approx(0.008)
        start_s = due_s - exposure_s / 2
        assert 0.0 < start_s < cameras._clock.now_s() - exposure_s
        assert cameras.transport is None  # no V4L2 camera, no FUSE
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        client.close()
        await cameras.aclose()
        for thread in desk.threads:
            thread.join()


async def test_cameras_of_both_kinds_stand_in_one_cell(tmp_path: Path) -> None:
    cameras = cameras_of(Desk(), {"inspection": DriverChoice("genicam")})
    await cameras.start(tmp_path, "socket")
    try:
        assert cameras.addresses["overhead"].startswith("unix:")
        address = cameras.addresses["inspection"]
        assert address.startswith("127.0.")
        cameras.unplug("inspection")
        assert "inspection" not in cameras.addresses
        assert not cameras.devices["inspection"].is_plugged
        assert cameras.plug("inspection") == address
        with pytest.raises(ValueError, match="plugged in"):
            cameras.plug("inspection")
    finally:
        await cameras.aclose()


async def test_two_cells_on_one_machine_take_addresses_of_their_own(tmp_path: Path) -> None:
    cells = [cameras_of(Desk(), LAYOUT.drivers) for _ in range(2)]
    for cell in cells:
        await cell.start(tmp_path, "auto")
    addresses = [address for cell in cells for address in cell.addresses.values()]
    assert len(set(addresses)) == 4
    for cell in cells:
        await cell.aclose()
