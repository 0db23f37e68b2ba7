"""The map of the code (docs/pictures/map.svg) shows the rooms and imports that there are."""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs"))

import room_map  # noqa: E402  (its folder comes first)

STORED = ROOT / "docs" / "pictures" / "map.svg"
SVG = "{http://www.w3.org/2000/svg}"

# each room imports rooms of a lower number alone, as layers have it
graphs = st.integers(1, 8).flatmap(
    lambda count: st.tuples(
        *(st.sets(st.sampled_from([*map(str, range(n))] or [""])) for n in range(count))
    )
)


def reached(graph: Mapping[str, set[str]], start: str) -> set[str]:
    found = set(graph.get(start, ()))
    return found.union(*(reached(graph, one) for one in found))


def test_the_map_is_up_to_date() -> None:
    stored = STORED.read_text(encoding="utf-8")
    assert stored == room_map.drawing(), "run: python docs/room_map.py > docs/pictures/map.svg"


def test_every_package_is_on_the_map() -> None:
    drawn = [one.text for one in ET.parse(STORED).iter(f"{SVG}text") if one.get("class") == "name"]
    packages = [
        one.parent.name for top in room_map.TOPS for one in (ROOT / top).glob("*/__init__.py")
    ]
    assert len(packages) > 30
    assert sorted(set(packages) - set(drawn)) == []


def test_every_arrow_of_the_controller_points_down_or_to_the_side() -> None:
    ways = [
        [float(y) for y in re.findall(r"[\d.]+ ([\d.]+)", one.get("d", ""))]
        for one in ET.parse(STORED).iter(f"{SVG}path")
        if one.get("class") == "arrow"
    ]
    assert len(ways) > 20
    assert all(way == sorted(way) and way[0] < way[-1] for way in ways)


@given(graphs)
def test_arrows_lead_to_everything_that_a_room_imports(below: tuple[set[str], ...]) -> None:
    graph = {str(n): found - {""} for n, found in enumerate(below)}
    drawn: dict[str, set[str]] = {room: set() for room in graph}
    for room, one in room_map.reduced(graph):
        assert one in graph[room]
        drawn[room].add(one)
    for room in graph:
        assert reached(drawn, room) == reached(graph, room)
        for one in drawn[room]:  # and none of them follows from the others
            assert one not in set().union(*(reached(drawn, other) for other in drawn[room]))


@given(graphs)
def test_a_room_stands_above_what_it_imports(below: tuple[set[str], ...]) -> None:
    graph = {str(n): found - {""} for n, found in enumerate(below)}
    height = {room: n for n, level in enumerate(room_map.levels(graph)) for room in level}
    assert height.keys() == graph.keys()
    assert all(height[room] < height[one] for room, found in graph.items() for one in found)


def test_a_room_without_a_purpose_is_named(tmp_path: Path) -> None:
    room = tmp_path / "controller" / "polishing"
    room.mkdir(parents=True)
    (room / "__init__.py").write_text("import math\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"controller\.polishing: no docstring"):
        room_map.purpose_of("controller.polishing", tmp_path)


def test_a_purpose_has_no_citation_and_does_not_repeat_the_name(tmp_path: Path) -> None:
    room = tmp_path / "polishing"
    room.mkdir()
    text = (
        '"""The polishing: `burrs` -> edges, from a process of its own (ADR 67, 68).\n\nMore."""\n'
    )
    (room / "__init__.py").write_text(text, encoding="utf-8")
    purpose = "Burrs \N{RIGHTWARDS ARROW} edges, from a process of its own"
    assert room_map.purpose_of("polishing", tmp_path) == purpose


def test_a_contract_that_is_not_there_is_named() -> None:
    with pytest.raises(ValueError, match="no import contract 'upwards'"):
        room_map.contract_layers("[tool.importlinter]\ncontracts = []\n", "upwards")
