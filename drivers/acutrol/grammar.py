"""ACL grammar (TM-8004-C section 2): a message line becomes commands with full names, or a refusal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

_SUBSYSTEMS = """
    ACQUIRE: ACTIVATE CHANNEL FREE READ SAMPLE SAVE STATUS TRIGGER
    CONFIGURE: AIM ANALOG AXIS CONDITIONER MODEL MOTOR OSCILLATOR SCALING VARIABLE
    DEMAND: ACCELERATION DELTAPOSITION INPUTVARIABLE OSCILLATOR POSITION RATE SHORTVECTOR VECTOR WORLDCOORDS
    INTERFACE: IEEE488 PARALLEL RS232 SCRAMNET VMIC REFLECTIVEMEM
    INTERLOCK: CLOSE CONFIGURE CONTROL LOGIC OPEN RESET
    LIMIT: ABSOLUTE ACCELERATION BEMF GLOBAL HIGHPOSITION LOWPOSITION RATE VELOCITYTRIP
    MODE: ABORT ARATE HOME OFF POSITION RATE SYNTHESIS TRACK
    PLAYBACK: ACTIVATE CONFIGURE DATA LIST RESTORE SAVE TRIGGER
    QUERY: ERROR SYSTEM VARNUM
    READ: ACCELERATION LOGDATA VARIABLE POSITION RATE SHORTVECTOR VECTOR WORLDCOORDS
    STATUS: CSR ESE ESR MSG MSGCLR STB TFR
    SYSTEM: SECURITY
    UTILITY: FORMAT LOCKOUTMODE MACRO REMOTELOCKOUT
"""
SUBSYSTEMS: Mapping[str, tuple[str, ...]] = {
    main: tuple(names.split())
    for main, _, names in (line.strip().partition(":") for line in _SUBSYSTEMS.strip().splitlines())
}
"""Main level and the level below it, from the manual's table of contents."""

_DOCUMENTED_SHORT_FORMS: Mapping[tuple[str, str], str] = {
    ("", "I"): "INTERLOCK",
    ("", "INT"): "INTERLOCK",
    ("INTERLOCK", "C"): "CLOSE",
    ("LIMIT", "A"): "ACCELERATION",
    ("READ", "V"): "VECTOR",
    **{(main, cut): "SHORTVECTOR" for main in ("DEMAND", "READ") for cut in ("SVEC", "SVECTOR")},
}
"""Cuts that fit several names or none and that the manual itself uses (4.3.7, 4.5.1, 4.5.5, 4.6.2, 4.10)."""


@dataclass(frozen=True)
class Command:
    """One command of a message: full upper-case names from the root down, query mark, arguments as written."""

    path: tuple[str, ...]
    query: bool = False
    arguments: tuple[str, ...] = ()


@dataclass(frozen=True)
class Refusal:
    """Why a command was not executed. Code 0 is success, so a refusal's is not 0."""

    code: int
    text: str


# The manual's list of error codes (Appendix C) is not public; the one code seen is "215: XML Path Not Found".
# These numbers are ours: a driver must go by "not 0" and the text.
UNDEFINED_HEADER = Refusal(101, "Undefined Header")
AMBIGUOUS_HEADER = Refusal(102, "Ambiguous Header")
PARAMETER_OUT_OF_RANGE = Refusal(103, "Parameter Out Of Range")
WRONG_PARAMETER_COUNT = Refusal(104, "Wrong Number Of Parameters")
DATA_TYPE_ERROR = Refusal(105, "Data Type Error")
NOT_IMPLEMENTED = Refusal(106, "Command Not Implemented")
MESSAGE_TOO_LONG = Refusal(107, "Message Too Long")


def parse_message(line: str) -> list[Command | Refusal]:
    """Return the commands of one message in order; parsing stops at the first refusal, which is the last entry.

    `;` stays in the subsystem, `;:` returns to the root, names may be cut to any unique prefix in either case.
    """
    parsed: list[Command | Refusal] = []
    subsystem = ""
    for unit in _split_outside_quotes(line, ";"):
        if not unit.strip():
            continue
        command, subsystem = _parse_unit(unit.strip(), subsystem)
        parsed.append(command)
        if isinstance(command, Refusal):
            break
    return parsed


def _parse_unit(unit: str, subsystem: str) -> tuple[Command | Refusal, str]:
    header, _, rest = unit.partition(" ")
    arguments = tuple(field.strip() for field in _split_outside_quotes(rest, ",")) if rest.strip() else ()
    query = header.endswith("?")
    header = header[:-1] if query else header
    if header.startswith("*"):
        return Command((header.upper(),), query, arguments), subsystem
    names = header.removeprefix(":").upper().split(":")
    if header.startswith(":") or not subsystem:
        main = _expand(names.pop(0), "", tuple(SUBSYSTEMS))
        if isinstance(main, Refusal):
            return main, ""
        if not names:
            return Command((main,), query, arguments), ""
        subsystem = main
    if len(names) != 1:
        return UNDEFINED_HEADER, subsystem
    name = _expand(names[0], subsystem, SUBSYSTEMS[subsystem])
    if isinstance(name, Refusal):
        return name, subsystem
    return Command((subsystem, name), query, arguments), subsystem


def _expand(name: str, parent: str, candidates: tuple[str, ...]) -> str | Refusal:
    if name in candidates:
        return name
    if (parent, name) in _DOCUMENTED_SHORT_FORMS:
        return _DOCUMENTED_SHORT_FORMS[parent, name]
    matches = [candidate for candidate in candidates if name and candidate.startswith(name)]
    if len(matches) == 1:
        return matches[0]
    return AMBIGUOUS_HEADER if matches else UNDEFINED_HEADER


def _split_outside_quotes(text: str, separator: str) -> list[str]:
    if '"' not in text:
        return text.split(separator)
    parts, start, quoted = [], 0, False
    for at, character in enumerate(text):
        if character == '"' and text[at - 1 : at] != "\\":
            quoted = not quoted
        elif character == separator and not quoted:
            parts.append(text[start:at])
            start = at + 1
    return [*parts, text[start:]]
