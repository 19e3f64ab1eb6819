"""One line with one fault: what comes out differs from what went in exactly as the fault's name says."""

import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base.errors import ConfigurationError
from simulators.faults import Fault, WireShape
from simulators.interfaces import Reply, StreamBlock
from simulators.lab._line import Line, Schedule
from simulators.plant.noise import NoiseSource

FRAME = 12


def frame(number: int) -> bytes:
    """Number, six bytes of padding, CRC-32 of both: a frame that says itself whether it is whole."""
    body = number.to_bytes(2, "big") + b"padded"
    return body + zlib.crc32(body).to_bytes(4, "big")


def sent(first: int, count: int) -> StreamBlock:
    """Frame k is out at (k + 1) / 10 s; a mark every fifth and at the end."""
    ends = sorted({*range(5, count, 5), count})
    marks = [(n * FRAME, (first + n) * 100_000_000) for n in ends]
    return StreamBlock(b"".join(frame(first + k) for k in range(count)), np.array(marks, np.int64))


def through(line: Line, blocks: int, each: int = 40) -> tuple[bytes, list[tuple[int, int]]]:
    """Pass `blocks` deliveries of 4 s; return the bytes and the marks with offsets of the whole stream."""
    data, marks = b"", []
    for k in range(blocks):
        start = k * each
        block = line.block(sent(start, each), start / 10.0, (start + each) / 10.0)
        if block is not None:
            marks += [(len(data) + int(n), int(t)) for n, t in block.marks]
            data += block.data
    return data, marks


SHAPE = WireShape(frame_bytes=FRAME, check_bytes=4)


def line(seed=1, wire=SHAPE, **fault) -> Line:
    return Line("gyro", [Fault(port="gyro", **fault)], seed=seed, wire=wire, device_faults={})


WHOLE = b"".join(frame(k) for k in range(120))


def numbers(data: bytes) -> list[int]:
    """Return the numbers of the frames in `data`, which must be whole ones."""
    assert len(data) % FRAME == 0
    frames = [data[k : k + FRAME] for k in range(0, len(data), FRAME)]
    assert all(zlib.crc32(each[:8]) == int.from_bytes(each[8:], "big") for each in frames)
    return [int.from_bytes(each[:2], "big") for each in frames]


def test_a_line_without_faults_changes_nothing():
    quiet = Line("gyro", [], seed=1, wire=None, device_faults={})
    assert through(quiet, 3)[0] == WHOLE
    assert quiet.reply(Reply(3.0, b"OK")) == Reply(3.0, b"OK")


def test_bytes_are_dropped_from_the_frame_that_is_out_next():
    data, _ = through(line(kind="drop", at_s=(5.03,), count=3), 3)
    # frame 50 is out at 5.1 s; three neighbouring bytes of it are missing
    assert data[: 50 * FRAME] == WHOLE[: 50 * FRAME]
    assert data[51 * FRAME - 3 :] == WHOLE[51 * FRAME :]
    left = data[50 * FRAME : 51 * FRAME - 3]
    assert any(left == frame(50)[:at] + frame(50)[at + 3 :] for at in range(FRAME - 2))


def test_bytes_come_twice():
    data, _ = through(line(kind="repeat", at_s=(0.0,), count=2), 3)
    assert data[FRAME + 2 :] == WHOLE[FRAME:]
    assert any(data[: FRAME + 2] == frame(0)[: at + 2] + frame(0)[at:] for at in range(FRAME - 1))


@pytest.mark.parametrize("count", [1, 7])
def test_exactly_as_many_bits_are_inverted(count):
    data, _ = through(line(kind="flip", at_s=(7.0,), count=count), 3)
    different = int.from_bytes(data, "big") ^ int.from_bytes(WHOLE, "big")
    assert len(data) == len(WHOLE)
    assert different.bit_count() == count
    frames = {at // FRAME for at, (a, b) in enumerate(zip(data, WHOLE, strict=True)) if a != b}
    assert frames == {69}  # out at 7.0 s


def test_a_wrong_check_value_leaves_the_rest_intact():
    data, _ = through(line(kind="bad_check", at_s=(7.0,)), 3)
    wrong = [at for at, (a, b) in enumerate(zip(data, WHOLE, strict=True)) if a != b]
    assert len(wrong) == 1
    assert 69 * FRAME + 8 <= wrong[0] < 70 * FRAME


def test_stray_bytes_come_before_a_frame():
    data, _ = through(line(kind="noise", at_s=(7.0,), count=5), 3)
    assert data[: 69 * FRAME] + data[69 * FRAME + 5 :] == WHOLE


def test_a_truncated_frame_is_the_beginning_of_it():
    data, _ = through(line(kind="truncate", at_s=(7.0,)), 3)
    lost = len(WHOLE) - len(data)
    assert 1 <= lost <= FRAME
    assert data == WHOLE[: 70 * FRAME - lost] + WHOLE[70 * FRAME :]


def test_whole_frames_are_lost_across_deliveries_and_the_counter_jumps():
    data, _ = through(line(kind="lose", at_s=(3.9,), count=5), 3)
    assert numbers(data) == [*range(38), *range(43, 120)]  # frame 38 is out at 3.9 s


def test_a_frame_comes_twice():
    data, _ = through(line(kind="double", at_s=(1.0, 2.0)), 3)
    assert numbers(data) == [*range(10), 9, *range(10, 20), 19, *range(20, 120)]


def test_silence_lasts_as_long_as_it_says():
    data, marks = through(line(kind="silence", at_s=(2.05,), duration_s=4.0), 3)
    assert numbers(data) == [*range(20), *range(60, 120)]  # nothing of 2.05 to 6.05 s
    assert not [t for _, t in marks if 2_050_000_000 <= t < 6_050_000_000]


def test_a_delay_holds_everything_and_loses_nothing():
    data, marks = through(line(kind="delay", at_s=(2.05,), duration_s=5.0), 3)
    assert data == WHOLE
    times = [t for _, t in marks]
    assert times == sorted(times)
    assert not [t for t in times if 2_100_000_000 <= t < 7_100_000_000]  # frame 20 is out at 2.1 s


KINDS = ["drop", "repeat", "flip", "noise", "truncate", "bad_check", "double", "lose", "delay", "silence"]


@settings(max_examples=60, deadline=None)
@given(
    kinds=st.lists(st.sampled_from(KINDS), min_size=1, max_size=4),
    rate=st.floats(60.0, 20_000.0),
    count=st.integers(1, 30),
    seed=st.integers(0, 2**32),
)
def test_marks_stay_in_order_and_cover_every_byte_and_the_seed_says_it_all(kinds, rate, count, seed):
    faults = [Fault(port="gyro", kind=kind, rate_per_h=rate, count=count, duration_s=0.7) for kind in kinds]

    def run():
        damaged = Line("gyro", faults, seed=seed, wire=SHAPE, device_faults={})
        return (*through(damaged, 5), damaged.struck)

    data, marks, struck = run()
    counts, times = [n for n, _ in marks], [t for _, t in marks]
    assert counts == sorted(set(counts))
    assert times == sorted(times)
    assert (counts[-1] if counts else 0) == len(data)
    assert run() == (data, marks, struck)


def test_random_instants_are_a_poisson_process_of_the_rate_asked_for():
    fault = Fault("gyro", "drop", rate_per_h=3600.0, start_s=100.0, end_s=10_100.0)
    schedule, instants = Schedule(fault, NoiseSource(5, "test")), []
    while (at := schedule.next_s) < np.inf:
        instants.append(at)
        schedule.take_until(at)
    assert instants[0] > 100.0 and instants[-1] <= 10_100.0
    # 10 000 expected: 5 sigma either way; gaps of an exponential have a spread equal to their mean
    assert abs(len(instants) - 10_000) < 500
    gaps = np.diff(instants)
    assert gaps.std() == pytest.approx(gaps.mean(), rel=0.05)


def test_replies_are_late_lost_and_never_overtake():
    late = line(kind="delay", at_s=(10.0,), duration_s=2.5, wire=None)
    assert late.reply(Reply(9.9, b"a")) == Reply(9.9, b"a")
    assert late.reply(Reply(10.5, b"b")) == Reply(13.0, b"b")
    assert late.reply(Reply(11.0, b"c")) == Reply(13.0, b"c")
    assert late.reply(Reply(14.0, b"d")) == Reply(14.0, b"d")
    mute = line(kind="silence", at_s=(10.0,), duration_s=2.0, wire=None)
    assert [mute.reply(Reply(t, b"x")) is None for t in (9.9, 10.5, 11.9, 12.0)] == [False, True, True, False]
    losing = line(kind="lose", at_s=(10.0,), count=2, wire=None)
    assert [losing.reply(Reply(t, b"x")) is None for t in (9.0, 10.0, 11.0, 12.0)] == [
        False,
        True,
        True,
        False,
    ]


def test_what_the_bench_writes_is_damaged_once_and_as_the_kind_says():
    written = bytes(range(65, 85))
    lost = line(kind="drop_command", at_s=(10.0,), count=3, wire=None)
    assert lost.command(written, 9.9) == written
    short = lost.command(written, 12.0)
    assert any(short == written[:at] + written[at + 3 :] for at in range(18))
    assert lost.command(written, 13.0) == written
    assert [(entry["time_s"], entry["kind"]) for entry in lost.struck] == [(12.0, "drop_command")]
    wrong = line(kind="flip_command", at_s=(0.0,), count=2, wire=None).command(written, 0.0)
    assert sum((a ^ b).bit_count() for a, b in zip(wrong, written, strict=True)) == 2
    noisy = line(kind="noise_command", at_s=(0.0,), count=4, wire=None).command(written, 0.0)
    assert len(noisy) == 24 and noisy.endswith(written)
    # Replies go by untouched.
    assert line(kind="flip_command", at_s=(0.0,), wire=None).reply(Reply(1.0, b"OK")) == Reply(1.0, b"OK")


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ({"kind": "gremlin", "at_s": (1.0,)}, ["'gremlin'", "drop", "vanish", "trip"]),
        ({"kind": "drop"}, ["rate_per_h 0"]),
        ({"kind": "drop", "at_s": (1.0,), "rate_per_h": 2.0}, ["one of the two"]),
        ({"kind": "silence", "at_s": (1.0,)}, ["duration_s 0"]),
        ({"kind": "vanish", "at_s": (1.0,)}, ["duration_s 0"]),
        ({"kind": "flip", "at_s": (1.0,), "count": 0}, ["count 0"]),
        ({"kind": "bad_check", "at_s": (1.0,)}, ["no check value"]),
    ],
)
def test_a_fault_that_cannot_be_is_refused_with_its_reason(fault, words):
    with pytest.raises(ConfigurationError) as refusal:
        Line(
            "table",
            [Fault(port="table", **fault)],
            seed=0,
            wire=None,
            device_faults={"trip": lambda fault, now_s: None},
        )
    assert all(word in str(refusal.value) for word in [*words, "'table'", "docs/faults.md"])
