"""cell.yaml: the devices' addresses and the cell's places in the world. mm, degrees, seconds."""

import socket
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import (
    AfterValidator,
    AliasChoices,
    BeforeValidator,
    Field,
    PrivateAttr,
    model_validator,
)

from ..calibration_reference import CalibrationName, CalibrationReference
from ..faults import FaultsSection
from ..file_kinds import is_recipe
from ..interlock_rules import InterlockRules
from ..yaml_models import Section, WrongKeyError
from .arm import OtherArmSection, UmiSection, arm_section
from .connect import ConnectSection
from .devices import (
    EMULATED,
    DetectionSection,
    DevicesSection,
    InterlocksSection,
    OutputsSection,
    TimingSection,
)
from .optics import AccuracySection, CamerasSection, LampSection, StationSection
from .surroundings import ChuteSection, FixedGripperSection, TableSection, TraysSection
from .values import IN_MM, Box, require_all_different

REQUIRED_LAMPS = (
    "table_backlight",
    "table_ring",
    "table_side",
    "station_backlight",
    "station_ring",
    "station_side",
)

MAX_NAME = 40


def _fit_for_a_name(name: str) -> str:
    """Return a cell's name; raise ValueError if a topic, a folder or an address cannot have it."""
    fits = len(name) <= MAX_NAME and all(c.isalnum() or c in "._- " for c in name)
    if not (fits and name and name[0].isalnum()):
        raise ValueError(f"must be 1 to {MAX_NAME} letters, digits, blanks, `.`, `_` or `-`")
    return name


def _host_name() -> str:
    """Return this computer's name, as far as a cell's name may have its signs."""
    name = "".join(c if c.isalnum() or c in ".-" else "-" for c in socket.gethostname())
    return name.strip(".-")[:MAX_NAME] or "cell"


class Cell(Section):
    """One cell, as its file describes it.

    Attributes
    ----------
    name : name of the cell, in journal, reports, store and all that a plant system gets (default:
        the name of this computer)
    calibration : files of what was measured; they take the place of the drawing's values
    clock : clock of the emulator whose addresses are given in `devices`
    arm : a UMI RTX, or an arm of another make, which has `shape`
    obstacles : further boxes in the world that nothing may touch
    interlock_rules : rules beside those that every cell has, by name
    on_alarm : program, with its arguments, that is called when an alarm is raised
    connect : wires to a plant system
    """

    name: Annotated[str, AfterValidator(_fit_for_a_name)] = Field(default_factory=_host_name)
    devices: DevicesSection
    calibration: dict[CalibrationName, CalibrationReference] = Field(default_factory=dict)
    clock: Path | None = None
    timing: TimingSection = TimingSection()
    table: TableSection
    cameras: CamerasSection
    station: StationSection
    lamps: dict[str, LampSection]
    arm: Annotated[UmiSection | OtherArmSection, BeforeValidator(arm_section)]
    fixed_gripper: FixedGripperSection = Field(
        validation_alias=AliasChoices("fixed_gripper", "fixture"), serialization_alias="fixture"
    )
    obstacles: dict[str, Box] = Field(default_factory=dict)
    chute: ChuteSection | None = None
    trays: TraysSection
    interlocks: InterlocksSection = InterlocksSection()
    outputs: OutputsSection = OutputsSection()
    interlock_rules: InterlockRules = Field(default_factory=dict)
    accuracy: AccuracySection = AccuracySection()
    faults: FaultsSection = FaultsSection()
    detection: DetectionSection = DetectionSection()
    on_alarm: tuple[str, ...] = Field((), max_length=50)
    connect: ConnectSection | None = None
    _folder: Path = PrivateAttr(default=Path())

    @model_validator(mode="before")
    @classmethod
    def _is_no_recipe(cls, tree: Any) -> Any:  # noqa: ANN401 - pydantic's signature
        if is_recipe(tree):
            raise ValueError("is a recipe, not a cell file; name the cell file of this cell")
        return tree

    @model_validator(mode="after")
    def _lamps_are_all_there(self) -> "Cell":
        missing = [lamp for lamp in REQUIRED_LAMPS if lamp not in self.lamps]
        if missing:
            raise ValueError(f"`lamps` lacks {', '.join(missing)}")
        require_all_different(
            "`lamps`: analog channel", {n: x.analog for n, x in self.lamps.items()}
        )
        require_all_different("`lamps`: relay", {n: x.relay for n, x in self.lamps.items()})
        return self

    @model_validator(mode="after")
    def _cameras_see_what_they_are_for(self) -> "Cell":
        area = self.table.drop_area
        middle = (sum(area.x) / 2, sum(area.y) / 2, 0.0)
        for name, camera, point, what in (
            ("overhead", self.cameras.overhead, middle, "the middle of `table.drop_area`"),
            ("inspection", self.cameras.inspection, self.station.position, "`station.position`"),
        ):
            if not camera.sees(np.array(point)):
                raise WrongKeyError(
                    ("cameras", name, "pose"), f"{what} is not in its picture; {IN_MM}"
                )
        return self

    @property
    def folder(self) -> Path:
        """Folder of the cell file, if it was read from one."""
        return self._folder

    def read_from(self, path: Path) -> Self:
        """Return this cell with a note that it was read from ``path``."""
        self._folder = path.absolute().parent
        return self

    @property
    def emulated_devices(self) -> tuple[str, ...]:
        """The names of the devices to be emulated."""
        devices = self.devices
        return tuple(
            name
            for name in type(devices).model_fields
            if getattr(devices, name).address == EMULATED
        )
