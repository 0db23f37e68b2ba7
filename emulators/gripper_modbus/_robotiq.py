"""Robotiq 2F-85: its firmware as a Modbus master meets it.

Source: modbus_devices.md 2.1 to 2.9. It never answers with an exception: an unknown request gets no
reply. Its internal activation is not documented; the choreography (open, close, open) and its
duration are ours.

Sections (§) are those of modbus_devices.md.
"""

import struct
from dataclasses import dataclass, field
from typing import Final

from emulators.modbus import RefusedRequest, parse_range, parse_registers

from ._jaws import MIN_FORCE_N, MIN_SPEED_MM_PER_S, STROKE_MM, JawModel
from ._registers import (
    ACTIVATE,
    GO_TO,
    INPUT_COUNT,
    INPUT_START,
    MAJOR_FAULTS,
    OUTPUT_COUNT,
    OUTPUT_START,
    RELEASE,
    RELEASE_OPENS,
    Fault,
    GripperStatus,
    JawScale,
    ObjectStatus,
    current_counts,
    force_n,
    speed_mm_per_s,
)

SILENCE_LIMIT_S: Final = 1.0  # §2.4, fault 09
_EPSILON_S: Final = 1e-9  # steps of 1/240 s do not add up to round numbers


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotiqConfig:
    """Properties of one gripper.

    Attributes
    ----------
    activation_s : duration of an unhindered activation [world s]; 1 to 3 s is typical
    refresh_s : age that a status may have when it is read: registers are renewed at 200 Hz
        (§2.1); 0: every read is fresh [world s]
    scale : readings of the encoder at the ends
    """

    activation_s: float = 1.5
    refresh_s: float = 0.005
    scale: JawScale = field(default_factory=JawScale)


class RobotiqDevice:
    """The gripper's controller and its jaws; `advance` moves both.

    Parameters
    ----------
    jaws : the mechanism, shared with the world; one of its own by default
    unit : Modbus slave id
    config : time of its activation, age of its registers, scale of its encoder

    Attributes
    ----------
    unit : Modbus number
    jaws : the mechanism, shared with the world
    is_over_temperature : fault 08 while it is true
    """

    hears_broadcast = False

    def __init__(
        self, jaws: JawModel | None = None, unit: int = 9, config: RobotiqConfig | None = None
    ) -> None:
        self.unit = unit
        self.jaws = JawModel() if jaws is None else jaws
        self.is_over_temperature = False
        self._config = RobotiqConfig() if config is None else config
        self._is_powered = True
        self._boot()

    def _boot(self) -> None:
        self._output = [0] * OUTPUT_COUNT
        self._status = GripperStatus.RESET
        self._fault = Fault.NONE  # major, or of the automatic release; stays until rACT 0
        self._priority_fault = Fault.NONE  # 05 or 07
        self._is_clear = False  # rACT was written 0 since power came: only then 1 activates (§2.2)
        self._delay_left_s = 0.0  # of fault 05 out of turn
        self._legs: list[float] = []  # openings still to be visited in this activation [mm]
        self._position_echo = 0
        self._idle_s = 0.0
        self._age_s = 0.0
        self._refresh()

    # --- power and faults: what tests and the world do to it ------------------------------------

    @property
    def is_powered(self) -> bool:
        """Whether the supply is on."""
        return self._is_powered

    @is_powered.setter
    def is_powered(self, is_powered: bool) -> None:
        if is_powered == self._is_powered:
            return
        self._is_powered = is_powered
        self.jaws.stop()
        if is_powered:
            self._boot()

    def raise_fault(self, fault: int) -> None:
        """Let a fault of §2.4 happen.

        A major one (0A, 0C, 0D, 0E) stops the jaws until rACT 0, then 1. 05: for as long as an
        activation takes, actions have to wait. 07: activation is lost, as by a dip of the supply.
        08: too hot, until 00 cools it down. 09: it has heard nothing for too long. 0B: automatic
        release, which opens the jaws. 0F: an automatic release has ended where the jaws are.

        Raises
        ------
        ValueError : the page has no such code
        """
        known = Fault(fault)
        if known in MAJOR_FAULTS:
            self._fault = known
            self._legs.clear()
            self.jaws.is_driven = False  # gCU keeps the moment's current
        elif known in (Fault.NONE, Fault.OVER_TEMPERATURE):
            self.is_over_temperature = known is Fault.OVER_TEMPERATURE
        elif known is Fault.ACTION_DELAYED:
            self._delay_left_s = self._config.activation_s
            self._priority_fault = known
            self.jaws.stop()
        elif known is Fault.NOT_ACTIVATED:
            self.jaws.stop()
            self._boot()
            self._priority_fault = known
        elif known is Fault.NO_COMMUNICATION:
            self._idle_s = SILENCE_LIMIT_S
        elif known is Fault.RELEASING:
            self._release(is_opening=True)
        else:
            self._end_release()
        self._refresh()

    # --- the wire -------------------------------------------------------------------------------

    def request(self, pdu: bytes, now_s: float) -> bytes | None:
        """Return the reply to one request; None, silence, to unknown requests."""
        if not self._is_powered:
            return None
        try:
            reply = self._answer(pdu[0], pdu[1:])
        except (RefusedRequest, struct.error):
            return None
        self._idle_s = 0.0
        return reply

    def _answer(self, function: int, body: bytes) -> bytes | None:
        match function:
            case 0x03 | 0x04:
                return bytes((function,)) + self._read(*parse_range(body))
            case 0x06:
                address, value = struct.unpack(">HH", body)
                self._write(address, [value])
                return bytes((function,)) + body
            case 0x10:
                self._write(*parse_registers(body))
                return bytes((function,)) + body[:4]
            case 0x17:
                from_address, count = parse_range(body[:4])
                self._check(from_address, count)
                self._write(*parse_registers(body[4:]))
                self._refresh()  # one motion-control cycle lies between write and read (§2.1)
                return bytes((function,)) + self._read(from_address, count)
            case _:
                return None

    def _check(self, address: int, count: int) -> None:
        if address < INPUT_START or address + count > INPUT_START + INPUT_COUNT:
            raise RefusedRequest(0)

    def _read(self, address: int, count: int) -> bytes:
        self._check(address, count)
        if self._config.refresh_s == 0.0:
            self._refresh()
        start = 2 * (address - INPUT_START)
        return bytes((2 * count,)) + self._input[start : start + 2 * count]

    def _write(self, address: int, values: list[int]) -> None:
        start = address - OUTPUT_START
        if start < 0 or start + len(values) > OUTPUT_COUNT:
            raise RefusedRequest(0)
        self._output[start : start + len(values)] = values
        if start == 0 and not self._action & ACTIVATE:
            self._deactivate()
        self._obey()

    @property
    def written(self) -> bytes:
        """The first six output bytes (§2.2) as they stand."""
        return struct.pack(">3H", *self._output[:3])

    # --- the firmware ---------------------------------------------------------------------------

    @property
    def _action(self) -> int:
        return self._output[0] >> 8

    def _obey(self) -> None:
        action = self._action
        if not action & ACTIVATE:
            if action & GO_TO:
                self._priority_fault = Fault.NOT_ACTIVATED
            return
        if self._priority_fault is Fault.NOT_ACTIVATED:
            self._priority_fault = Fault.NONE
        if action & RELEASE:
            self._release(is_opening=bool(action & RELEASE_OPENS))
            return
        if self._fault is not Fault.NONE:
            return  # a major fault or an automatic release ends by rACT 0 only
        if self._delay_left_s > 0.0:
            return
        if self._status is GripperStatus.RESET:
            if not self._is_clear:
                return
            self._start_activation()
        if self._status is GripperStatus.ACTIVATING:
            if action & GO_TO:
                self._priority_fault = Fault.ACTION_DELAYED
            return
        self._go()

    def _deactivate(self) -> None:
        self._status = GripperStatus.RESET
        self._fault = Fault.NONE
        if self._priority_fault is Fault.ACTION_DELAYED:
            self._priority_fault = Fault.NONE
        self._is_clear = True
        self._delay_left_s = 0.0
        self._legs.clear()
        self.jaws.stop()

    def _go(self) -> None:
        if not self._action & GO_TO:
            self.jaws.stop()
            return
        scale = self._config.scale
        self.jaws.drive(
            scale.opening_mm(self._output[1] & 0xFF),
            speed_mm_per_s(self._output[2] >> 8),
            force_n(self._output[2] & 0xFF),
        )

    def _start_activation(self) -> None:
        self._status = GripperStatus.ACTIVATING
        self._legs = [STROKE_MM, 0.0, STROKE_MM]  # opening first lets go of what is held
        self._next_leg()

    def _next_leg(self) -> None:
        way_mm = (STROKE_MM - self.jaws.opening_mm) + 2 * STROKE_MM
        if len(self._legs) == 3:
            self._leg_speed_mm_per_s = way_mm / max(self._config.activation_s, 1e-3)
        self.jaws.drive(self._legs.pop(0), self._leg_speed_mm_per_s, MIN_FORCE_N)

    def _release(self, *, is_opening: bool) -> None:
        if self._fault in (Fault.RELEASING, Fault.RELEASED):
            return
        self._fault = Fault.RELEASING
        self._priority_fault = Fault.NONE
        self._status = GripperStatus.RESET
        self._legs.clear()
        self.jaws.drive(STROKE_MM if is_opening else 0.0, MIN_SPEED_MM_PER_S, MIN_FORCE_N)

    def _end_release(self) -> None:
        self.jaws.stop()
        self._legs.clear()
        self._status, self._fault = GripperStatus.RESET, Fault.RELEASED

    def _wait(self, dt_s: float) -> None:
        """Let the delay of fault 05 run out, then carry out the orders given meanwhile."""
        if self._delay_left_s <= 0.0:
            return
        self._delay_left_s -= dt_s
        if self._delay_left_s <= 0.0:
            self._priority_fault = Fault.NONE
            self._obey()

    def advance(self, dt_s: float) -> None:
        """Let time pass, for controller and jaws [world s]."""
        self.jaws.advance(dt_s)
        if not self._is_powered:
            return
        if self._status is GripperStatus.ACTIVATING and self._fault is Fault.NONE:
            self._activate_on()
        elif self._fault is Fault.RELEASING and (self.jaws.is_at_target or self.jaws.is_holding):
            self._end_release()
        self._wait(dt_s)
        self._idle_s += dt_s
        self._age_s += dt_s
        if self._age_s >= self._config.refresh_s - _EPSILON_S:
            self._refresh()

    def _activate_on(self) -> None:
        if self.jaws.is_holding:  # the stops are felt where no stop can be
            self.jaws.stop()
            self.raise_fault(Fault.ACTIVATION_FAILED)
        elif self.jaws.is_at_target:
            if self._legs:
                self._next_leg()
            else:
                self._status = GripperStatus.ACTIVE
                self._priority_fault = Fault.NONE
                self._go()  # a request in the meantime was only delayed

    # --- the status registers -------------------------------------------------------------------

    def _refresh(self) -> None:
        self._age_s = 0.0
        if self._status is not GripperStatus.ACTIVATING:  # until then the request is only delayed
            self._position_echo = self._output[1] & 0xFF
        status = (self._action & (ACTIVATE | GO_TO)) | self._status << 4 | self._object() << 6
        self._input = bytes(
            (
                status,
                0,
                self._shown_fault(),
                self._position_echo,
                self._config.scale.counts(self.jaws.opening_mm),
                current_counts(self.jaws.current_ma),
            )
        )

    def _shown_fault(self) -> Fault:
        if self._fault is not Fault.NONE:
            return self._fault
        if self._priority_fault is not Fault.NONE:
            return self._priority_fault
        if self.is_over_temperature:
            return Fault.OVER_TEMPERATURE
        if self._idle_s >= SILENCE_LIMIT_S - _EPSILON_S:
            return Fault.NO_COMMUNICATION
        return Fault.NONE

    def _object(self) -> ObjectStatus:
        if self._status is not GripperStatus.ACTIVE or not self._action & GO_TO:
            return ObjectStatus.MOVING  # means nothing without rGTO (§2.3)
        if self._fault is not Fault.NONE:
            return ObjectStatus.MOVING
        if self.jaws.is_at_target:
            return ObjectStatus.AT_POSITION
        if self.jaws.is_holding:
            if self.jaws.touches_while_opening:
                return ObjectStatus.TOUCHED_OPENING
            return ObjectStatus.TOUCHED_CLOSING
        return ObjectStatus.MOVING
