"""`marginguard cohort` on Dask: the same bytes with any number of workers, and after failures."""

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager

import psutil
import pytest
from distributed import default_client

from app.cli.dask_pool import DaskPool
from app.cohort import Dataset
from tests.cli.command import refused, run
from tests.cli.small_case import write_small_case
from tests.waiting import wait_until

pytestmark = pytest.mark.long

SMALL_CASES = 12


def command(*words, **options):
    return subprocess.Popen(
        [sys.executable, "-m", "marginguard", "cohort", *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def finish(process, timeout=240):
    out, err = process.communicate(timeout=timeout)
    return process.returncode, out, err


def contents(folder):
    return {path.name: path.read_bytes() for path in (folder / "cases").iterdir()}


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """Recorded cases, one of them cut, and a manifest with two simulated ones beside them."""
    folder = tmp_path_factory.mktemp("archive")
    for index in range(SMALL_CASES):
        write_small_case(folder / f"case_{index:02d}")
    cut = folder / "case_05" / "tracking.igs.mha"
    cut.write_bytes(cut.read_bytes()[:300])
    return folder


@pytest.fixture(scope="module")
def reference(archive, tmp_path_factory):
    """The results with one worker."""
    folder = tmp_path_factory.mktemp("one")
    status, out, err = finish(command(archive, "--out", folder, "--workers", 1))
    assert status == 1, err
    assert out.startswith(f"{SMALL_CASES} cases: {SMALL_CASES} done, 0 kept, 1 with an error")
    assert "Dask's dashboard: http://127.0.0.1:" in err
    return folder


def test_number_of_workers_changes_no_byte(archive, reference, tmp_path):
    status, _, err = finish(command(archive, "--out", tmp_path / "out", "--workers", 4))
    assert status == 1, err
    assert contents(tmp_path / "out") == contents(reference)
    rows = {row["name"]: row for row in Dataset(tmp_path / "out").rows()}
    assert len(rows) == SMALL_CASES and rows["case_05"]["status"] == "failed"


def test_second_run_starts_no_worker(archive, reference):
    before = contents(reference)
    printed = run("cohort", archive, "--out", reference, "--json", status=1)
    assert printed.err == ""
    assert json.loads(printed.out) == {"total": 12, "kept": 12, "done": 0, "failed": 1}
    assert contents(reference) == before


def test_worker_does_not_keep_its_stacks():
    """Dask's profiler would add 1 MB to the memory of a worker with each case."""
    with DaskPool(None, 1):
        found = default_client().run(lambda dask_worker: list(dask_worker.periodic_callbacks))
    (callbacks,) = found.values()
    assert "heartbeat" in callbacks and "profile" not in callbacks


def workers_of(process):
    """The worker processes of a command: children of Dask's nannies."""
    return [
        child
        for child in psutil.Process(process.pid).children(recursive=True)
        if "multiprocessing.spawn" in " ".join(child.cmdline())
    ]


def journal_lines(folder):
    path = folder / "journal.jsonl"
    return len(path.read_text().splitlines()) if path.exists() else 0


def wait_for(condition, process):
    """Wait until ``condition`` holds while ``process`` runs."""

    def check():
        assert process.poll() is None, process.communicate()

    wait_until(condition, check)


def test_killed_workers_change_no_byte(archive, reference, tmp_path):
    process = command(archive, "--out", tmp_path / "out", "--workers", 2)
    for finished in (1, 4):
        wait_for(lambda least=finished: journal_lines(tmp_path / "out") >= least, process)
        workers_of(process)[-1].send_signal(signal.SIGKILL)
    status, _, err = finish(process)
    assert status == 1, err
    assert contents(tmp_path / "out") == contents(reference)


def test_case_whose_worker_dies_too_often_is_lost_until_the_next_run(archive, reference, tmp_path):
    once = {**os.environ, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
    words = (archive, "--out", tmp_path / "out", "--workers", 2)
    process = command(*words, env=once)
    wait_for(lambda: journal_lines(tmp_path / "out") >= 1, process)
    workers_of(process)[-1].send_signal(signal.SIGKILL)
    status, _, err = finish(process)
    assert status == 1, err
    rows = list(Dataset(tmp_path / "out").rows())
    lost = [row for row in rows if row["status"] == "lost"]
    assert {row["reason"] for row in lost} == {"1 worker died while running this case"}
    assert len(rows) == SMALL_CASES
    status, out, err = finish(command(*words, "--json"))
    assert status == 1 and json.loads(out)["done"] == len(lost), err
    assert contents(tmp_path / "out") == contents(reference)


def test_interrupted_command_is_continued(archive, reference, tmp_path):
    process = command(archive, "--out", tmp_path / "out", "--workers", 1)
    wait_for(lambda: journal_lines(tmp_path / "out") >= 3, process)
    process.send_signal(signal.SIGINT)
    status, _, _ = finish(process)
    assert status == 130 and journal_lines(tmp_path / "out") >= 3
    status, out, err = finish(command(archive, "--out", tmp_path / "out", "--workers", 1, "--json"))
    counts = json.loads(out)
    assert status == 1 and counts["kept"] >= 3 and counts["kept"] + counts["done"] == 12, err
    assert contents(tmp_path / "out") == contents(reference)


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextmanager
def program(module, *words, folder):
    """A Dask program that is killed at the end."""
    process = subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.{module}", *map(str, words)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        cwd=folder,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def test_scheduler_that_goes_away_and_returns(archive, reference, tmp_path):
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    listen = ("--host", "127.0.0.1", "--port", port, "--dashboard-address", "127.0.0.1:0")
    worker = (address, "--nworkers", 1, "--nthreads", 1, "--no-dashboard", "--death-timeout", 60)
    with program("dask_scheduler", *listen, folder=tmp_path):
        process_env = {**os.environ, "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "30s"}
        process = command(
            *(archive, "--out", tmp_path / "out", "--scheduler", address), env=process_env
        )
        with program("dask_worker", *worker, folder=tmp_path):
            wait_for(lambda: journal_lines(tmp_path / "out") >= 2, process)
    # Scheduler and worker are gone; the command waits.
    with (
        program("dask_scheduler", *listen, folder=tmp_path),
        program("dask_worker", *worker, folder=tmp_path),
    ):
        status, out, err = finish(process)
    assert status == 1, err
    assert f"{SMALL_CASES} done" in out
    assert contents(tmp_path / "out") == contents(reference)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--workers", "0"], "'0'; expected 1 to 1024"),
        (["--scheduler", "tcp://127.0.0.1:1"], "no scheduler"),
        (["--scheduler", "tcp://127.0.0.1:1", "--workers", "2"], "expected one of them"),
    ],
)
def test_bad_option_is_one_line(archive, tmp_path, words, message):
    assert message in refused("cohort", archive, "--out", tmp_path / "out", *words)
