"""Compiled signals against cantools on random messages of random DBC files; DBC files that must be refused."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import drivers.can_dbc._dbc
from drivers.base.errors import ConfigurationError
from drivers.can_dbc import MessageLayout
from drivers.can_dbc._dbc import MAX_FILE_BYTES, compile_message, find_message, load_database


def decoded(layout: MessageLayout, data: np.ndarray) -> dict[str, np.ndarray]:
    """Return the physical values of all signals in payloads, NaN where multiplexed away."""
    return {
        name: np.where(signal.present(data), signal.physical(data), np.nan)
        for name, signal in layout.signals.items()
    }


HEAD = 'VERSION ""\nBU_: A\n'


@dataclass(frozen=True)
class Field:
    name: str
    start: int
    bits: int
    big_endian: bool
    signed: bool
    is_float: bool
    group: int | None
    scale: float
    offset: float

    def line(self, multiplexer: bool) -> str:
        mark = " M" if multiplexer else "" if self.group is None else f" m{self.group}"
        sign = "-" if self.signed or self.is_float else "+"
        order = 0 if self.big_endian else 1
        return (
            f" SG_ {self.name}{mark} : {self.start}|{self.bits}@{order}{sign} "
            f'({self.scale!r},{self.offset!r}) [0|0] "" A'
        )


def cells(start: int, bits: int, big_endian: bool) -> set[int]:
    """Return the bits of the payload that a signal covers, counted as DBC files count: 8 * byte + weight."""
    if not big_endian:
        return set(range(start, start + bits))
    first = 8 * (start // 8) + 7 - start % 8
    return {8 * (at // 8) + 7 - at % 8 for at in range(first, first + bits)}


@st.composite
def dbc_texts(draw: st.DrawFn) -> str:
    """Draw a DBC file of one message: whatever fits its bytes, in either byte order, multiplexed or not.

    Its identifier has 11 bits or 29 (bit 31 set, as DBC files have it).
    """
    length = draw(st.integers(1, 8))
    identifier = draw(st.one_of(st.integers(0, 0x7FF), st.integers(0, 0x1FFFFFFF).map(lambda n: n | 1 << 31)))
    has_groups = draw(st.booleans())
    taken: dict[int | None, set[int]] = {None: set(), 0: set(), 1: set(), 5: set()}
    fields: list[Field] = []
    for number in range(draw(st.integers(1, 9))):
        is_multiplexer = has_groups and number == 0
        is_float = not is_multiplexer and draw(st.integers(0, 5)) == 0
        bits = draw(st.sampled_from([32, 64]) if is_float else st.integers(1, 4 if is_multiplexer else 64))
        start, big_endian = draw(st.integers(0, 8 * length - 1)), draw(st.booleans())
        group = draw(st.sampled_from([None, 0, 1, 5])) if has_groups and not is_multiplexer else None
        wanted = cells(start, bits, big_endian)
        others = [set().union(*taken.values())] if group is None else [taken[None], taken[group]]
        if not wanted <= set(range(8 * length)) or any(wanted & other for other in others):
            continue
        taken[group] |= wanted
        signed = not is_multiplexer and draw(st.booleans())
        scale = 1 if is_multiplexer else draw(st.sampled_from([1, 2, -3, 0.5, 0.001953125, 1e-6, 0.01]))
        offset = 0 if is_multiplexer else draw(st.sampled_from([0, 0, -40, 273.15, 100]))
        fields.append(Field(f"S{number}", start, bits, big_endian, signed, is_float, group, scale, offset))
    has_groups = has_groups and bool(fields) and fields[0].name == "S0"
    lines = [
        each.line(has_groups and each.name == "S0") for each in fields if has_groups or each.group is None
    ]
    kinds = [
        f"SIG_VALTYPE_ {identifier} {each.name} : {1 if each.bits == 32 else 2};"
        for each in fields
        if each.is_float and (has_groups or each.group is None)
    ]
    return "\n".join([f"{HEAD}BO_ {identifier} M: {length} A", *lines, "", *kinds, ""])


def decode(message, payload: bytes, scaling: bool) -> dict:
    try:
        return message.decode(payload[: message.length], decode_choices=False, scaling=scaling)
    except cantools.database.DecodeError:  # a multiplexer value that the file does not know
        return {}


@settings(deadline=None, max_examples=150)
@given(dbc_texts(), st.lists(st.binary(min_size=8, max_size=8), min_size=1, max_size=12))
def test_random_messages_of_random_dbc_files(text: str, payloads: list[bytes]) -> None:
    (message,) = cantools.database.load_string(text, database_format="dbc").messages
    layout = compile_message(message)
    table = np.frombuffer(b"".join(payloads), np.uint8).reshape(-1, 8)
    raws = [decode(message, payload, False) for payload in payloads]
    values = [decode(message, payload, True) for payload in payloads]
    with np.errstate(all="ignore"):
        ours = decoded(layout, table)
    assert set(ours) == {signal.name for signal in message.signals}
    assert (layout.identifier, layout.extended) == (message.frame_id, message.is_extended_frame)
    mine = layout.sent_by(
        np.array([layout.identifier] * 2, np.uint32), np.array([layout.extended, not layout.extended])
    )
    assert mine.tolist() == [True, False]  # an identifier of the other size is another message
    for row, (raw, value) in enumerate(zip(raws, values, strict=True)):
        for name, signal in layout.signals.items():
            if name not in raw:
                if raw:
                    assert not signal.present(table)[row]
                continue
            assert signal.present(table)[row]
            with np.errstate(invalid="ignore"):
                np.testing.assert_array_equal(signal.raw(table)[row], raw[name])
            largest = max(abs(float(raw[name]) * signal.scale), abs(signal.offset), 1e-300)
            if np.isfinite(largest):
                np.testing.assert_allclose(
                    ours[name][row], float(value[name]), rtol=1e-15, atol=4e-16 * largest
                )


@settings(deadline=None, max_examples=100)
@given(dbc_texts(), st.binary(min_size=8, max_size=8))
def test_packing_gives_the_bytes_that_cantools_encodes(text: str, payload: bytes) -> None:
    (message,) = cantools.database.load_string(text, database_format="dbc").messages
    layout = compile_message(message)
    raw = decode(message, payload, False)
    if not raw or any(value != value for value in raw.values()):
        return
    expected = message.encode(raw, scaling=False).ljust(8, b"\0")
    bits = {}
    for name, value in raw.items():
        signal = layout.signals[name]
        bits[name] = (
            np.array([value], f"f{signal.bits // 8}").view(f"u{signal.bits // 8}").astype(np.uint64)
            if signal.is_float
            else np.array([value], np.uint64 if signal.bits == 64 and not signal.signed else np.int64)
        )
    assert layout.pack(bits, 1)[0].tobytes() == expected


@settings(deadline=None, max_examples=100)
@given(dbc_texts(), st.lists(st.floats(-1e6, 1e6), min_size=9, max_size=9))
def test_quantised_values_decode_to_the_nearest(text: str, wanted: list[float]) -> None:
    (message,) = cantools.database.load_string(text, database_format="dbc").messages
    for signal, value in zip(compile_message(message).signals.values(), wanted, strict=False):
        low, high = (
            (-(2 ** (signal.bits - 1)), 2 ** (signal.bits - 1) - 1)
            if signal.signed
            else (0, 2**signal.bits - 1)
        )
        raw = signal.quantise([value])
        if signal.is_float:
            kind = np.float32 if signal.bits == 32 else np.float64
            assert raw.astype(f"u{signal.bits // 8}").view(kind)[0] == kind(
                (value - signal.offset) / signal.scale
            )
            continue
        nearest = min(max((value - signal.offset) / signal.scale, low), high)
        assert low <= int(raw[0]) <= high
        assert abs(int(raw[0]) - nearest) <= 0.5 + 1e-9 * abs(nearest)


NESTED = (
    HEAD
    + """BO_ 256 M: 8 A
 SG_ Top M : 0|4@1+ (1,0) [0|0] "" A
 SG_ Page m1M : 8|8@1+ (1,0) [0|0] "" A
 SG_ Rate m3 : 16|16@1- (0.01,0) [0|0] "deg/s" A
 SG_ Other m2 : 16|8@1+ (1,0) [0|0] "" A

SG_MUL_VAL_ 256 Page Top 1-2;
SG_MUL_VAL_ 256 Rate Page 3-5, 9-9;
SG_MUL_VAL_ 256 Other Page 2-2;
"""
)


def test_multiplexers_below_multiplexers() -> None:
    (message,) = cantools.database.load_string(NESTED).messages
    layout = compile_message(message)
    rng = np.random.default_rng(2)
    payloads = rng.integers(0, 256, (400, 8), np.uint8)
    payloads[:, 0] = rng.integers(0, 4, 400)
    payloads[:, 1] = rng.integers(0, 11, 400)
    known = 0
    for row, payload in enumerate(payloads):
        expected = decode(message, payload.tobytes(), True)
        if expected:
            known += 1
            found = (
                {name: values[row] for name, values in decoded(layout, payloads).items()}
                if row < 40
                else None
            )
            present = {
                name for name, signal in layout.signals.items() if signal.present(payloads[row : row + 1])[0]
            }
            assert present == set(expected)
            if found is not None:
                assert {name for name, value in found.items() if value == value} == set(expected)
    assert known > 50


OVERLAP = (
    HEAD
    + """BO_ 5 GYRO: 8 A
 SG_ RATE_X : 0|16@1- (1,0) [0|0] "" A
 SG_ RATE_Y : 8|16@1- (1,0) [0|0] "" A
"""
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (OVERLAP, "signals RATE_. and RATE_. are overlapping in message GYRO"),
        (HEAD + 'BO_ 5 M: 2 A\n SG_ S : 8|16@1+ (1,0) [0|0] "" A\n', "signal S does not fit in message M"),
        (HEAD + 'BO_ 5 M: 8 A\n SG_ S : 0|3000000000@1+ (1,0) [0|0] "" A\n', "MiB of memory"),
        (HEAD + 'BO_ 5 M: 8 A\n SG_ S : 0//\n|+3000000000@1+ (1,0) [0|0] "" A\n', "MiB of memory"),
        (HEAD + "BO_ " + "9" * 5000 + " M: 8 A\n", "4300 digits"),
        (NESTED.replace("3-5, 9-9", "3-4000000000"), "MiB of memory"),
        ("BO_ BO_ BO_", "cannot be read"),
        ("\0\xff\x80" * 100, "cannot be read"),
    ],
)
def test_files_that_are_wrong_or_hostile_are_refused_at_once(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "unit.dbc"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=message):
        load_database(path)


def test_two_kilobytes_of_multiplexers_take_no_more_than_their_time(tmp_path: Path, monkeypatch) -> None:
    """Each of 30 in a chain has four values: cantools makes a tree of 4**30 branches, or would."""
    signals = [' SG_ S0 M : 0|2@1+ (1,0) [0|0] "" A']
    signals += [f' SG_ S{k} m0M : {2 * k}|2@1+ (1,0) [0|0] "" A' for k in range(1, 31)]
    values = [f"SG_MUL_VAL_ 5 S{k} S{k - 1} 0-3;" for k in range(1, 31)]
    path = tmp_path / "unit.dbc"
    path.write_text("\n".join([HEAD + "BO_ 5 M: 8 A", *signals, *values, ""]), encoding="utf-8")
    monkeypatch.setattr(drivers.can_dbc._dbc, "_CPU_S", 2)
    with pytest.raises(ConfigurationError, match=r"more than 2 s of computing"):
        load_database(path)


def test_multiplexers_that_depend_on_each_other_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "unit.dbc"
    signals = ' SG_ A m0M : 0|8@1+ (1,0) [0|0] "" N\n SG_ B m0M : 8|8@1+ (1,0) [0|0] "" N\n'
    values = "SG_MUL_VAL_ 5 A B 0-0;\nSG_MUL_VAL_ 5 B A 0-0;\n"
    path.write_text(HEAD + "BO_ 5 M: 8 A\n" + signals + values, encoding="utf-8")
    with pytest.raises(ConfigurationError, match="multiplexer"):
        compile_message(find_message(path, "M"))


@pytest.mark.parametrize("outermost_first", [True, False])
@pytest.mark.parametrize("levels", [8, 9, 40])
def test_at_most_eight_multiplexers_stand_inside_one_another_in_whatever_order(
    tmp_path: Path, levels: int, outermost_first: bool
) -> None:
    """A layout doubles with each: forty would take for ever to compare."""
    lines, values = [], []
    for level in range(levels + 1):
        bit = level if outermost_first else levels - level
        kind = "M" if level == 0 else "m0" if level == levels else "m0M"
        lines.append((bit, f' SG_ S{level} {kind} : {bit}|1@1+ (1,0) [0|0] "" N'))
        values += [f"SG_MUL_VAL_ 5 S{level} S{level - 1} 0-0;"] if level else []
    path = tmp_path / "unit.dbc"
    path.write_text("\n".join([HEAD + "BO_ 5 M: 8 A", *(text for _, text in sorted(lines)), *values, ""]))
    if levels == 8:
        assert len(compile_message(find_message(path, "M")).signals["S8"].selectors) == 8
    else:
        with pytest.raises(ConfigurationError, match="multiplexer level 9") as refused:
            compile_message(find_message(path, "M"))
        assert "at most 8 multiplexers" in refused.value.expected


def test_a_file_of_any_size_is_read_only_so_far(tmp_path: Path) -> None:
    path = tmp_path / "huge.dbc"
    with path.open("wb") as file:
        file.truncate(MAX_FILE_BYTES * 1000)
    with pytest.raises(ConfigurationError, match="more than 4 MiB"):
        load_database(path)


def test_utf8_and_windows_files_give_the_same_unit(tmp_path: Path) -> None:
    text = HEAD + 'BO_ 5 M: 2 A\n SG_ S : 0|16@1- (1,0) [0|0] "°/s" A\n'
    for encoding in ("utf-8", "cp1252"):
        path = tmp_path / f"{encoding}.dbc"
        path.write_bytes(text.encode(encoding))
        assert compile_message(find_message(path, "M")).signals["S"].unit == "°/s"


def test_messages_of_can_fd_are_refused_when_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "fd.dbc"
    path.write_text(HEAD + 'BO_ 5 M: 64 A\n SG_ S : 0|16@1- (1,0) [0|0] "" A\n', encoding="utf-8")
    with pytest.raises(ConfigurationError, match="64 bytes"):
        compile_message(find_message(path, "M"))
    with pytest.raises(ConfigurationError, match="no message MM") as caught:
        find_message(path, "MM")
    assert "did you mean" in caught.value.expected
