"""Which steps are done, stale, failed or not done, and why."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from enum import StrEnum
from typing import Final

from controller.config.calibration_reference import CalibrationName
from messages import key, say

from ._record import StepEnd, StepRecord

GONE: Final = key("the calibration `{name}` is gone since {when}")
ANOTHER: Final = key("the calibration `{name}` is another one since {when}")


class StepStatus(StrEnum):
    """Present status of a step."""

    DONE = "done"
    STALE = key("stale")
    FAILED = key("failed")
    NOT_DONE = key("not done")


@dataclass(frozen=True, slots=True)
class StepPlan:
    """A step, as far as its order and its age matter.

    Attributes
    ----------
    name : name of the step
    needs : the steps that have to be done before it
    valid_days : days until it is stale; None for never
    """

    name: str
    needs: tuple[str, ...]
    valid_days: int | None


@dataclass(frozen=True, slots=True)
class StepStanding:
    """Standing of one step.

    Attributes
    ----------
    step : its name
    status : done or not
    reason : reason why it is not done; for a finished step, its date
    """

    step: str
    status: StepStatus
    reason: str


def standings(
    plans: Sequence[StepPlan],
    records: Mapping[str, StepRecord],
    now: datetime,
    digest: str,
    calibrations: Mapping[CalibrationName, str],
) -> tuple[StepStanding, ...]:
    """Return the standing of each step, in their order.

    A step is stale if the cell file now describes another cell, if a calibration that it used or
    wrote was replaced, if a step that it needs was repeated after it or is not done itself, or by
    its age.

    Parameters
    ----------
    plans : all steps, each after those that it needs
    records : the last record of each step that has one
    now : with its offset from UTC
    digest : digest of what the cell file describes
    calibrations : the hash of each calibration that the cell has now
    """
    found: dict[str, StepStanding] = {}
    for plan in plans:
        status, reason = _of_record(plan, records.get(plan.name), now, digest, calibrations)
        if status is StepStatus.DONE and (why := _by_needs(plan, records, found)):
            status, reason = StepStatus.STALE, why
        found[plan.name] = StepStanding(plan.name, status, reason)
    return tuple(found.values())


def _of_record(
    plan: StepPlan,
    record: StepRecord | None,
    now: datetime,
    digest: str,
    calibrations: Mapping[CalibrationName, str],
) -> tuple[StepStatus, str]:
    if record is None:
        return StepStatus.NOT_DONE, key("never begun")
    when = f"{record.ended:%Y-%m-%d %H:%M}"
    if record.outcome is StepEnd.BROKEN_OFF:
        return StepStatus.NOT_DONE, say(
            "broken off {when}: {message}", when=when, message=record.message
        )
    if record.outcome is StepEnd.FAILED:
        return StepStatus.FAILED, say("{when}: {message}", when=when, message=record.message)
    if record.cell_digest != digest:
        return StepStatus.STALE, say(
            "the cell file describes another cell than on {when}", when=when
        )
    for name, sha256 in {**record.based_on, **record.made}.items():
        if calibrations.get(name) != sha256:
            template = GONE if name not in calibrations else ANOTHER
            return StepStatus.STALE, say(template, name=name, when=when)
    if plan.valid_days is not None and now - record.ended > timedelta(days=plan.valid_days):
        return StepStatus.STALE, say(
            "older than {valid_days} days: {when}", valid_days=plan.valid_days, when=when
        )
    if record.by:
        return StepStatus.DONE, say("{when} by {by}", when=when, by=record.by)
    return StepStatus.DONE, when


def _by_needs(
    plan: StepPlan, records: Mapping[str, StepRecord], found: Mapping[str, StepStanding]
) -> str:
    """Return why a step that was done does not hold any more because of those before it."""
    for need in plan.needs:
        if found[need].status is not StepStatus.DONE:
            return say(
                "`{need}`, which it needs, is {value}", need=need, value=found[need].status.value
            )
        if records[need].ended > records[plan.name].began:
            return say("`{need}`, which it needs, was repeated after it", need=need)
    return ""
