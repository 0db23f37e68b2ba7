"""The agreement of persons with the machine, and the findings likely to be false alarms.

The definitions:

- Only the verdict that counts is counted: a person's last one on a part.
- A finding is counted where the person named it real or a false alarm. One that nobody named is
  only counted as such. One on two faces counts on both.
- The interval of a share is the exact one of a binomial (Clopper and Pearson), 95 %. It takes the
  findings as independent of each other.
- A finding is *likely a false alarm* where, of its recipe, kind and face, even the lower end of
  the interval of false alarms is above `LIKELY_SHARE`.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from scipy.special import betaincinv
from sqlalchemy import ColumnElement, and_, case, func, select

from ..queries import NAME, Filters, part_name
from ..sentences import with_sentences
from ..store import Store
from ..tables import FINDING_FACES, FINDINGS, PARTS, RUNS

CONFIDENCE: Final = 0.95
LIKELY_SHARE: Final = 0.5
LISTED_MAX: Final = 500  # unreviewed, likely false alarms that are listed


@dataclass(frozen=True, slots=True)
class Rate:
    """A count out of a total, and the interval of the share; 0..1 if the total is 0."""

    count: int
    total: int

    @property
    def share(self) -> float | None:
        """The share as counted."""
        return self.count / self.total if self.total else None

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end of the exact interval."""
        k, n, tail = self.count, self.total, (1 - CONFIDENCE) / 2
        lower = float(betaincinv(k, n - k + 1, tail)) if k else 0.0
        upper = float(betaincinv(k + 1, n - k, 1 - tail)) if k < n else 1.0
        return lower, upper


@dataclass(frozen=True, slots=True)
class Reviewed:
    """Findings of a recipe, kind and face on parts that a person decided on.

    Attributes
    ----------
    face : its label; empty if a finding lies on no face
    false_alarms : false alarms of those that a person named
    unnamed : findings that nobody named
    """

    recipe: str
    kind: str
    face: str
    false_alarms: Rate
    unnamed: int

    @property
    def is_likely_false(self) -> bool:
        """Whether more than `LIKELY_SHARE` are false alarms, surely enough."""
        return self.false_alarms.interval[0] > LIKELY_SHARE


@dataclass(frozen=True, slots=True)
class LikelyFalseAlarm:
    """A finding that awaits a person, of a kind that is mostly a false alarm."""

    part: str
    number: int
    reviewed: Reviewed


@dataclass(frozen=True, slots=True)
class Agreement:
    """The agreement of persons and machine on the parts that filters select.

    Attributes
    ----------
    findings : most false alarms first
    verdicts : by recipe, the machine's verdict and the person's, how many parts
    missed : parts that the machine passed and a person rejected, of those that it passed and a
        person decided on
    likely : findings that wait and are likely false alarms, newest parts first
    awaiting : parts that await a person
    """

    findings: tuple[Reviewed, ...]
    verdicts: Mapping[tuple[str, str, str], int]
    missed: Rate
    likely: tuple[LikelyFalseAlarm, ...]
    awaiting: int


def agreement(store: Store, filters: Filters) -> Agreement:
    """Return the agreement of persons and machine.

    Parameters
    ----------
    store : filled
    filters : parts to count; filters on reviews are ignored

    Raises
    ------
    HistoryError : the store cannot be read
    """
    clause = filters.clause()
    p, f = PARTS.c, FINDINGS.c
    label = func.coalesce(FINDING_FACES.c.label, "")

    def named(word: str) -> ColumnElement[int]:
        return func.coalesce(func.sum(case((f.review == word, 1), else_=0)), 0)

    by_face = (
        select(p.recipe, f.kind, label, named("false_alarm"), named("real"), named(""))
        .select_from(_FINDINGS_ON_FACES)
        .where(clause, p.review > "")
        .group_by(p.recipe, f.kind, label)
    )
    by_verdict = (
        select(p.recipe, p.verdict, p.review, func.count())
        .where(clause, p.review > "")
        .group_by(p.recipe, p.verdict, p.review)
        .order_by(p.recipe, p.verdict, p.review)
    )
    with store.reading() as db:
        grouped = with_sentences(db, [tuple(row) for row in db.execute(by_face)])
        found = [
            Reviewed(recipe, kind, face, Rate(int(false), int(false) + int(real)), int(rest))
            for recipe, kind, face, false, real, rest in grouped
        ]
        verdicts = {(r, machine, word): int(n) for r, machine, word, n in db.execute(by_verdict)}
        awaiting = db.execute(
            select(func.count()).select_from(PARTS).where(clause, p.awaits_review)
        ).scalar_one()
        likely_groups = {
            (one.recipe, one.kind, one.face): one for one in found if one.is_likely_false
        }
        waiting = (
            select(*NAME, p.number, f.ordinal, p.recipe, f.kind, label.label("face"))
            .select_from(_FINDINGS_ON_FACES.join(RUNS, RUNS.c.run_no == p.run_no))
            .where(clause, p.awaits_review)
            .order_by(p.start.desc(), p.part_id.desc(), f.ordinal, FINDING_FACES.c.ordinal)
        )
        likely = _likely(db.execute(waiting).mappings().all(), likely_groups)
    passed: Counter[str] = Counter()
    for (_, machine, word), n in verdicts.items():
        if machine == "pass":
            passed[word] += n
    found.sort(key=lambda one: (-one.false_alarms.count, one.recipe, one.kind, one.face))
    return Agreement(
        tuple(found),
        verdicts,
        Rate(passed["reject"], passed.total()),
        likely,
        int(awaiting),
    )


_FINDINGS_ON_FACES: Final = FINDINGS.join(PARTS).outerjoin(
    FINDING_FACES,
    and_(
        FINDING_FACES.c.part_id == FINDINGS.c.part_id, FINDING_FACES.c.finding == FINDINGS.c.ordinal
    ),
)


def _likely(
    waiting: Sequence[Mapping[Any, Any]], likely: Mapping[tuple[str, str, str], Reviewed]
) -> tuple[LikelyFalseAlarm, ...]:
    """Return the unreviewed findings that are likely false alarms on each of their faces."""
    by_finding: dict[tuple[str, int], list[Reviewed | None]] = {}
    for row in waiting:
        groups = by_finding.setdefault((part_name(row), int(row["ordinal"])), [])
        groups.append(likely.get((row["recipe"], row["kind"], row["face"])))
    found: list[LikelyFalseAlarm] = []
    for (part, number), groups in by_finding.items():
        sure = [one for one in groups if one is not None]
        if len(sure) == len(groups):
            least = min(sure, key=lambda one: one.false_alarms.interval[0])
            found.append(LikelyFalseAlarm(part, number, least))
    return tuple(found[:LISTED_MAX])


def agreement_json(found: Agreement) -> list[Mapping[str, Any]]:
    """Return it as plain JSON objects, each with its `event`."""
    lines: list[Mapping[str, Any]] = [
        {
            "event": "reviewed_verdict",
            "recipe": recipe,
            "machine": machine,
            "person": word,
            "parts": n,
        }
        for (recipe, machine, word), n in found.verdicts.items()
    ]
    lines += [{"event": "reviewed_finding", **_finding_json(one)} for one in found.findings]
    lines += [
        {
            "event": "likely_false_alarm",
            "part": one.part,
            "finding": one.number,
            **_finding_json(one.reviewed),
        }
        for one in found.likely
    ]
    lines.append(
        {"event": "missed", "of_passed": _rate_json(found.missed), "awaiting": found.awaiting}
    )
    return lines


def _finding_json(one: Reviewed) -> Mapping[str, Any]:
    return {
        "recipe": one.recipe,
        "kind": one.kind,
        "face": one.face,
        "false_alarms": _rate_json(one.false_alarms),
        "unnamed": one.unnamed,
        "is_likely_false": one.is_likely_false,
    }


def _rate_json(rate: Rate) -> Mapping[str, Any]:
    lower, upper = rate.interval
    return {
        "count": rate.count,
        "of": rate.total,
        "share": rate.share,
        "lower": lower,
        "upper": upper,
    }
