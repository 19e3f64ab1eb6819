"""Calibration certificates in a bench file: checked, written back, and told when they are overdue."""

from pathlib import Path

import pytest

from bench.record.benchfile import bench_file_from, bench_file_text, load_bench_file, overdue
from drivers.base.errors import ConfigurationError

EXAMPLE = Path(__file__).parents[2] / "examples" / "lab.toml"
LEVEL = {
    "quantity": "table_level_deg", "instrument": "level 7", "certificate": "K-1", "date": "2026-05-04",
    "due": "2027-05-04", "uncertainty": 0.006,
}  # fmt: skip


def bench(*calibrations):
    data = load_bench_file(EXAMPLE).model_dump(mode="json", exclude_none=True)
    return bench_file_from(data | {"calibration": list(calibrations)})


@pytest.mark.parametrize(
    ("given", "standard"),
    [
        ({}, 0.003),
        ({"k": 3.0}, 0.002),
        # JCGM 100, 4.3.7, 4.3.9 and H.6: half width over the square root of 3, 6 and 2
        ({"distribution": "rectangular"}, 0.0034641016),
        ({"distribution": "triangular"}, 0.0024494897),
        ({"distribution": "arcsine"}, 0.0042426407),
    ],
)
def test_the_standard_uncertainty_follows_from_k_or_the_distribution(given, standard):
    assert bench(LEVEL | given).calibration[0].standard_uncertainty == pytest.approx(standard, rel=1e-7)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ([LEVEL | {"due": "2026-05-03"}], "due on 2026-05-03, before its date"),
        ([LEVEL | {"k": 2.0, "distribution": "rectangular"}], "has a half width"),
        ([LEVEL | {"quantity": "table_tilt_deg"}], r"calibration\[0\]\.quantity.*table_level_deg"),
        ([LEVEL | {"uncertainty": 0}], r"calibration\[0\]\.uncertainty"),
        ([LEVEL | {"date": "yesterday"}], r"calibration\[0\]\.date.*the day of the calibration"),
        ([LEVEL, LEVEL], "a quantity twice"),
    ],
)
def test_a_wrong_certificate_is_refused(wrong, says):
    with pytest.raises(ConfigurationError, match=says):
        bench(*wrong)


def test_a_bench_file_with_certificates_reads_back_equal(tmp_path):
    file = bench(LEVEL, LEVEL | {"quantity": "time_base_ppm", "error": -1.5, "issued_by": "us"})
    (tmp_path / "copy.toml").write_text(bench_file_text(file), encoding="utf-8")
    assert load_bench_file(tmp_path / "copy.toml").calibration == file.calibration


def test_the_last_day_still_counts():
    certificates = bench(LEVEL).calibration
    assert overdue(certificates, "2027-05-04T23:59:59.000+00:00") == []
    assert overdue(certificates, "2027-05-05T00:00:00.000+00:00") == list(certificates)
