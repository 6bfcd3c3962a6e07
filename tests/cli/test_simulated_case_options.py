"""Options that describe a simulated case."""

import argparse
import math

import pytest

from app.cli.simulated_case_options import (
    TRACKERS,
    add_simulated_case,
    simulated_case_arguments,
    simulated_case_options,
)
from app.geometry import InputError
from app.synthetic.tracker_model import PRESETS


def parsed(*words):
    parser = argparse.ArgumentParser()
    add_simulated_case(parser)
    return simulated_case_options(parser.parse_args(words))


def test_choices_are_the_presets():
    assert list(TRACKERS) == list(PRESETS)


def test_default_is_white_noise_without_other_errors():
    options = parsed()
    assert options.tracker == PRESETS["white"] and options.duration_s is options.tumor_mm is None
    assert options.errors.contour_mm == options.errors.tip_mm == options.errors.clock_s == 0.0


def test_each_option_sets_its_value_in_its_unit():
    options = parsed(
        *("--tracker", "aurora", "--duration", "120", "--tumor-mm", "10", "--rate", "30"),
        *("--latency-ms", "50", "--slow-deg", "0.1", "--distortion-mm", "0.5", "--tip-deg", "1"),
        *("--contour-mm", "0.2", "--encoder-offset-deg", "0.05", "--clock-ms", "1"),
    )
    assert (options.duration_s, options.tumor_mm) == (120.0, 10.0)
    assert options.tracker.rate_hz == 30.0 and options.tracker.latency_s == 0.05
    assert options.tracker.slow.angle_rms_rad == pytest.approx(math.radians(0.1))
    assert options.tracker.slow.position_rms_mm == PRESETS["aurora"].slow.position_rms_mm
    assert options.tracker.distortion.shift_mm == 0.5
    assert options.errors.tip_rad == pytest.approx(math.radians(1.0))
    assert options.errors.contour_mm == 0.2 and options.errors.clock_s == 0.001
    assert options.errors.encoder_offset_rad == pytest.approx(math.radians(0.05))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--duration", "10"], "duration is 10 s; expected 50 to 5400 s"),
        (["--tumor-mm", "60"], "tumour is 60 mm; expected 8 to 40 mm"),
        (["--rate", "5"], "--rate 5: rate is 5 Hz; expected 20 to 250 Hz"),
        (["--interval-ms", "5000"], "--interval-ms 5000: tracker 'white': period_sd_s is 5"),
        (["--latency-ms", "-1"], "latency_s is -0.001; expected 0 to 0.2"),
        (["--contour-mm", "9"], "contour_mm is 9; expected 0 to 3"),
    ],
)
def test_value_out_of_range_is_one_line(words, message):
    with pytest.raises(InputError, match=message) as error:
        parsed(*words)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["nan", "inf", "much", "1_0", ""])
def test_word_that_is_not_a_number_is_refused(text, capsys):
    with pytest.raises(SystemExit):
        parsed("--rate", text)
    assert "is not a number; expected a decimal number" in capsys.readouterr().err


def test_arguments_describe_the_options_they_were_read_from():
    words = ["--tracker", "aurora", "--duration", "150", "--tumor-mm", "18", "--slow-deg", "0.1"]
    parser = argparse.ArgumentParser()
    add_simulated_case(parser)
    arguments = simulated_case_arguments(parser.parse_args(words))
    assert arguments == words
    assert simulated_case_arguments(parser.parse_args([])) == []
