"""Reads a description and says everything that is wrong with it at once: file, key, found, expected."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from drivers.base.errors import ConfigurationError, one_of
from drivers.base.files import read_settings
from drivers.frames._form import Form, forms_of
from drivers.frames._lines import LineDescription, line_form, verify_lines
from drivers.frames._model import Description
from drivers.frames._settings import setting_mistakes, with_settings
from drivers.frames._verify import verify
from drivers.kit import config
from drivers.kit.config import Mistake

Model = TypeVar("Model", bound=BaseModel)
_Settings = tuple[tuple[str, str], ...]


class FrameFamily:
    """A description with its forms: what decoder, encoder and driver are made from."""

    def __init__(
        self,
        description: Description,
        forms: list[Form],
        where: str,
        data: dict[str, Any],
        settings: Mapping[str, str],
    ) -> None:
        self.description = description
        self.forms = forms
        self.where = where
        self._data = data
        self._settings = dict(settings)

    @property
    def name(self) -> str:
        """The description's name."""
        return self.description.name

    def set_up(self, settings: Mapping[str, str]) -> FrameFamily:
        """Return the same description with `settings` chosen, the others at their defaults."""
        same = dict(settings) == self._settings
        return self if same else family_from(self._data, self.where, settings)

    def form(self, name: str | None) -> Form:
        """Return the message of that name, None for the first that carries a gyro channel."""
        measuring = [form for form in self.forms if form.measures]
        if name is None:
            return measuring[0]
        for form in self.forms:
            if form.name == name:
                return form
        names = [form.name for form in self.forms]
        raise ConfigurationError(
            "the description has no such message",
            where=self.where,
            found=repr(name),
            expected=one_of(name, names),
            remedy="correct frame_format in the bench file",
        )


def shipped() -> dict[str, Path]:
    """Return the descriptions that come with gyrobench: name -> file."""
    folder = Path(str(files("drivers.frames") / "descriptions"))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def is_path(description: str) -> bool:
    """Whether a bench file's `description` is a path rather than a name."""
    return description.endswith(".toml") or "/" in description


def description_path(description: str) -> Path:
    """Return the file behind a name of ours or a path; ConfigurationError with the nearest name."""
    if is_path(description):
        return Path(description)
    ours = shipped()
    if description not in ours:
        raise ConfigurationError(
            "there is no frame description of that name",
            found=repr(description),
            expected=one_of(description, list(ours)) + ", or a path that ends in .toml",
            remedy="`gyrobench frames list` shows them",
        )
    return ours[description]


def load_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file; ConfigurationError if it cannot be read or is none."""
    return read_settings(path, "the frame description", remedy="check the path")[0]


def load_family(description: str, settings: Mapping[str, str] | None = None) -> FrameFamily:
    """Return the description of a name of ours or a path, checked; ConfigurationError lists every mistake.

    `settings`: choices among the description's settings, by name; the others have their defaults.
    """
    path = description_path(description)
    try:
        changed = path.stat().st_mtime_ns
    except OSError:
        changed = 0
    return _loaded(str(path), changed, _fixed(settings))


@lru_cache(maxsize=64)
def _loaded(path: str, _changed: int, settings: _Settings) -> FrameFamily:
    return family_from(load_toml(Path(path)), path, dict(settings))


def family_of(description: str | Mapping[str, Any], settings: Mapping[str, str] | None = None) -> FrameFamily:
    """Return the family a bench file's `description` and `settings` mean.

    `description`: a name of ours, a path, or a description itself.
    """
    if isinstance(description, str):
        return load_family(description, settings)
    return _parsed(json.dumps(description, sort_keys=True), _fixed(settings))


@lru_cache(maxsize=64)
def _parsed(text: str, settings: _Settings) -> FrameFamily:
    data = json.loads(text)
    return family_from(data, f"description {data.get('name', '')!r} in the bench file", dict(settings))


def _fixed(settings: Mapping[str, str] | None) -> _Settings:
    return tuple(sorted((settings or {}).items()))


def family_from(data: dict[str, Any], where: str, settings: Mapping[str, str] | None = None) -> FrameFamily:
    """Check a description given as parsed TOML with `settings` chosen; `where` stands for the file in errors."""
    kind = LineDescription if "line" in data else Description
    asked = validated(kind, data, where)
    if mistakes := list(setting_mistakes(asked, settings or {})):
        raise refusal(where, mistakes)
    given = data
    if asked.setting:
        data = with_settings(data, asked, settings or {})
    if "line" in data:
        lines = validated(LineDescription, data, where)
        if mistakes := list(verify_lines(lines)):
            raise refusal(where, mistakes)
        if mistakes := list(verify(lines, [form := line_form(lines)])):
            raise refusal(where, mistakes)
        return FrameFamily(lines, [form], where, given, settings or {})
    description = validated(Description, data, where)
    forms = forms_of(description)
    if mistakes := list(verify(description, forms)):
        raise refusal(where, mistakes)
    return FrameFamily(description, forms, where, given, settings or {})


def validated(model: type[Model], data: dict[str, Any], where: str) -> Model:
    """Return `data` as a pydantic model; ConfigurationError that names every key which is wrong."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise refusal(where, [_mistake(model, details, data) for details in error.errors()]) from None


def refusal(where: str, mistakes: list[Mistake]) -> ConfigurationError:
    """Return the error that says all of `mistakes`."""
    return config.refusal("the frame description", where, mistakes)


def _mistake(model: type[BaseModel], details: ErrorDetails, data: Any) -> Mistake:
    """Turn pydantic's finding into a key as in the file; an entry of a list is called by its own name."""
    key = ""
    here: Any = data
    for part in details["loc"]:
        here = here[part] if _has(here, part) else None
        if isinstance(part, int):
            named = here.get("name") if isinstance(here, dict) else None
            key += f"[{part}]" + (f" {named!r}" if named else "")
        else:
            key += f".{part}" if key else str(part)
    if details["type"] == "extra_forbidden":
        section = _walk(model, details["loc"][:-1])[0]
        keys = [info.alias or name for name, info in section.model_fields.items()]
        return Mistake(key, "an unknown key", one_of(str(details["loc"][-1]), keys))
    expected = _walk(model, details["loc"])[1] or details["msg"]
    if details["type"] == "missing":
        return Mistake(key, "nothing", expected)
    found = details["input"]
    shown = "a table" if isinstance(found, dict) else _shown(found)
    reason = details["msg"].removeprefix("Value error, ")
    return Mistake(key, shown, expected if reason in expected else f"{expected} ({reason})")


def _shown(found: Any) -> str:
    text = f"a list of {len(found)}" if isinstance(found, (list, tuple)) and len(found) > 16 else repr(found)
    return text if len(text) <= 200 else f"{text[:200]} ..."


def _has(here: Any, part: Any) -> bool:
    if isinstance(here, dict):
        return part in here
    return isinstance(here, list) and isinstance(part, int) and part < len(here)


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for each in getattr(annotation, "__args__", ()) for model in _models(each)]


def _walk(model: type[BaseModel], location: tuple[Any, ...]) -> tuple[type[BaseModel], str]:
    """Return the innermost model on the way to `location`, and the text of the last key described."""
    text = ""
    for part in location:
        for field_name, info in model.model_fields.items():
            if part in (field_name, info.alias):
                text = info.description or text
                inner = _models(info.annotation)
                model = inner[0] if inner else model
                break
    return model, text
