"""What a page is made of: header, verdict, sections of blocks. Nothing here knows what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from markupsafe import Markup

from bench.present.report._palette import Paint

Tone = Literal["good", "bad", "doubt", "plain"]


@dataclass(frozen=True)
class Fact:
    """A labelled value; `code` sets it in a fixed-width font (checksums)."""

    label: str
    value: str
    code: bool = False


class _Block:
    """Part of a section; one that holds nothing is not printed."""

    @property
    def kind(self) -> str:
        """Name of the template's macro that prints it."""
        return type(self).__name__.lower()

    @property
    def empty(self) -> bool:
        """Whether there is nothing to print."""
        return not any(getattr(self, name, ()) for name in ("facts", "rows", "svgs", "texts", "terms"))


@dataclass(frozen=True)
class Facts(_Block):
    """A list of labelled values."""

    facts: Sequence[Fact]


@dataclass(frozen=True)
class Headline:
    """A figure to be seen first: `before` (if any) turned into `value`."""

    label: str
    value: str
    unit: str = ""
    before: str = ""
    note: str = ""


@dataclass(frozen=True)
class Verdict:
    """The answer: a word in its tone, one or two sentences, the figures behind it."""

    word: str
    tone: Tone
    sentences: Sequence[str]
    headlines: Sequence[Headline] = ()


@dataclass(frozen=True)
class Cell:
    """A table cell; `tone` other than plain marks it by colour and sign."""

    text: str
    tone: Tone = "plain"
    code: bool = False
    strong: bool = False


@dataclass(frozen=True)
class Row:
    """A table row; `emphasis` marks the chosen one, `note` is printed across the table beneath it."""

    cells: Sequence[Cell]
    emphasis: bool = False
    tone: Tone = "plain"
    note: str = ""


@dataclass(frozen=True)
class Table(_Block):
    """A table with a caption that says what it shows.

    ">Gap [°/h]" is a head with its unit over a column that is right-aligned, as numbers are.
    """

    heads: Sequence[str]
    rows: Sequence[Row]
    caption: str = ""

    @property
    def columns(self) -> list[tuple[str, str, bool]]:
        """Title, unit and whether it is right-aligned, of every column."""
        return [
            (*head.removeprefix(">").removesuffix("]").partition(" [")[::2], head.startswith(">"))
            for head in self.heads
        ]


@dataclass(frozen=True)
class Key:
    """A legend entry."""

    label: str
    paint: Paint
    shape: Literal["line", "band", "dot"] = "line"


@dataclass(frozen=True)
class Figures(_Block):
    """One figure or small multiples on common axes; `columns` is how many stand side by side when wide."""

    svgs: Sequence[Markup]
    caption: str
    keys: Sequence[Key] = ()
    columns: int = 1


@dataclass(frozen=True)
class Notes(_Block):
    """Remarks; a warning in tone 'doubt'."""

    texts: Sequence[str]
    tone: Tone = "plain"


@dataclass(frozen=True)
class Definitions(_Block):
    """Terms and what they mean, set small."""

    terms: Sequence[tuple[str, str]]


def named(name: str, *cells: str | Cell) -> Row:
    """Return a table row under its name in bold; plain texts become cells."""
    return Row([Cell(name, strong=True), *(c if isinstance(c, Cell) else Cell(c) for c in cells)])


Block = Facts | Table | Figures | Notes | Definitions


@dataclass(frozen=True)
class Section:
    """A titled group of blocks; without blocks it is not printed."""

    title: str
    blocks: Sequence[Block]
    intro: str = ""


@dataclass(frozen=True)
class Page:
    """A whole report, ending with its `terms` and what they mean; facts without a value are not printed."""

    title: str
    kind: str
    facts: Sequence[Fact]
    verdict: Verdict
    sections: Sequence[Section] = ()
    terms: Sequence[tuple[str, str]] = ()
    colophon: str = ""
