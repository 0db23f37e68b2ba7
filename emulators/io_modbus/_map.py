"""Factory register map of a Moxa ioLogik E1214: modbus_devices.md 7.1.

32-bit values stand high word first. Peer-to-peer I/O is not emulated: its status bits read 0.
Left open by the page and chosen here: the first of two characters is in the high byte, and text is
filled up with zeros; bits 6 to 15 of the relay word have no effect; counters are stopped as
delivered; while the watchdog's flag is up, commands to relays are answered and change nothing, as
on sister series.

Sections (§) are those of modbus_devices.md.
"""

import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

from emulators.modbus import COIL_ON, Point, PointMap, coil

from ._state import CHANNEL_COUNT, BlockState, EdgeCounter, RelayChannel

_FUNCTIONS: Final = frozenset({0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F, 0x10})


@dataclass(frozen=True, slots=True, kw_only=True)
class E1214Config:
    """Identity and settings that the web console would hold.

    Attributes
    ----------
    watchdog_s : host-connection watchdog [world s]; None: off, as delivered
    model : as it names itself
    safe_state : relays when the watchdog bites; one for each channel that the block has
    wired : inputs that the cell's six contacts are on, in the order of §7.4
    motor_relay : relay whose contact is in the supply of the arm's motors; None: none is
    mac, ip, firmware, build, device_name : as read back at 5024 to 5040
    """

    watchdog_s: float | None = None
    model: str = "E1214"
    safe_state: tuple[bool, ...] = (False,) * CHANNEL_COUNT
    wired: tuple[int, ...] = (0, 1, 2, 3, 4, 5)
    motor_relay: int | None = None
    mac: bytes = bytes.fromhex("0090e8000001")
    ip: bytes = bytes((192, 168, 127, 254))
    firmware: int = 0x0302_0000
    build: int = 0x2212_0100
    device_name: str = "cell-io"


E1212: Final = E1214Config(model="E1212", safe_state=(False,) * 8)  # §7.2


Inputs = Callable[[], tuple[bool, ...]]
Points = dict[int, Point]


def build_map(state: BlockState, inputs: Inputs, config: E1214Config) -> PointMap:
    """Return the map over a block's state.

    Parameters
    ----------
    state : model behind the registers
    inputs : gives the six inputs as they are now
    config : identity
    """
    coils = {4144: Point(lambda: state.has_watchdog_bitten, state.clear_watchdog, _is_on)}
    discretes: dict[int, Point] = {}
    holdings = {
        32: Point(lambda: _word(relay.is_closed for relay in state.relays), _relay_writer(state))
    }
    words = {48: Point(lambda: _word(inputs()))}
    for n, relay in enumerate(state.relays):
        coils |= _relay_coils(n, relay)
        holdings |= _pulse_registers(n, relay)
        words |= _switching_counts(n, relay)
    for n, counter in enumerate(state.counters):
        coils |= _counter_coils(n, counter)
        discretes |= _input_bits(n, inputs, counter)
        words |= _input_count(n, counter)
    for n in range(state.channel_count):
        coils[4128 + n] = _command(lambda: None)
        discretes[4096 + n] = discretes[4112 + n] = Point(lambda: 0)
    words |= _long(5020, lambda: int(state.uptime_s))
    words |= _block(5000, _text(config.model, 10))
    words |= _block(5024, config.mac)
    words |= _block(5027, config.ip)
    words |= _block(5029, config.firmware.to_bytes(4, "big"))
    words |= _block(5031, config.build.to_bytes(4, "big"))
    words |= _block(5040, _text(config.device_name, 30))
    return PointMap(_FUNCTIONS, coils, discretes, holdings, words)


def _relay_coils(n: int, relay: RelayChannel) -> Points:
    return {
        n: coil(lambda: relay.is_closed, lambda word: relay.command(word == COIL_ON)),
        16 + n: coil(lambda: relay.is_pulsing, lambda word: relay.set_pulsing(word == COIL_ON)),
        48 + n: _command(relay.clear_current_count),
    }


def _counter_coils(n: int, counter: EdgeCounter) -> Points:
    return {
        256 + n: coil(lambda: counter.is_running, lambda word: counter.run(word == COIL_ON)),
        272 + n: _command(counter.clear_count),
        288 + n: _command(counter.clear_overflow),
    }


def _input_bits(n: int, inputs: Inputs, counter: EdgeCounter) -> Points:
    return {n: Point(lambda: inputs()[n]), 1000 + n: Point(lambda: counter.has_overflowed)}


def _input_count(n: int, counter: EdgeCounter) -> Points:
    return _long(16 + 2 * n, lambda: counter.count)


def _switching_counts(n: int, relay: RelayChannel) -> Points:
    return _long(64 + 2 * n, lambda: relay.total_count) | _long(
        96 + 2 * n, lambda: relay.current_count
    )


def _pulse_registers(n: int, relay: RelayChannel) -> Points:
    def write_high(word: int) -> None:
        relay.pulse_count = word << 16 | relay.pulse_count & 0xFFFF

    def write_low(word: int) -> None:
        relay.pulse_count = relay.pulse_count & ~0xFFFF | word

    def write_on(word: int) -> None:
        relay.on_units = word

    def write_off(word: int) -> None:
        relay.off_units = word

    return {
        36 + 2 * n: Point(lambda: relay.pulse_count >> 16, write_high),
        37 + 2 * n: Point(lambda: relay.pulse_count & 0xFFFF, write_low),
        52 + n: Point(lambda: relay.on_units, write_on),
        68 + n: Point(lambda: relay.off_units, write_off),
    }


def _command(act: Callable[[], None]) -> Point:
    """Return a coil that acts when 1 is written, refuses 0 (exception 03) and reads 0; 7.1."""
    return Point(lambda: 0, lambda _: act(), _is_on)


def _is_on(word: int) -> bool:
    return word == COIL_ON


def _relay_writer(state: BlockState) -> Callable[[int], None]:
    def write(word: int) -> None:
        for n, relay in enumerate(state.relays):
            relay.command(bool(word >> n & 1))

    return write


def _word(bits: Iterable[bool]) -> int:
    return sum(on << n for n, on in enumerate(bits))


def _long(address: int, read: Callable[[], int]) -> Points:
    return {
        address: Point(lambda: read() >> 16 & 0xFFFF),
        address + 1: Point(lambda: read() & 0xFFFF),
    }


def _block(address: int, data: bytes) -> Points:
    words = struct.unpack(f">{len(data) // 2}H", data)
    return {at: _constant(word) for at, word in enumerate(words, address)}


def _constant(word: int) -> Point:
    return Point(lambda: word)


def _text(text: str, word_count: int) -> bytes:
    return text.encode("ascii")[: 2 * word_count].ljust(2 * word_count, b"\0")
