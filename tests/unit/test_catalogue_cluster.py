"""A cluster whose workers come late, die, or have another cellctl; a scheduler that goes away."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor as Executor
from importlib import import_module
from typing import Any

import pytest

from controller.catalogue import (
    Jobs,
    PoolLostError,
    TaskPool,
    in_order,
    open_pool,
    results_of,
)
from controller.catalogue.cluster import MAX_DEATHS, WorkerCluster, WorkerEndedError
from controller.catalogue.software import software_here
from controller.config import ConfigError

OLDER = {**software_here(), "cellctl": "0.0.9"}


class Remote:
    """Dask's future of a task."""

    def __init__(self, work: Callable[[], Any]) -> None:
        self.work = work
        self.state = "pending"

    def end(self) -> None:
        if self.state == "pending":
            self.state = "finished"

    def done(self) -> bool:
        return self.state != "pending"

    def cancelled(self) -> bool:
        return self.state == "cancelled"

    def cancel(self) -> None:
        self.state = "cancelled"

    def exception(self) -> None:
        return None

    def result(self) -> Any:
        return self.work()

    def add_done_callback(self, _: object) -> None: ...


class Scheduler:
    """A scheduler with workers; each look at them is a moment, in which those alive do a task."""

    def __init__(self, *moments: dict[str, dict[str, str]]) -> None:
        self.moments = list(moments)  # software of each worker, by address
        self.there: dict[str, dict[str, str]] = {}
        self.open: list[tuple[Remote, set[str]]] = []
        self.given: list[tuple[str, ...]] = []
        self.is_lost = False
        self.backwards = False  # the last task that a worker has is the first it does
        self.kills: Callable[[Remote], bool] = lambda _: False

    def nthreads(self) -> dict[str, int]:
        if self.is_lost:
            raise OSError("closed")
        if self.moments:
            self.there = self.moments.pop(0)
        for worker in list(self.there):
            mine = [one for one, workers in self.open if worker in workers and not one.done()]
            mine = mine[::-1] if self.backwards else mine
            if mine and self.kills(mine[0]):
                self.there = {f"{worker}'": self.there[worker]}  # a nanny starts another
            elif mine:
                mine[0].end()
        return dict.fromkeys(self.there, 1)

    def run(self, call: object, workers: list[str], on_error: str) -> dict[str, Any]:
        assert (call, on_error) == (software_here, "return")
        return {worker: self.there[worker] for worker in workers}

    def submit(self, call: Callable[..., Any], *arguments: object, **how: Any) -> Remote:
        remote = Remote(lambda: call(*arguments))
        self.given.append(tuple(how["workers"]))
        self.open.append((remote, set(how["workers"])))
        return remote


@pytest.fixture(autouse=True)
def _looks_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("controller.catalogue.cluster.LOOK_S", 0.0)


def squares(scheduler: Scheduler, count: int) -> tuple[dict[int, Any], list[str]]:
    told: list[str] = []
    cluster = WorkerCluster(scheduler, "tcp://here:1", told.append)
    return dict(results_of(cluster, _square, range(count))), told


def _square(number: int) -> int:
    return number**2


SAME = software_here()
ALL = {n: n**2 for n in range(6)}


def test_an_empty_cluster_is_waited_for_and_says_so() -> None:
    found, told = squares(Scheduler({}, {}, {"a": SAME}), 6)
    assert found == ALL
    assert told == [
        "workers: none at tcp://here:1 yet; waiting for one (`dask worker tcp://here:1`)",
        "workers: 1 of 1",
    ]


def test_workers_that_come_later_get_more_to_do() -> None:
    scheduler = Scheduler({"a": SAME}, {"a": SAME}, {"a": SAME, "b": SAME, "c": SAME})
    found, told = squares(scheduler, 12)
    assert found == {n: n**2 for n in range(12)}
    assert told == ["workers: 1 of 1", "workers: 3 of 3"]
    assert scheduler.given[:2] == [("a",), ("a",)]
    assert scheduler.given[-1] == ("a", "b", "c")


@pytest.mark.parametrize("is_late", [False, True])
def test_a_worker_of_another_cellctl_is_refused_and_gets_nothing(is_late: bool) -> None:
    first = {"a": SAME} if is_late else {"a": SAME, "old": OLDER}
    scheduler = Scheduler(first, {"a": SAME, "old": OLDER})
    found, told = squares(scheduler, 6)
    assert found == ALL
    assert set(scheduler.given) == {("a",)}
    (refusal,) = [words for words in told if "old" in words]
    assert "has cellctl 0.0.9, this process" in refusal
    assert told[-1] == "workers: 1 of 2"


def test_a_worker_without_cellctl_is_refused() -> None:
    lacking: Any = ModuleNotFoundError("No module named 'controller'")
    found, told = squares(Scheduler({"bare": lacking}, {"bare": lacking, "a": SAME}), 6)
    assert found == ALL
    assert "worker bare is not used: it has no such cellctl" in told[0]


def test_tasks_whose_workers_are_gone_go_to_those_that_came() -> None:
    scheduler = Scheduler({"a": SAME}, {}, {}, {"b": SAME})
    found, told = squares(scheduler, 6)
    assert found == ALL
    assert told == ["workers: 1 of 1", "workers: 0 of 1; waiting for one", "workers: 1 of 1"]
    assert scheduler.given[-1] == ("b",)


def test_a_task_that_ends_its_workers_is_given_up_and_the_others_go_on() -> None:
    scheduler = Scheduler({"a": SAME})
    ends_them: list[Remote] = []

    def kills(remote: Remote) -> bool:
        if remote.work() == 4:
            ends_them.append(remote)
        return remote.work() == 4

    scheduler.kills = kills
    found, _ = squares(scheduler, 6)
    assert len(ends_them) == MAX_DEATHS
    assert isinstance(found.pop(2), WorkerEndedError)
    assert found == {n: square for n, square in ALL.items() if n != 2}


def test_a_scheduler_that_goes_away_ends_the_work() -> None:
    scheduler = Scheduler({"a": SAME})
    cluster = WorkerCluster(scheduler, "tcp://here:1", lambda _: None)
    results = results_of(cluster, _square, range(6))
    assert next(results) == (0, 0)
    scheduler.is_lost = True
    with pytest.raises(PoolLostError, match="tcp://here:1 went away"):
        list(results)


def test_what_is_cancelled_by_nobody_here_means_a_lost_scheduler() -> None:
    scheduler = Scheduler({"a": SAME})
    cluster = WorkerCluster(scheduler, "tcp://here:1", lambda _: None)
    future = cluster.submit(_square, 2)
    scheduler.open[0][0].cancel()
    with pytest.raises(PoolLostError, match="went away"):
        cluster.wait([future])


def test_results_come_in_the_order_of_the_orders() -> None:
    scheduler = Scheduler({"a": SAME}, {"a": SAME, "b": SAME})
    cluster = WorkerCluster(scheduler, "tcp://here:1", lambda _: None)
    scheduler.backwards = True
    assert list(in_order(cluster, _square, range(9))) == [n**2 for n in range(9)]


def test_the_first_error_ends_what_is_in_order() -> None:
    with TaskPool(Executor(2), 2).executor as executor:
        results = in_order(TaskPool(executor, 2), _inverse, [2, 1, 0, 4])
        assert [next(results), next(results)] == [0.5, 1.0]
        with pytest.raises(ZeroDivisionError):
            next(results)


def test_one_order_that_fails_leaves_the_others() -> None:
    found = dict(results_of(None, _inverse, range(3)))
    assert isinstance(found.pop(0), ZeroDivisionError)
    assert found == {1: 1.0, 2: 0.5}


def _inverse(number: int) -> float:
    return 1 / number


def test_tls_without_a_certificate_names_the_settings() -> None:
    with (
        pytest.raises(ConfigError, match="DASK_DISTRIBUTED__COMM__TLS__CA_FILE"),
        open_pool(Jobs(scheduler="tls://127.0.0.1:1")),
    ):
        pass


def test_an_address_without_tls_is_refused_where_encryption_is_required() -> None:
    dask: Any = import_module("dask")
    with (
        dask.config.set({"distributed.comm.require-encryption": True}),
        pytest.raises(ConfigError, match="tls://"),
        open_pool(Jobs(scheduler="tcp://127.0.0.1:1")),
    ):
        pass
