"""Holds that fail by chance: each with the same probability, at a moment within its length.

A *hold* lasts from a gripper's closing on the part, or its trying to, until it has let go. Whether
one fails is drawn before it begins, since a grasp that misses is decided then; the moment of a drop
or a slip is a share of the time in which the gripper has the part alone. How long that is, a run of
the same scene without faults has shown. A hold that ends earlier than that hands its fault on to
the next one, so that the share of holds that fail stays what was ordered.
"""

import asyncio
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from .faults import FAULTS, PART, Cause, Fault

KINDS: Final = ("miss", "drop", "slip")  # equally often
GRIPPERS: Final = ("arm", "fixture")
OTHER: Final = {"arm": "fixture", "fixture": "arm"}
MISSES: Final = {"arm": FAULTS["missed grasp"], "fixture": FAULTS["missed hand-off"]}
ENDS: Final = frozenset({"released", "fell_out", "torn", "taken"})
SLIP_MM: Final = (2.0, 8.0)
SLIP_DEG: Final = 9.0
SHORTEST_S: Final = 1.0  # length of a kind of hold that the run without faults does not have

Lengths = Mapping[str, Sequence[float]]


@dataclass(slots=True)
class Hold:
    """One hold, or one closing that missed.

    Attributes
    ----------
    gripper : ``arm`` or ``fixture``
    kind : the gripper, and whether it took the part over from the other one
    fault : fault drawn for it: one of `KINDS`, or none
    alone_s : time that the gripper has had the part alone, once that is over [s]
    was_hit : the fault took place
    since_s : since when the gripper has the part alone; None: it does not
    """

    gripper: str
    kind: str
    fault: str
    alone_s: float = 0.0
    was_hit: bool = False
    since_s: float | None = None

    def end_alone(self, now_s: float) -> None:
        """Note that the other gripper holds it, too, or none does."""
        if self.since_s is not None:
            self.alone_s, self.since_s = now_s - self.since_s, None


@dataclass(slots=True)
class Holds:
    """All holds of one cell; follows the world's events.

    Parameters
    ----------
    cause : befalls the cell
    rate : share of holds that fail, 0..1
    rng : draws which, how and when
    lengths : durations of holds by one gripper alone without faults, by kind and in order [s]

    Attributes
    ----------
    made : every hold so far, in order of their beginnings
    owed : faults of holds that ended too early, for the next ones
    """

    cause: Cause
    rate: float
    rng: random.Random
    lengths: Lengths
    made: list[Hold] = field(default_factory=list)
    owed: list[str] = field(default_factory=list)
    _next: dict[str, str] = field(default_factory=dict)
    _now: dict[str, Hold] = field(default_factory=dict)

    def begin(self) -> None:
        """Draw the first holds, and follow the cell from now on."""
        for gripper in GRIPPERS:
            self._draw(gripper)
        self.cause.watch.on_event = self.on_event

    @property
    def fault_count(self) -> int:
        """The number of holds that have failed by chance."""
        return sum(hold.was_hit for hold in self.made)

    def lengths_seen(self) -> dict[str, list[float]]:
        """Return the durations of single holds, by kind and in order [s]."""
        seen: dict[str, list[float]] = {}
        for hold in self.made:
            seen.setdefault(hold.kind, []).append(hold.alone_s)
        return seen

    def _draw(self, gripper: str) -> None:
        """Decide about a gripper's next hold."""
        # the same draws whatever becomes of them: one hold's luck is not the next one's
        luck, kind = self.rng.random(), self.rng.choice(KINDS)
        self._next[gripper] = kind if luck < self.rate else ""
        if self._next[gripper] == "miss":
            self.cause.now(MISSES[gripper])

    def on_event(self, event: Any) -> None:  # noqa: ANN401  (of the emulated world)
        """Follow an event of the world."""
        if event.what == "missed":
            self.made.append(Hold(event.by, event.by, "miss", was_hit=True))
            self._draw(event.by)
        elif event.what == "gripped":
            self._begin(event.by, event.at_s)
        elif event.what in ENDS and event.by in self._now:
            self._end(event.by, event.at_s)

    def _begin(self, gripper: str, now_s: float) -> None:
        giver = self._now.get(OTHER[gripper])
        fault = self._next.pop(gripper, "")
        if not fault and self.owed:
            fault = self.owed.pop(0)
        kind = f"{gripper} from {giver.gripper}" if giver is not None else gripper
        hold = Hold(gripper, kind, fault)
        self._now[gripper] = hold
        self.made.append(hold)
        if giver is None:
            self._alone(hold, now_s)
        else:
            giver.end_alone(now_s)

    def _end(self, gripper: str, now_s: float) -> None:
        hold = self._now.pop(gripper)
        hold.end_alone(now_s)
        other = self._now.get(OTHER[gripper])
        if other is not None:
            self._alone(other, now_s)
        if hold.fault in ("drop", "slip") and not hold.was_hit:
            self.owed.append(hold.fault)
        self._draw(gripper)

    def _alone(self, hold: Hold, now_s: float) -> None:
        hold.since_s = now_s
        if hold.fault in ("drop", "slip") and not hold.was_hit:
            before = sum(one.kind == hold.kind for one in self.made) - 1
            known = self.lengths.get(hold.kind) or (SHORTEST_S,)
            length_s = known[min(before, len(known) - 1)]
            self.cause.spawn(self._fail(hold, now_s, self.rng.random() * length_s))

    async def _fail(self, hold: Hold, since_s: float, delay_s: float) -> None:
        await asyncio.sleep(delay_s)
        if hold.since_s != since_s:
            return  # it has ended, or the other gripper is at the part
        hold.was_hit = True
        self.cause.now(self._fault_of(hold))

    def _fault_of(self, hold: Hold) -> Fault:
        gripper = hold.gripper
        if hold.fault == "drop":
            drop = {"do": "lose_part", "gripper": gripper}
            return Fault(f"drop from {gripper}", (drop,), PART, touches_part=True)
        along_mm = self.rng.uniform(*SLIP_MM) * self.rng.choice((-1, 1))
        along_mm *= 0.5 if gripper == "fixture" else 1.0
        turn_deg = self.rng.uniform(-SLIP_DEG, SLIP_DEG)
        slip = {"do": "slip", "gripper": gripper, "along_mm": along_mm, "turn_deg": turn_deg}
        name = f"slip in {gripper} {along_mm:+.1f} mm {turn_deg:+.0f} deg"
        return Fault(name, (slip,), PART, touches_part=True)
