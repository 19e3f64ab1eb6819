"""Labs that are forked: each its own, each gone when its door closes, all gone with the nursery."""

import os

import pytest

from bench.emulated import EmulatedLab, Plant
from bench.nursery import LabNursery
from bench.testing import usual_bench
from drivers.errors import BenchError, ConfigurationError


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_forked_labs_are_labs_of_their_own():
    file = usual_bench(None)
    with LabNursery() as nursery:
        with (
            EmulatedLab(file, Plant(), start=nursery.start_lab) as one,
            EmulatedLab(file, Plant(), start=nursery.start_lab) as two,
        ):
            pids = [lab._process._pid for lab in (one, two)]
            assert all(map(alive, pids)) and one.clock_url != two.clock_url
            assert not set(one.ports.values()) & set(two.ports.values())
            one.perform({"act": "mount", "unit": "fog_1", "mounting": "axis_up"})
        assert not any(map(alive, pids))
        left = EmulatedLab(file, Plant(), start=nursery.start_lab)
        left._process.kill()
        with pytest.raises(BenchError, match="ended before"):
            left.perform({"act": "mount", "unit": "fog_1", "mounting": "axis_up"})
        left.close()
    with pytest.raises((BenchError, ConfigurationError)):
        EmulatedLab(file, Plant(), start=nursery.start_lab)
