"""Faults of a byte on the line: lost, doubled, flipped or late.

Possible harm by a serial wire of the cell to a byte. The byte and the direction are chosen by the
caller who plans the fault; chances are drawn from a seed.
"""

import random
from dataclasses import dataclass, field
from enum import Enum


class Harm(Enum):
    """The fault of a byte."""

    LOST = "lost"
    DOUBLED = "doubled"
    FLIPPED = "flipped"
    LATE = "late"


@dataclass(frozen=True, slots=True, kw_only=True)
class ByteFault:
    """One harm.

    Attributes
    ----------
    harm : harm to the byte
    bit : number of the bit to flip, 0 the lowest
    late_s : delay of the byte and of all that follow it [world s]
    """

    harm: Harm
    bit: int = 2
    late_s: float = 0.05

    def __post_init__(self) -> None:
        if not 0 <= self.bit <= 7:
            raise ValueError(f"a byte has the bits 0 to 7, not {self.bit}")
        if not self.late_s >= 0.0:
            raise ValueError(f"late by {self.late_s} s: no byte comes before it is sent")

    def apply(self, byte: int) -> list[tuple[int, float]]:
        """Return the bytes that arrive in the byte's place, each with its delay [world s]."""
        match self.harm:
            case Harm.LOST:
                return []
            case Harm.DOUBLED:
                return [(byte, 0.0), (byte, 0.0)]
            case Harm.FLIPPED:
                return [(byte ^ 1 << self.bit, 0.0)]
            case Harm.LATE:
                return [(byte, self.late_s)]


@dataclass(slots=True)
class LineNoise:
    """The faults of one direction of a line.

    Attributes
    ----------
    planned : faults to come, each with the number of bytes that still pass before it
    probability : probability that a byte suffers one of ``harms`` by chance
    harms : harms that chance does to bytes, all equally likely
    rng : draws for chance alone
    harmed_count : bytes harmed so far
    """

    planned: list[tuple[int, ByteFault]] = field(default_factory=list)
    probability: float = 0.0
    harms: tuple[Harm, ...] = tuple(Harm)
    rng: random.Random = field(default_factory=lambda: random.Random(0))
    harmed_count: int = 0

    def plan(self, fault: ByteFault, skip_count: int = 0) -> None:
        """Plan a fault of the byte after the next ``skip_count``.

        Raises
        ------
        ValueError : the count is negative
        """
        if skip_count < 0:
            raise ValueError(f"{skip_count} bytes cannot pass before the fault")
        self.planned.append((skip_count, fault))

    def pass_on(self, byte: int) -> list[tuple[int, float]]:
        """Return the bytes that arrive for a byte sent, each with its delay [world s]."""
        fault = self._next_fault()
        if fault is None:
            return [(byte, 0.0)]
        self.harmed_count += 1
        return fault.apply(byte)

    def _next_fault(self) -> ByteFault | None:
        found: ByteFault | None = None
        left: list[tuple[int, ByteFault]] = []
        for skip_count, fault in self.planned:
            if skip_count == 0 and found is None:
                found = fault
            else:
                left.append((max(0, skip_count - 1), fault))
        self.planned = left
        if found is None and self.probability and self.rng.random() < self.probability:
            found = ByteFault(harm=self.rng.choice(self.harms), bit=self.rng.randrange(8))
        return found
