"""Facts, not sentences: every event class is documented, and nobody decides by a text made for people."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest

from bench.record.events import EVENTS

ROOT = Path(__file__).parents[2]
SOURCES = [
    path.relative_to(ROOT)
    for room in ("bench", "procedures", "simulators")
    for path in sorted((ROOT / room).rglob("*.py"))
]
LEGACY = Path("bench/record/events/_legacy.py")
"""The one reader of sentences: of run folders written before events were typed."""
MADE_FOR_PEOPLE = {"text", "texts", "reason", "reasons", "description", "follows", "title", "why", "remedy"}
"""Attributes and keys that hold a sentence."""
BY_NAME = MADE_FOR_PEOPLE - {"text", "texts", "title"}
"""Variables of these names count too; `text` is also what a file's content is called."""
METHODS = {
    "startswith", "endswith", "partition", "rpartition", "split", "rsplit", "splitlines", "find", "rfind",
    "index", "rindex", "count", "removeprefix", "removesuffix",
}  # fmt: skip
PATTERNS = {"match", "search", "fullmatch", "findall", "finditer", "sub", "split", "fnmatch", "fnmatchcase"}
ALLOWED = {
    "bench/control/questions.py: Prepared.ask": "a campaign file's author writes the pattern for a question",
    "bench/present/panel/_watch.py: _what": "a name that somebody gave, not a sentence",
    "simulators/emulators/_acutrol_axis.py: ": "a fault's name as the controller's manual has it",
    "simulators/faults.py: Fault.check": "a refusal is one of those that the device knows",
    "bench/analysis/gap/_describe.py: curve_part": "`follows` names an input until it is a type of its own",
    "bench/analysis/gap/_generic.py: ": "as above",
    "bench/analysis/gap/_which.py: judged_sets": "as above",
}
"""What is compared although it is called so, and why."""


class _Reader(ast.NodeVisitor):
    """Finds where a sentence is taken apart or compared, in a function with what was assigned from one before."""

    def __init__(self) -> None:
        self.found: list[tuple[str, int, str]] = []
        self._names: list[str] = []
        self._tainted: set[str] = set()

    def _scope(
        self, node: ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Lambda, name: str
    ) -> None:
        before = set(self._tainted)
        self._names.append(name)
        self.generic_visit(node)
        self._names.pop()
        self._tainted = before

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self._scope(node, node.name)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self._scope(node, node.name)

    def visit_Assign(self, node: ast.Assign) -> None:
        self.generic_visit(node)
        if self._sentence(node.value):
            self._tainted |= {
                name.id for to in node.targets for name in ast.walk(to) if isinstance(name, ast.Name)
            }

    def visit_NamedExpr(self, node: ast.NamedExpr) -> None:
        self.generic_visit(node)
        if self._sentence(node.value):
            self._tainted.add(node.target.id)

    def visit_comprehension(self, node: ast.comprehension) -> None:
        if self._sentence(node.iter) and isinstance(node.target, ast.Name):
            self._tainted.add(node.target.id)
        self.generic_visit(node)

    def _comprehended(self, node: ast.ListComp | ast.SetComp | ast.GeneratorExp | ast.DictComp) -> None:
        for generator in node.generators:  # their names come first, as they are bound
            self.visit(generator)
        for part in ast.iter_child_nodes(node):
            if not isinstance(part, ast.comprehension):
                self.visit(part)

    def visit(self, node: ast.AST) -> None:
        if isinstance(node, ast.ListComp | ast.SetComp | ast.GeneratorExp | ast.DictComp):
            self._comprehended(node)
        else:
            super().visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        sides = [node.left, *node.comparators]
        for operator, left, right in zip(node.ops, sides, sides[1:], strict=False):
            if isinstance(operator, ast.In | ast.NotIn) and (self._sentence(right) or self._sentence(left)):
                self._note(node)
            constant = any(isinstance(side, ast.Constant) and side.value for side in (left, right))
            compared = isinstance(operator, ast.Eq | ast.NotEq) and constant
            if compared and (self._sentence(left) or self._sentence(right)):
                self._note(node)
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        match node.func:
            case ast.Attribute(value=owner, attr=called) if called in METHODS and self._sentence(owner):
                self._note(node)
            case ast.Attribute(attr=called) if called in PATTERNS and any(map(self._sentence, node.args)):
                self._note(node)
        self.generic_visit(node)

    def visit_Match(self, node: ast.Match) -> None:
        if self._sentence(node.subject):
            self._note(node.subject)
        self.generic_visit(node)

    def _note(self, node: ast.expr) -> None:
        self.found.append((".".join(self._names), node.lineno, ast.unparse(node)))

    def _sentence(self, node: ast.expr) -> bool:
        """Whether a value is, or is made of, a sentence."""
        match node:
            case ast.Attribute():
                return node.attr in MADE_FOR_PEOPLE
            case ast.Name():
                return node.id in BY_NAME or node.id in self._tainted
            case ast.Subscript():
                key = node.slice.value if isinstance(node.slice, ast.Constant) else None
                return key in MADE_FOR_PEOPLE or (
                    (key is None or isinstance(key, int)) and self._sentence(node.value)
                )
            case ast.Call(func=ast.Attribute(attr="get" | "pop"), args=[ast.Constant(value=key), *_]):
                return key in MADE_FOR_PEOPLE
            case ast.Call(func=ast.Attribute(value=owner, attr=called)):
                return called in METHODS | {
                    "strip",
                    "lower",
                    "upper",
                    "casefold",
                    "rstrip",
                } and self._sentence(owner)
            case ast.Call(func=ast.Name(id="str" | "list" | "tuple" | "set" | "sorted"), args=[inner]):
                return self._sentence(inner)
            case ast.NamedExpr():
                return self._sentence(node.value)
            case ast.BoolOp():
                return any(self._sentence(each) for each in node.values)
            case ast.BinOp():
                return self._sentence(node.left) or self._sentence(node.right)
            case ast.JoinedStr():
                return any(
                    self._sentence(part.value) for part in node.values if isinstance(part, ast.FormattedValue)
                )
        return False


def readings(source: str) -> list[tuple[str, int, str]]:
    reader = _Reader()
    reader.visit(ast.parse(source))
    return reader.found


def test_nobody_decides_by_a_text_of_an_event_a_reason_or_a_description() -> None:
    wrong = [
        f"{path}:{line}: {what}"
        for path in SOURCES
        if path != LEGACY
        for where, line, what in readings((ROOT / path).read_text(encoding="utf-8"))
        if not any(f"{path}: {where}".startswith(allowed) for allowed in ALLOWED)
    ]
    assert wrong == []


@pytest.mark.parametrize(
    "planted",
    [
        'def f(row): return row["text"].startswith("made safe")',
        'def f(row): return "made safe" in str(row.get("text", ""))',
        'def f(event): return re.match("spin at", event.text)',
        "def f(event): return _SPIN.match(event.text)",
        'def f(run): return "NOT CONFIRMED SAFE" in run.manifest.reason',
        'def f(reason): return reason.partition(" Remedy: ")[2]',
        'def f(explanation): return "a turn" in explanation.follows',
        'def f(rows): return [text for row in rows if (text := row["text"]).endswith("x")]',
        'def f(rows): return [t for t in [] if t] + [1 for r in rows if "a" in r["description"]]',
        'def f(event):\n    said = f"{event.text} more".strip()\n    return said.split(":")[0]',
        'def f(event):\n    match event.reason:\n        case "end of the run":\n            return 1',
        'def f(event): return event.text == "stop"',
        'def f(event): return event.reason in ("stop", "start")',
    ],
)
def test_the_search_finds_planted_ones(planted: str) -> None:
    assert readings(planted)


@pytest.mark.parametrize(
    "harmless",
    [
        'def f(event): return f"{event.device}: {event.text}"',
        "def f(a, b): return a.reason != b.reason",
        'def f(result): return result.reason or "none"',
        'def f(state): return state.kind.startswith("demand")',
        'def f(text): return text.split(",")',
    ],
)
def test_the_search_leaves_alone_what_only_shows_a_text(harmless: str) -> None:
    assert readings(harmless) == []


def test_every_event_class_is_in_the_document_with_its_fields() -> None:
    page = (ROOT / "docs" / "events.md").read_text(encoding="utf-8")
    rows = {
        kind: cells
        for line in page.splitlines()
        if line.startswith("| `")
        for kinds, cells in [line.strip("| ").split(" | ", 1)]
        for kind in re.findall(r"`(\w+)`", kinds)
    }
    assert set(rows) == set(EVENTS)
    missing = [
        f"{kind}: {name}"
        for kind, each in EVENTS.items()
        for name in (field.name for field in fields(each))
        if name != "details" and not re.search(rf"\b{name}\b", rows[kind])
    ]
    assert missing == []


def _call(node: ast.Call, called: ast.Attribute, known: set[str]) -> Iterator[str]:
    owner, first = ast.unparse(called.value), node.args[0] if node.args else None
    made = ast.unparse(first.func) if isinstance(first, ast.Call) else ""
    asked = ast.unparse(first) if first is not None else ""
    if called.attr == "event" and owner == "bench" and made not in known:
        yield ast.unparse(node)
    if called.attr == "of" and owner.split(".")[-1] in ("run", "events") and asked not in known:
        yield ast.unparse(node)


def _event_uses(source: str) -> Iterator[str]:
    """Yield what a module writes to or reads of an event log that is no listed class."""
    tree = ast.parse(source)
    known = {each.__name__ for each in EVENTS.values()} | {"Demand", "Event"}
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            yield from _call(node, node.func, known)
        if isinstance(node, ast.Compare) and ast.unparse(node.left).endswith("['kind']"):
            named = {side.value for side in node.comparators if isinstance(side, ast.Constant)}
            if named - set(EVENTS):
                yield ast.unparse(node)


def test_procedures_and_analysis_use_listed_events_only() -> None:
    wrong = [
        f"{path}: {use}"
        for path in SOURCES
        if path.parts[0] == "procedures" or path.parts[:2] == ("bench", "analysis")
        for use in _event_uses((ROOT / path).read_text(encoding="utf-8"))
    ]
    assert wrong == []
    assert list(
        _event_uses('bench.event("turn", number=1)\nrun.of(Elsewhere)\nx = event["kind"] == "section"')
    )
