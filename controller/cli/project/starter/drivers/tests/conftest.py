"""What the tests share: the emulator as a process of its own, and a cell file that names it."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

EMULATOR = "controller.cli.project.starter.drivers.gripper.emulator"
CELL = Path(__file__).parents[1] / "cell.yaml"


@pytest.fixture(scope="session")
def address() -> Iterator[str]:
    """Yield the address of the emulator, run on a free port: the first line that it prints."""
    words = [sys.executable, "-m", EMULATOR, "--port", "0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as emulator:
        try:
            assert emulator.stdout is not None
            yield emulator.stdout.readline().strip()
        finally:
            emulator.terminate()


@pytest.fixture
def cell_file(address: str, tmp_path: Path) -> Path:
    """Return a cell file with the address of the emulator in it."""
    text = CELL.read_text(encoding="utf-8")
    path = tmp_path / "cell.yaml"
    path.write_text(text.replace("127.0.0.1:5020", address), encoding="utf-8")
    return path
