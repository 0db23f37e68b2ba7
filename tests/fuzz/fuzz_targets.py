"""What fuzzing feeds: each target takes bytes, and only errors that callers expect end it quietly.

`benchmarks/bench_fuzz.py` runs them under atheris; `test_fuzz_corpus.py` feeds them the corpus that
is kept. A target that raises, hangs or eats memory has found something.
"""

import asyncio
import errno
import logging
import os
import socket
import struct
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from controller.cad.errors import CadError
from controller.cad.reading import check_ahead, load_solid
from controller.config import ConfigError, load_cell, load_recipe
from controller.config.view_set import load_view_set
from controller.stored.pictures import read_picture
from drivers.camera_v4l2.kernel import Device, SocketCalls, abi
from drivers.errors import DeviceError
from drivers.modbus_link import FunctionCode, Request, RtuOverTcpAddress, TcpAddress
from drivers.umi_scara.protocol import codec
from drivers.umi_scara.protocol.constants import Parameter, Simple
from emulators.camera_v4l2 import CameraConfig, V4l2Device
from emulators.clock import WorldClock
from emulators.in_process import Cell, CellOptions
from emulators.modbus import BrokenStreamError, MbapReader, RtuReader
from emulators.umi_scara import ArmModel, ArmWire
from emulators.world import LayoutError, read_layout

# as the link's connection does: it shouts with frame dumps about what is handled
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL + 1)
ROOT = Path(__file__).resolve().parents[2]
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
PICTURE_PX = (64, 48)
Target = Callable[[bytes], None]

REQUESTS = [
    *(codec.encode_simple(command) for command in Simple),
    *(codec.encode_controller_status(ctl) for ctl in range(5)),
    *(codec.encode_deferred_read(Parameter.SPEED, 2)),
    *(codec.encode_deferred_write(Parameter.SPEED, 2, -3)),
    codec.encode_immediate_read(Parameter.CURRENT_POSITION, 1),
    codec.encode_immediate_write(1, 700),
    codec.encode_numeric_go([1, 2]),
]
HOOKS = SimpleNamespace(
    packet=lambda sending, data: data,
    pdu=lambda sending, pdu: pdu,
    connected=lambda connected: None,
)
READS = (
    Request(FunctionCode.READ_HOLDING_REGISTERS, 0x07D0, 3),
    Request(FunctionCode.READ_DISCRETE_INPUTS, 0, 6),
    Request(FunctionCode.READ_COILS, 0, 8),
    Request(FunctionCode.WRITE_COIL, 0, 1, (1,)),
    Request(FunctionCode.WRITE_REGISTERS, 0x03E8, 3, (0x0900, 0xFF, 0xFFFF)),
)


def cut(data: bytes) -> Iterator[bytes]:
    """Yield the data in pieces; the first byte of each says how long it is."""
    while data:
        size = data[0] % 16 + 1
        yield data[1 : 1 + size]
        data = data[1 + size :]


# --- wires --------------------------------------------------------------------------------------


def arm_reply(data: bytes) -> None:
    """Feed the arm driver's reader whatever comes back for a request."""
    if not data:
        return
    reader = codec.ReplyReader(REQUESTS[data[0] % len(REQUESTS)])
    with suppress(DeviceError):
        for piece in cut(data[1:]):
            if piece and reader.feed(piece) is not None:
                return


def arm_line(data: bytes) -> None:
    """Send the emulated arm whatever a host may send."""
    model = ArmModel(1)
    wire, now_s = ArmWire(model), 0.0
    for piece in cut(data[:300]):
        wire.feed(piece, now_s)
        now_s += 0.02
        model.advance(0.02)
        wire.due(now_s)
    assert all(motor.position == motor.position for motor in model.axes.values())


@cache
def _loop() -> asyncio.AbstractEventLoop:
    return asyncio.new_event_loop()


def _modbus(data: bytes, *, is_rtu: bool) -> None:
    """Feed pymodbus' client, as the link has made it, what a line may bring for one request."""
    if not data:
        return
    request = READS[data[0] % len(READS)]
    found: list[ModbusPDU] = []

    async def receive() -> None:
        address = RtuOverTcpAddress("127.0.0.1", 1) if is_rtu else TcpAddress("127.0.0.1", 1)
        client = address.client(HOOKS)  # type: ignore[arg-type]  # no link behind them
        ctx = client.ctx
        ctx.request_dev_id, ctx.request_transaction_id = 1, 1
        ctx.response_future = _loop().create_future()
        # what pymodbus raises in here ends the connection, and that the link expects
        with suppress(ModbusException, ValueError, IndexError, struct.error):
            for piece in cut(data[1:]):
                ctx.datagram_received(piece, None)
        if ctx.response_future.done() and ctx.response_future.exception() is None:
            found.append(ctx.response_future.result())
        client.close()

    _loop().run_until_complete(receive())
    for pdu in found:
        if request.is_answered_by(pdu) and request.is_read and not pdu.isError():
            bits = request.function in (FunctionCode.READ_COILS, FunctionCode.READ_DISCRETE_INPUTS)
            values = pdu.bits if bits else pdu.registers
            assert len(values) >= request.count
            assert all(0 <= int(value) <= 0xFFFF for value in values)


def modbus_tcp(data: bytes) -> None:
    """Feed the Modbus link's TCP framing."""
    _modbus(data, is_rtu=False)


def modbus_rtu(data: bytes) -> None:
    """Feed the Modbus link's RTU framing."""
    _modbus(data, is_rtu=True)


def emulated_modbus(data: bytes) -> None:
    """Send the emulated buses whatever a master may send, framed and unframed."""
    cell = _still_cell()
    frames, line = MbapReader(), RtuReader()
    with suppress(BrokenStreamError):
        for piece in cut(data):
            for frame in frames.feed(piece):
                for bus in (cell.gripper_bus, cell.lights_bus, cell.io_bus):
                    if frame.pdu:
                        bus.request(frame.unit, frame.pdu, 0.0)
            line.feed(piece)
            line.silence()
    if len(data) > 2:
        for bus in (cell.gripper_bus, cell.lights_bus, cell.io_bus):
            for unit in (1, 2, 9):
                bus.request(unit, data, 0.0)


@cache
def _still_cell() -> Cell:
    folder = Path(tempfile.mkdtemp(prefix="fuzz-cell-"))
    return Cell(CellOptions(cell=CELL, is_empty=True), folder, WorldClock())


def control_port(data: bytes) -> None:
    """Send the control port of the emulated cell a line."""
    answer = _still_cell().faults.obey(data[:4000])
    assert answer["ok"] in (True, False)


# --- cameras ------------------------------------------------------------------------------------


class StillClock:
    """World time that stands."""

    def now_s(self) -> float:
        return 1.0

    def to_monotonic_s(self, world_s: float) -> float:
        return world_s


class NoPictures:
    """A source whose frames are lost."""

    def expose(self, *_: float) -> None:
        return None


NUMBERS = [int(request) for name, request in vars(abi).items() if name.startswith("VIDIOC_")]


def v4l2_device(data: bytes) -> None:
    """Let a client make any calls of the emulated camera, structs and all."""
    device = V4l2Device(NoPictures(), StillClock(), CameraConfig(sizes_px=(PICTURE_PX,)))
    handle = device.open()
    while len(data) > 1:
        number, size = NUMBERS[data[0] % len(NUMBERS)], 2 + data[1] % 208
        result, _ = device.ioctl(handle, number, data[2:size])
        assert -200 < result <= 0
        device.advance(1.0)
        device.poll(handle)
        data = data[size:]
    device.ioctl(handle, int.from_bytes(data, "little"), data)
    device.close(handle)


class Answers:
    """System calls whose structs come back as the fuzzer wants them."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def open(self, path: str) -> int:
        return 3

    def ioctl(self, fd: int, request: int, buffer: bytearray) -> None:
        fresh, self._data = self._data[: len(buffer)], self._data[len(buffer) :]
        if not fresh:
            raise OSError(errno.EINVAL, "the list's end")
        buffer[: len(fresh)] = fresh

    def close(self, fd: int) -> None:
        pass


def _use(device: Device) -> None:
    device.query_capability()
    list(device.pixel_formats())
    device.set_format(abi.PixFormat(64, 48, abi.fourcc("GREY")))
    device.set_period(0.2)
    device.request_buffers(4)
    device.query_buffer(0)
    device.dequeue()
    for control in device.list_controls():
        list(device.menu_items(control))


def v4l2_structs(data: bytes) -> None:
    """Answer the camera driver's calls with any structs."""
    with suppress(OSError, DeviceError):
        _use(Device(Answers(data), "/dev/video0"))  # type: ignore[arg-type]  # what is called


class _Peer:
    """A camera at the other end of a socket that says what the fuzzer wants."""

    def __init__(self) -> None:
        self.folder = tempfile.mkdtemp(prefix="fuzz-camera-")
        self.path = f"{self.folder}/camera.sock"
        self.data = b""
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(self.path)
        self._listener.listen()
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            line, _ = self._listener.accept()
            with line, suppress(OSError):
                reading, writing = os.pipe()
                try:
                    head = self.data[:1]
                    if head != b"\x00":  # a proper answer first, so that more is asked
                        socket.send_fds(line, [bytes(8)], [reading])
                    line.sendall(self.data)
                    line.shutdown(socket.SHUT_WR)
                finally:
                    os.close(reading)
                    os.close(writing)
                line.recv(1 << 16)


@cache
def _peer() -> _Peer:
    return _Peer()


def camera_socket(data: bytes) -> None:
    """Answer the camera driver over its socket with any bytes."""
    peer = _peer()
    peer.data = data
    calls = SocketCalls(5.0)
    with suppress(OSError, DeviceError):
        device = Device(calls, f"unix:{peer.path}")
        try:
            with suppress(OSError, DeviceError):
                _use(device)
                device.acknowledge()
        finally:
            device.close()


# --- files ----------------------------------------------------------------------------------------


@cache
def _folder() -> Path:
    memory = Path("/dev/shm")
    return Path(tempfile.mkdtemp(prefix="fuzz-", dir=memory if memory.is_dir() else None))


def _file(name: str, data: bytes) -> Path:
    path = _folder() / name
    path.write_bytes(data[:200_000])
    return path


def recipe(data: bytes) -> None:
    """Read a recipe."""
    with suppress(ConfigError):
        load_recipe(_file("recipe.yaml", data))


def cell_file(data: bytes) -> None:
    """Read a cell file, both readings of it."""
    path = _file("cell.yaml", data)
    with suppress(ConfigError):
        load_cell(path)
    with suppress(LayoutError):
        read_layout(path)


def view_set(data: bytes) -> None:
    """Read a set of stored views."""
    with suppress(ConfigError):
        load_view_set(_file("SET.json", data))


def _cad(name: str) -> Target:
    def read(data: bytes) -> None:
        with suppress(CadError):
            load_solid(_file(name, data))

    read.__doc__ = f"Read {name}."
    return read


def step_ahead(data: bytes) -> None:
    """Look through a STEP file before the kernel's process is started for it."""
    path = _file("part.step", data)
    with suppress(CadError):
        check_ahead(path, ".step", len(data[:200_000]))


def picture(data: bytes) -> None:
    """Read a picture; what its header promises comes before what is decoded."""
    with suppress(ConfigError):
        read_picture(_file("picture.png", data), PICTURE_PX)


def _apart(module: str, name: str) -> Target:
    """Return a target of another module, which is imported once it is needed: it takes long."""

    def feed(data: bytes) -> None:
        getattr(import_module(module), name)(data)

    feed.__doc__ = f"Feed {name} of {module}."
    return feed


def load(name: str) -> Target:
    """Return a target with all that it needs imported."""
    if name in APART:
        import_module(APART[name])
    return TARGETS[name]


APART = dict.fromkeys(("control_requests", "control_replies"), "control_targets")
TARGETS: dict[str, Target] = {
    "arm_reply": arm_reply,
    "arm_line": arm_line,
    "modbus_tcp": modbus_tcp,
    "modbus_rtu": modbus_rtu,
    "emulated_modbus": emulated_modbus,
    "control_port": control_port,
    "control_requests": _apart("control_targets", "control_requests"),
    "control_replies": _apart("control_targets", "control_replies"),
    "v4l2_device": v4l2_device,
    "v4l2_structs": v4l2_structs,
    "camera_socket": camera_socket,
    "recipe": recipe,
    "cell_file": cell_file,
    "view_set": view_set,
    "stl": _cad("part.stl"),
    "obj": _cad("part.obj"),
    "ply": _cad("part.ply"),
    "off": _cad("part.off"),
    "csg": _cad("part.csg.yaml"),
    "step_ahead": step_ahead,
    "picture": picture,
}
