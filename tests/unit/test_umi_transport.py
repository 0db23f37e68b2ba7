"""The serial transport over a real pseudo-terminal: bytes, silence, hang-up, exclusiveness."""

import asyncio
import os
import pty
import select
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.clock import CellClock
from drivers.errors import LinkError, UnpluggedError
from drivers.umi_scara import Ip, SerialTransport, UmiScara
from drivers.umi_scara.line import Link


class Line:
    """A pseudo-terminal: the arm's end as a descriptor, the host's end as a path."""

    def __init__(self) -> None:
        self.arm_fd, self.host_fd = pty.openpty()
        tty.setraw(self.host_fd)
        self.path = os.ttyname(self.host_fd)

    def hang_up(self) -> None:
        for fd in (self.arm_fd, self.host_fd):
            if fd >= 0:
                os.close(fd)
        self.arm_fd = self.host_fd = -1


@pytest.fixture
def line() -> Iterator[Line]:
    line = Line()
    yield line
    line.hang_up()


async def test_bytes_pass_both_ways_unchanged(line: Line) -> None:
    every_byte = bytes(range(256))
    transport = SerialTransport(line.path)
    try:
        transport.write(every_byte)
        assert os.read(line.arm_fd, 1024) == every_byte
        os.write(line.arm_fd, every_byte)
        heard = b""
        while len(heard) < len(every_byte):
            heard += await transport.read(5.0)
        assert heard == every_byte
    finally:
        await transport.aclose()


async def test_silence_reads_as_nothing(line: Line) -> None:
    transport = SerialTransport(line.path)
    try:
        assert await transport.read(0) == b""
        assert await transport.read(0.005) == b""
    finally:
        await transport.aclose()


async def test_a_read_without_patience_still_sees_what_has_arrived(line: Line) -> None:
    transport = SerialTransport(line.path)
    try:
        os.write(line.arm_fd, b"\x0b")
        assert select.select([line.host_fd], [], [], 5.0)[0]  # the kernel takes its own time
        assert await transport.read(0) == b"\x0b"
    finally:
        await transport.aclose()


async def test_what_another_look_has_taken_already_is_no_hang_up(line: Line) -> None:
    transport = SerialTransport(line.path)
    try:
        os.write(line.arm_fd, b"\x0b")
        assert select.select([line.host_fd], [], [], 5.0)[0]
        # the loop is told that the line is readable while a read without patience is under way:
        # both look, and there is something for the first one only
        transport._on_readable()
        transport._on_readable()
        assert await transport.read(0) == b"\x0b"
        transport.write(b"\x01")  # the line lives
        assert os.read(line.arm_fd, 8) == b"\x01"
    finally:
        await transport.aclose()


async def test_a_cancelled_read_loses_no_byte(line: Line) -> None:
    transport = SerialTransport(line.path)
    try:
        reading = asyncio.create_task(transport.read(5.0))
        await asyncio.sleep(0)
        os.write(line.arm_fd, b"\x21")
        reading.cancel()
        with pytest.raises(asyncio.CancelledError):
            await reading
        assert await transport.read(5.0) == b"\x21"
    finally:
        await transport.aclose()


async def test_a_line_that_hangs_up_is_unplugged_for_reader_and_writer(line: Line) -> None:
    transport = SerialTransport(line.path)
    try:
        reading = asyncio.create_task(transport.read(5.0))
        await asyncio.sleep(0)
        line.hang_up()
        with pytest.raises(UnpluggedError, match="gone"):
            await reading
        with pytest.raises(UnpluggedError):
            transport.write(b"\x01")
        with pytest.raises(UnpluggedError):
            await transport.read(0)
    finally:
        await transport.aclose()


async def test_a_link_on_a_line_that_hangs_up_says_unplugged(line: Line) -> None:
    link = Link(SerialTransport(line.path), CellClock(speed=10.0))
    try:
        line.hang_up()
        with pytest.raises(UnpluggedError):
            await link.exchange(Ip.ARM, b"\x11", repeats=True)
        with pytest.raises(UnpluggedError):
            await link.halt(b"\x24")
    finally:
        await link.aclose()


async def test_a_port_is_nobody_elses_while_it_is_open(line: Line) -> None:
    transport = SerialTransport(line.path)
    try:
        with pytest.raises(LinkError, match="cannot open"):
            SerialTransport(line.path)
    finally:
        await transport.aclose()
    again = SerialTransport(line.path)
    await again.aclose()
    await again.aclose()


async def test_a_missing_port_is_named(tmp_path: Path) -> None:
    arm = UmiScara(str(tmp_path / "ttyUSB9"))
    with pytest.raises(LinkError, match="ttyUSB9"):
        await arm.connect()


async def test_a_dead_arm_on_a_live_line_is_reported_and_the_port_let_go(line: Line) -> None:
    arm = UmiScara(line.path, clock=CellClock(speed=20.0))
    with pytest.raises(LinkError, match="check power, cable, boards"):
        await arm.connect()
    transport = SerialTransport(line.path)  # would be refused if the port were still open
    await transport.aclose()
