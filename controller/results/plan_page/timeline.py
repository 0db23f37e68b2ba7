"""The forecast as bars along one axis of seconds, one row per step."""

from collections.abc import Sequence
from dataclasses import dataclass

from ..moments import MomentKind
from .strip import StripFrame

# The word and the colour of each kind of step, in the order of the key.
KEY: dict[MomentKind, tuple[str, str]] = {
    MomentKind.PICK: ("pick", "#3f7fbf"),
    MomentKind.PRESENT: ("show", "#2a9d62"),
    MomentKind.GIVE: ("hand off", "#d98a1f"),
    MomentKind.RECEIVE: ("receive back", "#b8631b"),
    MomentKind.SET_DOWN: ("set down", "#a05aa8"),
    MomentKind.LOOK: ("look at the table", "#6abf8e"),
    MomentKind.PLACE: ("place", "#58728f"),
    MomentKind.PARK: ("park", "#9aa7b3"),
}
WIDTH, ROW, LEFT, RIGHT, TOP = 1080.0, 19.0, 300.0, 96.0, 26.0
# Mean width of a letter [px].
LETTER = 6.4
GAPS_S = (1, 2, 5, 10, 20, 30, 60, 120, 300, 600)
MAX_TICKS = 12


@dataclass(frozen=True, slots=True)
class StepBar:
    """One step: its bar [px], and the text beside it."""

    x: float
    y: float
    width: float
    colour: str
    label: str
    seconds: str
    until: str


@dataclass(frozen=True, slots=True)
class Timeline:
    """All bars, the axis, and the key of colours.

    Attributes
    ----------
    ticks : x [px] and its label
    totals : words, colour, seconds of each kind
    """

    width: float
    height: float
    left: float
    top: float
    row: float
    bars: tuple[StepBar, ...]
    ticks: tuple[tuple[float, str], ...]
    totals: tuple[tuple[str, str, float], ...]


def timeline(frames: Sequence[StripFrame]) -> Timeline:
    """Return the time line of drawn steps."""
    total_s = max(frames[-1].to_s, 1e-3)
    scale = (WIDTH - LEFT - RIGHT) / total_s
    bars = tuple(
        StepBar(
            x=LEFT + frame.from_s * scale,
            y=TOP + ROW * i,
            width=max(1.0, (frame.to_s - frame.from_s) * scale),
            colour=KEY[frame.moment.kind][1],
            label=_short(f"{frame.number}  {frame.moment.step.label}"),
            seconds=f"{frame.to_s - frame.from_s:.1f} s",
            until=f"{frame.to_s:.0f}",
        )
        for i, frame in enumerate(frames)
    )
    gap = next((g for g in GAPS_S if total_s / g <= MAX_TICKS), 1200)
    ticks = tuple((LEFT + s * scale, f"{s} s") for s in range(0, int(total_s) + 1, gap))
    totals = tuple(
        (word, colour, sum(f.to_s - f.from_s for f in frames if f.moment.kind is kind))
        for kind, (word, colour) in KEY.items()
        if any(f.moment.kind is kind for f in frames)
    )
    return Timeline(WIDTH, TOP + ROW * len(bars) + 6, LEFT, TOP, ROW, bars, ticks, totals)


def _short(text: str) -> str:
    most = int((LEFT - 12) / LETTER)
    return text if len(text) <= most else text[: most - 1] + "…"
