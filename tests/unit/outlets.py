"""Every outlet that counts parts, as one list: what each says of all runs in a folder.

An outlet takes a folder of runs and returns what it counts: one entry a part.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING
from unittest.mock import patch
from xml.etree import ElementTree

import pytest

from controller.cell.journal import JOURNAL_NAME, read_rows_counted, rows
from controller.cell.journal.usage import usage_of
from controller.history import (
    GROUPS,
    Filters,
    Store,
    characteristics_in,
    export,
    figures,
    fill,
    find_parts,
    list_parts,
    open_store,
    values_of,
)
from controller.history.reviewing import agreement
from controller.results.exports import QIF_NAMESPACE
from controller.results.judged import counted_parts
from controller.results.report import report_json
from controller.results.run import list_runs, load_run
from controller.results.statistics import series_of
from controller.results.takt import grouped, takts_of
from controller.results.writing import write_report

if TYPE_CHECKING:
    from tests.unit.page_bench import Bench

Counted = Sequence[str]
PART_LINK = r"/history/part/([^\"?]+)"


@contextmanager
def store_of(runs: Path) -> Iterator[Store]:
    store = open_store(f"sqlite:///{runs / 'history.sqlite'}")
    try:
        fill(store, runs)
        yield store
    finally:
        store.close()


def recipe_of(runs: Path) -> str:
    (recipe,) = {load_run(runs, one.run_id).recipe_name for one in list_runs(runs)}
    return recipe


def records(runs: Path) -> Counted:
    return [
        f"{judged.header.run_id}/{judged.header.number}"
        for one in list_runs(runs)
        for judged in counted_parts(load_run(runs, one.run_id))
    ]


def reports(runs: Path) -> Counted:
    return [
        f"{one.run_id}/{part['part']}"
        for one in list_runs(runs)
        for part in report_json(load_run(runs, one.run_id))["parts"]
        if part["is_counted"]
    ]


def history(runs: Path) -> Counted:
    with store_of(runs) as store:
        listed = list_parts(store, Filters(), 9)
        assert listed.count == len(listed.parts)
        return [str(part["part"]) for part in listed.parts]


def serial_numbers(runs: Path) -> Counted:
    """Parts found by the serial number that each part of the history has; by its name without."""
    with store_of(runs) as store:
        return [
            str(found["part"])
            for part in list_parts(store, Filters(), 9).parts
            for found in find_parts(store, str(part["serial"] or part["part"]))
        ]


def figures_by(group: str) -> Callable[[Path], Counted]:
    def counted(runs: Path) -> Counted:
        with store_of(runs) as store:
            return [
                one.name
                for one in figures(store, Filters(), group).groups
                for _ in range(one.part_count)
            ]

    return counted


def awaiting(runs: Path) -> Counted:
    """Parts that await a person or were decided on, and those that need neither."""
    with store_of(runs) as store:
        found = agreement(store, Filters())
        passed = list_parts(store, Filters(verdict="pass"), 9).parts
        return [str(part["part"]) for part in passed] + ["awaiting"] * found.awaiting


def run_chart(runs: Path) -> Counted:
    """Parts in the store's series of the first characteristic; of all where none is measured."""
    with store_of(runs) as store:
        recipe = recipe_of(runs)
        known = characteristics_in(store, recipe)
        if not known:
            return history(runs)
        values = values_of(store, Filters(), recipe, str(known[0]["id"]), 9)
        return [str(one["part"]) for one in values]


def statistics(runs: Path) -> Counted:
    """Parts in the longest series of `cellctl stats RECIPE`; of all where none is measured."""
    found = [[f"{v.run}/{v.part}" for v in one.values] for one in series_of(runs, recipe_of(runs))]
    return max(found, key=len) if found else history(runs)


def takt(runs: Path) -> Counted:
    """Parts that `stats --takt` divides the time by; tries that it leaves out are no parts."""
    groups = grouped(takts_of(runs), "run")
    return [one.name for one in groups for _ in range(one.part_count)]


def agreement_of_cameras(runs: Path) -> Counted:
    """Shares of parts in what is known of the calibrations' drift; of all parts where none is."""
    names = (rows.RunBegan.row_name, rows.ViewsPosed.row_name)
    found = list(read_rows_counted(runs / JOURNAL_NAME, names))
    posed = [f"{row.run}/{row.part}" for row in found if row.name == rows.ViewsPosed.row_name]
    assert sum(len(one.off_mm) for one in usage_of(found).values()) <= len(posed)
    return posed or history(runs)


def exported(suffix: str) -> Callable[[Path], Counted]:
    """Parts in an export of the history."""

    def counted(runs: Path) -> Counted:
        path = runs / f"all{suffix}"
        with store_of(runs) as store:
            export(store, Filters(), path, runs)
        return in_file(path)

    return counted


def written(suffix: str) -> Callable[[Path], Counted]:
    """Parts in the files that `cellctl report` writes of each run."""

    def counted(runs: Path) -> Counted:
        found: list[str] = []
        for one in list_runs(runs):
            parts = counted_parts(load_run(runs, one.run_id))
            if parts:
                found += in_file(write_report(parts, runs / f"{one.run_id}{suffix}"))
        return found

    return counted


def in_file(path: Path) -> Counted:
    """Return the parts in a file of another program's form."""
    match path.suffix:
        case ".csv":
            with path.open(encoding="utf-8-sig", newline="") as file:
                return [*{f"{row['run']}/{row['number']}" for row in csv.DictReader(file)}]
        case ".parquet":
            parquet = pytest.importorskip("pyarrow.parquet")
            found = parquet.read_table(path).to_pylist()
            return [*{f"{row['run']}/{row['number']}" for row in found}]
        case ".qif":
            results = ElementTree.parse(path).iter(f"{{{QIF_NAMESPACE}}}MeasurementResults")
            return [str(one.get("id")) for one in results]
        case _:  # a line of values has this character between a value and its attribute
            lines = path.read_bytes().split(b"\r\n")
            return [f"line {i}" for i, line in enumerate(lines) if b"\x14" in line]


@contextmanager
def page_of(runs: Path) -> Iterator[Bench]:
    """Open the page before a folder of runs; what its own process does is done in a thread."""
    page_bench = pytest.importorskip("tests.unit.page_bench", exc_type=ImportError)
    from controller.page.records import records as module

    with TemporaryDirectory() as folder, ExitStack() as stack:
        (Path(folder) / "runs").symlink_to(runs, target_is_directory=True)
        for name, value in (
            ("make_pool", lambda: ThreadPoolExecutor(1)),
            ("WAIT_S", 60.0),
            ("NEWER_S", 0.0),
        ):
            stack.enter_context(patch.object(module, name, value))
        at = page_bench.bench(Path(folder))
        with at.client:
            at.log_in()
            yield at


def shown(path: str, pattern: str) -> Callable[[Path], Counted]:
    """Parts whose pages a page leads to."""

    def counted(runs: Path) -> Counted:
        with page_of(runs) as at:
            reply = at.client.get(path)
            assert reply.status_code == 200, reply.text[:300]
            return [*dict.fromkeys(re.findall(pattern, reply.text))]

    return counted


def shown_chart(runs: Path) -> Counted:
    """Values in the page's run chart; parts of its list where none is measured."""
    with page_of(runs) as at:
        text = at.client.get("/history/charts").text
    found = re.search(r"values: (\d+)", text)
    return shown("/history", PART_LINK)(runs) if found is None else ["value"] * int(found[1])


def shown_now(runs: Path) -> Counted:
    """Parts that *Now* counts in the newest run."""
    with page_of(runs) as at:
        at.read()
        run = at.live.now()["run"]
    assert sum(run["counts"].values()) == len(run["parts"])
    return [f"part {one['part']}" for one in run["parts"]]


OUTLETS: Mapping[str, Callable[[Path], Counted]] = {
    "records": records,
    "reports": reports,
    "history": history,
    "serial numbers": serial_numbers,
    **{f"figures by {group}": figures_by(group) for group in GROUPS},
    "agreement": awaiting,
    "run chart": run_chart,
    "statistics": statistics,
    "takt": takt,
    "cameras": agreement_of_cameras,
    **{f"export {suffix}": exported(suffix) for suffix in (".csv", ".parquet", ".qif")},
    "page, list": shown("/history", PART_LINK),
    "page, chart": shown_chart,
    "page, now": shown_now,
    **{f"report {suffix}": written(suffix) for suffix in (".csv", ".qif", ".dfq")},
}
