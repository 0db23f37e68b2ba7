"""Which cellctl this is: version, changelog, commit."""

from __future__ import annotations

import re
import tomllib
from datetime import date
from pathlib import Path
from shutil import which

import pytest
from git_repository import commit_all, git
from packaging.version import Version
from ruamel.yaml import YAML

from controller.setup.software import UNKNOWN, commit_of, software_versions

ROOT = Path(__file__).resolve().parents[2]

needs_git = pytest.mark.skipif(which("git") is None, reason="git is not installed")


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A checkout with one commit."""
    folder = tmp_path / "checkout"
    folder.mkdir()
    (folder / "file").write_text("as committed\n")
    commit_all(folder)
    return folder


def released() -> list[tuple[Version, date]]:
    """Versions and dates of the changelog's headings, in their order."""
    headings = re.findall(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert headings[0] == "Unreleased"
    found = []
    for heading in headings[1:]:
        match = re.fullmatch(r"(\d+\.\d+\.\d+) - (\d{4}-\d\d-\d\d)", heading)
        assert match, f"CHANGELOG.md: `## {heading}`: `## 1.2.3 - 2026-01-31` is expected"
        found.append((Version(match[1]), date.fromisoformat(match[2])))
    return found


def test_the_version_is_the_newest_of_the_changelog() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    newest, _ = released()[0]
    assert Version(project["version"]) == newest


def test_the_changelog_has_the_newest_version_first() -> None:
    versions = released()
    assert versions == sorted(versions, reverse=True)
    assert [day for _, day in versions] == sorted((day for _, day in versions), reverse=True)


@needs_git
def test_the_commit_of_a_checkout_is_the_one_that_is_checked_out(checkout: Path) -> None:
    assert commit_of(checkout) == git(checkout, "rev-parse", "HEAD")[:12]


@needs_git
def test_a_tag_does_not_stand_in_for_the_commit(checkout: Path) -> None:
    git(checkout, "tag", "--annotate", "v9.9.9", "--message", "a release")
    assert commit_of(checkout) == git(checkout, "rev-parse", "HEAD")[:12]


@needs_git
def test_a_changed_checkout_is_named_as_changed(checkout: Path) -> None:
    (checkout / "file").write_text("changed\n")
    assert commit_of(checkout) == git(checkout, "rev-parse", "HEAD")[:12] + "-dirty"


@needs_git
def test_a_folder_inside_another_project_has_no_commit_of_that(checkout: Path) -> None:
    # where a virtual environment usually is: within the user's own repository
    inside = checkout / ".venv" / "lib"
    inside.mkdir(parents=True)
    assert commit_of(inside) == UNKNOWN


@needs_git
def test_a_git_hook_of_another_repository_does_not_mislead(
    checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / "other"
    other.mkdir()
    (other / "file").write_text("of the other\n")
    commit_all(other)
    monkeypatch.setenv("GIT_DIR", str(other / ".git"))
    assert commit_of(checkout) == git(checkout, "rev-parse", "HEAD")[:12]


def test_where_git_is_missing_the_commit_is_unknown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / ".git").mkdir()
    monkeypatch.setenv("PATH", str(tmp_path))
    assert commit_of(tmp_path) == UNKNOWN


def test_a_repository_that_git_refuses_has_an_unknown_commit(tmp_path: Path) -> None:
    (tmp_path / ".git").mkdir()
    assert commit_of(tmp_path) == UNKNOWN


def test_journal_and_reports_name_the_commit() -> None:
    assert re.fullmatch(r"[0-9a-f]{12}(-dirty)?|unknown", software_versions()["commit"])


def test_the_citation_is_of_the_newest_version_and_names_the_paper() -> None:
    cited = YAML(typ="safe").load(ROOT / "CITATION.cff")
    version, day = released()[0]
    assert (Version(cited["version"]), cited["date-released"]) == (version, day)
    assert cited["license"] == "Apache-2.0"
    (title,) = re.findall(r'^"(.+?)":', (ROOT / "docs" / "paper.md").read_text("utf-8"), re.M)
    assert title in [one["title"] for one in cited["references"]]


def test_the_supported_version_is_the_newest() -> None:
    (stated,) = re.findall(
        r"^\| the newest minor version \((\d+\.\d+)\) \|", (ROOT / "SECURITY.md").read_text(), re.M
    )
    newest, _ = released()[0]
    assert stated == f"{newest.major}.{newest.minor}"
