"""Plant families on the emulated bench, recorded in process: what each has, what its log shows, its model.

The chamber's air and the table are the lab's plant in every family. `fibre_optic` is a unit of that plant with
effects of the catalogue, as `gyrobench gap hunt --emulated` runs it through bytes. In the others heat, effects
and noise are a family's of the exam; none of their formulas is the catalogue's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np

from bench.analysis.gap import Design, Model, Recordings, designs_for, outlook, parse_model, read_model
from bench.analysis.gap._candidates import effects_beside
from bench.analysis.gap._columns import usual_variant
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._designs import usual_designs
from bench.analysis.gap._model_file import Term
from bench.lab.emulated import Plant, unit_seed
from bench.record.benchfile import BenchFile, load_bench_file
from benchmarks.gap_exam._family import Effect, Family, Unit
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._mems import MEMS
from benchmarks.gap_exam._mems import THERMAL_STEP_S as MEMS_STEP_S
from benchmarks.gap_exam._mems import heat as mems_heat
from benchmarks.gap_exam._ring_laser import RING_LASER, THERMAL_STEP_S
from benchmarks.gap_exam._ring_laser import heat as ring_laser_heat
from benchmarks.gap_exam._signals import drawn
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._whitening import NoiseLevels, Part, deflection
from benchmarks.hunt._programme import Programme, angles_deg, changing, made, programme_of
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS
from drivers.base.errors import ConfigurationError
from simulators.effects import Stimulus
from simulators.plant import LabPlant, UnitConfig
from simulators.plant.modelled_unit import ModelledErrors

ROOT = Path(__file__).parents[2]
NOMINAL = ROOT / "examples" / "nominal" / "fog_on_its_bench.toml"
FASTEST_DPS = 20.0
"""Of the bench's table."""
_SAMPLE_S = 0.1
_TURNING_STEP_S = 0.2
_ENCODER_ARCSEC = 0.5
Gap = Mapping[str, float]
"""Effects by name, with their sizes."""


class HuntPlant(Protocol):
    """A plant family on a bench."""

    @property
    def name(self) -> str:
        """Its name in the table."""

    @property
    def model(self) -> Model:
        """The nominal model of its gyros."""

    @property
    def designs(self) -> Sequence[Design]:
        """What its bench can do."""

    @property
    def known(self) -> Mapping[str, tuple[str, ...]]:
        """Effects that the catalogue has, and what it calls each: any of the names is right."""

    @property
    def foreign(self) -> tuple[str, ...]:
        """Effects that the catalogue has not."""

    def beside(self, effect: str) -> tuple[str, ...]:
        """Return names that are no false ones beside an effect."""

    def size(self, effect: str, sigmas: float, seed: int) -> float:
        """Return the size at which the bench's best run shows an effect with so many standard deviations.

        0 for one that no run of this bench shows.
        """

    def signed(self, effect: str) -> bool:
        """Return whether an effect may be of either sign."""

    def recorded(self, design: Design, gap: Gap, seed: int, number: int) -> Recordings:
        """Return what run `number` of the unit of a seed records."""


def bench_at(latitude_deg: float | None = None) -> BenchFile:
    """Return the bench of the demo with its one fibre-optic gyro, at a family's latitude."""
    file = load_bench_file(ROOT / "examples" / "demo.toml")
    limits = file.limits.model_copy(update={"max_rate_dps": FASTEST_DPS, "max_temp_c": 85.0})
    own = file.bench.latitude_deg if latitude_deg is None else latitude_deg
    bench = file.bench.model_copy(update={"latitude_deg": own})
    return file.model_copy(update={"limits": limits, "gyro": file.gyro[:1], "bench": bench})


def tests_at(latitude_deg: float) -> list[Design]:
    """Return the standard tests on the bench's table."""
    return usual_designs(latitude_deg, fastest_dps=FASTEST_DPS)


def executable(effect: object) -> bool:
    """Whether a plant can have an effect of the catalogue."""
    try:
        return bool(effect.causal)  # type: ignore[attr-defined]
    except ConfigurationError:
        return False


class FibreOptic:
    """The unit of the lab's plant with effects of the catalogue."""

    name = "fibre_optic"
    foreign: tuple[str, ...] = ()

    def __init__(self) -> None:
        self.file = bench_at()
        self.model = read_model(NOMINAL)
        self.designs = designs_for(self.file)
        self._energies = outlook(None, self.model, [], tests_at(self.file.bench.latitude_deg)).energies
        self._effects = {name: each for name, each in effects_beside(self.model).items() if executable(each)}

    @property
    def known(self) -> Mapping[str, tuple[str, ...]]:
        return {name: (name,) for name in self._effects if name in self._energies}

    def beside(self, effect: str) -> tuple[str, ...]:
        return ()

    def size(self, effect: str, sigmas: float, seed: int) -> float:
        wanted = sigmas / math.sqrt(self._energies[effect])
        low, high = self._effects[effect].parameters[0].bounds(self.model.noise.coarseness)
        return min(max(wanted, low), high)

    def signed(self, effect: str) -> bool:
        return self._effects[effect].parameters[0].low < 0.0

    def term(self, effect: str, size: float) -> Term:
        """Return an effect in its usual form, its first parameter of some size."""
        values = (size, *(0.0 for _ in self._effects[effect].parameters[1:]))
        return Term(usual_variant(self._effects[effect]), values, tuple(abs(size) for _ in values))

    def truth(self, gap: Gap) -> Model:
        """Return the model that a unit follows: the nominal one without what the bench adds, and its effects."""
        kept = [t for t in self.model.terms if executable(t.effect) and t.name != "table_wobble_once"]
        terms = [self.term(name, size) for name, size in gap.items()]
        return Model("truth", (*kept, *terms), self.model.noise)

    def plant(self, truth: Path, seed: int) -> Plant:
        """Return the plant whose unit follows a model file."""
        unit = self.file.gyro[0].unit
        return Plant(seed=seed, mount_azimuth_error_deg=0.0, gap_model={unit: truth})

    def recorded(self, design: Design, gap: Gap, seed: int, number: int) -> Recordings:
        programme = programme_of(design)
        truth = self.truth(gap)
        terms = [
            {"effect": t.name, "values": list(t.values), "shape": dict(t.variant.shape)} for t in truth.terms
        ]
        errors = ModelledErrors.from_json({"terms": terms, "noise": truth.noise.coefficients})
        gyro = self.file.gyro[0]
        unit = UnitConfig(
            gyro.name, "fog_mid", unit_seed(gyro.unit), aux_sensor=gyro.case_sensor or 0, errors=errors
        )
        plant = made(programme, self.file.bench.latitude_deg, seed + number, [unit])
        return _recordings(
            [self._stretch(plant, programme, k, design, number) for k in range(len(programme.parts))]
        )

    def _stretch(
        self, plant: LabPlant, programme: Programme, which: int, design: Design, number: int
    ) -> GapRun:
        part = programme.parts[which]
        n = part.end_s - part.start_s
        per_s = round(1.0 / _SAMPLE_S)
        signal = plant.unit(self.file.gyro[0].name).measure(part.start_s, n * per_s, _SAMPLE_S)
        turned = signal.angle_increment_rad[:, 0].reshape(n, per_s).sum(axis=1)
        inside = signal.temp_c.reshape(n, per_s).mean(axis=1)
        case = plant.true_drift(self.file.gyro[0].name)["case_temp_c"]
        edges = np.arange(part.start_s, part.end_s + 1.0)
        true = angles_deg(plant, edges)
        angle = true + _ENCODER_ARCSEC / 3600.0 * np.sin(np.radians(true))
        return _gap_run(
            DPH_PER_DPS * np.degrees(turned),
            edges,
            (inside, case[part.start_s : part.end_s]),
            angle,
            programme,
            part.condition,
            self.file.bench.latitude_deg,
            design,
            number,
            which,
        )


Heat = Callable[[Array, Unit, np.random.Generator], tuple[dict[str, Array], float]]
"""Temperatures (k,) of a family's bodies from the air's (n,) by the second; and the step between them."""


@dataclass(frozen=True, eq=False)
class OfExam:
    """A family of the exam: its gyro on the lab's table, its heat in the chamber's air."""

    family: Family
    heat: Heat
    inside: str
    outside: str

    @property
    def name(self) -> str:
        return self.family.name

    @cached_property
    def model(self) -> Model:
        return parse_model(self.family.nominal_text, self.family.name)

    @cached_property
    def designs(self) -> Sequence[Design]:
        return designs_for(bench_at(self.family.latitude_deg))

    @cached_property
    def _shows(self) -> list[list[tuple[Stage, Array]]]:
        """The stages of the runs that show most, with the nominal columns of each: for the sizes."""
        found = []
        for design in tests_at(self.family.latitude_deg):
            stages = self._staged(design, self._unit(0), 0, 0)[1]
            rates = [stage.in_rows(sensed_dph(stage, self.family.latitude_deg)) for stage in stages]
            found.append(
                [
                    (stage, np.stack((rate, stage.in_rows(stage.t_in_c) - 25.0)))
                    for stage, rate in zip(stages, rates, strict=True)
                ]
            )
        return found

    @cached_property
    def known(self) -> Mapping[str, tuple[str, ...]]:
        return {name: each.names for name, each in self._shown.items() if each.names}

    @cached_property
    def foreign(self) -> tuple[str, ...]:
        return tuple(name for name, each in self._shown.items() if not each.names)

    @property
    def _shown(self) -> dict[str, Effect]:
        """Effects whose size follows from a ratio, the same in every run."""
        own = self.family.effects.items()
        return {name: each for name, each in own if not each.curved and not each.changing}

    def beside(self, effect: str) -> tuple[str, ...]:
        return self.family.effects[effect].beside

    def size(self, effect: str, sigmas: float, seed: int) -> float:
        unit, sheet = self._unit(seed), self.family.sheet
        noise = NoiseLevels(
            sheet.arw_deg_per_sqrt_h, sheet.bias_instability_dph, sheet.rate_random_walk_dph_per_sqrt_h
        )
        best = 0.0
        for shown in self._shows:
            parts = []
            for stage, nominal in shown:
                own = stage.in_rows(self.family.effects[effect].signal(unit, stage, 1.0))
                parts.append(Part(own[None], nominal, stage.valid))
            best = max(best, deflection(parts, noise))
        return sigmas / best if best > 1e-9 else 0.0

    def signed(self, effect: str) -> bool:
        return self.family.effects[effect].signed

    def recorded(self, design: Design, gap: Gap, seed: int, number: int) -> Recordings:
        unit = self._unit(seed)
        programme, stages = self._staged(design, unit, seed, number)
        return _recordings(
            [self._stretch(unit, programme, stages, k, gap, design, number) for k in range(len(stages))]
        )

    def _unit(self, seed: int) -> Unit:
        from benchmarks.gap_exam._make import draw_unit

        return draw_unit(self.family, seed, {})

    def _staged(self, design: Design, unit: Unit, seed: int, number: int) -> tuple[Programme, list[Stage]]:
        programme = programme_of(design)
        plant = made(programme, self.family.latitude_deg, seed + number)
        air = plant.chamber.record()["air_temp_c"]
        bodies, heat_s = self.heat(air, unit, drawn(seed, "heat", number))
        step_s = _TURNING_STEP_S if programme.turns else 1.0
        stages = []
        for part in programme.parts:
            n = part.end_s - part.start_s
            edges = np.asarray(part.start_s + np.arange(round(n / step_s) + 1) * step_s, np.float64)
            middles = 0.5 * (edges[1:] + edges[:-1])
            at = np.arange(len(bodies[self.inside])) * heat_s
            own = {name: np.interp(middles, at, values) for name, values in bodies.items()}
            angle = angles_deg(plant, edges)
            rate = np.diff(angle)[:: round(1.0 / step_s)] / step_s
            stages.append(
                Stage(
                    design.text, design.text, part.condition, number, number, step_s, angle,
                    np.full(len(middles), programme.elevation_deg), own, own[self.inside], own[self.outside],
                    np.arange(n + 1.0), ~changing(rate), np.ones(n, dtype=np.bool_), (("run", 0.0),),
                    float(part.start_s),
                )
            )  # fmt: skip
        return programme, stages

    def _stretch(
        self,
        unit: Unit,
        programme: Programme,
        stages: Sequence[Stage],
        which: int,
        gap: Gap,
        design: Design,
        number: int,
    ) -> GapRun:
        family, stage = self.family, stages[which]
        rng = drawn(unit.seed, "log", design.text, number, which)
        true = sensed_dph(stage, family.latitude_deg)
        bias = unit.slope_dph * (stage.t_in_c - 25.0) / 50.0 + rng.normal(0.0, unit.sheet.turn_on_sigma_dph)
        added = sum((family.effects[name].signal(unit, stage, size) for name, size in gap.items()), 0.0)
        rate = true * (1.0 + 1e-6 * unit.sf_ppm) + bias + added
        output = family.rows(unit, stage, stage.in_rows(rate), rng)
        inside, outside, angle = family.read(unit, stage, rng)
        output = np.where(stage.valid, output, np.nan)
        edges = stage.power_on_s + stage.edges_s
        return _gap_run(
            output, edges, (inside, outside), angle, programme, stage.condition, family.latitude_deg,
            design, number, which,
        )  # fmt: skip


def _gap_run(
    output_dph: Array,
    edges_s: Array,
    temperatures_c: tuple[Array, Array],
    angle_deg: Array,
    programme: Programme,
    condition: str,
    latitude_deg: float,
    design: Design,
    number: int,
    which: int,
) -> GapRun:
    n = len(output_dph)
    elevation = np.full(n, programme.elevation_deg)
    stimulus = Stimulus(edges_s[1:], *temperatures_c, angle_deg, elevation, latitude_deg)
    left_out = changing(np.diff(angle_deg))
    return GapRun(
        f"{number:02d}-{design.procedure} {which}",
        "U-1",
        f"{design.procedure} {design.text}",
        condition,
        stimulus,
        np.where(left_out, np.nan, output_dph),
        np.full(n, "run"),
        f"{number} {which}",
    )


def _recordings(runs: Sequence[GapRun]) -> Recordings:
    return Recordings(tuple(runs), (), {})


def _of_ring_laser(air: Array, unit: Unit, rng: np.random.Generator) -> tuple[dict[str, Array], float]:
    bodies = ring_laser_heat(air[None, :: round(THERMAL_STEP_S)], unit, [rng])
    return {name: values[0] for name, values in bodies.items()}, THERMAL_STEP_S


def _of_mems(air: Array, unit: Unit, rng: np.random.Generator) -> tuple[dict[str, Array], float]:
    bodies = mems_heat(air[None, :: round(MEMS_STEP_S)], unit)
    return {name: values[0] for name, values in bodies.items()}, MEMS_STEP_S


def families() -> dict[str, HuntPlant]:
    """Return the plant families by name."""
    made_of = (
        FibreOptic(),
        OfExam(RING_LASER, _of_ring_laser, "block", "case"),
        OfExam(MEMS, _of_mems, "die", "lid"),
    )
    return {each.name: each for each in made_of}
