"""A bus: several devices by unit number, and the faults that the wire to each of them can have."""

import logging
from collections.abc import Iterable
from dataclasses import dataclass

from emulators.byte_faults import ByteFault

from .device import ModbusDevice, exception_pdu

BROADCAST_UNIT = 0
wire_log = logging.getLogger("emulators.modbus.wire")


@dataclass(slots=True, kw_only=True)
class WireFaults:
    """The faults between one device and its master; everything off is a sound wire.

    Attributes
    ----------
    is_deaf : requests do not reach the device: nothing happens, nothing answers
    is_mute : requests are carried out, replies are lost
    exception_code : answered in place of the device, which does not see the request
    reply_delay_s : additional delay of the reply [world s]
    reply_byte_count : only so many bytes of the reply frame arrive
    is_crc_bad : a bit of the reply flips on the wire; a TCP frame has no CRC and loses its
        protocol number instead
    reply_fault : fault of one byte of the reply frame, and its index from 0; on a connection of its
        own a device loses no byte, thanks to TCP
    reply_unit : the reply names this unit
    is_connection_dropped : the connection ends where the reply should come; the request is
        carried out
    requests_left : faults cease after so many requests; None: they stay
    """

    is_deaf: bool = False
    is_mute: bool = False
    exception_code: int | None = None
    reply_delay_s: float = 0.0
    reply_byte_count: int | None = None
    is_crc_bad: bool = False
    reply_fault: tuple[int, ByteFault] | None = None
    reply_unit: int | None = None
    is_connection_dropped: bool = False
    requests_left: int | None = None

    def spend(self) -> bool:
        """Count one request; return whether the faults hold for it."""
        if self.requests_left is None:
            return True
        if self.requests_left <= 0:
            return False
        self.requests_left -= 1
        return True


@dataclass(frozen=True, slots=True)
class BusReply:
    """A bus's reply to its server for one request.

    Attributes
    ----------
    unit, pdu : the reply
    delay_s : additional delay [world s]
    byte_count : only so many bytes of the frame arrive; None: all
    is_corrupt : the frame is damaged on the wire
    is_connection_dropped : no reply, the connection ends instead
    fault : the byte of the frame that does not come through, and what happens to it
    """

    unit: int
    pdu: bytes
    delay_s: float = 0.0
    byte_count: int | None = None
    is_corrupt: bool = False
    is_connection_dropped: bool = False
    fault: tuple[int, ByteFault] | None = None

    @property
    def is_sound(self) -> bool:
        """Whether a master on the line can read it."""
        return not self.is_corrupt and self.byte_count is None and self.fault is None


class Bus:
    """Devices on one line. A unit that nobody has is silence.

    Attributes
    ----------
    devices : those attached; a device may be unplugged and plugged in again by `detach`, `attach`
    """

    def __init__(self, devices: Iterable[ModbusDevice] = ()) -> None:
        self.devices: list[ModbusDevice] = []
        self._faults: dict[int, WireFaults] = {}
        for device in devices:
            self.attach(device)

    def attach(self, device: ModbusDevice) -> None:
        """Connect a device.

        Raises
        ------
        ValueError : another device has the same unit number
        """
        if any(other.unit == device.unit for other in self.devices):
            raise ValueError(f"unit {device.unit} is on this bus already")
        self.devices.append(device)

    def detach(self, device: ModbusDevice) -> None:
        """Pull a device's plug."""
        self.devices.remove(device)

    def faults(self, unit: int) -> WireFaults:
        """Return the faults of the wire to a unit, to be changed in place."""
        return self._faults.setdefault(unit, WireFaults())

    def set_faults(self, unit: int, faults: WireFaults) -> None:
        """Let the wire to a unit have these faults and no others."""
        self._faults[unit] = faults

    def clear_faults(self) -> None:
        """Mend every wire."""
        self._faults.clear()

    def request(self, unit: int, pdu: bytes, now_s: float) -> BusReply | None:
        """Put one request on the line and return the reply; None is silence.

        Parameters
        ----------
        unit : addressee; 0 is everyone
        pdu : function code and data
        now_s : instant at which the request was complete [world s]
        """
        reply = self._answer(unit, pdu, now_s)
        wire_log.debug(
            "%.6f unit %d < %s > %s",
            now_s,
            unit,
            pdu.hex(" "),
            "silence" if reply is None else f"unit {reply.unit} {reply.pdu.hex(' ')}",
        )
        return reply

    def _answer(self, unit: int, pdu: bytes, now_s: float) -> BusReply | None:
        if unit == BROADCAST_UNIT:
            return self._broadcast(pdu, now_s)
        faults = self._faults.get(unit)
        if faults is not None and not faults.spend():
            faults = None
        if faults is not None and faults.is_deaf:
            return None
        if faults is not None and faults.exception_code is not None:
            reply: bytes | None = exception_pdu(pdu[0], faults.exception_code)
        else:
            reply = self._ask(unit, pdu, now_s)
        if faults is None:
            return None if reply is None else BusReply(unit, reply)
        if faults.is_connection_dropped:
            return BusReply(unit, b"", is_connection_dropped=True)
        if faults.is_mute or reply is None:
            return None
        return BusReply(
            unit if faults.reply_unit is None else faults.reply_unit,
            reply,
            faults.reply_delay_s,
            faults.reply_byte_count,
            faults.is_crc_bad,
            fault=faults.reply_fault,
        )

    def _ask(self, unit: int, pdu: bytes, now_s: float) -> bytes | None:
        # two devices with one number answer at once, and neither can be read
        replies = [d.request(pdu, now_s) for d in self.devices if d.unit == unit]
        return replies[0] if len(replies) == 1 else None

    def _broadcast(self, pdu: bytes, now_s: float) -> BusReply | None:
        # Waveshare modules answer a read of unit 0, under their own number, so that a lone module
        # whose number is lost can be found (modbus_devices.md 6.2); two at once are a collision.
        hearers = [d for d in self.devices if d.hears_broadcast]
        replies = [(d.unit, reply) for d in hearers if (reply := d.request(pdu, now_s)) is not None]
        is_read = pdu[0] in (0x01, 0x02, 0x03, 0x04)
        if not is_read or len(replies) != 1:
            return None
        return BusReply(*replies[0])
