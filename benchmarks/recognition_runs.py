"""Runs of a recogniser as its users run it: a process of its own, JSON lines out, and its costs.

Also where its camera comes from: a file given, or the board pictures beside the others, by
`cellctl calibrate camera`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from bench import ROOT
from known_parts import cad_files

CELLCTL = (sys.executable, "-m", "controller.cli")
TIMEOUT_S = 3600.0


@dataclass(frozen=True, eq=False, slots=True)
class Run:
    """What one process answered, and what it took.

    Attributes
    ----------
    lines : the answers, as printed
    peak_mb : largest resident memory
    error : what it said if it ended with an exit code that is no answer, else ""
    """

    lines: list[dict[str, Any]]
    peak_mb: float
    error: str = ""


def run(command: Sequence[str], *, one_core: bool, checkout: Path = ROOT) -> Run:
    """Run a command that prints answers, and return them with what they took.

    Parameters
    ----------
    one_core : the process may use one core only, the last of those there are
    checkout : whose code is run
    """
    before: Callable[[], None] | None = None
    if one_core:
        core = max(os.sched_getaffinity(0))

        def before() -> None:
            os.sched_setaffinity(0, {core})

    with tempfile.TemporaryFile("w+") as complaints:
        process = subprocess.Popen(
            list(command),
            cwd=checkout,
            env=os.environ | {"PYTHONPATH": str(checkout)},
            stdout=subprocess.PIPE,
            stderr=complaints,
            text=True,
            preexec_fn=before,
        )
        watch = threading.Timer(TIMEOUT_S, process.kill)
        watch.start()
        try:
            assert process.stdout is not None
            lines = [body for line in process.stdout if (body := _answer(line)) is not None]
            process.stdout.close()
            # wait4 tells this child's memory alone, getrusage that of the largest one so far
            _, status, usage = os.wait4(process.pid, 0)
        finally:
            watch.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        complaints.seek(0)
        said = complaints.read().strip()
    error = "" if process.returncode in (0, 1) else f"exit {process.returncode}: {said[-2000:]}"
    if process.returncode == 1 and not lines and said:
        error = f"exit 1 without an answer: {said[-2000:]}"
    return Run(lines, usage.ru_maxrss / 1024, error)


def _answer(line: str) -> dict[str, Any] | None:
    try:
        body = json.loads(line)
    except ValueError:
        return None
    return body if isinstance(body, dict) and "image" in body else None


def recognise_command(
    images: Sequence[Path], parts: Sequence[Path], calibration: Path, lighting: str
) -> list[str]:
    """Return the public command for pictures of one light."""
    return [
        *CELLCTL,
        "recognise",
        *map(str, images),
        *(word for path in parts for word in ("--parts", str(path))),
        *("--calibration", str(calibration), "--lighting", lighting, "--json"),
    ]


def stable_poses(parts: Sequence[Path], checkout: Path = ROOT) -> dict[str, list[np.ndarray]]:
    """Return the orientations of the parts' stable poses, as `cellctl compile` numbers them."""
    files = cad_files(parts).values()
    said = subprocess.run(
        [*CELLCTL, "compile", *map(str, files), "--json"],
        cwd=checkout,
        capture_output=True,
        text=True,
        check=False,
    )
    bodies = [json.loads(line) for line in said.stdout.splitlines()]
    return {b["part"]: [np.array(p["R"]) for p in b["stable_poses"]] for b in bodies}


def calibrate(folder: Path, into: Path) -> dict[str, tuple[Path, str]]:
    """Return the calibration files of a folder's board pictures and how they were made.

    Parameters
    ----------
    folder : holds calib.json, the boards, and perhaps the small ones, named lo_...
    into : where the files go

    Returns
    -------
    "hi" and, where there are small pictures, "lo"
    """
    board = json.loads((folder / "calib.json").read_text())
    made: dict[str, tuple[Path, str]] = {}
    for name, prefix in (("hi", ""), ("lo", "lo_")):
        target = {**board, "images": [dict(e, image=prefix + e["image"]) for e in board["images"]]}
        target["world"] = dict(board["world"], image=prefix + board["world"]["image"])
        images = [folder / entry["image"] for entry in target["images"]]
        if not all(image.is_file() for image in images):
            continue
        told, result = into / f"{name}_target.json", into / f"{name}.json"
        told.write_text(json.dumps(target))
        command = [*CELLCTL, "calibrate", "camera", *map(str, images)]
        command += ["--target", str(told), "-o", str(result)]
        said = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        if said.returncode == 0 and result.is_file():
            made[name] = (result, "cellctl calibrate camera")
        elif name == "hi":
            raise SystemExit(f"{folder}: {said.stderr.strip()}")
        else:
            made[name] = smaller(*made["hi"], result)
    return made


def smaller(large: Path, how: str, result: Path) -> tuple[Path, str]:
    """Write the camera of the 256 x 256 pictures, whose pixels are 5 x 4 of the large ones'."""
    body = json.loads(large.read_text())
    # u_lo = (u + 0.5) / 5 - 0.5, v_lo = (v + 0.5) / 4 - 0.5
    shrink = np.array([[1 / 5, 0, 0.5 / 5 - 0.5], [0, 1 / 4, 0.5 / 4 - 0.5], [0, 0, 1]])
    K = shrink @ np.array(body["K"])
    body |= {"size_px": [256, 256], "K": K.tolist()}
    result.write_text(json.dumps(body))
    return result, f"that of the large pictures ({how})"


def from_truth(truth: dict[str, Any], result: Path) -> tuple[Path, str]:
    """Write the camera that a set without boards was made with."""
    camera = truth["camera"]
    T_cam_world = np.eye(4)
    T_cam_world[:3, :3], T_cam_world[:3, 3] = camera["R_wc"], camera["t_wc"]
    body = {
        "size_px": [camera["width"], camera["height"]],
        "K": camera["K"],
        "distortion": camera["dist"],
        "T_world_cam": np.linalg.inv(T_cam_world).tolist(),
    }
    result.write_text(json.dumps(body))
    return result, "THE TRUE CAMERA: this set has no boards"
