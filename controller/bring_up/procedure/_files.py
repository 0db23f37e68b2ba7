"""The folder of a commissioning: records, calibrations, evidence, and the cell file.

::

    cell.yaml               the cell file as commissioned
    calibrations/NAME.json  what was measured
    steps/STEP.json         the last record of each step
    evidence/DATE-STEP/     its pictures, and the same record
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Final, get_args

from controller.config import Cell, ConfigError, load_cell
from controller.config.calibration_reference import CalibrationName, CalibrationReference
from controller.config.calibrations import Calibration, write_calibration
from controller.config.files import read_bytes, read_text, reason_of, write_whole
from messages.form import from_said, said_in

from ._cell_file import calibrated_text
from ._record import StepEnd, StepRecord

CALIBRATION_NAMES: Final[tuple[CalibrationName, ...]] = get_args(CalibrationName)
MAX_RECORD_BYTES: Final = 4 << 20


class CommissioningFolder:
    """Files of a commissioning.

    Parameters
    ----------
    path : path of the folder; it need not exist
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def cell_file(self) -> Path:
        """The cell file as commissioned."""
        return self.path / "cell.yaml"

    def record_file(self, step: str) -> Path:
        """Return the path of a step's last record."""
        return self.path / "steps" / f"{step}.json"

    def calibration_file(self, name: CalibrationName) -> Path:
        """Return the path of a calibration."""
        return self.path / "calibrations" / f"{name}.json"

    def begin_evidence(self, step: str, at: datetime) -> Path:
        """Make and return a folder for the evidence of one run of a step.

        Raises
        ------
        ConfigError : it cannot be made
        """
        base = f"{at:%Y%m%d-%H%M%S}-{step}"
        for number in range(1000):
            folder = self.path / "evidence" / (f"{base}-{number}" if number else base)
            try:
                folder.mkdir(parents=True)
            except FileExistsError:
                continue
            except OSError as error:
                raise ConfigError(f"{folder}: cannot be made: {reason_of(error)}") from error
            return folder
        raise ConfigError(f"{self.path / 'evidence'}: has no name left for {base}")

    def read_records(self, steps: tuple[str, ...]) -> dict[str, StepRecord]:
        """Return the last record of each step that has one.

        Raises
        ------
        ConfigError : a record is damaged
        """
        found = {}
        for step in steps:
            path = self.record_file(step)
            if path.exists():
                found[step] = _read_record(path, step)
        return found

    def write_record(self, record: StepRecord) -> None:
        """Write a record beside its evidence, and as the last one of its step.

        An interrupted run does not replace a finished one.

        Raises
        ------
        ConfigError : it cannot be written
        """
        body = record.model_dump(mode="json", by_alias=True) | said_in(record.model_dump())
        text = json.dumps(body, indent=1, ensure_ascii=False)
        if record.evidence:
            write_whole(self.path / record.evidence / "record.json", text + "\n")
        last = self.record_file(record.step)
        if record.outcome is StepEnd.BROKEN_OFF and last.exists():
            return
        write_whole(last, text + "\n")

    def references(self) -> dict[CalibrationName, CalibrationReference]:
        """Return the calibrations that the cell file as commissioned names.

        Raises
        ------
        ConfigError : a calibration that was there cannot be read
        """
        found = {}
        for name in CALIBRATION_NAMES:
            path = self.calibration_file(name)
            if path.exists():
                digest = hashlib.sha256(read_bytes(path, MAX_RECORD_BYTES, "a calibration"))
                found[name] = CalibrationReference(
                    file=str(path.relative_to(self.path)), sha256=digest.hexdigest()
                )
        return found

    def keep(
        self, nominal: Path, calibrations: Mapping[CalibrationName, Calibration]
    ) -> dict[CalibrationName, str]:
        """Write calibrations and the cell file that refers to them; return their hashes.

        Parameters
        ----------
        nominal : cell file whose text is kept
        calibrations : new ones, by name

        Raises
        ------
        ConfigError : a file cannot be read or written
        """
        made = {
            name: write_calibration(self.calibration_file(name), one)
            for name, one in calibrations.items()
        }
        self.write_cell(nominal)
        return made

    def write_cell(self, nominal: Path) -> None:
        """Write the cell file as commissioned: the nominal one's text and the calibrations.

        Raises
        ------
        ConfigError : a file cannot be read or written
        """
        text = calibrated_text(read_text(nominal, "a cell file"), self.references())
        write_whole(self.cell_file, text)

    def load_for(self, nominal: Path, makes: Sequence[CalibrationName]) -> Cell:
        """Return the cell as commissioned so far, without the values a step is about to measure.

        Parameters
        ----------
        nominal : cell file whose text is kept
        makes : the calibrations left out

        Raises
        ------
        ConfigError : a file cannot be read or written, or a calibration is wrong
        """
        kept = {name: one for name, one in self.references().items() if name not in makes}
        draft = self.path / ".step.yaml"
        write_whole(draft, calibrated_text(read_text(nominal, "a cell file"), kept))
        try:
            return load_cell(draft).read_from(nominal)
        finally:
            draft.unlink(missing_ok=True)


def _read_record(path: Path, step: str) -> StepRecord:
    data = read_bytes(path, MAX_RECORD_BYTES, "a record")
    try:
        record = StepRecord.model_validate(from_said(json.loads(data)))
    except ValueError as error:
        first = str(error).splitlines()[0]
        raise ConfigError(
            f"{path}: is no record of commissioning ({first:.120}); remove it and repeat the step"
        ) from error
    if record.step != step:
        raise ConfigError(f"{path}: is the record of `{record.step}`; remove it, repeat the step")
    return record
