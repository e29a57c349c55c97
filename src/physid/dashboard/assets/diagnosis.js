/* A diagnosis: the verdict as a sentence, where the gap lies, which effect causes it, how far it closes. */
const words = (name) => String(name).replaceAll("_", " ");
const list = (names) => names.map(words).join(", ").replace(/, ([^,]*)$/, " or $1");

function verdictOf(diagnosis) {
  const group = diagnosis.group || [];
  const named = (diagnosis.effects || []).map((each) => words(each.name)).join(" + ");
  const [short, kind] = {
    none: ["no gap beyond the floors", "good"],
    named: [named, ""],
    group: [`one of ${group.length}: ${list(group)}`, "warn"],
    partial: [`${named}, and more`, "warn"],
    unknown: ["a gap that no effect explains", "bad"],
  }[diagnosis.verdict] || [String(diagnosis.verdict ?? "no verdict"), "plain"];
  return { short, kind };
}

function diagnosisSections(run) {
  const diagnosis = run.diagnosis;
  const verdict = verdictOf(diagnosis);
  return [
    h("div", { class: "card verdict" },
      h("p", {}, badge(diagnosis.verdict || "?", verdict.kind), " ", run.sentence,
        isNumber(diagnosis.confidence) && h("span", { class: "soft" }, ` Confidence ${percent(diagnosis.confidence)}.`)),
      (diagnosis.effects || []).map((effect) => h("p", { class: "small" }, Object.entries(effect.parameters || {}).map(([name, value]) =>
        h("span", { class: "number" }, `${words(effect.name)}, ${name}: ${interval(value)} `)))),
      diagnosis.next_experiment && h("p", { class: "small soft" }, `Next experiment: ${textOf(diagnosis.next_experiment)}`)),
    h("section", {}, h("h2", {}, "The three answers"), grid(whereCard(diagnosis), whichCard(diagnosis), howFarCard(diagnosis))),
    parameterTable(diagnosis),
  ];
}

const textOf = (value) => (typeof value === "string" ? value : JSON.stringify(value));

function interval(value) {
  if (isNumber(value)) return figure(value);
  const range = isNumber(value.low) && isNumber(value.high) ? ` (${figure(value.low)} to ${figure(value.high)})` : "";
  return `${figure(value.value)}${range} ${value.unit && value.unit !== "-" ? value.unit : ""}`.trim();
}

/* rows: [{ label, value, text, mark, muted }]; every bar is a share of the largest value */
function bars(rows, mark) {
  const most = Math.max(...rows.map((row) => row.value || 0), mark || 0) || 1;
  return h("div", { class: "bars" }, rows.map((row) => [
    h("span", {}, row.label),
    h("span", { class: "bar" },
      h("i", { class: row.muted ? "muted" : "", style: `width: ${Math.max((100 * (row.value || 0)) / most, 0.5)}%` }),
      isNumber(mark) && h("b", { style: `left: calc(${(100 * mark) / most}% - 1px)` })),
    h("span", { class: "number" }, row.text),
  ]));
}

function whereCard(diagnosis) {
  const where = diagnosis.where || {};
  const sites = Object.entries(where.site || {}).sort((a, b) => b[1] - a[1]);
  const cells = [...(where.cells || [])].sort((a, b) => b.evidence - a.evidence).slice(0, 5);
  return card(h("h3", {}, "Where"),
    sites.length > 0 && bars(sites.map(([name, value]) => ({ label: name, value, text: percent(value) }))),
    cells.length > 0 && [h("p", { class: "soft small", style: "margin-top: 14px" }, "Strongest evidence"),
      bars(cells.map((cell) => ({ label: `${words(cell.phase)}, ${[cell.body, cell.dof].filter(Boolean).join(" ")}`, value: cell.evidence, text: figure(cell.evidence, 3), muted: true })))]);
}

function whichCard(diagnosis) {
  const ranking = (diagnosis.ranking || []).slice(0, 8);
  const blamed = new Set((diagnosis.effects || []).map((each) => each.name));
  return card(h("h3", {}, "Which"),
    ranking.length === 0 && h("p", { class: "soft" }, "No candidate stands out."),
    ranking.length > 0 && bars(ranking.map((each) => ({
      label: each.effects.map(words).join(" + "), value: Math.max(each.score, 0),
      text: isNumber(each.p_value) ? `p ${figure(each.p_value, 2)}` : figure(each.score, 3),
      muted: !each.effects.some((name) => blamed.has(name)),
    }))));
}

function howFarCard(diagnosis) {
  const gap = diagnosis.gap || {};
  const splits = [["same", "same protocol"], ["transfer", "transfer"]].filter(([key]) => gap[key]);
  const show = (value) => measure(value, gap.unit);
  return card(h("h3", {}, "How far"),
    splits.length > 0 && bars(splits.flatMap(([key, label]) => [
      { label: `${label}, before`, value: gap[key].before, text: show(gap[key].before), muted: true },
      { label: `${label}, after`, value: gap[key].after, text: show(gap[key].after) },
    ]), gap.floor),
    isNumber(gap.floor) && h("div", { class: "legend" }, h("span", {}, h("i", { style: "border-color: var(--truth)" }), `floor ${show(gap.floor)}`)),
    splits.map(([key, label]) => diagnosis.shrink && diagnosis.shrink[key] && h("p", { class: "small", style: "margin-top: 8px" },
      `${label}: ${percent(diagnosis.shrink[key].value)} of the gap closed${diagnosis.shrink[key].low === null ? "" : ` (${percent(diagnosis.shrink[key].low)} to ${percent(diagnosis.shrink[key].high)})`}`)),
    !gap.transfer && h("p", { class: "small soft", style: "margin-top: 8px" }, "Predictive only: without a transfer set the cause is not certified."));
}

function parameterTable(diagnosis) {
  const rows = Object.entries(diagnosis.parameters || {});
  if (!rows.length) return null;
  const columns = [
    { title: "Parameter", cell: ([name]) => name },
    { title: "Nominal model", right: true, cell: ([, value]) => figure(value.nominal) },
    { title: "With the effect", right: true, cell: ([, value]) => (value.with_effect ? interval(value.with_effect) : "–") },
  ];
  return section("Parameters, before and after", table(columns, rows));
}

/* A report follows the system's colours; in this page it shall follow the page's. */
function themed(report) {
  const dark = document.documentElement.dataset.theme === "dark";
  return report.replaceAll("(prefers-color-scheme: dark)", dark ? "(min-width: 0)" : "(max-width: 0)");
}

function reportSection(run) {
  const place = h("div", {});
  const open = h("button", {
    "aria-pressed": "false",
    onclick: () => {
      const shown = place.childElementCount > 0;
      open.setAttribute("aria-pressed", String(!shown));
      const frame = h("iframe", { srcdoc: themed(run.report), sandbox: "", title: `report of ${run.id}` });
      addEventListener("theme", () => { frame.srcdoc = themed(run.report); });
      place.replaceChildren(...(shown ? [] : [frame]));
    },
  }, "Full report");
  return h("div", { style: "margin-top: 14px" }, open, place);
}
