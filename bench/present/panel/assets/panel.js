// The page's numbers, lists and curves: takes what the server sends and shows it. Everything from a run is set as
// text, never as markup.
(() => {
  "use strict";
  const { element, paper, place, setText, showBenches } = window.gyrobenchPage;
  const state = { values: {}, session: "", columns: [], levels: {}, capacity: 0, level: "run", gyros: "", auxiliary: "" };
  const PLOTS = {
    temperature: { unit: "°C", title: "Temperature", least: 2 },
    gyro: { unit: "°/s", title: "Gyro rate", least: 1e-5 },
    table: { unit: "°/s", title: "Table rate", least: 0.2 },
  };
  const PAINTS = ["--c1", "--c3", "--c4", "--c5", "--c6", "--c7", "--c8"];

  // Numbers

  function showValues(values) {
    for (const [key, text] of Object.entries(values)) {
      state.values[key] = text;
      for (const node of document.querySelectorAll(`[data-live="${CSS.escape(key)}"]`)) {
        setText(node, text);
        if (key.endsWith(".age")) node.closest(".card")?.classList.toggle("old", text.startsWith("last read"));
      }
    }
    if ("emulated" in values) document.body.classList.toggle("emulated", Boolean(values.emulated));
    if ("progress" in values) {
      const bar = place("[data-progress]");
      if (bar) bar.style.width = `${100 * Number(values.progress)}%`;
    }
  }

  function live(key, unit, className) {
    const both = document.createDocumentFragment();
    const value = element("span", className || "value", state.values[key] ?? "–");
    value.dataset.live = key;
    both.append(value);
    if (unit) {
      const tail = element("span", "unit", unit.startsWith("=") ? state.values[unit.slice(1)] ?? "" : unit);
      if (unit.startsWith("=")) tail.dataset.live = unit.slice(1);
      both.append(tail);
    }
    return both;
  }

  function pair(label, ...content) {
    const row = element("div");
    const right = element("dd");
    right.append(...content);
    row.append(element("dt", "", label), right);
    return row;
  }

  function buildGyros(names) {
    const found = JSON.stringify(names);
    if (found === state.gyros) return;
    state.gyros = found;
    place("[data-gyros]").replaceChildren(
      ...names.map((name) => {
        const key = (part) => `gyro.${name}.${part}`;
        const card = element("article", "card gyro");
        const head = element("h2", "", `${name} `);
        head.append(live(key("unit"), "", "serial"));
        const main = element("p", "main");
        main.append(live(key("mean"), "=" + key("rate_unit"), "value big"));
        const list = element("dl");
        list.append(
          pair("Latest", live(key("latest"), "=" + key("rate_unit"))),
          pair("Inside", live(key("temp"), "°C")),
          pair("Frames", live(key("frames"))),
          pair("Lost", live(key("lost"), "", "value counter")),
          pair("CRC and others", live(key("rejected"), "", "value counter"), live(key("reasons"), "", "reasons")),
        );
        const note = element("p", "note age", "mean of the last minute, ");
        note.append(live(key("age"), "", ""));
        card.append(head, main, note, list);
        card.classList.toggle("old", (state.values[key("age")] ?? "").startsWith("last read"));
        return card;
      }),
    );
  }

  function buildAuxiliary(names, readings) {
    const found = JSON.stringify([names, readings]);
    if (found === state.auxiliary) return;
    state.auxiliary = found;
    place("[data-auxiliary]").replaceChildren(
      ...names.map(([number, name]) => pair(name, live(`aux.${number}`, "°C"))),
      ...readings.map(([key, words, unit]) => pair(words, live(`reading.${key}`, unit))),
    );
  }

  // Banner and lists

  function clock(seconds) {
    if (typeof seconds !== "number") return "";
    const whole = Math.round(seconds);
    const two = (number) => String(number).padStart(2, "0");
    return `${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
  }

  function showNews(news) {
    const head = news.banner;
    const section = place("[data-banner]");
    section.className = `banner ${head.tone}`;
    setText(place("[data-word]"), head.word);
    for (const part of ["happened", "done", "press"]) {
      const node = place(`[data-part="${part}"]`);
      setText(node, head[part]);
      node.parentElement.hidden = !head[part];
    }
    document.title = head.tone === "good" ? "gyrobench panel" : `${head.word} · gyrobench panel`;
    fill("log", news.log.map(([seconds, kind, text]) => line(seconds, kind, text)), "Nothing yet.");
    const own = news.alarms.map((alarm) => {
      const row = line(alarm.time_s, alarm.kind === "log" ? "alarm" : alarm.kind, alarm.text);
      row.classList.add(alarm.seen ? "seen" : "unseen");
      row.lastChild.append(element("em", "", [alarm.run, alarm.seen].filter(Boolean).join(", ")));
      return row;
    });
    fill("alarms", own, "No alarms.");
    state.session = news.session;
    place("[data-unseen]").hidden = !news.alarms.some((alarm) => !alarm.seen);
    place("[data-papers]").replaceChildren(...news.papers.map(paper));
    showBenches(news.benches, news.session);
    buildGyros(news.gyros);
    buildAuxiliary(news.auxiliary, news.readings);
  }

  function line(seconds, kind, text) {
    const row = element("li", `k-${kind}`);
    row.append(element("time", "", clock(seconds)), element("span", "", text));
    return row;
  }

  function fill(name, rows, nothing) {
    place(`[data-list="${name}"]`).replaceChildren(...(rows.length ? rows : [element("li", "k-none", nothing)]));
  }

  function showRuns(runs) {
    const rows = runs.map((run) => {
      const row = element("li", "run-row");
      const outcome = element("span", `outcome ${run.kind}`, run.outcome);
      outcome.title = run.why || "";
      const links = element("span", "papers");
      links.append(...(run.papers || []).map(paper));
      row.append(
        element("span", "id", run.run), element("span", "", run.procedure || ""), element("span", "", run.units || ""),
        element("span", "", run.bench || ""), element("span", "", run.started ? `${run.started} UTC` : ""),
        element("span", "", run.length || ""), outcome, links,
      );
      if (run.why && run.kind !== "completed") row.append(element("span", "why", run.why));
      return row;
    });
    place("[data-runs]").replaceChildren(...(rows.length ? rows : [element("li", "k-none", "No runs in this folder yet.")]));
  }

  async function acknowledge() {
    const field = place('[data-testid="name"]');
    const by = (field?.value || "").trim();
    const said = place("[data-unseen] span");
    if (!by) {
      setText(said, "Type your name at the top of the page first: it goes into the record.");
      field?.focus();
      return;
    }
    const answer = await fetch("/panel/acknowledge", {
      method: "POST",
      headers: { "content-type": "application/json" },
      body: JSON.stringify({ session: state.session, by }),
    });
    setText(said, answer.ok ? "" : await answer.text());
  }

  // Curves

  function addRows(rows) {
    for (const [name, fresh] of Object.entries(rows)) {
      const level = state.levels[name];
      if (!level) continue;
      for (const row of fresh) {
        let at = level.rows.length;
        while (at && level.rows[at - 1][0] > row[0]) at -= 1;
        if (at && level.rows[at - 1][0] === row[0]) level.rows[at - 1] = row;
        else level.rows.splice(at, 0, row);
      }
      while (level.rows.length > state.capacity) level.rows.shift();
    }
  }

  // Where nothing came the line ends: a null, not a straight line to the next value.
  function points(rows, column, factor) {
    const found = [];
    for (const row of rows) {
      const low = row[1 + 2 * column];
      const high = row[2 + 2 * column];
      if (low === null) {
        found.push([row[0], null]);
        continue;
      }
      found.push([row[0], low * factor]);
      if (high !== low) found.push([row[0], high * factor]);
    }
    return found;
  }

  function chartOf(plot) {
    const node = place(`[data-plot="${plot}"]`);
    if (!node || !node.id || typeof getElement !== "function") return null;
    return getElement(Number(node.id.slice(1)))?.chart ?? null;
  }

  const STEPS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400];
  const step = (length) => STEPS.find((one) => length / one <= 8) ?? 86400 * Math.ceil(length / 86400 / 8);

  // A curve that does not move is drawn as a line in the middle, not as its last digit.
  function span(plot, series, factor) {
    let [low, high] = [Infinity, -Infinity];
    for (const one of series) for (const [, y] of one.data) if (y !== null) [low, high] = [Math.min(low, y), Math.max(high, y)];
    const least = PLOTS[plot].least * factor;
    if (!(low <= high) || high - low >= least) return { min: null, max: null };
    const unit = least / 4;
    const middle = unit * Math.round((low + high) / 2 / unit);
    return { min: Number((middle - least / 2).toPrecision(8)), max: Number((middle + least / 2).toPrecision(8)) };
  }

  function draw(plot, whole) {
    const chart = chartOf(plot);
    const level = state.levels[state.level];
    if (!chart || !level) return false;
    const css = getComputedStyle(document.body);
    const paint = (name) => css.getPropertyValue(name).trim();
    const mine = state.columns.map((column, index) => ({ ...column, index })).filter((c) => c.plot === plot);
    const rows = level.rows;
    const lanes = plot === "gyro" ? mine.map((c) => [c]) : [mine];
    const [factors, units] = [[], []];
    for (const [c] of lanes) {
      let most = 0;
      for (const row of rows) most = Math.max(most, Math.abs(row[1 + 2 * c.index] ?? 0), Math.abs(row[2 + 2 * c.index] ?? 0));
      const small = plot === "gyro" && most < 0.05;
      factors.push(small ? 3600 : 1);
      units.push(small ? "°/h" : PLOTS[plot].unit);
    }
    const lane = (c) => (plot === "gyro" ? mine.indexOf(c) : 0);
    const last = rows.length ? rows[rows.length - 1][0] : 0;
    const from = level.span_s ? last - level.span_s : 0;
    const measured = mine.filter((c) => c.key !== "set");
    const colour = (c) => paint(c.key === "set" ? "--c2" : PAINTS[measured.indexOf(c) % PAINTS.length]);
    const series = mine.map((c) => ({
      id: c.key,
      name: c.name,
      type: "line",
      showSymbol: false,
      animation: false,
      silent: true,
      lineStyle: { width: 1.5, color: colour(c), type: c.key === "set" ? "dashed" : "solid" },
      itemStyle: { color: colour(c) },
      xAxisIndex: lane(c),
      yAxisIndex: lane(c),
      data: points(rows, c.index, factors[lane(c)]),
    }));
    const axis = { axisLabel: { color: paint("--muted") }, axisLine: { onZero: false, lineStyle: { color: paint("--line") } } };
    const height = 165;
    const shownLanes = Math.max(1, lanes.length);
    if (plot === "gyro" && chart.getHeight() !== height * shownLanes + 25) {
      place('[data-plot="gyro"]').style.setProperty("height", `${height * shownLanes + 25}px`, "important");
      chart.resize();
    }
    const name = (index) => (plot === "gyro" && mine[index] ? `${mine[index].name}, ${units[index]}` : `${PLOTS[plot].title}, ${units[index] ?? PLOTS[plot].unit}`);
    const title = { left: 4, textStyle: { color: paint("--ink"), fontSize: 13, fontWeight: 600, fontFamily: paint("--sans") } };
    const every = [...Array(shownLanes).keys()];
    const option = {
      animation: false,
      title: every.map((index) => ({ ...title, text: name(index), top: 2 + index * height })),
      legend: { show: plot !== "gyro", right: 8, top: 2, left: 170, type: "scroll", icon: "roundRect", itemWidth: 14, itemHeight: 3, textStyle: { color: paint("--muted") } },
      grid: every.map((index) => (plot === "gyro" ? { left: 66, right: 14, top: 30 + index * height, height: height - 55 } : { left: 66, right: 14, top: 30, bottom: 24 })),
      tooltip: { trigger: "axis", confine: true, transitionDuration: 0, backgroundColor: paint("--paper"), borderColor: paint("--line"), textStyle: { color: paint("--ink") } },
      xAxis: every.map((index) => ({ ...axis, gridIndex: index, type: "value", min: Math.max(from, Math.min(0, from)), max: Math.max(last, from + 1), interval: step(last - Math.max(from, 0)), splitLine: { show: false }, axisLabel: { ...axis.axisLabel, formatter: clock, hideOverlap: true }, axisPointer: { label: { formatter: (p) => clock(p.value) } } })),
      yAxis: every.map((index) => ({ ...axis, gridIndex: index, type: "value", scale: true, ...span(plot, series.filter((one) => one.yAxisIndex === index), factors[index] ?? 1), splitNumber: plot === "gyro" ? 3 : 4, splitLine: { lineStyle: { color: paint("--grid") } } })),
      series,
    };
    chart.setOption(option, whole ? { notMerge: true, lazyUpdate: true } : { lazyUpdate: true });
    return true;
  }

  let whole = true;
  let waiting = false;

  function redraw() {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      const drawn = Object.keys(PLOTS).map((plot) => draw(plot, whole));
      if (drawn.every(Boolean)) whole = false;
      else if (state.columns.length) setTimeout(redraw, 100);
    });
  }

  // The socket

  function take(message) {
    if (message.values) showValues(message.values);
    if (message.news) showNews(message.news);
    if (message.runs) showRuns(message.runs);
    if (message.curves) {
      Object.assign(state, { columns: message.curves.columns, levels: message.curves.levels, capacity: message.curves.capacity });
      whole = true;
    }
    if (message.rows) addRows(message.rows);
    if (message.curves || message.rows) redraw();
    window.gyrobench.messages += 1;
  }

  // Whoever is signed out is asked to sign in; a panel that does not answer is tried again.
  async function again() {
    const answer = await fetch("/panel/who").catch(() => null);
    if (answer?.status === 401) return void location.reload();
    connect();
  }

  let panel = "";

  function connect() {
    const session = encodeURIComponent(new URLSearchParams(location.search).get("session") || "");
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/panel/live?session=${session}`);
    socket.onmessage = (event) => {
      const message = JSON.parse(event.data);
      if (message.panel) {
        // another process than the one that made this page: its buttons lead nowhere
        if (panel && panel !== message.panel) return void location.reload();
        panel = message.panel;
        document.body.classList.remove("cut-off");
      }
      take(message);
    };
    socket.onclose = () => {
      document.body.classList.add("cut-off");
      setTimeout(again, 1000);
    };
  }

  window.gyrobench = {
    messages: 0,
    show(level) { state.level = level; whole = true; redraw(); },
    repaint() { whole = true; redraw(); },
    levels: () => state.levels,
    columns: () => state.columns,
    rows: () => state.levels[state.level]?.rows.length ?? 0,
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => window.gyrobench.repaint());

  // What was painted first goes to its place on the page with the controls, once that is there.
  function settle() {
    if (!place("[data-place]")) return void setTimeout(settle, 20);
    for (const node of document.querySelectorAll("[data-move]")) place(`[data-place="${node.dataset.move}"]`).append(node);
    place("#first-paint")?.remove();
    redraw();
  }
  place('[data-testid="acknowledge"]').addEventListener("click", acknowledge);
  connect();
  settle();
})();
