"""Procedures by name and their parameters: every mistake is named with what was meant."""

import pytest

from bench.control.parameter_facts import parameter_facts
from bench.control.procedure import (
    Demands,
    Parameters,
    Procedure,
    find_procedure,
    load_procedures,
    parameter,
    parameter_rows,
)
from drivers.base.errors import ConfigurationError


class Shake(Parameters):
    amplitude_deg: float = parameter(1.5, "how far", "deg", gt=0, le=10)
    cycles: int = parameter(3, "how often", ge=1)


SHAKE = Procedure("shake", "A shake", "-", Shake, lambda b, p: None, lambda p: 1.0, lambda p: Demands())


def test_texts_of_the_command_line_become_values():
    parsed = SHAKE.parse({"amplitude_deg": "2.5", "cycles": "4"})
    assert parsed == Shake(amplitude_deg=2.5, cycles=4)
    assert SHAKE.parse({}) == Shake()


def test_every_wrong_parameter_is_named_at_once():
    with pytest.raises(ConfigurationError) as wrong:
        SHAKE.parse({"amplitude_deg": "11", "cycles": "2.5", "amplitud": "1"})
    text = str(wrong.value)
    assert "amplitude_deg = '11'" in text and "less than or equal to 10" in text
    assert "cycles = '2.5'" in text
    assert "amplitud is not a parameter; did you mean 'amplitude_deg'" in text
    assert "gyrobench procedures shake" in text


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "", "1e999"])
def test_a_parameter_must_be_a_finite_number(value):
    with pytest.raises(ConfigurationError, match="amplitude_deg"):
        SHAKE.parse({"amplitude_deg": value})


def test_parameters_are_shown_with_unit_default_and_limits():
    assert parameter_rows(SHAKE) == [
        ("amplitude_deg", "1.5", "deg", "> 0, <= 10", "how far"),
        ("cycles", "3", "", ">= 1", "how often"),
    ]


def test_facts_of_every_kind_of_parameter():
    facts = {fact.name: fact for fact in parameter_facts(find_procedure("standard-test").parameters)}
    grade, noise, cycles = facts["grade"], facts["noise_h"], facts["power_cycles"]
    assert (grade.kind, grade.choices, grade.default) == ("choice", ("fog", "rlg", "mems"), "fog")
    assert (noise.kind, noise.optional, noise.default, noise.unit) == ("number", True, None, "h")
    assert (cycles.kind, cycles.optional, facts["temperatures"].kind) == ("whole", True, "switch")
    low = facts["low_c"]
    assert (low.at_least, low.at_most, low.above, low.limits) == (-70.0, 20.0, None, ">= -70, <= 20")
    headings = parameter_facts(find_procedure("heading-change").parameters)[0]
    assert (headings.kind, headings.optional) == ("text", False)


def test_installed_procedures_are_found_and_near_misses_suggested():
    assert {"zero-bias-cold-shock", "scale-factor-cold-shock"} <= set(load_procedures())
    assert find_procedure("zero-bias-cold-shock").name == "zero-bias-cold-shock"
    with pytest.raises(ConfigurationError, match="did you mean 'scale-factor-cold-shock'"):
        find_procedure("scale-factor-cold-shok")
    with pytest.raises(ConfigurationError, match="lists them"):
        find_procedure("xyzzy")


def test_a_dwell_that_the_search_for_east_cannot_use_is_refused_with_the_parameters():
    with pytest.raises(ConfigurationError, match="step_dwell_s"):
        find_procedure("standard-test").parse({"step_dwell_s": "30"})
