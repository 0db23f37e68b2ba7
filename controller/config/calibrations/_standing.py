"""The standing of a cell's calibrations: their age, their runs, and their basis."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Final

import numpy as np

from messages import joined, say

from ..calibration_reference import CalibrationName, CalibrationReference
from ._models import Calibration, VerificationRecord

VERIFY = "cellctl commission --step verify"
# Drift from view to view of a held part that arm and station camera leave; decided by this many
# parts, since one alone may have slipped.
DRIFT_PARTS: Final = 5
MAX_OFF_MM: Final = 0.3
DRIFTING: Final[tuple[CalibrationName, ...]] = ("inspection", "arm")


@dataclass(frozen=True, slots=True)
class Usage:
    """The runs' use of one calibration file.

    Attributes
    ----------
    run_count : runs that have used it
    off_mm : part by part, oldest first, how far arm and station camera disagreed from view to view
    """

    run_count: int = 0
    off_mm: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class CalibrationStanding:
    """Whether one calibration still counts.

    Attributes
    ----------
    measured : date
    why_stale : empty while it counts
    """

    name: CalibrationName
    measured: datetime
    why_stale: str = ""


@dataclass(frozen=True, slots=True)
class CalibrationsStanding:
    """Whether the calibrations of a cell still count.

    Attributes
    ----------
    each : by name; empty for a cell that stands as drawn
    why_not_verified : empty once a verification has passed with the very calibrations of now
    """

    each: tuple[CalibrationStanding, ...] = ()
    why_not_verified: str = ""

    @property
    def stale(self) -> tuple[str, ...]:
        """A sentence for each calibration that no longer counts."""
        return tuple(
            say(
                "the calibration of {name} is stale: {why_stale}",
                name=one.name.replace("_", " "),
                why_stale=one.why_stale,
            )
            for one in self.each
            if one.why_stale
        )

    @property
    def sentences(self) -> tuple[str, ...]:
        """All sentences that a report has to state; empty if everything counts."""
        why = self.why_not_verified
        return (*self.stale, *((say("the cell is not verified: {why}", why=why),) if why else ()))


def standing_of(
    references: Mapping[CalibrationName, CalibrationReference],
    found: Mapping[CalibrationName, Calibration],
    now: datetime,
    usage: Mapping[str, Usage],
) -> CalibrationsStanding:
    """Return whether calibrations are still valid.

    Parameters
    ----------
    references, found : references and calibrations found in one cell file, by name
    now : with its offset from UTC
    usage : so far, by the hash of the calibration file
    """
    each = tuple(
        CalibrationStanding(
            name,
            one.measured,
            _why_stale(name, one, references, now, usage.get(references[name].sha256, Usage())),
        )
        for name, one in found.items()
    )
    return CalibrationsStanding(each, _why_not_verified(references, found, each))


def _why_stale(
    own: CalibrationName,
    one: Calibration,
    references: Mapping[CalibrationName, CalibrationReference],
    now: datetime,
    used: Usage,
) -> str:
    measured = f"{one.measured:%Y-%m-%d}"
    if one.measured > now + timedelta(days=1):
        return say(
            "it was measured {measured}, which is yet to come; set the clock",
            measured=measured,
        )
    if one.valid_days is not None and now - one.measured > timedelta(days=one.valid_days):
        return say(
            "measured {measured}, valid for {valid_days} days",
            measured=measured,
            valid_days=one.valid_days,
        )
    if one.valid_runs is not None and used.run_count >= one.valid_runs:
        return say(
            "{run_count} runs have used it, it is valid for {valid_runs}",
            run_count=used.run_count,
            valid_runs=one.valid_runs,
        )
    last = used.off_mm[-DRIFT_PARTS:]
    usual = float(np.median(last)) if len(last) == DRIFT_PARTS else 0.0
    if own in DRIFTING and usual > MAX_OFF_MM:
        return say(
            "arm and station camera disagree by {usual:.2f} mm from view to "
            "view of the last {drift_parts} parts, {max_off_mm:g} are allowed: "
            "one of them has moved",
            usual=usual,
            drift_parts=DRIFT_PARTS,
            max_off_mm=MAX_OFF_MM,
        )
    if one.residual is not None and one.residual.value > one.residual.limit:
        of = one.residual
        return say(
            "its fit leaves {value:g} {unit}, {limit:g} are allowed",
            value=of.value,
            unit=of.unit,
            limit=of.limit,
        )
    for name, digest in one.based_on.items():
        if name not in references:
            return say(
                "it is based on a calibration of {name} that is gone", name=name.replace("_", " ")
            )
        if references[name].sha256 != digest:
            return say("{name} was calibrated anew since", name=name.replace("_", " "))
    return ""


def _why_not_verified(
    references: Mapping[CalibrationName, CalibrationReference],
    found: Mapping[CalibrationName, Calibration],
    each: tuple[CalibrationStanding, ...],
) -> str:
    if not references:
        return say(
            "its poses are those of its file, and nothing was measured ({verify})", verify=VERIFY
        )
    record = found.get("verification")
    if not isinstance(record, VerificationRecord):
        return say("no verification ({verify})", verify=VERIFY)
    if not record.passed:
        measured = f"{record.measured:%Y-%m-%d}"
        return say("its verification of {measured} failed", measured=measured)
    later = sorted(name for name in references if name not in (*record.based_on, "verification"))
    if later:
        return say("{later} came after its verification", later=joined(", ", later))
    if why := next((one.why_stale for one in each if one.name == "verification"), ""):
        return why
    return ""
