"""What the command said of many specimens, counted: verdicts, places found, what stood in the way.

Shared by the benches that judge stored pictures again, with a twist (bench_twisted.py) or a trap
(bench_traps.py). Nothing of the room is imported.
"""

from __future__ import annotations

import json
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

from inspection_truth import Judged, judged, lower_limit, upper_limit

Words = dict[str, Any]
Item = TypeVar("Item")
FINDING = re.compile(r" v\d+ \S+ [0-9.]+ mm$")
UNCOVERED = re.compile(r": \d+ % compared, \d+ % is required\b")


@dataclass(frozen=True)
class Outcome:
    """One judgement.

    Attributes
    ----------
    specimen, part : folder and specimen; its part
    kind : of the twist or the trap; `unchanged` of the good set itself
    seed, name : with which it can be made again; a word on what was drawn
    verdict : pass, fail, indeterminate or error
    is_shown : a view shows the defect
    is_found : something at its place was failed
    is_hinted : something at its place was failed or left open
    only_uncovered : PASS, but for faces of which too little was compared
    failed, opened : what was failed, and left open, in the command's words
    reasons : of the verdict
    seconds : a view
    message : of an error
    """

    specimen: str
    part: str
    kind: str
    seed: int
    name: str
    verdict: str
    is_shown: bool
    is_found: bool
    is_hinted: bool
    only_uncovered: bool
    failed: tuple[str, ...]
    opened: tuple[str, ...]
    reasons: tuple[str, ...]
    seconds: float
    message: str = ""


def outcome(
    truth: Words, kind: str, seed: int, name: str, lines: Sequence[Words], message: str
) -> Outcome:
    """Return what the command's lines say of a specimen.

    Parameters
    ----------
    truth : of the specimen, as judged here
    kind, seed, name : of the twist or the trap
    lines, message : of the command
    """
    j: Judged = judged(truth, lines, len(truth["poses"]), message)
    ends = [line for line in lines if line["event"] == "verdict"]
    return Outcome(
        specimen=truth["specimen"],
        part=truth["part"],
        kind=kind,
        seed=seed,
        name=name,
        verdict=j.verdict,
        is_shown=j.is_shown,
        is_found=j.is_found,
        is_hinted=j.is_hinted,
        only_uncovered=bool(ends) and is_only_uncovered(ends[-1], lines),
        failed=tuple(_called(line) for line in lines if _is(line, "fail")),
        opened=tuple(_called(line) for line in lines if _is(line, "indeterminate")),
        reasons=tuple(ends[-1]["reasons"]) if ends else (),
        seconds=j.seconds,
        message=message,
    )


def is_only_uncovered(verdict: Words, lines: Iterable[Words]) -> bool:
    """Whether nothing but faces that were compared too little stands in the way of a PASS.

    No finding, no characteristic failed or left open that counts, and each reason of the verdict is
    a face of which too little was compared. A PASS counts, too.

    Parameters
    ----------
    verdict : the command's last line
    lines : all its lines
    """
    if verdict["verdict"] == "pass":
        return True
    if verdict["verdict"] != "indeterminate" or not verdict["reasons"]:
        return False
    speaks = any(line["event"] == "finding" or _is(line, "fail") for line in lines)
    return not speaks and all(UNCOVERED.search(reason) for reason in verdict["reasons"])


def _is(line: Words, verdict: str) -> bool:
    return line["event"] != "verdict" and line.get("verdict") == verdict


def _called(line: Words) -> str:
    if line["event"] == "characteristic":
        value = line.get("measured_mm")
        return f"{line['id']} = {value:.3f}" if value is not None else str(line["id"])
    if line["event"] == "face":
        return f"face {line['face']}"
    return f"{line['kind']} {line['view']} {line['lamp']} {line['size_mm']:.1f} mm"


def run_all(
    work: Callable[[Item], Outcome], items: Iterable[Item], jobs: int, out: Path | None, quiet: bool
) -> list[Outcome]:
    """Return all outcomes; each is printed, and added to a file, as it comes.

    Parameters
    ----------
    work, items : what is to be judged, and how
    jobs : at once
    out : a file of JSON lines
    quiet : print nothing
    """
    done = []
    for o in _ahead(work, items, jobs):
        done.append(o)
        if out:
            with out.open("a") as file:
                file.write(json.dumps(asdict(o)) + "\n")
        if not quiet:
            print(line_of(o), flush=True)
    return done


def _ahead(work: Callable[[Item], Outcome], items: Iterable[Item], jobs: int) -> Iterator[Outcome]:
    """Yield outcomes in turn; items are drawn no further ahead than there are jobs."""
    with ThreadPoolExecutor(jobs) as pool:
        waiting: deque[Future[Outcome]] = deque()
        for item in items:
            waiting.append(pool.submit(work, item))
            if len(waiting) > jobs:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def read_outcomes(paths: Iterable[Path]) -> Iterator[Outcome]:
    """Yield the outcomes of files that `run_all` wrote; of two of the same the later counts."""
    found: dict[tuple[str, str, int], Outcome] = {}
    for path in paths:
        for text in path.read_text().splitlines():
            words = json.loads(text)
            for key in ("failed", "opened", "reasons"):
                words[key] = tuple(words[key])
            o = Outcome(**words)
            found[(o.specimen, o.kind, o.seed)] = o
    yield from found.values()


def line_of(o: Outcome) -> str:
    what = f"{o.specimen:6} {o.part:14} {o.kind:18} {o.seed:4d} {o.verdict:14}"
    notes = []
    if o.only_uncovered and o.verdict != "pass":
        notes.append("only uncovered faces stop a PASS")
    if o.is_found:
        notes.append("found")
    elif o.is_hinted:
        notes.append("hinted")
    if not o.is_shown:
        notes.append("in no view")
    if o.failed:
        notes.append("failed: " + ", ".join(o.failed[:2]))
    return f"{what} {o.seconds:5.2f} s/view  {o.name}  {'; '.join(notes)} {o.message}".rstrip()


def is_alike(o: Outcome, control: Outcome | None) -> bool:
    """Whether nothing tells a specimen from the good one of the same pictures.

    PASS; or no finding, nothing failed, and no more reasons against a PASS than the good one has:
    once what keeps good parts open is mended, it passes.
    """
    if o.verdict == "pass" or control is None:
        return o.verdict == "pass"
    has_finding = any(FINDING.search(name) for name in o.opened)
    is_open = o.verdict == "indeterminate" and not o.failed and not has_finding
    return is_open and len(o.reasons) <= len(control.reasons)


def counts(mine: Sequence[Outcome], controls: Mapping[str, Outcome]) -> Words:
    """Return how often each verdict was given, and what else is known.

    Parameters
    ----------
    mine : outcomes
    controls : of the good ones, by specimen
    """
    out: Words = {"n": len(mine)}
    out |= {
        v: sum(o.verdict == v for o in mine) for v in ("pass", "fail", "indeterminate", "error")
    }
    out["only_uncovered"] = sum(o.only_uncovered for o in mine)
    out["alike"] = sum(is_alike(o, controls.get(o.specimen)) for o in mine)
    out["found"] = sum(o.is_found for o in mine)
    out["silent"] = sum(not o.is_hinted and o.verdict != "fail" for o in mine)
    for key in ("pass", "fail", "alike"):
        out[f"{key}_below"] = upper_limit(out[key], len(mine)) if mine else 1.0
    out["found_above"] = lower_limit(out["found"], len(mine)) if mine else 0.0
    return out


def by_kind(done: Sequence[Outcome], control: str, *, shown: bool = True) -> dict[str, Words]:
    """Return counts of each kind, of what a view shows or of what none does.

    Parameters
    ----------
    done : all outcomes
    control : the kind of the good ones
    shown : which of them
    """
    controls = {o.specimen: o for o in done if o.kind == control}
    kinds = dict.fromkeys(o.kind for o in done)
    rows = {k: [o for o in done if o.kind == k and o.is_shown is shown] for k in kinds}
    return {k: counts(mine, controls) for k, mine in rows.items() if mine}


def print_counts(rows: dict[str, Words], title: str) -> None:
    print(f"\n{title}\n{'':26}{'n':>5}{'PASS':>6}{'<':>6}{'alike':>7}{'<':>6}{'would':>7}{'FAIL':>6}"
          f"{'OPEN':>6}{'error':>6}{'found':>7}{'>':>6}{'silent':>8}")  # fmt: skip
    for name, c in rows.items():
        print(f"{name:26}{c['n']:5d}{c['pass']:6d}{c['pass_below']:6.0%}{c['alike']:7d}"
              f"{c['alike_below']:6.0%}{c['only_uncovered']:7d}{c['fail']:6d}"
              f"{c['indeterminate']:6d}{c['error']:6d}{c['found']:7d}{c['found_above']:6.0%}"
              f"{c['silent']:8d}")  # fmt: skip
