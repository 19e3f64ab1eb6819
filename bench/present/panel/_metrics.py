"""What the panel knows as metrics that Prometheus scrapes; docs/metrics.md has what each means."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from fastapi import Request
from fastapi.responses import Response
from prometheus_client import CollectorRegistry, ProcessCollector
from prometheus_client.exposition import choose_encoder
from prometheus_client.metrics_core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric

from bench import __version__
from bench.control.disk import free_bytes
from bench.present.panel._benches import Benches
from bench.present.panel._desk_routes import Desks
from bench.present.panel._folders import RunsFolder
from bench.present.panel._session import Session
from bench.present.panel._values import fresh, number_of

STATES = ("starting", "running", "asking", "paused", "ended", "lost", "unreadable")
"""States of a session; `lost`: its process is gone without a word, `unreadable`: its live file is none."""
_BENCH = ("bench", "emulated")
_CHAMBER = {
    "air_temp_c": ("gyrobench_chamber_air_celsius", "air of the chamber"),
    "set_point_c": ("gyrobench_chamber_set_point_celsius", "set point of the chamber"),
}
_TABLE = {
    "rate_dps": ("gyrobench_table_rate_degrees_per_second", "rate of the table"),
    "angle_deg": ("gyrobench_table_angle_degrees", "angle of the table"),
}
_GYRO = {
    "rate_dps": ("gyrobench_gyro_rate_degrees_per_second", "rate of a gyro, mean of a minute"),
    "temp_c": ("gyrobench_gyro_celsius", "temperature inside a gyro"),
}
_GYRO_COUNTS = {
    "frames": ("gyrobench_gyro_frames", "frames decoded in this run"),
    "lost": ("gyrobench_gyro_lost", "samples lost in this run, by the unit's own counter"),
}


class Metrics:
    """Collects what the panel has read of its benches; nothing is read from a device for it."""

    def __init__(self, folder: RunsFolder, benches: Benches, desks: Desks) -> None:
        self._folder = folder
        self._benches = benches
        self._desks = desks
        self._registry = CollectorRegistry(auto_describe=False)
        self._registry.register(self)
        ProcessCollector(registry=self._registry)

    def page(self, request: Request) -> Response:
        """Answer a scrape, in the format that it accepts (text 0.0.4 or OpenMetrics)."""
        self._benches.update()
        encode, content_type = choose_encoder(request.headers.get("accept", ""))
        return Response(encode(self._registry), headers={"content-type": content_type})

    def collect(self) -> Iterator[Metric]:
        """Yield every family with its samples of now."""
        yield InfoMetricFamily("gyrobench_panel", "the panel", value={"version": __version__})
        yield _gauge(
            "gyrobench_disk_free_bytes", "free on the disk of the runs", value=free_bytes(self._folder.root)
        )
        families: dict[str, Metric] = {}
        for labels, session in self._shown():
            _Session(families, labels, session).collect()
        self._collect_queues(families)
        yield from families.values()

    def _shown(self) -> Iterator[tuple[tuple[str, str], Session]]:
        """Yield the session of each bench that goes on, else the newest."""
        for (bench, emulated), group in self._benches.groups().items():
            yield (bench, str(int(emulated))), next((one for one in group if one.alive), group[0])

    def _collect_queues(self, families: dict[str, Metric]) -> None:
        for bench, state in self._desks.states().items():
            for name, about, value in (
                ("gyrobench_queue_waiting", "items that wait in the queue", len(state.waiting)),
                ("gyrobench_queue_busy", "whether an item of the queue goes on", state.current is not None),
                (
                    "gyrobench_queue_held",
                    "whether the queue starts nothing by itself",
                    state.held is not None,
                ),
            ):
                family = families.setdefault(name, _gauge(name, about, ("bench",)))
                family.add_sample(name, {"bench": bench}, float(value))


class _Session:
    """Adds the samples of one session to the families."""

    def __init__(self, families: dict[str, Metric], labels: tuple[str, str], session: Session) -> None:
        self._families = families
        self._labels = dict(zip(_BENCH, labels, strict=True))
        self._session = session
        self._now: Mapping[str, Any] = session.now or {}

    def collect(self) -> None:
        """Add what is known; of a value that is stale or no number there is no sample."""
        session, now = self._session, self._now
        state = self._state()
        for name in STATES:
            self._add("gyrobench_session_state", "1 for the state it is in", float(name == state), state=name)
        self._add("gyrobench_live_age_seconds", "for how long the live file has not changed", session.age_s)
        self._add("gyrobench_alarms_unseen", "alarms that nobody has seen", len(session.unseen()))
        self._add("gyrobench_questions_open", "questions that wait for an operator", self._questions())
        if outcome := str(now.get("outcome") or ""):
            self._add("gyrobench_last_outcome", "how the last run or campaign ended", 1.0, outcome=outcome)
        if not session.alive or session.problem:
            return
        run, campaign = now.get("run") or {}, now.get("campaign") or {}
        facts = {
            "run": run.get("run_id"),
            "procedure": run.get("procedure"),
            "campaign": campaign.get("title"),
        }
        told = {name: str(text or "") for name, text in facts.items()}
        self._add("gyrobench_run_info", "the run that goes on", 1.0, **told)
        self._add("gyrobench_run_seconds", "bench time of the run", now.get("time_s"))
        self._add("gyrobench_run_left_seconds", "what is expected to be left of the run", now.get("left_s"))
        self._add("gyrobench_campaign_run", "number of the run in its campaign", campaign.get("number"))
        self._add("gyrobench_campaign_runs", "runs of the campaign", campaign.get("count"))
        self._devices()

    def _devices(self) -> None:
        now = self._now
        chamber, table = fresh(now.get("chamber")), fresh(now.get("table"))
        for device, metrics in ((chamber, _CHAMBER), (table, _TABLE)):
            for key, (name, about) in metrics.items():
                self._add(name, about, device.get(key))
        sensors = (now.get("run") or {}).get("auxiliary") or {}
        for number, value in (chamber.get("auxiliary_c") or {}).items():
            sensor = str(sensors.get(number) or f"sensor {number}")
            self._add(
                "gyrobench_chamber_sensor_celsius", "a further sensor of the chamber", value, sensor=sensor
            )
        for instrument, row in (now.get("readings") or {}).items():
            for column, value in row.items():
                whose = {"instrument": instrument, "column": column}
                self._add("gyrobench_reading", "newest value, its unit in the column's name", value, **whose)
        units = (now.get("run") or {}).get("units") or {}
        for name, gyro in (now.get("gyros") or {}).items():
            whose = {"gyro": name, "unit": str(units.get(name, ""))}
            for key, (metric, about) in _GYRO.items():
                self._add(metric, about, fresh(gyro).get(key), **whose)
            for key, (metric, about) in _GYRO_COUNTS.items():
                self._count(metric, about, gyro.get(key), **whose)
            for reason, value in (gyro.get("rejected") or {}).items():
                self._count(
                    "gyrobench_gyro_rejected", "frames refused in this run", value, **whose, reason=reason
                )

    def _state(self) -> str:
        session = self._session
        if session.problem:
            return "unreadable"
        state = str(self._now.get("state"))
        return state if session.alive or state == "ended" else "lost"

    def _questions(self) -> int:
        return len(self._now.get("prompts") or ()) if self._session.alive else 0

    def _add(self, name: str, about: str, value: object, **labels: str) -> None:
        if (number := number_of(value)) is not None:
            family = self._families.setdefault(name, _gauge(name, about, (*_BENCH, *labels)))
            family.add_sample(name, self._labels | labels, number)

    def _count(self, name: str, about: str, value: object, **labels: str) -> None:
        if (number := number_of(value)) is not None:
            counter = CounterMetricFamily(name, about, labels=(*_BENCH, *labels))
            family = self._families.setdefault(name, counter)
            family.add_sample(f"{name}_total", self._labels | labels, number)


def _gauge(
    name: str, about: str, labels: tuple[str, ...] = (), value: float | None = None
) -> GaugeMetricFamily:
    return GaugeMetricFamily(name, about, value=value, labels=labels or None)
