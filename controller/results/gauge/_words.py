"""The conclusions that a gauge study allows, in sentences."""

from collections.abc import Sequence
from typing import Final

from ..statistics import Interval
from ..statistics.capability import MIN_COUNT
from ..statistics.nested import NestedStudy
from ..wording import count_of
from ._study import GRASP, LEVELS, PART, REPEAT, START, CharacteristicGauge

NOUNS: Final = {PART: "part", START: "start pose", GRASP: "grasp", REPEAT: "value"}
EFFECTS: Final = {
    PART: "the parts",
    START: "start pose",
    GRASP: "re-grasp",
    REPEAT: "repeatability",
}
UM_PER_MM: Final = 1000.0


def in_um(found: Interval | None, unit: str) -> str:
    """Return a spread in words, um or degrees, with its interval."""
    if found is None:
        return "-"
    value, lower, upper = (
        f"{x * UM_PER_MM:.0f}" if unit == "mm" else f"{x:.3f}"
        for x in (found.value, found.lower, found.upper)
    )
    return f"{value} ({lower} to {upper})"


def said_of(gauge: CharacteristicGauge) -> list[str]:
    """Return the remarks on the numbers of one characteristic."""
    said = []
    if gauge.missing:
        said.append(f"{count_of(gauge.missing, 'reading')} without a value")
    if gauge.study is None:
        said.append("one value: nothing is repeated")
    if gauge.lower == 0 and gauge.nominal == 0:
        said.append("never below 0, so that it is not normal: its spread is a rough figure")
    return said


def said_of_all(gauges: Sequence[CharacteristicGauge]) -> list[str]:
    """Return what the data allow, in sentences, by the characteristic with the most values."""
    studies = [g.study for g in gauges if g.study is not None]
    if not studies:
        return [
            "No characteristic has two values: measure the part again in the same grasp, after a "
            "new grasp, and from another start pose."
        ]
    study = max(studies, key=lambda s: s.n)
    counts = [count_of(study.counts[level], NOUNS[level]) for level in LEVELS]
    said = [f"{', '.join(counts)}."]
    for component in study.components:
        if len(component.levels) > 1:
            words = [EFFECTS[level] for level in component.levels]
            said.append(
                f"{_capital(_listed(words))} are not told apart: {_why(component.levels, study)}."
            )
    for level in study.hidden:
        said.append(_hidden(level))
    most = max(len(g.values) for g in gauges)
    if most < MIN_COUNT:
        said.append(f"No Cg and Cgk: {most} values, {MIN_COUNT} are required.")
    return said


def _why(levels: Sequence[str], study: NestedStudy) -> str:
    reasons = {
        START: "each part was measured from one start pose",
        GRASP: "there is one grasp for each start pose",
        REPEAT: "no grasp was measured twice",
    }
    return "; ".join(reasons[level] for level in levels[1:])


def _hidden(level: str) -> str:
    return {
        PART: "One part only: no ndc, and nothing of how parts differ.",
        START: "One start pose only, or none that is known: what another one adds is not in it.",
        GRASP: "One grasp only: what a re-grasp adds is not in it.",
    }.get(level, "")


def _listed(words: Sequence[str]) -> str:
    return f"{', '.join(words[:-1])} and {words[-1]}"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
