"""The part of the page that is plain HTML: sent with its values, painted before any script has run."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from html import escape
from pathlib import Path

_ASSETS = Path(__file__).parent / "assets"
_PARTS = (
    ("happened", "What happened"),
    ("done", "What the bench has done"),
    ("press", "What to press"),
)


@cache
def style_sheet() -> str:
    """Return the style sheet; dark by the page's own switch, or by the browser's wish until that is there."""
    dark = (_ASSETS / "dark.css").read_text(encoding="utf-8")
    return (
        (_ASSETS / "panel.css").read_text(encoding="utf-8")
        + f"body.body--dark {{ {dark} }}\n"
        + f"@media (prefers-color-scheme: dark) {{ body:not(.body--light) {{ {dark} }} }}\n"
    )


def first_paint(values: Mapping[str, str], banner: Mapping[str, str]) -> str:
    """Return names, banner, cards and lists with the values there are; panel.js moves them to their places."""
    live = _Live(values)
    return f'<div id="first-paint" class="panel">{_names(live)}{_banner(banner)}{_cards(live)}{_LISTS}</div>'


class _Live:
    """Makes places for texts that change, each with the text it has now."""

    def __init__(self, values: Mapping[str, str]) -> None:
        self._values = values

    def span(self, key: str, unit: str = "", style: str = "value", default: str = "–") -> str:
        """Return a place for the text of that key, with its unit."""
        text = escape(self._values.get(key, default))
        tail = f'<span class="unit">{unit}</span>' if unit else ""
        return f'<span class="{style}" data-live="{key}">{text}</span>{tail}'

    def pair(self, label: str, key: str, unit: str = "") -> str:
        """Return a labelled place."""
        return f"<div><dt>{label}</dt><dd>{self.span(key, unit)}</dd></div>"


def _names(live: _Live) -> str:
    return f"""<div data-move="names">
<h1>{live.span("title", style="title", default="gyrobench")}</h1>
<p class="sub">{live.span("count", style="", default="")}{live.span("campaign_left", style="", default="")}
{live.span("age", style="late", default="")}</p></div>"""


def _banner(banner: Mapping[str, str]) -> str:
    rows = "".join(
        f"<div{'' if banner[key] else ' hidden'}><dt>{label}</dt>"
        f'<dd data-part="{key}">{escape(banner[key])}</dd></div>'
        for key, label in _PARTS
    )
    return f"""<section class="banner {escape(banner["tone"])}" data-banner data-move="banner" role="status"
aria-live="polite"><p class="word" data-word data-testid="state">{escape(banner["word"])}</p>
<dl>{rows}</dl></section>"""


def _cards(live: _Live) -> str:
    return f"""<section class="cards" data-move="cards">
<article class="card run"><h2>Run</h2>
<p class="head">{live.span("step", style="")}</p><p class="doing">{live.span("doing", style="")}</p>
<div class="progress"><i data-progress></i></div>
<p class="times"><span>{live.span("elapsed")} gone</span><span>{live.span("left")} left</span></p>
<dl>{live.pair("Phase", "phase")}{live.pair("Procedure", "procedure")}{live.pair("Run", "run")}
{live.pair("Units", "units")}</dl><p class="speed">{live.span("speed", style="", default="")}</p></article>
<article class="card"><h2>Chamber</h2>
<p class="main">{live.span("air", "°C", "value big")}</p>
<p class="note">{live.span("last_read", style="", default="")}</p>
<dl>{live.pair("Set point", "set", "°C")}{live.pair("Rate", "air_rate", "K/min")}</dl><dl data-auxiliary></dl>
</article>
<article class="card"><h2>Table</h2>
<p class="main">{live.span("rate", "°/s", "value big")}</p>
<p class="note">{live.span("last_read", style="", default="")}</p>
<dl>{live.pair("Angle", "angle", "°")}{live.pair("Demand", "demand")}</dl></article>
<div class="gyros" data-gyros></div></section>"""


_LISTS = """<section class="lists" data-move="lists">
<article class="card alarms"><h2>Alarms</h2><ol data-list="alarms"></ol></article>
<article class="card log"><h2>Log</h2><ol data-list="log"></ol></article></section>"""
