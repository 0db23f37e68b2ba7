"""The number of an order: from the command line or the recipe into every record of its parts."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from controller.cell.batch import Papers
from controller.cell.journal import rows
from controller.cli import main
from controller.cli.inputs.serials import papers_of
from controller.cli.options import SerialOptions
from controller.cli.running.recipe_run import given_papers
from controller.history import Filters, Store, export, figures, fill, list_parts, open_store
from controller.results.exports import csv_text, dfq_bytes, qif_bytes
from controller.results.judged import judged_parts, result_json
from controller.results.report import report_json
from controller.results.run import load_run
from controller.results.takt import GROUPS, grouped, takt_of
from tests.unit import judged_bench as bench
from tests.unit.results_bench import RunWriter, good_run, sighting

ORDERED = Papers(order_number="4711")


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    good_run(tmp_path, papers=ORDERED)
    good_run(tmp_path, "20260302-120000-000-featuretype")
    made = open_store(f"sqlite:///{tmp_path / 'history.sqlite'}")
    fill(made, tmp_path)
    yield made
    made.close()


def test_the_command_line_gives_the_order_to_the_run(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(
        "controller.cli.running.recipe_run.run_recipe", lambda o: asked.append(o) or 0
    )
    words = ["run", "holder", "--order", " 4711 ", "--lot", "L7", "--serial", "A1"]
    assert main([*words, "--runs", str(tmp_path)]) == 0
    (options,) = asked
    papers = papers_of(options.serials, given_papers(options), None, 1, 1, tmp_path)
    assert (papers.order_number, papers.lot, papers.serials) == ("4711", "L7", ("A1",))


def test_numbers_that_are_counted_leave_the_papers_as_they_are(tmp_path: Path) -> None:
    given = Papers("Ann", "L7", part_temperature_c=21.0, order_number="4711")
    papers = papers_of(SerialOptions(counted_from="A1"), given, None, 1, 1, tmp_path)
    kept = (papers.operator, papers.lot, papers.part_temperature_c, papers.order_number)
    assert kept == ("Ann", "L7", 21.0, "4711")


def test_a_dry_run_has_no_order(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "holder", "--dry", "--order", "4711"]) == 2
    assert "--order: --dry takes no part; leave it out" in capsys.readouterr().err


def test_the_order_as_given_stands_before_the_recipes(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path, papers=ORDERED)
    writer.look(sighting())
    writer.close()
    record = load_run(tmp_path)
    in_recipe = {"order_number": "12", "part_number": "A-7"}
    for one in (record.recipe, *record.recipes):
        one["papers"] = in_recipe  # type: ignore[index] - as a recipe with papers has it
    (judged,) = judged_parts(record)
    assert judged.header.papers == {"order_number": "4711", "part_number": "A-7"}
    assert report_json(record)["parts"][0]["papers"] == dict(judged.header.papers)


def test_a_part_that_is_taken_over_keeps_its_order(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path, papers=Papers(order_number="4712"))
    writer.look(sighting())
    writer.write(rows.PartResumed(run="before", order_number="4711"))
    writer.look(sighting())
    writer.close()
    numbers = [one.header.papers.get("order_number") for one in judged_parts(load_run(tmp_path))]
    assert numbers == ["4711", "4712"]


def test_every_form_of_results_has_the_order(tmp_path: Path) -> None:
    papers = {"order_number": "4711", "drawing_number": "D-12", "part_number": "A-7"}
    judged = bench.judged(tmp_path, papers=papers)
    assert result_json(judged)["header"]["papers"] == papers
    row = next(csv.DictReader(csv_text([judged]).splitlines()))
    assert {key: row[key] for key in papers} == papers
    lines = dfq_bytes([judged]).decode().splitlines()
    assert {"K1001/1 A-7", "K1041/1 D-12", "K0053/0 4711"} <= set(lines)
    assert b'name="order number" value="4711"' in qif_bytes([judged])


def test_the_history_finds_sorts_and_exports_by_the_order(store: Store, tmp_path: Path) -> None:
    (found,) = list_parts(store, Filters(order_number="4711"), 9).parts
    assert (found["order_number"], found["run"]) == ("4711", "20260301-120000-000-featuretype")
    every = list_parts(store, Filters(), 9, sort="order_number", is_rising=True).parts
    assert [one["order_number"] for one in every] == ["", "4711"]
    groups = figures(store, Filters(), "order").groups
    assert [(group.name, group.part_count) for group in groups] == [("", 1), ("4711", 1)]
    export(store, Filters(order_number="4711"), tmp_path / "o.csv", tmp_path)
    with (tmp_path / "o.csv").open(encoding="utf-8-sig", newline="") as file:
        assert {row["order_number"] for row in csv.DictReader(file)} == {"4711"}


def test_time_is_added_up_by_order(tmp_path: Path) -> None:
    good_run(tmp_path, papers=ORDERED)
    run = takt_of(load_run(tmp_path))
    assert "order" in GROUPS
    assert [group.name for group in grouped([run], "order")] == ["4711"]


@pytest.mark.parametrize(
    "words", [("history",), ("stats", "--by", "order"), ("stats", "--takt", "--by", "order")]
)
def test_commands_choose_parts_by_their_order(
    store: Store, tmp_path: Path, words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    for order, is_there in (("4711", True), ("none", False)):
        assert main([*words, "--order", order, "--runs", str(tmp_path), "--json"]) == 0
        assert ("4711" in capsys.readouterr().out) is is_there


def test_an_order_without_a_group_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stats", "block", "--order", "4711"]) == 2
    assert "--order" in capsys.readouterr().err
