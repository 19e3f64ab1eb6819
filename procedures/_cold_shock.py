"""What the cold-shock tests share: the equilibrium criterion, the shock, its verification, the way back.

Source: CN115855016B (low-temperature shock error compensation of a fibre-optic gyro), steps S112 and S113; rate
preference of GB/T 2423.22-2012 (IEC 60068-2-14 Nb).
"""

from __future__ import annotations

import math

import numpy as np

from bench.control.procedure import Demands, Parameters, parameter
from bench.control.session import Bench
from bench.control.stream_stations import GyroStation
from bench.record.events.run import Basis

_GATE_WINDOW_S = 600.0
_SHOCK_LIMIT_C = -40.0
_TENTH_TO_NINE = 0.8
"""Part of the fall between its 10 and 90 % points."""
_UNDERSHOOT_S = 300.0
"""Time after arrival in which the air has its undershoot; the shock is judged after it."""


class ColdShockParameters(Parameters):
    """The chamber profile."""

    room_c: float = parameter(25.0, "room temperature before and after the shock", "degC", ge=10, le=35)
    cold_c: float = parameter(-45.0, "set point of the shock", "degC", ge=-70, le=-40)
    ramp_k_per_min: float = parameter(12.0, "ramp demanded of the chamber, both ways", "K/min", gt=0, le=30)
    required_rate_k_per_min: float = parameter(
        10.0, "shock rate below which the run is invalid (0: not judged)", "K/min", ge=0, le=30
    )
    soak_min: float = parameter(75.0, "time at the cold set point", "min", gt=0, le=600)
    hold_min: float = parameter(30.0, "reference window at equilibrium", "min", ge=10, le=600)
    warm_up_min: float = parameter(60.0, "least time from power-on to equilibrium", "min", ge=0, le=600)
    drift_k_per_10min: float = parameter(
        0.1, "equilibrium: largest change of gyro temperature in 10 min", "K", gt=0, le=2
    )
    equilibrium_timeout_min: float = parameter(240.0, "longest wait for equilibrium", "min", gt=0, le=1440)

    def shock_duration_s(self) -> float:
        """Expected time from the shock command to the end of the return."""
        ramps = 2 * abs(self.room_c - self.cold_c) / self.ramp_k_per_min
        return 60.0 * (ramps + self.soak_min + 105.0)

    def demands(self, max_rate_dps: float = 0.0) -> Demands:
        """The extremes of the profile."""
        return Demands(
            max_rate_dps=max_rate_dps,
            min_temp_c=self.cold_c,
            max_temp_c=self.room_c,
            max_ramp_k_per_min=self.ramp_k_per_min,
        )


def wait_for_equilibrium(bench: Bench, p: ColdShockParameters, *, phase: str) -> None:
    """Wait for thermal equilibrium by a stated criterion.

    All three must hold: `warm_up_min` since power-on; the gyro's own temperature (1 min means) changed less than
    `drift_k_per_10min` over 10 min; the last three 10 min means of its output agree within three times their
    standard error. An equilibrium that does not come in time makes the run invalid and the run goes on.
    """
    bench.phase(phase)

    def reached() -> bool:
        now, gyro = bench.now_s, bench.judge
        return (
            now >= 60.0 * p.warm_up_min
            and temperature_steady(gyro, now, p.drift_k_per_10min)
            and bias_steady(gyro, now)
        )

    timeout_s = 60.0 * p.equilibrium_timeout_min
    if not bench.wait_until(reached, timeout_s=timeout_s, what="waiting for equilibrium", every_s=60.0):
        bench.invalidate(
            f"no thermal equilibrium within {p.equilibrium_timeout_min:g} min in phase {phase}",
            "no_equilibrium",
            phase=phase,
            waited_s=timeout_s,
        )


def temperature_steady(gyro: GyroStation, now_s: float, drift_k: float) -> bool:
    """Whether 1 min means of the gyro temperature, 10 min apart, differ by less than `drift_k`.

    A unit that sends no temperature, as some on J1939, is as steady as its output says.
    """
    rows = gyro.update().since(now_s - _GATE_WINDOW_S - 60.0)
    time_s, temp_c = rows["time_s"], rows["temp_c"]
    early, late = time_s <= now_s - _GATE_WINDOW_S, time_s > now_s - 60.0
    if not early.any() or not late.any() or time_s[0] > now_s - _GATE_WINDOW_S - 30.0:
        return False
    if not np.isfinite(temp_c).any():
        return not np.isfinite(gyro.update().since(0.0)["temp_c"]).any()
    if not np.isfinite(temp_c[early]).any() or not np.isfinite(temp_c[late]).any():
        return False
    return bool(abs(np.nanmean(temp_c[late]) - np.nanmean(temp_c[early])) < drift_k)


def bias_steady(gyro: GyroStation, now_s: float) -> bool:
    """Whether the last three 10 min means agree within three standard errors (from 10 s means)."""
    rows = gyro.update().since(now_s - 3 * _GATE_WINDOW_S)
    if len(rows["time_s"]) < 3 or rows["time_s"][0] > now_s - 3 * _GATE_WINDOW_S + 60.0:
        return False
    age = ((now_s - rows["time_s"]) // 10.0).astype(int)
    blocks = np.bincount(age, rows["rate_dps"] * rows["samples"], 180) / np.maximum(
        np.bincount(age, rows["samples"], 180), 1.0
    )
    thirds = blocks[:180].reshape(3, 60)
    standard_error = thirds.std(axis=1, ddof=1).mean() / np.sqrt(60.0)
    return bool(np.ptp(thirds.mean(axis=1)) <= 3.0 * np.sqrt(2.0) * standard_error)


def reference_window(bench: Bench, p: ColdShockParameters) -> None:
    """Hold at equilibrium: the mean output and temperature here are what the run's drift is counted from."""
    bench.phase("reference")
    start = bench.now_s
    bench.wait(60.0 * p.hold_min, "reference window")
    gyro = bench.judge
    rows = gyro.update().since(start)
    output_dph, basis = 3600.0 * gyro.mean_rate_dps(start), Basis("gyro_output", since_s=start)
    bench.measure("reference_output", output_dph, "deg/h", gyro=gyro.name, basis=basis)
    known = rows["temp_c"][np.isfinite(rows["temp_c"])]
    temp_c, basis = float(known.mean()) if len(known) else math.nan, Basis("unit_temperature")
    bench.measure("reference_temperature", temp_c, "degC", gyro=gyro.name, basis=basis)


def shock(bench: Bench, p: ColdShockParameters) -> None:
    """Command the shock, verify its rate on the log, soak."""
    bench.phase("shock")
    start = bench.now_s
    bench.chamber.go_to(p.cold_c, p.ramp_k_per_min)
    allowed_s = 60.0 * (2.0 * abs(p.room_c - p.cold_c) / p.ramp_k_per_min + 20.0)
    arrived = bench.wait_until(
        lambda: bench.chamber.history.last["air_temp_c"] <= p.cold_c + 1.0,
        timeout_s=allowed_s,
        what=f"shock to {p.cold_c:g} degC",
    )
    bench.phase("soak")
    end = bench.now_s + 60.0 * p.soak_min
    doing = f"soak at {p.cold_c:g} degC"
    bench.wait(min(_UNDERSHOOT_S, 60.0 * p.soak_min), doing)
    verify_shock(bench, start, p, arrived)
    bench.wait(end - bench.now_s, doing)


def verify_shock(bench: Bench, start_s: float, p: ColdShockParameters, arrived: bool) -> None:
    """Measure the shock on the recorded air temperature; a run that misses the criterion is invalid."""
    rows = bench.chamber.history.since(start_s)
    rate, steepest = shock_rate_k_per_min(rows["time_s"], rows["air_temp_c"])
    lowest = float(rows["air_temp_c"].min())
    required = p.required_rate_k_per_min
    fall_k = float(rows["air_temp_c"][0]) - lowest
    mean = Basis("air_rate", since_s=start_s, change_k=_TENTH_TO_NINE * fall_k)
    minute = Basis("air_rate", since_s=start_s, change_k=steepest)
    fast = bench.measure("shock_rate_10_90", rate, "K/min", low=required or None, basis=mean)
    steep = bench.measure("shock_steepest_60s", steepest, "K/min", low=required or None, basis=minute)
    air = Basis("air_temperature", since_s=start_s)
    deep = bench.measure("shock_lowest_air", lowest, "degC", high=_SHOCK_LIMIT_C, basis=air)
    if not fast or not steep:
        bench.invalidate(
            f"shock rate {rate:.2f} K/min between 10 and 90 % (steepest 60 s {steepest:.2f} K/min), "
            f"required {required:g} K/min",
            "shock_too_slow",
            rate_k_per_min=rate,
            steepest_k_per_min=steepest,
            required_k_per_min=required,
        )
    if not deep or not arrived:
        bench.invalidate(
            f"air reached {lowest:.1f} degC, asked for {p.cold_c:g} and required {_SHOCK_LIMIT_C:g} degC",
            "shock_not_cold",
            lowest_c=lowest,
            demanded_c=p.cold_c,
            required_c=_SHOCK_LIMIT_C,
        )


def shock_rate_k_per_min(
    time_s: np.ndarray[tuple[int], np.dtype[np.float64]], air_c: np.ndarray[tuple[int], np.dtype[np.float64]]
) -> tuple[float, float]:
    """Return (mean rate from 10 to 90 % of the fall, steepest fall in any 60 s), K/min, positive = cooling."""
    top, bottom = air_c[0], air_c.min()
    span = top - bottom
    if span <= 0:
        return 0.0, 0.0
    begin = int(np.argmax(air_c <= top - 0.1 * span))
    end = int(np.argmax(air_c <= top - 0.9 * span))
    if end <= begin:
        return 0.0, 0.0
    rate = 60.0 * (air_c[begin] - air_c[end]) / (time_s[end] - time_s[begin])
    ahead = np.interp(time_s + 60.0, time_s, air_c)
    return float(rate), float((air_c - ahead).max())


def return_to_room(bench: Bench, p: ColdShockParameters) -> None:
    """Back to room temperature and to equilibrium (S113)."""
    bench.phase("return")
    bench.chamber.go_to(p.room_c, p.ramp_k_per_min)
    bench.wait_until(
        lambda: bench.chamber.history.last["air_temp_c"] >= p.room_c - 0.5,
        timeout_s=60.0 * (2.0 * abs(p.room_c - p.cold_c) / p.ramp_k_per_min + 60.0),
        what=f"return to {p.room_c:g} degC",
    )
    wait_for_equilibrium(bench, p, phase="final_equilibrium")
