import math
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from app.case import (
    IgtlSourceEntry,
    TfSourceEntry,
    TopicSourceEntry,
    begin_case,
    open_case,
    open_live,
)
from app.case.manifest.images import ActivationEntry
from app.fixture import GuidanceParameters, LimiterParameters, TumorMotionParameters
from app.geometry import InputError
from app.session import guidance_parameters, limiter_parameters, tumor_motion_parameters
from tests.refusals import refused


@pytest.fixture
def values(project_root: Path) -> dict[str, Any]:
    text = (project_root / "data" / "live_example" / "live.yaml").read_text()
    return yaml.safe_load(text)


def opened(folder: Path, values: dict[str, Any]):
    path = folder / "live.yaml"
    path.write_text(yaml.safe_dump(values))
    return open_live(path)


def begun(live, folder: Path) -> dict[str, Any]:
    """The document of the case that a recording of the session begins."""
    begin_case(live, folder / "case")
    return yaml.safe_load((folder / "case" / "case.yaml").read_text())


def test_example_is_valid_and_names_the_meshes_of_the_recorded_case(project_root):
    live = open_live(project_root / "data" / "live_example" / "live.yaml")
    recorded = open_case(project_root / "data" / "recorded_case")
    assert live.source == TopicSourceEntry("/tracked_transforms")
    assert live.stamps_of_host is True
    assert (live.case.tumor_mesh().faces == recorded.tumor_mesh().faces).all()
    assert live.case.manifest.margins == recorded.manifest.margins
    assert live.case.manifest.clock == recorded.manifest.clock


def test_joints_use_the_host_clock_without_a_clock_section(tmp_path, values):
    assert not opened(tmp_path, values).joints_of_host
    del values["clock"]
    assert opened(tmp_path, values).joints_of_host


GUIDANCE = {"force_n": 2.0, "range_mm": 10.0, "rate_n_s": 20.0}
GUIDANCE |= {"period_ms": 20.0, "delay_ms": 5.0, "damping_n_s_m": 5.0}
MOTION = {"swing_mm": 5, "rate_hz": 0.25, "jitter_mm": 0.3, "jitter_deg": 0.3}
IGTL = {"igtl": {"host": "plus", "port": 18944}}
DWELLS = {"method": "paired_points", "dwells": [{"start_s": 0.0, "end_s": 1.0}]}


@pytest.mark.parametrize(
    ("source", "entry"),
    [
        ({"tf": {}, "clock": "host"}, TfSourceEntry(())),
        ({"tf": {"edges": [{"parent": "tracker", "child": "cautery"}]}, "clock": "estimate"},
         TfSourceEntry((("tracker", "cautery"),))),
        ({"tracked_transforms": {"topic": "/ndi/poses"}, "clock": "host"},
         TopicSourceEntry("/ndi/poses")),
        ({**IGTL, "clock": "estimate"}, IgtlSourceEntry("plus", 18944)),
    ],
)  # fmt: skip
def test_each_kind_of_source_is_read(tmp_path, values, source, entry):
    live = opened(tmp_path, values | {"source": source})
    assert live.source == entry
    assert live.stamps_of_host is (source["clock"] == "host")


def test_guidance_and_limiter_are_read(tmp_path, values):
    live = opened(tmp_path, values)
    assert guidance_parameters(live) is None
    assert limiter_parameters(live) == LimiterParameters()
    given = {"guidance": GUIDANCE, "limiter": {"tau_ms": 80.0, "max_speed_mm_s": 100.0}}
    live = opened(tmp_path, values | given)
    assert guidance_parameters(live) == GuidanceParameters(2.0, 10.0, 20.0, 0.02, 0.005, 5.0)
    assert limiter_parameters(live) == LimiterParameters(tau_s=0.08, max_speed_mm_s=100.0)
    assert live.case.notes() == ()


def test_old_names_of_limits_are_read_with_a_note_on_each(tmp_path, values):
    old = {"tau_ms": 80.0, "most_mm_s": 100.0, "most_rad_s": 1.0}
    live = opened(tmp_path, values | {"limiter": old})
    assert limiter_parameters(live) == LimiterParameters(0.08, 50.0, 20.0, 100.0, 1.0)
    assert live.case.notes() == (
        "live.yaml: limiter.most_mm_s is the old name of max_speed_mm_s: rename it",
        "live.yaml: limiter.most_rad_s is the old name of max_turn_rad_s: rename it",
    )


def test_limit_by_its_old_and_its_present_name_is_refused(tmp_path, values):
    twice = {"limiter": {"most_mm_s": 100.0, "max_speed_mm_s": 200.0}}
    expected = "limiter.most_mm_s is the old name of max_speed_mm_s, which is given, too; expected"
    with pytest.raises(InputError, match=expected):
        opened(tmp_path, values | twice)


def test_value_by_an_old_name_is_checked(tmp_path, values):
    with pytest.raises(InputError, match=r"limiter\.max_speed_mm_s is -1; expected at least 0"):
        opened(tmp_path, values | {"limiter": {"most_mm_s": -1.0}})


def test_tumor_motion_is_in_degrees_and_needs_all_keys(tmp_path, values):
    assert tumor_motion_parameters(opened(tmp_path, values)) is None
    motion = MOTION | {"swing_deg": 180}
    found = tumor_motion_parameters(opened(tmp_path, values | {"tumor_motion": motion}))
    assert found == TumorMotionParameters(5.0, math.pi, 0.25, 0.3, math.radians(0.3))
    still = opened(tmp_path, values | {"tumor_motion": motion | {"rate_hz": 0.0}})
    with pytest.raises(InputError, match=r"live.yaml: tumor_motion: rate_hz of the tumour is 0.0;"):
        tumor_motion_parameters(still)


def test_errors_of_the_tracker_are_in_ns_mm_and_radians(tmp_path, values):
    unknown = opened(tmp_path, values)
    assert (unknown.latency_ns, unknown.sigma_mm, unknown.sigma_rad) == (0, 0.0, 0.0)
    assert unknown.motion_frame is None
    source = {"tf": {}, "clock": "host", "latency_ms": 20, "sigma_mm": 0.2, "sigma_deg": 45}
    given = {"source": source, "tumor_motion": MOTION | {"swing_deg": 1, "frame": "tracker"}}
    live = opened(tmp_path, values | given)
    assert (live.latency_ns, live.sigma_mm) == (20_000_000, 0.2)
    assert live.sigma_rad == pytest.approx(math.pi / 4.0)
    assert live.motion_frame == "tracker"
    with pytest.raises(InputError, match="latency_ms"):
        opened(tmp_path, values | {"source": source | {"latency_ms": -1}})


def test_active_force_and_zero_limit_are_refused(tmp_path, values):
    stiff = opened(tmp_path, values | {"guidance": GUIDANCE | {"delay_ms": 15.0}})
    with refused(r"live.yaml: guidance: stiffness of the guidance .* is 200 N/m; .* 200 N/m"):
        guidance_parameters(stiff)
    still = opened(tmp_path, values | {"limiter": {"max_speed_mm_s": 0.0}})
    with pytest.raises(InputError, match=r"limiter: max_speed_mm_s of the limiter is 0.0;"):
        limiter_parameters(still)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"source": {"clock": "host"}}, "has none of tf, tracked_transforms, igtl"),
        ({"source": {"tf": {}, "tracked_transforms": {}, "clock": "host"}},
         "has tf and tracked_transforms of tf"),
        ({"source": {"tf": {}}}, "live.yaml: source.clock is missing"),
        ({"source": {"tf": {}, "clock": "ntp"}},
         "source.clock is 'ntp'; expected one of host, estimate"),
        ({"source": {"tf": {"edges": []}, "clock": "host"}}, "source.tf.edges is empty"),
        ({"source": {"tf": {"edge": []}, "clock": "host"}}, "source.tf.edge is unknown"),
        ({"source": {"tracked_transforms": {"topic": "a b"}, "clock": "host"}}, "topic is 'a b'"),
        ({"recording": {"path": "x.mcap"}}, "live.yaml: recording is unknown"),
        ({"guidance": {"force_n": 2.0}}, "live.yaml: guidance.range_mm is missing"),
        ({"guidance": GUIDANCE | {"gain": 1.0}}, "guidance.gain is unknown"),
        ({"limiter": {"max_speed_mm_s": -1.0}}, "max_speed_mm_s is -1; expected at least 0"),
        ({"clock": {"estimate": True}}, "live.yaml: clock.estimate needs a recording"),
        ({"registration": DWELLS}, "live.yaml: registration.dwells needs a recording"),
        ({"source": {"igtl": {"host": "plus"}, "clock": "host"}}, "source.igtl.port is missing"),
        ({"source": {"igtl": {"host": "plus", "port": 65536}, "clock": "host"}},
         "source.igtl.port is 65536; expected 1 to 65535"),
        ({"schema": 3}, "live.yaml: schema is 3; expected 1 or 2"),
    ],
)  # fmt: skip
def test_faults_are_refused_with_their_key(tmp_path, values, change, message):
    with pytest.raises(InputError, match=re.escape(message)):
        opened(tmp_path, values | change)


def test_missing_file_folder_and_recording_are_refused(tmp_path, values):
    with pytest.raises(InputError, match=r"live\.yaml: a live case has no recording"):
        opened(tmp_path, values).case.recorded_frames()
    values["tumor"]["mesh"]["path"] = "gone.stl"
    with pytest.raises(InputError, match=r"live\.yaml: tumor\.mesh\.path is 'gone\.stl'"):
        opened(tmp_path, values)
    with pytest.raises(InputError, match="is not a live configuration: it is a folder"):
        open_live(tmp_path)


def test_case_of_an_igtl_source_has_its_images_on_a_topic(tmp_path, values):
    values["source"] = {**IGTL, "clock": "host"}
    images = {"probe": "probe", "calibration": "probe.txt"}
    values["images"] = {**images, "device": "Image_Probe"}
    (tmp_path / "probe.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1")
    written = begun(opened(tmp_path, values), tmp_path)
    assert written["images"] == {**images, "topic": "/marginguard/images"}


def test_live_recording_starts_with_a_case_without_recording(tmp_path, values, project_root):
    config = tmp_path / "config"
    config.mkdir()
    stl = (project_root / "data" / "recorded_case" / "tumor.stl").read_bytes()
    (config / "tumor.stl").write_bytes(stl)
    values["tumor"]["mesh"]["path"] = "tumor.stl"
    written = begun(opened(config, values), tmp_path)
    assert (tmp_path / "case" / "tumor.stl").read_bytes() == stl
    assert written.pop("recording") == {"path": "tracking"}
    del values["source"]
    assert written == values
    with pytest.raises(InputError, match="already exists; refusing to overwrite it"):
        begin_case(open_live(config / "live.yaml"), tmp_path / "case")


def test_other_tracking_topic_cannot_be_recorded_as_a_case(tmp_path, values):
    values["source"] = {"tracked_transforms": {"topic": "/ndi"}, "clock": "host"}
    with pytest.raises(InputError, match="expected /tracked_transforms"):
        begin_case(opened(tmp_path, values), tmp_path / "case")
    assert not (tmp_path / "case").exists()


def test_recorded_case_omits_live_sections_and_estimates_the_clocks(tmp_path, values):
    values["source"]["clock"] = "estimate"
    del values["clock"]
    live = opened(tmp_path, values | {"guidance": GUIDANCE, "limiter": {"tau_ms": 80.0}})
    written = begun(live, tmp_path)
    assert not {"source", "guidance", "limiter"} & written.keys()
    assert written["clock"] == {"estimate": True}


@pytest.mark.parametrize(
    ("cautery", "message"),
    [
        ({}, "cautery has neither topic nor device; expected one of them"),
        ({"topic": "/a", "device": "A"}, "cautery has topic and device; expected one of them"),
        ({"device": "A"}, "cautery.device is 'A' and the source is not igtl; expected a topic"),
    ],
)
def test_cautery_has_one_source(tmp_path, values, cautery, message):
    with pytest.raises(InputError, match=re.escape(message)):
        opened(tmp_path, values | {"cautery": cautery})


def test_cautery_of_a_session_is_in_its_recorded_case(tmp_path, project_root):
    path = project_root / "data" / "live_example"
    live = open_live(path / "live.yaml")
    assert live.case.manifest.activation is None
    text = (path / "live.yaml").read_text() + "\ncautery: {topic: /generator/active}\n"
    folder = tmp_path / "live"
    shutil.copytree(path, folder)
    (folder / "live.yaml").write_text(text)
    live = open_live(folder / "live.yaml")
    assert live.case.manifest.activation == ActivationEntry("/generator/active", None, 10**9)
    written = begun(live, tmp_path)
    assert written["cautery"] == {"topic": "/generator/active"}
