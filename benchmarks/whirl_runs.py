"""Runs with rotation, made by the plant, carried as bytes by the emulated gyro and table."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bench.analysis.whirl._angle import align_angle
from bench.analysis.whirl._runs import Turns
from bench.analysis.whirl._types import TurnRecord
from benchmarks._without import effect_names, without
from drivers.acutrol import decode_transcript, encode_state_query
from drivers.kit.config import TableConfig
from drivers.kvh import KvhDecoder
from simulators.emulators.acutrol import AcutrolEmulator
from simulators.emulators.kvh import KvhEmulator
from simulators.plant import LabPlant, PlantConfig, TableParameters, UnitConfig
from simulators.plant.triad import triad_unit
from simulators.plant.wobble import Wobble

LATITUDE_DEG = 40.0
QUIET = tuple(effect_names(triad_unit(0)))
STILL = TableParameters(ripple_once_ppm=0.0, ripple_twice_ppm=0.0, encoder_error_arcsec=0.0)
TABLE = TableParameters(encoder_error_arcsec=3.0, encoder_noise_arcsec=2.0)


@dataclass(frozen=True)
class Plan:
    """Stretches of (duration_s, rate_dps), rest before and after, and what is turned."""

    stretches: Sequence[tuple[float, float]]
    wobble: Wobble
    seed: int = 1
    rate_hz: int = 100
    rest_s: float = 30.0
    table: TableParameters = TABLE
    without: tuple[str, ...] = ()
    azimuth_deg: float = 0.3
    tilt_deg: float = 0.2
    clock_error_ppm: float = 0.0
    poll_s: float = 1.0


def emulate(plan: Plan) -> tuple[TurnRecord, Turns]:
    """Return the rotating part of a run (exactly the stretches), and the whole of it with its alignment.

    Gyro and table are read as bytes by the drivers' codecs, the table once a second.
    """
    unit = UnitConfig(
        "ins",
        model="ins_triad",
        mount_azimuth_error_deg=plan.azimuth_deg,
        tilt_deg=plan.tilt_deg,
        change=without(*plan.without),
        wobble=plan.wobble,
    )
    lab = LabPlant(PlantConfig(latitude_deg=LATITUDE_DEG, seed=plan.seed, table=plan.table, units=(unit,)))
    gyro = KvhEmulator(
        lab.unit("ins"),
        serial_number="INS-1",
        axes="xyz",
        streaming=True,
        clock_error_ppm=plan.clock_error_ppm,
        settings={"DR": str(plan.rate_hz)},
    )
    table, decoder = AcutrolEmulator(lab.table), KvhDecoder(nominal_rate_hz=plan.rate_hz, axes="xyz")
    edges = np.cumsum([0.0, plan.rest_s, *(duration for duration, _ in plan.stretches), plan.rest_s])
    demands = dict(
        zip(edges[1:-1].tolist(), [*(rate for _, rate in plan.stretches), 0.0][: len(edges) - 2], strict=True)
    )
    times = np.union1d(np.arange(1, int(edges[-1] / plan.poll_s) + 1) * plan.poll_s, list(demands))
    lab.table.servo(0.0, True)
    rates: list[NDArray[np.float64]] = []
    exchanges: list[tuple[int, Literal["sent", "received"], bytes]] = []
    for now in times.tolist():
        lab.advance(now)
        if (block := gyro.stream(now)) is not None:
            columns = decoder.feed(block.data).columns
            rates.append(np.stack([columns[f"rot_{axis}"] for axis in "xyz"], axis=1))
        query = encode_state_query(1)
        exchanges.append((round(now * 1e9), "sent", query))
        exchanges += [
            (round(reply.at_s * 1e9), "received", reply.data) for reply in table.receive(query, now)
        ]
        if now in demands:
            lab.table.demand_rate(now, demands[now])
    return _records(
        plan,
        np.concatenate(rates),
        decode_transcript(exchanges, TableConfig(driver="acutrol3000", port="memory", baudrate=9600))[0],
        edges,
    )


def _records(
    plan: Plan, increments: NDArray[Any], polls: dict[str, NDArray[Any]], edges: NDArray[np.float64]
) -> tuple[TurnRecord, Turns]:
    period = 1.0 / plan.rate_hz  # what the gyro's own clock says; the table's stamps are in the lab's time
    time_s = period * np.arange(len(increments) + 1, dtype=np.float64)
    rate_dps = increments.astype(np.float64) * (180.0 / np.pi / period)
    angle, alignment = align_angle(time_s, rate_dps[:, 2], polls["time_ns"] * 1e-9, polls["angle_deg"])
    whole = TurnRecord(
        f"run-{plan.seed}",
        "INS-1",
        period,
        time_s,
        rate_dps,
        angle,
        np.ones(len(rate_dps), np.bool_),
        LATITUDE_DEG,
    )
    turning = cut(whole, float(edges[1]) + 1.0, float(edges[-2]))
    return turning, Turns(whole, alignment, ())


def cut(record: TurnRecord, start_s: float, end_s: float) -> TurnRecord:
    """Return a stretch of a record."""
    first, last = (int(np.searchsorted(record.time_s, time_s - 1e-9)) for time_s in (start_s, end_s))
    return dataclasses.replace(
        record,
        time_s=record.time_s[first : last + 1],
        angle_rad=record.angle_rad[first : last + 1],
        rate_dps=record.rate_dps[first:last],
        usable=record.usable[first:last],
    )


def reversing(turns: int, every: int, rate_dps: float) -> list[tuple[float, float]]:
    """Return stretches of `every` turns in alternating senses."""
    senses = itertools.cycle((1.0, -1.0))
    return [(360.0 * every / rate_dps, rate_dps * next(senses)) for _ in range(turns // every)]


def nominal_angle(record: TurnRecord) -> NDArray[np.float64]:
    """Return w t with the mean rate of the record, (n + 1,): what a fit at the nominal angle would use."""
    share = (record.time_s - record.time_s[0]) / (record.time_s[-1] - record.time_s[0])
    return np.asarray(record.angle_rad[0] + share * (record.angle_rad[-1] - record.angle_rad[0]))
