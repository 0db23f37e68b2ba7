"""The report as PDF: three pages, the same bytes again, nothing from outside, a clear refusal."""

from __future__ import annotations

import base64
import hashlib
import re
import sys
import zlib
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest

from controller.cad.compiled import load_part
from controller.inspection import Verdict
from controller.results.report import PdfError, pdf_bytes
from controller.results.writing import write_report
from tests.data_files import part_file
from tests.unit import judged_bench as bench

AT = datetime(2026, 3, 1, 12, 1, 30, tzinfo=UTC)


def texts_of(what: bytes, pdf: bytes) -> list[bytes]:
    """Return what a pattern finds in a document, also in its packed objects."""
    texts = [pdf]
    for packed in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, re.S):
        try:
            texts.append(zlib.decompress(packed))
        except zlib.error:
            continue  # a picture
    return [found for text in texts for found in re.findall(what, text)]


def count_of(what: bytes, pdf: bytes) -> int:
    """Return how often a pattern is in a document, also in its packed objects."""
    return len(texts_of(what, pdf))


def page_count(pdf: bytes) -> int:
    """Return how many page objects a document has."""
    return count_of(rb"/Type\s*/Page\b", pdf)


def test_links_lead_to_their_place_within_the_document(capfd: pytest.CaptureFixture[str]) -> None:
    page = '<p><a href="#there">go</a></p><p id="there" style="break-before: page">here</p>'
    pdf = pdf_bytes(page, "two pages", AT)
    assert count_of(rb"/Subtype\s*/Link\b", pdf) == 1
    assert count_of(rb"/URI\b", pdf) == 0
    assert capfd.readouterr().err == ""


def test_a_part_prints_on_three_pages_at_most(tmp_path: Path) -> None:
    solid = load_part(part_file("flange_xy.stl")).solid
    path = write_report([bench.judged(tmp_path)], tmp_path / "r.pdf", solid)
    pdf = path.read_bytes()
    assert pdf.startswith(b"%PDF-")
    assert page_count(pdf) <= 3
    assert len(pdf) < 2_000_000


def test_thirty_characteristics_still_print_on_three_pages(tmp_path: Path) -> None:
    one = bench.all_kinds()[0].characteristic.kind
    many = tuple(
        bench.measured(i, one, 8.0, 0.2, 8.01, Verdict.PASS, bench.rim(i)) for i in range(1, 31)
    )
    solid = load_part(part_file("flange_xy.stl")).solid
    judged = bench.judged(tmp_path, bench.inspection(many))
    assert page_count(write_report([judged], tmp_path / "r.pdf", solid).read_bytes()) <= 3


def test_nothing_shrinks_the_paper_so_that_drawings_keep_their_scale(tmp_path: Path) -> None:
    solid = load_part(part_file("flange_xy.stl")).solid
    kind, rim = bench.all_kinds()[0].characteristic.kind, bench.rim(1.0)
    why = "no view shows the rim at less than 30 deg, and all others show it in the shadow of jaws"
    values: tuple[tuple[float | None, Verdict, str], ...] = (
        (108.5, Verdict.PASS, ""), (None, Verdict.NOT_EVALUATED, why),
    )  # fmt: skip
    made = tuple(
        bench.measured(i, kind, 108.5, 0.25, value, verdict, rim, reason=reason)
        for i, (value, verdict, reason) in enumerate(values, start=1)
    )
    judged = bench.judged(tmp_path, bench.inspection(made))
    pdf = write_report([judged], tmp_path / "r.pdf", solid).read_bytes()
    widths_mm = {
        float(w) * 25.4 / 72 for w in texts_of(rb"([\d.]+) 0 0 -[\d.]+ [\d.]+ [\d.]+ cm", pdf)
    }
    # the part coloured by its ledger is 40 mm wide in the style sheet
    assert any(abs(width_mm - 40.0) < 0.05 for width_mm in widths_mm), widths_mm


def test_the_same_part_gives_the_same_bytes(tmp_path: Path) -> None:
    hashes = set()
    for name in ("one.pdf", "two.pdf"):
        path = write_report([bench.judged(tmp_path)], tmp_path / name)
        hashes.add(hashlib.sha256(path.read_bytes()).hexdigest())
    assert len(hashes) == 1


def test_nothing_is_fetched_from_outside(tmp_path: Path) -> None:
    picture = tmp_path / "secret.jpg"
    assert cv2.imwrite(str(picture), np.full((40, 40), 90, np.uint8))
    data = base64.b64encode(picture.read_bytes()).decode()
    inside = pdf_bytes(f'<p>text</p><img src="data:image/jpeg;base64,{data}">', "t", AT)
    assert b"/Subtype /Image" in inside
    outside = pdf_bytes(f'<p>text</p><img src="{picture.as_uri()}">', "t", AT)
    assert b"/Subtype /Image" not in outside


def test_a_page_without_letters_is_refused_and_html_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(PdfError, match="no font"):
        pdf_bytes("<svg width='9' height='9'></svg>", "t", AT)
    monkeypatch.setitem(sys.modules, "plutoprint", None)  # as where its wheel cannot be installed
    with pytest.raises(PdfError, match=r"install the package plutoprint.*r\.html"):
        write_report([bench.judged(tmp_path)], tmp_path / "r.pdf")
    assert "Reviewed by" in (tmp_path / "r.html").read_text()
    assert not (tmp_path / "r.pdf").exists()
