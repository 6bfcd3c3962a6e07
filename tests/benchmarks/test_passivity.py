"""The benchmark of passivity finds energy where there is some, and none inside the bound."""

from dataclasses import replace

from benchmarks.passivity import COUPLING, ROUNDING_J, Device, SpringTouch, main, measure, touched


def test_forces_give_out_no_energy_inside_the_bound(capsys):
    assert main(["--touches", "25", "--seed", "3"]) == 0
    assert "0 touches above 0" in capsys.readouterr().out


def test_energy_outside_the_bound_is_found_and_refused():
    for row in measure(10, 4):
        assert row["weak_active_touches"] > 0
        assert row["weak_energy_out_max_j"] > 1e3 * ROUNDING_J
        assert row["weak_refused"]


def test_later_forces_than_stated_give_out_energy():
    late = replace(Device(COUPLING.damping_n_s_m, COUPLING.period_s, COUPLING.delay_s), delay_s=0.1)
    energy = touched(late, lambda normal: SpringTouch(COUPLING, normal), 10, 5)
    assert (energy > ROUNDING_J).any()
