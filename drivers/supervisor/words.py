"""The messages of controller and supervisor: bytes for the wires, and when to send them."""

import json
from dataclasses import dataclass
from typing import Any, Final, Protocol, runtime_checkable

BEAT_S: Final = 0.1  # period of heartbeats [cell s]
# Heartbeats missed before every wire is stopped: half a second, which no healthy loop is late.
MISSED_BEATS: Final = 5
# Heartbeats missed before inputs, a signal or a caller count, on which a running loop would have
# acted. A loop that an emulated cell's time waits for is up to half a beat late (shared-clock.md
# 4).
BLIND_BEATS: Final = 2.0


@dataclass(frozen=True, slots=True)
class BlindStop:
    """A stop that is sent without a query first and without waiting for an answer.

    Attributes
    ----------
    name : name of the device
    place : path of a serial line, which is set up already, or ``host:port``
    frames : sent one after the other
    spacing_s : from the start of one to the next [wall s]
    count : number of times that all of them are sent, since nobody confirms them
    """

    name: str
    place: str
    frames: tuple[bytes, ...]
    spacing_s: float = 0.0
    count: int = 1


@dataclass(frozen=True, slots=True)
class BlindLook:
    """A reading of inputs that shows whether all is well: the emergency stop, the door.

    Attributes
    ----------
    name : name of the device
    place : ``host:port``
    request : sent for each reading
    mask : as long as the answer; its bits are set in the answer while all is well
    """

    name: str
    place: str
    request: bytes
    mask: bytes


@dataclass(frozen=True, slots=True)
class Orders:
    """The supervisor's orders.

    Attributes
    ----------
    stops : on all wires
    looks : at inputs, while the controller is late
    calls : first bytes of the requests to the controller that stop the cell
    clock : file of an emulated cell's clock (shared-clock.md); empty: the wall clock
    speed : cell seconds in a second of the wall clock, where no clock is shared
    beat_s : from one heartbeat to the next [cell s]
    """

    stops: tuple[BlindStop, ...] = ()
    looks: tuple[BlindLook, ...] = ()
    calls: tuple[bytes, ...] = ()
    clock: str = ""
    speed: float = 1.0
    beat_s: float = BEAT_S

    def to_bytes(self) -> bytes:
        """Return the orders as JSON."""
        body: dict[str, Any] = {
            "stops": [
                [one.name, one.place, [f.hex() for f in one.frames], one.spacing_s, one.count]
                for one in self.stops
            ],
            "looks": [
                [one.name, one.place, one.request.hex(), one.mask.hex()] for one in self.looks
            ],
            "calls": [one.hex() for one in self.calls],
            "clock": self.clock,
            "speed": self.speed,
            "beat_s": self.beat_s,
        }
        return json.dumps(body).encode()

    @classmethod
    def from_bytes(cls, data: bytes) -> "Orders":
        """Return the orders written by `to_bytes`."""
        body = json.loads(data)
        return cls(
            tuple(
                BlindStop(name, place, tuple(map(bytes.fromhex, frames)), spacing_s, count)
                for name, place, frames, spacing_s, count in body["stops"]
            ),
            tuple(
                BlindLook(name, place, bytes.fromhex(request), bytes.fromhex(mask))
                for name, place, request, mask in body["looks"]
            ),
            tuple(map(bytes.fromhex, body["calls"])),
            body["clock"],
            body["speed"],
            body["beat_s"],
        )


@runtime_checkable
class StopsBlindly(Protocol):
    """A device that can be stopped in its controller's place."""

    def blind_stop(self) -> BlindStop | None:
        """Return the bytes of a stop in the present state; None if it needs none."""


@runtime_checkable
class LooksBlindly(Protocol):
    """A device whose inputs can be read in its controller's place."""

    def blind_look(self) -> BlindLook | None:
        """Return the bytes of a reading; None if its line cannot carry one."""
