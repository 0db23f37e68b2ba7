"""The pytest plug-in: `pytest --cell FILE` tries the devices of a cell; else it does nothing.

pytest imports this at each of its starts, so the suite itself is imported only when it is wanted.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from .requirement import Requirement
    from .suite import Suite


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options."""
    group = parser.getgroup("cellctl", "conformance of the devices of a cell")
    group.addoption("--cell", metavar="FILE", help="try the devices of this cell file, no tests")
    group.addoption(
        "--allow-motion", action="store_true", help="let metal move; real devices ask before"
    )
    group.addoption(
        "--cell-device",
        action="append",
        default=[],
        metavar="NAME",
        help="try this device alone; may be repeated (default: all)",
    )
    group.addoption(
        "--cell-report",
        metavar="FILE",
        help="report to sign, .html or .pdf; JSON beside it (default: below conformance/)",
    )
    group.addoption(
        "--cell-speed",
        type=float,
        default=1.0,
        metavar="FACTOR",
        help="speed of emulated devices, times real time (default: 1)",
    )


@pytest.hookimpl(wrapper=True)
def pytest_cmdline_main(config: pytest.Config) -> Generator[None, Any, Any]:
    """Keep everything in one process, since a device has one master; return pytest's exit code.

    Raises
    ------
    UsageError : paths of tests are given, too
    """
    if config.getoption("cell"):
        if config.args_source is pytest.Config.ArgsSource.ARGS:
            raise pytest.UsageError("--cell tries devices alone; leave the paths away")
        for name, value in (("numprocesses", 0), ("dist", "no"), ("tx", [])):
            if hasattr(config.option, name):  # of pytest-xdist
                setattr(config.option, name, value)
    return (yield)


def pytest_configure(config: pytest.Config) -> None:
    """Register the suite if a cell file is given."""
    if config.getoption("cell"):
        config.pluginmanager.register(_Conformance(config), "cellctl-conformance")


class _DeviceNode(pytest.Collector):
    """A device; each requirement on it is an item."""

    def collect(self) -> list[pytest.Item]:
        """Return nothing: the items are made all at once."""
        return []


class _RequirementItem(pytest.Item):
    """A requirement of a device."""

    def __init__(
        self, *, suite: Suite, device: str, requirement: Requirement, name: str, parent: _DeviceNode
    ) -> None:
        super().__init__(name, parent)
        self._suite, self._device, self._requirement = suite, device, requirement

    def runtest(self) -> None:
        """Try it."""
        outcome = self._suite.attempt(self._device, self._requirement)
        self.user_properties.append(("figure", outcome.words))
        if outcome.verdict == "not tried":
            pytest.skip(outcome.message)
        if outcome.verdict != "met":
            pytest.fail(f"{outcome.text}\n{self._device}: {outcome.message}", pytrace=False)

    def reportinfo(self) -> tuple[Path, None, str]:
        """Return its location."""
        return self.path, None, f"{self._device}: {self._requirement.text}"


def _has_terminal() -> bool:
    """Return whether a person can be asked, who reads and types."""
    try:  # not `sys.stdin`, which pytest replaces; it puts files in place of both while it captures
        return os.isatty(0) and os.isatty(1)
    except OSError:
        return False


class _Conformance:
    """Makes the items, and writes the report."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._suite: Suite | None = None
        self._written: list[Path] = []

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self, session: pytest.Session) -> bool:
        """Make the items of all devices, in place of those of files."""
        from controller.config import ConfigError

        from .suite import Suite

        option = self._config.option
        try:
            self._suite = suite = Suite(
                Path(option.cell),
                option.cell_device,
                speed=option.cell_speed,
                allow_motion=option.allow_motion,
                prompt=self._prompt,
            )
        except ConfigError as error:
            raise pytest.UsageError(str(error)) from None
        items: list[pytest.Item] = []
        for device in suite.tried:
            node = _DeviceNode.from_parent(session, name=device, nodeid=device)
            items += [
                _RequirementItem.from_parent(
                    node, name=requirement.name, suite=suite, device=device, requirement=requirement
                )
                for requirement in suite.requirements(device)
            ]
        hook = self._config.hook
        report = pytest.CollectReport("", "passed", None, [*items])
        hook.pytest_collectreport(report=report)
        session.items = items
        hook.pytest_collection_modifyitems(session=session, config=self._config, items=items)
        session.testscollected = len(items)
        hook.pytest_collection_finish(session=session)
        return True

    @pytest.hookimpl(wrapper=True)
    def pytest_runtestloop(self, session: pytest.Session) -> Generator[None, Any, Any]:
        """Open the cell, try everything, close it, write the report."""
        suite = self._suite
        if suite is None or self._config.option.collectonly:
            return (yield)
        from controller.cell.devices.emulator import EmulatorError
        from controller.config import ConfigError
        from drivers.errors import DeviceError

        try:
            suite.open()
        except (ConfigError, EmulatorError, DeviceError) as error:
            suite.close()
            raise pytest.UsageError(str(error)) from None
        try:
            result = yield
        finally:
            suite.close()
            self._write(suite)
        return result

    def _write(self, suite: Suite) -> None:
        from .report import write_report

        findings = suite.findings()
        given = self._config.option.cell_report
        stamp = f"{findings.begun:%Y-%m-%dT%H%M%SZ}"
        path = Path(given) if given else Path("conformance") / f"{findings.cell} {stamp}.html"
        self._written = write_report(findings, path)

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:  # noqa: ANN401  (pytest's own)
        """Print every outcome with its figure, and the path of the report."""
        if self._suite is None:
            return
        terminalreporter.section("devices")
        for tried in self._suite.tried.values():
            firmware = f", firmware {tried.firmware}" if tried.firmware else ""
            where = "emulated" if tried.is_emulated else tried.address
            terminalreporter.line(f"{tried.name}: {tried.model or 'no answer'}{firmware} ({where})")
            for outcome in tried.outcomes:
                terminalreporter.line(f"  {outcome.verdict:9} {outcome.name:12} {outcome.words}")
        for path in self._written:
            terminalreporter.line(f"report: {path}")

    def _prompt(self, request: str) -> bool:
        """Print a request on the terminal; return True if somebody answers yes.

        Only a person who sees the device may answer: a pipe or a file does not count.
        """
        capture = self._config.pluginmanager.getplugin("capturemanager")
        if capture is not None:
            capture.suspend_global_capture(in_=True)
        try:
            if not _has_terminal():
                return False
            sys.stdout.write(f"\n{request}. Done, or agreed? yes/no: ")
            sys.stdout.flush()
            return sys.stdin.readline().strip().lower() in ("y", "yes")
        finally:
            if capture is not None:
                capture.resume_global_capture()
