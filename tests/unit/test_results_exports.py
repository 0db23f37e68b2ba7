"""Exports: QIF against its schema and beside NIST's, dfq by an independent reader, CSV, JSON."""

from __future__ import annotations

import csv
import gzip
import io
import json
import time
import zipfile
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

import pytest
from lxml import etree

from controller.inspection import Verdict
from controller.inspection.characteristics import CharacteristicKind
from controller.results.exports import csv_text, dfq_bytes, qif_bytes
from controller.results.judged import result_json
from controller.results.run import ReviewReport
from controller.results.writing import SUFFIXES, write_report
from tests.unit import judged_bench as bench

DATA = Path(__file__).resolve().parents[1] / "data" / "qif"
QIF3 = "{http://qifstandards.org/xsd/qif3}"


@pytest.fixture(scope="session")
def schema(tmp_path_factory: pytest.TempPathFactory) -> etree.XMLSchema:
    folder = tmp_path_factory.mktemp("qif")
    with zipfile.ZipFile(DATA / "qif3_schema.zip") as archive:
        archive.extractall(folder)
    return etree.XMLSchema(etree.parse(folder / "QIFDocument.xsd"))


def read_qif(data: bytes) -> list[list[tuple[str, float | None, str]]]:
    """Return name, value and status of each characteristic of each part, of QIF 2.1 or 3.0."""
    root = etree.fromstring(data)
    names = {
        item.get("id"): item.findtext("{*}Name") or item.findtext(".//{*}Designator")
        for item in root.iter("{*}*")
        if etree.QName(item).localname.endswith("CharacteristicItem")
    }
    parts = []
    for results in root.iter("{*}MeasurementResults"):
        found = []
        for one in results.iter("{*}*"):
            # version 2 called an actual what version 3 calls a measurement
            if not etree.QName(one).localname.endswith(
                ("CharacteristicActual", "CharacteristicMeasurement")
            ):
                continue
            value = one.findtext("{*}Value")
            found.append(
                (
                    str(names[one.findtext("{*}CharacteristicItemId")]),
                    None if value is None else float(value),
                    str(one.findtext("{*}Status/{*}CharacteristicStatusEnum")),
                )
            )
        parts.append(found)
    return parts


@cache
def nist() -> bytes:
    return gzip.decompress((DATA / "nist_plate_results.qif.gz").read_bytes())


def test_the_reader_finds_in_nists_file_what_is_published_of_it() -> None:
    # counted in the published file: 20 parts of 31 characteristics, 569 pass and 51 fail
    parts = read_qif(nist())
    assert [len(part) for part in parts] == [31] * 20
    statuses = [status for part in parts for _, _, status in part]
    assert (statuses.count("PASS"), statuses.count("FAIL")) == (569, 51)
    assert all(value is not None for part in parts for _, value, _ in part)


def test_the_same_reader_finds_values_and_statuses_in_ours(tmp_path: Path) -> None:
    (found,) = read_qif(qif_bytes([bench.judged(tmp_path)]))
    assert found == [
        ("diameter 1", 8.031, "PASS"),
        ("position 2", 0.082, "PASS"),  # of the zone: twice the radial distance
        ("distance 3", 40.29, "INDETERMINATE"),
        ("length 4", 60.71, "FAIL"),
        ("width 5", 5.98, "PASS"),
        ("radius 6", 2.44, "PASS"),
        ("angle 7", pytest.approx(90.1), "PASS"),
        ("straightness 8", 0.02, "PASS"),
        ("roundness 9", None, "NOT_ANALYZED"),
    ]


@pytest.mark.parametrize("count", [1, 3])
def test_every_document_is_valid_qif(tmp_path: Path, schema: etree.XMLSchema, count: int) -> None:
    made = bench.inspection(findings=(bench.chip(),))
    parts = [bench.judged(tmp_path, made, number=i, serial=f"S{i}") for i in range(count)]
    document = etree.fromstring(qif_bytes(parts))
    schema.assertValid(document)
    serials = [e.text for e in document.iter(f"{QIF3}SerialNumber")]
    assert serials == [f"S{i}" for i in range(count)]


def test_a_part_without_characteristics_is_valid_too(
    tmp_path: Path, schema: etree.XMLSchema
) -> None:
    schema.assertValid(etree.fromstring(qif_bytes([bench.judged(tmp_path, bench.inspection(()))])))


def test_the_schema_refuses_a_status_that_qif_does_not_have(
    tmp_path: Path, schema: etree.XMLSchema
) -> None:
    data = qif_bytes([bench.judged(tmp_path)]).replace(b">INDETERMINATE<", b">UNDECIDED<")
    assert not schema.validate(etree.fromstring(data))


@pytest.mark.parametrize(
    ("verdict", "status"),
    [("pass", "PASS"), ("fail", "FAIL"), ("indeterminate", "UNKNOWN")],
)
def test_the_parts_verdict_is_its_status(tmp_path: Path, verdict: str, status: str) -> None:
    made = bench.inspection(verdict=Verdict(verdict))
    document = etree.fromstring(qif_bytes([bench.judged(tmp_path, made)]))
    found = [e.text for e in document.iter(f"{QIF3}InspectionStatusEnum")]
    assert found == [status, status]  # of the results, and of the component


def test_uncertainty_is_standard_uncertainty_and_doubled_for_a_zone(tmp_path: Path) -> None:
    document = etree.fromstring(qif_bytes([bench.judged(tmp_path)]))
    values = [
        m.find(f"{QIF3}Value")
        for m in document.iter()
        if str(m.tag).endswith("teristicMeasurement")
    ]
    assert values[0] is not None
    assert values[1] is not None
    assert values[0].get("combinedUncertainty") == "0.01"  # U is 0.02 with k = 2
    assert values[1].get("combinedUncertainty") == "0.02"


def test_limits_are_limits_and_a_position_has_a_round_zone(tmp_path: Path) -> None:
    document = etree.fromstring(qif_bytes([bench.judged(tmp_path)]))
    bore = document.find(f".//{QIF3}DiameterCharacteristicDefinition/{QIF3}Tolerance")
    assert bore is not None
    assert [e.text for e in bore] == ["8.2", "7.8", "true"]
    zone = document.find(f".//{QIF3}PositionCharacteristicDefinition/{QIF3}ToleranceValue")
    assert zone is not None
    assert zone.text == "0.3"


def test_diameter_and_position_of_a_hole_are_of_one_feature(tmp_path: Path) -> None:
    document = etree.fromstring(qif_bytes([bench.judged(tmp_path)]))
    features = {
        etree.QName(item).localname: item.findtext(f"{QIF3}FeatureItemIds/{QIF3}Id")
        for item in document.iter()
        if str(item.tag).endswith("CharacteristicItem")
    }
    assert features["DiameterCharacteristicItem"] == features["PositionCharacteristicItem"]
    assert features["RadiusCharacteristicItem"] != features["DiameterCharacteristicItem"]


def test_the_same_results_give_the_same_bytes_and_others_another_name(tmp_path: Path) -> None:
    one = qif_bytes([bench.judged(tmp_path)])
    assert qif_bytes([bench.judged(tmp_path)]) == one
    other = qif_bytes([bench.judged(tmp_path, serial="SN-0043")])
    names = [etree.fromstring(data).findtext(f"{QIF3}QPId") for data in (one, other)]
    assert names[0] != names[1]
    uuids = [[e.text for e in etree.fromstring(d).iter(f"{QIF3}UUID")] for d in (one, other)]
    assert uuids[0] == uuids[1]  # the product and its characteristics are the same
    assert len(set(uuids[0])) == len(uuids[0])


def test_markup_in_names_stays_text_in_qif(tmp_path: Path, schema: etree.XMLSchema) -> None:
    evil = 'bore </Name><x a="\x07&'
    one = bench.all_kinds()[0]
    made = bench.inspection((replace(one, characteristic=replace(one.characteristic, id=evil)),))
    document = etree.fromstring(qif_bytes([bench.judged(tmp_path, made, serial="<S>&")]))
    schema.assertValid(document)
    assert document.findtext(f".//{QIF3}DiameterCharacteristicItem/{QIF3}Name") == (
        'bore </Name><x a=" &'
    )


def test_a_persons_verdict_stands_beside_the_machines(
    tmp_path: Path, schema: etree.XMLSchema
) -> None:
    judged = bench.judged(tmp_path)
    at = datetime(2026, 3, 1, 12, tzinfo=UTC)
    review = ReviewReport(at, "reject", "Ann & Co", "a <dent>", judged.verdict, {1: "real"})
    reviewed = replace(judged, part=replace(judged.part, reviews=(review,)))
    document = etree.fromstring(qif_bytes([reviewed]))
    schema.assertValid(document)
    status = ".//{*}InspectionStatus/{*}InspectionStatusEnum"
    before = etree.fromstring(qif_bytes([judged])).findtext(status)
    assert document.findtext(status) == before
    (note,) = [one for one in document.iter("{*}AttributeStr") if one.get("name") == "review 1"]
    assert note.get("value") == (
        "reject; finding 1 real; a <dent> (Ann & Co, 2026-03-01T12:00:00+00:00)"
    )
    row = next(csv.DictReader(io.StringIO(csv_text([reviewed]))))
    assert (row["review"], row["review_who"], row["part_verdict"]) == (
        "reject", "Ann & Co", judged.verdict,
    )  # fmt: skip


def test_parts_of_two_products_are_refused(tmp_path: Path) -> None:
    other = bench.inspection(bench.all_kinds()[:3])
    parts = [bench.judged(tmp_path), bench.judged(tmp_path, other)]
    for write in (qif_bytes, dfq_bytes):
        with pytest.raises(ValueError, match="differ"):
            write(parts)


def test_a_part_that_was_not_measured_has_no_values(
    tmp_path: Path, schema: etree.XMLSchema
) -> None:
    parts = [bench.judged(tmp_path, bench.inspection(())), bench.judged(tmp_path, number=2)]
    document = qif_bytes(parts)
    schema.assertValid(etree.fromstring(document))
    assert [len(part) for part in read_qif(document)] == [0, 9]
    assert len(read_dfq(dfq_bytes(parts))[1]) == 1


# --- dfq -------------------------------------------------------------------------------------


def read_dfq(data: bytes) -> tuple[dict[str, str], list[list[list[str]]], dict[str, list[str]]]:
    """Return fields of head, values by part and characteristic, and fields behind values."""
    head: dict[str, str] = {}
    values: list[list[list[str]]] = []
    behind: dict[str, list[str]] = {}
    for line in data.decode("utf-8-sig").split("\r\n"):
        if line.startswith("K"):
            key, text = line.split(" ", 1)
            if key.startswith("K00"):
                behind.setdefault(key, []).append(text)
            else:
                assert key not in head
                head[key] = text
        elif line:
            values.append([one.split("\x14") for one in line.split("\x0f")])
    return head, values, behind


@pytest.mark.parametrize(("zone", "ahead_h"), [("Europe/Berlin", (1, 2)), ("UTC", (0, 0))])
def test_a_dfq_file_has_the_plants_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, zone: str, ahead_h: tuple[int, int]
) -> None:
    judged = bench.judged(tmp_path)
    monkeypatch.setenv("TZ", zone)
    time.tzset()
    try:
        _, values, _ = read_dfq(dfq_bytes([judged]))
    finally:
        monkeypatch.undo()
        time.tzset()
    at = datetime.strptime(values[0][0][2], "%d.%m.%Y/%H:%M:%S")  # noqa: DTZ007 - it has no zone
    ahead = at - judged.header.end.astimezone(UTC).replace(tzinfo=None, microsecond=0)
    assert ahead.total_seconds() / 3600 in ahead_h  # winter or summer


def test_a_dfq_file_holds_head_and_values(tmp_path: Path) -> None:
    parts = [bench.judged(tmp_path, number=i, serial=f"S{i}") for i in (1, 2)]
    head, values, behind = read_dfq(dfq_bytes(parts))
    assert head["K0100"] == "9"
    assert head["K1001/1"] == "bracket"
    assert (head["K2101/1"], head["K2110/1"], head["K2111/1"]) == ("8.0000", "7.8000", "8.2000")
    assert (head["K2142/1"], head["K2142/7"], head["K2022/3"]) == ("mm", "deg", "4")
    assert head["K2120/1"] == "1"  # a limit of the drawing
    assert head["K2120/2"] == "2"  # no position is below 0
    assert [len(line) for line in values] == [9, 9]
    assert values[0][0] == ["8.0310", "0", "01.03.2026/12:01:30"]
    assert values[0][8] == ["0.0000", "256", "01.03.2026/12:01:30"]  # not evaluated: invalid
    assert behind["K0014/0"] == ["S1", "S2"]
    assert behind["K0006/0"] == ["L7", "L7"]


def test_a_name_cannot_begin_a_field_of_its_own(tmp_path: Path) -> None:
    one = bench.measured(
        1, CharacteristicKind.DIAMETER, 8.0, 0.2, 9.9, Verdict.FAIL, bench.rim(0.0),
        label="bore\r\nK2111/1 99",
    )  # fmt: skip
    head, _, _ = read_dfq(dfq_bytes([bench.judged(tmp_path, bench.inspection((one,)))]))
    assert head["K2111/1"] == "8.2000"
    assert head["K2002/1"] == "bore K2111/1 99"


def test_names_beyond_ascii_mark_the_file_as_utf8(tmp_path: Path) -> None:
    assert dfq_bytes([bench.judged(tmp_path)]).isascii()
    data = dfq_bytes([bench.judged(tmp_path, part="Gehäuse")])
    assert data.startswith(b"\xef\xbb\xbf")
    assert read_dfq(data)[0]["K1001/1"] == "Gehäuse"


# --- CSV and JSON -----------------------------------------------------------------------------


def test_the_table_has_a_row_for_each_characteristic_and_part(tmp_path: Path) -> None:
    parts = [bench.judged(tmp_path, number=i) for i in (1, 2)]
    rows = list(csv.DictReader(io.StringIO(csv_text(parts))))
    assert len(rows) == 18
    assert (rows[3]["id"], rows[3]["verdict"]) == ("length 4", "fail")
    assert float(rows[3]["measured"]) == pytest.approx(60.71)
    assert float(rows[3]["deviation"]) == pytest.approx(0.71)
    assert rows[8]["measured"] == rows[8]["U_k2"] == ""
    assert [row["number"] for row in rows[::9]] == ["1", "2"]


def test_no_text_of_the_table_is_a_formula(tmp_path: Path) -> None:
    rows = list(
        csv.DictReader(io.StringIO(csv_text([bench.judged(tmp_path, serial="=1+1", lot="-x")])))
    )
    assert (rows[0]["serial"], rows[0]["lot"]) == ("'=1+1", "'-x")
    assert rows[4]["deviation"] == "-0.02"  # a number is one


def test_the_json_holds_values_uncertainties_and_verdicts(tmp_path: Path) -> None:
    made = bench.inspection(findings=(bench.chip(),))
    body = json.loads(json.dumps(result_json(bench.judged(tmp_path, made)), allow_nan=False))
    assert (body["schema"], body["schema_version"]) == ("cellctl.result", 1)
    angle = body["characteristics"][6]
    assert (angle["unit"], angle["nominal"]) == ("deg", pytest.approx(90))
    assert (angle["measured"], angle["U"]) == (pytest.approx(90.1), pytest.approx(0.03))
    bore = body["characteristics"][0]
    assert bore["deviation"] == pytest.approx(0.031)
    assert bore["looks"][0]["budget"] == {"edge": 0.002, "scale": 0.005}
    assert body["characteristics"][8]["measured"] is None
    (finding,) = body["findings"]
    assert (finding["kind"], finding["verdict"], finding["size_mm"]) == ("chip", "fail", 3.25)
    assert body["header"]["serial"] == "SN-0042"


# --- files ------------------------------------------------------------------------------------


def test_the_suffix_decides_what_a_report_is(tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    parts = [bench.judged(tmp_path / "pictures")]
    out = tmp_path / "out"
    for suffix in SUFFIXES:
        assert write_report(parts, out / f"bracket{suffix.upper()}").stat().st_size > 500
    assert json.loads((out / "bracket.JSON").read_text())["schema"] == "cellctl.result"
    assert read_qif((out / "bracket.QIF").read_bytes())[0][0][0] == "diameter 1"
    assert len(list(out.iterdir())) == len(SUFFIXES)  # nothing half-written is left
    with pytest.raises(
        ValueError, match=r"bracket\.docx: the suffix of a report is one of \.pdf, \.html"
    ):
        write_report(parts, out / "bracket.docx")
    with pytest.raises(ValueError, match="no part"):
        write_report([], out / "none.csv")
