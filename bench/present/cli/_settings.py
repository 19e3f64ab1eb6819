"""A procedure's parameters on the command line: `--set dwell_s=60`, or as options, `--dwell-s 60`."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

from bench.control.procedure import Procedure
from drivers.base.errors import ConfigurationError

OWN_OPTIONS = ("bench", "runs", "set", "yes", "json", "plant", "seed", "by", "signed-in-as", "help")
"""Options of `run` and `rehearse` themselves: no parameter may have such a name."""


def settings_of(procedure: Procedure, pairs: Iterable[str], options: Sequence[str]) -> dict[str, str]:
    """Return name -> value of `name=value` texts and of `--name value` or `--name=value` options.

    ConfigurationError for what is neither, for an option that is no parameter, for a parameter given both ways.
    """
    settings = parse_settings(pairs)
    for name, value in _named(procedure, options):
        if name in settings:
            raise ConfigurationError(
                "a parameter given twice", where=f"--{_dashed(name)}", found=f"{settings[name]} and {value}"
            )
        settings[name] = value
    return settings


def parse_settings(
    pairs: Iterable[str],
    option: str = "--set",
    refusal: str = "a parameter that is not name=value",
    example: str = "soak_min=60",
) -> dict[str, str]:
    """Return name -> value of `name=value` texts of an option; ConfigurationError for anything else."""
    settings = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not equals or not name.strip():
            raise ConfigurationError(refusal, where=option, found=pair, expected=f"e.g. {example}")
        settings[name.strip()] = value.strip()
    return settings


def _named(procedure: Procedure, options: Sequence[str]) -> Iterable[tuple[str, str]]:
    fields = procedure.parameters.model_fields
    left = list(options)
    while left:
        option, equals, value = left.pop(0).partition("=")
        name = option.removeprefix("--").replace("-", "_")
        if not option.startswith("--") or name not in fields:
            raise _unknown(procedure, option)
        if not equals:
            if fields[name].annotation is bool and (not left or left[0].startswith("--")):
                value = "true"
            elif left:
                value = left.pop(0)
            else:
                raise ConfigurationError(
                    "an option without its value", where=option, expected=f"{option} VALUE"
                )
        yield name, value


def _unknown(procedure: Procedure, option: str) -> ConfigurationError:
    names = [_dashed(name) for name in (*procedure.parameters.model_fields, *OWN_OPTIONS)]
    near = difflib.get_close_matches(option.lstrip("-"), set(names) - {option.lstrip("-")}, n=1)
    return ConfigurationError(
        "no such option" if option.startswith("-") else "a word too many",
        where=procedure.name,
        found=option,
        expected="options of the command, or parameters of the procedure as --name value",
        remedy=f"did you mean --{near[0]}?"
        if near
        else f"`gyrobench procedures {procedure.file or procedure.name}` lists them",
    )


def _dashed(name: str) -> str:
    return name.replace("_", "-")
