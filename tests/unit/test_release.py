"""What a release consists of: pinned packages, the bill of materials, and what refuses to build."""

from __future__ import annotations

import re
import sys
import tomllib
import uuid
from datetime import UTC, datetime
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "packaging"))

import licences  # noqa: E402  (its folder comes first)
import release  # noqa: E402

PINS = release.pins(release.CONSTRAINTS.read_text("utf-8"))
AT = datetime(2026, 3, 1, tzinfo=UTC)


def asked_for() -> list[Requirement]:
    """Packages that pyproject.toml asks for in a cell, with their bounds."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    texts = [*project["dependencies"], *(one for name in release.EXTRAS for one in extras[name])]
    return [Requirement(text) for text in texts]


@pytest.fixture(scope="module")
def bill() -> dict[str, Any]:
    return release.bill_of_materials("1.2.3", "0123456789ab", {"cellctl.whl": "00"}, AT)


@pytest.mark.parametrize("wanted", asked_for(), ids=str)
def test_what_a_cell_needs_is_pinned_within_its_bounds(wanted: Requirement) -> None:
    found = [pin for pin in PINS if pin.name == canonicalize_name(wanted.name)]
    assert found, "python packaging/release.py constraints"
    for pin in found:
        assert wanted.specifier.contains(pin.version), pin


def test_what_those_need_is_pinned_too() -> None:
    here = {pin.name for pin in PINS if pin.is_for_this_python}
    needed = {name for name in licences.needed(release.EXTRAS) if licences.is_installed(name)}
    assert len(needed) > 30
    assert needed - here == set(), "python packaging/release.py constraints"


def test_one_version_of_each_is_for_this_python() -> None:
    here = [pin.name for pin in PINS if pin.is_for_this_python]
    assert len(here) == len(set(here))


def test_every_pin_has_the_hashes_of_its_files() -> None:
    for pin in PINS:
        assert pin.sha256, pin.name
        assert all(re.fullmatch("[0-9a-f]{64}", digest) for digest in pin.sha256), pin.name


def test_pins_are_read_with_marker_and_hashes() -> None:
    text = (
        "a==1.0 ; python_version < '3' \\\n    --hash=sha256:ab \\\n    --hash=sha256:cd\nb-c==2\n"
    )
    assert release.pins(text) == [
        release.Pin("a", "1.0", "python_version < '3'", ("ab", "cd")),
        release.Pin("b-c", "2", None, ()),
    ]
    assert [pin.is_for_this_python for pin in release.pins(text)] == [False, True]


def test_no_pin_is_older_than_what_mends_an_advisory() -> None:
    from test_licences import MENDED

    for pin in PINS:
        if pin.name in MENDED:
            mended, advisory = MENDED[pin.name]
            assert Version(pin.version) >= Version(mended), advisory


def test_the_bill_lists_what_a_cell_installs_and_nothing_of_the_tests(bill: dict[str, Any]) -> None:
    names = {component["name"] for component in bill["components"]}
    assert {canonicalize_name(one.name) for one in asked_for() if is_for_here(one)} <= names
    assert {"three", "pydantic-core"} <= names  # the page's script; what pydantic needs
    assert names.isdisjoint({"pytest", "hypothesis", "ruff", "axe-core", "distributed"})


def is_for_here(one: Requirement) -> bool:
    return one.marker is None or one.marker.evaluate()


def test_every_component_has_version_licence_and_purl(bill: dict[str, Any]) -> None:
    for component in [*bill["components"], bill["metadata"]["component"]]:
        kind, _, rest = component["purl"].removeprefix("pkg:").partition("/")
        assert (kind, rest) == (
            "npm" if component["name"] == "three" else "pypi",
            f"{component['name']}@{component['version']}",
        )
        ((licence,),) = [one.values() for one in component["licenses"]]
        assert licences.is_allowed(licence)


def test_dependencies_lead_from_cellctl_to_every_component(bill: dict[str, Any]) -> None:
    leads = {row["ref"]: row["dependsOn"] for row in bill["dependencies"]}
    refs = {component["bom-ref"] for component in bill["components"]}
    assert leads.keys() == refs | {bill["metadata"]["component"]["bom-ref"]}
    reached: set[str] = set()
    ahead = [bill["metadata"]["component"]["bom-ref"]]
    while ahead:
        one = ahead.pop()
        if one not in reached:
            reached.add(one)
            ahead += leads[one]
    assert reached == leads.keys()


def test_what_a_package_bundles_is_within_it(bill: dict[str, Any]) -> None:
    inside = {one["name"]: one.get("components", []) for one in bill["components"]}
    for name in licences.BUNDLED:
        (bundled,) = inside[name]
        assert bundled["licenses"][0]["expression"].startswith("LGPL-2.1")


def test_the_same_release_gives_the_same_bill(bill: dict[str, Any]) -> None:
    again = release.bill_of_materials("1.2.3", "0123456789ab", {"cellctl.whl": "00"}, AT)
    assert again == bill
    other = release.bill_of_materials("1.2.4", "0123456789ab", {"cellctl.whl": "00"}, AT)
    assert uuid.UUID(other["serialNumber"]) != uuid.UUID(bill["serialNumber"])


def test_a_package_that_is_not_pinned_ends_the_release(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "constraints.txt"
    version = distribution("numpy").version
    file.write_text(f"numpy=={version}\n")
    monkeypatch.setattr(release, "CONSTRAINTS", file)
    with pytest.raises(release.ReleaseError, match=r"not pinned: .*scipy"):
        release.bill_of_materials("1.2.3", "0123456789ab", {}, AT)


def test_a_command_that_there_is_not_is_answered_with_those_there_are(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert release.main(["publish"]) == 2
    assert "constraints" in capsys.readouterr().err
