"""Judged parts as QIF 3.0 results (references.md S20).

One document holds one product: its characteristics as definition, nominal and item, and for each
part one set of measurement results with an actual component. A rim that is measured is a circle
feature, a face at whose edges a distance is measured is a plane feature.

Three things are not as in our own tables. A position is in QIF the diameter of its zone, so that
value, limit and uncertainty are doubled. `combinedUncertainty` is the standard uncertainty, half of
U. A part that cannot be decided upon is UNKNOWN, as QIF has no word for it; a characteristic is
INDETERMINATE. Identifiers follow from what they name: the same run gives the same bytes.
"""

import hashlib
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from lxml import etree

from controller.cell.journal.rows import CharacteristicFields
from controller.config.cad_files import cad_identity

from ..judged import DECISION_RULE, JudgedPart, shared_characteristics
from ..wording import K_U

QIF_NAMESPACE: Final = "http://qifstandards.org/xsd/qif3"
VERSION: Final = "3.0.0"
UUIDS: Final = uuid.uuid5(uuid.NAMESPACE_DNS, "qif.cellctl")
STATUS: Final[Mapping[str, str]] = {
    "pass": "PASS",
    "fail": "FAIL",
    "indeterminate": "INDETERMINATE",
    "not evaluated": "NOT_ANALYZED",
}
PART_STATUS: Final[Mapping[str, str]] = {
    "pass": "PASS",
    "fail": "FAIL",
    "indeterminate": "UNKNOWN",
    "not evaluated": "NOT_MEASURED",
    "no verdict": "NOT_MEASURED",
}
CLASSES: Final[Mapping[str, str]] = {
    "diameter": "Diameter",
    "position": "Position",
    "distance": "DistanceBetween",
    "length": "Length",
    "width": "Width",
    "radius": "Radius",
    "angle": "Angle",
    "straightness": "Straightness",
    "roundness": "Circularity",
}
SIDE: Final[Mapping[bool | None, str]] = {
    True: "INTERNAL",
    False: "EXTERNAL",
    None: "NOT_APPLICABLE",
}
DRAWING_STANDARD: Final = ("1101", "2017")  # standard of geometrical tolerances
# A position's zone is stated as a diameter, its measured value is a radius.
ZONE_DIAMETER: Final = 2.0


def qif_bytes(parts: Sequence[JudgedPart]) -> bytes:
    """Return the document.

    Raises
    ------
    ValueError : no part, or parts of different products
    """
    if not parts:
        raise ValueError("a QIF document of results needs a part")
    return _Document(parts).as_bytes()


@dataclass(slots=True)
class _Feature:
    """A feature of the product, and the identifiers of its four aspects."""

    tag: str
    name: str
    definition: int
    nominal: int
    item: int
    characteristic: CharacteristicFields
    anchor: int


@dataclass(slots=True)
class _Ids:
    """Hands out the identifiers of a document, from 1."""

    last: int = 0

    def next(self) -> int:
        self.last += 1
        return self.last


@dataclass(slots=True)
class _Document:
    parts: Sequence[JudgedPart]
    ids: _Ids = field(default_factory=_Ids)
    features: dict[tuple[object, ...], _Feature] = field(default_factory=dict)
    features_of: dict[str, list[_Feature]] = field(default_factory=dict)
    items: dict[str, int] = field(default_factory=dict)

    def as_bytes(self) -> bytes:
        """Return the document's bytes.

        Raises
        ------
        ValueError : parts of different products
        """
        asked = {c.id: c for c in shared_characteristics(self.parts)}
        head = self.parts[0].header
        root = etree.fromstring(f'<QIFDocument xmlns="{QIF_NAMESPACE}"/>')
        qpid = _add(root, "QPId")
        _add(_add(root, "Version"), "TimeCreated", self.parts[-1].header.end.isoformat())
        header = _add(root, "Header")
        application = _add(header, "Application")
        _add(application, "Name", f"cellctl {head.software.get('cellctl', '')}".strip())
        _add(header, "Description", _words(self.parts))
        standard = self._standard(root) if asked else 0
        _units(root)
        device = self._device(root, head.cell)
        component = self._product(root)
        if asked:
            self._find_features(tuple(asked.values()))
            self._features(root)
            self._characteristics(root, tuple(asked.values()), standard)
        self._results(root, device, component)
        root.set("versionQIF", VERSION)
        root.set("idMax", str(self.ids.last))
        # what the document is called follows from all that it says
        qpid.text = str(uuid.uuid5(UUIDS, hashlib.sha256(etree.tostring(root)).hexdigest()))
        found: bytes = etree.tostring(
            root, xml_declaration=True, encoding="UTF-8", pretty_print=True
        )
        return found

    # --- the product --------------------------------------------------------------------------

    def _standard(self, root: etree._Element) -> int:
        standard = _add(_list(root, "StandardsDefinitions", 1), "Standard", id=self.ids.next())
        _add(_add(standard, "Organization"), "StandardsOrganizationEnum", "ISO")
        designator, year = DRAWING_STANDARD
        _add(standard, "Designator", designator)
        _add(standard, "Year", year)
        return self.ids.last

    def _device(self, root: etree._Element, name: str) -> int:
        devices = _list(_add(root, "MeasurementResources"), "MeasurementDevices", 1)
        device = _add(devices, "MeasurementDevice", id=self.ids.next())
        _add(device, "Name", f"cell {name}" if name else "cellctl")
        return self.ids.last

    def _product(self, root: etree._Element) -> int:
        head = self.parts[0].header
        product = _add(root, "Product")
        part = _add(
            _list(product, "PartSet", 1), "Part", id=self.ids.next(), hidden="0", transparency="0"
        )
        part_id = self.ids.last
        if head.cad_sha256:
            _add(part, "UUID", str(uuid.uuid5(UUIDS, cad_identity(head.cad, head.cad_sha256))))
        _add(part, "ModelNumber", head.cad or head.part)
        component = _add(
            _list(product, "ComponentSet", 1),
            "Component",
            id=self.ids.next(),
            hidden="0",
            transparency="0",
        )
        component_id = self.ids.last
        _add(_add(component, "Part"), "Id", str(part_id))
        path = _add(_list(product, "AsmPaths", 1), "AsmPath", id=self.ids.next())
        _add(_list(path, "ComponentIds", 1), "Id", str(component_id))
        return self.ids.last

    # --- features -----------------------------------------------------------------------------

    def _find_features(self, asked: Sequence[CharacteristicFields]) -> None:
        for c in asked:
            self.features_of[c.id] = []
            if c.axis is None:
                continue
            is_rim = c.rim_radius_mm is not None
            for index, anchor in enumerate(c.anchors_mm):
                key = (is_rim, anchor, c.axis, c.rim_radius_mm, index)
                if key not in self.features:
                    tag = "Circle" if is_rim else "Plane"
                    self.features[key] = _Feature(
                        tag,
                        f"{tag.lower()} {len(self.features) + 1}",
                        self.ids.next(),
                        self.ids.next(),
                        self.ids.next(),
                        c,
                        index,
                    )
                self.features_of[c.id].append(self.features[key])

    def _features(self, root: etree._Element) -> None:
        if not self.features:
            return
        found = tuple(self.features.values())
        features = _add(root, "Features")
        definitions = _list(features, "FeatureDefinitions", len(found))
        nominals = _list(features, "FeatureNominals", len(found))
        items = _list(features, "FeatureItems", len(found))
        for f in found:
            c = f.characteristic
            definition = _add(definitions, f"{f.tag}FeatureDefinition", id=f.definition)
            if c.rim_radius_mm is not None:
                _add(definition, "InternalExternal", SIDE[c.is_hole])
                _add(definition, "Diameter", _number(2 * c.rim_radius_mm))
            nominal = _add(nominals, f"{f.tag}FeatureNominal", id=f.nominal)
            _add(nominal, "FeatureDefinitionId", str(f.definition))
            _add(nominal, "Location", _vector(c.anchors_mm[f.anchor]))
            assert c.axis is not None
            _add(nominal, "Normal", _vector(_outwards(c, f.anchor)))
            item = _add(items, f"{f.tag}FeatureItem", id=f.item)
            _add(item, "FeatureNominalId", str(f.nominal))
            _add(item, "FeatureName", f.name)
            checked = _add(_add(item, "DeterminationMode"), "Checked")
            _add(_add(checked, "CheckDetails"), "Measured")

    # --- characteristics ----------------------------------------------------------------------

    def _characteristics(
        self, root: etree._Element, asked: Sequence[CharacteristicFields], standard: int
    ) -> None:
        part = _add(root, "Characteristics")
        _add(part, "FormalStandardId", str(standard))
        definitions = _list(part, "CharacteristicDefinitions", len(asked))
        nominals = _list(part, "CharacteristicNominals", len(asked))
        items = _list(part, "CharacteristicItems", len(asked))
        for c in asked:
            name = CLASSES[c.kind]
            definition = _add(definitions, f"{name}CharacteristicDefinition", id=self.ids.next())
            _attributes(definition, {"limits from": c.source})
            _limits(definition, c)
            nominal = _add(nominals, f"{name}CharacteristicNominal", id=self.ids.next())
            nominal_id = self.ids.last
            _add(nominal, "CharacteristicDefinitionId", definition.get("id"))
            of_it = self.features_of[c.id]
            _ids(nominal, "FeatureNominalIds", [f.nominal for f in of_it])
            if c.kind not in ("position", "straightness", "roundness"):
                _add(nominal, "TargetValue", _number(c.nominal))
            if c.kind == "distance":
                _add(nominal, "AnalysisMode", "THREEDIMENSIONAL")
            item = _add(items, f"{name}CharacteristicItem", id=self.ids.next())
            self.items[c.id] = self.ids.last
            _add(item, "Description", c.label or c.id)
            _add(item, "Name", c.id)
            designator = _add(item, "CharacteristicDesignator")
            _add(designator, "Designator", str(c.balloon))
            head = self.parts[0].header
            cad = cad_identity(head.cad, head.cad_sha256) or head.part
            _add(designator, "UUID", str(uuid.uuid5(UUIDS, f"{cad} {c.id}")))
            if c.is_critical:
                _add(_add(designator, "Criticality"), "LevelEnum", "CRITICAL")
            _ids(item, "FeatureItemIds", [f.item for f in of_it])
            _add(item, "CharacteristicNominalId", str(nominal_id))

    # --- results ------------------------------------------------------------------------------

    def _results(self, root: etree._Element, device: int, path: int) -> None:
        results = _add(root, "Results")
        found = _list(results, "MeasurementResultsSet", len(self.parts))
        components: list[int] = []
        for judged in self.parts:
            self.ids.next()
            components.append(self.ids.last)
            self._part_results(found, judged, device, components[-1])
        actual = _list(
            _list(results, "ActualComponentSets", 1), "ActualComponentSet", len(self.parts)
        )
        for judged, component in zip(self.parts, components, strict=True):
            header = judged.header
            element = _add(actual, "ActualComponent", id=component)
            _add(element, "SerialNumber", header.serial or f"{header.run_id} {header.number}")
            _part_status(element, "Status", judged.verdict)
            trace = _add(element, "Traceability")
            if header.lot:
                _add(trace, "LotNumber", header.lot)
            _add(trace, "InspectionStart", header.start.isoformat())
            _add(trace, "InspectionEnd", header.end.isoformat())
            if header.operator:
                _add(_add(trace, "InspectionOperator"), "Name", header.operator)
            _add(element, "AsmPathId", str(path))

    def _part_results(
        self, found: etree._Element, judged: JudgedPart, device: int, component: int
    ) -> None:
        results = _add(found, "MeasurementResults", id=self.ids.next())
        _attributes(results, _notes(judged))
        name = f"{judged.header.run_id} {judged.header.number} {judged.header.start.isoformat()}"
        _add(results, "ThisResultsInstanceQPId", str(uuid.uuid5(UUIDS, name)))
        measured = {f.item: self.ids.next() for f in self.features.values()}
        diameters = {
            id(f): c
            for c in judged.part.characteristics
            if c.kind == "diameter"
            for f in self.features_of[c.id]
        }
        if measured:
            features = _list(results, "MeasuredFeatures", len(measured))
            for f in self.features.values():
                element = _add(features, f"{f.tag}FeatureMeasurement", id=measured[f.item])
                _add(element, "FeatureItemId", str(f.item))
                diameter = diameters.get(id(f))
                if diameter is not None and diameter.measured is not None:
                    _measured(element, "Diameter", diameter)
        if judged.part.characteristics:
            holder = _add(results, "MeasuredCharacteristics")
            values = _list(holder, "CharacteristicMeasurements", len(judged.part.characteristics))
            for c in judged.part.characteristics:
                element = _add(
                    values, f"{CLASSES[c.kind]}CharacteristicMeasurement", id=self.ids.next()
                )
                _attributes(element, {"reason": c.reason, "views": " ".join(c.views)})
                status = _add(element, "Status")
                _add(status, "CharacteristicStatusEnum", STATUS[c.verdict])
                _add(element, "CharacteristicItemId", str(self.items[c.id]))
                _ids(
                    element,
                    "FeatureMeasurementIds",
                    [measured[f.item] for f in self.features_of[c.id]],
                )
                _add(element, "ActualComponentId", str(component))
                _ids(element, "MeasurementDeviceIds", [device])
                if c.measured is not None:
                    _measured(element, "Value", c)
        _part_status(results, "InspectionStatus", judged.verdict)
        _ids(results, "ActualComponentIds", [component])


def _limits(definition: etree._Element, c: CharacteristicFields) -> None:
    if c.kind == "position":
        _add(definition, "ToleranceValue", _number(ZONE_DIAMETER * c.upper))
        _add(definition, "MaterialCondition", "NONE")
        _add(_add(definition, "ZoneShape"), "DiametricalZone")
    elif c.kind in ("straightness", "roundness"):
        _add(definition, "ToleranceValue", _number(c.upper))
        if c.kind == "straightness":
            _add(_add(definition, "ZoneShape"), "NonDiametricalZone")
    else:
        tolerance = _add(definition, "Tolerance")
        _add(tolerance, "MaxValue", _number(c.upper))
        _add(tolerance, "MinValue", _number(c.lower))
        _add(tolerance, "DefinedAsLimit", "true")


def _measured(parent: etree._Element, tag: str, c: CharacteristicFields) -> None:
    factor = ZONE_DIAMETER if c.kind == "position" else 1.0
    assert c.measured is not None
    element = _add(parent, tag, _number(factor * c.measured))
    if c.U is not None:  # the schema wants both or neither; what was known was corrected
        element.set("combinedUncertainty", _number(factor * c.U / K_U))
        element.set("meanError", "0")


def _outwards(c: CharacteristicFields, anchor: int) -> tuple[float, float, float]:
    """Return the outward normal of a rim's plane, or of one face of a distance."""
    assert c.axis is not None
    x, y, z = c.axis
    # a distance goes from its first face to its second; the faces of a slot look at each other
    is_back = c.rim_radius_mm is None and (anchor == 0) != (c.kind == "width")
    return (-x, -y, -z) if is_back else (x, y, z)


def _notes(judged: JudgedPart) -> dict[str, str]:
    """Return the facts for which QIF has no element."""
    header, verdict = judged.header, judged.part.verdict
    notes = {
        "decision rule": DECISION_RULE,
        "run": header.run_id,
        "recipe": header.recipe,
        "recipe sha256": header.recipe_sha256,
        "CAD sha256": header.cad_sha256,
        "emulated": ", ".join(header.emulated_devices),
        **{key.replace("_", " "): number for key, number in header.papers.items()},
    }
    if header.part_temperature_c is not None:
        notes["part temperature [C]"] = _number(header.part_temperature_c)
    if verdict is not None:
        notes["surface compared"] = _number(verdict.compared_fraction)
        notes |= {f"reason {i}": reason for i, reason in enumerate(verdict.reasons, start=1)}
    for i, one in enumerate(judged.part.reviews, start=1):
        words = [f"finding {n} {word.replace('_', ' ')}" for n, word in one.findings.items()]
        said = "; ".join([one.verdict, *words, one.why])
        notes[f"review {i}"] = f"{said} ({one.who}, {one.at.isoformat()})"
    for f in judged.part.findings:
        at = _vector(f.p_part_mm)
        notes[f"finding {f.number}"] = f"{f.kind}, {f.size_mm:.2f} mm, at {at}, view {f.view}"
    return notes


def _words(parts: Sequence[JudgedPart]) -> str:
    header = parts[0].header
    emulated = "EMULATED CELL, not a production result. " if header.emulated_devices else ""
    return f"{emulated}Inspection of {header.part}, decided by {DECISION_RULE}."


def _units(root: etree._Element) -> None:
    primary = _add(_add(root, "FileUnits"), "PrimaryUnits")
    for kind, si, name, factor in (
        ("AngularUnit", "radian", "degree", "0.017453292519943295"),
        ("LinearUnit", "meter", "mm", "0.001"),
    ):
        unit = _add(primary, kind)
        _add(unit, "SIUnitName", si)
        _add(unit, "UnitName", name)
        _add(_add(unit, "UnitConversion"), "Factor", factor)


def _part_status(parent: etree._Element, tag: str, verdict: str) -> None:
    _add(_add(parent, tag), "InspectionStatusEnum", PART_STATUS[verdict])


def _ids(parent: etree._Element, tag: str, ids: Sequence[int]) -> None:
    if ids:
        listed = _list(parent, tag, len(ids))
        for number in ids:
            _add(listed, "Id", str(number))


def _attributes(parent: etree._Element, notes: Mapping[str, str]) -> None:
    known = {name: text for name, text in notes.items() if text}
    if known:
        listed = _list(parent, "Attributes", len(known))
        for name, text in known.items():
            _add(listed, "AttributeStr", name=name, value=_clean(text))


def _list(parent: etree._Element, tag: str, count: int) -> etree._Element:
    return _add(parent, tag, n=count)


def _add(
    parent: etree._Element, tag: str, text: str | None = None, **attributes: str | int
) -> etree._Element:
    element = etree.SubElement(parent, f"{{{QIF_NAMESPACE}}}{tag}")
    if text is not None:
        element.text = _clean(text)
    for name, value in attributes.items():
        element.set(name, str(value))
    return element


def _clean(text: str) -> str:
    """Return a text without the characters that XML cannot hold."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def _number(value: float) -> str:
    return f"{value:.6f}".rstrip("0").rstrip(".") if value else "0"


def _vector(values: Sequence[float]) -> str:
    return " ".join(_number(v) for v in values)
