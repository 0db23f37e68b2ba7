"""Effect of a cell's calibration state on a verdict."""

from dataclasses import replace

from controller.config import Recipe
from controller.config.view_set import SetCalibration
from controller.inspection import PartInspection, Verdict
from messages import say


def as_calibrated(
    found: PartInspection, calibration: SetCalibration, recipe: Recipe | None
) -> PartInspection:
    """Return a verdict without a PASS where a calibration that the recipe requires is missing.

    Parameters
    ----------
    found : the verdict of the pictures
    calibration : calibrations that did not count when they were taken
    recipe : recipe with its requirements for a PASS; None for none
    """
    required = "any" if recipe is None else recipe.inspection.calibration
    missing = list(calibration.stale) if required != "any" else []
    if required == "verified" and calibration.why_not_verified:
        missing.append(
            say(
                "the cell is not verified: {why_not_verified}",
                why_not_verified=calibration.why_not_verified,
            )
        )
    if missing and found.verdict is Verdict.PASS:
        return replace(
            found,
            verdict=Verdict.INDETERMINATE,
            reasons=(
                *(say("{why}; the recipe requires it", why=why) for why in missing),
                *found.reasons,
            ),
        )
    stated = tuple(why for why in calibration.stale if why not in missing)
    return replace(found, reasons=(*found.reasons, *missing, *stated))
