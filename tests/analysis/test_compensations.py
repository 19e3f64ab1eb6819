"""Compensation files of every kind: read back as written, also those of earlier versions; others are refused."""

from __future__ import annotations

import re
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bench.analysis.calibration import ImuCompensation
from bench.analysis.common.compensation import FittedCompensation, UnitMismatch
from bench.analysis.common.state_file import JSON_ENTRY, read_state, write_state
from bench.analysis.compensations import KINDS, load_compensation
from bench.analysis.heading import HeadingCompensation
from bench.analysis.heading._lagged import Evidence, LaggedModel
from bench.analysis.heading._temperature import ReferenceTemperature
from bench.analysis.rlg import RlgCompensation
from bench.analysis.thermal import Compensation
from bench.analysis.thermal._linear_models import LaggedRidgeModel
from bench.analysis.thermal._stream import Limits
from bench.analysis.whirl import WhirlCompensation
from drivers.base.errors import ConfigurationError, RecordError

OLD = Path(__file__).parent / "old_files"
"""Written by the version before all kinds had one base (a2c2287)."""
NUMBERS = st.floats(-1e6, 1e6)
NAMES = st.text("abcXYZ-019", min_size=1, max_size=8)
SUMS = st.dictionaries(NAMES, st.text("0123456789abcdef", min_size=64, max_size=64), max_size=3)


def made(*shape: int) -> st.SearchStrategy[np.ndarray]:
    return arrays(np.float64, shape, elements=NUMBERS)


@st.composite
def imu(draw: st.DrawFn) -> ImuCompensation:
    parameters = arrays(np.float64, (24,), elements=st.floats(-0.1, 0.1))
    parts = draw(st.tuples(parameters, made(24), made(24, 24), made(2, 3), NUMBERS, NAMES, NUMBERS))
    return ImuCompensation(draw(NAMES), *parts, runs=draw(SUMS), declared=("a doubt",))


@st.composite
def whirl(draw: st.DrawFn) -> WhirlCompensation:
    count = draw(st.integers(0, 4))
    lines, sigmas = tuple(draw(made(count)).tolist()), draw(made(count))
    amplitudes = draw(made(count)) + 1j * draw(made(count))
    plays = {"travels_deg": (10.0, 2.0), "plays_arcsec": np.array([0.5j, 1.0])}
    return WhirlCompensation(draw(NAMES), lines, amplitudes, sigmas, "mean", 1j, **plays, runs=draw(SUMS))


@st.composite
def ring_laser(draw: st.DrawFn) -> RlgCompensation:
    count = draw(st.integers(0, 3))
    names, values = ("T", "dT/dt", "T2")[:count], tuple(draw(made(count)).tolist())
    return RlgCompensation(
        draw(NAMES), names, values, draw(NUMBERS), (0.0, 40.0), (-1.0, 1.0), runs=draw(SUMS)
    )


@st.composite
def heading(draw: st.DrawFn) -> HeadingCompensation:
    terms = draw(st.sampled_from([("lag9", 3), ("lag15", 5)]))
    reference = ReferenceTemperature(draw(made(17)), 0.1, 0.2)
    model = LaggedModel(
        terms[0],
        draw(made(3, terms[1])),
        draw(made(3, terms[1])),
        draw(st.floats(1.0, 1e6)),
        reference,
        0.0,
        40.0,
        draw(made(terms[1])),
        draw(made(3, 4)),
        Evidence(3.0, 1.0, 2.0, 0.1, 0.9),
        4,
        100.0,
    )
    return HeadingCompensation.from_fit(model, draw(NAMES), draw(SUMS))


@st.composite
def thermal(draw: st.DrawFn) -> Compensation:
    model = LaggedRidgeModel.from_state(read_state(OLD / "thermal.gyrocomp")["state"])
    limits = Limits(dict.fromkeys(("t_in", "t_out", "dt_60", "gradient"), (0.0, 1.0)), (-1, 1), (0, 0), 60.0)
    return Compensation(draw(NAMES), model, 10, limits, draw(NUMBERS), 1.0, (), created_utc="2026-11-22")


EVERY = {"imu": imu, "whirl": whirl, "ring_laser": ring_laser, "heading": heading, "thermal": thermal}


def same(one: object, two: object) -> bool:
    """Return whether two contents of files are equal, arrays bit by bit."""
    if isinstance(one, dict) and isinstance(two, dict):
        return one.keys() == two.keys() and all(same(one[key], two[key]) for key in one)
    if isinstance(one, np.ndarray) and isinstance(two, np.ndarray):
        return one.dtype == two.dtype and one.shape == two.shape and one.tobytes() == two.tobytes()
    return type(one) is type(two) and one == two


@pytest.mark.parametrize("kind", EVERY)
@given(data=st.data())
def test_what_is_saved_is_read_back(kind: str, data: st.DataObject, tmp_path_factory) -> None:
    compensation = data.draw(EVERY[kind]())
    first, second = (tmp_path_factory.mktemp("kinds") / name for name in ("any.name", "again"))
    compensation.save(first)
    found = load_compensation(first)
    assert type(found) is type(compensation)
    assert found.describe() == compensation.describe()
    found.save(second)
    assert same(read_state(second), read_state(first))


@pytest.mark.parametrize("name", EVERY)
def test_files_of_the_version_before_are_read(name: str, tmp_path: Path) -> None:
    found, old = load_compensation(OLD / f"{name}.gyrocomp"), read_state(OLD / f"{name}.gyrocomp")
    assert found.unit_id == old.get("unit_id", "")
    runs = old.get("runs") or old.get("training_runs") or {}
    expected = runs if isinstance(runs, dict) else {run["run_id"]: run["checksum"] for run in runs}
    assert dict(found.runs) == expected
    found.save(tmp_path / "new")
    written = read_state(tmp_path / "new")
    moved = {"ring_laser": {"training_runs"}, "whirl": {"play_arcsec", "travel_deg"}}.get(name, set())
    assert all(same(written[key], old[key]) for key in old.keys() - moved)
    assert written.keys() >= {"unit_id", "runs", "software", "created_utc"}


def test_old_numbers_are_what_they_were() -> None:
    whirl_file = load_compensation(OLD / "whirl.gyrocomp")
    assert isinstance(whirl_file, WhirlCompensation)
    assert whirl_file.amplitudes_arcsec.tolist() == [1 + 2j, -0.5j, 0.25]
    assert whirl_file.plays_arcsec.tolist() == [0.125j]
    assert len({type(load_compensation(path)) for path in OLD.iterdir()}) == len(KINDS)


@pytest.mark.parametrize("name", ["thermal", "imu", "whirl", "ring_laser"])
def test_another_unit_is_refused_in_one_way(name: str) -> None:
    compensation = load_compensation(OLD / f"{name}.gyrocomp")
    compensation.require_unit(compensation.unit_id)
    compensation.require_unit("other", force=True)
    with pytest.raises(UnitMismatch, match=f"unit {compensation.unit_id}.*Found: unit other") as refused:
        compensation.require_unit("other")
    assert isinstance(refused.value, ConfigurationError)


def test_a_heading_effect_is_refused_to_another_platform_too() -> None:
    model = load_compensation(OLD / "heading.gyrocomp")
    assert isinstance(model, HeadingCompensation)
    own = HeadingCompensation.from_fit(model.model, "PINS-1", {"log.csv": "ab"})
    assert own.stream("PINS-1").model is model.model
    with pytest.raises(UnitMismatch, match="unit PINS-2"):
        own.stream("PINS-2")
    assert own.software.keys() >= {"gyrobench", "numpy", "python"} and own.created_utc


def changed(value: object, place: tuple[str, ...], to: object) -> object:
    if not place:
        return to
    assert isinstance(value, dict)
    return {**value, place[0]: changed(value[place[0]], place[1:], to)}


@pytest.mark.parametrize(
    ("name", "place", "to", "words"),
    [
        ("imu", ("parameters_si",), np.zeros(23), "parameters of shape"),
        ("imu", ("covariance_si",), np.full((24, 24), np.nan), "covariance_si: not all of it numbers"),
        ("imu", ("lever_arm_m",), [[0.0, 0.0, 0.0]], "lever_m of shape"),
        ("whirl", ("sd_arcsec",), [1.0], "sd_arcsec of shape"),
        ("ring_laser", ("coefficients",), [], "coefficients of shape"),
        ("ring_laser", ("temp_range_c",), [1.0, 2.0, 3.0], "temp_range_c of shape"),
        ("heading", ("gain_dph_per_k",), np.zeros((3, 4)), "of shape"),
        ("heading", ("swing",), np.full((3, 4), np.inf), "swing: not all of it numbers"),
        ("heading", ("reference", "coefficients"), np.zeros((2, 2)), "coefficients of shape"),
        ("thermal", ("unit_id",), None, "KeyError.*unit_id"),
        ("thermal", ("state", "centre"), np.zeros(1), "not a readable"),
        ("thermal", ("inputs", "t_in", "valid_range"), [1.0], "not a readable"),
        ("thermal", ("state", "scale"), np.zeros(14), "scale that is not above zero"),
        ("thermal", ("state", "scale"), np.ones(1), "not a readable"),
        ("thermal", ("k_ref",), 0.0, "ZeroDivisionError"),
        ("thermal", ("step_s",), 0, "step_s is 0"),
        ("whirl", ("travel_deg",), 0.0, "a travel that is not above zero"),
        ("heading", ("tau_s",), 0.0, "tau_s is 0"),
        ("heading", ("reference", "coefficients"), np.zeros(16), "not a readable"),
        ("imu", ("parameters_si",), np.full(24, -1.0), "Singular matrix"),
    ],
)
def test_wrong_shapes_and_what_is_no_number_are_refused(name, place, to, words, tmp_path) -> None:
    state = read_state(OLD / f"{name}.gyrocomp")
    if to is None:
        del state[place[0]]
    else:
        state = changed(state, place, to)
    write_state(tmp_path / "x", state)
    with pytest.raises(RecordError, match=words):
        load_compensation(tmp_path / "x")


def spoilt(path: Path, out: Path, entry: str, content: bytes) -> Path:
    """A copy of a file with another content of one entry."""
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            new.writestr(name, content if name == entry else old.read(name))
    return out


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("text", ["NaN", "Infinity", "-1e999"])
def test_no_number_of_any_file_may_be_none(name: str, text: str, tmp_path: Path) -> None:
    path = OLD / f"{name}.gyrocomp"
    with zipfile.ZipFile(path) as archive:
        described = archive.read(JSON_ENTRY).decode()
        arrays = [entry for entry in archive.namelist() if entry.endswith(".npy")]
        sizes = {entry: len(archive.read(entry)) for entry in arrays}
        contents = {entry: archive.read(entry) for entry in arrays}
    numbers = list(re.finditer(r"(?<=[ \n])-?\d+\.[\de.+-]+(?=[,\n])", described))
    assert len(numbers) > 5
    for number in numbers:
        changed_text = described[: number.start()] + text + described[number.end() :]
        spoilt(path, tmp_path / "x", JSON_ENTRY, changed_text.encode())
        with pytest.raises(RecordError, match="not a readable"):
            load_compensation(tmp_path / "x")
    for entry in arrays:
        for end in (sizes[entry] - 8, sizes[entry] - 1, 20):  # an array that lost its end
            spoilt(path, tmp_path / "x", entry, contents[entry][:end])
            with pytest.raises(RecordError, match="not a readable"):
                load_compensation(tmp_path / "x")
        last = struct.pack("<d", float(text))
        spoilt(path, tmp_path / "x", entry, contents[entry][:-8] + last)
        with pytest.raises(RecordError, match="not all of it numbers"):
            load_compensation(tmp_path / "x")


@pytest.mark.parametrize(
    ("place", "to", "words"),
    [
        (("weights", "input_high"), np.array([-50.0, 3.5, 25.0]), "range is empty"),
        (("weights", "w_output"), np.zeros((2, 3)), "w_output of shape"),
        (("weights", "bias"), np.full(8, np.nan), "not all of it numbers"),
    ],
)
def test_a_network_that_gives_nothing_is_refused(place, to, words, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    shapes = {"w_input": (8, 3), "w_hidden": (8, 2), "bias": (8,), "w_output": (2, 2), "b_output": (2,)}
    network = {
        "settings": {"hidden": 2},
        "weights": {name: rng.normal(size=shape) for name, shape in shapes.items()}
        | {"input_low": np.array([-50.0, -3.5, -15.0]), "input_high": np.array([26.0, 3.5, 25.0])}
        | {"target_mid": np.zeros(2), "target_scale": np.array([0.25, 0.0])},
    }
    state = read_state(OLD / "thermal.gyrocomp") | {"model": "lstm", "state": network}
    write_state(tmp_path / "whole", state)
    load_compensation(tmp_path / "whole")  # a target that was not trained has scale 0
    write_state(tmp_path / "x", changed(state, ("state", *place), to))
    with pytest.raises(RecordError, match=words):
        load_compensation(tmp_path / "x")


@pytest.mark.parametrize("name", ["k_in", "k_relax", "width_c"])
def test_a_grey_box_without_exchange_is_refused(name: str, tmp_path: Path) -> None:
    parameters = {"k_in": 0.02, "k_out": 0.01, "k_layer": 0.2, "k_relax": 5e-4}
    parameters |= {"transition_c": -20.0, "width_c": 8.0}
    state = read_state(OLD / "thermal.gyrocomp") | {"model": "grey_box"}
    linear = {
        "centre": np.zeros(10),
        "scale": np.ones(10),
        "coef": np.ones((10, 2)),
        "intercept": np.zeros(2),
    }
    state["state"] = {"step_s": 10.0, **linear, "parameters": parameters}
    write_state(tmp_path / "whole", state)
    load_compensation(tmp_path / "whole")
    write_state(tmp_path / "x", changed(state, ("state", "parameters", name), 0.0))
    with pytest.raises(RecordError, match="not above zero"):
        load_compensation(tmp_path / "x")


def test_what_is_no_number_is_not_written(tmp_path: Path) -> None:
    bad = ImuCompensation(
        "I", np.full(24, np.nan), np.ones(24), np.eye(24), np.zeros((2, 3)), 0.0, "t22", 1.0
    )
    with pytest.raises(RecordError, match="not all of it numbers"):
        bad.save(tmp_path / "x")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"no zip", "not a readable compensation file"),
        (b'{"format": "recipe-1"}', "not a readable compensation file"),
        (b"PK\x03\x04 cut short", "not a readable compensation file"),
    ],
)
def test_a_file_that_is_none_is_refused(content, words, tmp_path) -> None:
    path = tmp_path / "x.gyrocomp"
    path.write_bytes(content)
    with pytest.raises(RecordError, match=words):
        load_compensation(path)


def test_a_kind_of_a_later_version_is_refused(tmp_path) -> None:
    write_state(tmp_path / "x", {"kind": "odometer", "format": 1})
    with pytest.raises(RecordError, match="kind odometer"):
        load_compensation(tmp_path / "x")


def test_the_loader_of_one_kind_names_the_other() -> None:
    with pytest.raises(RecordError, match=r"imu-calibration.*load_compensation"):
        Compensation.load(OLD / "imu.gyrocomp")


def test_every_kind_of_the_table_is_on_the_base() -> None:
    found = {type(load_compensation(path)): path for path in OLD.iterdir()}
    assert all(issubclass(kind, FittedCompensation) for kind in found)
    assert {kind.KIND for kind in found} == set(KINDS)


def test_a_file_that_is_not_there_is_named(tmp_path) -> None:
    with pytest.raises(ConfigurationError, match="no such compensation file") as told:
        load_compensation(tmp_path / "none.gyrocomp")
    assert "none.gyrocomp" in str(told.value)
