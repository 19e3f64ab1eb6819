"""Reads a bench file and says all that is wrong with it at once: file, key, found, expected; writes one."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args, get_type_hints

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from bench.record.benchfile._checks import cross_checks, device_sections
from bench.record.benchfile._model import BenchFile
from drivers.base.errors import one_of
from drivers.base.files import read_settings
from drivers.kit.config import Mistake, Section, refusal
from drivers.kit.registry import config_class, instrument_roles, roles


def load_bench_file(path: Path | str) -> BenchFile:
    """Read and check the bench file at `path`; raises ConfigurationError that lists every mistake."""
    path = Path(path)
    data, content = read_settings(
        path,
        "the bench file",
        remedy="check the path given with --bench; `gyrobench new bench lab` writes lab.toml",
    )
    data, mistakes = _with_files(data, path.parent)
    return _checked(data, str(path), hashlib.sha256(content).hexdigest(), True, mistakes)


def bench_file_from(data: Mapping[str, Any], where: str = "the bench file of the run") -> BenchFile:
    """Check a bench file kept as plain values (parsed TOML, or `model_dump` of a `BenchFile`).

    As `load_bench_file`, but it asks nothing of the machine it runs on; `where` stands for the file in errors.
    `sha256` is that of the data as canonical JSON (sorted keys, no spaces, UTF-8).
    """
    canonical = json.dumps(data, sort_keys=True, separators=(",", ":"), ensure_ascii=False, default=str)
    return _checked(data, where, hashlib.sha256(canonical.encode()).hexdigest(), False, [])


def bench_file_text(file: BenchFile) -> str:
    """Return TOML that `load_bench_file` reads back as an equal bench file."""
    sections = file.model_dump(mode="json", exclude_none=True)
    lines: list[str] = []
    for name, section in sections.items():
        for table in section if isinstance(section, list) else [section]:
            lines.append(f"[[{name}]]" if isinstance(section, list) else f"[{name}]")
            lines += [f"{key} = {_value(value)}" for key, value in table.items()]
            lines.append("")
    return "\n".join(lines)


def _with_files(data: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[Mistake]]:
    """Have every driver read the files that its section names, and return what is wrong with them."""
    mistakes: list[Mistake] = []
    complete: dict[int, dict[str, Any]] = {}
    for role, key, section in device_sections(data):
        complete[id(section)], wrong = config_class(role, section.get("driver")).with_files(section, folder)
        mistakes += [Mistake(f"{key}.{mistake.key}", mistake.found, mistake.expected) for mistake in wrong]

    def completed(value: Any) -> Any:
        return complete.get(id(value), value)

    sections = {
        role: [completed(section) for section in value] if isinstance(value, list) else completed(value)
        for role, value in data.items()
        if role in roles()
    }
    return {**data, **sections}, mistakes


def _checked(
    data: Mapping[str, Any], where: str, sha256: str, resolve_links: bool, mistakes: list[Mistake]
) -> BenchFile:
    bench_file: BenchFile | None = None
    try:
        bench_file = BenchFile.model_validate(data)
    except ValidationError as error:
        mistakes += [_mistake(details, data) for details in error.errors()]
    mistakes += cross_checks(data, resolve_links)
    if bench_file is None or mistakes:
        first_by_key = {mistake.key: mistake for mistake in reversed(mistakes)}
        raise refusal("the bench file", where, list(reversed(first_by_key.values())))
    bench_file._sha256 = sha256  # noqa: SLF001  (a frozen model takes no public assignment)
    return bench_file


def _mistake(details: ErrorDetails, data: Mapping[str, Any]) -> Mistake:
    location = [part for part in details["loc"] if part != "[key]"]
    if location[0] == "instruments":  # gathered there, and beside the other sections in the file
        location = location[1:] or ["instruments"]
    if details["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        names = sorted(_keys_at(location[:-1], data))
        return Mistake(_key(location), "an unknown key", one_of(str(location[-1]), names))
    expected = _description(location, data) or details["msg"]
    if details["type"] == "missing":
        return Mistake(_key(location), "nothing", expected)
    if details["type"] == "value_error":
        expected = f"{expected}; {details['msg'].removeprefix('Value error, ')}"
    limits = _bounds(details)
    return Mistake(_key(location), _shown(details["input"]), expected + (f" ({limits})" if limits else ""))


def _key(location: list[Any]) -> str:
    """Return `gyro[1].port`: tables joined by dots, entries of an array counted from 0."""
    text = ""
    for part in location:
        inside_array = isinstance(part, int) and (
            text in ("gyro", "platform", "calibration", "limits.forbid", *instrument_roles())
            or text.endswith((".axes", ".outputs"))
        )
        text += f"[{part}]" if inside_array else f".{part}" if text else str(part)
    return text


def _shown(value: object) -> str:
    kind = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}.get(type(value))
    if isinstance(value, dict):
        return "a table" if value else "an empty table"
    if isinstance(value, (list, tuple)):
        return f"a list of {len(value)}"
    return f"{value!r} ({kind})" if kind else repr(value)


def _bounds(details: ErrorDetails) -> str:
    words = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}
    context = details.get("ctx", {})
    return ", ".join(f"{word} {context[name]:g}" for name, word in words.items() if name in context)


def _keys(model: Any) -> dict[str, tuple[Any, str | None]]:
    """Return type and description of the keys of a section."""
    if not isinstance(model, type):
        return {}
    if issubclass(model, Section) and dataclasses.is_dataclass(model):
        types = get_type_hints(model)
        return {
            field.name: (types[field.name], field.metadata.get("description"))
            for field in dataclasses.fields(model)
        }
    fields = model.model_fields if issubclass(model, BaseModel) else {}
    keys = {name: (field.annotation, field.description) for name, field in fields.items()}
    if model is BenchFile:
        del keys["instruments"]
        keys |= {role: (None, f"[[{role}]] with name, driver and port") for role in instrument_roles()}
    return keys


def _keys_at(location: list[Any], data: Mapping[str, Any]) -> dict[str, tuple[Any, str | None]]:
    """Return the keys of the table at a location; a device's section has its driver's."""
    model: Any = BenchFile
    if location and location[0] in roles():
        in_array = len(location) > 1 and isinstance(location[1], int)
        section = data[location[0]][location[1]] if in_array else data.get(location[0])
        if isinstance(section, dict):
            model = config_class(location[0], section.get("driver"))
            location = location[2 if in_array else 1 :]
    for part in location:
        if isinstance(part, int):
            continue
        model, _ = _keys(model).get(str(part), (None, None))
        model = next((argument for argument in get_args(model) if isinstance(argument, type)), model)
    return _keys(model)


def _description(location: list[Any], data: Mapping[str, Any]) -> str:
    """Return the description of the nearest described key at or above `location`."""
    for depth in range(len(location), 0, -1):
        _, description = _keys_at(location[: depth - 1], data).get(str(location[depth - 1]), (None, None))
        if description:
            return description
    return ""


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return (
            "{ " + ", ".join(f"{json.dumps(str(key))} = {_value(item)}" for key, item in value.items()) + " }"
        )
    if isinstance(value, list):
        return f"[{', '.join(_value(item) for item in value)}]"
    # JSON's strings, numbers and booleans are TOML's, given that control characters are escaped alike
    return json.dumps(value, ensure_ascii=False)
