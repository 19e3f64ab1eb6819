"""The text a Weiss or Vötsch chamber prints on `$dd?`: its own field lists, limits and digital output names."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from drivers.base.errors import ProtocolError

_TOKEN = re.compile(r"(?:CV|SV|MV|DO)\d\d")
_END_OF_LIST = re.compile(r"<CR>|Description", re.IGNORECASE)
_LIMITS = re.compile(
    r"^\s*((?:CV|SV)\d\d)\s+value min:\s*(-?\d+(?:\.\d+)?)\s+value max:\s*(-?\d+(?:\.\d+)?)[ \t]*([^\r\n]*)",
    re.IGNORECASE | re.MULTILINE,
)
_NAME = re.compile(r"^\s*((?:DO|MV)\d\d)[ \t]+(?!DO\d\d|MV\d\d)(\S[^\r\n]*)", re.MULTILINE)


@dataclass(frozen=True)
class Setting:
    """Range and name of a settable value, in its own unit (degC for a temperature)."""

    minimum: float
    maximum: float
    name: str


@dataclass(frozen=True)
class Configuration:
    """What a chamber says about its own strings.

    `set_fields` and `read_fields`: names of the numbers in `$ddE` and in the reply to `$ddI`, in order, such as
    CV01 CV01 MV01. `digital_count`: characters of the digital block in `$ddE`. `digital_names` by index.
    """

    set_fields: tuple[str, ...]
    read_fields: tuple[str, ...]
    digital_count: int
    settings: Mapping[str, Setting]
    digital_names: Mapping[int, str]
    measured_names: Mapping[str, str]

    @property
    def start_bit(self) -> int:
        """Index of the digital output called Start; raises ProtocolError if there is none."""
        for index, name in self.digital_names.items():
            if name.lower() == "start":
                return index
        raise ProtocolError(
            "the chamber names no digital output Start",
            found=", ".join(f"DO{index:02d} {name}" for index, name in self.digital_names.items()) or "none",
            expected="a line such as 'DO01  Start' in the answer to $dd?",
            remedy="use SimServ with the start channel from the chamber's manual",
        )

    def actual_index(self, name: str) -> int:
        """Return where the actual value of CVnn or MVnn stands in a reply to `$ddI`: nominal precedes actual."""
        places = [index for index, field in enumerate(self.read_fields) if field == name]
        if not places:
            raise ProtocolError(
                f"the chamber reports no {name}",
                found=" ".join(self.read_fields),
                expected=f"{name} in the fields of $ddI",
                remedy="correct the auxiliary sensors in the bench file",
            )
        return places[-1]

    def measured_values(self) -> tuple[int, ...]:
        """Return the numbers of the measured values (MVnn) that are connected to something."""
        unused = ("unused", "unused setpoint", "not supported")
        fields = dict.fromkeys(field for field in self.read_fields if field.startswith("MV"))
        return tuple(
            int(name[2:]) for name in fields if self.measured_names.get(name, "").lower() not in unused
        )


def decode_configuration(text: str) -> Configuration:
    """Parse the answer to `$dd?`; raises ProtocolError if its field lists are missing.

    Newer firmware prints the names without spaces and breaks lines inside them, so lists are read with all white
    space taken out.
    """
    set_fields = _field_list(text, r"\$\d\dE\s")
    read_fields = _field_list(text, r"\$\d\dI\s*<CR>")
    if not set_fields or not read_fields:
        raise ProtocolError(
            "not an ASCII-2 configuration",
            found=repr(text[:120]),
            expected="field lists after '$ddE' and '$ddI<CR>'",
            remedy="check that the port belongs to a Weiss or Vötsch chamber and that its address is right",
        )
    settings = {
        field.upper(): Setting(float(low), float(high), name.strip())
        for field, low, high, name in _LIMITS.findall(text)
    }
    if not all("CV01" in part for part in (set_fields, read_fields, settings)):
        raise ProtocolError(
            "the ASCII-2 configuration has no temperature control",
            found=f"set {' '.join(set_fields)}; read {' '.join(read_fields)}; ranges of {' '.join(settings)}",
            expected="CV01 in the field lists and a line 'CV01  value min: ... value max: ...'",
            remedy="check the ASCII-2 configuration on the chamber's panel",
        )
    names = _NAME.findall(text)
    digital = [int(field[2:]) for field in set_fields if field.startswith("DO")]
    return Configuration(
        set_fields=tuple(field for field in set_fields if not field.startswith("DO")),
        read_fields=tuple(field for field in read_fields if not field.startswith("DO")),
        digital_count=max(digital, default=-1) + 1,
        settings=settings,
        digital_names={int(field[2:]): name.strip() for field, name in names if field.startswith("DO")},
        measured_names={
            field: name.removeprefix("actual value").strip()
            for field, name in names
            if field.startswith("MV")
        },
    )


def encode_configuration(configuration: Configuration, address: int) -> bytes:
    """Return the text of `$dd?` in the layout of a dynamic configuration, lines ended CR LF."""
    digital = [f"DO{index:02d}" for index in range(configuration.digital_count)]
    settings = [
        f"{field}  value min: {item.minimum:6.1f}   value max: {item.maximum:6.1f}   {item.name}"
        for field, item in configuration.settings.items()
    ]
    outputs = [f"DO{index:02d}  {name}" for index, name in configuration.digital_names.items()]
    rule = "-" * 80
    lines = [
        "ASCII-2 PROTOCOL CONFIGURATION",
        "Configuration type: DYNAMIC",
        "",
        "Example of an ASCII E-String:",
        *_wrap([f"${address:02d}E", *configuration.set_fields, *digital, "<CR>"]),
        *["", "Description:", *settings, *outputs, rule, "", "Example of  an ASCII I-String:"],
        f"${address:02d}I<CR>",
        *_wrap([*configuration.read_fields, *digital, "<CR>"]),
        *["", "Description:", *_describe(configuration), *outputs, rule, "", "Configured Messages:", "none"],
    ]
    return "\r\n".join(lines).encode("latin-1") + b"\r\n"


def _field_list(text: str, head: str) -> list[str]:
    found = re.search(head, text)
    if found is None:
        return []
    body = text[found.end() :]
    end = _END_OF_LIST.search(body)
    return _TOKEN.findall(re.sub(r"\s+", "", body[: end.start()] if end else body))


def _describe(configuration: Configuration) -> list[str]:
    lines, seen = [], set()
    for field in configuration.read_fields:
        name = configuration.settings[field].name if field in configuration.settings else ""
        if field.startswith("MV"):
            lines.append(f"{field} actual value {configuration.measured_names[field]}")
        elif field.startswith("SV"):
            lines.append(f"{field}  set value     {name}")
        else:
            lines.append(f"{field}  {'actual value ' if field in seen else 'nominal value'} {name}")
        seen.add(field)
    return lines


def _wrap(words: list[str]) -> list[str]:
    lines = [""]
    for word in words:
        joined = f"{lines[-1]} {word}".strip()
        if len(joined) <= 80:
            lines[-1] = joined
        else:
            lines.append(word)
    return lines
