"""Start a run of the emulated cell, and follow it over its control socket as another program would.

    python examples/follow_run.py [RECIPE]

The socket speaks HTTP; docs/control-api.json describes it. Orders go the same way: POST /pause,
/resume, /stop and others, each with who gives it and why.
"""

import http.client
import json
import socket
import subprocess
import sys
import time
from pathlib import Path

RUNS = Path("runs")
recipe = sys.argv[1] if len(sys.argv) > 1 else "holder"
RUN = [sys.executable, "-m", "controller.cli", "run", recipe, "--speed", "10"]


class CellConnection(http.client.HTTPConnection):
    """HTTP to the unix socket that a running cell names in its lock."""

    def connect(self) -> None:
        """Connect to the cell that runs now."""
        path = json.loads((RUNS / "cell.lock").read_text())["control"]
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.connect(path)


def status() -> dict[str, object] | None:
    """Return the cell's status; None while nobody listens."""
    connection = CellConnection("cell", timeout=5)
    try:
        connection.request("GET", "/status")
        return json.loads(connection.getresponse().read())
    except (OSError, ValueError, KeyError):
        return None
    finally:
        connection.close()


run = subprocess.Popen([*RUN, "--runs", str(RUNS)], stdout=subprocess.DEVNULL)
last = None
while run.poll() is None:
    now = status()
    if now is not None and now["state"] != last:
        last = now["state"]
        print(f"{now['run']}: {last}", flush=True)
    time.sleep(0.5)
print(f"the run ended with exit code {run.returncode}")
sys.exit(run.returncode)
