"""A run is started from the page: with what may be named, as a process that outlives the page."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the page's packages are not installed (extra `page`)")
pytest.importorskip("httpx2", reason="starlette's client for tests needs it")

from page_bench import CELL, ORIGIN, Bench, bench
from pydantic import ValidationError

from controller.cell.control import socket_path
from controller.cell.lock import hold_cell
from controller.config import load_cell
from controller.launching import LAST_NAME, LOG_FOLDER, Launcher, LaunchRefusedError, RunRequest
from controller.page.frame.screens import RequestRefusedError
from controller.page.frame.uploads import Uploaded
from controller.page.now.listing import keep_sent
from controller.page.security import Role

RECIPE = "name: plate\npart: plate.stl\n"
# Stands for `cellctl`: says with what it was called, then works until a file allows it to end.
FAKE = """
import json, os, pathlib, signal, sys, time
folder = pathlib.Path(sys.argv[1])
is_deaf = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
print("checking", flush=True)
said = {"argv": sys.argv[2:], "cwd": os.getcwd(), "session": os.getsid(0), "pid": os.getpid(),
        "deaf": is_deaf}
(folder / "said.tmp").write_text(json.dumps(said))
(folder / "said.tmp").rename(folder / "said.json")
while not (folder / "end").exists():
    time.sleep(0.02)
print("refused: the cell is cold", file=sys.stderr)
(folder / "ended").touch()
sys.exit(1)
"""
PATIENCE_S = 600.0  # a guard against a hang, no measure


def until(is_so: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < end_s, "it did not become so"
        time.sleep(0.02)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    folder = tmp_path / "project"
    (folder / "recipes").mkdir(parents=True)
    (folder / "recipes" / "plate.yaml").write_text(RECIPE)
    (folder / "recipes" / "plate.stl").write_text("solid\nendsolid\n")
    (folder / "recipes" / "lost.yaml").write_text("name: lost\npart: nowhere.stl\n")
    (folder / "notes.yaml").write_text("x: 1\n")
    (folder / "cell.yaml").write_text(CELL.read_text())
    (folder / "fake.py").write_text(FAKE)
    return folder


@pytest.fixture
def launcher(project: Path) -> Any:
    found = Launcher(
        project / "runs",
        project,
        (sys.executable, str(project / "fake.py"), str(project)),
    )
    yield found
    (project / "end").touch()
    if found._work is not None:
        found._work.process.wait(PATIENCE_S)


def body(**more: object) -> RunRequest:
    return RunRequest.model_validate({"recipes": [{"recipe": "recipes/plate.yaml"}], **more})


def said(project: Path) -> dict[str, Any]:
    until((project / "said.json").exists)
    found: dict[str, Any] = json.loads((project / "said.json").read_text())
    return found


async def test_what_may_be_started_is_read_from_the_project(launcher: Launcher) -> None:
    found = await launcher.choices()
    own = [one for one in found.recipes if "/" in one.key]
    assert [(one.key, bool(one.problem)) for one in own] == [
        ("recipes/lost.yaml", True),
        ("recipes/plate.yaml", False),
    ]
    assert found.recipe("holder") is not None
    assert [one.key for one in found.cells] == ["cell.yaml"]
    assert "arm" in found.cells[0].emulated


async def test_a_run_has_the_options_of_the_command_line_and_a_session_of_its_own(
    launcher: Launcher, project: Path
) -> None:
    recipes = [{"recipe": "recipes/plate.yaml", "count": 4}, {"recipe": "holder"}]
    more = {"cell": "cell.yaml", "lot": "L 7", "serial_from": "A-001", "speed": 5, "seed": 3}
    more |= {"goes_on": True, "order_number": "4711"}
    await launcher.start(body(recipes=recipes, are_trays_empty=True, **more), "ada")
    found = said(project)
    assert found["argv"][0] == "run"
    assert found["argv"][-3:] == ["--", "recipes/plate.yaml=4", "holder"]
    assert set(found["argv"][1:-3]) == {
        "--operator=ada",
        "--lot=L 7",
        "--order=4711",
        "--cell=cell.yaml",
        "--serial-from=A-001",
        "--across-runs",
        "--speed=5.0",
        "--seed=3",
        "--trays-empty",
        "--wait",
        f"--runs={project / 'runs'}",
    }
    assert found["cwd"] == str(project)
    assert found["session"] == found["pid"] != os.getsid(0)
    assert found["deaf"]


async def test_what_a_run_prints_and_how_it_ends_is_shown(
    launcher: Launcher, project: Path
) -> None:
    assert launcher.facts() is None
    await launcher.start(body(), "ada")
    said(project)
    facts = launcher.facts()
    assert facts is not None
    assert (facts["who"], facts["code"], facts["lines"]) == ("ada", None, ["checking"])
    with pytest.raises(LaunchRefusedError, match="not ended"):
        await launcher.start(body(), "bob")
    (project / "end").touch()
    until(lambda: (launcher.facts() or {})["code"] is not None)
    facts = launcher.facts()
    assert facts is not None
    assert (facts["code"], facts["lines"][-1]) == (1, "refused: the cell is cold")
    assert len(list((project / "runs" / LOG_FOLDER).glob("*.log"))) == 1


def restarted(project: Path) -> Launcher:
    """Return the launcher of the page that is started again."""
    return Launcher(project / "runs", project)


@pytest.mark.parametrize(
    ("more", "counts_on"),
    [
        ({"lot": "L 7", "order_number": "4711", "is_read": True}, False),
        ({"serial_from": "A-001"}, True),
        ({}, False),
    ],
)
async def test_the_last_batch_is_remembered_after_a_restart_and_counts_on(
    launcher: Launcher, project: Path, more: dict[str, Any], counts_on: bool
) -> None:
    assert await launcher.last() is None
    begun = body(**more, are_trays_empty=True, is_part_removed=True)
    await launcher.start(begun, "ada")
    again = await restarted(project).last()
    assert again is not None
    # what was stated of grippers and trays was true then
    stated = {"are_trays_empty": False, "is_part_removed": False, "goes_on": counts_on}
    assert again == begun.model_copy(update=stated)


@pytest.mark.parametrize("more", [{"serials": ["A", "B"]}, {"is_dry": True}])
async def test_a_batch_that_cannot_come_twice_leaves_the_one_before(
    launcher: Launcher, project: Path, more: dict[str, Any]
) -> None:
    await launcher.start(body(lot="L 7"), "ada")
    (project / "end").touch()
    until(lambda: (launcher.facts() or {})["code"] is not None)
    await launcher.start(body(**more), "ada")
    again = await launcher.last()
    assert again is not None
    assert again.lot == "L 7"


async def test_a_batch_of_another_version_is_not_remembered(
    launcher: Launcher, project: Path
) -> None:
    (project / "runs" / LOG_FOLDER).mkdir(parents=True)
    (project / "runs" / LOG_FOLDER / LAST_NAME).write_text('{"recipes": [], "unknown": 1}')
    assert await launcher.last() is None


@pytest.mark.parametrize("is_deaf", [False, True])
async def test_a_preparation_is_cancelled_also_where_sigint_is_ignored(
    launcher: Launcher, project: Path, is_deaf: bool
) -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if is_deaf else None
    with pytest.raises(LaunchRefusedError, match="being prepared"):
        await launcher.cancel()
    await launcher.start(body(), "ada")
    if before is not None:
        signal.signal(signal.SIGINT, before)
    said(project)
    await launcher.cancel()
    until(lambda: (launcher.facts() or {})["code"] is not None)
    assert (launcher.facts() or {})["code"] == -signal.SIGTERM
    with pytest.raises(LaunchRefusedError, match="being prepared"):
        await launcher.cancel()


async def test_nothing_is_started_while_somebody_has_the_cell(
    launcher: Launcher, project: Path
) -> None:
    runs = project / "runs"
    with (
        hold_cell(runs, load_cell(CELL), "another run", socket_path(runs)),
        pytest.raises(LaunchRefusedError, match="another run"),
    ):
        await launcher.start(body(), "ada")
    assert launcher.facts() is None


@pytest.mark.parametrize(
    ("recipe", "cell", "why"),
    [
        ("recipes/none.yaml", "", "no such file"),
        ("../project/recipes/plate.yaml", "", "no such file"),
        ("/etc/passwd", "", "no such file"),
        ("--json", "", "no such file"),
        ("notes.yaml", "", "no such file"),
        ("recipes/lost.yaml", "", "nowhere.stl"),
        ("recipes/plate.yaml", "recipes/plate.yaml", "no such file"),
        ("recipes/plate.yaml", "/etc/passwd", "no such file"),
    ],
)
async def test_a_file_that_is_not_offered_is_not_started(
    launcher: Launcher, recipe: str, cell: str, why: str
) -> None:
    with pytest.raises(LaunchRefusedError, match=why):
        await launcher.start(body(recipes=[{"recipe": recipe}], cell=cell), "ada")
    assert launcher.facts() is None


@pytest.mark.parametrize(
    "more",
    [
        {"recipes": []},
        {"recipes": [{"recipe": "holder", "count": 0}]},
        {"recipes": [{"recipe": "holder", "count": 100_001}]},
        {"recipes": [{"recipe": "holder"}] * 21},
        {"lot": "a\nb"},
        {"lot": "a\x00b"},
        {"lot": "x" * 81},
        {"serials": ["a", ""]},
        {"serials": ["a"] * 2_001},
        {"serials": ["a"], "serial_from": "b"},
        {"serials": ["a"], "is_read": True},
        {"serial_from": "a1", "is_read": True},
        {"goes_on": True},
        {"speed": float("nan")},
        {"speed": 101},
        {"seed": -1},
        {"part_temperature_c": float("inf")},
        {"operator": "somebody else"},
        {"control": "/tmp/x"},
    ],
)
def test_a_start_that_makes_no_sense_is_refused(more: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        body(**more)


async def test_numbers_may_be_read_off_the_parts(launcher: Launcher, project: Path) -> None:
    await launcher.start(body(is_read=True), "ada")
    assert "--scan" in said(project)["argv"]


async def test_a_value_is_never_taken_for_an_option(launcher: Launcher, project: Path) -> None:
    await launcher.start(body(lot="--control=/tmp/x", serials=["-x", "$(id)", "; id"]), "ada")
    found = said(project)["argv"]
    assert "--lot=--control=/tmp/x" in found
    assert [one for one in found if one.startswith("--serial=")] == [
        "--serial=-x",
        "--serial=$(id)",
        "--serial=; id",
    ]


def test_a_page_that_is_killed_leaves_the_run_alone(project: Path) -> None:
    page = f"""
import asyncio, pathlib, sys, time
from controller.launching import Launcher, RunRequest
project = pathlib.Path({str(project)!r})
command = (sys.executable, str(project / "fake.py"), str(project))
body = RunRequest.model_validate({{"recipes": [{{"recipe": "recipes/plate.yaml"}}]}})
asyncio.run(Launcher(project / "runs", project, command).start(body, "ada"))
time.sleep(600)
"""
    killed = subprocess.Popen([sys.executable, "-c", page], start_new_session=True)
    try:
        run = said(project)["pid"]
    finally:
        os.killpg(killed.pid, signal.SIGHUP)
        os.killpg(killed.pid, signal.SIGKILL)
        killed.wait()
    assert run != killed.pid
    os.kill(run, signal.SIGHUP)  # as the end of a terminal would send it
    os.kill(run, 0)  # it is there
    (project / "end").touch()
    until((project / "ended").exists)  # and came to its own end


def test_an_operator_starts_and_a_viewer_does_not(tmp_path: Path, project: Path) -> None:
    at: Bench = bench(tmp_path)
    csrf = at.log_in(Role.VIEWER)
    headers = {"Origin": ORIGIN, "X-CSRF-Token": csrf}
    order = {"recipes": [{"recipe": "no such recipe"}]}
    assert at.client.post("/now/start", json=order, headers=headers).status_code == 403
    assert at.client.get("/now/choices").status_code == 403
    assert 'id="start"' not in at.client.get("/now").text
    at.client.cookies.clear()
    headers["X-CSRF-Token"] = at.log_in(Role.OPERATOR)
    reply = at.client.post("/now/start", json=order, headers=headers)
    assert (reply.status_code, "no such file" in reply.json()["error"]) == (422, True)
    assert "holder" in [one["key"] for one in at.client.get("/now/choices").json()["recipes"]]


def sent(folder: Path, text: str) -> Uploaded:
    path = folder / "sent.csv"
    path.write_text(text)
    return Uploaded("monday.csv", path)


async def test_a_run_is_started_from_a_list_that_names_recipes_of_the_project_alone(
    launcher: Launcher, project: Path
) -> None:
    text = "Serial;Recipe;Lot\nA <1>;plate;L1\nA2;recipes/plate.yaml;\n\nB1;holder;L1\n"
    found = await keep_sent(launcher, sent(project, text), project)
    assert (found["name"], found["parts"]) == ("monday.csv", 3)
    assert found["recipes"] == [("recipes/plate.yaml", 2), ("holder", 1)]
    await launcher.start(body(recipes=[], parts_list=found["key"]), "ada")
    option = next(one for one in said(project)["argv"] if one.startswith("--parts-list="))
    lines = await asyncio.to_thread(Path(option.partition("=")[2]).read_text)
    plate = project / "recipes" / "plate.yaml"
    assert lines.splitlines() == [
        "recipe,serial,lot", f"{plate},A <1>,L1", f"{plate},A2,", "holder,B1,L1",
    ]  # fmt: skip
    facts = launcher.facts()
    assert facts is not None
    assert facts["recipes"] == "monday.csv"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("recipe,serial\n../../etc/passwd,1\n", "no such file"),
        ("recipe\n/etc/hostname\n", "no such file"),
        ("recipe\nlost\n", "nowhere.stl"),
        ("serial\n1\n", "columns"),
        ("recipe,serial,--cell\nplate,1,x\n", "columns"),
        ("recipe,serial\nplate\n", "line 2"),
        ("recipe\n" + "x" * 300 + "\n", "line 2"),
        ("recipe\n", "no parts"),
        ('recipe\n"plate', "line 2"),
    ],
)
async def test_a_list_that_names_anything_else_is_refused_and_not_kept(
    launcher: Launcher, project: Path, text: str, why: str
) -> None:
    with pytest.raises(RequestRefusedError, match=why):
        await keep_sent(launcher, sent(project, text), project)
    assert list((project / "runs").rglob("*.csv")) == []


async def test_a_list_that_was_not_sent_starts_nothing(launcher: Launcher) -> None:
    with pytest.raises(LaunchRefusedError, match="send it again"):
        await launcher.start(body(recipes=[], parts_list="0" * 16), "ada")
    assert launcher.facts() is None


async def test_a_dry_run_has_one_recipe_and_nothing_of_a_part(
    launcher: Launcher, project: Path
) -> None:
    await launcher.start(body(is_dry=True, speed=5), "ada")
    assert set(said(project)["argv"][1:-2]) == {
        "--operator=ada", "--speed=5.0", "--dry", "--wait", f"--runs={project / 'runs'}",
    }  # fmt: skip
    plate = {"recipe": "recipes/plate.yaml"}
    for more in (
        {"lot": "L1"}, {"order_number": "4711"}, {"serial_from": "A1"}, {"is_read": True},
        {"are_trays_empty": True}, {"recipes": [plate, plate]},
        {"recipes": [{**plate, "count": 2}]}, {"recipes": [], "parts_list": "0" * 16},
    ):  # fmt: skip
        with pytest.raises(ValidationError):
            body(is_dry=True, **more)


@pytest.mark.parametrize(
    "more",
    [
        {"recipes": []},
        {"parts_list": "0" * 16},
        {"recipes": [], "parts_list": "../../x"},
        {"recipes": [], "parts_list": "0" * 16, "is_read": True},
    ],
)
def test_a_list_stands_in_place_of_recipes_and_serial_numbers(more: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        body(**more)
