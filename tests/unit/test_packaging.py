"""Container and service: that they name what exists, start no run, and let a run end in order."""

from __future__ import annotations

import configparser
import json
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from packaging.specifiers import SpecifierSet
from ruamel.yaml import YAML
from sqlalchemy import make_url

from controller.cli.app import app
from controller.history.store import VARIABLE

ROOT = Path(__file__).resolve().parents[2]
PACKAGING = ROOT / "packaging"
DOCKERFILE = PACKAGING / "docker" / "Dockerfile"
COMPOSE = PACKAGING / "docker" / "compose.yaml"
INIT = PACKAGING / "docker" / "init"
UNIT = PACKAGING / "systemd" / "cellctl-page.service"
UNITS = [UNIT, PACKAGING / "systemd" / "cellctl-connect.service"]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
VERSION = PROJECT["version"]
RELEASED = {f"cellctl-{VERSION}-py3-none-any.whl", f"constraints-{VERSION}.txt"}


def instructions() -> list[tuple[str, str]]:
    """Words and arguments of the Dockerfile."""
    text = re.sub(r"\\\n", " ", re.sub(r"(?m)^#.*\n", "", DOCKERFILE.read_text()))
    lines = [line.split(None, 1) for line in text.splitlines() if line.strip()]
    return [(word, rest.strip()) for word, rest in lines]


def given(word: str) -> list[str]:
    return [rest for name, rest in instructions() if name == word]


@pytest.fixture
def compose() -> dict[str, Any]:
    loaded: dict[str, Any] = YAML(typ="safe").load(COMPOSE)
    return loaded


class Settings(dict[str, list[str]]):
    """A section of a unit; a key that stands several times keeps all its values."""

    def __setitem__(self, key: str, value: Any) -> None:
        if key in self and isinstance(value, list):
            self[key].extend(value)
        else:
            super().__setitem__(key, value)


def service(text: str) -> dict[str, list[str]]:
    """Keys of the section Service, each with all its values."""
    parser = configparser.RawConfigParser(
        dict_type=Settings, strict=False, interpolation=None, delimiters=("=",)
    )
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    parser.read_string(text)
    return {key: value.splitlines() for key, value in parser["Service"].items()}


def options_of(command: str) -> set[str]:
    """Options of a command of cellctl."""
    found = typer.main.get_command(app).commands[command]  # type: ignore[attr-defined]
    return {name for parameter in found.params for name in parameter.opts}


def require_serves(words: list[str]) -> None:
    """Check that a command line shows the page, with options that there are."""
    assert words[0] == "serve", words
    options = [word for word in words[1:] if word.startswith("-")]
    assert set(options) <= options_of("serve")


def test_the_image_is_made_of_what_a_release_builds() -> None:
    for rest in given("COPY"):
        *sources, _ = [word for word in shlex.split(rest) if not word.startswith("--")]
        for source in sources:
            if source.startswith("dist/"):
                matching = [name for name in RELEASED if Path("dist", name).match(source)]
                assert len(matching) == 1, source
            else:
                assert (ROOT / source).is_file(), source


def test_the_image_has_a_python_that_cellctl_supports() -> None:
    (base,) = given("FROM")
    match = re.fullmatch(r"python:(3\.\d+)-slim-\w+", base)
    assert match
    assert SpecifierSet(PROJECT["requires-python"]).contains(f"{match[1]}.0")


def test_every_package_of_the_image_is_verified_by_its_hash() -> None:
    installs = [line for line in " ".join(given("RUN")).split("&&") if "pip install" in line]
    assert installs
    for line in installs:
        assert "--require-hashes" in line or {"--no-index", "--no-deps"} <= set(line.split()), line


def test_the_container_runs_as_the_user_that_it_makes_and_ends_by_our_init() -> None:
    (user,) = given("USER")
    (made,) = re.findall(r"useradd --uid (\d+) ", " ".join(given("RUN")))
    assert user == made
    assert int(user) > 0
    entry, command = json.loads(given("ENTRYPOINT")[0]), json.loads(given("CMD")[0])
    copied = [rest.split()[-1] for rest in given("COPY")]
    assert entry[0] in copied
    assert entry[1] == "cellctl"
    require_serves(command)


def test_the_containers_are_of_this_version_and_start_no_run(compose: dict[str, Any]) -> None:
    cell = compose["services"]["cell"]
    assert cell["image"] == f"cellctl:{VERSION}"
    assert f"cellctl:{VERSION} " in DOCKERFILE.read_text()
    assert "command" not in cell
    assert "entrypoint" not in cell


def test_the_containers_may_do_no_more_than_they_need(compose: dict[str, Any]) -> None:
    cell = compose["services"]["cell"]
    assert cell["cap_drop"] == ["ALL"]
    assert cell["read_only"] is True
    assert "no-new-privileges:true" in cell["security_opt"]
    for service_ in compose["services"].values():
        assert not service_.get("privileged", False)
        for port in service_.get("ports", []):
            assert port.startswith("127.0.0.1:"), "reachable from other machines"


def test_the_history_of_the_containers_is_a_store_that_cellctl_opens(
    compose: dict[str, Any],
) -> None:
    url = make_url(
        re.sub(r"\$\{.*?\}", "secret", compose["services"]["cell"]["environment"][VARIABLE])
    )
    url.get_dialect()  # raises where its driver is not installed
    database = compose["services"]["history"]["environment"]
    assert (url.username, url.database) == (database["POSTGRES_USER"], database["POSTGRES_DB"])
    (port,) = compose["services"]["history"]["ports"]
    assert port.startswith(f"{url.host}:{url.port}:")
    assert "postgres" in PROJECT["optional-dependencies"]


@pytest.fixture
def first_process(tmp_path: Path) -> Iterator[Any]:
    """Start `init` as the first process of its own process namespace, as in a container."""
    enter = ["unshare", "--user", "--map-root-user", "--pid", "--fork", "--mount-proc"]
    if not shutil.which("unshare") or subprocess.run([*enter, "true"], check=False).returncode:
        pytest.skip("no process namespaces here")
    started: list[subprocess.Popen[bytes]] = []

    def start(script: str) -> subprocess.Popen[bytes]:
        command = [*enter, str(INIT), sys.executable, "-c", script, str(tmp_path)]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


# A page and a run that it has started, in a session of its own; the run needs a while to halt the
# arm, and writes that it has.
PAGE = """
import pathlib, signal, subprocess, sys
run = '''
import pathlib, signal, sys, time
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
print("running", flush=True)
signal.sigwait([signal.SIGTERM])
time.sleep(0.5)
pathlib.Path(sys.argv[1], "halted").touch()
'''
subprocess.Popen([sys.executable, "-c", run, sys.argv[1]], start_new_session=True)
"""


def container_init_of(outer: subprocess.Popen[bytes]) -> int:
    """Process id of `init`, the one child of `unshare`."""
    (child,) = Path(f"/proc/{outer.pid}/task/{outer.pid}/children").read_text().split()
    return int(child)


def test_a_stop_of_the_container_lets_a_run_halt_the_arm(
    first_process: Any, tmp_path: Path
) -> None:
    outer = first_process(PAGE + "signal.pause()")
    assert outer.stdout.readline() == b"running\n"
    subprocess.run(["kill", "-TERM", str(container_init_of(outer))], check=True)
    outer.wait(timeout=60)
    assert (tmp_path / "halted").is_file()


def test_the_container_outlives_its_page_while_a_run_is_on(
    first_process: Any, tmp_path: Path
) -> None:
    outer = first_process(PAGE + "sys.exit(3)")
    assert outer.stdout.readline() == b"running\n"
    assert outer.poll() is None
    subprocess.run(["kill", "-TERM", str(container_init_of(outer))], check=True)
    assert outer.wait(timeout=60) == 3  # the page's own code: `restart: on-failure` brings it back
    assert (tmp_path / "halted").is_file()


def test_the_unit_serves_the_page_and_nothing_starts_a_run() -> None:
    (command,) = service(UNIT.read_text())["ExecStart"]
    program, *words = command.split()
    assert program == "/opt/cellctl/bin/cellctl"
    require_serves([word for word in words if not word.startswith("$")])
    for unit in (PACKAGING / "systemd").iterdir():
        assert not re.search(r"^Exec\w+=.*cellctl (run|recover)\b", unit.read_text(), re.MULTILINE)


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_a_unit_writes_to_the_cells_folder_alone(unit: Path) -> None:
    settings = service(unit.read_text())
    assert settings["ProtectSystem"] == ["strict"]
    assert settings["NoNewPrivileges"] == ["yes"]
    (writable,) = settings["ReadWritePaths"]
    assert settings["StateDirectory"] == [Path(writable).name]
    words = settings["ExecStart"][0].split()
    for path in (settings["WorkingDirectory"][0], words[words.index("--runs") + 1]):
        assert Path(path).is_relative_to(writable)


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_a_restart_of_a_unit_leaves_a_run_and_its_control_socket(unit: Path) -> None:
    settings = service(unit.read_text())
    assert settings["KillMode"] == ["process"]
    assert settings["RuntimeDirectoryPreserve"] == ["yes"]
    (runtime,) = settings["RuntimeDirectory"]
    assert f"XDG_RUNTIME_DIR=/run/{runtime}" in settings["Environment"]


needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd is not installed"
)


def analyze(folder: Path, text: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Have systemd read a unit whose program is one that is here."""
    unit = folder / UNIT.name
    unit.write_text(text.replace("/opt/cellctl/bin/cellctl", sys.executable))
    return subprocess.run(
        ["systemd-analyze", *words, str(unit)], capture_output=True, text=True, check=False
    )


@needs_systemd
@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_systemd_reads_a_unit_without_a_remark(tmp_path: Path, unit: Path) -> None:
    done = analyze(tmp_path, unit.read_text(), "verify", "--man=no")
    remarks = [line for line in done.stderr.splitlines() if UNIT.name in line]
    assert (done.returncode, remarks) == (0, [])


@needs_systemd
def test_systemd_would_remark_a_key_that_it_does_not_know(tmp_path: Path) -> None:
    wrong = UNIT.read_text().replace("ProtectSystem=", "ProtectSytem=")
    done = analyze(tmp_path, wrong, "verify", "--man=no")
    assert "ProtectSytem" in done.stderr


@needs_systemd
@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_a_unit_is_closed_as_far_as_its_devices_let_it(tmp_path: Path, unit: Path) -> None:
    # in tenths: below 5.0 systemd calls a unit OK; devices and the network keep it from 0
    done = analyze(
        tmp_path, unit.read_text(), "security", "--offline=true", "--threshold=49", "--no-pager"
    )
    assert done.returncode == 0, done.stdout[-200:]
