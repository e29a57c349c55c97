/* Line charts: drawn for the width there is, a value under the finger, linear or logarithmic. */
const MARGIN = { left: 54, right: 14, top: 8, bottom: 30 };
const HEIGHT = 220;
const FROM_HERE_LOGARITHMIC = 50;

function ticksOf(low, high, count) {
  const raw = (high - low) / Math.max(count, 1);
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((each) => each * power).find((each) => each >= raw * 0.999);
  const ticks = [];
  for (let index = Math.ceil(low / step - 1e-9); index * step <= high + step * 1e-9; index += 1) ticks.push(index * step);
  return ticks.map((tick) => Number(tick.toPrecision(12)));
}

function decades(low, high) {
  const first = Math.floor(Math.log10(low) + 1e-9);
  const last = Math.ceil(Math.log10(high) - 1e-9);
  const every = Math.max(1, Math.ceil((last - first) / 6));
  const ticks = [];
  for (let power = first; power <= last; power += every) ticks.push(10 ** power);
  return ticks.filter((tick) => tick >= low * 0.999 && tick <= high * 1.001);
}

function scaleOf(values, from, to, logarithmic) {
  let low = Math.min(...values);
  let high = Math.max(...values);
  if (logarithmic) {
    const room = Math.max((high / low) ** 0.06, 1.05);
    low /= room;
    high *= room;
    const slope = (to - from) / Math.log(high / low);
    let ticks = decades(low, high);
    if (ticks.length < 2) ticks = ticksOf(low, high, 4).filter((tick) => tick > 0);
    return { at: (value) => from + slope * Math.log(value / low), ticks };
  }
  const room = (high - low || Math.abs(high) || 1) * 0.06;
  low -= room;
  high += room;
  return { at: (value) => from + ((value - low) / (high - low)) * (to - from), ticks: ticksOf(low, high, 5) };
}

function xScale(values, from, to) {
  const low = Math.min(...values);
  const high = Math.max(...values);
  const span = high - low || 1;
  const ticks = ticksOf(low, low + span, Math.min(6, (to - from) / 60)).filter((tick) => tick <= high && Number.isInteger(tick));
  return { at: (value) => from + ((value - low) / span) * (to - from), ticks };
}

/* title, axis, series: [{ label, color, x, y }], truths: [number], band: [low, high], show: (value) => text */
function chart({ title, axis, series, truths = [], band = null, show = figure, logarithmic = null }) {
  const drawn = series.filter((each) => each.x.length);
  const values = [...drawn.flatMap((each) => each.y), ...truths, ...(band || [])].filter(isNumber);
  const positive = values.length > 0 && values.every((value) => value > 0);
  let log = logarithmic ?? (positive && Math.max(...values) / Math.min(...values) > FROM_HERE_LOGARITHMIC);
  const plot = h("div", {});
  const tip = h("div", { class: "tip", hidden: true });
  const toggle = h("button", {
    "aria-pressed": String(log),
    "aria-label": `logarithmic scale of ${title}`,
    onclick: () => {
      log = !log;
      toggle.setAttribute("aria-pressed", String(log));
      draw(plot.clientWidth);
    },
  }, "log");

  function draw(width) {
    if (!width) return;
    const x = xScale(drawn.flatMap((each) => each.x), MARGIN.left, width - MARGIN.right);
    const y = scaleOf(values, HEIGHT - MARGIN.bottom, MARGIN.top, log);
    const parts = [
      y.ticks.map((tick) => [
        s("line", { class: "grid-line", x1: MARGIN.left, x2: width - MARGIN.right, y1: y.at(tick), y2: y.at(tick) }),
        s("text", { x: MARGIN.left - 8, y: y.at(tick) + 4, "text-anchor": "end" }, figure(tick)),
      ]),
      x.ticks.map((tick) => s("text", { x: x.at(tick), y: HEIGHT - 12, "text-anchor": "middle" }, figure(tick, 6))),
      s("text", { x: width - MARGIN.right, y: HEIGHT, "text-anchor": "end" }, axis),
      band && s("rect", { class: "band", x: MARGIN.left, width: width - MARGIN.left - MARGIN.right, y: y.at(band[1]), height: Math.max(y.at(band[0]) - y.at(band[1]), 1) }),
      truths.map((each) => s("line", { class: "true", x1: MARGIN.left, x2: width - MARGIN.right, y1: y.at(each), y2: y.at(each) })),
      drawn.map((each) => lineOf(each, x, y)),
    ];
    const cursor = s("g", {});
    const svg = s("svg", { viewBox: `0 0 ${width} ${HEIGHT}`, height: HEIGHT, role: "img", "aria-label": title }, parts, cursor);
    const leave = () => { cursor.replaceChildren(); tip.hidden = true; };
    svg.addEventListener("pointermove", (event) => point(event, svg, x, y, cursor));
    svg.addEventListener("pointerdown", (event) => point(event, svg, x, y, cursor));
    svg.addEventListener("pointerleave", leave);
    plot.replaceChildren(svg);
  }

  function point(event, svg, x, y, cursor) {
    const box = svg.getBoundingClientRect();
    const here = event.clientX - box.left;
    const all = drawn.flatMap((each) => each.x);
    const nearest = all.reduce((best, each) => (Math.abs(x.at(each) - here) < Math.abs(x.at(best) - here) ? each : best));
    const marks = [];
    const lines = [`${axis} ${figure(nearest, 6)}`];
    for (const each of drawn) {
      const index = each.x.indexOf(nearest);
      if (index < 0) continue;
      marks.push(s("circle", { cx: x.at(nearest), cy: y.at(each.y[index]), r: 4, fill: `var(${each.color})` }));
      lines.push(`${drawn.length > 1 ? `${each.label}  ` : ""}${show(each.y[index])}`);
    }
    const rule = s("line", { class: "cursor", x1: x.at(nearest), x2: x.at(nearest), y1: MARGIN.top, y2: HEIGHT - MARGIN.bottom });
    cursor.replaceChildren(rule, ...marks);
    tip.replaceChildren(...lines.map((line) => h("div", {}, line)));
    tip.hidden = false;
    const right = x.at(nearest) > box.width / 2;
    tip.style.top = `${plot.offsetTop + 12}px`;
    tip.style.left = right ? "auto" : `${x.at(nearest) + 10}px`;
    tip.style.right = right ? `${box.width - x.at(nearest) + 10}px` : "auto";
  }

  new ResizeObserver((entries) => draw(Math.floor(entries[0].contentRect.width))).observe(plot);
  const caption = h("figcaption", {}, h("h3", {}, title), positive && toggle);
  return h("figure", { class: "chart" }, caption, plot, tip, legendOf(drawn, truths, band));
}

function lineOf(each, x, y) {
  const points = each.x.map((value, index) => `${x.at(value).toFixed(1)},${y.at(each.y[index]).toFixed(1)}`);
  const few = points.length <= 40;
  const dots = few && each.x.map((value, index) =>
    s("circle", { cx: x.at(value), cy: y.at(each.y[index]), r: points.length === 1 ? 4 : 2.5, fill: `var(${each.color})` })
  );
  return [s("polyline", { class: "line", points: points.join(" "), stroke: `var(${each.color})` }), dots];
}

function legendOf(drawn, truths, band) {
  if (drawn.length < 2 && !truths.length && !band) return null;
  const keys = drawn.map((each) => h("span", {}, h("i", { style: `border-color: var(${each.color})` }), each.label));
  const truth = truths.length > 0 && h("span", {}, h("i", { class: "true" }), "truth");
  const interval = band && h("span", {}, h("i", { class: "band" }), "90 % interval");
  return h("div", { class: "legend" }, keys, truth, interval);
}
