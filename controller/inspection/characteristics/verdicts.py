"""The verdict on one characteristic."""

from .._types import Verdict
from ._types import Characteristic
from .limits import CONFORMANCE_PROBABILITY, decide


def verdict_of(
    characteristic: Characteristic,
    measured_mm: float,
    U_mm: float,
    probability: float = CONFORMANCE_PROBABILITY,
) -> Verdict:
    """Return whether a measured value fits; what is ideal at 0 has no lower limit.

    Parameters
    ----------
    characteristic : with its limits
    measured_mm, U_mm : value and expanded uncertainty (k = 2); rad for an angle
    probability : as `decide` has it
    """
    lower = None if characteristic.is_one_sided else characteristic.lower_mm
    return decide(measured_mm, U_mm, lower, characteristic.upper_mm, probability)
