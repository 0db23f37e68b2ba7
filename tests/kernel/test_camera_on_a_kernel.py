"""The camera's driver on a real kernel's V4L2: boots one with vivid, runs `vivid_cases.py` in it.

The kernel is a User Mode Linux (an ordinary program) named by the variable CELLCTL_KERNEL.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
KERNEL = os.environ.get("CELLCTL_KERNEL", "")
LIMIT_S = 900.0  # a guard against a hang, no measure

pytestmark = [
    pytest.mark.kernel,
    pytest.mark.skipif(not KERNEL, reason="CELLCTL_KERNEL names no User Mode Linux with vivid"),
    pytest.mark.skipif(shutil.which("busybox") is None, reason="needs busybox, linked statically"),
]


def boot(*command: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [str(HERE / "boot.sh"), *command],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )


def test_a_command_that_fails_in_the_kernel_fails_here() -> None:
    done = boot("sh", "-c", "uname -r; exit 7")
    assert done.returncode == 7, done.stdout + done.stderr
    assert done.stdout.strip() != os.uname().release


def test_the_cameras_driver_meets_the_kernels_own_camera() -> None:
    cases = "tests/kernel/vivid_cases.py"
    done = boot(sys.executable, "-m", "pytest", "-n", "0", "-q", "-p", "no:cacheprovider", cases)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    assert " passed" in done.stdout
    assert "skipped" not in done.stdout
