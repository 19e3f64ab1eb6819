"""A lab that is served to one run after another: time begins anew, the bench does not."""

import pytest

from bench.lab.emulated import Plant
from bench.record.recording import Run


def test_the_second_run_begins_at_zero_where_the_first_left_the_bench(bench, fog_file, tmp_path):
    with bench.lab(fog_file, Plant(seed=3)) as lab:
        first, second = (bench.drive(lab.file, tmp_path / name, hold_s=40.0) for name in ("one", "two"))
    assert (first.outcome, second.outcome) == ("completed", "completed"), (first.reason, second.reason)
    assert second.duration_s == pytest.approx(first.duration_s, abs=10.0)
    runs = [Run.open(result.folder) for result in (first, second)]
    for run in runs:
        assert run.manifest.emulated is not None and run.manifest.emulated.seed == 3
        assert "fog_1 fog_mid" in run.manifest.emulated.model
        for table in (run.turntable(), run.chamber(), run.gyro("fog_1")):
            assert 0 <= table["time_ns"][0] < 10e9
        assert 0.0 <= run.events[0]["time_s"] < 10.0
        assert bench.problems(run.place) == []
    ends, begins = runs[0].turntable()["angle_deg"][-1], runs[1].turntable()["angle_deg"][0]
    assert (begins - ends + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.01)
    assert ends == pytest.approx(5.0 * 40.0, abs=20.0)
