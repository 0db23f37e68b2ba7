"""The plate of NIST's box assembly: its CAD model, what was measured of 20 real ones, twins.

Data: github.com/usnistgov/smstestbed, folder tdp/mtc (public information of NIST, free to copy):
    CAD/NIST-MTC-CRADA-Models_Rev-A/nist_mtc_crada_plate.STEP
    QIF-IncomingInspection/PlateResults_20_samples.QIF
Neither is kept here; `read_plates` takes a folder that is a checkout of it.

A twin is the nominal plate with every measured feature filled and cut anew as it was measured:
17 round holes, a round end, three slots, length and width. Flatness and squareness are left as
drawn. Of the STEP file's five bodies the plate is the largest; the others are the islands of
letters cut through it.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from trace_held_parts import PLUG_MM, SAG_MM, block, body_of, rod

Array = NDArray[np.float64]
Body = Any  # manifold3d's solid

STEP = "tdp/mtc/CAD/NIST-MTC-CRADA-Models_Rev-A/nist_mtc_crada_plate.STEP"
QIF = "tdp/mtc/QIF-IncomingInspection/PlateResults_20_samples.QIF"
SPACE = "{http://qifstandards.org/xsd/qif2}"
SIZE_MM = np.array([120.0, 71.16, 5.0])
OVER_MM = 0.5  # cuts go this far beyond the plate
COUNTERSINK_MM = 2.55  # the walls of the screw holes end here
SCREW_MM = 4.5
KEYHOLE_MM, KEYHOLE_WIDTH_MM = np.array([35.0, 15.0]), 5.0  # runs along x
KEYHOLE_END_MM = np.array([42.5, 15.0])
KINDS = {
    "Diameter": "diameter",
    "Length": "length",
    "Width": "width",
    "Radius": "radius",
    "Position": "position",
    "DistanceBetween": "length",
}


@dataclass(frozen=True)
class Feature:
    """A feature as it was measured.

    Attributes
    ----------
    kind : hole, slot or other
    nominal_mm : (2,) where its axis is drawn
    place_mm : (2,) and where it was found
    diameter_mm : of a hole, twice the radius of the corner
    width_mm, length_mm : of a slot
    """

    kind: str
    nominal_mm: Array
    place_mm: Array
    diameter_mm: float = 0.0
    width_mm: float = 0.0
    length_mm: float = 0.0


@dataclass(frozen=True)
class Result:
    """A characteristic as it was published: limits, value [mm], verdict; feature's number."""

    name: str
    kind: str
    nominal_mm: float
    lower_mm: float
    upper_mm: float
    value_mm: float
    verdict: str
    feature: str


@dataclass(frozen=True)
class Plate:
    """One real plate: its serial number, its features by number, its results."""

    serial: str
    features: dict[str, Feature]
    results: tuple[Result, ...]

    @property
    def size_mm(self) -> Array:
        """Length and width as measured, and the nominal thickness, (3,)."""
        out = SIZE_MM.copy()
        for result in self.results:
            for axis in (0, 1):
                if result.kind == "length" and result.nominal_mm == SIZE_MM[axis]:
                    out[axis] = result.value_mm
        return out


def read_plates(folder: Path) -> list[Plate]:
    """Return what was measured of the 20 plates.

    Parameters
    ----------
    folder : a checkout of usnistgov/smstestbed
    """
    root = ET.parse(folder / QIF).getroot()
    by_id = {e.get("id", ""): e for e in root.iter() if e.get("id")}
    serials = {
        e.get("id", ""): _text(e, "SerialNumber").removeprefix("PLATE_RESULTS_")[:3]
        for e in root.iter(f"{SPACE}ActualComponent")
        if e.get("id")
    }
    plates = []
    for number, measured in enumerate(root.iter(f"{SPACE}MeasurementResults")):
        features, of_item = {}, {}
        for actual in measured.iter():
            if actual.tag.endswith("FeatureActual") and actual.get("id"):
                name = str(actual.get("id"))
                nominal = by_id[_text(by_id[_text(actual, "FeatureItemId")], "FeatureNominalId")]
                features[name] = _feature(actual, nominal)
                of_item[_text(actual, "FeatureItemId")] = name
        results = []
        for actual in measured.iter():
            if actual.tag.endswith("CharacteristicActual"):
                results.append(_result(actual, by_id))
        shown = [serials.get(_text(e, "Id")) for e in measured.iter(f"{SPACE}ActualComponentIds")]
        serial = next((s for s in shown if s), f"A{number + 1:02d}")
        plates.append(Plate(serial, features, tuple(results)))
    return plates


def _text(element: ET.Element, name: str) -> str:
    found = element.find(f".//{SPACE}{name}")
    return (found.text or "").strip() if found is not None else ""


def _numbers(element: ET.Element, name: str) -> Array:
    return np.array([float(word) for word in _text(element, name).split()])


def _feature(actual: ET.Element, nominal: ET.Element) -> Feature:
    if "CylinderFeature" in actual.tag:
        point, along = _numbers(actual, "AxisPoint"), _numbers(actual, "Direction")
        middle = point + along * (SIZE_MM[2] / 2 - point[2]) / along[2]
        return Feature("hole", _numbers(nominal, "AxisPoint")[:2], middle[:2],
                       diameter_mm=float(_text(actual, "Diameter")))  # fmt: skip
    if "OppositeParallelLines" in actual.tag:
        return Feature(
            "slot", _numbers(nominal, "StartPoint")[:2], _numbers(actual, "StartPoint")[:2],
            width_mm=float(_text(actual, "Width")), length_mm=float(_text(actual, "Length")),
        )  # fmt: skip
    return Feature("other", np.zeros(2), np.zeros(2))


def _result(actual: ET.Element, by_id: dict[str, ET.Element]) -> Result:
    item = by_id[_text(actual, "CharacteristicItemId")]
    nominal = by_id[_text(item, "CharacteristicNominalId")]
    definition = by_id[_text(nominal, "CharacteristicDefinitionId")]
    target = float(_text(nominal, "TargetValue") or 0.0)
    most = _text(definition, "MaxValue") or _text(definition, "ToleranceValue")
    least = _text(definition, "MinValue") or "0"
    kind = actual.tag.removeprefix(SPACE).removesuffix("CharacteristicActual")
    return Result(
        name=_text(item, "Name"),
        kind=KINDS.get(kind, kind.lower()),
        nominal_mm=target,
        lower_mm=target + float(least),
        upper_mm=target + float(most),
        value_mm=float(_text(actual, "Value")),
        verdict=_text(actual, "CharacteristicStatusEnum"),
        feature=_text(actual, "Id") if actual.find(f"{SPACE}FeatureActualIds") is not None else "",
    )


def write_nominal(folder: Path, path: Path) -> None:
    """Write the plate alone as a STEP file.

    Parameters
    ----------
    folder : a checkout of usnistgov/smstestbed
    path : of the file
    """
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Reader, STEPControl_Writer
    from OCP.TopAbs import TopAbs_SOLID
    from OCP.TopExp import TopExp_Explorer

    reader = STEPControl_Reader()
    reader.ReadFile(str(folder / STEP))
    reader.TransferRoots()
    explorer = TopExp_Explorer(reader.OneShape(), TopAbs_SOLID)
    bodies = []
    while explorer.More():
        volume = GProp_GProps()
        BRepGProp.VolumeProperties_s(explorer.Current(), volume)
        bodies.append((volume.Mass(), explorer.Current()))
        explorer.Next()
    writer = STEPControl_Writer()
    writer.Transfer(max(bodies, key=lambda one: one[0])[1], STEPControl_AsIs)
    writer.Write(str(path))


def twin(mesh: trimesh.Trimesh, plate: Plate) -> Body:
    """Return a plate as it was measured.

    The measured radius (drawn 2.5 mm, the round end of the keyhole) is cut where it was found.

    Parameters
    ----------
    mesh : the nominal plate [mm], its lower corner in the origin
    plate : what was measured
    """
    middle = SIZE_MM / 2
    scaled = plate.size_mm / SIZE_MM * (mesh.vertices - middle) + middle
    body = body_of(trimesh.Trimesh(scaled, mesh.faces, process=False))
    top = SIZE_MM[2] + OVER_MM
    for feature in plate.features.values():
        if feature.kind == "slot":
            body = body + _obround(feature, is_drawn=True) - _obround(feature, is_drawn=False)
        elif feature.kind == "hole":
            drawn = _drawn_mm(mesh, feature.nominal_mm)
            if np.allclose(feature.nominal_mm, KEYHOLE_END_MM, atol=0.01):
                body = body - _pin(feature.place_mm, feature.diameter_mm, -OVER_MM, top)
                continue
            wall = COUNTERSINK_MM if drawn == SCREW_MM else SIZE_MM[2]
            body = body + _pin(feature.nominal_mm, drawn + 2 * PLUG_MM, 0.0, wall)
            over = wall + OVER_MM
            body = body - _pin(feature.place_mm, feature.diameter_mm, -OVER_MM, over)
            if np.allclose(feature.nominal_mm, KEYHOLE_MM, atol=0.01):
                half = KEYHOLE_WIDTH_MM / 2
                low = [KEYHOLE_MM[0], KEYHOLE_MM[1] - half, -OVER_MM]
                body = body - block(low, [KEYHOLE_END_MM[0], KEYHOLE_MM[1] + half, top])
    return body


def _pin(at: Array, diameter_mm: float, low: float, high: float) -> Body:
    return rod(np.array([*at, low]), np.array([*at, high]), diameter_mm, SAG_MM)


def _drawn_mm(mesh: trimesh.Trimesh, at: Array) -> float:
    """Return the nominal diameter of the hole about an axis, from the nearest of its corners."""
    low = mesh.vertices[np.abs(mesh.vertices[:, 2]) < 1e-6]
    radius = float(np.linalg.norm(low[:, :2] - at, axis=1).min())
    return round(8 * radius) / 4


def _obround(feature: Feature, *, is_drawn: bool) -> Body:
    """Return what fills a slot along y as drawn, or what cuts it as measured."""
    if is_drawn:
        width, length = min(
            ((5.0, 30.0), (4.0, 17.5)), key=lambda drawn: abs(drawn[1] - feature.length_mm)
        )
        width, length = width + 2 * PLUG_MM, length + 2 * PLUG_MM
        low, high, at = 0.0, SIZE_MM[2], feature.nominal_mm
    else:
        width, length = feature.width_mm, feature.length_mm
        low, high, at = -OVER_MM, SIZE_MM[2] + OVER_MM, feature.place_mm
    half = (length - width) / 2
    out = block([at[0] - width / 2, at[1] - half, low], [at[0] + width / 2, at[1] + half, high])
    for sign in (-1.0, 1.0):
        out = out + _pin(at + np.array([0.0, sign * half]), width, low, high)
    return out
