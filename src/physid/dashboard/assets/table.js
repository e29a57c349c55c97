/* The table of all runs: sorts by any column, filters by words, kinds and comparisons such as seconds<10. */
const worst = (run) => {
  const errors = run.parameters.map((each) => each.error).filter(isNumber);
  return errors.length ? Math.max(...errors) : null;
};
const ofFigures = (run, ...names) => {
  const name = names.find((each) => isNumber(run.figures[each]));
  return name ? run.figures[name] : null;
};
/* A target is the largest value that is good enough. */
const met = (cell) => (isNumber(cell.target) && isNumber(cell.value) ? cell.value <= cell.target : null);

const COLUMNS = [
  { key: "id", title: "Run", wide: true, value: (run) => run.id, cell: nameCell },
  { key: "result", title: "Result", wide: true, value: (run) => summaryOf(run), cell: resultCell },
  { key: "error", title: "Parameter error", value: worst, cell: (run) => percent(worst(run)), right: true },
  { key: "position", title: "Position error", value: positionOf, cell: (run) => percent(positionOf(run)), right: true },
  { key: "rotation", title: "Rotation error", value: rotationOf, cell: (run) => isNumber(rotationOf(run)) ? `${figure(rotationOf(run), 2)}°` : "–", right: true },
  { key: "evaluations", title: "Evaluations", value: (run) => ofFigures(run, "evaluations"), cell: (run) => figure(ofFigures(run, "evaluations"), 3), right: true },
  { key: "seconds", title: "Time", value: (run) => ofFigures(run, "seconds"), cell: (run) => duration(ofFigures(run, "seconds")), right: true },
  { key: "date", title: "Date", value: (run) => run.date, cell: (run) => h("span", { class: "soft small" }, moment(run.date)), right: true },
];

function positionOf(run) { return ofFigures(run, "test/position_error", "val/position_error"); }
function rotationOf(run) { return ofFigures(run, "test/rotation_error", "val/rotation_error"); }

function nameCell(run) {
  const about = [run.method, run.data].filter(Boolean).join(" · ");
  return [
    h("a", { class: "name", href: linkTo(run) }, breakable(run.id)),
    h("div", { class: "about" },
      badge(run.kind, "plain"),
      about && h("span", { class: "soft small" }, about),
      run.state !== "finished" && badge(run.state, "warn"),
      run.notes.length > 0 && badge(plural(run.notes.length, "note"), "warn")),
  ];
}

function summaryOf(run) {
  if (run.diagnosis) return verdictOf(run.diagnosis).short;
  if (run.identifiability) return Object.entries(run.identifiability.verdicts || {}).map(([name, each]) => `${name} ${each.kind}`).join(" ");
  if (run.score) return run.score.figures.map((each) => each.name).join(" ");
  if (run.cells.length) return `${run.cells.filter((cell) => met(cell)).length}`;
  return run.parameters.map((each) => each.name).join(" ");
}

function resultCell(run) {
  if (run.diagnosis) {
    const verdict = verdictOf(run.diagnosis);
    return h("div", { class: "result" }, h("div", {}, badge(run.diagnosis.verdict || "?", verdict.kind), verdict.short));
  }
  if (run.identifiability) {
    return h("div", { class: "result" }, Object.entries(run.identifiability.verdicts || {}).map(([name, each]) =>
      h("div", {}, h("span", { class: "soft small" }, name), observedBadge(each))));
  }
  const lines = run.parameters.map((each) => h("div", {},
    h("span", { class: "soft small" }, each.name),
    h("span", { class: "number" }, `${figure(each.estimate)} ${each.unit}`.trim()),
    isNumber(each.error) && badge(percent(each.error), grade(each.error))));
  const judged = run.score ? judgedFigures(run) : run.cells.map(met).filter((each) => each !== null);
  const good = judged.filter(Boolean).length;
  if (judged.length) lines.push(h("div", {}, badge(`${good} of ${judged.length} targets met`, good === judged.length ? "good" : "warn")));
  else if (run.cells.length && !lines.length) lines.push(plural(run.cells.length, "figure"));
  if (!lines.length) return h("span", { class: "soft" }, "–");
  return h("div", { class: `result ${run.parameters.length > 2 ? "many" : ""}` }, lines);
}

const COMPARISON = /^([\w./-]+)(<=|>=|<|>|=)(-?[\d.]+(?:e-?\d+)?)(%?)$/i;

function quantity(run, name) {
  const column = COLUMNS.find((each) => each.key === name);
  if (column && isNumber(column.value(run))) return column.value(run);
  for (const each of run.parameters) if (each.name === name || each.name.endsWith(`.${name}`)) return each.estimate;
  const key = Object.keys(run.figures).find((each) => each === name || each.endsWith(`/${name}`));
  return key ? run.figures[key] : null;
}

function holds(run, word) {
  const comparison = COMPARISON.exec(word);
  if (comparison) {
    const [, name, sign, text, hundred] = comparison;
    const value = quantity(run, name);
    const limit = Number(text) / (hundred ? 100 : 1);
    if (!isNumber(value)) return false;
    return { "<": value < limit, ">": value > limit, "<=": value <= limit, ">=": value >= limit, "=": value === limit }[sign];
  }
  const text = [run.id, run.kind, run.state, run.method, run.data, run.config, summaryOf(run), ...run.parameters.map((each) => each.name)];
  return text.join(" ").toLowerCase().includes(word.toLowerCase());
}

const filtered = (runs, query, kind) =>
  runs.filter((run) => (!kind || run.kind === kind) && query.split(/\s+/).filter(Boolean).every((word) => holds(run, word)));

/* Runs without a value come last, whichever way the column is sorted. */
function sorted(runs, key, descending) {
  const value = COLUMNS.find((column) => column.key === key).value;
  const empty = (each) => each === null || each === undefined || each === "";
  return [...runs].sort((a, b) => {
    const [one, two] = [value(a), value(b)];
    if (empty(one) || empty(two)) return empty(one) - empty(two);
    const order = isNumber(one) ? one - two : String(one).localeCompare(String(two), "en", { numeric: true });
    return descending ? -order : order;
  });
}

function runTable(runs, state, choose, sortBy) {
  const head = COLUMNS.map((column) => h("th", {
    class: `sortable ${column.right ? "right" : ""}`, scope: "col",
    "aria-sort": state.key === column.key ? (state.descending ? "descending" : "ascending") : "none",
    onclick: () => sortBy(column.key),
  }, h("button", {}, column.title)));
  const body = runs.map((run) => h("tr", { onclick: (event) => { if (!event.target.closest("a, input, label")) location.hash = linkTo(run); } },
    h("td", { class: "choose" }, h("input", {
      type: "checkbox", "aria-label": `choose ${run.id}`, checked: state.chosen.has(run.id), onchange: (event) => choose(run, event.target.checked),
    })),
    COLUMNS.map((column) => {
      const content = column.cell(run);
      return h("td", { class: `${column.right ? "right number" : ""} ${column.wide ? "wide" : ""} ${content === "–" ? "none" : ""}`, "data-label": column.wide ? null : column.title }, content);
    })));
  return h("div", { class: "card scroll runs" }, h("table", {},
    h("thead", {}, h("tr", {}, h("th", { class: "choose" }, h("span", { hidden: true }, "choose")), head)), h("tbody", {}, body)));
}
