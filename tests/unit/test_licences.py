"""docs/licences.md lists what is installed, and nothing is under a licence that is not allowed."""

import re
import sys
import tomllib
from importlib.metadata import distribution, distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "packaging"))

import licences  # noqa: E402  (its folder comes first)

# Advisories against packages that cellctl needs, and the version that mended each. pip-audit asks
# for those of today where its service can be reached (.ci/run); this is what is held without it.
MENDED = {
    "jinja2": ("3.1.6", "CVE-2025-27516"),
    "lxml": ("4.9.1", "CVE-2022-2309"),
    "opencv-python-headless": ("4.8.1.78", "CVE-2023-4863"),
    "pydantic": ("2.4.0", "CVE-2024-3772"),
    "pygments": ("2.7.4", "CVE-2021-27291"),
    "scipy": ("1.10.0", "CVE-2023-25399"),
    "setuptools": ("78.1.1", "CVE-2025-47273"),
}


def rows() -> dict[str, str]:
    page = (ROOT / "docs" / "licences.md").read_text()
    found = re.findall(r"^\| ([a-z0-9._-]+) \| ([^|]+?) \|", page, re.MULTILINE)
    return {name: licence for name, licence in found if name != "package"}


def test_the_page_lists_what_is_needed_with_its_licence() -> None:
    listed = rows()
    missing = []
    for name in licences.needed():
        if not licences.is_installed(name):
            continue
        found = licences.licence_of(distribution(name))
        if listed.get(name) != found:
            missing.append((name, found, listed.get(name)))
    assert missing == [], "python packaging/licences.py > docs/licences.md"


def test_the_page_lists_the_files_that_are_kept_as_they_are() -> None:
    page = (ROOT / "docs" / "licences.md").read_text()
    listed = set(re.findall(r"^\| `([^`]+)` \| ([^|]+) \| `([0-9a-f]{64})` \|", page, re.MULTILINE))
    assert listed == set(licences.kept())
    for name, (_, _, folder, _) in licences.KEPT.items():
        assert (ROOT / folder / "LICENSE").is_file(), name


def test_nothing_installed_has_a_licence_that_is_not_allowed() -> None:
    assert licences.not_allowed() == {}


def test_a_package_under_the_lgpl_stands_apart_in_an_extra_of_its_own() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for name, (licence, extra) in licences.SEPARATE.items():
        assert licence.startswith("LGPL-")
        assert not licences.is_allowed(licence)
        assert licences.is_allowed_of(name, licence)
        assert not licences.is_allowed_of(name, "GPL-3.0-only")
        assert not licences.is_allowed_of("other", licence)
        holders = {
            one
            for one, needed in extras["optional-dependencies"].items()
            if any(canonicalize_name(Requirement(text).name) == name for text in needed)
        }
        assert holders == {extra}
        assert all(Requirement(text).name != name for text in extras["dependencies"])


@pytest.mark.parametrize(
    ("expression", "allowed"),
    [
        ("MIT", True),
        ("GPL-3.0-only", False),
        ("MIT AND GPL-3.0-only", False),
        ("MIT OR GPL-3.0-only", True),
        ("(Apache-2.0 OR BSD-2-Clause) AND 0BSD", True),
        ("AGPL-3.0-only", False),
        ("", False),
    ],
)
def test_an_expression_is_allowed_if_every_part_is(expression: str, allowed: bool) -> None:
    assert licences.is_allowed(expression) is allowed


def test_no_package_is_older_than_its_last_known_advisory() -> None:
    installed = {canonicalize_name(one.metadata["Name"]): one.version for one in distributions()}
    assert {"jinja2", "lxml", "pydantic"} <= installed.keys()
    for name, (mended, advisory) in MENDED.items():
        if name in installed:
            assert Version(installed[name]) >= Version(mended), f"{name}: {advisory}"
