"""A small controller of a UR arm for the driver's tests: its four ports, scripted by the test.

It moves its joints by trapezoids, at the share of the speed that its slider has. It shares no code
with the driver: bytes are packed here from the guides' tables (ur.md), and no other emulator.
"""

from __future__ import annotations

import asyncio
import re
import struct
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

SPEED = 10.0  # cell seconds in a second
HZ = 50.0
NUMBER = r"-?\d+(?:\.\d+)?"
MOVEJ = re.compile(rf"movej\(\[(.*)\], a=({NUMBER}), v=({NUMBER})\)")
STOPJ = re.compile(rf"stopj\(({NUMBER})\)")
PAYLOAD = re.compile(rf"set_payload\(({NUMBER}), \[(.*)\]\)")
TCP = re.compile(r"set_tcp\(p\[(.*)\]\)")
TYPES = {
    "timestamp": "DOUBLE",
    "actual_q": "VECTOR6D",
    "actual_qd": "VECTOR6D",
    "robot_mode": "INT32",
    "safety_mode": "INT32",
    "runtime_state": "UINT32",
    "speed_scaling": "DOUBLE",
    "target_speed_fraction": "DOUBLE",
    "payload": "DOUBLE",
    "payload_cog": "VECTOR3D",
    "tcp_offset": "VECTOR6D",
}
CODES = {"DOUBLE": "d", "VECTOR6D": "6d", "VECTOR3D": "3d", "INT32": "i", "UINT32": "I"}


def numbers(text: str) -> list[float]:
    return [float(one) for one in text.split(",")]


@dataclass(eq=False)
class UrController:
    """The arm: what the test sets, and what the driver has made of it."""

    q: list[float] = field(default_factory=lambda: [0.0, -1.6, 1.8, -1.8, -1.57, 0.0])
    robot_mode: int = 7
    safety_mode: int = 1
    is_remote: bool = True
    slider: float = 1.0
    model: str = "UR5"
    version: tuple[int, int, int, int] = (5, 11, 1, 108318)
    lacks: frozenset[str] = frozenset()
    payload: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    tcp: tuple[float, ...] = (0.0,) * 6
    refuses: str = ""  # a line of script with this in it is not run, and this is what it says
    ends_at: float = 1.0  # share of a move after which its program ends
    is_deaf: bool = False  # stops are not obeyed
    is_mute: bool = False  # no state goes out, no line is answered
    greeting: str = "Connected: Universal Robots Dashboard Server"
    # the gripper
    position: float = 3.0
    wanted: int = 3
    part_at: float = 230.0  # position at which the jaws meet something
    sta: int = 3
    gto: int = 1
    flt: int = 0

    lines: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)
    sets: list[str] = field(default_factory=list)
    ports: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.time_s = 0.0
        self.qd = [0.0] * 6
        self.runtime_state = 1
        self._from, self._step = list(self.q), [0.0] * 6
        self._way = self._rate = 0.0  # of the leading axis
        self._a = self._v = self._brake = 1.0
        self.is_led = False  # somebody may lead the arm by hand
        self._program: list[str] = []
        self._writers: set[asyncio.StreamWriter] = set()
        self._scripts: set[asyncio.StreamWriter] = set()
        self._ticked = asyncio.Event()

    # ---- physics -------------------------------------------------------------------------------
    @property
    def lead(self) -> float:
        return max(abs(one) for one in self._step)

    def advance(self, dt_s: float) -> None:
        self.time_s += dt_s
        if self.runtime_state == 2 and self.is_led:
            pass  # its program sleeps
        elif self.runtime_state == 2 and self.safety_mode in (1, 2):
            dt = dt_s * self.slider
            left = max(0.0, self.lead * self.ends_at - self._way)
            if self._brake:
                self._rate = max(0.0, self._rate - self._brake * dt_s)
                dt = dt_s
            else:
                self._rate = min(self._v, self._rate + self._a * dt, (2 * self._a * left) ** 0.5)
            way = min(left, self._rate * dt)
            self._way += way
            share = self._way / self.lead if self.lead else 1.0
            self.q = [a + share * d for a, d in zip(self._from, self._step, strict=True)]
            speed = way / dt_s if dt_s else 0.0
            self.qd = [speed * d / self.lead if self.lead else 0.0 for d in self._step]
            if left <= 1e-9 or (self._brake and self._rate <= 0.0):
                self.q = self.q if self._brake or self.ends_at < 1 else self._goal()
                self.qd, self.runtime_state, self._rate = [0.0] * 6, 1, 0.0
        elif self.safety_mode not in (1, 2):
            self.qd, self._rate = [0.0] * 6, 0.0
            if self.safety_mode != 5:
                self.runtime_state = 1
        if self.gto and self.sta == 3:
            goal = min(float(self.wanted), self.part_at)
            reach = 600.0 * dt_s
            self.position += max(-reach, min(reach, goal - self.position))

    def _goal(self) -> list[float]:
        return [a + d for a, d in zip(self._from, self._step, strict=True)]

    @property
    def obj(self) -> int:
        goal = min(float(self.wanted), self.part_at)
        if abs(self.position - goal) > 0.5:
            return 0
        return 2 if goal < self.wanted else 3

    # ---- script --------------------------------------------------------------------------------
    def run(self, line: str, is_remote: bool) -> None:
        self.lines.append(line)
        if not (self.is_remote and is_remote):
            return
        if self.refuses and self.refuses in line:
            self.say(f"compile error: {self.refuses}")
            return
        if self._program or line.startswith("def "):
            self._program.append(line.strip())
            if line == "end":
                self.is_led, self._program = self._program[1] == "freedrive_mode()", []
                self.runtime_state = 2
            return
        self.is_led = False
        if found := MOVEJ.fullmatch(line):
            self._from = list(self.q)
            self._step = [b - a for a, b in zip(self.q, numbers(found[1]), strict=True)]
            self._a, self._v, self._brake = float(found[2]), float(found[3]), 0.0
            self._way = self._rate = 0.0
            self.runtime_state = 2
        elif found := STOPJ.fullmatch(line):
            if not self.is_deaf and self.runtime_state == 2:
                self._brake = float(found[1])
        elif found := PAYLOAD.fullmatch(line):
            self.payload = (float(found[1]), *numbers(found[2]))
        elif found := TCP.fullmatch(line):
            self.tcp = tuple(numbers(found[1]))
        else:
            self.say(f"syntax error: {line}")

    def say(self, text: str) -> None:
        """Send a text message on the script port: package 20, message 0."""
        body = struct.pack(">Qbb", 1, -2, 0) + text.encode()
        for writer in self._scripts:
            # behind a package of state, cut in two
            writer.write(struct.pack(">IB", 5 + 3, 16) + b"abc")
            writer.write(struct.pack(">IB", 5 + len(body), 20) + body[:7])
            writer.write(body[7:])

    # ---- ports ---------------------------------------------------------------------------------
    async def rtde(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        names: list[str] = []
        sending: asyncio.Task[None] | None = None

        def send(kind: str, payload: bytes) -> None:
            writer.write(struct.pack(">Hc", 3 + len(payload), kind.encode()) + payload)

        async def states() -> None:
            while True:
                if not self.is_mute:
                    send("U", b"\x01" + b"".join(self.field(name) for name in names))
                await asyncio.sleep(1 / HZ / SPEED)

        try:
            while True:
                size, kind = struct.unpack(">Hc", await reader.readexactly(3))
                payload = await reader.readexactly(size - 3)
                if kind == b"V":
                    send("V", bytes([payload == b"\x00\x02"]))
                elif kind == b"v":
                    send("v", struct.pack(">IIII", *self.version))
                elif kind == b"O":
                    names = payload[8:].decode().split(",")
                    types = ["NOT_FOUND" if n in self.lacks else TYPES[n] for n in names]
                    send("O", b"\x01" + ",".join(types).encode())
                elif kind == b"S":
                    send("S", b"\x01")
                    sending = asyncio.ensure_future(states())
        finally:
            if sending is not None:
                sending.cancel()
                await asyncio.gather(sending, return_exceptions=True)

    def field(self, name: str) -> bytes:
        values: dict[str, object] = {
            "timestamp": self.time_s,
            "actual_q": self.q,
            "actual_qd": self.qd,
            "robot_mode": self.robot_mode,
            "safety_mode": self.safety_mode,
            "runtime_state": self.runtime_state,
            "speed_scaling": 1.0,
            "target_speed_fraction": self.slider,
            "payload": self.payload[0],
            "payload_cog": self.payload[1:],
            "tcp_offset": self.tcp,
        }
        value = values[name]
        row = value if isinstance(value, list | tuple) else [value]
        return struct.pack(">" + CODES[TYPES[name]], *row)

    async def dashboard(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(f"{self.greeting}\n".encode())
        was_remote = self.is_remote
        while line := (await reader.readline()).decode().strip():
            self.asked.append(line)
            if not self.is_mute:
                is_allowed = line.startswith(("is ", "get ")) or (was_remote and self.is_remote)
                reply = self.answer(line) if is_allowed else "Command is not allowed"
                writer.write(f"{reply}\n".encode())

    def answer(self, line: str) -> str:
        is_cb3 = self.version[0] < 5
        if line == "is in remote control":
            return f"could not understand: '{line}'" if is_cb3 else str(self.is_remote).lower()
        if line == "get robot model":
            return self.model
        if line == "power on":
            self.robot_mode = 5
            return "Powering on"
        if line == "brake release":
            self.robot_mode = 7
            return "Brake releasing"
        if line == "power off":
            self.robot_mode, self.sta = 3, 0
            return "Powering off"
        if line == "stop":
            self.runtime_state, self.qd = 1, [0.0] * 6
            return "Stopped"
        if line == "close safety popup":
            return "closing safety popup"
        if line == "unlock protective stop":
            if self.safety_mode != 3:
                return "Cannot unlock protective stop until 5s after occurrence."
            self.safety_mode = 1
            return "Protective stop releasing"
        return f"could not understand: '{line}'"

    async def script(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._scripts.add(writer)
        was_remote = self.is_remote  # as it was when this connection was made
        try:
            while line := (await reader.readline()).decode().strip():
                if not self.is_mute:
                    self.run(line, was_remote)
        finally:
            self._scripts.discard(writer)

    async def gripper(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while line := (await reader.readline()).decode().strip():
            verb, *words = line.split()
            if self.is_mute:
                continue
            if self.robot_mode < 5:  # the gripper has its power from the arm
                self.sta = 0
                writer.write(b"?")
                continue
            if verb == "GET":
                value = {"POS": round(self.position), "OBJ": self.obj, "STA": self.sta}
                value |= {"FLT": self.flt, "GTO": self.gto, "ACT": int(self.sta > 0)}
                writer.write(f"{words[0]} {value[words[0]]}".encode())
                continue
            self.sets.append(" ".join(words))
            for name, text in zip(words[::2], words[1::2], strict=True):
                if name == "POS":
                    self.wanted = int(text)
                elif name == "GTO":
                    self.gto = int(text)
                    if not self.gto:
                        self.wanted = round(self.position)
                elif name == "ACT":
                    self.sta = 3 * int(text)
            writer.write(b"ack")

    # ---- server --------------------------------------------------------------------------------
    @asynccontextmanager
    async def serving(self) -> AsyncIterator[UrController]:
        handlers: dict[str, Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]]
        handlers = {
            "rtde": self.rtde,
            "dashboard": self.dashboard,
            "script": self.script,
            "gripper": self.gripper,
        }
        tasks: set[asyncio.Task[None]] = set()

        def server(name: str) -> Callable[..., Awaitable[None]]:
            async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
                task = asyncio.current_task()
                assert task is not None
                tasks.add(task)
                self._writers.add(writer)
                try:
                    await handlers[name](reader, writer)
                except (asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
                    pass
                finally:
                    tasks.discard(task)
                    self._writers.discard(writer)
                    writer.close()

            return serve

        async def physics() -> None:
            while True:
                await asyncio.sleep(1 / HZ / SPEED)
                self.advance(1 / HZ)
                ticked, self._ticked = self._ticked, asyncio.Event()
                ticked.set()

        servers = {n: await asyncio.start_server(server(n), "127.0.0.1", 0) for n in handlers}
        self.ports = {n: s.sockets[0].getsockname()[1] for n, s in servers.items()}
        moving = asyncio.ensure_future(physics())
        try:
            yield self
        finally:
            moving.cancel()
            for one in servers.values():
                one.close()
            for task in tuple(tasks):
                task.cancel()
            await asyncio.gather(moving, *tasks, return_exceptions=True)

    def close_scripts(self) -> None:
        """End the connections to the script port, as a switch to local control does."""
        for writer in tuple(self._scripts):
            writer.close()

    @property
    def script_count(self) -> int:
        return len(self._scripts)

    async def next_tick(self) -> None:
        """Wait until it has moved on by a tick."""
        await self._ticked.wait()

    def drop(self) -> None:
        """Pull the cable: all connections end."""
        for writer in tuple(self._writers):
            writer.transport.abort()
