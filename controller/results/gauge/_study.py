"""From readings of parts to a study of each characteristic (references.md S17, S23, S25)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from controller.cell.journal.rows import CharacteristicFields

from ..statistics import Interval
from ..statistics.capability import MIN_COUNT
from ..statistics.gauge import NDC_FACTOR, SIGMAS, Bias, bias_of
from ..statistics.nested import NestedStudy, nested_study
from ._reference import Reference

PART, START, GRASP, REPEAT = LEVELS = ("part", "start pose", "grasp", "repeat")
MEASUREMENT, LOOK = "measurement", "look"
# Shares of the tolerance in Cg and Cgk: a gauge may scatter over a fifth, and be off by a tenth.
CG_SHARE: Final = 0.2
CGK_SHARE: Final = 0.1


@dataclass(frozen=True, slots=True)
class Reading:
    """A part, measured once.

    Attributes
    ----------
    part, start, grasp : part, start pose and grasp; a start pose is known by its name within its
        part, a grasp within its start pose
    source : source, for people
    characteristics : with their values
    grasp_of : number of the grasp of each view, if a reading has several
    """

    part: str
    start: str
    grasp: str
    source: str
    characteristics: tuple[CharacteristicFields, ...]
    grasp_of: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, slots=True)
class CharacteristicGauge:
    """The scatter of measuring one characteristic; lengths in `unit`.

    Attributes
    ----------
    values, groups : all values, and of each part, start pose and grasp
    sources : sources of each value
    missing : readings without a value
    study : by part, start pose, grasp and repeat; None for fewer than two values
    looks : single pictures within a grasp, grasps within a measurement; None where not enough
    bias : bias of the means that are independent of each other, from their references; None without
    U_bias : expanded uncertainty of the bias, k = 2, with that of the references; None for one mean
    """

    id: str
    label: str
    unit: str
    nominal: float
    lower: float
    upper: float
    values: tuple[float, ...]
    groups: tuple[tuple[str, str, str], ...]
    sources: tuple[str, ...]
    missing: int
    study: NestedStudy | None
    looks: NestedStudy | None
    bias: float | None = None
    U_bias: float | None = None

    @property
    def tolerance(self) -> float:
        """Width between the limits."""
        return self.upper - self.lower

    def spread(self, level: str) -> Interval | None:
        """Return six standard deviations of one level and all below it; None if not told apart."""
        if self.study is None or not any(c.levels[0] == level for c in self.study.components):
            return None
        return _six_sigma(self.study.variance_below(level))

    @property
    def in_grasp(self) -> Interval | None:
        """Repeatability: six standard deviations within one grasp."""
        return self.spread(REPEAT)

    @property
    def with_regrasps(self) -> Interval | None:
        """Six standard deviations with a new grasp each time."""
        return self.spread(GRASP)

    @property
    def gauge(self) -> Interval | None:
        """Six standard deviations of everything but the part."""
        return next((s for level in LEVELS[1:] if (s := self.spread(level)) is not None), None)

    @property
    def look_to_look(self) -> Interval | None:
        """Six standard deviations between single pictures in one grasp.

        They differ in view and lamp too: an upper bound of the repeatability of one picture.
        """
        if self.looks is None or self.looks.components[-1].levels[0] != LOOK:
            return None
        return _six_sigma(self.looks.variance_below(LOOK))

    @property
    def tolerance_percent(self) -> Interval | None:
        """The gauge's six standard deviations, of the tolerance."""
        found = self.gauge
        if found is None or self.tolerance <= 0:
            return None
        return Interval(
            *(100 * x / self.tolerance for x in (found.value, found.lower, found.upper))
        )

    @property
    def ndc(self) -> int | None:
        """Categories of parts that the gauge tells apart; None if parts are not told apart."""
        found = self.gauge
        if self.study is None or found is None or self.study.components[0].levels != (PART,):
            return None
        part = self.study.components[0].variance.value
        return int(NDC_FACTOR * SIGMAS * np.sqrt(part) / found.value) if found.value else None

    @property
    def cg(self) -> float | None:
        """A fifth of the tolerance over the gauge's spread; None below 25 values."""
        found = self.gauge
        if found is None or not found.value or len(self.values) < MIN_COUNT:
            return None
        return CG_SHARE * self.tolerance / found.value

    @property
    def cgk(self) -> float | None:
        """The same with the bias; None without a reference."""
        found = self.gauge
        if self.cg is None or self.bias is None or found is None:
            return None
        return (CGK_SHARE * self.tolerance - abs(self.bias)) / (found.value / 2)


def study_readings(
    readings: Sequence[Reading], references: Sequence[Reference] = ()
) -> tuple[CharacteristicGauge, ...]:
    """Return the study of each characteristic that was measured at least once.

    Parameters
    ----------
    readings : readings of one product, in the order measured
    references : values known from elsewhere
    """
    asked = {c.id: c for reading in readings for c in reading.characteristics}
    found = (_study(c, readings, references) for c in asked.values())
    return tuple(sorted((f for f in found if f.values), key=lambda f: asked[f.id].balloon))


def _study(
    asked: CharacteristicFields, readings: Sequence[Reading], references: Sequence[Reference]
) -> CharacteristicGauge:
    mine = [(r, c) for r in readings for c in r.characteristics if c.id == asked.id]
    measured = [(r, c, c.measured) for r, c in mine if c.measured is not None]
    values = tuple(value for _, _, value in measured)
    groups = tuple((r.part, r.start, r.grasp) for r, _, _ in measured)
    bias, U_bias = _bias(values, groups, [f for f in references if f.id == asked.id])
    return CharacteristicGauge(
        asked.id,
        asked.label or asked.id,
        asked.unit,
        asked.nominal,
        asked.lower,
        asked.upper,
        values,
        groups,
        tuple(r.source for r, _, _ in measured),
        len(readings) - len(values),
        nested_study(values, groups, LEVELS),
        _looks([(r, c) for r, c, _ in measured]),
        bias,
        U_bias,
    )


def _looks(measured: Sequence[tuple[Reading, CharacteristicFields]]) -> NestedStudy | None:
    values, groups = [], []
    for k, (reading, c) in enumerate(measured):
        for look in c.looks:
            if look.measured is not None and not look.reason and look.view in reading.grasp_of:
                values.append(look.measured)
                groups.append((k, reading.grasp_of[look.view]))
    return nested_study(values, groups, (MEASUREMENT, GRASP, LOOK))


def _bias(
    values: Sequence[float],
    groups: Sequence[tuple[str, str, str]],
    references: Sequence[Reference],
) -> tuple[float | None, float | None]:
    """Return bias and its expanded uncertainty, each None if unknown.

    Values repeated in one grasp, or from one start pose, are no independent proof: the means of the
    coarsest groups below the part count.
    """
    known = {f.part: f for f in references}
    off: dict[tuple[str, ...], list[float]] = {}
    U_references = []
    depth = next(
        (d for d in (2, 3) if len({g[:d] for g in groups}) > len({g[0] for g in groups})), 0
    )
    for i, (value, group) in enumerate(zip(values, groups, strict=True)):
        reference = known.get(group[0], known.get(""))
        if reference is not None:
            key = group[:depth] if depth else (*group, str(i))
            off.setdefault(key, []).append(value - reference.value)
            U_references.append(reference.U)
    if not off:
        return None, None
    means = [float(np.mean(each)) for each in off.values()]
    if len(means) < 2:
        return means[0], None
    found: Bias = bias_of(means, 0.0)
    return found.bias, float(np.hypot(found.upper - found.bias, max(U_references)))


def _six_sigma(variance: Interval | None) -> Interval | None:
    if variance is None:
        return None
    return Interval(
        *(SIGMAS * float(np.sqrt(v)) for v in (variance.value, variance.lower, variance.upper))
    )
