"""The compensation file and what it does to a series, a stream, another unit's data; the choice of a model."""

from __future__ import annotations

import json
import pickle
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from bench.analysis.common.compensation import UnitMismatch
from bench.analysis.compensations import load_compensation
from bench.analysis.thermal import FeatureRun, Prediction, ThermalModel, ThermalRun, prepare
from bench.analysis.thermal._compensation import Compensation
from bench.analysis.thermal._linear_models import MultilinearModel
from bench.analysis.thermal._registry import model_names, new_model
from bench.analysis.thermal._selection import fit_models, score_models
from bench.analysis.thermal._stream import FeatureStream, Flag
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError, RecordError

FAST = ("poly3", "multilinear", "stepwise", "lag_ridge", "lag_ridge_x_temp", "grey_box")


def one_pole(x: Array, tau_s: float) -> Array:
    a = np.exp(-1.0 / tau_s)
    return np.asarray(lfilter([1 - a], [1, -a], x - x[0]) + x[0])


def thermal_run(seed: int, low_c: float, rate_c_per_min: float, kind: str = "both") -> ThermalRun:
    rng = np.random.default_rng(seed)
    time = np.arange(1.0, 7001.0)
    cooling_s = 60 * (25.0 - low_c) / rate_c_per_min
    air = np.interp(time, [1800, 1800 + cooling_s, 4500, 4500 + cooling_s], [25.0, low_c, low_c, 25.0])
    case, inside = one_pole(air, 120.0), one_pole(air, 400.0)
    noise = rng.normal(0.0, 1.0, (4, time.size))
    bias = 2e-3 * (one_pole(inside, 600.0) - 25) + 1.8 * np.gradient(inside) + 0.02 * noise[0]
    sf = 5.0 * (one_pole(inside, 1200.0) - 25) + 5.0 * noise[1]
    return ThermalRun(
        f"{kind}-{seed}", "unit A", time, inside + 0.01 * noise[2], case + 0.01 * noise[3],
        bias if kind != "sf" else None, sf if kind != "bias" else None, (600.0, 1800.0), checksum=f"{seed:064x}",
    )  # fmt: skip


@pytest.fixture(scope="module")
def runs() -> dict[str, list[FeatureRun]]:
    train = [thermal_run(1, -41, 11, "bias"), thermal_run(2, -50, 13, "bias"), thermal_run(3, -42, 14, "sf")]
    return {"train": [prepare(run) for run in train], "validation": [prepare(thermal_run(5, -46, 12))]}


@pytest.fixture(scope="module")
def models(runs: dict[str, list[FeatureRun]]) -> dict[str, ThermalModel]:
    return fit_models(runs["train"], runs["validation"], FAST)


@pytest.fixture(scope="module")
def compensation(runs: dict[str, list[FeatureRun]], models: dict[str, ThermalModel]) -> Compensation:
    scores = score_models(models, runs["validation"])
    return Compensation.from_fit(
        models["lag_ridge"], runs["train"], runs["validation"], scores=scores, k_ref=1.25
    )


@pytest.fixture(scope="module")
def live() -> ThermalRun:
    """A run with holes: no temperature for five seconds, then at 2 min and for longer than the window."""
    run = thermal_run(9, -44, 12)
    inside, case = run.gyro_temp_c.copy(), run.case_temp_c.copy()
    inside[:5] = case[120:123] = inside[2000:2150] = np.nan
    return replace(run, gyro_temp_c=inside, case_temp_c=case)


@pytest.mark.parametrize("name", FAST)
def test_every_model_survives_the_file(
    name: str, models: dict[str, ThermalModel], runs: dict[str, list[FeatureRun]], tmp_path: Path
) -> None:
    run = runs["validation"][0]
    saved = Compensation.from_fit(models[name], runs["train"], runs["validation"])
    saved.save(tmp_path / "a.gyrocomp")
    loaded = load_compensation(tmp_path / "a.gyrocomp")
    assert isinstance(loaded, Compensation)
    before, after = saved.model.predict(run), loaded.model.predict(run)
    np.testing.assert_array_equal(before.bias_dph, after.bias_dph)
    np.testing.assert_array_equal(before.sf_error_ppm, after.sf_error_ppm)
    assert loaded.describe() == saved.describe()
    loaded.save(tmp_path / "b.gyrocomp")
    assert (tmp_path / "a.gyrocomp").read_bytes() == (tmp_path / "b.gyrocomp").read_bytes()


def test_papers_say_what_it_is(compensation: Compensation, runs: dict[str, list[FeatureRun]]) -> None:
    papers = json.loads(json.dumps(compensation.describe(), allow_nan=False))
    usable = np.concatenate([run.t_in[run.weight > 0] for run in runs["train"]])
    assert papers["inputs"]["t_in"] == {"unit": "degC", "valid_range": [usable.min(), usable.max()]}
    assert papers["unit_id"] == "unit A" and papers["model"] == "lag_ridge" and papers["step_s"] == 10
    assert [run["checksum"] for run in papers["training_runs"]] == [f"{seed:064x}" for seed in (1, 2, 3)]
    assert papers["training_runs"][2]["targets"] == ["sf_error_ppm"]
    assert {score["name"] for score in papers["scores"]} == set(FAST)
    assert {"gyrobench", "numpy", "torch", "python"} <= set(papers["software"])
    assert papers["reference_temp_c"] == pytest.approx(25.0, abs=0.1)
    assert papers["trained_from_s"] == 601.0


def test_correction_inverts_the_gyro_equation(compensation: Compensation) -> None:
    """F = K_ref (W (1 + dK) + b), built here from the drift, must come back as W."""
    run = thermal_run(9, -44, 12)
    bias_dph, sf_ppm, _ = compensation.drift(run)
    assert np.ptp(bias_dph) > 0.1 and np.ptp(sf_ppm) > 200
    output = 1.25 * (20.0 * (1 + sf_ppm * 1e-6) + bias_dph / 3600.0)
    corrected = compensation.apply("unit A", run.time_s, run.gyro_temp_c, run.case_temp_c, output)
    np.testing.assert_allclose(corrected.rate_dps, 20.0, rtol=1e-14)


def test_a_run_it_has_not_seen_comes_out_flat(compensation: Compensation) -> None:
    run = thermal_run(9, -44, 12)
    bias_dph, sf_ppm, flags = compensation.drift(run)
    assert run.bias_dph is not None and run.sf_error_ppm is not None
    used = run.time_s > 700
    means = [
        np.nanstd(series[used][:6300].reshape(-1, 100).mean(axis=1))
        for series in (run.bias_dph, run.bias_dph - bias_dph, run.sf_error_ppm, run.sf_error_ppm - sf_ppm)
    ]
    assert means[1] < 0.15 * means[0] and means[3] < 0.05 * means[2]
    assert not (flags[used] & Flag.CLAMPED).any()


@pytest.mark.parametrize("name", ["multilinear", "stepwise", "lag_ridge", "grey_box"])
def test_a_stream_is_the_series(
    name: str, models: dict[str, ThermalModel], runs: dict[str, list[FeatureRun]], live: ThermalRun
) -> None:
    compensation = Compensation.from_fit(models[name], runs["train"])
    output = np.full(live.time_s.size, 20.0)
    output[3000] = np.nan
    series = compensation.apply("unit A", live.time_s, live.gyro_temp_c, live.case_temp_c, output)
    stream = compensation.stream("unit A")
    columns = (live.time_s, live.gyro_temp_c, live.case_temp_c, output)
    pushed = [stream.push(*map(float, row)) for row in zip(*columns, strict=True)]
    np.testing.assert_array_equal([int(sample.flags) for sample in pushed], series.flags)
    np.testing.assert_allclose([sample.bias_dph for sample in pushed], series.bias_dph, atol=1e-8)
    np.testing.assert_allclose([sample.sf_error_ppm for sample in pushed], series.sf_error_ppm, atol=1e-5)
    np.testing.assert_allclose([sample.rate_dps for sample in pushed], series.rate_dps, rtol=1e-11)


def test_features_of_a_stream_are_those_of_a_recorded_run(live: ThermalRun) -> None:
    run = replace(live, **{key: getattr(live, key)[5:] for key in ("time_s", "gyro_temp_c", "case_temp_c",
                                                                   "bias_dph", "sf_error_ppm")})  # fmt: skip
    recorded, stream = prepare(run), FeatureStream(10)
    pairs = zip(run.gyro_temp_c, run.case_temp_c, strict=True)
    rows = np.array([row for pair in pairs if (row := stream.push(*map(float, pair))) is not None])
    expected = np.column_stack([recorded.t_in, recorded.t_out, recorded.dt_60, recorded.gradient])
    np.testing.assert_allclose(rows, expected, atol=1e-9)


def test_flags_tell_what_is_doubtful(compensation: Compensation) -> None:
    run = thermal_run(9, -44, 12)
    stream = compensation.stream("unit A")

    def push(second: float, gyro: float = 25.0, case: float = 25.0, rate: float = 20.0) -> Flag:
        return stream.push(second, gyro, case, rate).flags

    assert push(1.0, np.nan) == Flag.MISSING | Flag.EARLY | Flag.NO_DRIFT
    assert push(2.0) == Flag.RESTARTED | Flag.EARLY
    assert push(3.0) == Flag.EARLY and push(601.0) & Flag.LATE and push(602.0) == 0
    assert push(603.0, rate=np.nan) == Flag.MISSING
    assert push(605.0) == Flag.LATE and push(604.0) == Flag.LATE and push(606.0) == 0
    assert push(2000.0) == Flag.RESTARTED | Flag.LATE
    hot = [push(2000.0 + k, 60.0, 60.0) for k in range(1, 120)]
    assert hot[-1] & Flag.OUT_OF_RANGE
    colder = replace(run, gyro_temp_c=run.gyro_temp_c - 200.0, case_temp_c=run.case_temp_c - 200.0)
    _, sf_ppm, flags = compensation.drift(colder)
    assert (flags & Flag.CLAMPED).any() and sf_ppm.min() >= compensation.limits.sf_error_ppm[0]
    assert (flags & Flag.OUT_OF_RANGE).all()


def test_another_unit_is_refused_unless_forced(compensation: Compensation) -> None:
    other = replace(thermal_run(9, -44, 12), unit_id="unit B")
    with pytest.raises(UnitMismatch, match=r"unit B.*unit A"):
        compensation.drift(other)
    with pytest.raises(UnitMismatch):
        compensation.stream("unit B")
    with pytest.raises(UnitMismatch):
        compensation.apply("unit B", other.time_s, other.gyro_temp_c, other.case_temp_c, other.time_s)
    forced = compensation.drift(other, force_unit=True)[0]
    np.testing.assert_array_equal(forced, compensation.drift(replace(other, unit_id="unit A"))[0])


class _Bomb:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (Path.touch, (Path("exploded"),))  # type: ignore[return-value]  # what a hostile file would hold


def test_damaged_foreign_and_hostile_files_are_refused(
    compensation: Compensation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    good, bad = tmp_path / "good.gyrocomp", tmp_path / "bad.gyrocomp"
    compensation.save(good)
    assert [path.name for path in tmp_path.iterdir()] == ["good.gyrocomp"]
    content = good.read_bytes()
    bad.write_bytes(content[: len(content) // 2])
    with pytest.raises(RecordError, match="not a readable compensation"):
        Compensation.load(bad)
    with zipfile.ZipFile(good) as archive, zipfile.ZipFile(bad, "w") as copy:
        for name in archive.namelist():
            data = archive.read(name)
            if name.endswith("coef.npy"):
                data = data[:10] + data[10:].replace(b"'<f8'", b"'|O'  ").split(b"\n")[0] + b"\n"
                data += pickle.dumps(np.array([_Bomb()], dtype=object))
            copy.writestr(name, data)
    with pytest.raises(RecordError, match="not a readable compensation"):
        Compensation.load(bad)
    assert not (tmp_path / "exploded").exists()
    with zipfile.ZipFile(bad, "w") as copy:
        copy.writestr("compensation.json", json.dumps({"format": 99}))
    with pytest.raises(RecordError, match="another kind or format"):
        Compensation.load(bad)


def test_the_validation_run_chooses(
    models: dict[str, ThermalModel], runs: dict[str, list[FeatureRun]]
) -> None:
    table = score_models(models, runs["validation"])
    assert [row.score for row in table] == sorted(row.score for row in table)
    assert table[-1].name == "poly3", "the unit is a sum of lags, a static model the worst"
    scored = {row.name: row for row in table}
    assert scored["poly3"].score > 3 * scored["lag_ridge"].score


class Offset:
    """Right up to a constant and a known error in the second half."""

    name = "offset"

    def __init__(self, error: float) -> None:
        self.error = error

    def predict(self, run: FeatureRun) -> Prediction:
        assert run.bias_dph is not None and run.sf_error_ppm is not None
        wrong = np.where(run.time_s >= 1800.0, self.error, 0.0)
        return Prediction(run.bias_dph + 7.0 + wrong, run.sf_error_ppm - 70.0)


def test_score_is_what_is_left_over_what_was_there(runs: dict[str, list[FeatureRun]]) -> None:
    run = runs["validation"][0]
    used = run.weight > 0
    assert run.bias_dph is not None
    (row,) = score_models({"offset": Offset(0.3)}, [run])  # type: ignore[dict-item]  # only predict is used
    share = np.mean(run.time_s[used] >= 1800.0)
    raw = np.sqrt(np.mean(run.bias_dph[used] ** 2))
    assert row.bias_rms_dph == pytest.approx(0.3 * np.sqrt(share), rel=1e-9)
    assert row.sf_rms_ppm == pytest.approx(0.0, abs=1e-9)
    assert row.score == pytest.approx(0.5 * 0.3 * np.sqrt(share) / raw, rel=1e-9)


def test_names_are_names(models: dict[str, ThermalModel], runs: dict[str, list[FeatureRun]]) -> None:
    for name in model_names():
        assert new_model(name).name == name
    with pytest.raises(ConfigurationError, match=r"'lstn'.*lstm"):
        new_model("lstn")
    with pytest.raises(ConfigurationError, match="no validation run"):
        score_models(models, [])
    with pytest.raises(ConfigurationError, match="cannot be fitted together"):
        Compensation.from_fit(
            MultilinearModel(), [runs["train"][0], replace(runs["train"][1], unit_id="unit B")]
        )
