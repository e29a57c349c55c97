"use strict";
/* The table of runs is sorted and filtered here, runs are opened and compared; what they show is in the page already. */
(() => {
const DATA = JSON.parse(document.getElementById("data").textContent);
const $ = (query, root = document) => root.querySelector(query);
const all = (query, root = document) => [...root.querySelectorAll(query)];
const STILL = matchMedia("(prefers-reduced-motion: reduce)").matches;
const COMPARISON = /^([\w./-]+)(<=|>=|<|>|=)(-?[\d.]+(?:e-?\d+)?)(%?)$/i;
const chosen = new Set();
let sort = { key: "date", descending: true }, kind = "";

function number(run, name) {
  const key = [name, ...Object.keys(run.numbers)].find((each, index) =>
    index ? each.endsWith(`.${name}`) || each.endsWith(`/${name}`) : each in run.numbers);
  return key === undefined ? null : run.numbers[key];
}

function holds(run, word) {
  const found = COMPARISON.exec(word);
  if (!found) return run.text.includes(word.toLowerCase());
  const value = number(run, found[1]), limit = Number(found[3]) / (found[4] ? 100 : 1);
  if (value === null) return false;
  return { "<": value < limit, ">": value > limit, "<=": value <= limit, ">=": value >= limit, "=": value === limit }[found[2]];
}

function refresh() {
  const query = $("input[type=search]").value.split(/\s+/).filter(Boolean);
  const body = $(".runs tbody"), rows = all("tr", body);
  const value = (row) => { const run = DATA[row.dataset.index]; return run[sort.key] ?? run.numbers[sort.key] ?? ""; };
  rows.sort((a, b) => {
    const [one, two] = [value(a), value(b)];
    if (one === "" || two === "") return (one === "") - (two === "");
    const order = typeof one === "number" ? one - two : String(one).localeCompare(String(two), "en", { numeric: true });
    return sort.descending ? -order : order;
  });
  body.append(...rows);
  for (const row of rows) {
    const run = DATA[row.dataset.index];
    row.hidden = (kind && run.kind !== kind) || !query.every((word) => holds(run, word));
    $("input", row).checked = chosen.has(Number(row.dataset.index));
  }
  $(".empty").hidden = rows.some((row) => !row.hidden);
  for (const head of all("th.sortable")) {
    head.setAttribute("aria-sort", head.dataset.key !== sort.key ? "none" : sort.descending ? "descending" : "ascending");
  }
  for (const button of all("[data-kind]")) button.setAttribute("aria-pressed", String(button.dataset.kind === kind));
  $(".tray").hidden = !chosen.size;
  $(".tray span").textContent = `${chosen.size} run${chosen.size === 1 ? "" : "s"} chosen`;
  $(".tray .primary").disabled = chosen.size < 2;
}

function compare(runs) {
  $("#compare .count").textContent = `${runs.length} run${runs.length === 1 ? "" : "s"}`;
  runs.forEach((run, index) => document.documentElement.style.setProperty(`--run${run}`, `var(--s${index % 8})`));
  for (const each of all("#compare [data-run]")) each.hidden = !runs.includes(Number(each.dataset.run));
  for (const part of all("#compare .compared")) {
    for (const row of all("tbody tr", part)) {
      const cells = all("[data-run]:not([hidden]):not([data-empty])", row);
      const same = new Set(cells.map((cell) => cell.textContent)).size < 2;
      row.hidden = cells.length < Number(part.dataset.least) || ("differ" in part.dataset && same);
      const values = cells.map((cell) => Number(cell.dataset.value));
      const best = row.dataset.sign === "1" ? Math.max(...values) : Math.min(...values);
      const tell = row.dataset.sign !== "0" && !same;
      cells.forEach((cell, index) => cell.classList.toggle("best", tell && values[index] === best));
    }
    part.hidden = all("tbody tr:not([hidden])", part).length === 0;
  }
  for (const part of all("#compare .films")) part.hidden = all("[data-run]:not([hidden])", part).length === 0;
  for (const part of all("#compare .overlaid")) {
    for (const figure of all("figure", part)) {
      const lines = all(".line", figure);
      for (const line of lines) line.style.display = runs.some((run) => line.classList.contains(`r${run}`)) ? "" : "none";
      figure.hidden = lines.every((line) => line.style.display);
    }
    part.hidden = all("figure:not([hidden])", part).length === 0;
  }
}

function show() {
  const [, view, rest] = /^#\/(run|compare)\/(.*)$/.exec(location.hash) || [];
  const runs = (rest || "").split(",").map(decodeURIComponent).map((id) => DATA.findIndex((run) => run.id === id)).filter((index) => index >= 0);
  const opened = view === "run" && runs.length ? runs[0] : -1;
  const compared = view === "compare" && runs.length > 0 && $("#compare");
  $("#list").hidden = opened >= 0 || compared;
  for (const run of all(".run")) run.hidden = Number(run.dataset.index) !== opened;
  if ($("#compare")) $("#compare").hidden = !compared;
  if (compared) compare(runs);
  for (const film of all("video")) {
    if (film.offsetParent && !STILL) film.play().catch(() => {});
    else film.pause();
  }
  window.scrollTo(0, 0);
  document.title = `${opened >= 0 ? DATA[opened].id : $("#list h1").textContent} · physid`;
}

document.addEventListener("click", (event) => {
  const on = (query) => event.target.closest(query);
  if (on(".theme")) {
    const style = document.documentElement.style;
    const dark = style.colorScheme ? style.colorScheme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
    style.colorScheme = dark ? "light" : "dark";
    for (const frame of all("iframe")) { // a report follows the system's colours; in this page it shall follow the page's
      frame.srcdoc = frame.srcdoc.replace(/color-scheme: (light dark|light|dark);/, `color-scheme: ${style.colorScheme};`);
    }
  } else if (on("th.sortable")) {
    const key = on("th.sortable").dataset.key;
    sort = { key, descending: sort.key === key && !sort.descending };
  } else if (on("[data-kind]")) kind = kind === on("[data-kind]").dataset.kind ? "" : on("[data-kind]").dataset.kind;
  else if (on(".clear")) chosen.clear();
  else if (on(".tray .primary")) location.hash = `#/compare/${[...chosen].map((index) => encodeURIComponent(DATA[index].id)).join(",")}`;
  else if (on(".runs .choose input")) {
    const index = Number(on("tr").dataset.index);
    if (event.target.checked) chosen.add(index); else chosen.delete(index);
  } else if (on(".runs tbody tr") && !on("a")) location.hash = $("a", on("tr")).getAttribute("href");
  else return;
  refresh();
});
$("input[type=search]").addEventListener("input", refresh);
addEventListener("hashchange", show);
refresh();
show();
})();
