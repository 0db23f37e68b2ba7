"""The report to sign: the results of each device, with space for name, date and signature."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from controller.results.pages import make_environment, write_file
from controller.results.report import PdfError, pdf_bytes
from controller.setup.software import software_versions

from .suite import MET, NOT_MET, NOT_TRIED, Findings, TriedDevice

SCHEMA: Final = "cellctl-conformance/1"
TEMPLATE: Final = "conformance.html.j2"
BADGES: Final = {MET: "pass", NOT_MET: "fail", NOT_TRIED: "doubt"}


def write_report(findings: Findings, path: Path) -> list[Path]:
    """Write the report and its JSON; return their paths.

    Parameters
    ----------
    findings : results
    path : .html or .pdf; the JSON stands beside it

    Raises
    ------
    OSError : a file cannot be written
    """
    text = json.dumps(report_json(findings), indent=1, ensure_ascii=False)
    written = [write_file(text.encode(), path.with_suffix(".json"))]
    page = page_of(findings)
    if path.suffix.lower() != ".pdf":
        return [write_file(page.encode(), path), *written]
    try:
        pdf = pdf_bytes(page, f"Conformance of {findings.cell}", findings.begun)
    except PdfError:  # the page stands where the PDF would have stood
        return [write_file(page.encode(), path.with_suffix(".html")), *written]
    return [write_file(pdf, path), *written]


def page_of(findings: Findings) -> str:
    """Return the report as a page."""
    made = make_environment(__package__, [TEMPLATE]).get_template(TEMPLATE)
    return made.render(
        findings=findings,
        at=f"{findings.begun:%Y-%m-%d %H:%M} UTC",
        software=software_versions(),
        devices=[(tried, _summary(tried)) for tried in findings.devices],
        badges=BADGES,
    )


def _summary(tried: TriedDevice) -> str:
    count = Counter(outcome.verdict for outcome in tried.outcomes)
    return ", ".join(f"{count[verdict]} {verdict}" for verdict in BADGES if count[verdict])


def report_json(findings: Findings) -> dict[str, Any]:
    """Return the report as JSON."""
    return {
        "schema": SCHEMA,
        "cell": findings.cell,
        "cell_file": {"path": str(findings.path), "sha256": findings.sha256},
        "begun": findings.begun.isoformat(),
        "software": software_versions(),
        "devices": [asdict(tried) for tried in findings.devices],
    }
