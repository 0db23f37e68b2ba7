"""The reference from a cell file to its calibrations: by file and hash, under ``calibration:``."""

from typing import Annotated, Literal

from pydantic import Field

from .yaml_models import Section

CalibrationName = Literal[
    "overhead", "inspection", "arm", "fixed_gripper", "trays", "lamps", "verification"
]


class CalibrationReference(Section):
    """A calibration file.

    Attributes
    ----------
    file : its path, from the folder of the cell file
    sha256 : SHA-256 of its bytes, so that neither is changed without the other
    """

    file: Annotated[str, Field(min_length=1, max_length=400)]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
