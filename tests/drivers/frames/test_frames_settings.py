"""What the bytes do not tell: settings of a description, chosen by name in the bench file."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from bench.control.run_record import decode_run
from bench.record.benchfile import load_bench_file
from bench.record.recording import verify
from drivers.base.errors import ConfigurationError
from drivers.frames import (
    FrameDecoder,
    FrameEncoder,
    Frames,
    FramesConfig,
    choices_of,
    load_family,
    shipped,
    vector_mistakes,
)
from drivers.frames._load import family_from, load_toml
from tests.benches import BENCH
from tests.drivers.frames.test_frames_bench import STIM, bench_file, run

DATAGRAM = bytes.fromhex(
    "AF000124FFFAD600035B00FFE7A6FFDD36081C5200FF7E70FEBA0C3FFA1D0023A023C023A0002319230A231C00239523B6239500FFEF02"
    "00E101FAC64942C6"
)
"""A real STIM300's; x is 292, acceleration z 531 538."""


def section(settings: dict[str, str]) -> FramesConfig:
    return FramesConfig(
        name="g", driver="frames", unit="1", axis="x", axes="xyz", description="stim300", settings=settings
    )


def read(settings: dict[str, str], data: bytes = DATAGRAM) -> dict[str, Any]:
    return FrameDecoder(load_family("stim300", settings), rate_hz=125.0, axes="xyz").feed(data).columns


@pytest.mark.parametrize(("axes", "usable"), [("z", True), ("y", False), ("xyz", False)])
def test_axes_that_a_description_lacks_are_refused_with_the_bench_file(axes: str, usable: bool) -> None:
    given = {"description": "kvh_dsp3000", "axes": axes}
    if usable:
        read_in, mistakes = FramesConfig.with_files(given, Path())
        assert (read_in["baudrate"], read_in["rate_hz"], mistakes) == (38_400, 100.0, [])
        assert FramesConfig.with_files(given | {"rate_hz": 50.0}, Path())[0]["rate_hz"] == 50.0
    else:
        with pytest.raises(ConfigurationError, match="has no gyro channel") as refused:
            FramesConfig.with_files(given, Path())
        assert refused.value.found == "axes z"


def test_what_has_the_wrong_type_is_left_to_the_sections_own_check() -> None:
    for given in (
        {"description": 3},
        {"description": "kvh_dsp3000", "settings": {"range": 1}},
        {"description": "kvh_dsp3000", "settings": "none"},
    ):
        assert FramesConfig.with_files(given, Path()) == (given, [])
    assert FramesConfig.with_files({"description": "kvh_dsp3000", "axes": ["y"]}, Path())[0]["axes"] == ["y"]


def test_one_datagram_in_every_output_of_the_data_sheet() -> None:
    """TS1524 rev. 31, equations 1 to 4."""
    assert read({})["rate_x"][0] == read({"gyro_output": "average_rate"})["rate_x"][0] == 292 / 2**14
    turned = read({"gyro_output": "incremental_angle"})
    assert turned["rate_x"][0] == 292 / 2**21
    settings = section({"gyro_output": "incremental_angle"})
    assert Frames.rates(settings, turned, 125.0)["x"][0] == 292 / 2**21 * 125.0
    for words, power in (("2g", 21), ("5g", 20), ("10g", 19), ("30g", 18), ("80g", 16)):
        chosen = {"accelerometer_range": words}
        assert read(chosen)["acc_z"][0] == 531_538 / 2**power
        chosen["accelerometer_output"] = "incremental_velocity"
        assert read(chosen)["acc_z"][0] == 531_538 / 2 ** (power + 3)
    whole = section({"accelerometer_output": "incremental_velocity"})
    assert Frames.accelerations is not None
    found = Frames.accelerations(whole, read(whole.settings), 125.0)
    assert found["z"][0] == pytest.approx(531_538 / 2**22 * 125.0)  # m/s per sample


def test_an_integrated_angle_wraps_at_four_degrees() -> None:
    family = load_family("stim300", {"gyro_output": "integrated_angle"})
    turned = 3.9 + 0.05 * np.arange(8)  # passes +4, where the unit goes on at -4
    sent = (turned + 4.0) % 8.0 - 4.0
    data = FrameEncoder(family, "rate").encode(8, {"rate_x": sent, "counter": 16 * np.arange(8)})
    angle = FrameDecoder(family, rate_hz=125.0, axes="x").feed(data).columns["rate_x"]
    np.testing.assert_allclose(angle[1:], 0.05, atol=2.0**-20)


def test_the_counter_of_a_stim210_shows_what_never_came() -> None:
    """2000 counts a second: 16 a datagram of 125 Hz, modulo 256; when no message is named, bytes count."""
    family = load_family("stim210")
    data = FrameEncoder(family, "rate_counter").encode(20, {"counter": 16 * np.arange(20)})
    gap = data[: 13 * 4] + data[13 * 6 :]
    named = FrameDecoder(family, rate_hz=125.0, axes="xyz", message="rate_counter")
    counter = named.feed(gap).columns["counter"]
    assert (named.counter_modulo, named.counter_step) == (256, 16.0)
    assert (np.diff(counter) % 256 / 16).tolist() == [1] * 3 + [3] + [1] * 13
    unnamed = FrameDecoder(family, rate_hz=125.0, axes="xyz")
    assert unnamed.feed(gap).columns["counter"].tolist() == list(range(18))


def test_an_integrated_angle_in_a_line_wraps_at_a_turn() -> None:
    family = load_family("kvh_dsp3000", {"output": "integrated_angle"})
    lines = b"".join(b"%17.6f   1\r\n" % angle for angle in (359.7, 359.9, 0.1, 0.3))
    columns = FrameDecoder(family, rate_hz=100.0, axes="z").feed(lines).columns
    np.testing.assert_allclose(columns["rate_z"][1:], 0.2, atol=1e-9)
    assert columns["valid"].tolist() == [False, True, True, True]


@pytest.mark.parametrize("name", list(shipped()))
def test_every_choice_of_every_description_can_be_used(name: str) -> None:
    for chosen in choices_of(load_family(name).description):
        assert load_family(name, chosen).forms
    assert not [str(each) for each in vector_mistakes(load_family(name))]


def test_unknown_settings_and_choices_are_refused_with_what_there_is(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"settings.gyro_unit .*gyro_output, inclinometer"):
        load_family("stim300", {"gyro_unit": "rate"})
    with pytest.raises(
        ConfigurationError, match=r"(?s)settings.gyro_output .*'angle'.*average_rate, incremental"
    ):
        load_family("stim300", {"gyro_output": "angle"})
    with pytest.raises(ConfigurationError, match="it has none"):
        load_family("fg333", {"a": "b"})
    file = tmp_path / "bench.toml"
    for driver, line, words in (
        ("frames", 'settings = { gyro_output = "angle" }', "settings.gyro_output"),
        ("frames", "settings = { gyro_output = 3 }", r"gyro\[0\].settings.gyro_output"),
        ("kvh1750", 'settings = { gyro_output = "rate" }', r"gyro\[0\].settings"),
        ("stim300", 'settings = { range = "5g" }', "settings.range"),
    ):
        text = BENCH + STIM.replace('driver = "frames"', f'driver = "{driver}"\n{line}')
        if driver != "frames":
            text = "\n".join(each for each in text.split("\n") if not each.startswith("description"))
        file.write_text(text)
        with pytest.raises(ConfigurationError, match=words):
            load_bench_file(file)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"default": "x"}, "setting.gyro_output.default"),
        ({"choice": {"rate": {"field": {"rat": {}}}}}, "choice.rate.field"),
        (
            {"choice": {"rate": {"field": {"acc": {"scale": {"pow2": 1}}}}}},
            "which setting 'gyro_output' sets too",
        ),
        ({"choice": {"rate": {"message": "rats"}}}, "choice.rate.message"),
        ({"choice": {"rate": {"field": {"rate": {"at": 3}}}}}, "an unknown key"),
        ({"choice": {"rate": {"field": {"rate": {"unit": "g"}}}}}, "rate"),
    ],
)
def test_settings_that_cannot_be_are_named(change: dict[str, Any], words: str) -> None:
    data = copy.deepcopy(load_toml(shipped()["stim300"]))
    data["setting"]["gyro_output"] |= change
    with pytest.raises(ConfigurationError) as refused:
        family_from(data, "mine.toml")
    assert words in str(refused.value)


def test_a_unit_set_to_increments_through_the_bench(tmp_path: Path) -> None:
    """The emulated unit sends what the settings say, and the record is in the same units as ever."""
    line = 'settings = { gyro_output = "incremental_angle", accelerometer_range = "30g" }'
    file = bench_file(tmp_path, STIM.replace("rate_hz = 125", f"rate_hz = 125\n{line}"))
    result = run(file, tmp_path / "run")
    assert result.outcome == "completed", result.reason
    table = pq.read_table(result.folder / "gyro_stim.parquet").to_pandas()
    turning = table.iloc[len(table) // 2 : len(table) // 2 + 500]
    up = 15.041 / 3600 * math.sin(math.radians(39.10))
    assert turning["rate_y_dps"].mean() == pytest.approx(5.0 + up, abs=0.1)  # z lies level, so y is up
    assert [str(problem) for problem in verify(result.folder, decode_run).problems] == []
