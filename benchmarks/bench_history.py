"""How long the history takes: questions of a store of many parts, and filling it from a journal.

    python benchmarks/bench_history.py [--parts N] [--filled N] [--url URL] [--json]

The store gets parts as a cell makes them (runs of 100, twelve characteristics, eighteen steps; 5 %
fail with a finding on one or two faces, 3 % had a recovery), written straight into its tables. Each
question is asked five times in this process; the median counts. Filling is measured by a journal of
its own, with rows as long as those of a run, by the seconds that a part takes. With --url the store
is a database server's, whose tables of cellctl are made anew.
"""

import random
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from bench import Arguments, show
from sqlalchemy import Connection

from controller.cell.journal import JOURNAL_NAME, Journal, rows
from controller.history import (
    Filters,
    Store,
    figures,
    fill,
    find_parts,
    list_parts,
    open_store,
    recipes_in,
    values_of,
)
from controller.history.exporting import export
from controller.history.reviewing import agreement
from controller.history.rows_of import part_id
from controller.history.tables import (
    CHARACTERISTICS,
    FINDING_FACES,
    FINDINGS,
    JOURNALS,
    MEASUREMENTS,
    METADATA,
    PARTS,
    PICTURES,
    RECOVERIES,
    RUNS,
    STEPS,
)

RUN_PARTS = 100
VALUES = 12  # characteristics of a part
STEPS_COUNT = 18
PICTURES_COUNT = 30
CELLS = 10
RECIPES = ("featuretype", "flange_xy", "holder", "widget")
BEGIN = datetime(2026, 1, 5, 6)  # noqa: DTZ001 - UTC, as the store has it
REPEATS = 5
VIEWS = 14
OUTLINE = tuple((400 + i, 300 + i // 2) for i in range(250))


def part_of(rng: random.Random, run_no: int, number: int, at: datetime) -> dict[str, Any]:
    recipe = RECIPES[run_no % len(RECIPES)]
    verdict = rng.choices(("pass", "fail", "indeterminate", "no verdict"), (92, 5, 2, 1))[0]
    took_s = rng.gauss(64.0, 5.0)
    decided = "accept" if number % 4 == 1 else "reject"
    return {
        "part_id": part_id(run_no, number), "run_no": run_no, "number": number, "recipe": recipe,
        "serial": f"{recipe[:2].upper()}{run_no:05d}{number:03d}", "lot": f"L{run_no // 5}",
        "operator": ("Ann", "Bob", "Cem")[run_no % 3], "verdict": verdict, "reason": "as found",
        "tray": "accept" if verdict == "pass" else "reject", "custody": "placed", "start": at,
        "end": at + timedelta(seconds=took_s), "day": at.date().isoformat(), "wall_s": took_s,
        "forecast_s": 62.0, "done_forecast_s": 60.0, "done_actual_s": took_s,
        "compared_fraction": 0.97, "looks": 1, "recovery_count": int(rng.random() < 0.03),
        "finding_count": int(verdict == "fail"), "is_emulated": False, "is_open": False,
        "read_seq": 1, "nest": None,
        "awaits_review": verdict == "indeterminate" and number % 2 == 0,
        "review": decided if verdict in ("fail", "indeterminate") and number % 2 else "",
    }  # fmt: skip


def made(parts: int) -> Iterator[tuple[dict[str, Any], list[dict[str, Any]]]]:
    """Yield each run and its parts."""
    rng = random.Random(16)
    for run_no in range(1, parts // RUN_PARTS + 1):
        at = BEGIN + timedelta(hours=2 * run_no)
        found = [
            part_of(rng, run_no, k + 1, at + timedelta(seconds=70 * k)) for k in range(RUN_PARTS)
        ]
        first = found[0]
        run = {
            "run_no": run_no, "run_id": f"{at:%Y%m%d-%H%M%S}-000-{first['recipe']}",
            "journal_no": 1, "recipe": first["recipe"], "cell": f"cell-{run_no % CELLS}",
            "lot": first["lot"],
            "operator": first["operator"], "recipe_sha256": "0" * 64, "cad_sha256": "0" * 64,
            "ordered": RUN_PARTS, "speed": 1.0, "is_dry": False, "is_emulated": False,
            "start": at, "end": found[-1]["end"], "wall_s": 7000.0, "outcome": "complete",
            "message": "", "read_seq": 1,
        }  # fmt: skip
        yield run, found


def stock(store: Store, parts: int) -> None:
    """Write parts straight into the tables."""
    rng = random.Random(17)
    with store.writing() as db:
        key = {"journal_no": 1, "key": "bench", "file": "none", "last_seq": 0, "last_hash": ""}
        db.execute(JOURNALS.insert(), [key])
        for r, recipe in enumerate(RECIPES):
            db.execute(
                CHARACTERISTICS.insert(),
                [
                    {
                        "characteristic_no": r * VALUES + i + 1, "key": f"{recipe}{i}",
                        "recipe": recipe, "id": f"d{i}", "balloon": i + 1, "label": f"bore {i}",
                        "kind": "diameter", "unit": "mm", "nominal": 8.0, "lower": 7.9,
                        "upper": 8.1, "source": "recipe", "is_critical": False,
                    }
                    for i in range(VALUES)
                ],
            )  # fmt: skip
        for run, found in made(parts):
            db.execute(RUNS.insert(), [run])
            db.execute(PARTS.insert(), found)
            first = RECIPES.index(run["recipe"]) * VALUES
            ids = [one["part_id"] for one in found]
            db.execute(
                MEASUREMENTS.insert(),
                [
                    {
                        "part_id": key, "ordinal": i + 1, "characteristic_no": first + i + 1,
                        "measured": rng.gauss(8.0, 0.02), "U": 0.02, "verdict": "pass",
                        "reason": "",
                    }
                    for key in ids
                    for i in range(VALUES)
                ],
            )  # fmt: skip
            db.execute(
                STEPS.insert(),
                [
                    {
                        "part_id": key, "ordinal": i + 1, "label": "show with grasp G1",
                        "view": f"G1-V{i}", "forecast_s": 3.5, "actual_s": 3.6,
                    }
                    for key in ids
                    for i in range(STEPS_COUNT)
                ],
            )  # fmt: skip
            db.execute(
                PICTURES.insert(),
                [
                    {
                        "part_id": key, "ordinal": i + 1, "view": f"G1-V{i // 2}",
                        "lamp": "backlit", "sha256": f"{rng.getrandbits(256):064x}",
                        "file": f"pictures/part{key % 1000:03d}_G1-V{i // 2}_station_side.png",
                    }
                    for key in ids
                    for i in range(PICTURES_COUNT)
                ],
            )  # fmt: skip
            for one in found:
                hang_on(db, rng, one)


def hang_on(db: Connection, rng: random.Random, part: dict[str, Any]) -> None:
    """Write what hangs on a part that failed, or had a recovery."""
    key = part["part_id"]
    if part["finding_count"]:
        word = rng.choice(("real", "false_alarm", "")) if part["review"] else ""
        kind = rng.choice(("missing material", "surplus material", "surface differs"))
        db.execute(
            FINDINGS.insert(),
            [{"part_id": key, "ordinal": 1, "kind": kind, "view": "G1-V0", "lamp": "backlit",
              "size_mm": 2.0, "area_mm2": 3.0, "x_mm": 1.0, "y_mm": 2.0, "z_mm": 3.0,
              "verdict": "fail", "review": word}],
        )  # fmt: skip
        faces = rng.sample(range(40), rng.choice((1, 2)))
        db.execute(
            FINDING_FACES.insert(),
            [
                {"part_id": key, "ordinal": i, "finding": 1, "face": f, "label": f"F{f} plane"}
                for i, f in enumerate(faces, 1)
            ],
        )
    if part["recovery_count"]:
        db.execute(
            RECOVERIES.insert(),
            [{"part_id": key, "ordinal": 1, "at": part["start"], "fault": "grip_missed",
              "action": "look_again", "reason": "jaws closed on nothing", "custody": "",
              "alarm": 301}],
        )  # fmt: skip


def median_ms(asked: Callable[[], object]) -> float:
    asked()
    times = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        asked()
        times.append(1000 * (time.perf_counter() - began))
    return statistics.median(times)


def questions(store: Store, parts: int) -> dict[str, float]:
    """Return the median of each question [ms]."""
    march = BEGIN + timedelta(hours=2 * (parts // RUN_PARTS) // 2)
    middle = parts // RUN_PARTS // 2
    recipe = RECIPES[middle % len(RECIPES)]
    serial = f"{recipe[:2].upper()}{middle:05d}050"
    return {
        "list, newest 50": median_ms(lambda: list_parts(store, Filters(), 50)),
        "list, recipe and verdict": median_ms(
            lambda: list_parts(store, Filters(recipe="holder", verdict="fail"), 50)
        ),
        "list, a lot": median_ms(lambda: list_parts(store, Filters(lot="L7"), 50)),
        "list, operator, second half": median_ms(
            lambda: list_parts(store, Filters(operator="Ann", since=march), 50)
        ),
        "list, a cell": median_ms(lambda: list_parts(store, Filters(cell="cell-3"), 50)),
        "list, what awaits a person": median_ms(
            lambda: list_parts(store, Filters(review="awaiting"), 50)
        ),
        "list, its last page": median_ms(
            lambda: list_parts(store, Filters(), 50, skipped=parts - 50)
        ),
        "list, by seconds": median_ms(lambda: list_parts(store, Filters(), 50, sort="seconds")),
        "list, a recipe, by serial number": median_ms(
            lambda: list_parts(store, Filters(recipe="holder"), 50, sort="serial", is_rising=True)
        ),
        "recipes there are": median_ms(lambda: recipes_in(store)),
        "values of 400 parts": median_ms(lambda: values_of(store, Filters(), "holder", "d3", 400)),
        "agreement of persons": median_ms(lambda: agreement(store, Filters())),
        "one part in full": median_ms(lambda: find_parts(store, serial)),
        "figures of a day, by run": median_ms(
            lambda: figures(store, Filters(since=march, until=march + timedelta(days=1)), "run")
        ),
        "figures of a recipe, by day": median_ms(
            lambda: figures(store, Filters(recipe="holder"), "day")
        ),
        "figures of all, by cell": median_ms(lambda: figures(store, Filters(), "cell")),
        "figures of all, by recipe": median_ms(lambda: figures(store, Filters(), "recipe")),
    }


def journal_of(path: Path, parts: int) -> int:
    """Write a journal of one run with rows as long as a run's; return its bytes."""
    journal = Journal(path, "20260105-060000-000-bench")
    db = journal._db
    db.execute("PRAGMA synchronous = OFF")
    journal.write(rows.RunBegan(recipe={"name": "bench"}, cell={"name": "bench"}, count=parts))
    for k in range(1, parts + 1):
        labels = tuple(f"show with grasp G1, view {v}" for v in range(VIEWS))
        journal.write(
            rows.PlanMade(
                steps=(*labels, "park"), seconds=(3.5,) * (VIEWS + 1), forecast_s=62.0,
                covered_fraction=0.97, reachable_fraction=0.99,
            ),
            k,
        )  # fmt: skip
        for v, label in enumerate(labels):
            path_rows = ((0.1,) * 6,) * 2
            for _ in range(4):
                journal.write(rows.PathBegun(waypoints=path_rows), k)
                journal.write(rows.PathEnded(), k)
            journal.write(
                rows.ViewPicturesTaken(view=f"V{v}", pictures={"backlit": "p.png"}, q=(0.0,) * 6), k
            )
            journal.write(rows.StepDone(label=label, forecast_s=3.5, seconds=3.6, view=f"V{v}"), k)
            journal.write(rows.ViewJudged(view=f"V{v}", evaluated=True, outline_px=OUTLINE), k)
        values = tuple(
            rows.CharacteristicFields(
                id=f"d{i}", balloon=i, kind="diameter", label=f"bore {i}", nominal=8.0, lower=7.9,
                upper=8.1, source="recipe", measured=8.01, U=0.02, verdict="pass",
            )
            for i in range(VALUES)
        )  # fmt: skip
        journal.write(rows.PartMeasured(characteristics=values), k)
        faces = tuple(
            rows.FaceJudged(
                face=f, label=f"F{f} plane", area_mm2=100.0, compared_fraction=0.9, verdict="pass",
                views=("V0",), reason="",
            )
            for f in range(40)
        )  # fmt: skip
        journal.write(
            rows.PartJudged(verdict="pass", reasons=("",), compared_fraction=0.97, faces=faces), k
        )
        journal.write(rows.CustodyChanged(name="placed", detail="accept"), k)
        journal.write(rows.PartDone(tray="accept"), k)
    journal.write(rows.AtRest(state="complete"))
    journal.write(rows.RunEnded(end="complete", parts=parts))
    journal.close()
    return path.stat().st_size


def filling(folder: Path, parts: int, url: str | None) -> dict[str, float]:
    runs = folder / "runs"
    runs.mkdir()
    size = journal_of(runs / JOURNAL_NAME, parts)
    store = open_store(url or f"sqlite:///{folder}/filled.sqlite")
    began, cpu = time.perf_counter(), time.process_time()
    count = fill(store, runs).part_count
    took, cpu = time.perf_counter() - began, time.process_time() - cpu
    assert count == parts
    began = time.perf_counter()
    fill(store, runs)
    again = time.perf_counter() - began
    store.close()
    return {
        "journal, kB a part": size / 1000 / parts,
        "fill, ms a part": 1000 * took / parts,
        "fill, CPU ms a part": 1000 * cpu / parts,
        "nothing new, ms": 1000 * again,
    }


def emptied(url: str) -> Store:
    store = open_store(url)
    METADATA.drop_all(store.engine)
    store.close()
    return open_store(url)


def main() -> int:
    parser = Arguments(__doc__, parts=2_000, filled=10)
    parser.add_argument("--parts", type=int, default=100_000)
    parser.add_argument("--filled", type=int, default=200)
    parser.add_argument("--url")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        store = emptied(args.url or f"sqlite:///{folder}/history.sqlite")
        began = time.perf_counter()
        stock(store, args.parts)
        stocked_s = time.perf_counter() - began
        asked = questions(store, args.parts)
        began = time.perf_counter()
        exported = export(store, Filters(recipe="holder"), folder / "holder.csv", folder)
        asked[f"export {exported:,} rows as CSV"] = 1000 * (time.perf_counter() - began)
        size = store.file.stat().st_size / 1e6 if store.file else None
        store.close()
        if args.url:
            emptied(args.url).close()
        filled = filling(folder, args.filled, args.url)
    rows = [{"question": what, "ms": ms} for what, ms in asked.items()]
    show(args, rows, {"parts": args.parts, "store MB": size, "stocked s": stocked_s, **filled})
    return 0


if __name__ == "__main__":
    sys.exit(main())
