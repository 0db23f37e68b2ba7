"""`cellctl learn`: good parts named as sets or taken from runs; `inspect` and `replay` use it."""

from __future__ import annotations

import hashlib
import json
import shutil
import sqlite3
from pathlib import Path
from typing import Any

import learned_sets
import numpy as np
import pytest
import stored_run
import view_sets
from cad_solids import box, mesh_of
from shown_part import perfect

from controller.catalogue import PoolLostError
from controller.cell.journal import JOURNAL_NAME, Journal, append_beside, rows
from controller.cli import main
from controller.config.view_set import load_view_set
from controller.interface import judge_pictures
from controller.stored import (
    Judging,
    cad_sha256,
    compiled_part,
    judge_views,
    lines_digest,
    read_learned,
    read_pictures,
)
from controller.stored.learned_file import BY_VERDICT, HEADER

RUN = "20260314-092641-512-shown"
PART_COUNT = 6


@pytest.fixture(scope="module")
def sets(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The sets of six good parts."""
    return learned_sets.write_some(tmp_path_factory.mktemp("sets"), PART_COUNT)


@pytest.fixture(scope="module")
def learned(sets: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What six good parts look like."""
    path = tmp_path_factory.mktemp("learned") / "shown.learned"
    assert main(["learn", *map(str, sets), "-o", str(path), "--json"]) == 0
    return path


def words(paths: list[Path]) -> list[str]:
    return [str(path) for path in paths]


# -- from sets ------------------------------------------------------------------------------------


def test_a_learned_file_says_from_what_and_how_much_it_compares(
    sets: list[Path], learned: Path
) -> None:
    found = read_learned(learned)
    header = found.header
    assert [part.name for part in header.parts] == words(sets)
    assert header.left_out == ()
    assert header.part == "shown"
    assert (
        header.cad_sha256 == hashlib.sha256((sets[0].parent / "shown.stl").read_bytes()).hexdigest()
    )
    assert 0 < header.compared <= header.in_sight < 1
    (view,) = found.appearance.views
    assert view.parts == PART_COUNT
    assert sorted(view.pictures) == ["ring", "side"]


def test_the_output_is_one_object_for_machines(
    sets: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "folder" / "a.learned"  # is made
    assert main(["learn", *words(sets), "-o", str(out), "--json"]) == 0
    body = json.loads(capsys.readouterr().out)
    assert body["learned"] == str(out)
    assert [part["name"] for part in body["parts"]] == words(sets)
    assert body["left_out"] == []
    assert (body["views"], body["pictures"]) == (1, 2)
    assert all(0 < part["compared"] <= part["in_sight"] < 1 for part in body["parts"])
    assert read_learned(out).header.software


def test_two_processes_learn_what_one_does(
    sets: list[Path], learned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "two.learned"
    odd = learned_sets.write(tmp_path / "odd", 90, "blank")
    for jobs in ("1", "2"):
        file = str(out.with_stem(f"by_{jobs}"))
        assert main(["learn", *words([*sets, odd]), "-o", file, "--jobs", jobs, "--json"]) == 0
    one, two = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert [part["name"] for part in one["left_out"]] == [str(odd)]
    for name in ("parts", "left_out", "unlearned", "views", "pictures"):
        assert one[name] == two[name]
    arrays = [np.load(out.with_stem(f"by_{jobs}"), allow_pickle=False) for jobs in ("1", "2")]
    assert arrays[0].files == arrays[1].files
    for name in set(arrays[0].files) - {HEADER}:  # which has the time
        assert arrays[0][name].tobytes() == arrays[1][name].tobytes()


def test_processes_that_end_early_leave_no_file(
    sets: list[Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def lost(*_: object) -> None:
        raise PoolLostError("the Dask scheduler at tcp://here:1 went away")

    monkeypatch.setattr("controller.cli.learning.learned_parts.in_order", lost)
    out = tmp_path / "a.learned"
    assert main(["learn", *words(sets), "-o", str(out)]) == 1
    assert "tcp://here:1 went away" in capsys.readouterr().err
    assert not out.exists()


def test_a_part_that_differs_is_named_and_left_out(
    sets: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    odd = learned_sets.write(tmp_path / "odd", 90, "blank")
    out = tmp_path / "a.learned"
    assert main(["learn", *words([*sets[:3], odd, *sets[3:]]), "-o", str(out)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    header = read_learned(out).header
    assert [part.name for part in header.parts] == words(sets)
    assert [part.name for part in header.left_out] == [str(odd)]
    assert f"{odd} differs from the others and is left out" in printed


def refused(capsys: pytest.CaptureFixture[str], *asked: str) -> str:
    assert main(["learn", *asked]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "Traceback" not in printed.err
    return " ".join(printed.err.replace("│", " ").split())


def test_fewer_than_five_parts_are_too_few_and_no_picture_is_read(
    sets: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    four = []
    for path in sets[:4]:
        four.append(tmp_path / f"{path.parent.name}.json")
        four[-1].write_text(path.read_text())
        shutil.copy(path.parent / "shown.stl", tmp_path / "shown.stl")
    out = tmp_path / "a.learned"
    said = refused(capsys, *words(four), "-o", str(out))
    assert "nothing learned: 4 good parts, 5 are needed" in said
    assert not out.exists()


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ([], "name either SET... or --runs"),
        (["a.json", "--runs", "runs", "--accepted"], "name either SET... or --runs"),
        (["--runs", "runs"], "--runs and --accepted go together"),
        (["a.json", "--accepted"], "--runs and --accepted go together"),
    ],
)
def test_options_that_exclude_each_other(
    asked: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert said in refused(capsys, *asked, "-o", "a.learned")


def test_an_output_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--output" in refused(capsys, "a.json")


def test_an_output_that_is_a_folder_is_refused_before_anything_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(capsys, "none.json", "-o", str(tmp_path))
    assert "is a directory; name a file in it" in said


def test_an_output_below_a_file_is_refused_before_anything_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    said = refused(capsys, "none.json", "-o", str(tmp_path / "file" / "a.learned"))
    assert "is a file; name a folder" in said


def test_all_missing_sets_are_named(sets: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, str(sets[0]), "none1.json", "none2.json", "-o", "a.learned")
    assert "none1.json: No such file" in said
    assert "none2.json: No such file" in said


def test_one_part_named_twice_is_not_two(
    sets: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "again").symlink_to(sets[0].parent)
    again = tmp_path / "again" / "SET.json"
    said = refused(capsys, *words([*sets[:4], again]), "-o", str(tmp_path / "a.learned"))
    assert f"{again}: is named twice" in said


def test_a_set_of_another_part_is_named(
    sets: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(sets[-1].parent, tmp_path / "other")
    mesh_of(box(46, 34, 24)).export(tmp_path / "other" / "shown.stl")
    other = tmp_path / "other" / "SET.json"
    assert main(["learn", *words([*sets[:-1], other]), "-o", str(tmp_path / "a.learned")]) == 2
    said = capsys.readouterr().err
    assert f"{other}: its part has another CAD file" in said
    assert not (tmp_path / "a.learned").exists()


def test_the_recipe_says_which_part_is_learned(
    sets: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh_of(box(46, 34, 24)).export(tmp_path / "block.stl")
    recipe = tmp_path / "block.yaml"
    recipe.write_text("name: block\npart: block.stl\n")
    out = tmp_path / "a.learned"
    assert main(["learn", *words(sets), "--recipe", str(recipe), "-o", str(out)]) == 2
    assert f"{sets[0]}: its part has another CAD file" in capsys.readouterr().err


# -- judging by it --------------------------------------------------------------------------------


def inspected(
    capsys: pytest.CaptureFixture[str], path: Path, *more: str
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    capsys.readouterr()
    main(["inspect", str(path), "--json", *more])
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    return lines[-1], lines


def test_inspection_by_learned_parts_compares_more_and_says_so(
    learned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = learned_sets.write(tmp_path / "set", 41)  # not among those learned
    cold, _ = inspected(capsys, path)
    warm, lines = inspected(capsys, path, "--learned", str(learned))
    assert warm["covered_fraction"] > cold["covered_fraction"]
    assert warm["verdict"] == cold["verdict"] == "indeterminate"  # one view of one side
    (said,) = [reason for reason in warm["reasons"] if "learned" in reason]
    assert f"from {PART_COUNT} parts: it decided on surfaces in 2 of 2 lit pictures" in said
    assert not any("learned" in reason for reason in cold["reasons"])
    assert not [line for line in lines if line["event"] == "finding"]


def test_a_missing_bore_still_fails_by_learned_parts(
    learned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = learned_sets.write(tmp_path / "set", 42, "blank")
    end, _ = inspected(capsys, path, "--learned", str(learned))
    assert end["verdict"] == "fail"


def test_a_view_that_was_not_learned_is_named(
    learned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = view_sets.write(tmp_path / "set")
    end, _ = inspected(capsys, path, "--learned", str(learned))
    (said,) = [reason for reason in end["reasons"] if "learned" in reason]
    assert "in 2 of 6 lit pictures" in said
    assert "not in v01/ring, v01/side, v02/ring, v02/side, which no learned view fits" in said


def test_a_file_of_another_part_is_refused(
    learned: Path, sets: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(sets[0].parent, tmp_path / "set")
    mesh_of(box(46, 34, 24)).export(tmp_path / "set" / "shown.stl")
    path = tmp_path / "set" / "SET.json"
    assert main(["inspect", str(path), "--learned", str(learned), "--json"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "learned with another CAD model" in said.err


@pytest.mark.parametrize("name", ["none.learned", "", "SET.json"])
def test_a_file_that_is_none_is_refused(
    sets: list[Path], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = sets[0].parent / name
    assert main(["inspect", str(sets[0]), "--learned", str(wrong), "--json"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert str(wrong) in said.err


def test_a_set_and_a_recipe_name_it_too(
    learned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = learned_sets.write(tmp_path / "set", 41)
    by_option, _ = inspected(capsys, path, "--learned", str(learned))
    shutil.copy(learned, path.parent / "good.learned")
    recipe = path.parent / "shown.yaml"
    recipe.write_text("name: shown\npart: shown.stl\ninspection: {learned: good.learned}\n")
    by_recipe, _ = inspected(capsys, path, "--recipe", str(recipe))
    path.write_text(json.dumps(learned_sets.tree() | {"learned": "good.learned"}))
    by_set, _ = inspected(capsys, path)
    cell = judge_pictures(path)  # as a program asks
    shares = {end["covered_fraction"] for end in (by_option, by_recipe, by_set)}
    assert shares == {cell.ledger.compared_fraction}
    assert judge_pictures(path, recipe=recipe).ledger.compared_fraction in shares


def test_a_program_judges_a_set_by_its_own_recipe_as_the_command_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = learned_sets.write(tmp_path / "set", 41)
    for smallest_mm in (2.0, 4.0):
        own = {"name": "shown", "part": "shown.stl"}
        own["inspection"] = {"smallest_defect_mm": smallest_mm}  # type: ignore[assignment]
        path.write_text(json.dumps(learned_sets.tree() | {"recipe": own}))
        by_command, _ = inspected(capsys, path)
        assert judge_pictures(path).ledger.compared_fraction == by_command["covered_fraction"]


def test_a_terminal_shows_that_learned_parts_decided(
    learned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = learned_sets.write(tmp_path / "set", 41)
    capsys.readouterr()
    main(["inspect", str(path), "--learned", str(learned)])
    assert f"from {PART_COUNT} parts: it decided on surfaces" in capsys.readouterr().out


# -- from runs ------------------------------------------------------------------------------------


def write_run(runs: Path, verdicts: list[str]) -> None:
    """Write a run of parts with these verdicts, as the cell leaves it."""
    folder = runs / RUN
    (folder / "inputs").mkdir(parents=True)
    mesh_of(perfect()).export(folder / "inputs" / "shown.stl")
    journal = Journal(runs / JOURNAL_NAME, RUN)
    recipe = {"name": "shown", "part": "shown.stl"}
    journal.write(rows.RunBegan(recipe=recipe, count=len(verdicts)))
    stl = "inputs/shown.stl"
    journal.write(rows.FilesStored({stl: stored_run.sha256(folder / stl)}))
    for number, verdict in enumerate(verdicts, 1):
        place = f"pictures/part{number:03d}"
        learned_sets.write_pictures(folder / place, number - 1)
        tree = learned_sets.tree() | {"part": stl, "recipe": recipe}
        for view in tree["views"]:
            view["pictures"] = {k: f"{place}/{file}" for k, file in view["pictures"].items()}
        views = folder / f"part{number:03d}.views.json"
        views.write_text(json.dumps(tree), encoding="utf-8")
        for path in (*sorted((folder / place).iterdir()), views):
            name = path.relative_to(folder).as_posix()
            journal.write(rows.FilesStored({name: stored_run.sha256(path)}), number)
        judged = rows.PartJudged(verdict=verdict, reasons=(), covered_fraction=0.9, faces=())
        journal.write(judged, number)
        journal.write(rows.PartInspected(views=views.name, lines_sha256="0" * 64), number)
    journal.write(rows.AtRest(state="complete"))
    journal.write(rows.RunEnded(end="complete", parts=len(verdicts)))
    journal.close()


def review(runs: Path, number: int, verdict: Any, who: str) -> None:
    row = rows.PartReviewed(verdict=verdict, who=who, why="seen")
    append_beside(runs / JOURNAL_NAME, RUN, row, number)


def from_runs(runs: Path, out: Path, *more: str) -> int:
    return main(["learn", "--runs", str(runs), "--accepted", "-o", str(out), "--json", *more])


VERDICTS = ["pass", "indeterminate", "pass", "fail", "pass", "pass", "indeterminate", "pass"]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of eight parts; the persons' verdicts beside it. Tests copy it."""
    runs = tmp_path_factory.mktemp("written") / "runs"
    write_run(runs, VERDICTS)
    review(runs, 2, "accept", "Ann")  # was indeterminate
    review(runs, 3, "reject", "Bert")  # had passed
    review(runs, 5, "reject", "Bert")
    review(runs, 5, "accept", "Ann")  # the last one counts
    return runs


@pytest.fixture
def runs(written: Path, tmp_path: Path) -> Path:
    shutil.copytree(written, tmp_path / "runs")
    return tmp_path / "runs"


def test_of_a_run_the_passed_and_accepted_parts_are_learned_and_not_the_rejected(
    runs: Path, tmp_path: Path
) -> None:
    assert from_runs(runs, tmp_path / "a.learned") == 0
    header = read_learned(tmp_path / "a.learned").header
    by = {part.name: part.accepted_by for part in header.parts}
    assert by == {
        f"{RUN} part 1": BY_VERDICT,
        f"{RUN} part 2": "Ann",
        f"{RUN} part 5": "Ann",
        f"{RUN} part 6": BY_VERDICT,
        f"{RUN} part 8": BY_VERDICT,
    }
    assert all(part.accepted_at is not None for part in header.parts)


def test_a_part_whose_pictures_changed_since_is_left_out(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    learned_sets.write_pictures(runs / RUN / "pictures" / "part006", 77)
    assert from_runs(runs, tmp_path / "a.learned") == 2
    said = capsys.readouterr().err
    assert f"{RUN} part 6: its pictures changed or are gone; it is left out" in said
    assert "4 good parts" in said


def test_a_part_whose_pictures_were_dropped_is_left_out(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = runs / RUN / "pictures" / "part006"
    files = tuple(path.relative_to(runs / RUN).as_posix() for path in place.iterdir())
    shutil.rmtree(place)
    append_beside(runs / JOURNAL_NAME, RUN, rows.PicturesDropped(before="2026-04-01", files=files))
    review(runs, 7, "accept", "Cem")
    assert from_runs(runs, tmp_path / "a.learned") == 0
    assert f"{RUN} part 6: its pictures changed or are gone" in capsys.readouterr().err
    names = [part.name for part in read_learned(tmp_path / "a.learned").header.parts]
    assert len(names) == 5
    assert f"{RUN} part 6" not in names


def test_a_journal_whose_chain_is_broken_accepts_nothing(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with sqlite3.connect(runs / JOURNAL_NAME) as db:
        for (trigger,) in db.execute(
            "SELECT name FROM sqlite_master WHERE type = 'trigger'"
        ).fetchall():
            db.execute(f"DROP TRIGGER {trigger}")
        db.execute("UPDATE journal SET body = replace(body, 'reject', 'accept')")
    db.close()
    assert from_runs(runs, tmp_path / "a.learned") == 2
    assert "the chain of hashes breaks at row" in capsys.readouterr().err


def test_parts_of_another_recipe_are_not_taken(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh_of(box(46, 34, 24)).export(tmp_path / "block.stl")
    recipe = tmp_path / "block.yaml"
    recipe.write_text("name: block\npart: block.stl\n")
    assert from_runs(runs, tmp_path / "a.learned", "--recipe", str(recipe)) == 2
    assert f"nothing learned: 0 good parts in {runs}" in capsys.readouterr().err


def test_a_folder_without_runs_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert from_runs(tmp_path, tmp_path / "a.learned") == 1
    assert "nothing ran here yet" in capsys.readouterr().err


def test_a_run_judged_by_learned_parts_is_judged_so_again(
    learned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its set names the copy in the run's inputs, not the file, which may have changed."""
    runs = tmp_path / "runs"
    folder = runs / RUN
    learned_sets.write(folder / "inputs", 41)
    shutil.copy(learned, folder / "inputs" / "good.learned")
    learned_sets.write_pictures(folder / "pictures", 41)
    tree = learned_sets.tree() | {
        "part": "inputs/shown.stl",
        "learned": "inputs/good.learned",
        "recipe": {"name": "shown", "part": "x.stl", "inspection": {"learned": "gone.learned"}},
    }
    for view in tree["views"]:
        view["pictures"] = {k: f"pictures/{file}" for k, file in view["pictures"].items()}
    views = folder / "part001.views.json"
    views.write_text(json.dumps(tree), encoding="utf-8")
    digest = stored_run.write_journal(runs, views)
    capsys.readouterr()
    assert main(["replay", RUN, "--runs", str(runs), "--json"]) == 0
    end = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert end["bit_equal"] is True
    assert any("learned" in reason for reason in end["reasons"])
    # another learned file: other numbers
    file = load_view_set(views)
    cold = Judging(file.recipe, views, views)
    found = judge_views(file, compiled_part(views, file), read_pictures(views, file), cold)
    assert lines_digest(found) != digest
    assert cad_sha256(file.part) == read_learned(learned).header.cad_sha256
