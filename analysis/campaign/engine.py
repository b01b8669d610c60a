"""The runs of a campaign on Dask: a cluster on this machine, or an existing scheduler by its address.

A worker starts each run in a separate process, forked from one that has everything loaded, and moves the
result in as a whole. Finished runs are not repeated: the same command resumes after any interruption.
"""

import contextlib
import itertools
import logging
import signal
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import dask
from distributed import Client, LocalCluster, as_completed

from analysis.campaign.growth import contains, continued, described
from analysis.campaign.one import one as one_run
from analysis.campaign.plan import Plan, Run
from analysis.campaign.store import Store
from analysis.fork_server import ForkServer, ServerError
from plugin.configuration import versions
from sumo_net.settings import SettingsError
from sumo_net.traffic import TrafficError

_AHEAD = 3  # runs handed to the scheduler per worker
_LINES = 3  # kept of a failed run's standard error
_DASK = {
    "distributed.scheduler.allowed-failures": 3,
    "distributed.comm.timeouts.connect": "10s",
    # Dask's own profiling, 50 times a second, takes 3 % of a core.
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
    # Logs that are never read: at their default lengths memory grows over thousands of runs.
    "distributed.admin.system-monitor.log-length": 60,
    "distributed.admin.log-length": 100,
    "distributed.admin.low-level-log-length": 100,
    "distributed.diagnostics.computations.max-history": 10,
}


class Progress(NamedTuple):
    """Progress of a campaign."""

    total: int
    done: int  # including those of earlier calls
    failed: int
    last: "Done | None" = None  # the run that has just ended


class Done(NamedTuple):
    """A worker's report on one run."""

    seconds: float  # wall-clock, all of the worker's work for it
    run_s: float  # wall-clock, the run's own process
    cpu_s: float  # processor time of that process
    cause: str  # of the failure, '' if it succeeded


class Resumed(NamedTuple):
    """A campaign in its directory."""

    plan: Plan  # cells numbered as they are there
    missing: list[Run]
    description: dict[str, Any]  # see `described`
    mark: str  # hash of everything that the results depend on
    grown: bool  # the runs there are those of a smaller campaign that this one contains


def run(
    plan: Plan,
    out: Path | str,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    compare_paper: bool = False,
    tell: Callable[[Progress], None] = lambda progress: None,
) -> dict[str, dict[str, Any]]:
    """Run the missing runs of a campaign into `out`; returns the failures' causes and attempts by key.

    workers : concurrent processes of the cluster on this machine; default: one for each core.
    scheduler : address of an existing Dask scheduler to use instead.

    Raises SettingsError before anything is run or overwritten.
    """
    store = Store(out)
    plan, missing, description, what, grown = resumed(plan, store, compare_paper)
    with _client(workers, scheduler) as client:
        if missing:
            _check_workers(client)  # before anything is written
        store.claim(plan.campaign.title, what, len(plan.runs), grown)
        store.sweep_up()
        store.describe(description)
        tell(Progress(len(plan.runs), len(plan.runs) - len(missing), 0))
        if missing:
            _work(client, plan, missing, store, compare_paper, tell)
    return store.failures()


def resumed(plan: Plan, store: Store, compare_paper: bool = False) -> Resumed:
    """What a campaign would still do in a store. Writes nothing; raises SettingsError as `Store.check`."""
    before = store.description()
    plan = continued(plan, before)
    description = described(plan, compare_paper)
    what = f"{plan.hash} with the published search beside" if compare_paper else plan.hash
    grown = contains(description, before)
    store.check(what, grown)
    there = store.done()
    missing = [one for one in plan.runs if one.key not in there]
    return Resumed(plan, missing, description, what, grown)


def _work(
    client: Client,
    plan: Plan,
    missing: list[Run],
    store: Store,
    compare_paper: bool,
    tell: Callable[[Progress], None],
) -> None:
    waiting = iter(missing)
    attempts: dict[str, int] = {}
    runs = {one.key: one for one in missing}
    done, failed = len(plan.runs) - len(missing), 0

    def submit(one: Run) -> Any:
        attempts[one.key] = attempts.get(one.key, 0) + 1
        order = {
            "key": one.key,
            "cell": one.cell,
            "scenario": one.scenario,
            "seed": one.seed,
            "changes": dict(one.changes),
            "keep": list(plan.campaign.keep),
            "compare_paper": compare_paper,
        }
        return client.submit(work_off, order, store.address, key=f"{one.key}-{attempts[one.key]}", pure=False)

    threads = sum(client.nthreads().values())
    pool = as_completed([submit(one) for one in itertools.islice(waiting, _AHEAD * max(threads, 1))])
    for future in pool:
        key = future.key.rsplit("-", 1)[0]
        one_done = _outcome(future)
        cause = one_done.cause
        if cause and attempts[key] <= plan.campaign.retries:
            pool.add(submit(runs[key]))
            continue
        if cause:
            store.fail(key, cause, attempts[key])
            failed += 1
        else:
            done += 1
        tell(Progress(len(plan.runs), done, failed, one_done))
        following = next(waiting, None)
        if following is not None:
            pool.add(submit(following))


def _outcome(future: Any) -> Done:
    try:
        done: Done = future.result()
    except Exception as error:  # the worker died of it repeatedly
        nothing = float("nan")
        words = f"{type(error).__name__}: {' '.join(str(error).split())[:500]}"
        return Done(nothing, nothing, nothing, words)
    return done


_server = ForkServer()  # one for each process, shared by a worker's threads


def work_off(order: dict[str, Any], address: str) -> Done:
    """One run, on a worker."""
    begin = time.monotonic()

    def done(run_s: float, cpu_s: float, cause: str) -> Done:
        return Done(time.monotonic() - begin, run_s, cpu_s, cause)

    with tempfile.TemporaryDirectory(prefix="sumo-adas-run-") as folder:
        place = Path(folder) / "run"
        try:
            outcome = _server.call(one_run, order, place)
        except ServerError as error:
            return done(0.0, 0.0, str(error))
        took = outcome.seconds, outcome.cpu_s
        if outcome.ended_by:
            said = [line.strip() for line in outcome.words.splitlines() if line.strip()][-_LINES:]
            how = f"ended by signal {outcome.ended_by} ({signal.strsignal(outcome.ended_by)})"
            return done(*took, " | ".join([how, *said]).replace(folder, "…"))
        if outcome.error is not None:
            words = " ".join(str(outcome.error).split()).replace(folder, "…")
            named = isinstance(outcome.error, SettingsError | TrafficError | OSError) and words
            return done(*took, words if named else f"{type(outcome.error).__name__}: {words}")
        try:
            Store(address).put(order["key"], place)
        except OSError as error:
            return done(*took, f"{address}: {error.strerror or error}")
    return done(*took, "")


@contextlib.contextmanager
def _client(workers: int | None, scheduler: str | None) -> Iterator[Client]:
    logging.getLogger("distributed").setLevel(logging.ERROR)
    with dask.config.set(_DASK):
        if scheduler is not None:
            try:
                client = Client(scheduler, timeout="10s")
            except (OSError, ValueError) as error:
                reason = " ".join(str(error).split())
                raise SettingsError(f"--scheduler {scheduler}: no scheduler answers ({reason})") from None
            with client:
                yield client
            return
        # Runs are separate processes: the workers that wait for them can be threads of this process.
        with (
            LocalCluster(
                n_workers=workers or dask.system.CPU_COUNT,
                threads_per_worker=1,
                processes=False,
                memory_limit=0,
                dashboard_address="127.0.0.1:0",  # any port: the default may be in use
            ) as cluster,
            Client(cluster) as client,
        ):
            try:
                yield client
            finally:
                _server.close()


def _check_workers(client: Client) -> None:
    """Raises SettingsError if a worker cannot run anything, or has other versions than this process."""
    if not client.nthreads():
        raise SettingsError("the scheduler has no workers: start some, as in `dask worker ADDRESS`")

    def ready() -> tuple[str, str]:
        # Sent by value, for a worker without sumo-adas: must not refer to this module.
        import importlib

        missing = []
        for name in ("libsumo", "analysis.campaign", "plugin"):
            try:
                importlib.import_module(name)
            except ImportError as error:
                missing.append(error.name or name)
        if missing:
            return ", ".join(missing), ""
        return "", str(importlib.import_module("plugin.configuration").versions())

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # libsumo's wheel warns about other Arrow versions
        answers = client.run(ready, on_error="return")
    for worker, answer in answers.items():
        if isinstance(answer, BaseException):
            raise SettingsError(f"worker {worker}: {type(answer).__name__}: {answer}")
        missing, found = answer
        if missing:
            raise SettingsError(f"worker {worker} has no {missing}: install sumo-adas there")
        if found != versions():
            raise SettingsError(f"worker {worker} has {found}, here is {versions()}: install the same there")
