"""Time of the first request of new service clients beside plain rclpy, and replies that are lost.

    python -m benchmarks.first_request [PAIRS]

The server is a process with rclpy alone. Clients of plain rclpy, of `app.bridge.calls` and of the
module ROS2 are made in turn, first each of a new node, then all of a kind of one node. The time is
from the creation of the client to its reply: with a new node it contains the discovery of the node.
"""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from benchmarks.ros_domain import reserved_domain

SERVICE = "/first_request"
TIMEOUT_S = 5.0
POLL_S = 0.001

Measure = Callable[[], float | None]
"""Seconds to the reply to a new client; None without a reply."""

MODULE = Path(__file__).resolve().parents[1] / "slicer_module" / "ROS2"


def serve() -> None:
    """Serve until the process is killed, with rclpy alone."""
    import rclpy
    from std_srvs.srv import SetBool

    def answer(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success = request.data
        return response

    rclpy.init()
    node = rclpy.create_node("first_request_server")
    node.create_service(SetBool, SERVICE, answer)
    print("ready", flush=True)
    rclpy.spin(node)


@contextmanager
def plain_rclpy() -> Iterator[Measure]:
    """Clients with rclpy alone."""
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor
    from std_srvs.srv import SetBool

    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node("plain", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    threading.Thread(target=executor.spin, daemon=True).start()

    def measure() -> float | None:
        done = threading.Event()
        start = time.perf_counter()
        client = node.create_client(SetBool, SERVICE)
        while not client.service_is_ready():
            time.sleep(POLL_S)
        client.call_async(SetBool.Request(data=True)).add_done_callback(lambda _: done.set())
        is_answered = done.wait(TIMEOUT_S)
        taken_s = time.perf_counter() - start
        executor.create_task(lambda: node.destroy_client(client))
        return taken_s if is_answered else None

    yield measure
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)


@contextmanager
def bridge() -> Iterator[Measure]:
    """Clients of `app.bridge.calls`."""
    from app.bridge import RosNode
    from app.bridge.calls import CallError, ServiceClient

    with RosNode("bridge") as ros:

        def measure() -> float | None:
            start = time.perf_counter()
            client = ServiceClient(ros, "std_srvs/srv/SetBool", SERVICE)
            try:
                client.call({"data": True}, TIMEOUT_S)
                return time.perf_counter() - start
            except CallError:
                return None
            finally:
                ros.call(client.close)

        yield measure


@contextmanager
def module() -> Iterator[Measure]:
    """Clients of the module ROS2, spun by `WaitForServiceResponse`."""
    sys.path.insert(0, str(MODULE))
    from slicer import vtkMRMLScene

    from ROS2Lib.logic import Ros2Api  # type: ignore[import-not-found, unused-ignore]

    api = Ros2Api(vtkMRMLScene())
    node = api.AddNewNodeByClass("vtkMRMLROS2NodeNode")
    node.Create("module")

    def measure() -> float | None:
        start = time.perf_counter()
        client = node.CreateAndAddServiceClientNode("SetBool", SERVICE)
        client.SendAsyncRequest({"data": True})
        is_answered = api.WaitForServiceResponse(client, TIMEOUT_S)
        taken_s = time.perf_counter() - start
        node.RemoveAndDeleteServiceClientNode(SERVICE)
        return taken_s if is_answered else None

    yield measure
    api.Close()


KINDS = {"plain rclpy": plain_rclpy, "bridge": bridge, "module": module}


def measure_pairs(pairs: int, *, new_nodes: bool) -> dict[str, list[float | None]]:
    """Times by kind, measured in turn; each client has a new node, or all of a kind have one."""
    times: dict[str, list[float | None]] = {name: [] for name in KINDS}
    with ExitStack() as stack:
        kept = {}
        if not new_nodes:
            kept = {name: stack.enter_context(kind()) for name, kind in KINDS.items()}
            for measure in kept.values():
                measure()  # the nodes discover each other
        for number in range(pairs):
            for turn in range(len(KINDS)):
                name = list(KINDS)[(number + turn) % len(KINDS)]
                if new_nodes:
                    with KINDS[name]() as measure:
                        times[name].append(measure())
                else:
                    times[name].append(kept[name]())
    return times


def report(name: str, times: list[float | None], plain: list[float | None]) -> str:
    """One line: percentiles in ms, median ratio and difference to plain rclpy, lost replies."""
    taken_ms = 1e3 * np.array([each for each in times if each is not None])
    pairs = [(a, b) for a, b in zip(times, plain, strict=True) if a is not None and b is not None]
    more_ms = 1e3 * np.median([a - b for a, b in pairs])
    ratio = np.median([a for a, _ in pairs]) / np.median([b for _, b in pairs])
    return (
        f"{name:14} p50 {np.median(taken_ms):7.2f} ms   p90 {np.percentile(taken_ms, 90):7.2f} ms"
        f"   max {taken_ms.max():7.2f} ms   {ratio:5.2f} x rclpy, {more_ms:+6.2f} ms"
        f"   lost {times.count(None)} of {len(times)}"
    )


def main() -> None:
    """Measure pairs in turn and print one line for each client."""
    from app.bridge import prepare_environment

    pairs = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    with reserved_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        prepare_environment()
        server = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.first_request", "serve"],
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            assert server.stdout is not None
            server.stdout.readline()
            for new_nodes in (True, False):
                times = measure_pairs(pairs, new_nodes=new_nodes)
                load = Path("/proc/loadavg").read_text().split()[0]
                whose = "new nodes" if new_nodes else "one node of each kind"
                print(f"{pairs} new clients of {whose}, load {load}")
                for name, taken in times.items():
                    print(report(name, taken, times["plain rclpy"]), flush=True)
        finally:
            server.kill()
            server.wait()


if __name__ == "__main__":
    serve() if sys.argv[1:] == ["serve"] else main()
