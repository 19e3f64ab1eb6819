// The page of trends: one figure of one or several units over the date of the run, and how two units compare.
(() => {
  "use strict";
  const { element, place, setText } = window.gyrobenchPage;
  const { digits, library, paint, paintOf } = window.gyrobenchCharts;
  const units = JSON.parse(document.body.dataset.units);
  const node = place("[data-trend]");
  if (!node || !units.length) return;
  const choice = place("[data-figures]");
  const POLL_MS = 1500;
  let [found, chart, wanted] = [{ figures: [] }, null, document.body.dataset.figure];

  const colour = (unit) => paint(paintOf(units.indexOf(unit)));
  const value = (number, of) => `${digits(number)}${of ? ` ${of}` : ""}`;
  // As many decimals as the interval is worth: two digits of its half width.
  function fitting(number, low, high) {
    const half = low === null ? 0 : (high - low) / 2;
    if (!(half > 0)) return digits(number);
    const decimals = 1 - Math.floor(Math.log10(half));
    return (decimals > 9 ? number.toExponential(2) : number.toFixed(Math.max(0, decimals))).replaceAll("-", "−").replace(/^−(0\.?0*)$/, "$1");
  }
  const interval = (one) => (one.low === null ? "no interval known" : `${fitting(one.low, one.low, one.high)} to ${fitting(one.high, one.low, one.high)}`);
  const worth = (one, of) => `${fitting(one.value, one.low, one.high)}${of ? ` ${of}` : ""}`;
  const day = (seconds) => new Date(seconds * 1000).toISOString().slice(0, 16).replace("T", " ");
  const chosen = () => found.figures.find((figure) => `${figure.figure} [${figure.of}]` === choice.value) ?? found.figures[0];

  function fillChoice() {
    const groups = new Map();
    for (const figure of found.figures) {
      const [head, tail] = figure.figure.includes(": ") ? figure.figure.split(": ", 2) : ["Test standards", figure.figure];
      if (!groups.has(head)) groups.set(head, Object.assign(element("optgroup"), { label: head }));
      const key = `${figure.figure} [${figure.of}]`;
      const count = figure.units.reduce((sum, unit) => sum + unit.points.length, 0);
      groups.get(head).append(Object.assign(element("option", "", `${tail}${figure.of ? `, ${figure.of}` : ""} (${count})`), { value: key }));
    }
    const before = choice.value || wanted;
    choice.replaceChildren(...groups.values());
    const keys = [...choice.options].map((option) => option.value);
    // the first one to see: what has an interval says more than what has none
    const telling = found.figures.find((figure) => figure.units.some((unit) => unit.points.some((point) => point.low !== null)));
    choice.value = keys.includes(before) ? before : telling ? `${telling.figure} [${telling.of}]` : keys[0] ?? "";
  }

  function whiskers(points, unit) {
    return {
      type: "custom", silent: true, name: `${unit} interval`, data: points.filter((point) => point.low !== null).map((point) => [point.time_s * 1000, point.low, point.high]), encode: { x: 0, y: [1, 2] },
      renderItem: (_, api) => {
        const [low, high] = [api.coord([api.value(0), api.value(1)]), api.coord([api.value(0), api.value(2)])];
        const line = (x1, y1, x2, y2) => ({ type: "line", shape: { x1, y1, x2, y2 }, style: { stroke: colour(unit), lineWidth: 1.6 } });
        return { type: "group", children: [line(low[0], low[1], high[0], high[1]), line(low[0] - 5, low[1], low[0] + 5, low[1]), line(high[0] - 5, high[1], high[0] + 5, high[1])] };
      },
    };
  }

  function draw() {
    const figure = chosen();
    if (!chart || !figure) return;
    const every = figure.units.flatMap((unit) => unit.points);
    const ends = every.flatMap((point) => [point.low ?? point.value, point.high ?? point.value]);
    const limits = [...new Set(every.flatMap((point) => [point.least, point.most]).filter((limit) => limit !== null))];
    const near = limits.filter((limit) => limit >= Math.min(...ends) - 3 * (Math.max(...ends) - Math.min(...ends)) && limit <= Math.max(...ends) + 3 * (Math.max(...ends) - Math.min(...ends)));
    const [low, high] = [Math.min(...ends, ...near), Math.max(...ends, ...near)];
    const room = 0.08 * (high - low || Math.abs(high) || 1);
    const times = every.map((point) => point.time_s * 1000);
    const around = Math.max(0.04 * (Math.max(...times) - Math.min(...times)), 3600e3);
    const axis = { axisLabel: { color: paint("--muted"), hideOverlap: true }, axisLine: { lineStyle: { color: paint("--line") } } };
    const series = figure.units.filter((unit) => unit.points.length).flatMap((unit) => [
      { type: "line", name: unit.unit, data: unit.points.map((point) => [point.time_s * 1000, point.value]), symbol: "circle", symbolSize: 8, showAllSymbol: true, silent: true, lineStyle: { width: 1, type: "dotted", color: colour(unit.unit) }, itemStyle: { color: colour(unit.unit) } },
      whiskers(unit.points, unit.unit),
    ]);
    if (series.length) series[0].markLine = { silent: true, symbol: "none", label: { formatter: "limit", color: paint("--muted") }, lineStyle: { color: paint("--bad-ink"), type: "dashed" }, data: near.map((limit) => ({ yAxis: limit })) };
    chart.setOption({
      animation: false, useUTC: true,
      title: { left: 4, top: 4, text: figure.figure + (figure.of ? `, ${figure.of}` : ""), textStyle: { fontFamily: paint("--sans"), color: paint("--ink"), fontSize: 13, fontWeight: 600, width: node.clientWidth - 20, overflow: "truncate" } },
      grid: { left: 76, right: 42, top: 36, bottom: 30 },
      xAxis: { ...axis, type: "time", min: Math.min(...times) - around, max: Math.max(...times) + around, splitNumber: node.clientWidth < 560 ? 3 : 6 },
      yAxis: { ...axis, type: "value", min: low - room, max: high + room, axisLabel: { ...axis.axisLabel, showMinLabel: false, showMaxLabel: false, formatter: (number) => digits(Number(number.toPrecision(6))) }, splitLine: { lineStyle: { color: paint("--grid") } } },
      series,
    }, { notMerge: true });
  }

  function words() {
    const figure = chosen();
    place("[data-words]").replaceChildren(...(figure?.units ?? []).map((unit) => {
      const line = element("p");
      const swatch = element("i");
      swatch.style.color = colour(unit.unit);
      const count = unit.points.length === 1 ? "1 run" : `${unit.points.length} runs`;
      let text = `${count}`;
      if (unit.slope) {
        const moves = unit.slope.low > 0 || unit.slope.high < 0;
        text += `, ${unit.slope.value > 0 ? "+" : ""}${worth(unit.slope, figure.of)} a month (95 %: ${interval(unit.slope)}): ${moves ? "it moves" : "no drift can be told"}`;
      } else if (unit.points.length) text += ", a drift can be told from 3 on";
      line.append(swatch, element("b", "", `${unit.unit}: `), element("span", "", text));
      return line;
    }));
  }

  function table(target, heads, rows) {
    const head = element("tr");
    head.append(...heads.map((text) => Object.assign(element("th", "", text), { scope: "col" })));
    const [top, body] = [element("thead"), element("tbody")];
    top.append(head);
    body.append(...rows.map((cells) => {
      const row = element("tr");
      row.append(...cells.map((cell) => {
        const box = element("td", typeof cell === "string" && /^[+−\d]/.test(cell) ? "number" : "");
        box.append(cell);
        return box;
      }));
      return row;
    }));
    target.replaceChildren(top, body);
  }

  function judged(one, of) {
    if (!one) return "needs 2 runs of each";
    const sign = one.value > 0 ? "+" : "";
    if (one.low === null) return `${sign}${value(one.value, of)}, no interval known`;
    return element("span", one.apart ? "differs" : "", `${sign}${worth(one, of)} (${interval(one)}): ${one.apart ? "they differ" : "no difference can be told"}`);
  }

  function tables() {
    const figure = chosen();
    const rows = (figure?.units ?? []).flatMap((unit) => unit.points.map((point) => ({ ...point, unit: unit.unit }))).sort((one, other) => other.time_s - one.time_s);
    table(place("[data-values]"), ["Run", "Unit", "Date (UTC)", "Value", "95 % interval", "Limits"], rows.map((point) => {
      const link = Object.assign(element("a", "", point.run), { href: `/curves?run=${encodeURIComponent(point.run)}` });
      const limits = point.least === null && point.most === null ? "none" : `${point.least === null ? "" : digits(point.least)} … ${point.most === null ? "" : digits(point.most)}`;
      return [link, point.unit, day(point.time_s), worth(point, figure.of), interval(point), limits];
    }));
    const compared = place("[data-compared]");
    if (compared) table(compared, ["Figure", ...units, "Difference of the newest", "Difference of the means"], found.figures.filter((one) => one.compared).map((one) => [
      one.figure + (one.of ? `, ${one.of}` : ""), ...one.units.map((unit) => worth(unit.points[unit.points.length - 1])), judged(one.compared.newest, one.of), judged(one.compared.means, one.of),
    ]));
  }

  function show() {
    draw();
    words();
    tables();
  }

  async function load() {
    const query = new URLSearchParams(units.map((unit) => ["unit", unit]));
    found = await (await fetch(`/panel/trends?${query}`)).json();
    const said = place("[data-said]");
    const problems = found.problems.map(([run, problem]) => `${run}: ${problem}`);
    let text = "";
    if (found.missing) text = `${found.missing} of ${found.runs} runs are still being read…`;
    else if (!found.runs) text = `There is no completed run of ${units.join(", ")} here.`;
    else if (!found.figures.length) text = "The runs of these units have no figures.";
    setText(said, [text, ...problems].filter(Boolean).join("\n"));
    said.hidden = !said.textContent;
    fillChoice();
    show();
    node.dataset.loaded = String(!found.missing);
    if (found.missing) setTimeout(load, POLL_MS);
  }

  choice.addEventListener("change", () => {
    wanted = choice.value;
    const address = new URL(location.href);
    address.searchParams.set("figure", wanted);
    history.replaceState(null, "", address);
    show();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
  library().then((echarts) => {
    chart = echarts.init(node);
    new ResizeObserver(() => { chart.resize(); draw(); }).observe(node);
    draw();
  });
  load();
})();
