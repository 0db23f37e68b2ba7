"""The STEP kernel as a process of its own: started with limits, its end reported as a CadError.

Nothing of the kernel is imported here. It may crash, hang or take all memory on a damaged file; the
caller gets a typed error with the reason, in bounded time.
"""

import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ... import errors
from ...errors import CadError, UnreadableCadError

PACKAGE: Final = "controller.step_kernel"
ROOT: Final = Path(__file__).parents[4]  # folder in which the child finds that package
REFUSED: Final = 3  # exit code of a child that gives its reason
# Environment variable: the time that any file is granted [CPU s].
GRANT: Final = "CELLCTL_STEP_CPU_S"
# Sound files take 1 to 3 s for each MB, and up to 11 s where surfaces are hard to divide.
SECONDS_PER_MB: Final = 6.0
GRANT_MAX_S: Final = 1e5
PATIENCE: Final = 4.0  # Computing times after which a child counts as hung.


@dataclass(frozen=True, slots=True)
class KernelLimits:
    """Limits on the kernel's time and memory.

    Attributes
    ----------
    time_s : time of computing [CPU s], for a small file; large ones get `SECONDS_PER_MB` more
    memory_bytes : memory for data; its libraries, 250 MB, come on top
    """

    time_s: float = 30.0
    memory_bytes: int = 700 << 20

    @classmethod
    def granted(cls) -> "KernelLimits":
        """Return the usual limits, or those from the environment.

        Raises
        ------
        UnreadableCadError : the environment grants no positive number of seconds
        """
        text = os.environ.get(GRANT)
        if text is None:
            return cls()
        try:
            time_s = float(text)
        except ValueError:
            time_s = 0.0
        if not 0.0 < time_s < GRANT_MAX_S:
            raise UnreadableCadError(
                f"{GRANT}={text}: is no number of seconds from 1 to {GRANT_MAX_S:g}"
            )
        return cls(time_s=time_s)

    def time_for_s(self, byte_count: int) -> float:
        """Return the computing time allowed for a file of this size [CPU s]."""
        return self.time_s + SECONDS_PER_MB * max(byte_count / 1e6 - 0.2, 0.0)


class KernelRun:
    """One run of the kernel on one file, as a context that leaves no process behind.

    Parameters
    ----------
    program : name of a module of `controller.step_kernel`, or the path of a script
    source : the file
    out : file for the child's arrays
    arguments : arguments that the program takes after file, output, memory and time
    limits : on memory and time; None for the usual ones
    """

    def __init__(
        self,
        program: str | Path,
        source: Path,
        out: Path,
        arguments: Sequence[str] = (),
        limits: KernelLimits | None = None,
    ) -> None:
        limits = limits or KernelLimits.granted()
        self._time_s = limits.time_for_s(source.stat().st_size)
        self._deadline = time.monotonic() + PATIENCE * self._time_s  # but see `_wait`
        self._out = out
        started = [str(program)] if isinstance(program, Path) else ["-m", f"{PACKAGE}.{program}"]
        command = [sys.executable, "-P", *started]
        command += [str(source), str(out), str(limits.memory_bytes), str(ceil(self._time_s))]
        paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
        # the kernel talks to the terminal about each entity; what matters is in the output file
        self._process = subprocess.Popen(
            [*command, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        )

    def __enter__(self) -> "KernelRun":
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()

    def _wait(self) -> int:
        """Return the child's exit code; SIGXCPU for a child that hangs.

        The kernel limits the child's computing time; time spent waiting for a processor does not
        count.
        """
        while True:
            ends = self._deadline + kept_waiting_s(self._process.pid)
            try:
                return self._process.wait(max(ends - time.monotonic(), 0.0))
            except subprocess.TimeoutExpired:
                if time.monotonic() >= self._deadline + kept_waiting_s(self._process.pid):
                    return -signal.SIGXCPU

    def result(self, where: str) -> Mapping[str, NDArray[np.generic]]:
        """Wait for the child and return its arrays.

        Raises
        ------
        CadError : the class the child names; UnreadableCadError where it crashed or hung
        """
        code = self._wait()
        if code == -signal.SIGXCPU:
            raise UnreadableCadError(
                f"{where}: the STEP kernel did not finish within {self._time_s:.0f} s of "
                "computing. The file may be sound: grant more by "
                f"{GRANT}={4 * max(self._time_s, 1.0):.0f}, or export the part without drawings"
            )
        if code == REFUSED:
            failure = json.loads(self._out.read_text())
            error = getattr(errors, failure["error"])
            assert issubclass(error, CadError)
            raise error(f"{where}: {failure['reason']}; export the solid body again")
        if code != 0:
            how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
            raise UnreadableCadError(
                f"{where}: the STEP kernel crashed on it ({how}); export the part again"
            )
        with np.load(self._out, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}


def kept_waiting_s(pid: int) -> float:
    """Return the time that a process waited, ready to run, for a processor [s]."""
    try:
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) * 1e-9
    except (OSError, IndexError, ValueError):
        return 0.0  # it has ended, or this kernel does not count that


def check_installed(where: str) -> None:
    """Require the STEP kernel.

    Raises
    ------
    UnreadableCadError : it is not installed; the message says how to get it
    """
    if importlib.util.find_spec("OCP") is None:
        raise UnreadableCadError(
            f"{where}: STEP files need the STEP kernel, which is not installed; "
            "install it with: pip install 'cellctl[step]'"
        )
