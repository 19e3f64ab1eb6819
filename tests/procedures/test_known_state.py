"""The check before a campaign goes on, from a chamber that is far from where it should be."""

import numpy as np


def test_a_far_temperature_is_reached_by_a_ramp(emulated_bench):
    """As fast as the chamber can is faster than a bench allows: the check would end in its own abort."""
    run = emulated_bench.run(
        "known-state", air_c=-15, ramp_k_per_min=5, air_tolerance_k=5, drift_k_per_10min=5
    )
    assert run.outcome == "completed", run.reason
    air = run.record.chamber(("time_ns", "air_temp_c"))
    cold = np.flatnonzero(air["air_temp_c"] < -10.0)[0]
    assert 6.5 < air["time_ns"][cold] / 60e9 < 9.0
