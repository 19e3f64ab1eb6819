"""The places in the sources where something small can be changed, and a draw of them that stays the same."""

from __future__ import annotations

import ast
import hashlib
import json
import random
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

from benchmarks._mutant_rooms import ROOMS, Part
from benchmarks._trial import ROOT

KEPT = ROOT / "build" / "mutants"
_Row = tuple[str, int, str, int]
"""Function, line, operator, occurrence."""


@dataclass(frozen=True)
class Mutant:
    """One change: which of cosmic-ray's operators, at which of its places in the file; who may notice it."""

    part: Part
    file: str
    function: str
    line: int
    operator: str
    occurrence: int

    @property
    def key(self) -> str:
        """Name it in the kept results."""
        return f"{self.file}:{self.line} {self.operator} {self.occurrence}"


def drawn(room: str, count: int, draw: int = 1) -> list[Mutant]:
    """Return so many mutants of a room, of different places.

    A place's rank is a hash of what stands there: a change of one source draws no other places in the rest.
    """
    parts: dict[str, Part] = {}
    for part in ROOMS[room]:
        for glob in part.sources:
            paths = list(ROOT.glob(glob))
            if not paths:
                raise SystemExit(f"no such sources: {glob}")
            for path in paths:
                parts.setdefault(str(path.relative_to(ROOT)), part)
    ranked = sorted(
        (hashlib.sha256(f"{draw} {file} {name}".encode()).hexdigest(), file, rows)
        for file in sorted(parts)
        for name, rows in _places(file).items()
    )
    found: list[Mutant] = []
    for rank, file, rows in ranked:
        random.Random(rank).shuffle(rows)
        one = next((row for row in rows if _changed(file, row[2], row[3]) is not None), None)
        found += [] if one is None else [Mutant(parts[file], file, *one)]
        if len(found) == count:
            break
    return found


def mutated(mutant: Mutant) -> str:
    """Return the mutant's file with the mutant in it."""
    text = _changed(mutant.file, mutant.operator, mutant.occurrence)
    assert text is not None
    return text


def change(mutant: Mutant) -> str:
    """Return in a line what a mutant makes of its line."""
    before, after = (ROOT / mutant.file).read_text("utf-8").splitlines(), mutated(mutant).splitlines()
    at = next(
        (k for k, pair in enumerate(zip(before, after, strict=False)) if pair[0] != pair[1]), len(after) - 1
    )
    return f"`{before[at].strip()}` -> `{after[at].strip()}`"


def statement(mutant: Mutant) -> range:
    """Return the lines of the innermost statement that the mutant stands in, up to its line.

    Of a condition in brackets on lines of its own only these are seen to be executed.
    """
    first, upto = 1, mutant.line
    for node in ast.walk(_tree(mutant.file)):
        if isinstance(node, ast.stmt | ast.excepthandler | ast.match_case):
            last = node.pattern if isinstance(node, ast.match_case) else node
            start = last.lineno
            if first <= start <= mutant.line <= (last.end_lineno or start):
                first = start
                upto = (
                    max(mutant.line, node.test.lineno)
                    if isinstance(node, ast.If | ast.While)
                    else mutant.line
                )
    return range(first, upto + 1)


@cache
def _tree(file: str) -> ast.Module:
    return ast.parse((ROOT / file).read_text(encoding="utf-8"))


def digest(*names: str) -> str:
    """Return a checksum of files."""
    return hashlib.sha256(b"".join((ROOT / name).read_bytes() for name in names)).hexdigest()[:16]


def _places(file: str) -> dict[str, list[_Row]]:
    """Return the mutants of a file by place; as found before, if the file is the same."""
    kept = KEPT / "places" / f"{digest(file)}.json"
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(_searched(file)), encoding="utf-8")
    return {name: [tuple(row) for row in rows] for name, rows in json.loads(kept.read_text("utf-8")).items()}


def _searched(file: str) -> dict[str, list[_Row]]:
    from cosmic_ray.ast import ast_nodes, get_ast_from_path
    from cosmic_ray.plugins import get_operator, operator_names

    nodes = list(ast_nodes(get_ast_from_path(ROOT / file)))
    found: dict[tuple[Any, ...], list[_Row]] = {}
    for name in sorted(operator_names()):
        kind = get_operator(name)
        if kind.arguments() or name == "core/NoOp":
            continue
        operator, occurrence = kind(), 0
        for node in nodes:
            for start, end in operator.mutation_positions(node):
                if not _beside(node):
                    row = (_function(node), start[0], name, occurrence)
                    found.setdefault((start, end, _group(name)), []).append(row)
                occurrence += 1
    lines = (ROOT / file).read_text(encoding="utf-8").splitlines()
    named: dict[str, list[_Row]] = {}
    for start, end, group in sorted(found):
        rows, number = found[start, end, group], 0
        name = f"{rows[0][0]} {lines[start[0] - 1].strip()} {start[1]} {end[1]} {group}"
        while f"{name} {number}" in named:
            number += 1
        named[f"{name} {number}"] = rows
    return named


def _group(operator: str) -> str:
    """Return what an operator changes: "core/ReplaceBinaryOperator_Add_Sub" changes what all others of it do."""
    return operator.split("_")[0]


def _up(node: Any) -> Iterator[tuple[Any, Any]]:
    """Return the pairs of a node of the tree and what it stands in, outwards."""
    while node.parent is not None:
        yield node, node.parent
        node = node.parent


def _function(node: Any) -> str:
    names = [above.name.value for _, above in _up(node) if above.type in ("funcdef", "classdef")]
    return ".".join(reversed(names)) or "(module)"


def _beside(node: Any) -> bool:
    """Return whether it stands in an annotation or a decorator, or is the star of a signature or a call."""
    if node.type == "decorator":
        return True
    if node.type == "operator" and node.parent.type in ("parameters", "param", "argument", "arglist"):
        return True
    for own, above in _up(node):
        if above.type == "decorator" or (above.type == "tfpdef" and own is not above.children[0]):
            return True
        if above.type == "annassign" and own is above.children[1]:
            return True
        if above.type == "funcdef" and own.get_previous_sibling() == "->":
            return True
    return False


def _changed(file: str, operator: str, occurrence: int) -> str | None:
    """Return the file with a mutant in it; None where that is no program, or no other one."""
    kept = KEPT / "changed" / digest(file) / f"{operator.replace('/', '.')}-{occurrence}.py"
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(_made(file, operator, occurrence) or "", encoding="utf-8")
    return kept.read_text(encoding="utf-8") or None


def _made(file: str, operator: str, occurrence: int) -> str | None:
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    text = (ROOT / file).read_text(encoding="utf-8")
    changed: str | None
    try:
        changed = mutate_code(text, get_operator(operator)(), occurrence)
    except AttributeError:  # cosmic-ray cannot replace an exception whose name has a dot
        return None
    if changed is None:
        return None
    try:
        same = ast.dump(ast.parse(changed)) == ast.dump(ast.parse(text))
    except SyntaxError:
        return None
    return None if same else changed
