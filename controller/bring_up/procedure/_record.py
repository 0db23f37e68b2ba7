"""Record of a step of commissioning: figures with limits, pictures, the person, and the end.

Written as JSON; `docs/commissioning.md` names the fields.
"""

from collections.abc import Iterable, Mapping
from datetime import datetime
from enum import StrEnum
from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from controller.config import Section
from controller.config.calibration_reference import CalibrationName
from messages import joined, key, say
from messages.fields import Sentence

LOWER_BOUND: Final = key("at least {bound:g}")
UPPER_BOUND: Final = key("at most {bound:g}")
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class StepEnd(StrEnum):
    """End of a step."""

    PASSED = "passed"
    FAILED = key("failed")
    """A figure is over its limit, or what is there is not what should be."""
    BROKEN_OFF = "broken off"
    """Stopped by a person, an interlock, or a device that was lost; it is to be repeated."""


class StepFigure(Section):
    """One measured value and its limit.

    Attributes
    ----------
    name : name of its subject, for people
    value : measured
    unit : empty where it has none
    uncertainty : standard uncertainty of the value; None where nobody worked it out
    low, high : limits, None where there is none
    """

    name: Sentence
    value: float
    unit: str = ""
    uncertainty: float | None = Field(None, ge=0)
    low: float | None = None
    high: float | None = None

    @property
    def is_within(self) -> bool:
        """Whether the value keeps its limits."""
        return (self.low is None or self.value >= self.low) and (
            self.high is None or self.value <= self.high
        )

    @property
    def has_limit(self) -> bool:
        """Whether anything is required of it."""
        return self.low is not None or self.high is not None

    @property
    def words(self) -> str:
        """The value with its unit and its limits."""
        more = "" if self.uncertainty is None else say(" +- {u:.3g}", u=self.uncertainty)
        limits = [
            say(template, bound=bound)
            for template, bound in ((LOWER_BOUND, self.low), (UPPER_BOUND, self.high))
            if bound is not None
        ]
        allowed = say(" ({limits} allowed)", limits=joined(", ", limits)) if limits else ""
        unit = f" {self.unit}" if self.unit else ""
        return say(
            "{name}: {value:.4g}{more}{unit}{allowed}",
            name=self.name,
            value=self.value,
            more=more,
            unit=unit,
            allowed=allowed,
        )


class StepPicture(Section):
    """A picture of a step.

    Attributes
    ----------
    file : its path from the folder of the step's evidence
    caption : caption of the picture
    sha256 : SHA-256 of its bytes
    """

    file: str
    caption: str
    sha256: Sha256


class GivenAnswer(Section):
    """A question to a person, and the answer.

    Attributes
    ----------
    text : text of the question
    choice : answer given
    who : gave the answer
    """

    text: Sentence
    choice: Sentence
    who: str


class StepRecord(Section):
    """One run of one step.

    Attributes
    ----------
    step : its name
    message : reason why it did not pass; empty if it did
    began, ended : UTC
    by : name of the person who commissioned
    software : software used
    cell : name of the cell
    cell_digest : digest of what the nominal cell file describes, `cell_digest`
    emulated : the devices that were emulated
    evidence : folder of its pictures, from the folder of the commissioning
    based_on : calibrations it used, by the hash of their file
    made : calibrations it wrote, by the hash of their file
    """

    schema_: Literal[1] = Field(1, alias="schema")
    step: str
    outcome: StepEnd
    message: Sentence = ""
    began: datetime
    ended: datetime
    by: str = ""
    software: str = ""
    cell: str = ""
    cell_digest: Sha256
    emulated: tuple[str, ...] = ()
    evidence: str = ""
    based_on: Mapping[CalibrationName, Sha256] = Field(default_factory=dict)
    made: Mapping[CalibrationName, Sha256] = Field(default_factory=dict)
    figures: tuple[StepFigure, ...] = ()
    findings: tuple[str, ...] = ()
    pictures: tuple[StepPicture, ...] = ()
    answers: tuple[GivenAnswer, ...] = ()

    @model_validator(mode="after")
    def _times_are_in_order(self) -> "StepRecord":
        if self.began.tzinfo is None or self.ended.tzinfo is None:
            raise ValueError("`began` and `ended` need their offset from UTC")
        if self.ended < self.began:
            raise ValueError("`ended` is before `began`")
        return self


def worst_of(figures: Iterable[StepFigure]) -> tuple[StepFigure, ...]:
    """Return the figures that do not keep their limits."""
    return tuple(figure for figure in figures if not figure.is_within)
