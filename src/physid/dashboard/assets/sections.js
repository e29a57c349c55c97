/* One run: what was identified, how it went there, what it predicts, and how to repeat it. */
const GROUPS = [["loss", "Losses"], ["error", "Errors"], ["schedule", "Schedules"], ["other", "Other curves"]];

function runPage(run) {
  const about = [run.method, run.data, run.figures.seconds ? duration(run.figures.seconds) : "", moment(run.date)].filter(Boolean);
  return h("div", {},
    h("div", { class: "head" },
      h("div", { class: "titles" },
        h("a", { href: "#/" }, "← all runs"),
        h("h1", {}, run.id, " ", badge(run.kind, "plain"), " ", run.state !== "finished" && badge(run.state, "warn")),
        h("p", { class: "soft" }, about.join(" · "))),
      themeButton()),
    run.notes.map((note) => h("p", { class: "note" }, note)),
    run.diagnosis && diagnosisSections(run),
    run.report && reportSection(run),
    run.score && scoreSections(run),
    run.identifiability && identifiabilitySection(run.identifiability),
    run.parameters.length > 0 && parameterSection(run),
    run.cells.length > 0 && cellSection(run),
    run.media.length > 0 && mediaSection(run.media),
    GROUPS.map(([group, title]) => curveSection(title, run.curves.filter((curve) => curve.group === group && curve.x.length > 1))),
    !run.score && figureSection(run),
    recordSection(run));
}

const OBSERVED = { identified: "good", combination: "warn" };
const observedBadge = (verdict) => badge(verdict.kind === "combination" ? "in a combination" : words(verdict.kind), OBSERVED[verdict.kind] || "bad");

/* What an experiment can tell: the standard deviation to expect of each parameter, and which combination is known. */
function identifiabilitySection(identifiability) {
  const columns = [
    { title: "Parameter", cell: ([name]) => name },
    { title: "Expected", right: true, cell: ([, each]) => percent(each.deviation) },
    { title: "If it alone is unknown", right: true, cell: ([, each]) => percent(each.alone) },
    { title: "Verdict", cell: ([, each]) => [observedBadge(each), each.combination ? ` ${each.combination}, to ${percent(each.combined)}` : ""] },
  ];
  return section("What can be identified", table(columns, Object.entries(identifiability.verdicts || {})));
}

function parameterSection(run) {
  return section("Parameters", grid(run.parameters.map((each) => card(
    h("h3", {}, each.name),
    h("div", { class: "pair" },
      h("span", { class: "big" }, `${figure(each.estimate, 5)} ${each.unit}`),
      isNumber(each.low) && isNumber(each.high) && h("span", { class: "soft", title: "90 % interval" }, `${figure(each.low, 5)} to ${figure(each.high, 5)}`),
      isNumber(each.true) && h("span", { class: "soft" }, `true ${figure(each.true, 5)}`),
      isNumber(each.error) && badge(`${percent(each.error)} off`, grade(each.error))),
    each.x.length > 0 && chart({
      title: "estimate", axis: each.axis, logarithmic: false,
      series: [{ label: "estimate", color: "--estimate", x: each.x, y: each.y }],
      band: isNumber(each.low) && isNumber(each.high) ? [each.low, each.high] : null,
      truths: isNumber(each.true) ? [each.true] : [],
    })))));
}

function curveSection(title, curves) {
  if (!curves.length) return null;
  return section(title, grid(curves.map((curve) => card(chart({
    title: curve.name, axis: curve.axis, show: (value) => named(curve.name, value),
    series: [{ label: curve.name, color: "--s0", x: curve.x, y: curve.y }],
  })))));
}

function cellSection(run) {
  const mark = (cell) => ({ true: badge("met", "good"), false: badge("missed", "bad"), null: "" })[String(met(cell))];
  const several = new Set(run.cells.map((cell) => cell.cell)).size > 1;
  const columns = [
    ...(several ? [{ title: "What", cell: (cell) => cell.cell }] : []),
    { title: "Figure", cell: (cell) => cell.metric },
    { title: "Value", right: true, cell: (cell) => [isNumber(cell.value) ? figure(cell.value) : String(cell.value ?? "–"), cell.unit && cell.unit !== "-" ? ` ${cell.unit}` : ""] },
    { title: "Paper", right: true, cell: (cell) => isNumber(cell.paper) ? figure(cell.paper) : String(cell.paper ?? "–") },
    { title: "Target", right: true, cell: (cell) => isNumber(cell.target) ? figure(cell.target) : String(cell.target ?? "–") },
    { title: "", cell: mark },
  ];
  return section("Results", table(columns, run.cells));
}

function mediaSection(media) {
  return section("Films and images", h("div", { class: "grid wide" }, media.map((each) => h("div", { class: "card media" }, h("h3", {}, each.title), mediumOf(each)))));
}

/* Films play by themselves, without sound, unless the viewer's system asks for little motion. They are small: what steers
   them would hide them, and comes when it is asked for. */
const STILL = matchMedia("(prefers-reduced-motion: reduce)").matches;

function mediumOf(each) {
  if (each.type !== "video") return h("img", { src: each.uri, alt: each.title, decoding: "async" });
  const steer = ({ currentTarget }) => { currentTarget.controls = true; };
  const settle = ({ currentTarget }) => { currentTarget.controls = STILL || currentTarget.paused || currentTarget.matches(":hover, :focus"); };
  return h("video", {
    src: each.uri, controls: STILL, autoplay: !STILL, loop: true, muted: true, playsinline: true, tabindex: 0, title: each.title,
    onpointerenter: steer, onpointerdown: steer, onfocus: steer, onpointerleave: settle, onplay: settle,
  });
}

function figureSection(run) {
  const names = Object.keys(run.figures).sort();
  if (!names.length) return null;
  const columns = [
    { title: "Figure", cell: breakable },
    { title: "Last value", right: true, cell: (name) => named(name, run.figures[name]) },
  ];
  return section("Final figures", h("div", { class: "narrow" }, table(columns, names)));
}

function recordSection(run) {
  const record = run.record || {};
  const plain = Object.entries(record).filter(([, value]) => value !== null && typeof value !== "object");
  const nested = Object.entries(record).filter(([, value]) => value !== null && typeof value === "object");
  if (!run.config && !run.record) return null;
  return section("How to repeat it",
    run.config && h("details", {}, h("summary", {}, "Configuration"), card(h("pre", {}, run.config))),
    run.record && h("details", {}, h("summary", {}, "Versions, data and machine"),
      plain.length > 0 && card(h("pre", {}, plain.map(([name, value]) => `${name}: ${value}`).join("\n"))),
      nested.map(([name, value]) => h("details", {}, h("summary", { class: "soft" }, name), card(h("pre", {}, JSON.stringify(value, null, 2)))))));
}
