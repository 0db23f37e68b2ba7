"""SVG chart of values in the order measured: limits, control limits, marks, groups."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Final

from markupsafe import Markup

WIDTH, HEIGHT = 760, 200
LEFT, RIGHT, TOP, BOTTOM = 62, 128, 14, 22
MARGIN_SHARE: Final = 0.06  # margin above and below, as a share of the range shown
MAX_DOTS: Final = 4000


def _written(value: float, digits: int) -> str:
    return f"{value:.{digits}f}"


@dataclass(frozen=True, slots=True)
class LevelLine:
    """A level across the chart: its value, its name, and its kind (limit or control limit)."""

    value: float
    name: str
    style: str = "limit"


@dataclass(frozen=True, slots=True)
class Chart:
    """The content of a chart.

    Attributes
    ----------
    values : in the order measured
    lines : levels across it
    marks : by index of a value, a word for it; such a value is drawn as a diamond
    groups : name of each value's group; a line is drawn where it changes
    half_widths : expanded uncertainty of each value, or None
    written : returns a number with so many digits as the reader's language writes it
    """

    values: Sequence[float]
    lines: Sequence[LevelLine] = ()
    marks: Mapping[int, str] = field(default_factory=dict)
    groups: Sequence[str] = ()
    half_widths: Sequence[float | None] = ()
    written: Callable[[float, int], str] = _written


def value_chart(chart: Chart) -> Markup:
    """Return a chart as SVG.

    Colours and dashes are in words too: `LevelLine.name`, and the marks.
    """
    first = max(0, len(chart.values) - MAX_DOTS)
    shown = list(chart.values[first:])
    every = [*shown, *(line.value for line in chart.lines)]
    for value, half in zip(shown, chart.half_widths[first:], strict=False):
        every += [value - (half or 0.0), value + (half or 0.0)]
    low, high = min(every), max(every)
    room = MARGIN_SHARE * (high - low) or 1e-3
    low, high = low - room, high + room

    def y(value: float) -> float:
        return TOP + (HEIGHT - TOP - BOTTOM) * (high - value) / (high - low)

    def x(index: int) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * (index + 0.5) / max(len(shown), 1)

    out = [
        f'<svg class="chart" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'aria-label="{len(shown)} values in the order measured">',
        f'<path class="axis" d="M{LEFT} {TOP}V{HEIGHT - BOTTOM}H{WIDTH - RIGHT}"/>',
    ]
    out += _groups(list(chart.groups[first:]), x)
    out += _lines(chart, y)
    if len(shown) > 1:
        way = "L".join(f"{x(i):.1f} {y(v):.1f}" for i, v in enumerate(shown))
        out.append(f'<path class="way" d="M{way}"/>')
    for i, value in enumerate(shown):
        half = chart.half_widths[first + i] if first + i < len(chart.half_widths) else None
        if half:
            out.append(
                f'<path class="u" d="M{x(i):.1f} {y(value - half):.1f}V{y(value + half):.1f}"/>'
            )
        mark = chart.marks.get(first + i)
        said = escape(f"{chart.written(value, 4)}{f', {mark}' if mark else ''}")
        title = f"<title>{first + i + 1}: {said}</title>"
        if mark:
            cx, cy = x(i), y(value)
            out.append(
                f'<path class="mark" d="M{cx:.1f} {cy - 6:.1f}L{cx + 6:.1f} {cy:.1f}'
                f'L{cx:.1f} {cy + 6:.1f}L{cx - 6:.1f} {cy:.1f}Z">{title}</path>'
                f'<text class="mark" x="{cx:.1f}" y="{cy - 8:.1f}">{escape(mark)}</text>'
            )
        else:
            out.append(
                f'<circle class="dot" cx="{x(i):.1f}" cy="{y(value):.1f}" r="3">{title}</circle>'
            )
    out.append("</svg>")
    return Markup("".join(out))  # nosec B704: all texts were escaped above


def _lines(chart: Chart, y: Callable[[float], float]) -> list[str]:
    out: list[str] = []
    taken: list[float] = []
    for line in sorted(chart.lines, key=lambda one: one.style != "limit"):
        at = y(line.value)
        out.append(f'<path class="{line.style}" d="M{LEFT} {at:.1f}H{WIDTH - RIGHT}"/>')
        if all(abs(at - other) > 11 for other in taken):
            taken.append(at)
            out.append(f'<text x="{WIDTH - RIGHT + 5}" y="{at + 4:.1f}">{escape(line.name)}</text>')
            value = escape(chart.written(line.value, 3))
            out.append(f'<text class="n" x="{LEFT - 5}" y="{at + 4:.1f}">{value}</text>')
    return out


def _groups(groups: Sequence[str], x: Callable[[int], float]) -> list[str]:
    out = []
    begin = 0
    for i in range(1, len(groups) + 1):
        if i < len(groups) and groups[i] == groups[begin]:
            continue
        middle = (x(begin) + x(i - 1)) / 2
        out.append(
            f'<text class="group" x="{middle:.1f}" y="{HEIGHT - 6}">{escape(groups[begin])}</text>'
        )
        if i < len(groups):
            at = (x(i - 1) + x(i)) / 2
            out.append(f'<path class="group" d="M{at:.1f} {TOP}V{HEIGHT - BOTTOM}"/>')
        begin = i
    return out
