"""Many parts at once: the order of the work, processes that end early, and the same answers."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from cad_solids import box, mesh_of, rod

from controller.cad.compiled import CompileOptions
from controller.catalogue import (
    LOCAL,
    Ahead,
    Jobs,
    PartWork,
    PoolLostError,
    TaskPool,
    ahead,
    jobs_among,
    open_pool,
)
from controller.catalogue.tasks import Compiled
from controller.cli import main
from controller.cli.inputs import ahead as working
from controller.config import ConfigError

CELL = Path(__file__).parents[2] / "recipes/cells/emulated.yaml"


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


class AtOnce(Executor):
    """Does what it is given at once, and remembers it; from ``dies_at`` on every worker is dead."""

    def __init__(self, dies_at: int = 10**9) -> None:
        self.done: list[tuple[str, Any]] = []
        self._dies_at = dies_at

    def submit(self, call: Callable[..., Any], /, *args: Any, **_: Any) -> Future[Any]:  # type: ignore[override]
        future: Future[Any] = Future()
        if len(self.done) >= self._dies_at:
            future.set_exception(BrokenProcessPool("a worker was killed"))
            return future
        self.done.append((call.__name__, args))
        future.set_result(call(*args))
        return future


@pytest.fixture
def _no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tasks that only name themselves; a part has four distinct poses."""

    def compile_one(_: PartWork) -> Compiled:
        return Compiled(1.0, distinct=(0, 2, 3, 7))

    def prepare_one(_: PartWork) -> None: ...

    def certify_some(_: PartWork, __: tuple[int, ...]) -> None: ...

    for task in (compile_one, prepare_one, certify_some):
        monkeypatch.setattr(ahead, task.__name__, task)


def works(count: int, cell: Path | None) -> list[PartWork]:
    return [PartWork(Path(f"{n}.stl"), CompileOptions(), cell) for n in range(count)]


@pytest.mark.usefixtures("_no_work")
def test_the_part_that_is_wanted_next_is_finished_first() -> None:
    executor = AtOnce()
    line = Ahead(TaskPool(executor, 2), works(20, CELL))
    assert line.wait_for(0).planned
    begun = {args[0].path for _, args in executor.done}
    assert len(begun) < 10  # of twenty
    for number in range(1, 20):
        assert line.wait_for(number).planned
    certified = [args[0].path for name, args in executor.done if name == "certify_some"]
    assert certified[:18] == [
        Path(f"{n}.stl") for n in range(18)
    ]  # a task each while many are left


@pytest.mark.usefixtures("_no_work")
def test_the_poses_of_a_last_part_are_shared() -> None:
    executor = AtOnce()
    made = Ahead(TaskPool(executor, 3), works(1, CELL)).wait_for(0)
    assert made.planned
    names = [name for name, _ in executor.done]
    assert names == ["compile_one", "prepare_one", *["certify_some"] * 3]
    shares = [args[1] for name, args in executor.done if name == "certify_some"]
    assert sorted(pose for share in shares for pose in share) == [0, 2, 3, 7]


@pytest.mark.usefixtures("_no_work")
def test_without_a_cell_nothing_is_planned() -> None:
    executor = AtOnce()
    made = Ahead(TaskPool(executor, 2), works(1, None)).wait_for(0)
    assert not made.planned
    assert [name for name, _ in executor.done] == ["compile_one"]


@pytest.mark.usefixtures("_no_work")
@pytest.mark.parametrize("dies_at", [0, 1, 4])
def test_processes_that_die_keep_nobody_waiting(dies_at: int) -> None:
    line = Ahead(TaskPool(AtOnce(dies_at), 2), works(5, CELL))
    made = [line.wait_for(number) for number in range(5)]
    assert isinstance(line.failure, PoolLostError)
    assert not made[-1].planned


@pytest.mark.parametrize(
    ("text", "jobs"),
    [
        (None, LOCAL),
        ("1", LOCAL),
        ("7", Jobs(7)),
        ("tcp://host:8786", Jobs(scheduler="tcp://host:8786")),
    ],
)
def test_jobs(text: str | None, jobs: Jobs) -> None:
    assert jobs_among(text) == jobs


def test_all_jobs_are_one_a_core_at_least() -> None:
    assert jobs_among("all").count >= 1


@pytest.mark.parametrize("text", ["0", "-1", "1.5", "", "many", "513", "host:8786", "\u0663"])
def test_what_is_no_number_of_jobs(text: str) -> None:
    with pytest.raises(ConfigError, match="--jobs"):
        jobs_among(text)


def test_a_scheduler_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("controller.catalogue.cluster.CONNECT_S", 0.2)
    with (
        pytest.raises(ConfigError, match="no Dask scheduler answers"),
        open_pool(Jobs(scheduler="tcp://127.0.0.1:1")),
    ):
        pass


@pytest.fixture
def parts(tmp_path: Path) -> list[Path]:
    """Three sound parts, and in their midst one that is no CAD file."""
    files = [tmp_path / f"{name}.stl" for name in ("bored", "broken", "plate", "rod")]
    mesh_of(box(40, 30, 10) - rod(5, 20, 64)).export(files[0])
    files[1].write_text("solid of nothing\n", encoding="ascii")
    mesh_of(box(50, 20, 6)).export(files[2])
    mesh_of(rod(8, 40, 48)).export(files[3])
    return files


def answers(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, list[Any], str]:
    """Return the exit code, what stdout had without what is a matter of time, and stderr."""
    code = main(arguments)
    out, err = capsys.readouterr()
    bodies = [json.loads(line) for line in out.splitlines()]
    kept = [{k: v for k, v in b.items() if k not in ("seconds", "from_cache")} for b in bodies]
    # which stage it was in is a matter of time, too
    lines = [
        line
        for line in err.splitlines()
        if '"event": "progress"' not in line and not line.startswith("cellctl: workers: ")
    ]
    return code, kept, "\n".join(lines)


def test_two_processes_compile_what_one_does(
    parts: list[Path],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    command = ["compile", "--json", *map(str, parts)]
    two = answers([*command, "--jobs", "2"], capsys)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "other"))
    one = answers(command, capsys)
    assert two == one
    assert one[0] == 2
    assert [body["part"] for body in one[1]] == ["bored", "plate", "rod"]
    assert "broken.stl" in one[2]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Jobs]:
    """Who was asked to work ahead; nobody does."""
    found: list[Jobs] = []

    def nobody(jobs: Jobs, _: object) -> Any:
        found.append(jobs)
        return nullcontext()

    monkeypatch.setattr(working, "open_pool", nobody)
    return found


def test_no_process_is_started_for_what_the_cache_has(
    parts: list[Path], capsys: pytest.CaptureFixture[str], asked: list[Jobs]
) -> None:
    sound = [str(parts[0]), str(parts[2])]
    command = ["compile", "--json", "--jobs", "2"]
    assert main(["compile", "--json", sound[0]]) == 0
    assert main([*command, *sound]) == 0  # one of two is there
    capsys.readouterr()
    assert main([*command, *sound]) == 0
    bodies = list(map(json.loads, capsys.readouterr().out.splitlines()))
    assert [body["from_cache"] for body in bodies] == [True, True]
    assert [jobs.is_alone for jobs in asked] == [True, False, True]


def test_interrupted_work_is_gone_on_with(
    parts: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compile", "--json", str(parts[2])]) == 0  # as far as the first time came
    capsys.readouterr()
    main(["compile", "--json", "--jobs", "2", *map(str, parts)])
    kept = {
        b["part"]: b["from_cache"] for b in map(json.loads, capsys.readouterr().out.splitlines())
    }
    assert kept == {"bored": False, "plate": True, "rod": False}


def test_no_jobs_without_a_cache(parts: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compile", "--no-cache", "--jobs", "2", str(parts[0])]) == 2
    assert "--jobs cannot be combined with --no-cache" in capsys.readouterr().err


@pytest.fixture
def scheduler() -> Iterator[str]:
    """The address of a Dask cluster in this process."""
    distributed: Any = import_module("distributed")  # untyped
    with distributed.LocalCluster(
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        dashboard_address=None,
        protocol="tcp://",
        host="127.0.0.1",
    ) as cluster:
        yield cluster.scheduler_address


@pytest.mark.filterwarnings("ignore")  # of Dask's own
def test_dask_compiles_what_one_process_does(
    scheduler: str,
    parts: list[Path],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    command = ["compile", "--json", *map(str, parts)]
    cluster = answers([*command, "--jobs", scheduler], capsys)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "other"))
    alone = answers(command, capsys)
    assert cluster == alone
    assert "broken.stl" in cluster[2]


@pytest.mark.slow
def test_two_processes_certify_what_one_does(
    parts: list[Path],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    command = ["compile", "--json", "--cell", str(CELL), str(parts[0]), str(parts[3])]
    two = answers([*command, "--jobs", "2"], capsys)
    with monkeypatch.context() as patch:  # all of it is there now
        patch.setattr(working, "open_pool", lambda one, _: nullcontext() if one.is_alone else None)
        assert answers([*command, "--jobs", "2"], capsys) == two
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "other"))
    assert two == answers(command, capsys)
