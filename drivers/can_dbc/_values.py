"""Where a decoder finds the values of each signal, worked out once for all calls: small blocks come often."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.can_dbc._layout import CanLayout, SignalUse, ValidRule


@dataclass
class Block:
    """Samples: payloads (n, 8) by slot, offsets just past each (n,), and the frames that values are held from."""

    parts: list[NDArray[np.uint8]]
    end_offset: NDArray[np.int64]
    held: Mapping[str, NDArray[np.void]]

    def __len__(self) -> int:
        return len(self.end_offset)


class Source:
    """Where the values of a signal are, worked out once: in which frame of a sample, or held from another."""

    def __init__(self, layout: CanLayout, use: SignalUse | ValidRule) -> None:
        self.signal = layout.signal(use)
        self._slot = layout.slot_of(use)
        self._message = use.message

    def _payload(self, block: Block) -> tuple[NDArray[np.uint8], NDArray[np.bool_] | bool]:
        """Return the payload that has the signal for each row, and whether there is one."""
        signal = self.signal
        if self._slot is not None:
            part = block.parts[self._slot]
            return part, signal.present(part) if signal.selectors else True
        source = block.held[self._message]
        if signal.selectors:
            source = source[signal.present(source["data"])]
        if not len(source):
            return np.zeros((len(block), 8), np.uint8), np.zeros(len(block), np.bool_)
        at = np.searchsorted(source["end_offset"], block.end_offset) - 1
        return source["data"][np.maximum(at, 0)], at >= 0

    def raw(self, block: Block) -> tuple[NDArray[Any], NDArray[np.bool_] | bool]:
        """Return the raw values, and which of them are known."""
        payload, known = self._payload(block)
        return self.signal.raw(payload), known


class Values(Source):
    """Where the physical values of a signal are."""

    def __init__(self, layout: CanLayout, use: SignalUse) -> None:
        super().__init__(layout, use)
        self._use = use
        turned = use.role in ("rate", "delta_angle")
        self.must_be_finite = turned and (use.raw_range is not None or self.signal.is_float)

    def physical(self, block: Block) -> NDArray[np.float32]:
        """Return the values in the unit of the use, NaN where unknown."""
        use = self._use
        payload, known = self._payload(block)
        values = self.signal.physical(payload)
        if use.factor != 1.0:
            values *= use.factor
        if use.zero:
            values += use.zero
        if use.raw_range is not None:
            raw = self.signal.raw(payload)
            known = known & (raw >= use.raw_range[0]) & (raw <= use.raw_range[1])
        if known is not True:
            values[~np.asarray(known)] = np.nan
        return values.astype(np.float32)


def columns_of(layout: CanLayout, axes: str) -> Iterator[tuple[str, SignalUse | None]]:
    """Yield the name of each column of physical values and what it shows, None for nothing."""
    rates = layout.rates()
    for axis in axes:
        yield f"rate_{axis}_dps" if rates[axis].role == "rate" else f"angle_{axis}_deg", rates[axis]
    for axis, use in layout.accelerations().items():
        yield f"accelerometer_{axis}_mps2", use
    yield "temp_c", layout.use("temperature")
    if (case := layout.use("case_temperature")) is not None:
        yield "case_temp_c", case


def merged(rules: list[ValidRule]) -> list[tuple[ValidRule, int, int]]:
    """Return rules, masks and values: those about one signal are one, unless they contradict each other."""
    found: list[tuple[ValidRule, int, int]] = []
    for rule in rules:
        for at, (other, mask, equals) in enumerate(found):
            both = mask & rule.mask
            if (other.message, other.signal) == (rule.message, rule.signal) and not (
                equals ^ rule.equals
            ) & both:
                found[at] = other, mask | rule.mask, equals | rule.equals
                break
        else:
            found.append((rule, rule.mask, rule.equals))
    return found
