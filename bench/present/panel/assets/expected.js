// The plan's curve beside the measured one: the run's own procedure and parameters, rehearsed on an emulated bench.
window.gyrobenchExpected = (() => {
  "use strict";
  const { element, setText } = window.gyrobenchPage;
  const LANES = { air: ["Temperature", "Air"], table: ["Table rate", "Table rate"] };

  // Every phase of the plan begins where the run's phase of that name began; what is still to come follows the last one.
  function placed(plan, phases) {
    const seen = {};
    const begun = new Map();
    for (const [name, start] of phases) {
      seen[name] = (seen[name] ?? 0) + 1;
      begun.set(`${name} ${seen[name]}`, start);
    }
    const count = {};
    return plan.phases.filter(([name]) => {
      count[name] = (count[name] ?? 0) + 1;
      return begun.has(`${name} ${count[name]}`);
    }).map(([name, start], index, kept) => {
      const number = kept.slice(0, index + 1).filter(([other]) => other === name).length;
      return { start, shift: begun.get(`${name} ${number}`) - start };
    });
  }

  function moved(curve, parts) {
    const found = { t: [], low: [], high: [] };
    let part = -1;
    curve.t.forEach((time, at) => {
      let now = part;
      while (now + 1 < parts.length && parts[now + 1].start <= time) now += 1;
      const next = parts[now + 1];
      const shifted = time + (parts[now]?.shift ?? parts[0]?.shift ?? 0);
      if (now !== part && found.t.length) {
        found.t.push(shifted);
        found.low.push(null);
        found.high.push(null);
      }
      part = now;
      if (next && shifted >= next.start + next.shift) return;
      found.t.push(shifted);
      found.low.push(curve.low[at]);
      found.high.push(curve.high[at]);
    });
    return found;
  }

  class Expected {
    // `run()`: the name of the run that is shown; `changed()` is called when there is something else to draw.
    constructor(bar, run, changed) {
      [this.run, this.changed, this.plan, this.of, this.shown] = [run, changed, null, "", false];
      this.button = element("button", "do quiet", "Show the plan");
      this.button.type = "button";
      this.button.addEventListener("click", () => this.press());
      this.said = element("span", "held", "");
      this.said.setAttribute("role", "status");
      bar.append(this.button, this.said);
    }

    async press() {
      this.shown = !this.shown;
      const run = this.run();
      if (this.shown && this.of !== run) {
        this.plan = null;
        this.button.disabled = true;
        setText(this.said, "Rehearsing the run on an emulated bench…");
        try {
          const found = await (await fetch(`/panel/expected?${new URLSearchParams({ run })}`)).json();
          [this.plan, this.of] = found.curves ? [found, run] : [null, ""];
          setText(this.said, found.problem ?? "");
        } catch {
          setText(this.said, "The panel does not answer.");
        }
        this.button.disabled = false;
        this.shown = Boolean(this.plan);
      }
      setText(this.button, this.shown ? "Hide the plan" : "Show the plan");
      this.changed();
    }

    get drawn() { return this.shown && this.plan && this.of === this.run(); }

    // The time at which the plan ends on the run's clock.
    end(phases) {
      const parts = placed(this.plan, phases);
      return this.plan.end_s + (parts[parts.length - 1]?.shift ?? 0);
    }

    // Adds dashed curves to lanes of the run; `shift`: what the lanes' times are less than the run's.
    add(lanes, phases, shift = 0) {
      const parts = placed(this.plan, phases);
      for (const curve of this.plan.curves) {
        const lane = lanes.find((one) => LANES[curve.key]?.includes(one.title));
        if (!lane) continue;
        const { t, low, high } = moved(curve, parts);
        lane.series.push({ id: `plan ${curve.key}`, name: `${curve.name}, planned`, colour: "--ink", dash: "dotted", t: t.map((time) => time - shift), low, high });
      }
    }
  }

  return { Expected };
})();
