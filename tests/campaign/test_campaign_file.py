"""The campaign file: what it may say, and every mistake in it told before anything moves."""

import shutil
from itertools import pairwise

import pytest

from bench.campaign import (
    bench_of,
    check_limits,
    load_campaign,
    not_measured,
    plan_campaign,
)
from bench.control.disk import check_disk, estimated_bytes
from drivers.base.errors import ConfigurationError, LimitExceeded


def test_units_take_their_place_on_the_bench_in_the_campaigns_order(campaign_path, bench_file):
    campaign = load_campaign(campaign_path, bench_file)
    file = bench_of(campaign, bench_file)
    assert [(gyro.name, gyro.unit, gyro.port) for gyro in file.gyro] == [
        ("fog_2", "FOG-002", "/dev/ttyUSB3"),
        ("fog_1", "FOG-007", "/dev/ttyUSB9"),
    ]
    assert [run.name for run in campaign.runs] == ["turn-1", "turn-2", "last"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('serial = "FOG-002"', 'serial = "FOG-020"', ["FOG-020 is not on the bench", "did you mean FOG-002"]),
        ('gyro = "fog_1"', 'gyro = "fog_9"', ["no gyro 'fog_9'", "fog_1 (FOG-001)"]),
        ('gyro = "fog_1"', 'gyro = "fog_2"', ["FOG-002 and FOG-007 are both on gyro 'fog_2'"]),
        ('"/dev/ttyUSB9"', '"/dev/ttyUSB0"', ["port", "/dev/ttyUSB0", "a port of its own"]),
        ('"/dev/ttyUSB9"', '"/dev/ttyUSB3"', ["/dev/ttyUSB3", "a port of its own"]),
        ('procedure = "constant-rotation"', 'procedure = "constant-rotatoin"', ["mean 'constant-rotation'"]),
        ("rate_dps = 12", "rate_dsp = 12", ["run turn", "rate_dsp is not a parameter", "'rate_dps'"]),
        ("rate_dps = 12", "rate_dps = 0.01", ["at least 0.1 deg/s"]),
        ('name = "last"', 'name = "turn-2"', ["runs of the same name: turn-2"]),
        ('name = "last"', 'name = "../last"', ["run 2 name", "../last"]),
        ('name = "last"', 'name = "turn.2"', ["run 2 name"]),
        ("repeats = 2", "repeats = 0", ["run 1 repeats", "greater than or equal to 1"]),
        ("repeats = 2", "repeat = 2", ["run 1 repeat: an unknown key"]),
        ("title", "tilte", ["title", "field required"]),
        ('title = "Short turns"', 'title = "x"\ngyro = "fog_3"', ["'fog_3' is not under test"]),
        ('title = "Short turns"', 'title = "x"\ngyro = "fog_1"', ["no run has role = 'training'"]),
        ('title = "Short turns"', "title = ", ["invalid"]),
        ("[[run]]", "[[notify]]\n[[run]]", ["notify 1", "one of command, webhook and file"]),
        ("[[run]]", '[[notify]]\ncommand = "rm -rf /"\n[[run]]', ["notify 1 command"]),
        ("[[run]]", '[[notify]]\nwebhook = "file:///etc/passwd"\n[[run]]', ["notify 1 webhook"]),
    ],
)
def test_a_mistake_is_told_with_its_place(campaign_path, bench_file, old, new, words):
    text = campaign_path.read_text()
    assert old in text
    campaign_path.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigurationError) as told:
        load_campaign(campaign_path, bench_file)
    said = str(told.value)
    assert all(word.lower() in said.lower() for word in words), said
    assert str(campaign_path) in said


def test_all_mistakes_are_told_at_once(campaign_path, bench_file):
    text = campaign_path.read_text().replace("FOG-002", "FOG-2").replace("turns = 1", "turns = 0")
    campaign_path.write_text(text)
    with pytest.raises(ConfigurationError) as told:
        load_campaign(campaign_path, bench_file)
    assert "FOG-2 is not on the bench" in str(told.value) and "run last" in str(told.value)


SHOCK = """
[[run]]
name = "shock"
procedure = "zero-bias-cold-shock"
parameters = { cold_c = -55, ramp_k_per_min = 30 }
"""


def test_what_a_limit_forbids_is_refused_with_the_run(campaign_path, bench_file):
    campaign_path.write_text(
        campaign_path.read_text()
        .replace("rate_dps = -12", "rate_dps = -25")
        .replace("turns = 1", "turns = 3")
        + SHOCK
    )
    campaign = load_campaign(campaign_path, bench_file)
    for refuse in (check_limits, lambda *both: plan_campaign(*both, None)):
        with pytest.raises(LimitExceeded) as told:
            refuse(campaign, bench_file)
        said = str(told.value)
        assert "last: 25 deg/s" in said and "shock: -55 .. 25 degC" in said and "shock: 30 K/min" in said
        assert "turn" not in said.replace("turns", "") and "-50 .. 85 degC" in said


def test_a_quick_plan_adds_up(campaign_path, bench_file):
    campaign_path.write_text(campaign_path.read_text() + SHOCK.replace("-55, ramp_k_per_min = 30", "-45"))
    planned = plan_campaign(load_campaign(campaign_path, bench_file), bench_file, None)
    assert [row.run.name for row in planned] == ["turn-1", "turn-2", "last", "shock"]
    assert planned[0].start_s == 0.0
    for before, after in pairwise(planned):
        assert after.start_s == before.end_s
    # two turns at 12 deg/s are 60 s, with 10 s of rest at both ends
    assert 80.0 <= planned[0].duration_s <= 150.0
    assert [row.chamber_s > 0.0 for row in planned] == [False, False, False, True]


def test_a_disk_that_is_too_small_is_the_one_of_the_folder_to_be(
    campaign_path, bench_file, tmp_path, monkeypatch
):
    campaign = load_campaign(campaign_path, bench_file)
    needed = estimated_bytes(campaign.expected_duration_s(), bench_of(campaign, bench_file))
    seconds = sum(run.test.expected_duration_s(run.values) for run in campaign.runs)
    raw = 36 * 20 * seconds  # two KVH 1750 at 10 Hz, frames of 36 bytes
    assert raw < needed < 10 * raw
    asked = []

    def usage(path):
        asked.append(path)
        return shutil._ntuple_diskusage(2 * needed, needed + 1, needed - 1)

    monkeypatch.setattr(shutil, "disk_usage", usage)
    with pytest.raises(LimitExceeded, match="does not fit"):
        check_disk(needed, tmp_path / "new" / "monday", "the campaign", "--out")
    assert asked == [tmp_path]
    check_disk(needed - 1, tmp_path, "the campaign", "--out")


STANDARD = """
[[run]]
name = "figures"
procedure = "standard-test"
repeats = 1
parameters = { power_cycles = 0, sequences = 1, temperatures = false }
[limits."bias"]
unit = "deg/h"
high = 1.0
[limits."bias repeatability"]
unit = "deg/h"
high = 1.0
[limits."bias temperature sensitivity"]
unit = "deg/h/degC"
high = 1.0
"""


@pytest.mark.parametrize(
    ("old", "new", "missing"),
    [
        ("", "", ["bias repeatability", "bias temperature sensitivity"]),
        ("temperatures = false", "temperatures = true", ["bias repeatability"]),
        ("repeats = 1", "repeats = 2", ["bias temperature sensitivity"]),
        ("power_cycles = 0", "power_cycles = 1", ["bias temperature sensitivity"]),
        ('"standard-test"', '"zero-bias-cold-shock"', None),
    ],
)
def test_limits_that_no_run_measures_are_told(campaign_path, bench_file, old, new, missing):
    text = campaign_path.read_text() + STANDARD.replace(old, new)
    if missing is None:
        text = text.replace("{ power_cycles = 0, sequences = 1, temperatures = false }", "{}")
    campaign_path.write_text(text)
    campaign = load_campaign(campaign_path, bench_file)
    assert not_measured(campaign) == (missing or list(campaign.limits))
