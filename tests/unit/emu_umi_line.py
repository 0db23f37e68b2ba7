"""A host on the emulated arm's line, for tests: hex out, hex back, time on demand."""

from emulators.umi_scara import ArmModel, ArmWire, Axis, Faults

STEP_S = 1 / 240
# umi_rtx.md 1.3
CTL = {
    Axis.ELBOW: (1, 0),
    Axis.SHOULDER: (1, 1),
    Axis.ZED: (1, 2),
    Axis.YAW: (1, 3),
    Axis.GRIPPER: (1, 4),
    Axis.WRIST1: (0, 2),
    Axis.WRIST2: (0, 3),
}


class Line:
    """Model and wire under one time; every exchange takes 10 ms."""

    def __init__(
        self, *, warm: bool = True, seed: int = 1, strict: bool = False, listening: int = 0
    ) -> None:
        self.model = ArmModel(seed=seed)
        self.faults = Faults()
        self.wire = ArmWire(self.model, faults=self.faults, strict=strict, listening=listening)
        self.now_s = 0.0
        if warm:
            self.wire.run_warm()

    def ask(self, request: str, wait_s: float = 0.010) -> str:
        """Send one request, return what came back within 10 ms, both in hex."""
        self.wire.feed(bytes.fromhex(request), self.now_s)
        self.now_s += wait_s
        self.model.advance(wait_s)
        return self.wire.due(self.now_s).hex(" ")

    def run(self, *exchanges: tuple[str, str]) -> None:
        for request, reply in exchanges:
            assert self.ask(request) == reply, f"to {request}"

    def on(self, ip: int) -> "Line":
        """Make an IP the listening one, over the line."""
        if self.ask("01") != f"{0x20 | ip:02x}":
            assert self.ask("29") == "00"
            assert self.ask("01") == f"{0x20 | ip:02x}"
        return self

    def pass_time(self, duration_s: float) -> None:
        """Let time pass in the steps of a world."""
        for _ in range(round(duration_s / STEP_S)):
            self.model.advance(STEP_S)
        self.now_s += duration_s

    def write(self, axis: Axis, parameter: int, value: int) -> None:
        ip, ctl = CTL[axis]
        self.on(ip)
        data = (value & 0xFFFF).to_bytes(2, "little").hex()
        assert self.ask(f"70{parameter:02x}00") == "e0"
        assert self.ask(f"{0x78 + ctl:02x}{data}")[0] == "f"

    def _value(self, opcode: int, axis: Axis) -> int:
        ip, ctl = CTL[axis]
        self.on(ip)
        reply = bytes.fromhex(self.ask(f"{opcode + ctl:02x}"))
        assert reply[0] >> 4 == 8
        return int.from_bytes(reply[1:], "little", signed=True)

    def counter(self, axis: Axis) -> int:
        return self._value(0x48, axis)

    def error(self, axis: Axis) -> int:
        return self._value(0x40, axis)

    def status(self, axis: Axis) -> int:
        ip, ctl = CTL[axis]
        self.on(ip)
        opcode, status, third = bytes.fromhex(self.ask(f"{0x10 + ctl:02x}"))
        assert (opcode, third) == (0x10 + ctl, 0)
        return status

    def label(self, axis: Axis, value: int) -> None:
        ip, ctl = CTL[axis]
        self.on(ip)
        data = (value & 0xFFFF).to_bytes(2, "little").hex()
        assert self.ask(f"{0x58 + ctl:02x}{data}")[0] == "a"

    def go(self, *axes: Axis) -> str:
        ip = CTL[axes[0]][0]
        self.on(ip)
        mask = sum(1 << CTL[axis][1] for axis in axes)
        return self.ask(f"{0xA0 | mask:02x}")

    def drive(self, directions: dict[Axis, int]) -> None:
        """Send the manual go that drives these axes and holds the IP's others."""
        ip = CTL[next(iter(directions))][0]
        self.on(ip)
        bits = sum((1 if d > 0 else 2) << 2 * CTL[axis][1] for axis, d in directions.items())
        assert self.ask(f"80{bits & 0xFF:02x}{bits >> 8:02x}") == "00"

    def stop_both(self, opcode: str = "24") -> None:
        for _ in range(2):
            self.run((opcode, "00"), ("29", "00"))

    def wait_for(self, bit: int, value: int, *axes: Axis, limit_s: float = 60.0) -> float:
        """Poll controller status until a bit of every axis has a value; return how long it took."""
        started_s = self.now_s
        while not all((self.status(axis) >> bit & 1) == value for axis in axes):
            assert self.now_s - started_s < limit_s, f"bit {bit} of {axes}"
            self.pass_time(12 * STEP_S)
        return self.now_s - started_s

    def true(self, axis: Axis) -> float:
        """True position, which no client sees [counts]."""
        return self.model.axes[axis].position
