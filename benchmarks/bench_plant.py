"""The connection to a plant: how late a result is on each wire, and what the bridge costs.

    python benchmarks/bench_plant.py                 200 parts at 20 times the real rate
    python benchmarks/bench_plant.py --parts 2400    what two hours at that rate bring

A journal grows by parts as runs write them, at `--rate` parts a second, while the real `cellctl
connect` serves webhook, folder, REST and a PLC's registers, OPC UA where asyncua is installed, and
MQTT and Sparkplug where mosquitto is. Each receiver is of this script; the one of OPC UA subscribes
with 50 ms. A result is late by the time from the row that finished its part until the receiver has
it; REST and the PLC's registers are asked every 50 ms, and the PLC acknowledges each result before
it gets the next. Sparkplug's is the DDATA that mirrors it. The bridge's memory is read when it is
ready and at the end. `bench_plant_cell.py` has whole runs beside it.
"""

import asyncio
import base64
import http.server
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import numpy as np
from bench import EMULATED, ROOT, Arguments, note, show
from pymodbus import ModbusException
from pymodbus.client import ModbusTcpClient
from results_bench import RunWriter, verdict, view

from controller.cell.batch import Papers
from controller.plant.wires.mqtt.payload import decode

ASKED_S = 1.0
ASKED_MB = 150.0
ASK_REST_S = 0.05
LAST_WALL_S = 60.0
PASSWORD = "of the benchmark alone"
RUN_PARTS = 20


class Arrivals:
    """When each receiver had each part, by run and number [s of this machine's clock]."""

    def __init__(self) -> None:
        self.at: dict[str, dict[tuple[str, int], float]] = {}
        self._lock = threading.Lock()
        self._key_of: dict[int, tuple[str, int]] = {}
        self._unnamed: list[tuple[str, int, float]] = []

    def note(self, wire: str, part: dict[str, Any]) -> None:
        """Note a result; alarms do not count."""
        if part.get("schema") == "cellctl.part/1":
            with self._lock:
                key = (str(part["run"]), int(part["part"]))
                self._key_of[int(part["seq"])] = key
                self.at.setdefault(wire, {}).setdefault(key, time.monotonic())
                self._name()

    def note_number(self, wire: str, seq: int) -> None:
        """Note a result by its row, where a wire has that alone; another wire names the part."""
        with self._lock:
            self._unnamed.append((wire, seq, time.monotonic()))
            self._name()

    def _name(self) -> None:
        unnamed, self._unnamed = self._unnamed, []
        for wire, seq, at_s in unnamed:
            key = self._key_of.get(seq)
            if key is None:
                self._unnamed.append((wire, seq, at_s))
            else:
                self.at.setdefault(wire, {}).setdefault(key, at_s)


def free_port() -> int:
    with socket.socket() as tried:
        tried.bind(("127.0.0.1", 0))
        return int(tried.getsockname()[1])


def wait_open(port: int) -> None:
    """Wait until a port of this machine is listened at, within a time."""
    end_s = time.monotonic() + LAST_WALL_S
    while time.monotonic() < end_s:
        try:
            socket.create_connection(("127.0.0.1", port), 0.2).close()
        except OSError:
            time.sleep(0.05)
        else:
            return


def webhook(stack: ExitStack, arrivals: Arrivals) -> str:
    """Serve a webhook; return its address."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            arrivals.note("webhook", json.loads(body))
            self.send_response(204)
            self.end_headers()

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    stack.callback(server.shutdown)
    return f"http://127.0.0.1:{server.server_address[1]}/"


def follow(stack: ExitStack, look: Callable[[], None]) -> None:
    """Call a function again and again until the end."""
    is_over = threading.Event()

    def work() -> None:
        while not is_over.wait(ASK_REST_S):
            look()

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    stack.callback(thread.join)
    stack.callback(is_over.set)


def watch_folder(folder: Path, arrivals: Arrivals) -> Callable[[], None]:
    seen: set[str] = set()

    def look() -> None:
        for entry in os.scandir(folder):
            if entry.name not in seen and not entry.name.startswith("."):
                seen.add(entry.name)
                arrivals.note("folder", json.loads(Path(entry.path).read_bytes()))

    return look


def ask_rest(port: int, arrivals: Arrivals) -> Callable[[], None]:
    last = 0
    account = base64.b64encode(f"bench:{PASSWORD}".encode()).decode()

    def look() -> None:
        nonlocal last
        url = f"http://127.0.0.1:{port}/api/v1/parts?after={last}"
        try:
            with urlopen(Request(url, headers={"Authorization": f"Basic {account}"})) as answer:
                found = json.load(answer)
        except OSError:  # not ready yet
            return
        for part in found:
            arrivals.note("rest", part)
            last = part["seq"]

    return look


def ask_plc(port: int, arrivals: Arrivals) -> Callable[[], None]:
    """Be a PLC that only takes results: read, acknowledge, drop the acknowledgement."""
    plc = ModbusTcpClient("127.0.0.1", port=port)
    has_acknowledged = False

    def look() -> None:
        nonlocal has_acknowledged
        if not plc.connected and not plc.connect():  # not ready yet
            return
        with suppress(ModbusException):  # the bridge may be gone already
            registers = plc.read_holding_registers(0, count=10).registers
            is_valid = bool(registers[1] >> 3 & 1)
            if is_valid and not has_acknowledged:
                arrivals.note_number("plc", registers[8] << 16 | registers[9])
            if is_valid != has_acknowledged:
                plc.write_register(100, 4 * is_valid)
                has_acknowledged = is_valid

    return look


def heard_json(payload: bytes) -> Iterator[dict[str, Any]]:
    """Yield the results in a Sparkplug payload: DDATA has aliases, and one value is their JSON."""
    for metric in decode(payload).metrics:
        if isinstance(metric.value, str) and metric.value.startswith("{"):
            yield json.loads(metric.value)


def broker(stack: ExitStack, folder: Path, arrivals: Arrivals) -> int | None:
    """Start a broker and a subscriber; return its port, None where there is no mosquitto."""
    program = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
    subscribe = shutil.which("mosquitto_sub")
    if program is None or subscribe is None:
        return None
    port = free_port()
    settings = folder / "mosquitto.conf"
    settings.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\n")
    served = subprocess.Popen([program, "-c", str(settings)], stderr=subprocess.DEVNULL)
    stack.callback(served.wait)
    stack.callback(served.terminate)
    wait_open(port)

    def listen(topic: str, hear: Callable[[bytes], None]) -> None:
        heard = subprocess.Popen(
            [subscribe, "-p", str(port), "-q", "1", "-t", topic, "-F", "%x"],
            stdout=subprocess.PIPE,
        )
        stack.callback(heard.wait)
        stack.callback(heard.terminate)

        def work() -> None:
            assert heard.stdout is not None
            for line in heard.stdout:
                hear(bytes.fromhex(line.decode()))

        threading.Thread(target=work, daemon=True).start()

    def mirror(payload: bytes) -> None:
        for part in heard_json(payload):
            arrivals.note("sparkplug", part)

    listen("cellctl/v1/bench/part", lambda payload: arrivals.note("mqtt", json.loads(payload)))
    listen("spBv1.0/bench/DDATA/#", mirror)
    return port


def opcua(stack: ExitStack, folder: Path, arrivals: Arrivals) -> tuple[int | None, threading.Event]:
    """Wait for an OPC UA server beside the rest.

    Returns
    -------
    the port that it is to have, None without asyncua; an event: it is subscribed to
    """
    is_ready = threading.Event()
    if find_spec("asyncua") is None:
        is_ready.set()
        return None, is_ready
    sys.path.insert(0, str(ROOT / "tests" / "plant"))
    port, loop = free_port(), asyncio.new_event_loop()
    from opcua_bench import make_certificate

    certificate, key = make_certificate(folder / "clients", "bench")
    trusted = folder / "connect" / "opcua" / "trusted"
    trusted.mkdir(parents=True)
    shutil.copy(certificate, trusted)

    class Listener:
        def event_notification(self, event: Any) -> None:  # noqa: ANN401 - asyncua's
            if event.ResultContent is not None:
                arrivals.note("opcua", json.loads(event.ResultContent[0].Value))

    async def listen() -> None:
        from asyncua import Client, ua
        from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
        from opcua_bench import Vision

        while True:
            client = Client(
                f"opc.tcp://127.0.0.1:{port}/cellctl", timeout=60, watchdog_intervall=60
            )
            client.application_uri = "urn:test:bench"
            client.set_user("bench")
            client.set_password(PASSWORD)
            try:
                await client.set_security(SecurityPolicyBasic256Sha256, certificate, key)
                await client.connect()
                break
            except OSError:
                await asyncio.sleep(0.2)
        await client.load_data_type_definitions()
        vision = await Vision.found(client)
        subscription = await client.create_subscription(50, Listener())
        kind = client.get_node(ua.NodeId(1024, vision.namespace))
        await subscription.subscribe_events(vision.node, [kind])
        is_ready.set()
        await is_over.wait()
        with suppress(OSError, TimeoutError):  # the bridge may be gone already
            await client.disconnect()

    is_over = asyncio.Event()
    thread = threading.Thread(target=loop.run_until_complete, args=(listen(),), daemon=True)
    thread.start()
    stack.callback(thread.join)
    stack.callback(loop.call_soon_threadsafe, is_over.set)
    return port, is_ready


def cell_file(
    folder: Path, url: str, rest: int, plc: int, mqtt: int | None, opc: int | None
) -> Path:
    """Write a cell file with these wires."""
    text = EMULATED.read_text().replace("name: emulated", "name: bench")
    text += (
        "\nconnect:\n  may_start: yes\n"
        f"  webhook: [{{url: '{url}', secret_file: secret}}]\n"
        "  folder: [{path: out, name: '{run}_{part}'}]\n"
        f"  rest: {{listen: '127.0.0.1:{rest}'}}\n"
    )
    text += f"  plc: {{listen: '127.0.0.1:{plc}', recipes: {{1: holder}}}}\n"
    if mqtt is not None:
        text += f"  mqtt: {{broker: 127.0.0.1, port: {mqtt}, sparkplug: {{group: bench}}}}\n"
    if opc is not None:
        text += f"  opcua: {{listen: '127.0.0.1:{opc}'}}\n"
    (folder / "secret").write_text("a secret of this benchmark alone")
    (folder / "secret").chmod(0o600)
    (folder / "out").mkdir()
    path = folder / "cell.yaml"
    path.write_text(text)
    return path


def memory_mb(pid: int) -> float:
    text = Path(f"/proc/{pid}/status").read_text()
    return int(text.split("VmRSS:")[1].split()[0]) / 1024


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def write_parts(runs: Path, count: int, rate: float, day: int) -> dict[tuple[str, int], float]:
    """Write runs at a rate; return when each part's last row was written."""
    finished: dict[tuple[str, int], float] = {}
    shown, judged = (view("G1-V0"), view("G1-V3")), verdict()
    pause_s = 1.0 / rate
    for first in range(0, count, RUN_PARTS):
        at = f"{first // 3600:02}{first // 60 % 60:02}{first % 60:02}"
        run = f"202603{day:02}-{at}-000-featuretype"
        of_run = min(RUN_PARTS, count - first)
        # the PLC gets the parts of its own orders alone
        papers = Papers(order_number="PLC-bench")
        writer = RunWriter(runs, run, count=of_run, cell_name="bench", papers=papers)
        for part in range(1, of_run + 1):
            began_s = time.monotonic()
            writer.whole_part(shown, judged, "accept")
            finished[run, part] = time.monotonic()
            time.sleep(max(0.0, pause_s - (time.monotonic() - began_s)))
        writer.end()
    return finished


@dataclass(frozen=True)
class Connected:
    """A bridge with every wire, and a receiver at each.

    Attributes
    ----------
    folder : of the cell file, `runs` in it
    pid : of the bridge
    rest : port of its REST
    wires : those that are there
    """

    folder: Path
    pid: int
    rest: int
    wires: tuple[str, ...]
    arrivals: Arrivals
    environment: dict[str, str]

    @property
    def runs(self) -> Path:
        return self.folder / "runs"


def connected(stack: ExitStack, *options: str) -> Connected:
    """Start `cellctl connect` with every wire, and a receiver at each."""
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
    arrivals = Arrivals()
    runs, rest, plc = folder / "runs", free_port(), free_port()
    runs.mkdir()
    environment = {**os.environ, "XDG_CONFIG_HOME": str(folder / "config")}
    subprocess.run(
        [sys.executable, "-m", "controller.cli", "account", "bench", "--role", "plant"],
        input=PASSWORD, text=True, check=True, env=environment, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    port = broker(stack, folder, arrivals)
    opc, is_subscribed = opcua(stack, folder, arrivals)
    path = cell_file(folder, webhook(stack, arrivals), rest, plc, port, opc)
    bridge = subprocess.Popen(
        [sys.executable, "-m", "controller.cli", "connect", f"--cell={path}",
         f"--runs={runs}", "--json", *options],
        stdout=subprocess.PIPE, env=environment, cwd=folder,
    )  # fmt: skip
    stack.callback(bridge.wait)
    stack.callback(bridge.send_signal, signal.SIGTERM)
    assert bridge.stdout is not None
    ready = json.loads(bridge.stdout.readline())
    note({"wires": ready["wires"]})
    for listening in (rest, plc, *([opc] if opc else [])):
        wait_open(listening)
    follow(stack, watch_folder(folder / "out", arrivals))
    follow(stack, ask_rest(rest, arrivals))
    follow(stack, ask_plc(plc, arrivals))
    is_subscribed.wait(LAST_WALL_S)
    wires = (
        *("webhook", "folder", "rest", "plc"),
        *(["mqtt", "sparkplug"] if port else []),
        *(["opcua"] if opc else []),
    )
    return Connected(folder, bridge.pid, rest, wires, arrivals, environment)


def measure(count: int, rate: float) -> dict[str, Any]:
    """Return lateness of each wire, and the bridge's memory and processor time."""
    with ExitStack() as stack:
        bridge = connected(stack)
        runs, arrivals, every = bridge.runs, bridge.arrivals, bridge.wires
        write_parts(runs, 2, 1.0, day=1)  # the first ones load what later ones use
        wait_for(arrivals, 2, every)
        before_mb, before_s = memory_mb(bridge.pid), cpu_s(bridge.pid)
        finished, in_between_mb = {}, []
        for quarter in range(4):
            finished |= write_parts(runs, count // 4, rate, day=2 + quarter)
            in_between_mb.append(round(memory_mb(bridge.pid), 1))
        count = len(finished)
        wait_for(arrivals, 2 + count, every)
        late: dict[str, Any] = {}
        for wire in every:
            had = arrivals.at.get(wire, {})
            seconds = [had[key] - at for key, at in finished.items() if key in had]
            late[wire] = {
                "arrived": len(seconds),
                "p50_s": round(float(np.percentile(seconds, 50)), 3),
                "p95_s": round(float(np.percentile(seconds, 95)), 3),
                "longest_s": round(max(seconds), 3),
            }
        return {
            "parts": count,
            "wires": late,
            "memory_mb": round(memory_mb(bridge.pid), 1),
            "memory_mb_after_quarters": [round(before_mb, 1), *in_between_mb],
            "cpu_s_a_part": round((cpu_s(bridge.pid) - before_s) / count, 3),
        }


def wait_for(arrivals: Arrivals, count: int, wires: tuple[str, ...]) -> None:
    """Wait until each wire has brought so many results, within a time."""
    end_s = time.monotonic() + LAST_WALL_S
    while time.monotonic() < end_s:
        if all(len(arrivals.at.get(wire, {})) >= count for wire in wires):
            return
        time.sleep(0.05)


def main() -> int:
    parser = Arguments(__doc__, parts=20, rate=1.0)
    parser.add_argument("--parts", type=int, default=200, help="parts of the journal")
    parser.add_argument("--rate", type=float, default=0.33, help="parts a second")
    args = parser.parse_args()
    found = measure(args.parts, args.rate)
    wires = [{"wire": name, **figures} for name, figures in found["wires"].items()]
    figures = {key: value for key, value in found.items() if key != "wires"}
    show(args, wires, figures)
    is_whole = all(one["arrived"] == found["parts"] for one in wires)
    is_soon = all(one["p95_s"] <= ASKED_S for one in wires)
    return 0 if is_whole and is_soon and found["memory_mb"] <= ASKED_MB else 1


if __name__ == "__main__":
    sys.exit(main())
