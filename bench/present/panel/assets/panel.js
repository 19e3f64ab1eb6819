// The page's numbers, lists and curves: takes what the server sends and shows it. Everything from a run is set as
// text, never as markup.
(() => {
  "use strict";
  const { element, paper, place, setText, showBenches } = window.gyrobenchPage;
  const state = { values: {}, session: "", columns: [], levels: {}, capacity: 0, level: "run", gyros: "", auxiliary: "", phases: [], held: null, fine: null, epoch: -1 };
  const { Lanes, clock, paintOf } = window.gyrobenchCharts;
  const LEAST = { Temperature: 2, "Table rate": 0.2 };
  const { Expected } = window.gyrobenchExpected;
  let [chart, plan] = [null, null];

  // What this page shows: a session, a bench whatever it does, or what the panel chooses.
  function asked() {
    const found = new URLSearchParams(location.search);
    return { session: found.get("session") || "", bench: found.get("bench") || "" };
  }

  // Numbers

  function showValues(values) {
    for (const [key, text] of Object.entries(values)) {
      state.values[key] = text;
      for (const node of document.querySelectorAll(`[data-live="${CSS.escape(key)}"]`)) {
        setText(node, text);
        if (key.endsWith(".age")) node.closest(".card")?.classList.toggle("old", text.startsWith("last read"));
      }
    }
    if ("last_refused" in values) place("[data-live=last]")?.classList.toggle("wrong", Boolean(values.last_refused));
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
    document.title = [head.word, state.values.bench, "gyrobench panel"].filter(Boolean).join(" · ");
    document.body.classList.toggle("without", !news.session);
    fill("log", news.log.map(([seconds, kind, text]) => line(seconds, kind, text)), "Nothing yet.");
    const own = news.alarms.map((alarm) => {
      const row = line(alarm.time_s, alarm.kind === "log" ? "alarm" : alarm.kind, alarm.text);
      row.classList.add(alarm.seen ? "seen" : "unseen");
      row.lastChild.append(element("em", "", [alarm.run, alarm.seen].filter(Boolean).join(", ")));
      return row;
    });
    fill("alarms", own, "No alarms.");
    [state.session, state.run] = [news.session, news.run];
    place("[data-unseen]").hidden = !news.alarms.some((alarm) => !alarm.seen);
    place("[data-papers]").replaceChildren(...news.papers.map(paper));
    showBenches(news.benches, news.session);
    state.phases = news.phases;
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
      if (run.outside) row.append(element("span", "why outside", `✕ Outside its limits: ${run.outside}`));
      if (run.noted) row.append(element("span", "why", `Note: ${run.noted}`));
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

  // What is shown: the newest stretch, or one that is held; of that the server has finer values.

  function series(rows, index) {
    return { t: rows.map((row) => row[0]), low: rows.map((row) => row[1 + 2 * index]), high: rows.map((row) => row[2 + 2 * index]) };
  }

  function lanes(rows) {
    const shown = [];
    let painted = 0;
    const curve = (column, index, colour, dash) => ({ id: column.key, name: column.name, colour, dash, ...series(rows, index) });
    state.columns.forEach((column, index) => {
      if (column.plot === "gyro") return void shown.push({ title: column.name, unit: "°/s", small: true, least: 1e-5, series: [curve(column, index, paintOf(shown.length))] });
      const name = column.plot === "table" ? "Table rate" : "Temperature";
      let lane = shown.find((one) => one.title === name);
      if (!lane) shown.push((lane = { title: name, unit: column.unit, least: LEAST[name], series: [] }));
      lane.series.push(column.key === "set" ? curve(column, index, "--c2", "dashed") : curve(column, index, name === "Temperature" ? paintOf(painted++) : "--c1"));
    });
    const order = (lane) => (lane.title === "Temperature" ? 0 : lane.title === "Table rate" ? 2 : 1);
    shown.sort((one, other) => order(one) - order(other));
    if (plan?.drawn) plan.add(shown, state.phases);
    return shown;
  }

  function draw() {
    const level = state.levels[state.level];
    if (!level || !chart) return;
    const whole = state.levels.run.rows;
    const last = whole.length ? Math.max(whole[whole.length - 1][0], level.rows.length ? level.rows[level.rows.length - 1][0] : 0) : 1;
    const first = level.span_s ? Math.max(0, last - level.span_s) : 0;
    const end = plan?.drawn ? Math.max(last, plan.end(state.phases)) : last;
    const [from, to] = state.held ?? [first, Math.max(level.span_s ? last : end, first + 1)];
    const fine = state.held && state.fine && state.fine.of === String(state.held) ? state.fine.rows : null;
    const rows = fine ?? (state.held ? whole : level.rows);
    const phases = state.phases.map(([name, start], index) => [name, start, state.phases[index + 1]?.[1] ?? Infinity]);
    chart.show({ lanes: lanes(rows), from, to, full: [0, Math.max(end, 1)], phases: phases.map(([name, start, end]) => [name, start, Math.min(end, Math.max(last, start + 1))]), newest: !state.held && last });
    const hold = place("[data-hold]");
    setText(hold, state.held ? "Follow the run" : "Hold the curves");
    setText(place("[data-held]"), state.held ? `Held; the run is at ${state.values.elapsed ?? clock(last)}` : "");
  }

  let waiting = false;

  function redraw() {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      draw();
    });
  }

  function hold(view) {
    state.held = view;
    redraw();
    clearTimeout(state.asking);
    if (view) state.asking = setTimeout(askFiner, 200);
  }

  async function askFiner() {
    const view = state.held;
    if (!view) return;
    const query = new URLSearchParams({ ...asked(), from_s: view[0], to_s: view[1] });
    const found = await (await fetch(`/panel/window?${query}`)).json();
    if (state.held !== view || found.epoch !== state.epoch || found.rows.length < 2) return;
    state.fine = { of: String(view), rows: found.rows };
    redraw();
  }

  function makeCurves() {
    chart = new Lanes(place("[data-lanes]"), hold);
    const button = element("button", "do quiet", "Hold the curves");
    button.type = "button";
    button.dataset.hold = "";
    button.addEventListener("click", () => hold(state.held ? null : [chart.data.from, chart.data.to]));
    const word = element("span", "held", "");
    word.dataset.held = "";
    chart.bar.prepend(button);
    chart.bar.append(word);
    plan = new Expected(chart.bar, () => state.run, redraw);
  }

  // The socket

  function take(message) {
    if (message.values) showValues(message.values);
    if (message.news) showNews(message.news);
    if (message.runs) showRuns(message.runs);
    if (message.curves) {
      const { columns, levels, capacity, epoch } = message.curves;
      if (epoch !== state.epoch) Object.assign(state, { held: null, fine: null });
      Object.assign(state, { columns, levels, capacity, epoch });
    }
    if (message.noise) window.gyrobenchNoise.show(message.noise);
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
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/panel/live?${new URLSearchParams(asked())}`);
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
    show(level) { state.level = level; hold(null); },
    repaint() { chart?.repaint(); window.gyrobenchNoise.repaint(); },
    chart: () => chart,
    held: () => state.held,
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
    showValues(state.values); // what has come before there was a place for it
    window.gyrobenchNoise.show(window.gyrobenchNoise.curves());
    makeCurves();
    redraw();
  }
  place('[data-testid="acknowledge"]').addEventListener("click", acknowledge);
  connect();
  settle();
})();
