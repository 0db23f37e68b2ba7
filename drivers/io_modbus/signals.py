"""Three-valued signals: the result of a poll, or the lack of one. No wire, no waiting."""

from collections.abc import Mapping
from dataclasses import dataclass

from ..kinds import Change, Signal
from ._config import Debounce, InputChannel


@dataclass(frozen=True, slots=True)
class Snapshot:
    """All inputs at once.

    Attributes
    ----------
    at_s : cell instant just before the inputs were last read; -inf when they never were [s]
    signals : by name
    """

    at_s: float
    signals: Mapping[str, Signal]

    def __getitem__(self, name: str) -> Signal:
        return self.signals[name]


class Believer:
    """Turns raw readings into signals: debounces, and forgets everything when readings stop."""

    def __init__(self, inputs: tuple[InputChannel, ...]) -> None:
        self._inputs = inputs
        self._raw: dict[str, bool] = {}
        self.signals = {channel.name: Signal.UNKNOWN for channel in inputs}

    def take(self, bits: tuple[bool, ...], at_s: float) -> list[Change]:
        """Take a reading of all channels; return the changes that count."""
        changes: list[Change] = []
        for channel in self._inputs:
            bit = bits[channel.channel]
            is_second = self._raw.get(channel.name) == bit
            self._raw[channel.name] = bit
            needs_two = channel.debounce is Debounce.BOTH or (
                channel.debounce is Debounce.RISING and bit
            )
            if is_second or not needs_two:
                self._believe(channel.name, Signal.OK if bit else Signal.NOT_OK, at_s, changes)
        return changes

    def forget(self, at_s: float) -> list[Change]:
        """Forget all signals; return the changes that this makes."""
        self._raw.clear()
        changes: list[Change] = []
        for channel in self._inputs:
            self._believe(channel.name, Signal.UNKNOWN, at_s, changes)
        return changes

    def _believe(self, name: str, signal: Signal, at_s: float, changes: list[Change]) -> None:
        previous = self.signals[name]
        if signal is not previous:
            self.signals[name] = signal
            changes.append(Change(name, signal, previous, at_s))
