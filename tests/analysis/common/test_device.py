"""Where batched arithmetic runs: the stated rule."""

import pytest

from bench.analysis.common import device
from bench.analysis.common.device import compute_device
from drivers.base.errors import ConfigurationError


@pytest.fixture
def no_wish(monkeypatch):
    monkeypatch.delenv(device.VARIABLE, raising=False)


def sees(monkeypatch, tmp_path, driver, count):
    import torch

    path = tmp_path / "version"
    if driver:
        path.touch()
    monkeypatch.setattr(device, "_DRIVER", path)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: count > 0)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)


@pytest.mark.parametrize(
    ("driver", "count", "expected"),
    [(False, 0, "cpu"), (False, 1, "cpu"), (True, 0, "cpu"), (True, 1, "cuda")],
)
def test_cuda_where_there_is_a_driver_and_torch_sees_a_device(
    no_wish, monkeypatch, tmp_path, driver, count, expected
):
    sees(monkeypatch, tmp_path, driver, count)
    assert compute_device() == expected


def test_a_wish_is_followed_or_refused(monkeypatch, tmp_path):
    sees(monkeypatch, tmp_path, True, 2)
    for wish in ("cpu", "cuda", "cuda:1"):
        monkeypatch.setenv(device.VARIABLE, wish)
        assert compute_device() == wish
    for wish in ("cuda:2", "cuda:-1", "cuda:x", "meta", "gpu"):
        monkeypatch.setenv(device.VARIABLE, wish)
        with pytest.raises(ConfigurationError, match=wish):
            compute_device()


def test_no_device_is_a_clear_error(monkeypatch, tmp_path):
    sees(monkeypatch, tmp_path, False, 0)
    monkeypatch.setenv(device.VARIABLE, "cuda")
    with pytest.raises(ConfigurationError, match="0 CUDA devices"):
        compute_device()
