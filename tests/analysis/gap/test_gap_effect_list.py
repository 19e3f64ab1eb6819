"""`gyrobench gap effects`: what it prints of an effect is what a model file takes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from bench.analysis.gap import effect_facts, parse_model
from bench.present.cli.gap._effects import effects
from drivers.base.errors import ConfigurationError
from simulators.effects import catalogue

HEAD = 'format = 1\nname = "n"\n'
NOISE = "[noise]\narw_deg_per_sqrt_h = 0.01\n"


@pytest.mark.parametrize("name", sorted(catalogue()))
def test_a_model_file_takes_an_effect_as_it_is_shown(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    effects(name)
    shown = capsys.readouterr().out
    (facts,) = effect_facts(name)
    assert shown.startswith(name) and all(each["name"] in shown for each in facts["parameters"])
    _, has_text, text = shown.partition("In a model file:")
    if facts["kind"] == "record":
        assert not has_text and "a model file does not have it" in shown
        return
    values = {each["name"]: max(each["low"], 0.5) for each in facts["parameters"]}
    values |= {key: tried[0] for key, tried in facts["shape"].items()}
    for line in text.strip().splitlines():
        sure = line.startswith("sigma")
        filled = re.sub(
            r"(\w+) = \.\.\.", lambda each, s=sure: f"{each[1]} = {1.0 if s else values[each[1]]}", line
        )
        text = text.replace(line, filled)
    if facts["kind"] == "noise":
        text += "" if name == "noise_level" else "arw_deg_per_sqrt_h = 0.01\n"
        assert getattr(parse_model(HEAD + text, "shown").noise, facts["parameters"][0]["name"]) == 0.5
        return
    model = parse_model(HEAD + NOISE + text, "shown")
    (term,) = (*model.terms, *model.channel_terms, *model.disturbances)
    assert term.name == name
    assert list(term.values) == [values[each["name"]] for each in facts["parameters"]]


def test_the_list_has_every_effect_and_those_of_a_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    effects(as_json=True)
    listed = [each["name"] for each in json.loads(capsys.readouterr().out)["effects"]]
    assert listed == list(catalogue())
    effects()
    assert "coil's" in capsys.readouterr().out


def test_a_name_that_is_not_there_has_one_that_is_near() -> None:
    with pytest.raises(ConfigurationError, match="there is no such effect") as wrong:
        effects("shup")
    assert wrong.value.remedy == "did you mean 'shupe'?"
    with pytest.raises(ConfigurationError) as wrong:
        effects("qqqq")
    assert "gyrobench gap effects" in wrong.value.remedy
