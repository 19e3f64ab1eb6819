"""A procedure's parameters as options of `run` and `rehearse`."""

import pytest

from bench.control.procedure import find_procedure, load_procedures
from bench.present.cli._settings import OWN_OPTIONS, settings_of
from drivers.base.errors import ConfigurationError


@pytest.mark.parametrize(
    ("options", "settings"),
    [
        (["--scheme", "23-position"], {"scheme": "23-position"}),
        (["--dwell-s=60", "--rate_dps", "20"], {"dwell_s": "60", "rate_dps": "20"}),
        (["--warm-up-min", "-1"], {"warm_up_min": "-1"}),
        (["--scheme", "a=b.toml"], {"scheme": "a=b.toml"}),
        ([], {}),
    ],
)
def test_a_parameter_may_be_an_option(options, settings):
    found = settings_of(find_procedure("system-calibration"), ["settle=1"], options)
    assert found == {"settle": "1", **settings}


def test_a_yes_or_no_parameter_needs_no_value():
    procedure = find_procedure("standard-test")
    assert settings_of(procedure, [], ["--temperatures"]) == {"temperatures": "true"}
    assert settings_of(procedure, [], ["--temperatures", "no"]) == {"temperatures": "no"}
    assert procedure.parse({"temperatures": "true"}).temperatures is True


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--shceme", "x"], "did you mean --scheme"),
        (["--bensh=lab.toml"], "did you mean --bench"),
        (["--scheme"], "without its value"),
        (["23-position"], "a word too many"),
        (["-dwell-s", "5"], "no such option"),
        (["--dwell-s", "5"], "given twice"),
    ],
)
def test_what_is_no_parameter_is_refused(options, words):
    with pytest.raises(ConfigurationError, match=words):
        settings_of(find_procedure("system-calibration"), ["dwell_s=60"], options)


def test_no_parameter_has_the_name_of_an_option_of_the_command():
    for procedure in load_procedures().values():
        assert not set(procedure.parameters.model_fields) & set(OWN_OPTIONS), procedure.name


def test_an_option_is_no_suggestion_for_itself():
    with pytest.raises(ConfigurationError, match="no such option") as refused:
        settings_of(find_procedure("known-state"), [], ["--yes"])
    assert "did you mean --yes" not in str(refused.value)
