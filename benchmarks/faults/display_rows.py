"""Rows with faults of a display, a process of its own: the constraint must come as without it.

The full disk needs `unshare --mount`: that row is not measured where it is not permitted.
"""

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial

import numpy as np

from app.geometry import NS_PER_MS, NS_PER_S
from benchmarks.faults.bench import Bench, UnmeasuredError
from benchmarks.faults.foreign_rows import ask
from benchmarks.faults.records import Verdict
from benchmarks.faults.results import Row, Variant
from benchmarks.harness.processes import CLI, Child

FAULT_NS, AFTER_NS = 10 * NS_PER_S, 2 * NS_PER_S
BEYOND_MS = 10.0  # by which the longest gap may exceed that of the same guard without a display
LEAVE_S = 45.0  # a killed display stays on the graph for 20 s
STEP = "/marginguard/step"
VIEW = [*CLI, "view", "--live", "--node", "/marginguard", "--no-browser"]
FULL_DISK = """
import os, sys
script = '''
    mount -t tmpfs -o size=4k none "$0" && head -c 4096 /dev/zero > "$0/filled" || exit 1
    export HOME="$0" TMPDIR="$0" XDG_STATE_HOME="$0" XDG_CACHE_HOME="$0"
    exec "$@"
'''
root = [] if os.geteuid() == 0 else ["--map-root-user"]
os.execvp("unshare", ["unshare", "--mount", *root, "sh", "-c", script, *sys.argv[1:]])
"""


def display_rows() -> Iterator[Row]:
    for name, display, fault in (
        ("display killed", _page, signal.SIGKILL),
        ("display stopped for 10 s", _page, signal.SIGSTOP),
        ("display hung for 10 s, its command open", _hung, None),
        ("display's disk full", partial(_page, full_disk=True), None),
    ):
        run = partial(_beside, display=display, fault=fault)
        bound = f"{BEYOND_MS:g} ms more"
        yield Row(name, Variant.LIVE_JOINTS, run, "its own process", bound, trials=1)


def _beside(
    bench: Bench,
    display: Callable[[Bench], AbstractContextManager[Child]],
    fault: signal.Signals | None,
) -> Verdict:
    """Compare the longest gap of the constraint during the fault with those before and after."""
    before_ms = _longest_gap_alone_ms(bench)
    with display(bench) as child:
        _await_displays(bench, 1)
        beside_ms = _longest_gap_ms(bench, child, fault)
    alone_ms = max(before_ms, _longest_gap_alone_ms(bench))
    beyond_ms = beside_ms - alone_ms
    late = beyond_ms > BEYOND_MS
    return Verdict(
        to_safe_ms=None if late else 0.0,
        over_limit_ms=max(0.0, beyond_ms - BEYOND_MS),
        late_constraints=int(late),
        note=f"longest gap {beside_ms:.1f} ms, {alone_ms:.1f} ms without a display "
        f"(x {beside_ms / alone_ms:.2f}); period {bench.period_ms:g} ms",
    )


def _longest_gap_alone_ms(bench: Bench) -> float:
    _await_displays(bench, 0)
    return _longest_gap_ms(bench)


def _longest_gap_ms(
    bench: Bench, child: Child | None = None, fault: signal.Signals | None = None
) -> float:
    """Longest time between two constraints that arrive, as sent: not what delays the receiver."""
    controller = bench.controller
    bench.free()  # what the guard does on hold is less
    controller.forget()
    begin_ns = time.time_ns()
    if child is not None and fault is not None:
        child.send_signal(fault)
    controller.wait_until(begin_ns + FAULT_NS)
    if child is not None:
        child.send_signal(signal.SIGCONT)
    controller.wait_until(begin_ns + FAULT_NS + AFTER_NS)
    sent = [each.sent_ns for each in controller.records()[0]]
    return float(np.diff([begin_ns, *sent, time.time_ns()]).max() / NS_PER_MS)


def _await_displays(bench: Bench, count: int) -> None:
    """Wait until the graph lists so many displays; raises `UnmeasuredError`."""
    deadline = time.monotonic() + LEAVE_S
    while (found := bench.controller.node.count_subscribers(STEP)) != count:
        if time.monotonic() > deadline:
            raise UnmeasuredError(f"{found} displays on the graph; expected {count}")
        time.sleep(0.1)


@contextmanager
def _page(bench: Bench, *, full_disk: bool = False) -> Iterator[Child]:
    """The page of the running guard, which shows its steps."""
    folder = bench.folder / "full"
    folder.mkdir(exist_ok=True)
    on_full_disk = ["-c", FULL_DISK, str(folder), sys.executable]
    page = bench.child("page", [*on_full_disk, *VIEW] if full_disk else VIEW)
    try:
        page.line("http", 90.0)
        yield page
    finally:
        page.end()


@contextmanager
def _hung(bench: Bench) -> Iterator[Child]:
    """A node that subscribes as a display does and takes nothing, nor the reply to its command."""
    with bench.foreign() as node:
        ask(node, do="hang", instance_id=bench.latest().content.instance_id)
        yield node
