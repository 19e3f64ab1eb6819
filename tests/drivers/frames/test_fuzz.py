"""A portion of `make fuzz`: no decoder raises on any bytes, and no frame comes out whose check does not hold."""

import pytest

from benchmarks.fuzz import fuzz, names


@pytest.mark.parametrize("name", names())
def test_bytes_that_no_device_sent(name: str) -> None:
    found = fuzz(name, 60_000, seed=20)
    assert found.mistakes == []
    assert found.bytes_offered >= 60_000


@pytest.mark.parametrize("name", names())
def test_the_damaged_third_has_frames_in_it(name: str) -> None:
    assert fuzz(name, 60_000, seed=21).frames > 20, "a decoder that is never given a frame of its own"
