// The queue's page: shows what goes on and what waits, sends what the operator asks for, plans what is in the form.
(() => {
  "use strict";
  const { element, place, recallName, setText } = window.gyrobenchPage;
  const queue = document.body.dataset.queue;
  const form = place("[data-run]");
  const campaign = place("[data-campaign] select");
  const hunt = place("[data-hunt]");
  const field = place("#name");
  let view = {};
  let shown = "";
  let plan = null;
  let asking = 0;

  // Talking to the panel

  function say(text) {
    const said = place("[data-said]");
    setText(said, text);
    said.hidden = !text;
    if (text) said.scrollIntoView({ block: "nearest" });
  }

  async function send(what, body) {
    const answer = await fetch(`/panel/queue/${queue}/${what}`, {
      method: "POST",
      headers: { "content-type": "application/json" },
      body: JSON.stringify(body),
    });
    const found = await answer.json();
    return answer.ok ? found : Promise.reject(found);
  }

  // A press of a button: needs a name, says what was refused and why.
  async function ask(action, more) {
    const by = field.value.trim();
    if (!by) {
      say("Type your name at the top of the page first: it stands beside what you start.");
      field.focus();
      return false;
    }
    try {
      show(await send("change", { action, by, ...more }));
      say("");
      return true;
    } catch (wrong) {
      if (wrong.mistakes) showMistakes(wrong.mistakes);
      say(wrong.error || (wrong.mistakes ? "There are mistakes in the form." : "The panel does not answer."));
      return false;
    }
  }

  async function look() {
    try {
      const answer = await fetch(`/panel/queue/${queue}`);
      if (answer.status === 401) return void location.reload();
      show(await answer.json());
      document.body.classList.remove("cut-off");
    } catch {
      document.body.classList.add("cut-off");
    }
    setTimeout(look, document.hidden ? 5000 : 1000);
  }

  // What goes on, what waits

  const clock = (utc) => {
    const time = new Date(utc);
    const day = time.toDateString() === new Date().toDateString() ? "" : `${time.toLocaleDateString("en-GB", { weekday: "short", day: "numeric", month: "short" })} `;
    return day + time.toLocaleTimeString("en-GB", { hour: "2-digit", minute: "2-digit" });
  };

  function button(text, act, about, style = "quiet") {
    const node = element("button", `do ${style}`, text);
    node.type = "button";
    if (about) node.setAttribute("aria-label", about);
    node.addEventListener("click", act);
    return node;
  }

  function link(text, address, style = "") {
    const node = element("a", style, text);
    node.href = address;
    return node;
  }

  function title(item) {
    const head = element("p", "item-title");
    head.append(element("b", "", item.title), element("span", "by", `by ${item.by}`));
    const detail = element("p", "detail", item.detail);
    detail.title = item.command;
    const both = element("div", "about");
    both.append(head, detail);
    return both;
  }

  function current(item) {
    const box = element("div", "now");
    const line = element("p", "state-line");
    line.append(element("b", "word", item.word), element("span", "", `started ${clock(item.started)} by ${item.by}`));
    if (item.link) line.append(link("Watch it, answer, pause or abort", item.link, "go"));
    box.append(title(item), line);
    return box;
  }

  function waiting(item, index, count, busy) {
    const row = element("li");
    const when = item.not_before ? `not before ${clock(item.not_before)}, ` : "";
    const about = title(item);
    about.append(element("p", "when", `${when}about ${clock(item.begin)} to ${clock(item.end)}, ${item.length}`));
    const buttons = element("div", "buttons");
    const move = (place_) => () => ask("move", { item: item.id, place: place_ });
    const up = button("↑", move(index - 1), `Move ${item.title} up`);
    const down = button("↓", move(index + 1), `Move ${item.title} down`);
    up.disabled = index === 0;
    down.disabled = index === count - 1;
    const start_ = button("Start now", () => sure(item), `Start ${item.title} now`);
    start_.disabled = busy;
    buttons.append(
      up, down,
      ...(item.edit ? [link("Change", item.edit, "do quiet")] : []),
      button("Take out", () => ask("remove", { item: item.id }), `Take ${item.title} out of the queue`),
      start_,
    );
    row.append(element("span", "number", String(index + 1)), about, buttons);
    return row;
  }

  function ended(item) {
    const row = element("li");
    const line = element("p", "state-line");
    line.append(element("b", `outcome ${item.outcome}`, item.said));
    if (item.reason) line.append(element("span", "", item.reason));
    if (item.report) line.append(link("Report", item.report, "go"));
    if (item.again) line.append(link("Repeat", item.again, "go"));
    row.append(title(item), line);
    return row;
  }

  function show(found) {
    const text = JSON.stringify(found);
    if (text === shown) return;
    shown = text;
    if (!found.bench) return void say(found.problem);
    if (found.problem || view.problem) say(found.problem);
    const held = place("[data-held]");
    const used = found.used ? ` The bench is in use: ${found.used}.` : "";
    setText(held, (found.held || (found.waiting.length ? "The queue goes: what is due starts by itself." : "")) + used);
    held.classList.toggle("is-held", Boolean(found.held));
    setText(place("[data-hold]"), found.held ? "Start the queue" : "Hold the queue");
    place("[data-current]").replaceChildren(...(found.current ? [current(found.current)] : []));
    const rows = found.waiting.map((item, index) => waiting(item, index, found.waiting.length, Boolean(found.current)));
    const nothing = element("li", "none", found.current ? "Nothing waits behind it." : "Nothing waits. Choose a procedure or a campaign below.");
    place("[data-waiting]").replaceChildren(...(rows.length ? rows : [nothing]));
    place("[data-ended]").replaceChildren(...found.ended.map(ended));
    const box = place("[data-ended-box]");
    box.hidden = !found.ended.length;
    if (found.look && !view.look) box.open = true;
    view = found;
  }

  // The form and its plan

  function order() {
    if (campaign?.value) return { campaign: campaign.value };
    if (hunt?.elements.model.value) return Object.fromEntries(new FormData(hunt));
    if (!form) return null;
    return { procedure: form.dataset.procedure, typed: Object.fromEntries(new FormData(form)) };
  }

  function showMistakes(mistakes) {
    for (const box of document.querySelectorAll("[data-field]")) {
      const text = mistakes[box.dataset.field] || "";
      setText(box.querySelector("[data-wrong]"), text);
      box.classList.toggle("is-wrong", Boolean(text));
      box.querySelector("input, select").setAttribute("aria-invalid", text ? "true" : "false");
    }
  }

  const size = (bytes) => (bytes < 1e6 ? `${(bytes / 1e3).toFixed(0)} kB` : bytes < 1e9 ? `${(bytes / 1e6).toFixed(1)} MB` : `${(bytes / 1e9).toFixed(1)} GB`);

  function planned(found, rehearsed) {
    const box = element("div");
    const facts = element("dl", "facts");
    const fact = (name, text) => {
      const row = element("div");
      row.append(element("dt", "", name), element("dd", "", text));
      facts.append(row);
    };
    const end = new Date(Date.now() + 1000 * found.duration_s);
    fact("Takes", `${rehearsed || !found.chamber ? "" : "about "}${found.length}, until ${clock(end)} if it began now`);
    if (found.chamber) fact("Chamber", found.chamber);
    if (found.bytes) fact("On disk", `${rehearsed ? "" : "about "}${size(found.bytes)}${found.free ? ` of ${size(found.free)} free` : ""}`);
    for (const [name, value, limit, unit] of found.extremes || []) fact(name, `${value} ${unit} (this bench allows ${limit})`);
    box.append(facts);
    if (found.fits === false) box.append(element("p", "wrong", "It does not fit on the disk."));
    for (const warning of found.warnings || []) box.append(element("p", "wrong", warning));
    if (found.questions) {
      box.append(element("h3", "", found.questions.length ? `Asks ${found.asked === 1 ? "one question" : `${found.asked} times`}` : "Asks nothing"));
      const list = element("ul");
      list.append(...found.questions.map((text) => element("li", "", text)));
      box.append(list, element("h3", "", "Steps"));
      const steps = element("ol", "steps");
      for (const [at, length, text] of found.steps) {
        const row = element("li");
        row.append(element("time", "", at), element("span", "", text), element("span", "length", length));
        steps.append(row);
      }
      box.append(steps);
    } else if (hunt?.elements.model.value && !campaign?.value) {
      box.append(element("p", "hint", "Each run is chosen from what the runs before it tell, within this bench's limits. It asks as every run does."));
    } else {
      box.append(element("p", "hint", "By the procedure's own estimate. A rehearsal on an emulated lab also tells the steps and what will be asked."));
    }
    return box;
  }

  function showPlan(node, ready) {
    place("[data-plan-body]").replaceChildren(node);
    place("[data-plan-do]").hidden = !order();
    for (const name of ["add", "start_now", "rehearse"]) {
      const press = place(`[data-do="${name}"]`);
      if (press) press.disabled = !ready;
    }
    place('[data-do="rehearse"]').hidden = Boolean(order()?.model);
  }

  async function estimate() {
    const asked = order();
    const number = ++asking;
    plan = null;
    if (!asked) return;
    try {
      const found = await send("plan", asked);
      if (number !== asking) return;
      showMistakes({});
      plan = planned(found, false);
      showPlan(plan, found.fits);
    } catch (wrong) {
      if (number !== asking) return;
      showMistakes(wrong.mistakes || {});
      showPlan(element("p", "wrong", wrong.error || (wrong.mistakes ? "Mend what is marked in the form." : "The panel does not answer.")), false);
    }
  }

  async function rehearse() {
    const number = ++asking;
    const press = place('[data-do="rehearse"]');
    press.disabled = true;
    setText(press, "Rehearsing on an emulated lab…");
    try {
      const found = await send("rehearse", order());
      if (number === asking) showPlan((plan = planned(found, true)), true);
    } catch (wrong) {
      if (number === asking) showPlan(element("p", "wrong", wrong.error || "The rehearsal failed."), false);
    }
    setText(press, "Rehearse it: steps and questions");
    press.disabled = false;
  }

  // Starting asks once, with the plan

  let starting = null;

  // What is chosen, in a word.
  function what() {
    const chosen = campaign?.value ? campaign : hunt?.elements.model.value ? hunt.elements.model : null;
    if (!chosen) return form.dataset.procedure;
    return (chosen === campaign ? "the campaign " : "a search from ") + chosen.selectedOptions[0].textContent.replace(/^[^:]*: /, "");
  }

  function sure(item) {
    starting = item;
    setText(place("#sure-head"), `Start ${item?.title ?? what()} on ${view.bench}?`);
    const body = place("[data-sure-body]");
    const text = item ? `${item.title}, ${item.detail}: ${item.length}.` : "";
    body.replaceChildren(...(item ? [element("p", "", text)] : plan ? [plan.cloneNode(true)] : []));
    body.append(element("p", "warn", document.body.classList.contains("emulated") ? "The lab is emulated: nothing real moves." : "Table and chamber will move. Is the bench ready, the unit mounted, nobody near the table?"));
    place("[data-sure]").showModal();
    place("[data-sure-body]").scrollTo(0, 0);
  }

  async function start() {
    place("[data-sure]").close();
    const done = starting ? await ask("start", { item: starting.id }) : await ask("start_now", order());
    if (done) window.scrollTo({ top: 0 });
  }

  async function add() {
    const at = place('[data-testid="not-before"]').value;
    const not_before = at ? new Date(at).toISOString() : null;
    const edit = form?.dataset.edit;
    if (await ask(edit ? "edit" : "add", { ...order(), not_before, ...(edit ? { item: edit } : {}) })) {
      if (edit) location.href = `/queue/${queue}`;
      else window.scrollTo({ top: 0 });
    }
  }

  // One thing at a time: what is typed or chosen last.
  function choose(last) {
    for (const other of [campaign, hunt?.elements.model]) if (other && other !== last) other.value = "";
  }

  let pause = 0;
  form?.addEventListener("input", () => {
    choose(null);
    clearTimeout(pause);
    pause = setTimeout(estimate, 250);
  });
  form?.addEventListener("submit", (event) => event.preventDefault());
  campaign?.addEventListener("change", () => {
    choose(campaign);
    estimate();
  });
  hunt?.addEventListener("input", () => {
    choose(hunt.elements.model);
    clearTimeout(pause);
    pause = setTimeout(estimate, 250);
  });
  hunt?.addEventListener("submit", (event) => event.preventDefault());
  const choice = place("[data-submit]");
  choice.addEventListener("change", () => choice.form.submit());
  if (choice.value && choice.value !== form?.dataset.procedure) choice.form.submit(); // chosen before this script ran
  place('[data-do="rehearse"]').addEventListener("click", rehearse);
  place('[data-do="add"]').addEventListener("click", add);
  place('[data-do="start_now"]')?.addEventListener("click", () => sure(null));
  place("[data-yes]").addEventListener("click", start);
  place("[data-no]").addEventListener("click", () => place("[data-sure]").close());
  place("[data-hold]").addEventListener("click", () => ask(view.held ? "let_go" : "hold"));
  place("[data-save]")?.addEventListener("submit", async (event) => {
    event.preventDefault();
    const preset = event.target.elements.preset.value;
    if (await ask("save_preset", { ...order(), preset })) location.href = `?procedure=${encodeURIComponent(form.dataset.procedure)}&preset=${encodeURIComponent(preset.trim())}`;
  });
  for (const node of document.querySelectorAll("[data-forget]")) {
    node.addEventListener("click", async () => {
      if (await ask("remove_preset", { procedure: form.dataset.procedure, preset: node.dataset.forget })) location.reload();
    });
    node.disabled = false;
  }
  for (const node of document.querySelectorAll("[data-resume]")) {
    node.addEventListener("click", async () => {
      if (await ask("add", { resume: node.dataset.resume })) location.reload();
    });
    node.disabled = false;
  }
  recallName(field);
  look();
  estimate();
})();
