"""The arm's serial line without I/O: bytes and instants in, bytes and instants out.

Framing, pacing, the choice of the listening board, and the line's faults; umi_rtx.md 1 and 7. The
meaning of a request is the peripheral's business.
"""

import logging
from collections import deque
from dataclasses import dataclass
from typing import Final

from emulators.byte_faults import LineNoise

from ._axes import IP_COUNT
from ._faults import MONITOR_BANNER, MONITOR_ERROR, Faults
from ._model import ArmModel
from ._peripheral import Peripheral, request_length

log = logging.getLogger(__name__)

BYTE_S: Final = 10 / 9600  # umi_rtx.md 1.2: ten bits at 9600 baud
LATENCY_S: Final = 0.001  # time from the last request byte to the first reply byte; umi_rtx.md 7
FRAME_S: Final = 0.008  # limit for a request's bytes, least time between starts; umi_rtx.md 1.2
EPSILON_S: Final = 1e-9
FRAME_TIMEOUT: Final = b"\x0b"
OVERRUN: Final = b"\x0c"
VALUE_WRITES: Final = range(0x58, 0x60), range(0x78, 0x80)  # requests that carry a 16-bit value
VALUE_REPLIES: Final = (0x80, 0xD0)
STOPS: Final = {0x24: "dead", 0x25: "ramp", 0x26: "free"}  # umi_rtx.md 2.3
STOPS_KEPT: Final = 1000


@dataclass(frozen=True, slots=True)
class StopHeard:
    """A stop that a board has heard.

    Attributes
    ----------
    at_s : its last bit was on the line [world s]
    ip : the board
    kind : ``dead``, ``ramp`` or ``free``
    """

    at_s: float
    ip: int
    kind: str


class ArmWire:
    """Both IPs on their common line.

    Parameters
    ----------
    model : the body
    faults : faults of the line; may be changed at any time
    strict : answer `0C` to a request that starts less than 8 ms after the one before
    listening : the IP that listens after power-up

    Attributes
    ----------
    to_arm, from_arm : faults of the line in each direction
    stops : the last ones that a board has heard
    """

    def __init__(
        self,
        model: ArmModel,
        *,
        faults: Faults | None = None,
        strict: bool = False,
        listening: int = 0,
    ) -> None:
        self.model = model
        self.faults = Faults() if faults is None else faults
        self.strict = strict
        self.listening = listening
        self.ips = [Peripheral(number, model, self.faults) for number in range(IP_COUNT)]
        self._request = bytearray()
        self._request_started_s = 0.0
        self._previous_start_s = -FRAME_S
        self._line_free_s = 0.0  # of the bytes towards the arm
        self._reply_free_s = 0.0
        self._replies: deque[tuple[float, int]] = deque()
        self._banner_sent = False
        self._is_powered = True
        self.stops: deque[StopHeard] = deque(maxlen=STOPS_KEPT)
        self.to_arm, self.from_arm = LineNoise(), LineNoise()

    # --- the line -----------------------------------------------------------------------------

    def feed(self, data: bytes, now_s: float) -> None:
        """Put request bytes on the line, where they follow each other at 9600 baud.

        Parameters
        ----------
        data : any piece of the host's byte stream
        now_s : time at which the host handed them to the line [world s], never going back
        """
        if self.faults.unplugged or not self._is_powered:
            return
        for sent in data:
            for byte, late_s in self.to_arm.pass_on(sent):
                arrival_s = max(now_s, self._line_free_s) + BYTE_S + late_s
                self._line_free_s = arrival_s
                self._hear(byte, arrival_s)

    def _hear(self, byte: int, arrival_s: float) -> None:
        self._expire(arrival_s)
        if self.faults.monitor_rom:
            self._answer_in_ascii(byte, arrival_s)
            return
        if not self._request:
            self._request_started_s = arrival_s
        self._request.append(byte)
        if len(self._request) == request_length(self._request[0]):
            request = bytes(self._request)
            self._request.clear()
            self._obey(request, arrival_s)

    def due(self, now_s: float, early_s: float = 0.0) -> bytes:
        """Return, once, the reply bytes whose time has come.

        Parameters
        ----------
        now_s : the present, by which the line's own time-out is judged [world s]
        early_s : bytes that are due within this time come along [world s]
        """
        self._expire(now_s)
        out = bytearray()
        while self._replies and self._replies[0][0] <= now_s + early_s + EPSILON_S:
            out.append(self._replies.popleft()[1])
        return bytes(out)

    def next_due_s(self) -> float | None:
        """Return the time at which `due` is next needed [world s]; None if only `feed` can tell."""
        deadline_s = self._request_started_s + FRAME_S if self._request else None
        if not self._replies:
            return deadline_s
        reply_s = self._replies[0][0]
        return reply_s if deadline_s is None else min(reply_s, deadline_s)

    # --- supply, boards -----------------------------------------------------------------------

    @property
    def is_powered(self) -> bool:
        """Whether the arm's supply is on; off, it is silent, its motors are limp."""
        return self._is_powered

    @is_powered.setter
    def is_powered(self, is_powered: bool) -> None:
        if is_powered != self._is_powered:
            self._is_powered = is_powered
            self.power_cycle()

    def power_cycle(self, listening: int = 0) -> None:
        """Switch the arm off and on: everything is forgotten, both IPs are restarted.

        The axes stay where they are, without drive; all counters read 0 there.
        """
        for ip in self.ips:
            ip.restart()
        self.listening = listening
        self._request.clear()
        self._replies.clear()
        self._banner_sent = False

    def restart(self, ip: int) -> None:
        """Let one IP lose its memory, as a dip of its supply does; its motors stop dead."""
        self.ips[ip].restart()

    def kill(self, ip: int) -> None:
        """Let the board of one IP die: silence when it listens, its motors without drive."""
        self.ips[ip].restart()
        self.ips[ip].is_dead = True

    def revive(self, ip: int) -> None:
        """Mend a dead board; it comes up restarted."""
        self.ips[ip].is_dead = False

    def run_warm(self, *, auto_toggle: bool = False, power_on: bool = True) -> None:
        """Leave both IPs as a predecessor on the line did: running, not restarted.

        Parameters
        ----------
        auto_toggle : the predecessor crashed in auto-toggle mode
        power_on : it had sent `27`
        """
        for ip in self.ips:
            ip.is_restarted = False
            ip.auto_toggle = auto_toggle
            self.model.set_power(ip.number, power_on)

    # --- requests and replies -------------------------------------------------------------------

    def _expire(self, now_s: float) -> None:
        deadline_s = self._request_started_s + FRAME_S
        if not self._request or now_s < deadline_s - EPSILON_S:
            return
        self._request.clear()
        ip = self.ips[self.listening]
        if not ip.is_dead:
            code = bytes((self.faults.restart_code,)) if ip.is_restarted else FRAME_TIMEOUT
            self._reply(code, deadline_s)

    def _obey(self, request: bytes, arrival_s: float) -> None:
        ip = self.ips[self.listening]
        start_s, previous_s = self._request_started_s, self._previous_start_s
        self._previous_start_s = start_s
        if ip.is_dead:
            return
        if self.strict and start_s - previous_s < FRAME_S - EPSILON_S:
            self._reply(OVERRUN, arrival_s + LATENCY_S)
            return
        if self.faults.corrupt_next_write and any(request[0] in ops for ops in VALUE_WRITES):
            self.faults.corrupt_next_write = False
            request = bytes((request[0], request[1] ^ 0x04, request[2]))
        if request[0] in STOPS:
            self.stops.append(StopHeard(arrival_s, ip.number, STOPS[request[0]]))
        reply, hands_over = ip.execute(request)
        log.debug("IP%d: %s -> %s", ip.number, request.hex(" "), reply.hex(" "))
        if hands_over:
            self.listening ^= 1
        if self.faults.corrupt_next_read and reply[0] & 0xF0 in VALUE_REPLIES:
            self.faults.corrupt_next_read = False
            reply = bytes((reply[0], reply[1] ^ 0x04, reply[2]))
        lost = self.faults.drop_reply_byte
        if lost is not None and lost < len(reply):
            self.faults.drop_reply_byte = None
            reply = reply[:lost] + reply[lost + 1 :]
        self._reply(reply, arrival_s + LATENCY_S)

    def _reply(self, reply: bytes, start_s: float) -> None:
        if self.faults.mute or self.faults.unplugged:
            return
        due_s = max(start_s + self.faults.reply_delay_s, self._reply_free_s)
        for sent in reply:
            for byte, late_s in self.from_arm.pass_on(sent):
                due_s += late_s
                self._replies.append((due_s, byte))
                due_s += BYTE_S
        self._reply_free_s = due_s

    def _answer_in_ascii(self, byte: int, arrival_s: float) -> None:
        if not self._banner_sent:
            self._banner_sent = True
            self._reply(MONITOR_BANNER, arrival_s + LATENCY_S)
        elif byte not in b"\r\n":
            self._reply(MONITOR_ERROR, arrival_s + LATENCY_S)
