"""A bench file as text again, e.g. one that reaches an emulated lab's ports."""

from __future__ import annotations

import json
from typing import Any

from bench.record.benchfile._model import BenchFile


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


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return (
            "{ " + ", ".join(f"{json.dumps(str(key))} = {_value(item)}" for key, item in value.items()) + " }"
        )
    if isinstance(value, list):
        return f"[{', '.join(_value(item) for item in value)}]"
    # JSON's strings, numbers and booleans are TOML's, given that control characters are escaped alike
    return json.dumps(value, ensure_ascii=False)
