// The page of recorded runs: fetches the curves of each, lays them over one another, fetches a stretch anew when zoomed.
(() => {
  "use strict";
  const { place, setText } = window.gyrobenchPage;
  const { Lanes, paint, paintOf } = window.gyrobenchCharts;
  const node = place("[data-lanes]");
  if (!node) return;
  const LEAST = { Air: 2, "Table rate": 0.2 };
  const FINER_MS = 250;
  const runs = [...document.querySelectorAll("[data-run]")].map((row) => ({ row, name: row.dataset.run, colour: paintOf(Number(row.dataset.paint)), whole: null, fine: null }));
  const align = place("[data-align]");
  let view = null;
  let waiting = 0;

  const colours = () => runs.forEach((run) => { run.row.querySelector(".swatch").style.color = paint(run.colour); });
  const start = (run) => run.whole?.phases.find(([name]) => name === align.value)?.[1] ?? (align.value ? null : 0);
  const there = () => runs.filter((run) => run.whole && start(run) !== null);

  function full() {
    const ends = there().map((run) => [-start(run), run.whole.end_s - start(run)]);
    return ends.length ? [Math.min(...ends.map(([low]) => low)), Math.max(...ends.map(([, high]) => high), 1)] : [0, 1];
  }

  function lanes() {
    const found = new Map();
    for (const run of there()) {
      const shift = start(run);
      for (const curve of (run.fine ?? run.whole).curves) {
        if (!found.has(curve.lane)) found.set(curve.lane, { title: curve.lane, unit: curve.unit, least: LEAST[curve.lane] ?? (curve.unit === "°C" ? 0.5 : 1e-6), small: curve.key !== "table", series: [] });
        const label = runs.length > 1 ? `${run.name}, ${curve.name}` : curve.name;
        found.get(curve.lane).series.push({ id: `${run.name} ${curve.key}`, name: label, colour: run.colour, dash: curve.key === "set" ? "dashed" : undefined, t: curve.t.map((time) => time - shift), low: curve.low, high: curve.high });
      }
    }
    const [only] = there();
    if (plan?.drawn && only) plan.add([...found.values()], only.whole.phases, start(only));
    return [...found.values()];
  }

  let plan = null;
  const chart = new Lanes(node, (wanted) => {
    view = wanted;
    for (const run of runs) run.fine = null;
    show();
    clearTimeout(waiting);
    waiting = setTimeout(finer, FINER_MS);
  });

  function show() {
    const [first, last] = full();
    const [from, to] = view ?? [first, last];
    const lead = there()[0];
    const phases = lead ? lead.whole.phases.map(([name, begin, end]) => [name, begin - start(lead), end - start(lead)]) : [];
    chart.show({ lanes: lanes(), from, to, full: [first, last], phases });
    node.dataset.shown = `${from} ${to}`;
  }

  async function load(run, stretch) {
    const query = new URLSearchParams({ run: run.name, ...(stretch ? { from_s: stretch[0], to_s: stretch[1] } : {}) });
    try {
      const found = await (await fetch(`/panel/curves?${query}`)).json();
      setText(run.row.querySelector("[data-problem]"), found.problem ?? "");
      return found.curves ? found : null;
    } catch {
      setText(run.row.querySelector("[data-problem]"), "The panel does not answer.");
      return null;
    }
  }

  // All runs over the same stretch: then their means are of equally long stretches, and one is no noisier for being short.
  async function finer() {
    const wanted = view;
    const [from, to] = wanted ?? full();
    for (const run of there()) {
      const shift = start(run);
      const found = from + shift < run.whole.end_s && to + shift > 0 ? await load(run, [from + shift, to + shift]) : null;
      if (view !== wanted) return;
      run.fine = found;
    }
    show();
    node.dataset.finer = node.dataset.shown;
  }

  function fillAlign() {
    const names = [...new Set(runs.flatMap((run) => (run.whole ? run.whole.phases.map(([name]) => name) : [])))];
    for (const name of names) align.append(Object.assign(document.createElement("option"), { value: name, textContent: name.replaceAll("_", " ") }));
  }

  align.addEventListener("change", () => {
    const lengths = runs.flatMap((run) => (run.whole?.phases ?? []).filter(([name]) => name === align.value).slice(0, 1).map(([, begin, end]) => end - begin));
    for (const run of runs) {
      run.fine = null;
      if (run.whole) setText(run.row.querySelector("[data-problem]"), start(run) === null ? `It has no phase ${align.value.replaceAll("_", " ")}.` : "");
    }
    chart.zoomed(lengths.length ? [0, Math.max(...lengths, 1)] : null);
  });

  if (runs.length === 1) plan = new window.gyrobenchExpected.Expected(chart.bar, () => runs[0].name, show);
  window.gyrobenchCurves = { runs, chart, view: () => view };
  colours();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { colours(); chart.repaint(); });
  Promise.all(runs.map(async (run) => {
    run.whole = await load(run);
    show();
  })).then(async () => {
    fillAlign();
    if (runs.length > 1) await finer();
    node.dataset.loaded = "true";
  });
})();
