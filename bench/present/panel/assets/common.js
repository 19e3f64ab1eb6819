// What every page has: the strip of benches, links, the operator's name. Everything from a run is set as text, never
// as markup.
window.gyrobenchPage = (() => {
  "use strict";
  document.documentElement.lang = "en";
  const place = (selector) => document.querySelector(selector);

  function setText(node, text) {
    if (node.textContent !== text) node.textContent = text;
  }

  function element(name, className, text) {
    const node = document.createElement(name);
    if (className) node.className = className;
    if (text !== undefined) node.textContent = text;
    return node;
  }

  function paper([what, address]) {
    const link = element("a", "paper", what);
    link.href = address;
    link.target = "_blank";
    return link;
  }

  function showBenches(benches, session) {
    const nav = place("[data-benches]");
    nav.replaceChildren(
      ...benches.map((bench) => {
        const link = element("a", `bench ${bench.tone}${bench.emulated ? " emulated" : ""}`);
        link.href = bench.link;
        if (session && bench.session === session) link.setAttribute("aria-current", "page");
        link.append(element("b", "", bench.name), element("span", "state", bench.word), ...[bench.what, bench.queue].filter(Boolean).map((text) => element("span", "what", text)));
        if (bench.emulated) link.append(element("span", "mark", "emulated"));
        if (bench.alarms) link.append(element("span", "count", bench.alarms === 1 ? "1 alarm not seen" : `${bench.alarms} alarms not seen`));
        return link;
      }),
    );
  }

  // The operator's name is kept in this browser, for all pages.
  function recallName(field) {
    if (field.readOnly) return; // signed in
    field.value = field.value || localStorage.getItem("gyrobench-name") || "";
    field.addEventListener("input", () => localStorage.setItem("gyrobench-name", field.value));
  }

  return { element, paper, place, recallName, setText, showBenches };
})();
