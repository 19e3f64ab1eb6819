"""ASCII lines: the shipped descriptions' vectors, any chunks, damage, and random text."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base.errors import ConfigurationError
from drivers.frames import FrameDecoder, LineEncoder, load_family, reader_of, shipped, vector_mistakes
from drivers.frames._kind import Frames
from drivers.frames._load import family_from, load_toml
from drivers.kit.instruments import has_counter
from tests.drivers.frames.test_frames_bench import bench_file
from tests.drivers.frames.test_frames_bench import run as run_bench

LINES = ("kvh_dsp3000", "novatel_rawimusa", "novatel_rawimusxa", "vectornav_ascii", "vectornav_ymr")
# NovAtel's own framer tests have this line.
NOVATEL = (
    b"%RAWIMUSXA,1692,484620.664;00,11,1692,484620.664389000,00801503,"
    b"43110635,-817242,-202184,-215194,-41188,-9895*a5db8c7b\r\n"
)


@pytest.mark.parametrize("name", LINES)
def test_vectors(name: str) -> None:
    assert [str(mistake) for mistake in vector_mistakes(load_family(name))] == []


@pytest.mark.parametrize("name", ["kvh_dsp3000", "novatel_rawimusxa", "vectornav_ascii", "vectornav_ymr"])
def test_a_line_that_was_read_is_written_as_its_maker_writes_it(name: str) -> None:
    """Vectors from outside: read, written anew from the numbers, the same text, its check too."""
    family = load_family(name)
    line = NOVATEL if name == "novatel_rawimusxa" else family.description.vector[0].text.encode() + b"\r\n"
    (messages,) = reader_of(family).feed(line)
    values = {key: column for key, column in messages.columns().items() if not np.isnan(column).any()}
    written = LineEncoder(family).encode(1, values)
    if name == "novatel_rawimusxa":  # its two header columns are no field and stay those of the vector
        written = written.replace(written[: written.index(b";")], line[: line.index(b";")])
        assert written[: written.index(b"*")] == line[: line.index(b"*")]
    else:
        assert written == line


@pytest.mark.parametrize("name", LINES)
def test_what_is_written_is_read(name: str) -> None:
    family = load_family(name)
    encoder = LineEncoder(family)
    rng = np.random.default_rng(1)
    values = {
        spec.name: np.round(rng.normal(0.0, 3.0, 40), 3)
        for spec in encoder.form.fields
        if spec.role in ("rate", "delta_angle")
    }
    (messages,) = reader_of(family).feed(encoder.encode(40, values))
    columns = messages.columns()
    for key, sent in values.items():
        step = next(spec.scale.factor for spec in encoder.form.fields if spec.name == key)
        np.testing.assert_allclose(columns[key], sent, atol=max(1e-6, abs(step)))


@pytest.mark.parametrize(
    ("name", "axes", "column", "rate_dps"),
    [
        ("kvh_dsp3000", "z", "rate_dps", 0.0),
        ("novatel_rawimusa", "xyz", "rate_y_dps", 5.0),
    ],  # z lies level on the table, y is up
)
def test_a_gyro_that_sends_lines_through_the_bench(
    tmp_path: Path, name: str, axes: str, column: str, rate_dps: float
) -> None:
    text = f'''
[[gyro]]
name = "fog"
driver = "frames"
description = "{name}"
port = "/dev/ttyUSB1"
axes = "{axes}"
axis = "z"
unit = "L1"
'''
    result = run_bench(bench_file(tmp_path, text), tmp_path / "runs")
    assert result.outcome == "completed", result.reason
    table = pq.read_table(result.folder / "gyro_fog.parquet").to_pandas()
    assert table["lost_before"].sum() == 0 and table["valid"].all()
    turning = table.iloc[len(table) // 2 : len(table) // 2 + 300]
    assert turning[column].mean() == pytest.approx(rate_dps, abs=0.1)


def test_novatel_increments_become_rates_and_accelerations() -> None:
    settings_ = Frames.config(
        name="span",
        driver="frames",
        unit="1",
        description="novatel_rawimusxa",
        axes="xyz",
        axis="z",
    )
    columns = Frames.decoder(settings_).feed(b"RUBBISH" + NOVATEL).columns
    assert columns["counter"].tolist() == [484620664389]
    # A SPAN-CPT's counts: 0.1 / (3600 * 256) rad and 0.05 / 2**15 m/s (NovAtel OEM6 SPAN reference).
    rate = Frames.rates(settings_, columns, 100.0)
    assert rate["y"][0] == pytest.approx(np.degrees(41188 * 0.1 / 3600 / 256) * 100.0, rel=1e-12)
    assert Frames.accelerations is not None
    acceleration = Frames.accelerations(settings_, columns, 100.0)
    assert acceleration["z"][0] == pytest.approx(43110635 * 0.05 / 2**15 * 100.0, rel=1e-12)


@given(cuts=st.lists(st.integers(1, 40), min_size=1, max_size=5), broken=st.sets(st.integers(0, 5)))
@settings(max_examples=60, deadline=None)
def test_any_chunks_and_damage_give_the_sound_lines(cuts: list[int], broken: set[int]) -> None:
    stream = b""
    for n in range(6):
        stream += NOVATEL.replace(b"-817242", b"-817243") if n in broken else NOVATEL
    decoder, ends, at, turn = (
        FrameDecoder(load_family("novatel_rawimusxa"), rate_hz=100.0, axes="z"),
        [],
        0,
        0,
    )
    while at < len(stream):
        size = cuts[turn % len(cuts)]
        ends += decoder.feed(stream[at : at + size]).end_offset.tolist()
        at, turn = at + size, turn + 1
    assert ends == [len(NOVATEL) * (n + 1) for n in range(6) if n not in broken]
    assert decoder.counts.rejected == ({"checksum": len(broken)} if broken else {})


def test_a_broken_line_leaves_a_gap_where_there_is_no_counter() -> None:
    stream = b"  0.01   1\r\n  0.0x   1\r\n  0.02   0\r\n\r\n"
    decoder = FrameDecoder(load_family("kvh_dsp3000"), rate_hz=100.0, axes="z")
    assert not has_counter(decoder)
    assert has_counter(FrameDecoder(load_family("novatel_rawimusxa"), rate_hz=100.0, axes="z"))
    batch = decoder.feed(stream)
    assert batch.columns["counter"].tolist() == [0, 2]
    assert batch.columns["rate_z"].tolist() == [0.01, 0.02]
    assert batch.columns["valid"].tolist() == [True, False]


@pytest.mark.parametrize("name", LINES)
@given(
    data=st.lists(st.sampled_from([b"\n", b",", b";", b"*", b" ", b"1", b"nan", b"1e999", b"\xff", NOVATEL]))
)
@settings(max_examples=60, deadline=None)
def test_no_text_raises(name: str, data: list[bytes]) -> None:
    reader_of(load_family(name)).feed(b"".join(data))
    FrameDecoder(load_family(name), rate_hz=100.0, axes="z").feed(b"".join(data))


def test_a_line_without_an_end_does_not_fill_the_memory() -> None:
    reader = reader_of(load_family("kvh_dsp3000"))
    for _ in range(100):
        reader.feed(b"1 " * 500)
    assert reader.pending <= 2048 and reader.counts.bytes_skipped > 90_000


def test_a_column_that_is_not_there_is_named() -> None:
    data = load_toml(shipped()["kvh_dsp3000"])
    data["field"][1]["at"] = 2
    with pytest.raises(ConfigurationError, match=r"field 'flag'\.at"):
        family_from(data, "mine.toml")
