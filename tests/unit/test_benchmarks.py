"""Benchmarks: one table lists each of them; they are called and print alike, and run in one go."""

from __future__ import annotations

import argparse
import ast
import json
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = {path.name: path for path in (ROOT / "benchmarks").glob("*.py")}
sys.path.insert(0, str(ROOT / "benchmarks"))

import bench  # noqa: E402  (path set above)

import benchmarks.__main__ as in_one_go  # noqa: E402

NAMED = re.compile(r"\b(?:bench|trace|recognition|planning|inspection|runs|fit|twisted)_\w+\.py")


def test_the_table_lists_every_script_and_none_that_has_gone() -> None:
    text = (ROOT / "docs" / "measurements.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("|")]
    first = {m for row in rows for m in re.findall(r"`(\w+\.py)", row.split("|")[1])}
    others = {m for row in rows for m in re.findall(r"`(\w+\.py)`", row.split("|")[2])}
    assert set(in_one_go.NAMES) == {name.removesuffix(".py") for name in first}
    assert first | others == SCRIPTS.keys() - {"bench.py", "__main__.py"}


def test_pages_name_benchmarks_that_are_there_or_say_that_they_are_history() -> None:
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    elsewhere = {path.name for path in (ROOT / "tests").rglob("*.py")}
    lost = []
    for page in pages:
        text = page.read_text(encoding="utf-8")
        gone = set(NAMED.findall(text)) - SCRIPTS.keys() - elsewhere
        said = [line for line in text.splitlines() if "kept in git history" in line]
        lost += [(page.name, name) for name in gone if not any(name in line for line in said)]
    assert lost == []


@pytest.mark.parametrize("name", in_one_go.NAMES)
def test_the_reduced_form_sets_arguments_that_there_are(name: str) -> None:
    tree = ast.parse(SCRIPTS[f"{name}.py"].read_text(encoding="utf-8"))
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    (made,) = [c for c in calls if isinstance(c.func, ast.Name) and c.func.id == "Arguments"]
    added = {
        str(c.args[0].value).lstrip("-").replace("-", "_")
        for c in calls
        if isinstance(c.func, ast.Attribute) and c.func.attr == "add_argument"
        if isinstance(c.args[0], ast.Constant)
    }
    assert {word.arg for word in made.keywords} <= added


def parsed(*words: str) -> argparse.Namespace:
    parser = bench.Arguments("What it shows.", count=1, names=["a"])
    parser.add_argument("names", nargs="*", default=["a", "b"])
    parser.add_argument("--count", type=int, default=9)
    return parser.parse_args(list(words))


def test_the_reduced_form_stands_in_for_what_is_not_given() -> None:
    assert (parsed().count, parsed().names) == (9, ["a", "b"])
    assert (parsed("--quick").count, parsed("--quick").names) == (1, ["a"])
    assert (parsed("--quick", "--count", "5", "z").count, parsed("--quick", "z").names) == (
        5,
        ["z"],
    )


def test_a_reduced_form_of_no_argument_is_a_mistake() -> None:
    with pytest.raises(ValueError, match="'speed'"):
        bench.Arguments("", speed=1.0).parse_args(["--quick"])


def test_a_table_has_a_column_for_each_key_and_numbers_to_the_right() -> None:
    told = bench.table([{"part": "lever", "mm": 0.51234}, {"part": "hub", "mm": 12.0, "why": "-"}])
    assert told.splitlines() == [
        "part       mm  why",
        "lever  0.5123",
        "hub        12  -",
    ]


def test_json_has_rows_and_figures(capsys: pytest.CaptureFixture[str]) -> None:
    bench.show(parsed("--json"), [{"n": 1}], {"all": Path("a")})
    assert json.loads(capsys.readouterr().out) == {"figures": {"all": "a"}, "rows": [{"n": 1}]}


SCRIPT = """
import sys
print("held by 3 of 3")
print({said!r}, file=sys.stderr)
sys.exit({code})
"""


def test_in_one_go_each_says_how_it_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    codes = {"one": 0, "two": 1, "three": bench.LEFT_OUT, "four": 2}
    for name, code in codes.items():
        (tmp_path / f"{name}.py").write_text(SCRIPT.format(said=f"about {name}", code=code))
    monkeypatch.setattr(in_one_go, "HERE", tmp_path)
    monkeypatch.setattr(in_one_go, "NAMES", list(codes))
    monkeypatch.setattr(sys, "argv", ["benchmarks", "--quick", "--json"])
    assert in_one_go.main() == 1
    told = json.loads(capsys.readouterr().out)
    assert [(row["ended"], row["said"]) for row in told["rows"]] == [
        ("held", "held by 3 of 3"),
        ("not held", "held by 3 of 3"),
        ("left out", "about three"),
        ("exit 2", "about four"),
    ]
    monkeypatch.setattr(sys, "argv", ["benchmarks", "--only", "one", "three"])
    assert in_one_go.main() == 0
