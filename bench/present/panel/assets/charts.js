// Curves in lanes over one time axis, on the live page and on those of recorded runs: zoom by dragging, buttons and
// keys, a cursor that values are read off at, the phases as a strip. Everything from a run is set as text.
window.gyrobenchCharts = (() => {
  "use strict";
  const { element, setText } = window.gyrobenchPage;
  const [LEFT, RIGHT, TOP, LANE] = [66, 14, 30, 168];
  const PAINTS = ["--c1", "--c3", "--c4", "--c5", "--c6", "--c7", "--c8"];
  const STEPS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400];
  const [LEAST_S, DRAGGED] = [2, 8];
  const paint = (name) => getComputedStyle(document.body).getPropertyValue(name).trim();
  const paintOf = (index) => PAINTS[index % PAINTS.length];
  let loaded = null;
  const library = () => (loaded ??= import("/panel/echarts/index.js").then((found) => found.echarts));

  function clock(seconds) {
    if (typeof seconds !== "number") return "";
    const whole = Math.round(Math.abs(seconds));
    const two = (number) => String(number).padStart(2, "0");
    return `${seconds < -0.5 ? "−" : ""}${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
  }

  const digits = (value, most = 6) => (Math.abs(value) >= 1000 ? value.toFixed(1) : String(Number(value.toPrecision(most)))).replaceAll("-", "−");
  const step = (length) => STEPS.find((one) => length / one <= 8) ?? 86400 * Math.ceil(length / 86400 / 8);

  // Whole steps of the clock in a stretch: a zoomed axis too has ticks at 0:10:00, not at 0:09:17.
  function ticks(from, to, most) {
    const length = step(((to - from) * 8) / most);
    const first = Math.ceil(from / length);
    return Array.from({ length: Math.max(0, Math.floor(to / length) - first + 1) }, (_, index) => (first + index) * length);
  }

  // The index of the value nearest to a time, -1 where none is near: a cursor in a gap reads nothing.
  function nearest(series, time) {
    const times = series.t;
    let [low, high] = [0, times.length - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= time) low = middle;
      else high = middle;
    }
    if (high < 0) return -1;
    const at = Math.abs(times[high] - time) < Math.abs(times[low] - time) ? high : low;
    const usual = (times[times.length - 1] - times[0]) / Math.max(1, times.length - 1);
    return series.low[at] === null || Math.abs(times[at] - time) > 3 * usual + 0.5 ? -1 : at;
  }

  // A stretch has a lowest and a highest value; where nothing came the line ends.
  function points(series, factor) {
    const found = [];
    series.t.forEach((time, at) => {
      const [low, high] = [series.low[at], series.high[at]];
      found.push([time, low === null ? null : low * factor]);
      if (low !== null && high !== low) found.push([time, high * factor]);
    });
    return found;
  }

  // A curve that does not move is drawn as a line in the middle, not as its last digit.
  function span(lane, series, factor, from, to) {
    let [low, high] = [Infinity, -Infinity];
    for (const one of series) for (const [x, y] of one.data) if (y !== null && x >= from && x <= to) [low, high] = [Math.min(low, y), Math.max(high, y)];
    if (!(low <= high)) return { min: null, max: null };
    const least = (lane.least ?? 0) * factor;
    if (high - low >= least) {
      const room = 0.06 * (high - low || Math.abs(high) || 1);
      return { min: low - room, max: high + room };
    }
    const unit = least / 4;
    const middle = unit * Math.round((low + high) / 2 / unit);
    return { min: Number((middle - least / 2).toPrecision(8)), max: Number((middle + least / 2).toPrecision(8)) };
  }

  // Rates that are small are read in degrees an hour.
  function scale(lane) {
    if (lane.unit !== "°/s" || !lane.small) return [1, lane.unit];
    let most = 0;
    for (const one of lane.series) for (const value of one.high) if (value !== null) most = Math.max(most, Math.abs(value));
    return most < 0.05 ? [3600, "°/h"] : [1, lane.unit];
  }

  class Lanes {
    // `zoomed(view)` is told of a stretch [from, to] that somebody wants to see, null for everything.
    constructor(node, zoomed) {
      this.zoomed = zoomed;
      this.data = { lanes: [], from: 0, to: 1, full: [0, 1], phases: [] };
      this.cursor = null;
      this.bar = element("div", "reader");
      for (const [sign, word, act] of [["+", "Zoom in", () => this.zoom(0.5)], ["−", "Zoom out", () => this.zoom(2)], ["◀", "Earlier", () => this.move(-0.5)], ["▶", "Later", () => this.move(0.5)], ["All", "Show everything", () => this.zoomed(null)]]) {
        const button = element("button", "do quiet", sign);
        button.type = "button";
        button.title = word;
        button.setAttribute("aria-label", word);
        button.addEventListener("click", act);
        this.bar.append(button);
      }
      this.choice = element("select");
      this.choice.setAttribute("aria-label", "Show a phase");
      this.choice.addEventListener("change", () => this.showPhase(Number(this.choice.value)));
      this.bar.append(this.choice);
      this.strip = element("div", "phases");
      this.strip.setAttribute("aria-hidden", "true");
      this.field = element("div", "field-of-curves");
      this.canvas = element("div", "lanes-canvas");
      this.line = element("i", "cursor");
      this.box = element("i", "dragged");
      this.reading = element("div", "reading");
      this.reading.setAttribute("role", "status");
      this.field.append(this.canvas, this.line, this.box);
      this.field.tabIndex = 0;
      this.field.setAttribute("role", "group");
      this.field.setAttribute("aria-label", "Curves. Arrow keys move the cursor, plus and minus zoom, Home shows everything.");
      node.replaceChildren(this.bar, this.strip, this.field, this.reading);
      this.listen();
      this.read();
      library().then((echarts) => {
        this.chart = echarts.init(this.canvas, null, { renderer: "canvas" });
        new ResizeObserver(() => this.resized()).observe(this.field);
        this.draw(true);
      });
    }

    get ready() { return Boolean(this.chart); }

    // `lanes`: {title, unit, least, small, series: [{id, name, colour, dash, t, low, high}]}; `full`: all there is;
    // `phases`: [name, from, to]. Whatever is shown, times are on one axis.
    show(data) {
      const before = this.data;
      this.data = { phases: [], ...data };
      const shape = (one) => JSON.stringify(one.lanes.map((lane) => [lane.title, lane.series.map((series) => series.id)]));
      this.draw(shape(before) !== shape(this.data));
      if (JSON.stringify(before.phases) !== JSON.stringify(this.data.phases)) this.fillPhases();
      this.placePhases();
      this.placeCursor();
    }

    repaint() { this.draw(true); }

    resized() {
      this.chart.resize();
      this.placePhases();
      this.placeCursor();
    }

    draw(whole) {
      const { lanes, from, to } = this.data;
      if (!this.chart) return;
      const height = LANE * Math.max(1, lanes.length) + 4;
      if (this.canvas.clientHeight !== height) {
        this.canvas.style.height = `${height}px`;
        this.chart.resize();
      }
      const scales = lanes.map(scale);
      const series = lanes.flatMap((lane, index) => lane.series.map((one) => ({
        id: `${index} ${one.id}`, name: one.name, type: "line", showSymbol: false, animation: false, silent: true, xAxisIndex: index, yAxisIndex: index,
        lineStyle: { width: 1.6, color: paint(one.colour), type: one.dash ?? "solid" }, itemStyle: { color: paint(one.colour) }, data: points(one, scales[index][0]),
      })));
      const axis = { axisLabel: { color: paint("--muted") }, axisLine: { onZero: false, lineStyle: { color: paint("--line") } } };
      const font = { fontFamily: paint("--sans"), color: paint("--ink"), fontSize: 13, fontWeight: 600 };
      const marks = ticks(from, to, this.field.clientWidth < 560 ? 3 : 8);
      this.chart.setOption({
        animation: false,
        title: lanes.map((lane, index) => ({ left: 4, top: 4 + index * LANE, text: `${lane.title}, ${scales[index][1]}`, textStyle: font })),
        grid: lanes.map((_, index) => ({ left: LEFT, right: RIGHT, top: TOP + index * LANE, height: LANE - 55 })),
        xAxis: lanes.map((_, index) => ({ ...axis, gridIndex: index, type: "value", min: from, max: to, splitLine: { show: false }, axisTick: { customValues: marks }, axisLabel: { ...axis.axisLabel, customValues: marks, formatter: clock, hideOverlap: true } })),
        yAxis: lanes.map((lane, index) => ({ ...axis, gridIndex: index, type: "value", scale: true, ...span(lane, series.filter((one) => one.yAxisIndex === index), scales[index][0], from, to), splitNumber: 3, axisLabel: { ...axis.axisLabel, showMinLabel: false, showMaxLabel: false }, splitLine: { lineStyle: { color: paint("--grid") } } })),
        series,
      }, whole ? { notMerge: true, lazyUpdate: true } : { lazyUpdate: true });
    }

    // Where a time is on the page, and what time is there

    get width() { return Math.max(1, this.field.clientWidth - LEFT - RIGHT); }

    pixel(time) { return LEFT + ((time - this.data.from) / (this.data.to - this.data.from)) * this.width; }

    time(pixel) {
      const share = Math.min(1, Math.max(0, (pixel - LEFT) / this.width));
      return this.data.from + share * (this.data.to - this.data.from);
    }

    zoom(factor) {
      const { from, to, full } = this.data;
      const middle = this.cursor !== null && this.cursor >= from && this.cursor <= to ? this.cursor : (from + to) / 2;
      const length = Math.max(LEAST_S, (to - from) * factor);
      if (length >= full[1] - full[0]) return void this.zoomed(null);
      const share = (middle - from) / (to - from);
      this.want(middle - share * length, length);
    }

    move(share) {
      const { from, to } = this.data;
      this.want(from + share * (to - from), to - from);
    }

    want(from, length) {
      const [first, last] = this.data.full;
      const start = Math.max(first, Math.min(from, last - length));
      this.zoomed([start, start + length]);
    }

    showPhase(index) {
      const phase = this.data.phases[index];
      this.zoomed(phase ? [phase[1], Math.max(phase[2], phase[1] + LEAST_S)] : null);
    }

    fillPhases() {
      const option = (text, value) => Object.assign(element("option", "", text), { value });
      const count = {};
      this.choice.hidden = !this.data.phases.length;
      this.choice.replaceChildren(option("All phases", -1), ...this.data.phases.map(([name], index) => {
        count[name] = (count[name] ?? 0) + 1;
        return option(name.replaceAll("_", " ") + (count[name] > 1 ? ` (${count[name]})` : ""), index);
      }));
    }

    placePhases() {
      const { phases, from, to } = this.data;
      this.strip.hidden = !phases.length;
      this.strip.replaceChildren(...phases.map(([name, start, end], index) => ({ name, index, start: Math.max(start, from), end: Math.min(end, to) })).filter((one) => one.end > one.start).map((one) => {
        const width = this.pixel(one.end) - this.pixel(one.start);
        const part = element("span", one.index % 2 ? "odd" : "", width < 30 ? "" : one.name.replaceAll("_", " "));
        part.style.left = `${this.pixel(one.start)}px`;
        part.style.width = `${width}px`;
        part.title = one.name.replaceAll("_", " ");
        part.addEventListener("click", () => this.showPhase(one.index));
        return part;
      }));
    }

    // The cursor

    point(time) {
      const [first, last] = this.data.full;
      this.cursor = time === null ? null : Math.min(last, Math.max(first, time));
      this.placeCursor();
    }

    placeCursor() {
      const { from, to } = this.data;
      const shown = this.cursor !== null && this.cursor >= from && this.cursor <= to;
      this.line.hidden = !shown;
      if (shown) this.line.style.left = `${this.pixel(this.cursor)}px`;
      this.read();
    }

    read() {
      this.reading.classList.toggle("at-cursor", this.cursor !== null);
      this.reading.setAttribute("aria-live", this.cursor === null ? "off" : "polite");
      const time = this.cursor ?? (this.data.newest || null);
      if (time === null) {
        if (this.reading.dataset.at === "none") return;
        this.reading.dataset.at = "none";
        this.reading.replaceChildren(element("span", "hint", "Point at the curves to read values; drag over a stretch to zoom into it."));
        return;
      }
      const phase = this.data.phases.find(([, start, end]) => time >= start && time < end);
      const parts = [element("b", "", clock(time) + (phase ? `, ${phase[0].replaceAll("_", " ")}` : ""))];
      for (const lane of this.data.lanes) {
        const [factor, unit] = scale(lane);
        for (const series of lane.series) {
          const at = nearest(series, time);
          const entry = element("span", "read");
          const swatch = element("i", series.dash ?? "");
          swatch.style.color = paint(series.colour);
          const value = at < 0 ? "–" : series.low[at] === series.high[at] ? digits(series.low[at] * factor) : `${digits(series.low[at] * factor)} … ${digits(series.high[at] * factor)}`;
          entry.append(swatch, element("span", "", `${series.label ?? series.name} `), element("span", "value", `${value} ${unit}`));
          parts.push(entry);
        }
      }
      const text = parts.map((part) => part.textContent).join("|");
      if (this.reading.dataset.at === text) return;
      this.reading.dataset.at = text;
      this.reading.replaceChildren(...parts);
    }

    listen() {
      let start = null;
      const x = (event) => event.clientX - this.field.getBoundingClientRect().left;
      const box = (from, to) => {
        this.box.hidden = from === to;
        Object.assign(this.box.style, { left: `${Math.min(from, to)}px`, width: `${Math.abs(to - from)}px` });
      };
      box(0, 0);
      this.field.addEventListener("pointerdown", (event) => {
        if (event.button || event.target.closest("button")) return;
        start = x(event);
        this.field.setPointerCapture(event.pointerId);
      });
      this.field.addEventListener("pointermove", (event) => {
        if (start !== null && Math.abs(x(event) - start) > DRAGGED) box(start, x(event));
        else if (event.pointerType === "mouse") this.point(this.time(x(event)));
      });
      this.field.addEventListener("pointerup", (event) => {
        const from = start;
        start = null;
        box(0, 0);
        if (from === null) return;
        const [low, high] = [this.time(Math.min(from, x(event))), this.time(Math.max(from, x(event)))];
        if (Math.abs(x(event) - from) > DRAGGED) this.zoomed([low, Math.max(high, low + LEAST_S)]);
        else this.point(this.time(x(event)));
      });
      this.field.addEventListener("pointercancel", () => { start = null; box(0, 0); });
      this.field.addEventListener("dblclick", () => this.zoomed(null));
      this.field.addEventListener("keydown", (event) => {
        const { from, to } = this.data;
        const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
        if (by) {
          this.point((this.cursor ?? (from + to) / 2) + (by * (to - from) * (event.shiftKey ? 10 : 1)) / 100);
          if (this.cursor < from || this.cursor > to) this.move(by / 2);
        }
        else if (event.key === "+" || event.key === "=") this.zoom(0.5);
        else if (event.key === "-") this.zoom(2);
        else if (event.key === "Home") this.zoomed(null);
        else if (event.key === "Escape") this.point(null);
        else return;
        event.preventDefault();
      });
    }
  }

  return { Lanes, clock, digits, library, paint, paintOf };
})();
