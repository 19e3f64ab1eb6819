"""A section of the scale-factor test ends before the table leaves its rate, and a run before it is closed."""

import contextlib
from types import SimpleNamespace

import numpy as np

from procedures import scale_factor_cold_shock as scale_factor


class Bench:
    """Writes down the order of what it is told."""

    def __init__(self):
        self.order = []
        self.judge = SimpleNamespace(name="fog_1")
        self.table = SimpleNamespace(
            engage=lambda: self.order.append("servo on"),
            mounting_text="",
            spin=self.spin,
            stop=lambda: self.spin("stop"),
        )
        self.chamber = SimpleNamespace(
            go_to=lambda temp_c: None, start=lambda: None, stop=lambda: self.order.append("chamber stop")
        )

    def spin(self, rate_dps):
        self.order.append(f"spin {rate_dps}")

    def phase(self, name):
        self.order.append(f"phase {name}")

    def ask(self, question, **act):
        self.order.append("ask")

    def event(self, event):
        self.order.append(f"{event.kind} {event.rate_dps}")

    def step(self, code, title):
        return contextlib.nullcontext()


def test_order(monkeypatch):
    bench = Bench()
    parts = ("wait_for_equilibrium", "reference_window", "shock", "return_to_room")
    for name in parts:
        monkeypatch.setattr(scale_factor, name, lambda *_, name=name, **__: bench.order.append(name))
    scale_factor.run(bench, scale_factor.ScaleFactorParameters(rate_dps=5.0))
    for rate in (5.0, -5.0, 0.0):
        assert bench.order.index(f"section {rate}") + 1 == bench.order.index(f"spin {rate}")
    assert bench.order.index("phase close") < bench.order.index("spin stop")
    sections = np.flatnonzero([entry.startswith("section") for entry in bench.order])
    assert [bench.order[at - 1] for at in sections[1:]] == ["return_to_room"] * 2
