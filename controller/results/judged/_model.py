"""The content of a report on a judged part: its header, measurements and findings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Final

from controller.cell.journal.rows import CharacteristicFields
from controller.config.characteristics import CONFORMANCE_PROBABILITY

from ..run import PartReport, RunPictures

DECISION_RULE: Final = f"guard bands, {100 * CONFORMANCE_PROBABILITY:.0f} % for PASS and for FAIL"


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """The inspected part, the inspector and the equipment; an unknown text is empty.

    Attributes
    ----------
    part : name of the product
    number : number of the part in its run, from 1
    recipe, recipe_sha256, cad, cad_sha256, cell, cell_sha256 : files, and what was in them
    calibrated : calibration date of each camera
    calibration : sentences on the calibrations of the cell that did not count; None if unknown
    software : versions by name
    start, end : UTC
    part_temperature_c : None if nobody measured it
    run_id : empty for pictures that no run took
    emulated_devices : not empty: no production result
    cell_settings : the cell as it was read, whole
    papers : part, drawing, order and gauge numbers by key; not given where empty
    """

    part: str
    number: int = 1
    serial: str = ""
    lot: str = ""
    operator: str = ""
    recipe: str = ""
    recipe_sha256: str = ""
    cad: str = ""
    cad_sha256: str = ""
    cell: str = ""
    cell_sha256: str = ""
    calibrated: Mapping[str, str] = field(default_factory=dict)
    calibration: tuple[str, ...] | None = None
    software: Mapping[str, str] = field(default_factory=dict)
    start: datetime
    end: datetime
    part_temperature_c: float | None = None
    run_id: str = ""
    emulated_devices: tuple[str, ...] = ()
    cell_settings: Mapping[str, object] = field(default_factory=dict)
    papers: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class JudgedPart:
    """A part, judged or not, as in its report.

    Attributes
    ----------
    header : header of the report
    part : results of the part
    pictures : reader of its pictures
    """

    header: Header
    part: PartReport
    pictures: RunPictures

    @property
    def verdict(self) -> str:
        """The verdict in a word or two."""
        return self.part.verdict.verdict if self.part.verdict else "no verdict"

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why, most important first."""
        return self.part.verdict.reasons if self.part.verdict else ()


def shared_characteristics(parts: Sequence[JudgedPart]) -> tuple[CharacteristicFields, ...]:
    """Return the characteristics of a product, as its first measured part has them.

    Raises
    ------
    ValueError : two parts have different ones, so that they are of different products
    """
    measured = [judged.part.characteristics for judged in parts if judged.part.characteristics]
    if not measured:
        return ()
    first = measured[0]
    if any([c.id for c in other] != [c.id for c in first] for other in measured):
        raise ValueError("a file holds one product: the characteristics of these parts differ")
    return first
