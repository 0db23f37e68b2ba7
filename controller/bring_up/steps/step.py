"""The protocol of a step of commissioning."""

from collections.abc import Mapping
from typing import Protocol

from controller.config.calibration_reference import CalibrationName
from controller.config.calibrations import Calibration

from ..bench import Bench


class CommissioningStep(Protocol):
    """One step: its requirements and its action.

    Attributes
    ----------
    name : name in one word
    title : result of the step, as a title
    needs : steps that have to be done before it
    uses : calibrations whose values it relies on
    makes : calibrations that it writes; it starts from the drawing's values in their place
    valid_days : days until it is stale; None for never
    """

    @property
    def name(self) -> str: ...  # noqa: D102  (an attribute)

    @property
    def title(self) -> str: ...  # noqa: D102  (an attribute)

    @property
    def needs(self) -> tuple[str, ...]: ...  # noqa: D102  (an attribute)

    @property
    def uses(self) -> tuple[CalibrationName, ...]: ...  # noqa: D102  (an attribute)

    @property
    def makes(self) -> tuple[CalibrationName, ...]: ...  # noqa: D102  (an attribute)

    @property
    def valid_days(self) -> int | None: ...  # noqa: D102  (an attribute)

    async def run(self, bench: Bench) -> Mapping[CalibrationName, Calibration]:
        """Do the step, keep its evidence, and return the calibrations that it found.

        Figures over their limits make it fail, whatever it returns.

        Raises
        ------
        StepFailedError : The state found is not the one required.
        CellError, DeviceError : the cell or a device does not allow it
        """
        ...
