"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const get = id => document.getElementById(id), canvas = get("view"), pen = canvas.getContext("2d");
const colour = n => css(`--s${[0, 2, 3, 1][n % 4]}`);
let angle = [0.9, 0.45], zoom = 1, which = 0, frame = 0, playing = false, last = 0, clock = 0;
// Colours of the stylesheet as a canvas can use them: light-dark() is resolved on an element alone.
const probe = document.getElementById("probe");
const css = name => { probe.style.color = `var(${name})`; return getComputedStyle(probe).color; };
const add = (a, b) => a.map((v, k) => v + b[k]), times = (a, s) => a.map(v => v * s);
const dot = (a, b) => a.reduce((sum, v, k) => sum + v * b[k], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
function turn(q, v) {
  const u = q.slice(0, 3), once = times(cross(u, v), 2);
  return add(add(v, times(once, q[3])), cross(u, once));
}
const seen = () => data.trajectories[which];
const height = p => dot(data.normal, p) - data.offset;
function camera() {
  const [a, e] = angle, out = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
  const right = [-Math.sin(a), Math.cos(a), 0], up = cross(out, right);
  const scale = zoom * 0.8 * Math.min(canvas.width, canvas.height) / seen().extent;
  return p => {
    const d = add(p, times(seen().middle, -1));
    return [canvas.width / 2 + scale * dot(d, right), canvas.height / 2 - scale * dot(d, up), dot(d, out)];
  };
}
function line(see, points, colour, width = 1, dash = []) {
  pen.strokeStyle = colour; pen.lineWidth = width * devicePixelRatio; pen.setLineDash(dash.map(d => d * devicePixelRatio));
  pen.beginPath();
  let pause = true;
  for (const p of points) {
    if (!p) { pause = true; continue; }
    const [x, y] = see(p);
    pause ? pen.moveTo(x, y) : pen.lineTo(x, y);
    pause = false;
  }
  pen.stroke(); pen.setLineDash([]);
}
function arrow(see, from, to, colour) {
  line(see, [from, to], colour, 3);
  const [a, b] = [see(from), see(to)], t = Math.atan2(b[1] - a[1], b[0] - a[0]), r = 9 * devicePixelRatio;
  if (Math.hypot(b[0] - a[0], b[1] - a[1]) < 2) return;
  pen.fillStyle = colour; pen.beginPath(); pen.moveTo(b[0], b[1]);
  for (const s of [2.7, -2.7]) pen.lineTo(b[0] + r * Math.cos(t + s), b[1] + r * Math.sin(t + s));
  pen.fill();
}
function corners(pose, size) {
  const found = [];
  for (let n = 0; n < 8; n++) {
    const arm = [n & 4 ? 0.5 : -0.5, n & 2 ? 0.5 : -0.5, n & 1 ? 0.5 : -0.5].map((s, k) => s * size[k]);
    found.push(add(turn(pose.slice(3), arm), pose.slice(0, 3)));
  }
  return found;
}
const FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
// What of a polygon lies over the ground (side 1) or under it (side -1).
function cut(points, side) {
  const kept = [];
  points.forEach((p, k) => {
    const q = points[(k + 1) % points.length], [a, b] = [side * height(p), side * height(q)];
    if (a >= 0) kept.push(p);
    if (a * b < 0) kept.push(add(times(p, b / (b - a)), times(q, -a / (b - a))));
  });
  return kept;
}
function fill(points, colour, edge) {
  if (points.length < 3) return;
  pen.beginPath(); points.forEach((v, k) => k ? pen.lineTo(v[0], v[1]) : pen.moveTo(v[0], v[1])); pen.closePath();
  pen.fillStyle = colour; pen.fill();
  if (edge) { pen.globalAlpha = 1; pen.strokeStyle = edge; pen.lineWidth = devicePixelRatio; pen.stroke(); }
}
function boxes(see, one, side) {
  const faces = [];
  data.bodies.forEach((body, n) => {
    const pose = one.pose[frame][n];
    if (!pose) return;
    const at = corners(pose, body.size);
    FACES.forEach((face, f) => {
      const p = cut(face.map(k => at[k]), side).map(see);
      if (p.length) faces.push({ p, n, f, depth: p.reduce((s, v) => s + v[2], 0) / p.length });
    });
  });
  faces.sort((a, b) => a.depth - b.depth);
  for (const { p, n, f } of faces) {
    pen.globalAlpha = 0.55 + 0.07 * (f >> 1); fill(p, colour(n), css("--ink"));
  }
}
function ground(see, one) {
  const n = data.normal, first = Math.abs(n[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
  const u = add(first, times(n, -dot(n, first))).map((v, k, all) => v / Math.hypot(...all)), v = cross(n, u), side = one.square;
  const [a, b] = [u, v].map(axis => Math.round(dot(axis, one.middle) / side)), cells = Math.ceil(0.7 * one.extent / side);
  const at = (i, j) => add(times(n, data.offset), add(times(u, (a + i) * side), times(v, (b + j) * side)));
  pen.globalAlpha = 0.85;
  fill([[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([i, j]) => see(at(i * cells, j * cells))), css("--card"));
  pen.globalAlpha = 1;
  for (let k = -cells; k <= cells; k++) {
    line(see, [at(k, -cells), at(k, cells)], css("--line"));
    line(see, [at(-cells, k), at(cells, k)], css("--line"));
  }
  data.bodies.forEach((body, k) => { // the shadow of light from straight above: how high a body is
    const pose = one.pose[frame][k], at = pose && corners(pose, body.size).map(p => see(add(p, times(n, -height(p)))));
    if (at) FACES.forEach(face => fill(face.map(k => at[k]), css("--line")));
  });
}
function draw() {
  canvas.width = canvas.clientWidth * devicePixelRatio; canvas.height = canvas.clientHeight * devicePixelRatio;
  const see = camera(), one = seen(), long = one.extent * 0.15;
  const [a, e] = angle, above = dot(data.normal, [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)]) >= 0 ? 1 : -1;
  pen.clearRect(0, 0, canvas.width, canvas.height);
  boxes(see, one, -above);
  ground(see, one);
  [["x", css("--bad")], ["y", css("--good")], ["z", css("--accent")]].forEach(([name, colour], k) => {
    const to = add(one.origin, [0, 1, 2].map(j => j === k ? long : 0));
    arrow(see, one.origin, to, colour);
    const [x, y] = see(add(to, times(add(to, times(one.origin, -1)), 0.15)));
    pen.fillStyle = colour; pen.font = `${14 * devicePixelRatio}px system-ui`; pen.fillText(name, x, y);
  });
  data.bodies.forEach((body, n) => {
    line(see, one.pose.map(p => p[n] && p[n].slice(0, 3)), colour(n), 1, [3, 3]);
  });
  boxes(see, one, above);
  let strongest = 0;
  data.bodies.forEach((body, n) => {
    const pose = one.pose[frame][n], force = one.force && one.force[frame][n];
    if (!pose || !force) return;
    strongest = Math.max(strongest, Math.hypot(...force));
    const from = pose.slice(0, 3);
    arrow(see, from, add(from, times(force, one.extent * 0.3 / data.strongest)), css("--before"));
  });
  const heights = data.bodies.flatMap((body, n) => one.pose[frame][n] ? corners(one.pose[frame][n], body.size).map(height) : []);
  const lowest = Math.min(...heights);
  get("grid").textContent = `; a square of the ground is ${one.square} m wide`;
  const lost = data.bodies.filter((body, n) => !one.pose[frame][n]).map(body => body.name);
  get("said").textContent = `frame ${one.frames[frame]}, ${one.time[frame].toFixed(3)} s` +
    (one.force ? `, force ${strongest.toPrecision(3)} N` : ", no forces") +
    (heights.length ? `, lowest corner ${(1000 * Math.abs(lowest)).toFixed(1)} mm ${lowest < 0 ? "under" : "over"} the ground` : "") + (lost.length ? `, not seen: ${lost.join(", ")}` : "");
  get("frame").value = frame;
}
function choose(index) {
  which = index; frame = 0; clock = 0;
  get("frame").max = data.trajectories[which].time.length - 1;
  draw();
}
function tick(now) {
  if (!playing) return;
  const one = data.trajectories[which];
  clock += Math.min(now - last, 100) / 1000 * Number(get("speed").value); last = now;
  if (clock > one.time.at(-1)) clock = 0;
  frame = 0;
  while (frame + 1 < one.time.length && one.time[frame + 1] <= clock) frame++;
  draw(); requestAnimationFrame(tick);
}
data.trajectories.forEach((one, index) => get("which").add(new Option(one.label, index)));
get("which").onchange = event => choose(Number(event.target.value));
get("frame").oninput = event => { frame = Number(event.target.value); clock = data.trajectories[which].time[frame]; draw(); };
get("play").onclick = () => {
  playing = !playing; get("play").textContent = playing ? "pause" : "play";
  last = performance.now(); requestAnimationFrame(tick);
};
canvas.onpointermove = event => {
  if (!(event.buttons & 1)) return;
  angle = [angle[0] - event.movementX / 150, Math.max(-1.5, Math.min(1.5, angle[1] + event.movementY / 150))];
  draw();
};
canvas.onwheel = event => { event.preventDefault(); zoom *= Math.exp(-event.deltaY / 500); draw(); };
window.onresize = draw;
matchMedia("(prefers-color-scheme: dark)").onchange = draw;
choose(0);
