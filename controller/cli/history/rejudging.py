"""`cellctl rejudge`: the parts of an archive judged anew, and which of them turned."""

import csv
import io
import json
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from controller.catalogue import Jobs, PoolLostError, jobs_among, open_pool, results_of
from controller.config import ConfigError
from controller.history import Filters, recipes_in
from controller.history.rejudging import (
    NOT_JUDGED,
    Archive,
    PartTurn,
    Rejudged,
    compared,
    counts,
    judging_by_recipe,
    keep,
    parts_left,
    rejudge,
)
from controller.results.exports import csv_cell
from controller.results.pages import whole_file
from controller.results.wording import count_of, span

from ..inputs.ahead import told_of_workers
from ..inputs.checks import check_writable_folder, writing
from ..inputs.history_store import filled_store, period
from ..terminal.output import emit, print_line, warn, write_error_line
from .arguments import RejudgeOptions
from .tables import print_columns

EVERY_S = 10.0  # between lines of progress
NAMED_COUNT = 10  # parts not judged that are named one by one; the CSV file has all
SHOWN_COUNT = 200  # turned parts that the terminal gets; the CSV file has all
COLUMNS = ("run", "number", "serial", "lot", "was", "now", "turned", "why", "lines_sha256")


@dataclass(eq=False, slots=True)
class _Progress:
    """How far it is, on stderr from time to time."""

    whole: int
    left: int
    as_json: bool
    done: int = 0
    _began_s: float = field(default_factory=time.monotonic)
    _said_s: float = field(default_factory=time.monotonic)

    def add(self, count: int) -> None:
        self.done += count
        now_s = time.monotonic()
        if now_s - self._said_s < EVERY_S or not self.done:
            return
        self._said_s = now_s
        at = self.whole - self.left + self.done
        rest_s = (now_s - self._began_s) / self.done * (self.left - self.done)
        if self.as_json:
            body = {"event": "progress", "done": at, "parts": self.whole, "left_s": round(rest_s)}
            write_error_line(json.dumps(body))
        else:
            write_error_line(f"{at} of {count_of(self.whole, 'part')}, about {span(rest_s)} left")


def rejudge_archive(options: RejudgeOptions) -> int:
    """Judge the parts of an archive anew and print those that turned.

    Returns
    -------
    exit code: 0 where every part was judged, else 1

    Raises
    ------
    ConfigError : an option or the recipe is wrong, or no such part is there
    HistoryError : store or journal cannot be read, or the store not be written
    """
    output = options.output
    jobs = jobs_among(options.jobs)
    if output is not None:
        if output.suffix.lower() != ".csv" or output.is_dir():
            raise ConfigError(f"-o {output}: name a file that ends in .csv")
        check_writable_folder(output.parent, "-o in")
    since, until = period(options.since, options.until)
    filters = Filters(lot=options.lot, since=since, until=until)
    judging = judging_by_recipe(options.recipe)
    with filled_store(options.runs_dir, options.store_url) as store:
        archive = Archive(store, options.runs_dir, judging, filters)
        whole, kept, others = counts(archive)
        if others:
            warn(
                f"{count_of(others, 'part')} of runs in other folders are left out; name theirs "
                "with --runs"
            )
        if not whole:
            known = ", ".join(recipes_in(store)) or "no recipe"
            raise ConfigError(
                f"no judged part of {judging.recipe.name} fits; the store has parts of: {known}"
            )
        if kept:
            warn(f"judged so already: {kept} of {count_of(whole, 'part')}")
        progress = _Progress(whole, whole - kept, options.as_json)
        problems: dict[int, str] = {}
        try:
            _judge(archive, jobs, problems, progress)
        except PoolLostError as error:
            warn(
                f"cellctl: {error}; {kept + progress.done - len(problems)} of "
                f"{count_of(whole, 'part')} are judged and kept: the same command goes on from "
                "there"
            )
            return 1
        turns = list(compared(archive, problems))
    if output is not None:
        with writing("-o", output):
            _write(turns, output)
    _print(turns, output, as_json=options.as_json)
    return 1 if problems else 0


def _judge(archive: Archive, jobs: Jobs, problems: dict[int, str], progress: _Progress) -> None:
    """Judge what is not judged yet, and keep each result as it comes."""
    if not progress.left:
        return
    with open_pool(jobs, told_of_workers) as pool:
        for part, found in results_of(pool, rejudge, parts_left(archive)):
            if isinstance(found, Rejudged) and not found.problem:
                keep(archive, [(part, found)])
            elif isinstance(found, Rejudged):
                problems[part.part_id] = found.problem
            else:
                problems[part.part_id] = f"{type(found).__name__}: {found}"
            progress.add(1)


def _print(turns: Sequence[PartTurn], output: Path | None, *, as_json: bool) -> None:
    turned = [one for one in turns if one.is_turned]
    without = [one for one in turns if one.now == NOT_JUDGED]
    ways = Counter((one.was, one.now) for one in turned)
    if as_json:
        for one in (*turned, *without):
            emit({"event": "turned" if one.is_turned else "not_judged", **asdict(one)})
        emit(
            {
                "event": "rejudged",
                "parts": len(turns),
                "turned": {f"{was} -> {now}": n for (was, now), n in sorted(ways.items())},
                "not_judged": len(without),
            }
        )
    else:
        if turned:
            print_columns(
                ("serial", "part", "was", "now", "why"),
                (
                    (one.serial, f"{one.run}/{one.number}", one.was, one.now, one.why)
                    for one in turned[:SHOWN_COUNT]
                ),
            )
        if len(turned) > SHOWN_COUNT:
            print_line(f"and {len(turned) - SHOWN_COUNT} more (-o FILE has all)")
        words = ", ".join(f"{n} {was} -> {now}" for (was, now), n in sorted(ways.items()))
        print_line(
            f"{count_of(len(turns), 'part')}: {len(turned)} turned{f' ({words})' if words else ''}"
        )
        if output is not None:
            print_line(f"written: {output}")
    for one in without[:NAMED_COUNT] if not as_json else ():
        warn(f"{one.run}/{one.number} is not judged: {one.why}")
    if len(without) > NAMED_COUNT and not as_json:
        warn(f"and {len(without) - NAMED_COUNT} more are not judged (-o FILE has all)")


def _write(turns: Sequence[PartTurn], output: Path) -> None:
    with whole_file(output) as file:
        # marked, so that Excel reads it as UTF-8
        text = io.TextIOWrapper(file, encoding="utf-8-sig", newline="", write_through=True)
        writer = csv.writer(text)
        writer.writerow(COLUMNS)
        for one in turns:
            row = {**asdict(one), "turned": "yes" if one.is_turned else "no"}
            writer.writerow([csv_cell(row[name]) for name in COLUMNS])
        text.detach()
