/* The page: which view the address asks for, and what the viewer has chosen. */
const DATA = JSON.parse(document.getElementById("data").textContent);
const RUNS = DATA.runs;
const APP = document.getElementById("app");
const STATE = { query: "", kind: "", key: "date", descending: true, chosen: new Set() };

const linkTo = (run) => `#/run/${encodeURIComponent(run.id)}`;
const find = (id) => RUNS.find((run) => run.id === id);

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  dispatchEvent(new Event("theme"));
}

function themeButton() {
  return h("button", {
    "aria-label": "light or dark", title: "light or dark",
    onclick: () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"),
  }, "◐");
}

function listPage() {
  const kinds = [...new Set(RUNS.map((run) => run.kind))].sort();
  const counts = kinds.map((kind) => plural(RUNS.filter((run) => run.kind === kind).length, kind).replace("diagnosises", "diagnoses"));
  const place = h("div", {});
  const tray = h("div", {});
  const choose = (run, chosen) => {
    if (chosen) STATE.chosen.add(run.id);
    else STATE.chosen.delete(run.id);
    refreshTray();
  };
  const sortBy = (key) => {
    STATE.descending = STATE.key === key ? !STATE.descending : false;
    STATE.key = key;
    refresh();
  };
  const search = h("input", {
    type: "search", value: STATE.query, placeholder: "Filter: words, or error<1%  seconds<10", "aria-label": "filter runs",
    oninput: (event) => { STATE.query = event.target.value; refresh(); },
  });
  const chips = kinds.length > 1 && kinds.map((kind) => h("button", {
    "aria-pressed": String(STATE.kind === kind), "data-kind": kind,
    onclick: () => { STATE.kind = STATE.kind === kind ? "" : kind; refresh(); },
  }, kind, h("span", { class: "soft" }, ` ${RUNS.filter((run) => run.kind === kind).length}`)));

  function refresh() {
    const shown = sorted(filtered(RUNS, STATE.query, STATE.kind), STATE.key, STATE.descending);
    for (const chip of chips || []) chip.setAttribute("aria-pressed", String(STATE.kind === chip.dataset.kind));
    place.replaceChildren(shown.length ? runTable(shown, STATE, choose, sortBy) : h("div", { class: "card empty" }, "No run matches."));
    refreshTray();
  }
  function refreshTray() {
    const count = STATE.chosen.size;
    tray.replaceChildren(...(count === 0 ? [] : [h("div", { class: "tray" }, h("div", {},
      h("span", {}, `${plural(count, "run")} chosen`),
      h("span", { style: "display: flex; gap: 8px" },
        h("button", { onclick: () => { STATE.chosen.clear(); refresh(); } }, "Clear"),
        h("button", {
          class: "primary", disabled: count < 2,
          onclick: () => { location.hash = `#/compare/${[...STATE.chosen].map(encodeURIComponent).join(",")}`; },
        }, "Compare"))))]));
  }
  refresh();
  return h("div", {},
    h("div", { class: "head" },
      h("div", { class: "titles" }, h("h1", {}, DATA.title), h("p", { class: "soft" }, `${counts.join(", ")} · written ${moment(DATA.made)}`)),
      themeButton()),
    h("div", { class: "tools" }, search, chips), place, tray);
}

function show() {
  const [, view, rest] = /^#\/(run|compare)\/(.*)$/.exec(location.hash) || [];
  const runs = (rest || "").split(",").map(decodeURIComponent).map(find).filter(Boolean);
  const page = view === "run" && runs.length ? runPage(runs[0]) : view === "compare" && runs.length ? comparePage(runs) : listPage();
  APP.replaceChildren(page);
  window.scrollTo(0, 0);
  document.title = `${view === "run" && runs.length ? runs[0].id : DATA.title} · physid`;
}

setTheme(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
window.addEventListener("hashchange", show);
show();
