"""A campaign that grows, and a search for the missing effect on an emulated bench, stopped and resumed."""

import json
from pathlib import Path

import pytest

from bench.campaign import CampaignFolder, CampaignRunner, resume_campaign
from bench.campaign._file import CampaignRun
from bench.campaign.hunt import DECIDED, Hunt, HuntSettings, begin_hunt, steps_of
from bench.lab.emulated import Plant
from bench.record.benchfile import load_bench_file
from bench.record.events.campaign import NextRun, RunAdded, Sought
from drivers.base.errors import ConfigurationError

MODEL = Path(__file__).parents[2] / "examples" / "nominal" / "fog_on_its_bench.toml"
TRUTH = """
format = 1
name = "true unit"
[noise]
arw_deg_per_sqrt_h = 0.003
bias_instability_dph = 0.004
[[effect]]
name = "scale_factor_asymmetry"
parameters = { asymmetry_ppm = 12.0 }
sigma = { asymmetry_ppm = 1.0 }
"""


def turn(name, **parameters):
    return CampaignRun(name=name, procedure="constant-rotation", parameters={"rest_s": 10} | parameters)


def test_a_campaign_goes_on_with_what_is_added_and_a_copy_of_its_file_has_it(
    tmp_path, campaign_path, bench_file
):
    folder = CampaignFolder.create(tmp_path / "out", campaign_path, bench_file, Plant(seed=5), False)
    more = [turn("more", rate_dps=12, turns=1), turn("again", rate_dps=-12, turns=1)]
    ending = CampaignRunner(folder, further=lambda: more.pop(0) if more else None).run()
    assert ending.outcome == "completed", ending.reason
    assert [state.run.name for state in ending.states] == ["turn-1", "turn-2", "last", "more", "again"]
    read = CampaignFolder(tmp_path / "out")
    assert [state.state for state in read.states(thorough=True)] == ["done"] * 5
    added = [event for _, event in read.events() if isinstance(event, RunAdded)]
    assert [event.run for event in added] == ["more", "again"]
    assert added[-1].file_sha256 == read.campaign.sha256


def test_what_is_added_keeps_to_the_limits_and_costs_nothing_that_was_recorded(
    tmp_path, campaign_path, bench_file
):
    folder = CampaignFolder.create(tmp_path / "out", campaign_path, bench_file, Plant(seed=5), False)
    ending = CampaignRunner(folder, further=lambda: turn("fast", rate_dps=500)).run()
    assert ending.outcome == "failed" and "500 deg/s" in ending.reason
    assert [state.state for state in ending.states] == ["done"] * 3


def test_a_run_as_toml_is_the_run_that_was_read(tmp_path, bench_file):
    run = turn("a-1", rate_dps=-6.5, turns=3.0, reversals=2)
    flags = CampaignRun(name="b", procedure="thermal-ramp", parameters={"both_directions": False})
    path = tmp_path / "campaign.toml"
    path.write_text(f'title = "x"\n{run.toml()}\n{flags.toml()}')
    folder = CampaignFolder.create(tmp_path / "out", path, bench_file, Plant(), False)
    assert folder.campaign.run == (run, flags)


@pytest.fixture(scope="module")
def searched(tmp_path_factory, texts):
    """A search that was stopped after every run, each time gone on with by another process' objects."""
    root = tmp_path_factory.mktemp("hunt")
    alone = texts[0].split('[[gyro]]\nname = "fog_2"')[0]  # a second unit would only take time
    (root / "bench.toml").write_text(alone.replace("max_rate_dps = 20", "max_rate_dps = 100"))
    (root / "truth.toml").write_text(TRUTH)
    plant = Plant(seed=11, mount_azimuth_error_deg=0.0, gap_model={"FOG-001": root / "truth.toml"})
    settings = HuntSettings(budget_h=4.5, until=0.8)
    file = load_bench_file(root / "bench.toml")
    begin_hunt(root / "out", file, MODEL, settings, plant=plant)
    for _ in range(6):
        hunt = Hunt(resume_campaign(root / "out"))
        if hunt.end is not None:
            break
        runs = len(hunt.folder.campaign.runs)

        def one_more(hunt=hunt, runs=runs):
            return hunt.next_run() if len(hunt.folder.campaign.runs) == runs else None

        ending = CampaignRunner(hunt.folder, further=one_more).run()
        assert ending.outcome == "completed", ending.reason
    return root


def test_a_search_finds_the_effect_and_sees_it_again(searched):
    hunt = Hunt(CampaignFolder(searched / "out"))
    end = hunt.end
    assert end.acts == "scale_factor_asymmetry" and end.probability > 0.8
    assert (end.ended, end.confirmed) == (DECIDED, True)
    assert hunt.next_run() is None
    first, *others = steps_of(hunt)
    # half an hour of rates of both signs shows it, what follows is made to see it again
    assert first.chosen.procedure == "rates-over-temperature" and first.chosen.to_confirm is False
    assert first.after.acts == "scale_factor_asymmetry" and first.after.gained_nats > 1.0
    assert others and all(each.chosen.to_confirm for each in others)
    assert (
        len({(each.chosen.procedure, each.chosen.parameters) for each in (first, *others)}) == len(others) + 1
    )
    assert end.used_h <= 4.5


def test_every_step_is_in_the_journal_once(searched):
    events = [event for _, event in CampaignFolder(searched / "out").events()]
    kinds = [event.kind for event in events if isinstance(event, Sought | NextRun)]
    thought = [event for event in events if isinstance(event, Sought)]
    assert kinds == ["sought", *(len(thought) - 1) * ["next_run", "sought"]]
    assert [len(event.after) for event in thought] == list(range(len(thought)))
    assert all(sum(event.probabilities.values()) == pytest.approx(1.0) for event in thought)
    lines = (searched / "out" / "events.jsonl").read_text().splitlines()
    assert all(json.loads(line) for line in lines)


def test_a_search_that_cannot_begin_says_what_would_help(searched, tmp_path, bench_file):
    with pytest.raises(ConfigurationError, match="no run fits into the bench time"):
        begin_hunt(tmp_path / "a", bench_file, MODEL, HuntSettings(budget_h=0.1, until=0.9))
    with pytest.raises(ConfigurationError, match="no such gyro"):
        begin_hunt(tmp_path / "a", bench_file, MODEL, HuntSettings(budget_h=9, until=0.9, gyro="x"))
    with pytest.raises(ConfigurationError, match="not empty"):
        begin_hunt(searched / "out", bench_file, MODEL, HuntSettings(budget_h=9, until=0.9))
    with pytest.raises(ConfigurationError, match="no search"):
        Hunt(CampaignFolder.create(tmp_path / "b", *plain_campaign(tmp_path, bench_file)))
    assert not (tmp_path / "a").exists()


def plain_campaign(tmp_path, bench_file):
    path = tmp_path / "plain.toml"
    path.write_text(f'title = "x"\n{turn("one", turns=1).toml()}')
    return path, bench_file, Plant(), False
