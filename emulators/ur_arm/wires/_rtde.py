"""RTDE, the controller's side of one connection: bytes in, bytes out; universal_robots.md 2.

Sections (§) are those of universal_robots.md.
"""

import logging
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from .._facts import CYCLE_S, Software
from .._model import UrArm
from ._fields import (
    FORMATS,
    IN_USE,
    INPUTS,
    NOT_FOUND,
    OUTPUTS,
    Getter,
    apply_inputs,
    input_register,
    pack,
)

log = logging.getLogger(__name__)

HEADER: Final = struct.Struct(">HB")
VERSIONS: Final = (1, 2)
NAMES_BYTES_MAX: Final = 2048  # §2.2
FREQUENCY_V1_HZ: Final = 125.0  # §2.2
ERROR: Final = 1  # level of a text message, §2.1
WARNING: Final = 2
SOURCE: Final = "RTDE"
INVALID_RECIPE: Final = 0  # §2.2


class BadFrameError(Exception):
    """The stream has lost its frames; the controller ends the connection."""


def frame(kind: str, payload: bytes = b"") -> bytes:
    """Return a package: size with the header, type, payload."""
    return HEADER.pack(HEADER.size + len(payload), ord(kind)) + payload


@dataclass(frozen=True, slots=True)
class _Inputs:
    """One input recipe."""

    names: tuple[str, ...]
    kinds: tuple[str, ...]

    @property
    def layout(self) -> struct.Struct:
        """Layout of its values."""
        return struct.Struct(">" + "".join(FORMATS[kind] for kind in self.kinds))

    def values(self, data: bytes) -> Mapping[str, Any]:
        flat = list(self.layout.unpack(data))
        values: dict[str, Any] = {}
        for name, kind in zip(self.names, self.kinds, strict=True):
            if kind.startswith("VECTOR6"):
                values[name], flat = tuple(flat[:6]), flat[6:]
            else:
                values[name] = flat.pop(0)
        return values


class RtdeSession:
    """One client's RTDE.

    Parameters
    ----------
    arm : the controller
    software : its version
    taken : names of inputs that some session holds; shared by all sessions of a controller
    """

    def __init__(self, arm: UrArm, software: Software, taken: set[str]) -> None:
        self._arm, self._software, self._taken = arm, software, taken
        self._held: set[str] = set()
        self._rest = b""
        self._version = 1
        self._is_started = False
        self._outputs: list[Getter] = []
        self._kinds: list[str] = []
        self._every = 1
        self._inputs: dict[int, _Inputs] = {}
        self._answers: Mapping[int, Callable[[bytes], bytes]] = {
            ord("V"): self._request_version,
            ord("v"): self._control_version,
            ord("O"): self._set_up_outputs,
            ord("I"): self._set_up_inputs,
            ord("S"): self._start,
            ord("P"): self._pause,
            ord("U"): self._take_data,
            ord("M"): self._take_message,
        }

    def feed(self, data: bytes) -> bytes:
        """Return the replies to what has arrived.

        Raises
        ------
        BadFrameError : a size below the header's
        """
        self._rest += data
        replies = b""
        while len(self._rest) >= HEADER.size:
            size, kind = HEADER.unpack_from(self._rest)
            if size < HEADER.size:
                raise BadFrameError(f"a package of {size} bytes")
            if len(self._rest) < size:
                break
            payload, self._rest = self._rest[HEADER.size : size], self._rest[size:]
            answer = self._answers.get(kind)
            if answer is None:
                replies += self._message(f"unknown package type {kind}", ERROR)
                continue
            try:
                replies += answer(payload)
            except (struct.error, UnicodeDecodeError):
                replies += self._message(f"package {chr(kind)!r} has a wrong length", ERROR)
        return replies

    def due(self) -> bytes:
        """Return the data package of this control cycle, empty if none is due."""
        if not self._is_started or not self._outputs or self._arm.cycle_count % self._every:
            return b""
        values = [getter(self._arm) for getter in self._outputs]
        data = pack(self._kinds, values)
        return frame("U", data if self._version == 1 else b"\x01" + data)

    def close(self) -> None:
        """Release the inputs that the client has held."""
        self._taken -= self._held
        self._held.clear()

    # --- the packages -----------------------------------------------------------------------------

    def _request_version(self, payload: bytes) -> bytes:
        (version,) = struct.unpack(">H", payload)
        is_known = version in VERSIONS
        if is_known:
            self._version = version
        return frame("V", bytes((is_known,)))

    def _control_version(self, _: bytes) -> bytes:
        one = self._software
        return frame("v", struct.pack(">IIII", one.major, one.minor, one.bugfix, one.build))

    def _set_up_outputs(self, payload: bytes) -> bytes:
        frequency_hz = FREQUENCY_V1_HZ
        if self._version >= 2:
            (frequency_hz,) = struct.unpack_from(">d", payload)
            payload = payload[8:]
        names = _names(payload)
        fields = [OUTPUTS.get(name) or input_register(name) for name in names]
        kinds = [NOT_FOUND if one is None else one[0] for one in fields]
        known = [one for one in fields if one is not None]
        highest_hz = 1.0 / CYCLE_S
        complaint = b""
        if not 0.0 < frequency_hz <= highest_hz:
            complaint = self._message(
                f"output frequency {frequency_hz:g} Hz: above 0, {highest_hz:g} Hz at most", ERROR
            )
        elif len(payload) > NAMES_BYTES_MAX:
            complaint = self._message(f"more than {NAMES_BYTES_MAX} bytes of names", ERROR)
        elif self._is_started:
            complaint = self._message("outputs cannot be set up while started: pause", ERROR)
        is_valid = not complaint and len(known) == len(fields) > 0
        self._outputs = [getter for _, getter in known] if is_valid else []
        self._kinds = kinds if is_valid else []
        if is_valid:
            self._every = max(1, round(highest_hz / frequency_hz))
        recipe = b"" if self._version == 1 else bytes((1 if is_valid else INVALID_RECIPE,))
        return complaint + frame("O", recipe + ",".join(kinds).encode())

    def _set_up_inputs(self, payload: bytes) -> bytes:
        names = _names(payload)
        others = self._taken - self._held
        kinds = [IN_USE if name in others else INPUTS.get(name, NOT_FOUND) for name in names]
        recipe = INVALID_RECIPE
        if names and not {IN_USE, NOT_FOUND} & set(kinds):
            recipe = len(self._inputs) + 1
            self._inputs[recipe] = _Inputs(tuple(names), tuple(kinds))
            self._held |= set(names)
            self._taken |= set(names)
        return frame("I", bytes((recipe,)) + ",".join(kinds).encode())

    def _start(self, _: bytes) -> bytes:
        self._is_started = bool(self._outputs or self._inputs)
        complaint = b""
        if not self._is_started:
            complaint = self._message("nothing to start: no valid recipe is set up", ERROR)
        return complaint + frame("S", bytes((self._is_started,)))

    def _pause(self, _: bytes) -> bytes:
        self._is_started = False
        return frame("P", b"\x01")

    def _take_data(self, payload: bytes) -> bytes:
        recipe = self._inputs.get(payload[0] if payload else INVALID_RECIPE)
        if recipe is None:
            return self._message("input data for no recipe that is set up", ERROR)
        apply_inputs(self._arm, recipe.values(payload[1:]))
        return b""

    def _take_message(self, payload: bytes) -> bytes:
        log.info("RTDE client says %r", payload)
        return b""

    def _message(self, text: str, level: int) -> bytes:
        log.info("RTDE: %s", text)
        words = text.encode()[:255]
        if self._version == 1:
            return frame("M", bytes((level,)) + words)
        source = SOURCE.encode()
        parts = bytes((len(words),)) + words + bytes((len(source),)) + source + bytes((level,))
        return frame("M", parts)


def _names(payload: bytes) -> list[str]:
    """Return the names; a comma behind the last one names nothing."""
    names = payload.decode("ascii").split(",")
    if names[-1] == "":
        names.pop()
    return names
