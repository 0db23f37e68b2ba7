"""Read and write calibration files."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from ..calibration_reference import CalibrationName, CalibrationReference
from ..errors import ConfigError
from ..files import parse_json, read_bytes, write_whole
from ..yaml_models import WrongKeyError
from ._models import (
    ArmCalibration,
    Calibration,
    CameraCalibration,
    FixedGripperCalibration,
    LampsCalibration,
    TraysCalibration,
    VerificationRecord,
)

MAX_BYTES: Final = 4 << 20
MODELS: Final[Mapping[CalibrationName, type[Calibration]]] = {
    "overhead": CameraCalibration,
    "inspection": CameraCalibration,
    "arm": ArmCalibration,
    "fixed_gripper": FixedGripperCalibration,
    "trays": TraysCalibration,
    "lamps": LampsCalibration,
    "verification": VerificationRecord,
}


def read_calibration(path: Path, name: CalibrationName) -> Calibration:
    """Return a calibration file.

    Raises
    ------
    ConfigError : unreadable, not JSON, of another kind, or a value is missing or out of range
    """
    return _parse(path, name, read_bytes(path, MAX_BYTES, "a calibration"))


def read_calibrations(
    cell_path: Path, references: Mapping[CalibrationName, CalibrationReference]
) -> dict[CalibrationName, Calibration]:
    """Return the calibrations that a cell file refers to, by name.

    Raises
    ------
    ConfigError : as in `read_calibration`, or a file is not the one that the cell file refers to
    """
    found: dict[CalibrationName, Calibration] = {}
    for name, reference in references.items():
        path = cell_path.parent / reference.file
        where = f"{cell_path}: `calibration.{name}`"
        try:
            data = read_bytes(path, MAX_BYTES, "a calibration")
        except ConfigError as error:
            raise ConfigError(f"{where}: {error}") from error
        if hashlib.sha256(data).hexdigest() != reference.sha256:
            raise ConfigError(
                f"{where}: {path} has changed since the cell file referred to it; commission the "
                f"cell again, or give the hash of the file that you trust"
            )
        found[name] = _parse(path, name, data)
    return found


def _parse(path: Path, name: CalibrationName, data: bytes) -> Calibration:
    model = MODELS[name]
    tree = parse_json(data, path, "a calibration")
    kind = model.model_fields["kind"].default
    if not isinstance(tree, dict) or tree.get("kind") != kind:
        given = tree.get("kind") if isinstance(tree, dict) else None
        raise ConfigError(
            f"{path}: is of kind {given!r:.40}; a calibration of kind `{kind}` is required"
        )
    try:
        return model.model_validate(tree)
    except ValidationError as error:
        raise ConfigError(f"{path}: {first_problem(error)}") from error


def first_problem(error: ValidationError) -> str:
    """Return the first problem that a model found, with its key."""
    first = error.errors()[0]
    location, message = list(first["loc"]), first["msg"].removeprefix("Value error, ")
    inner = first.get("ctx", {}).get("error")
    if isinstance(inner, WrongKeyError):
        location += inner.location
    return f"`{'.'.join(map(str, location)) or 'file'}`: {message}"


def digest_of(calibration: Calibration) -> str:
    """Return the SHA-256 of the bytes that `write_calibration` writes for a calibration."""
    return hashlib.sha256(_text_of(calibration).encode()).hexdigest()


def _text_of(calibration: Calibration) -> str:
    return json.dumps(calibration.as_json(), indent=1, ensure_ascii=False) + "\n"


def write_calibration(path: Path, calibration: Calibration) -> str:
    """Write a calibration file, whole or not at all; return the SHA-256 of its bytes.

    Raises
    ------
    ConfigError : it cannot be written
    """
    write_whole(path, _text_of(calibration))
    return digest_of(calibration)
