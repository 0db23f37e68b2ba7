"""The camera's registers: what a request reads, and which writes they take.

Knows ranges and access; what a write sets off is the device's.
"""

import struct
from collections.abc import Callable, Sequence
from typing import Final

from ..features import DESCRIPTION_ADDRESS, Feature, Kind
from ..features.table import address_of
from ..protocol import bootstrap as boot
from ..protocol.gvcp import Refused, Status

WORD_BYTES: Final = 4


class Registers:
    """Words, texts and the description, each at its address.

    Parameters
    ----------
    features : in the order of their registers
    words : bootstrap registers and their values
    texts : bootstrap texts
    description : the description's bytes
    """

    def __init__(
        self,
        features: Sequence[Feature],
        words: dict[int, int],
        texts: dict[int, str],
        description: bytes,
    ) -> None:
        self._features = {address_of(index): one for index, one in enumerate(features)}
        self._addresses = {one.name: at for at, one in self._features.items()}
        self._words = dict(words)
        self._areas = {
            at: bytearray(texts.get(at, "").encode()[:length].ljust(length, b"\0"))
            for at, length in boot.TEXT_BYTES.items()
        }
        self._areas[DESCRIPTION_ADDRESS] = bytearray(description)
        self.load_defaults()

    def load_defaults(self) -> None:
        """Give every feature its value at power-up."""
        for at, feature in self._features.items():
            self._words[at] = _to_word(feature, feature.start or 0.0)

    # --- by name ----------------------------------------------------------------------------------

    def value(self, name: str) -> float:
        """Return the value of a feature."""
        at = self._addresses[name]
        return _from_word(self._features[at], self._words[at])

    def number(self, name: str) -> int:
        """Return the value of a feature that is a whole number."""
        return int(self.value(name))

    def put(self, name: str, value: float) -> None:
        """Set a feature from inside the camera."""
        at = self._addresses[name]
        self._words[at] = _to_word(self._features[at], value)

    def word(self, address: int) -> int:
        """Return a bootstrap register."""
        return self._words[address]

    def put_word(self, address: int, word: int) -> None:
        """Set a bootstrap register from inside the camera."""
        self._words[address] = word

    def feature_at(self, address: int) -> Feature | None:
        """Return the feature whose register is at an address."""
        return self._features.get(address)

    # --- by address -------------------------------------------------------------------------------

    def read(self, address: int, count: int) -> bytes:
        """Return bytes.

        Raises
        ------
        Refused : not whole words, or nothing is at one of the addresses
        """
        if address % WORD_BYTES or count % WORD_BYTES:
            raise Refused(Status.BAD_ALIGNMENT)
        return b"".join(self._word_at(at) for at in range(address, address + count, WORD_BYTES))

    def _word_at(self, address: int) -> bytes:
        if address in self._words:
            feature = self._features.get(address)
            if feature is not None and feature.access == "WO":
                return bytes(WORD_BYTES)
            return self._words[address].to_bytes(WORD_BYTES, "big")
        for start, area in self._areas.items():
            if start <= address < start + len(area):
                return bytes(area[address - start : address - start + WORD_BYTES])
        if address < boot.STREAM_SOURCE_PORT:
            return bytes(WORD_BYTES)  # reserved bootstrap registers read as 0
        raise Refused(Status.INVALID_ADDRESS)

    def write_text(self, address: int, data: bytes) -> bool:
        """Write into the one text that a client may change; return False if it is none of it.

        Raises
        ------
        Refused : a text that cannot be changed
        """
        for start, length in boot.TEXT_BYTES.items():
            if start <= address < start + length:
                if start != boot.USER_NAME or address + len(data) > start + length:
                    raise Refused(Status.WRITE_PROTECT)
                self._areas[start][address - start : address - start + len(data)] = data
                return True
        return False

    def check(self, feature: Feature, word: int, is_busy: Callable[[], bool]) -> None:
        """Raise Refused unless a feature takes a word now.

        Parameters
        ----------
        feature : feature that is written
        word : as written
        is_busy : whether pictures are taken, which locks some features

        Raises
        ------
        Refused : it does not
        """
        if feature.access == "RO" or (feature.is_locked and is_busy()):
            raise Refused(Status.WRITE_PROTECT)
        value = _from_word(feature, word)
        match feature.kind:
            case Kind.COMMAND:
                is_right = word == 1
            case Kind.ENUMERATION:
                is_right = word in feature.entries.values()
            case Kind.FLOAT:
                is_right = feature.low <= value <= feature.high
            case _:
                is_right = feature.low <= value <= feature.high
                is_right = is_right and (value - feature.low) % feature.step == 0
        if not is_right:
            raise Refused(Status.INVALID_PARAMETER)


def _to_word(feature: Feature, value: float) -> int:
    if feature.kind is Kind.FLOAT:
        return int.from_bytes(struct.pack(">f", value), "big")
    return round(value)


def _from_word(feature: Feature, word: int) -> float:
    if feature.kind is Kind.FLOAT:
        return float(struct.unpack(">f", word.to_bytes(WORD_BYTES, "big"))[0])
    return word
