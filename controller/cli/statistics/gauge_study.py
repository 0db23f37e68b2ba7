"""`cellctl gauge`: a study of measuring scatter, kept with the runs and found again."""

from datetime import UTC, datetime
from pathlib import Path

from rich import box
from rich.table import Table

from controller.results.gauge import (
    CharacteristicGauge,
    StudySources,
    gauge_row,
    kept_studies,
    read_references,
    said_of_all,
    study_json,
    study_readings,
    write_evidence,
    write_gauge_page,
)
from controller.results.wording import count_of
from controller.setup.software import software_versions

from ..inputs.checks import check_writable_folder
from ..terminal.figures_table import print_table
from ..terminal.output import emit, print_line, warn
from ._output import check_page
from .gauge_sources import read_sources

TEXT_COLUMNS = 220
COLUMNS = (
    "characteristic", "n", "in one\ngrasp", "with\nre-grasps", "gauge", "%T", "ndc", "bias",
    "Cg, Cgk", "look to look\n(upper bound)", "to note",
)  # fmt: skip


def report_gauge(
    sources: list[str],
    recipe_path: Path | None,
    reference: Path | None,
    report: Path | None,
    runs_dir: Path,
    *,
    as_json: bool,
) -> int:
    """Study repeated measurements, print and keep the study; return the exit code.

    Parameters
    ----------
    sources : sets of views and runs, with the names of their groups or without
    recipe_path : recipe to measure sets by; None for their own
    reference : table of true values; None for none
    report : page to write; None for none
    runs_dir : folder of all runs, which the study is kept in
    as_json : print JSON lines instead of a table

    Returns
    -------
    exit code: 0 where a study was made, 1 where nothing was measured twice

    Raises
    ------
    ConfigError : a source, the references or the name of the report are wrong
    """
    check_page(report)
    check_writable_folder(runs_dir, "--runs")
    found = read_sources(sources, recipe_path, runs_dir)
    measured = {c.id for r in found.readings for c in r.characteristics if c.measured is not None}
    parts = {r.part for r in found.readings}
    references = read_references(reference, measured, parts) if reference else []
    gauges = study_readings(found.readings, references)
    evidence = StudySources(
        datetime.now(UTC),
        found.part,
        found.cad_sha256,
        software_versions(),
        found.inputs,
        references,
        found.remarks,
    )
    if as_json:
        for gauge in gauges:
            emit({"event": "characteristic", **study_json(gauge)})
    else:
        _print(gauges)
    for sentence in (*said_of_all(gauges), *found.remarks):
        (warn if as_json else print_line)(sentence)
    if not any(g.study or g.looks for g in gauges):
        return 1
    kept = write_evidence(runs_dir, evidence, gauges)
    if as_json:
        emit({"event": "evidence", "file": str(kept), "data_allow": said_of_all(gauges)})
    else:
        print_line(f"evidence: {kept}")
    if report is not None:
        write_gauge_page(evidence, gauges, kept, report)
        (warn if as_json else print_line)(f"report: {report}")
    return 0


def list_studies(runs_dir: Path, *, as_json: bool) -> int:
    """Print the studies kept in a folder of runs, newest first; return the exit code.

    Parameters
    ----------
    runs_dir : folder of all runs
    as_json : print JSON lines instead of sentences
    """
    studies = kept_studies(runs_dir)
    if not studies and not as_json:
        print_line(f"no gauge study is kept in {runs_dir}")
    for one in studies:
        if one.problem:
            warn(f"{one.path}: {one.problem}")
        elif as_json:
            emit(
                {
                    "event": "study",
                    "file": str(one.path),
                    "at": one.at,
                    "part": one.part,
                    "readings": one.reading_count,
                    "characteristics": one.characteristic_count,
                    "worst_percent_of_tolerance": one.worst_percent,
                }
            )
        else:
            worst = "" if one.worst_percent is None else f", at worst {one.worst_percent:.1f} %T"
            print_line(
                f"{one.path}: {one.part}, {count_of(one.reading_count, 'reading')} of "
                f"{count_of(one.characteristic_count, 'characteristic')}{worst}"
            )
    return 0


def _print(gauges: tuple[CharacteristicGauge, ...]) -> None:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    print_table(table, COLUMNS, map(gauge_row, gauges), TEXT_COLUMNS)
    print_line(
        "Six standard deviations in um (angles: degrees), in brackets their 95 % interval; "
        "%T: of the tolerance"
    )
