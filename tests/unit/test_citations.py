"""Every citation leads to a heading or numbered row of this repository; the checker is checked."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from citations import Checkout, keys_of

ROOT = Path(__file__).resolve().parents[2]
SIGN = "§"
DOT_MD = ".md"  # apart, so that what is planted here is no citation of this file

PAGE = f"""# A wire

## 2. Requests

### 2.3 Simple ones

| value | bytes |
|---|---|
| 7 | 07 |

## 8 Failures

| nr | what |
|---|---|
| 8.10 | nothing moves |
| P3.1 | a section of a paper |

See wire{DOT_MD} 2.3.
"""


@pytest.fixture(scope="module")
def checkout() -> Checkout:
    return Checkout(ROOT)


def test_every_citation_resolves(checkout: Checkout) -> None:
    assert not checkout.problems, "\n" + "\n".join(map(str, checkout.problems))


def test_the_citations_are_found_at_all(checkout: Checkout) -> None:
    """A pattern that matched nothing would resolve everything."""
    citing = {path.parts[0] for path in checkout.texts}
    assert citing >= {"controller", "drivers", "emulators", "tests", "benchmarks", "docs"}
    assert sum(map(checkout.count_in, checkout.texts)) > 500


def test_headings_and_numbered_rows_count_and_values_do_not() -> None:
    assert keys_of(PAGE) == {"2", "2.3", "8", "8.10", "P3.1"}


@pytest.fixture
def plant(tmp_path: Path) -> Path:
    (tmp_path / "docs" / "adr").mkdir(parents=True)
    (tmp_path / "docs" / f"wire{DOT_MD}").write_text(PAGE, encoding="utf-8")
    (tmp_path / "docs" / "adr" / f"0007-why{DOT_MD}").write_text(
        "# 7. Why\n\n## Decision\n", encoding="utf-8"
    )
    references = "| S6 | ISO/IEC 15948 |\n| PT1 | Table 1 |\n"
    (tmp_path / "docs" / f"references{DOT_MD}").write_text(references, encoding="utf-8")
    (tmp_path / "drivers").mkdir()
    (tmp_path / "tests").mkdir()
    return tmp_path


def found(root: Path, name: str, text: str) -> list[str]:
    (root / name).write_text(text, encoding="utf-8")
    return [str(problem) for problem in Checkout(root).problems]


@pytest.mark.parametrize(
    "text",
    [
        f"# wire{DOT_MD} 2.3, 8.10 and P3.1\n",
        f"# docs/wire{DOT_MD} 2.3: the bytes\n",
        f'"""Sections ({SIGN}) are those of wire{DOT_MD}."""\n\nX = 1  # {SIGN}8.10, {SIGN}2\n',
        f"# what wire{DOT_MD}\n# 2.3 says\n",
        f"# docs/wire{DOT_MD}, *Simple ones*: the bytes\n",
        f"# wire{DOT_MD},\n# *Simple ones*\n",
        "# ADR 7; the paper's Table 1; ISO/IEC 15948\n",
        "# ADR 7,\n# *Decision*\n",
        "X = sleep(2.5)  # half of 5.0 s\n",
    ],
)
def test_citations_that_resolve_are_no_problem(plant: Path, text: str) -> None:
    assert found(plant, "drivers/arm.py", text) == []


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (f"# wire{DOT_MD} 2.9\n", f"1: wire{DOT_MD} has no section 2.9"),
        (f"# wire{DOT_MD} 7\n", f"1: wire{DOT_MD} has no section 7"),
        (f"# wire{DOT_MD} 2.3, 8.10 and 8.11\n", f"1: wire{DOT_MD} has no section 8.11"),
        (f"# what wire{DOT_MD}\n# 2.9 says\n", f"1: wire{DOT_MD} has no section 2.9"),
        (f"# wire{DOT_MD}, *Gone*\n", f"1: wire{DOT_MD} has no heading 'Gone'"),
        (f"\n# else{DOT_MD}\n", f"2: else{DOT_MD} is not in the repository"),
        (f"# docs/adr/wire{DOT_MD}\n", f"1: docs/adr/wire{DOT_MD} is not in the repository"),
        (
            f"X = 1\nY = 2  # {SIGN}2.3\n",
            f"2: {SIGN} without 'Sections ({SIGN}) are those of' a page",
        ),
        (
            f'"""Sections ({SIGN}) are those of\nwire{DOT_MD}."""\n# {SIGN}2.9\n',
            f"3: wire{DOT_MD} has no section 2.9",
        ),
        ("X = 1  # as it is (2.3)\n", f"1: write {SIGN}, not '(2.3' alone"),
        ("# A" + "DR 8\n", "1: there is no ADR 8"),
        ("# A" + "DR 7, *Decision* and *Gone*\n", f"1: 0007-why{DOT_MD} has no heading 'Gone'"),
        ("# the paper" + "'s Table 9\n", f"1: references{DOT_MD} has no section PT9"),
        ("# I" + "SO 1101\n", f"1: docs/references{DOT_MD} does not list ISO 1101"),
        ("# (paper" + ", section 2.1)\n", "section 2' is not the form"),
        ("# ../sha" + "red/parts\n", "is outside the repository"),
        ('X = ROOT / "sha' + 'red"\n', "is outside the repository"),
    ],
)
def test_a_citation_that_leads_nowhere_is_named_with_its_line(
    plant: Path, text: str, why: str
) -> None:
    (problem,) = found(plant, "drivers/arm.py", text)
    assert problem.startswith("drivers/arm.py:")
    assert why in problem


def test_within_a_page_the_sign_means_that_page(plant: Path) -> None:
    text = f"## 1. One\n\nAs {SIGN}1 says, and {SIGN}2.3 does not.\n"
    (problem,) = found(plant, f"docs/other{DOT_MD}", text)
    assert problem == f"docs/other{DOT_MD}:3: docs/other{DOT_MD} has no section 2.3"


def test_two_adrs_of_one_number_are_a_problem(plant: Path) -> None:
    (problem,) = found(plant, f"docs/adr/0007-why-not{DOT_MD}", "# 7. Why not\n")
    assert problem.endswith("is ADR 7, too")


def test_a_golden_file_cites_by_its_sections(plant: Path) -> None:
    text = f'# Sections ({SIGN}) are those of wire{DOT_MD}.\nsection = "2.3"\nsection = "3.1"\n'
    (problem,) = found(plant, "tests/wire.toml", text)
    assert problem == f"tests/wire.toml:3: wire{DOT_MD} has no section 3.1"


MAY_NOT_RUN = re.compile(r"mark\.(?:skipif|skip|xfail)\b|pytest\.skip\(|importorskip|@needs_kernel")


def test_the_page_on_tests_names_every_file_whose_tests_may_not_run() -> None:
    """What is skipped on some machines, or expected to fail, is told where the tests are."""
    files = {
        path.name
        for path in (ROOT / "tests").rglob("test_*.py")
        if path != Path(__file__) and MAY_NOT_RUN.search(path.read_text(encoding="utf-8"))
    }
    page = (ROOT / "docs" / f"testing{DOT_MD}").read_text(encoding="utf-8")
    section = page[page.index("## What a machine may skip") :].partition("\n## ")[0]
    assert files == set(re.findall(r"test_\w+\.py", section))
