/* Chosen runs side by side: diagnoses, parameters, curves, figures, films, and where their configurations differ. */
const color = (index) => `--s${index % 8}`;

function comparePage(runs) {
  const legend = runs.map((run, index) => h("span", {}, h("i", { style: `border-color: var(${color(index)})` }), h("a", { href: linkTo(run) }, run.id)));
  return h("div", {},
    h("div", { class: "head" },
      h("div", { class: "titles" }, h("a", { href: "#/" }, "← all runs"), h("h1", {}, `Comparison of ${plural(runs.length, "run")}`),
        h("div", { class: "legend" }, legend)),
      themeButton()),
    comparedDiagnoses(runs),
    comparedParameters(runs),
    comparedFigures(runs),
    comparedCells(runs),
    comparedCurves(runs),
    comparedFilms(runs),
    comparedSettings(runs));
}

const headOf = (run, index) => [h("i", { class: "swatch", style: `background: var(${color(index)})` }), run.id];

/* What each diagnosis says, line by line. */
function comparedDiagnoses(runs) {
  if (!runs.some((run) => run.diagnosis)) return null;
  const closed = (key) => (diagnosis) => percent(diagnosis.shrink?.[key]?.value);
  const size = (key) => ({ gap }) => (gap?.[key] ? `${measure(gap[key].before, gap.unit)} → ${measure(gap[key].after, gap.unit)}` : "–");
  const rows = [
    ["Verdict", (diagnosis) => badge(diagnosis.verdict, verdictOf(diagnosis).kind)],
    ["Confidence", (diagnosis) => percent(diagnosis.confidence)],
    ["Effects", (diagnosis) => (diagnosis.effects || []).flatMap((effect) => Object.entries(effect.parameters || {}).map(([name, value]) =>
      h("div", {}, `${words(effect.name)}, ${name}: ${interval(value)}`)))],
    ["Not told apart", (diagnosis) => ((diagnosis.group || []).length > 1 ? diagnosis.group.map(words).join(", ") : "–")],
    ["Site", ({ where }) => Object.entries(where?.site || {}).filter(([, share]) => share >= 0.1).sort((a, b) => b[1] - a[1]).map(([name, share]) => `${name} ${percent(share)}`).join(", ") || "–"],
    ["Error, same protocol", size("same")],
    ["Closed, same protocol", closed("same")],
    ["Error, transfer", size("transfer")],
    ["Closed, transfer", closed("transfer")],
  ];
  const columns = [
    { title: "Diagnosis", cell: ([title]) => title },
    ...runs.map((run, index) => ({ title: headOf(run, index), cell: ([, show]) => (run.diagnosis ? show(run.diagnosis) : "–") })),
  ];
  return section("Diagnoses", table(columns, rows));
}

/* Figures that several reproductions have, beside the paper's. */
function comparedCells(runs) {
  const name = (cell) => `${cell.cell}: ${cell.metric}`;
  const mine = (run, key) => run.cells.find((cell) => name(cell) === key);
  const names = [...new Set(runs.flatMap((run) => run.cells.map(name)))].filter((key) => runs.filter((run) => mine(run, key)).length > 1);
  if (!names.length) return null;
  const any = (key) => runs.map((run) => mine(run, key)).find(Boolean);
  const columns = [
    { title: "Result", cell: breakable },
    ...runs.map((run, index) => ({
      title: headOf(run, index), right: true,
      cell: (key) => {
        const cell = mine(run, key);
        return cell ? h("span", { class: met(cell) === false ? "missed" : "" }, measure(cell.value, cell.unit, 4)) : "–";
      },
    })),
    { title: "Paper", right: true, cell: (key) => figure(any(key).paper) },
    { title: "Target", right: true, cell: (key) => figure(any(key).target) },
  ];
  return section("Results", table(columns, names));
}

const namesOf = (runs, take) => [...new Set(runs.flatMap(take))].sort();

function comparedParameters(runs) {
  const names = namesOf(runs, (run) => run.parameters.map((each) => each.name));
  if (!names.length) return null;
  return section("Parameters", grid(names.map((name) => {
    const mine = runs.map((run, index) => ({ run, index, each: run.parameters.find((one) => one.name === name) })).filter((one) => one.each);
    const truths = [...new Set(mine.map((one) => one.each.true).filter(isNumber))];
    return card(chart({
      title: name, axis: mine[0].each.axis, truths, logarithmic: false,
      series: mine.map(({ run, index, each }) => ({ label: run.id, color: color(index), x: each.x, y: each.y })),
    }));
  })));
}

function comparedFigures(runs) {
  const rows = [
    ...namesOf(runs, (run) => run.parameters.map((each) => each.name)).map((name) => ({
      name: `${name}, relative error`, values: runs.map((run) => run.parameters.find((each) => each.name === name)?.error ?? null), show: percent, sign: -1,
    })),
    ...namesOf(runs, (run) => Object.keys(run.figures)).map((name) => ({
      name, values: runs.map((run) => run.figures[name] ?? null), show: (value) => named(name, value), sign: direction(name),
    })),
  ];
  if (!rows.length) return null;
  const best = (row) => {
    const there = row.values.filter(isNumber);
    if (!row.sign || there.length < 2 || new Set(there).size < 2) return null;
    return row.sign < 0 ? Math.min(...there) : Math.max(...there);
  };
  const columns = [
    { title: "Figure", cell: (row) => breakable(row.name) },
    ...runs.map((run, index) => ({
      title: headOf(run, index), right: true,
      cell: (row) => h("span", { class: isNumber(row.values[index]) && row.values[index] === best(row) ? "best" : "" }, row.show(row.values[index])),
    })),
  ];
  return section("Figures", table(columns, rows));
}

function comparedCurves(runs) {
  return GROUPS.map(([group, title]) => {
    const names = namesOf(runs, (run) => run.curves.filter((curve) => curve.group === group && curve.x.length > 1).map((curve) => curve.name));
    if (!names.length) return null;
    return section(title, grid(names.map((name) => {
      const mine = runs.map((run, index) => ({ run, index, curve: run.curves.find((each) => each.name === name) })).filter((one) => one.curve);
      return card(chart({
        title: name, axis: mine[0].curve.axis, show: (value) => named(name, value),
        series: mine.map(({ run, index, curve }) => ({ label: run.id, color: color(index), x: curve.x, y: curve.y })),
      }));
    })));
  });
}

function comparedFilms(runs) {
  const titles = namesOf(runs, (run) => run.media.map((each) => each.title));
  const shared = titles.filter((title) => runs.filter((run) => run.media.some((each) => each.title === title)).length > 1);
  if (!shared.length) return null;
  return section("Films and images", shared.map((title) => [
    h("p", { class: "soft", style: "margin: 12px 0 6px" }, title),
    grid(runs.map((run, index) => ({ run, index, each: run.media.find((one) => one.title === title) })).filter((one) => one.each)
      .map(({ run, index, each }) => h("div", { class: "card media" }, h("h3", {}, h("i", { class: "swatch", style: `background: var(${color(index)})` }), run.id), mediumOf(each)))),
  ]));
}

function comparedSettings(runs) {
  const text = (run, key) => (key in run.settings ? run.settings[key] : "–");
  const keys = namesOf(runs, (run) => Object.keys(run.settings)).filter((key) => new Set(runs.map((run) => text(run, key))).size > 1);
  if (!keys.length) return null;
  const columns = [
    { title: "Setting", cell: breakable },
    ...runs.map((run, index) => ({ title: headOf(run, index), cell: (key) => text(run, key) })),
  ];
  return section("Where the configurations differ", table(columns, keys));
}
