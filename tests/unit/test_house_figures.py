"""The figures of the house: counted on a small one whose figures are known, and kept on ours."""

import re
import sys
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

import house_figures as house  # noqa: E402  (path set above)

MAX_ARROWS_IN_PLANNING = 62  # half of what they were when its rooms were a mesh

FILES = {
    "controller/__init__.py": "",
    "controller/planning/__init__.py": "from .top import best",
    "controller/planning/base.py": "WIDTH_MM = 3.0",
    "controller/planning/top.py": '''
from ._hidden import find
from .base import WIDTH_MM


class TooWideError(ValueError):
    """It does not fit."""


class FarTooWideError(TooWideError):
    """It does not fit by far."""


def best(a, b, c):
    """Return the best.

    Parameters
    ----------
    a, b, c : widths [mm]

    Raises
    ------
    TooWideError : nothing fits
    """
    if a > WIDTH_MM:
        raise FarTooWideError("no")
    return find(a, b, c)
''',
    "controller/planning/_hidden.py": '''
def find(a, b, c):
    """Return the widest."""
    if a < 0:
        raise KeyError(a)

    def inner():
        raise OSError

    return max(a, b, c)


def two(self, a):
    """Return one."""
    error = ValueError()
    raise error
''',
    "drivers/__init__.py": "",
    "emulators/__init__.py": "",
    "tests/test_it.py": "from controller.planning._hidden import find",
    "benchmarks/bench_it.py": "from controller.planning import best",
}


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return tmp_path


@lru_cache(maxsize=1)
def all_ours() -> tuple[house.Source, ...]:
    return tuple(house.read_sources(ROOT, (*house.PRODUCTION, *house.READERS)))


@pytest.fixture(scope="module", autouse=True)
def _let_go() -> Iterator[None]:
    """Leave the syntax trees of the whole house to no later test: collecting would visit them."""
    yield
    all_ours.cache_clear()


def ours(packages: Sequence[str]) -> list[house.Source]:
    return [source for source in all_ours() if source.module.split(".")[0] in packages]


def sources_of(root: Path) -> list[house.Source]:
    return house.read_sources(root, (*house.PRODUCTION, *house.READERS))


def test_a_section_counts_where_the_docstring_has_one(checkout: Path) -> None:
    found = house.parameters_documented(sources_of(checkout))
    assert (found["with"], found["without"]) == (1, 1)
    assert found["missing"] == ["controller/planning/_hidden.py:2 find"]


def test_an_error_is_documented_by_its_name_or_by_a_class_above_it(checkout: Path) -> None:
    found = house.raises_documented(sources_of(checkout))
    # what is raised within an inner function, or handed on by a variable, is not the function's own
    assert (found["with"], found["without"]) == (1, 1)
    assert found["missing"] == ["controller/planning/_hidden.py:2 find: KeyError"]


@pytest.mark.parametrize(
    ("head", "first", "is_missing"),
    [
        ("def work(a) -> int:", "Return one.", False),
        ("def work(a) -> int:", "Add; return the sum.", False),
        ("def work(a) -> int:", "Add one.", True),
        ("def work(a) -> int:", "Add.\n\n    Returns\n    -------\n    a sum", False),
        ("def work(a) -> None:", "Add one.", False),
        ("def work(a) -> Iterator[int]:", "Yield sums.", False),
        ("def work(a) -> Iterator[None]:", "Add while the block runs.", False),
        ("@property\ndef work(a) -> int:", "The sum.", False),
        ("@property\ndef work(a) -> int:", "Return the sum.", True),
    ],
)
def test_what_a_function_returns_is_said_first_or_in_a_section(
    checkout: Path, head: str, first: str, is_missing: bool
) -> None:
    text = f'{head}\n    """{first}\n    """\n'
    (checkout / "controller" / "work.py").write_text(text)
    missing = house.returns_documented(sources_of(checkout))["missing"]
    assert any("work" in where for where in missing) is is_missing


COMMAND = '''
from pathlib import Path
from typing import Annotated

import typer

Wide = Annotated[int, typer.Option("--wide", help="width [mm]")]


def work(part: Annotated[Path, typer.Argument({help})], wide: Wide = 1, json: Wide = 0) -> None:
    """Work."""
    raise typer.Exit(1)
'''


@pytest.mark.parametrize(("given", "missing"), [("help='a part'", 0), ("metavar='PART'", 1)])
def test_a_command_is_documented_by_the_help_of_its_options(
    checkout: Path, given: str, missing: int
) -> None:
    (checkout / "controller" / "work.py").write_text(COMMAND.replace("{help}", given))
    found = house.parameters_documented(sources_of(checkout))["missing"]
    assert [where for where in found if "work" in where] == ["controller/work.py:10 work"] * missing
    raised = house.raises_documented(sources_of(checkout))["missing"]
    assert not any("work" in where for where in raised)


@pytest.mark.parametrize(
    ("handler", "is_raised"),
    [
        ("except (KeyError, ValueError) as error:\n        return str(error)", False),
        ("except ValueError:\n        raise", True),
        ("except OSError:\n        return a", True),
        ("finally:\n        print(a)", True),
    ],
)
def test_what_a_function_catches_itself_it_does_not_raise(
    checkout: Path, handler: str, is_raised: bool
) -> None:
    text = f"def work(a):\n    try:\n        raise ValueError(a)\n    {handler}\n"
    (checkout / "controller" / "work.py").write_text(text)
    raised = house.raises_documented(sources_of(checkout))["missing"]
    assert ("controller/work.py:1 work: ValueError" in raised) is is_raised


def test_every_option_of_every_command_has_a_help_text() -> None:
    sources = ours(house.PRODUCTION)
    shared = house.shared_options(sources)
    commands = {
        name: options
        for source in sources
        for name, function, _ in house.public_functions(source)
        if (options := house.command_options(function, shared)) is not None
    }
    assert {"check", "report", "backup", "camera"} <= set(commands)
    for name, options in commands.items():
        assert all(house.has_help(option) for option in options), name


def test_a_private_module_is_for_its_own_package(checkout: Path) -> None:
    found = house.underscores(sources_of(checkout))
    assert found["where"] == ["tests/test_it.py:1 controller.planning._hidden find"]
    assert (found["by_tests_and_benchmarks"], found["by_other_packages"]) == (1, 0)


@pytest.mark.parametrize(
    ("line", "count"),
    [
        ("from controller.planning import _hidden", 1),
        ("from controller.planning.top import _best", 1),
        ("import controller.planning._hidden", 1),
        ('patch("controller.planning._hidden.find", None)', 1),
        ('patch("controller.planning.top.best", None)', 0),
        ('print("controller._hidden is an example.")', 0),
        ("from controller.planning import __doc__ as text", 0),
    ],
)
def test_a_private_name_is_noticed_however_it_is_imported(
    checkout: Path, line: str, count: int
) -> None:
    (checkout / "tests" / "test_it.py").write_text(line)
    assert house.underscores(sources_of(checkout))["by_tests_and_benchmarks"] == count


def test_tests_benchmarks_and_other_packages_import_public_names() -> None:
    sources = ours((*house.PRODUCTION, *house.READERS))
    assert house.underscores(sources)["where"] == []


@pytest.mark.parametrize(("shared", "pairs"), [(7, 0), (8, 1), (12, 1)])
def test_eight_lines_that_stand_twice_are_a_duplicate(
    tmp_path: Path, shared: int, pairs: int
) -> None:
    body = "".join(f"    step_{n}(x, {{}})  # {n}\n" for n in range(shared))
    for name, literal in (("one", 1), ("two", 22)):
        path = tmp_path / "controller" / f"{name}.py"
        path.parent.mkdir(exist_ok=True)
        text = f"def {name}(x):\n    {name}_begins(x)\n" + body.replace("{}", str(literal))
        path.write_text(text, encoding="utf-8")
    found = house.duplicates(sources_of(tmp_path), keep_names=True)
    assert found["pairs"] == pairs
    assert found["lines_in_them"] == (2 * shared if pairs else 0)


def test_planning_is_no_mesh() -> None:
    figures = house.arrows_within(house.import_graph(ROOT), house.PLANNING)
    assert figures["arrows"] <= MAX_ARROWS_IN_PLANNING
    assert figures["both_ways"] == []


def test_a_room_of_cell_and_results_can_be_looked_over() -> None:
    sources = ours(("controller",))
    assert {"controller.cell.devices", "controller.results.report"} <= {s.package for s in sources}
    large = house.large_packages(sources)
    assert [
        room for room in large if room.startswith(("controller.cell", "controller.results"))
    ] == []


def test_every_public_function_says_what_it_takes_returns_and_raises() -> None:
    sources = ours(house.PRODUCTION)
    parameters = house.parameters_documented(sources)
    raises = house.raises_documented(sources)
    returns = house.returns_documented(sources)
    assert parameters["with"] > 400  # a walk that found nothing would prove nothing
    assert raises["with"] > 200
    assert returns["with"] > 1000
    assert parameters["missing"] == []
    assert raises["missing"] == []
    assert returns["missing"] == []


def test_a_parameters_section_lists_every_parameter_in_a_line_of_its_own(checkout: Path) -> None:
    text = 'def work(a, b, *c, d):\n    """Work.\n\n    Parameters\n    ----------\n'
    text += '    a : one; b : two\n    *c : more\n    """\n'
    (checkout / "controller" / "work.py").write_text(text)
    assert house.unlisted_parameters(sources_of(checkout)) == [
        "controller/work.py:1 work: b",
        "controller/work.py:1 work: d",
    ]
    assert house.unlisted_parameters(ours(house.PRODUCTION)) == []


def test_arrays_have_their_names_in_one_place() -> None:
    named = {
        (source.module, line.split(" = ")[0])
        for source in ours(("controller",))
        if ".starter." not in source.module  # what is laid out for others stands alone
        for line in source.text.splitlines()
        if re.match(r"[A-Z]\w* = (?:npt\.)?NDArray\[np\.", line)
    }
    assert {name for _, name in named} >= {"FloatArray", "IntArray", "BoolArray"}
    assert {module for module, _ in named} == {"controller.arrays"}


def test_lines_are_counted_by_kind(checkout: Path) -> None:
    text = '"""Two lines\nof words."""\n\n# why\nx = 1  # what\n'
    (checkout / "messages").mkdir()
    (checkout / "messages" / "__init__.py").write_text(text, encoding="utf-8")
    size = house.sizes(sources_of(checkout))["messages"]
    counted = {kind: size[kind] for kind in house.KINDS}
    assert counted == {"code": 1, "docstrings": 2, "comments": 1, "empty": 1}
    assert sum(counted.values()) == size["lines"]


def test_classes_with_the_same_fields_are_listed(checkout: Path) -> None:
    fields = "    a: int\n    b: float = 2.0\n    c: str = ''\n"
    for name, body in (("One", fields), ("Other", fields), ("Less", "    a: int\n    b: int\n")):
        file = checkout / "controller" / f"{name.lower()}.py"
        file.write_text(f"class {name}:\n{body}", encoding="utf-8")
    (equal,) = house.equal_classes(sources_of(checkout))
    assert equal["fields"] == 3
    assert [where.split()[-1] for where in equal["classes"]] == ["One", "Other"]
