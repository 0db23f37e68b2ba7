"""A part's inspection as lines of JSON: characteristics, findings, faces, verdict (inspect.md)."""

import hashlib
import json
from collections.abc import Iterator
from math import degrees
from typing import Any

from controller.arrays import FloatArray
from controller.inspection import Detection, FaceVerdict, PartFinding, PartInspection
from controller.inspection.characteristics import (
    CharacteristicKind,
    Measured,
    place_of,
)


def json_lines(part: PartInspection) -> Iterator[dict[str, Any]]:
    """Yield the lines of a part: each characteristic, each finding, at the end the verdict."""
    for measured in part.measured:
        yield _characteristic(measured)
    for finding in part.findings:
        yield _finding(finding)
    yield {
        "event": "verdict",
        "verdict": part.verdict.value,
        "covered_fraction": part.ledger.compared_fraction,
        "reasons": list(part.reasons),
        "unproven": list(part.unproven),
        "found": [_detection(one) for one in part.ledger.detections],
    }


def face_lines(part: PartInspection) -> Iterator[dict[str, Any]]:
    """Yield a line for each face: the share compared, the check, and the reason for the rest."""
    for face in part.ledger.faces:
        yield _face(face)


def lines_digest(part: PartInspection) -> str:
    """Return the SHA-256 of the lines of a part, every number to its last bit."""
    return hashlib.sha256(json.dumps(list(json_lines(part))).encode()).hexdigest()


def in_unit(measured: Measured, value: float | None) -> float | None:
    """Return a value of a characteristic in the unit of files: mm, degrees for an angle."""
    if value is None or measured.characteristic.kind is not CharacteristicKind.ANGLE:
        return value
    return degrees(value)


def _characteristic(measured: Measured) -> dict[str, Any]:
    asked = measured.characteristic
    p_part_mm, axis = place_of(asked.geometry)
    line: dict[str, Any] = {
        "event": "characteristic",
        "id": asked.id,
        "kind": asked.kind.value,
        "p_part_mm": _numbers(p_part_mm),
        "axis": _numbers(axis),
        "nominal_mm": in_unit(measured, asked.nominal_mm),
        "measured_mm": in_unit(measured, measured.measured_mm),
        "U_mm": in_unit(measured, measured.U_mm),
        "lower": in_unit(measured, asked.lower_mm),
        "upper": in_unit(measured, asked.upper_mm),
        "verdict": measured.verdict.value,
        "views": list(measured.views),
        "reason": measured.reason,
        "balloon": asked.balloon,
        "source": asked.source,
    }
    if asked.kind is CharacteristicKind.ANGLE:
        line["unit"] = "deg"  # of all values of this line, whatever the keys end in
    return line


def _finding(finding: PartFinding) -> dict[str, Any]:
    return {
        "event": "finding",
        "kind": finding.kind,
        "view": finding.view_id,
        "lamp": finding.lamp,
        "p_part_mm": _numbers(finding.p_part_mm),
        "size_mm": float(finding.size_mm),
        "area_mm2": None if finding.area_mm2 is None else float(finding.area_mm2),
        "faces": [int(face) for face in finding.faces],
        "verdict": finding.verdict.value,
        "pictures": [list(picture) for picture in finding.pictures],
    }


def _face(face: FaceVerdict) -> dict[str, Any]:
    return {
        "event": "face",
        "face": face.face_id,
        "label": face.label,
        "area_mm2": face.area_mm2,
        "compared_fraction": face.compared_fraction,
        "by_check": dict(face.by_check),
        "rest": dict(face.rest),
        "verdict": face.verdict.value,
        "views": list(face.views),
        "reason": face.reason,
    }


def _detection(one: Detection) -> dict[str, Any]:
    return {
        "kind": one.kind,
        "size_mm": one.size_mm,
        "share": one.share,
        "half_mm": one.half_mm,
        "asked": one.is_asked,
        "open_faces": [face for face, _ in one.open_faces],
    }


def _numbers(values: FloatArray) -> list[float]:
    return [float(value) for value in values]
