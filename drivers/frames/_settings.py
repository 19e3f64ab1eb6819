"""What the bytes do not tell: how a unit was ordered or set up, chosen by name in the bench file."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from typing import Any

from drivers.frames._model import Choice, Description, Setting
from drivers.kit.config import Mistake

Plain = dict[str, Any]


def setting_mistakes(description: Description, settings: Mapping[str, str]) -> Iterator[Mistake]:
    """Yield what is wrong with the description's settings, and with the choices made of them."""
    own = {group.name for group in description.field}
    own |= {group.name for variant in description.variant for group in variant.field}
    messages = {variant.name for variant in description.variant} or {description.name}
    for name, setting in description.setting.items():
        key = f"setting.{name}"
        if setting.default not in setting.choice:
            yield Mistake(f"{key}.default", repr(setting.default), _one_of(setting.choice))
        for words, choice in setting.choice.items():
            for unknown in sorted(set(choice.field) - own):
                yield Mistake(f"{key}.choice.{words}.field", repr(unknown), _one_of(own))
            for unknown in sorted(set(_listed(choice.message)) - messages):
                yield Mistake(f"{key}.choice.{words}.message", repr(unknown), _one_of(messages))
    for one, other, place in _twice(description.setting):
        yield Mistake(f"setting.{other}", f"{place}, which setting {one!r} sets too", "keys of its own")
    for name, words in settings.items():
        known = description.setting.get(name)
        if known is None:
            yield Mistake(
                f"settings.{name}", "a setting that this unit does not have", _one_of(description.setting)
            )
        elif words not in known.choice:
            yield Mistake(f"settings.{name}", repr(words), _one_of(known.choice))


def with_settings(data: Mapping[str, Any], description: Description, settings: Mapping[str, str]) -> Plain:
    """Return a description's data with the choices made worked in; what is not chosen is the default."""
    result: Plain = copy.deepcopy(dict(data))
    for name, setting in description.setting.items():
        choice = setting.choice[settings.get(name, setting.default)]
        if choice.message is not None:
            result["message"] = choice.message
        for entry in _fields(result):
            if (change := choice.field.get(entry.get("name", ""))) is not None:
                for key, value in change.model_dump(exclude_none=True).items():
                    entry[key] = {**entry.get(key, {}), **value} if key == "scale" else value
    return result


def choices_of(description: Description) -> Iterator[dict[str, str]]:
    """Yield settings that try every choice once: the defaults, then each other choice alone."""
    yield {}
    for name, setting in description.setting.items():
        yield from ({name: words} for words in setting.choice if words != setting.default)


def _fields(data: Plain) -> Iterator[Plain]:
    groups = [data, *data.get("variant", [])]
    return (entry for group in groups for entry in group.get("field", []))


def _twice(settings: Mapping[str, Setting]) -> Iterator[tuple[str, str, str]]:
    """Yield two settings that set the same key, and the key."""
    seen: dict[str, str] = {}
    for name, setting in settings.items():
        for place in sorted({place for choice in setting.choice.values() for place in _places(choice)}):
            if seen.setdefault(place, name) != name:
                yield seen[place], name, place


def _places(choice: Choice) -> Iterator[str]:
    if choice.message is not None:
        yield "message"
    for field, change in choice.field.items():
        for key, value in change.model_dump(exclude_none=True).items():
            yield from (f"{field}.{key}.{part}" for part in value) if key == "scale" else (f"{field}.{key}",)


def _listed(message: str | tuple[str, ...] | None) -> tuple[str, ...]:
    return () if message is None else (message,) if isinstance(message, str) else message


def _one_of(names: Any) -> str:
    return "one of " + ", ".join(sorted(names)) if names else "no settings: it has none"
