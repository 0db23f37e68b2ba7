"""The tool's firmware as a Modbus master meets it, and the box that switches its supply.

The jaws' speed is ours, as is what a stop does to a grasp: it stays. Both are unknown (§3.5).
Sections (§) are those of modbus_devices.md.
"""

from dataclasses import dataclass
from typing import Final

from emulators.gripper_modbus import JawModel
from emulators.modbus import Point, PointMap

SPEED_MM_PER_S: Final = 50.0  # §3.5
BOOT_S: Final = 1.0  # §3.3
FUNCTIONS: Final = frozenset({0x03, 0x06, 0x10})  # §3.1
BOX_UNIT: Final = 63
FIRMWARE: Final = 0x0100
BUILD: Final = 1

_BUSY, _GRIP = 0x01, 0x02  # §3.3
_PRESSED = {1: 0x04, 2: 0x10}
_TRIGGERED = {1: 0x08, 2: 0x20}
_GO, _STOP, _GO_WITH_OFFSET = 1, 8, 16  # §3.2


@dataclass(frozen=True, slots=True)
class RgType:
    """The differences of the two types, §3.2: product, greatest width and force in tenths."""

    product: int
    widest: int
    strongest: int


RG2: Final = RgType(0x20, 1100, 400)
RG6: Final = RgType(0x21, 1600, 1200)


class RgDevice:
    """The gripper; `advance` moves its jaws.

    Parameters
    ----------
    jaws : the mechanism, shared with the world
    kind : RG2 or RG6
    unit : unit of its side of the quick changer

    Attributes
    ----------
    unit : Modbus number
    jaws : the mechanism
    pressed : safety switches, 1 and 2, that are pressed now
    """

    hears_broadcast = False

    def __init__(self, jaws: JawModel, kind: RgType = RG2, unit: int = 65) -> None:
        self.unit = unit
        self.jaws = jaws
        self.pressed: set[int] = set()
        self._kind = kind
        self._triggered: set[int] = set()
        self._force = self._width = 0
        self._is_powered = True
        self._boot_left_s = 0.0
        zero = Point(lambda: 0)
        self._map = PointMap(
            FUNCTIONS,
            holdings={
                0x0000: Point(write=self._set_force, accepts=lambda v: v <= kind.strongest),
                0x0001: Point(write=self._set_width, accepts=lambda v: v <= kind.widest),
                0x0002: Point(
                    write=self._command, accepts=lambda v: v in (_GO, _STOP, _GO_WITH_OFFSET)
                ),
                **dict.fromkeys(range(0x0102, 0x0114), zero),
                0x010B: Point(self._tenths),
                0x010C: Point(lambda: self.status),
                0x0113: Point(self._tenths),
                **dict.fromkeys(range(0x0600, 0x0606), zero),
                0x0600: Point(lambda: kind.product),
                0x0604: Point(lambda: FIRMWARE),
                0x0605: Point(lambda: BUILD),
            },
        )

    @property
    def is_powered(self) -> bool:
        """Whether the supply is on; off, the tool is silent and its jaws stay."""
        return self._is_powered

    @is_powered.setter
    def is_powered(self, is_powered: bool) -> None:
        if is_powered != self._is_powered:
            self._is_powered = is_powered
            self.restart()

    def restart(self) -> None:
        """Switch it off and on: for a while it is silent, and triggered switches are forgotten."""
        self.jaws.stop()
        self._triggered = set(self.pressed)
        self._boot_left_s = BOOT_S

    def raise_fault(self, fault: int) -> None:
        """Trigger a safety switch, 1 or 2; the jaws stop until the power has been off.

        Raises
        ------
        ValueError : there is no such switch
        """
        if fault not in _TRIGGERED:
            raise ValueError(f"safety switch {fault}: 1 or 2")
        self._triggered.add(fault)
        self.jaws.stop()

    @property
    def status(self) -> int:
        """The word of 0x010C."""
        word = _BUSY if self._is_busy else 0
        word |= _GRIP if self._is_gripping else 0
        word |= sum(_PRESSED[switch] for switch in self.pressed)
        return word | sum(_TRIGGERED[switch] for switch in self._triggered)

    @property
    def _is_busy(self) -> bool:
        jaws = self.jaws
        return jaws.is_driven and not jaws.is_at_target and not self._is_gripping

    @property
    def _is_gripping(self) -> bool:
        return self.jaws.is_holding and self.jaws.is_pressing

    def _tenths(self) -> int:
        return round(10.0 * self.jaws.opening_mm) & 0xFFFF

    def _set_force(self, tenths: int) -> None:
        self._force = tenths

    def _set_width(self, tenths: int) -> None:
        self._width = tenths

    def _command(self, word: int) -> None:
        if word == _STOP:
            if self._is_busy:
                self.jaws.stop()
        elif not self._is_busy and not self._triggered and not self.pressed:
            self.jaws.drive(self._width / 10.0, SPEED_MM_PER_S, self._force / 10.0)

    def request(self, pdu: bytes, now_s: float) -> bytes | None:
        """Return the reply to one request; None while it has no supply or starts up."""
        del now_s
        if not self._is_powered or self._boot_left_s > 0.0:
            return None
        return self._map.answer(pdu)

    def advance(self, dt_s: float) -> None:
        """Let time pass [world s]."""
        self._boot_left_s = max(0.0, self._boot_left_s - dt_s)
        self._triggered |= self.pressed
        self.jaws.advance(dt_s)


class ComputeBoxDevice:
    """The box itself, unit 63: it can switch the tools off and on.

    Parameters
    ----------
    tool : gripper mounted on it
    """

    hears_broadcast = False

    def __init__(self, tool: RgDevice) -> None:
        self.unit = BOX_UNIT
        self._map = PointMap(
            FUNCTIONS,
            holdings={0x0000: Point(write=lambda _: tool.restart(), accepts=lambda v: v == 2)},
        )

    def request(self, pdu: bytes, now_s: float) -> bytes | None:
        """Return the reply to one request."""
        del now_s
        return self._map.answer(pdu)
