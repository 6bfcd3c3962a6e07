"""``marginguard live`` with a pyigtl server measures the same distances as a replay."""

import re
import threading
import time
from itertools import count, islice

import pytest
import yaml

from app.case import open_case
from app.geometry import join_transform_name
from app.session import Session, setup_from_case

pytestmark = pytest.mark.slow

STEP_S = 0.02
NOISE_MM = 5e-4


def test_live_session_measures_the_same_distance_as_a_replay(
    start_pyigtl, start, project_root, tmp_path
):
    server = start_pyigtl()
    values = yaml.safe_load((project_root / "data/live_example/live.yaml").read_text())
    values["source"] = {"igtl": {"host": "127.0.0.1", "port": server.port}, "clock": "host"}
    config = tmp_path / "live.yaml"
    config.write_text(yaml.safe_dump(values))
    case = open_case(project_root / "data" / "recorded_case")
    frame = next(islice(case.recorded_frames(), 100, None))
    expected = Session(setup_from_case(case)).step(frame).decision.proximity
    assert expected is not None
    live = start("-m", "app.cli", "live", "--config", config)
    stop = threading.Event()

    def track() -> None:
        for number in count():
            if stop.wait(STEP_S):
                return
            for sample in frame.poses:
                assert sample.transform is not None
                matrix = sample.transform.matrix.copy()
                matrix[:3, 3] += NOISE_MM * (number % 7)  # a pose that repeats is frozen
                server.send(
                    name=join_transform_name(sample.source, sample.target),
                    matrix=matrix.tolist(),
                    time_s=time.time(),
                    metadata={"TransformStatus": "OK"},
                )

    tracker = threading.Thread(target=track)
    tracker.start()
    try:
        found = re.search(r"(-?\d+\.\d+) mm", live.line(lambda line: " mm" in line))
    finally:
        stop.set()
        tracker.join()
    assert found is not None
    assert float(found[1]) == pytest.approx(expected.signed_distance_mm, abs=0.02)
    live.stop()
    assert "connected to 127.0.0.1" in live.log.read_text()
