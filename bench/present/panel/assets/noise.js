// Noise of the gyros while the run goes on: Allan deviation over averaging time, with its interval, and as a table.
window.gyrobenchNoise = (() => {
  "use strict";
  const { element, place } = window.gyrobenchPage;
  const { clock, library, paint, paintOf } = window.gyrobenchCharts;
  const TAUS = [1, 10, 100];
  let [chart, curves] = [null, []];

  const log = (value) => Math.log10(value);
  const power = (value) => String(Number((10 ** value).toPrecision(3)));

  // 1, 2 and 5 of every decade between two ends, as logarithms.
  function marks(low, high) {
    const found = [];
    for (let decade = Math.floor(low); decade <= high; decade += 1) for (const one of [1, 2, 5]) found.push(decade + log(one));
    return found.filter((one) => one >= low && one <= high);
  }

  function table() {
    const head = element("tr");
    head.append(...["Gyro", ...TAUS.map((tau) => `${tau} s`), "Over"].map((text) => Object.assign(element("th", "", text), { scope: "col" })));
    const rows = curves.map((curve, index) => {
      const row = element("tr");
      const name = element("td");
      const swatch = element("i", "noise-swatch");
      swatch.style.color = paint(paintOf(index));
      name.append(swatch, curve.gyro);
      row.append(name, ...TAUS.map((tau) => {
        const at = curve.tau_s.findIndex((one) => Math.abs(log(one / tau)) < 0.16);
        if (at < 0) return element("td", "number", "–");
        const cell = element("td", "number", `${curve.deviation[at].toPrecision(3)} °/h`);
        cell.title = `at ${curve.tau_s[at].toPrecision(3)} s, 95 %: ${curve.low[at].toPrecision(3)} to ${curve.high[at].toPrecision(3)}`;
        return cell;
      }), element("td", "", clock(curve.record_s)));
      return row;
    });
    const whole = element("table");
    const [top, body] = [element("thead"), element("tbody")];
    top.append(head);
    body.append(...rows);
    whole.append(top, body);
    place("[data-noise-words]").replaceChildren(whole, element("p", "hint", "Allan deviation of the last stretch, at most an hour, in which the table stood still. Temperature that moves is in it."));
  }

  function draw() {
    if (!chart || !curves.length) return;
    const ends = curves.flatMap((curve) => [...curve.low, ...curve.high]).map(log);
    const times = curves.flatMap((curve) => curve.tau_s).map(log);
    const axis = (name, nameGap, values) => {
      const [low, high] = [Math.min(...values) - 0.04, Math.max(...values) + 0.04];
      const customValues = marks(low, high);
      return {
        type: "value", name, nameLocation: "middle", nameGap, min: low, max: high, nameTextStyle: { color: paint("--muted") }, axisTick: { customValues }, splitLine: { show: false },
        axisLabel: { color: paint("--muted"), customValues, formatter: power, hideOverlap: true }, axisLine: { onZero: false, lineStyle: { color: paint("--line") } },
      };
    };
    chart.setOption({
      animation: false,
      grid: { left: 70, right: 18, top: 14, bottom: 44 },
      xAxis: axis("averaging time, s", 26, times),
      yAxis: axis("Allan deviation, °/h", 48, ends),
      series: curves.flatMap((curve, index) => ["deviation", "low", "high"].map((what) => ({
        type: "line", silent: true, showSymbol: what === "deviation", symbolSize: 5, data: curve.tau_s.map((tau, at) => [log(tau), log(curve[what][at])]),
        lineStyle: { color: paint(paintOf(index)), width: what === "deviation" ? 1.8 : 0.8, type: what === "deviation" ? "solid" : "dotted" }, itemStyle: { color: paint(paintOf(index)) },
      }))),
    }, { notMerge: true });
  }

  function show(found) {
    curves = found;
    const section = place("[data-noise]");
    if (!section) return;
    section.hidden = !curves.length;
    if (!curves.length) return;
    table();
    if (chart) return void draw();
    library().then((echarts) => {
      if (chart) return;
      const node = place("[data-noise-chart]");
      chart = echarts.init(node);
      new ResizeObserver(() => chart.resize()).observe(node);
      draw();
    });
  }

  return { show, repaint() { draw(); if (curves.length) table(); }, curves: () => curves };
})();
