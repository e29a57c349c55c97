"""The style of the report: light and dark, from a phone to a wide screen, colours as on the dashboard."""

STYLE = """
:root {
  --page: #f6f7f9; --card: #ffffff; --ink: #16191f; --soft: #5d6675; --line: #e2e5ea; --hover: #eef1f6;
  --accent: #1d5fd1; --tint: #e8f0fd; --good: #12703f; --good-tint: #e2f5ea; --warn: #8a5300; --warn-tint: #fdf1da;
  --bad: #b42318; --bad-tint: #fde8e6; --before: #d97706; --after: #1d5fd1; --free: #7b8494; --floor: #16191f;
  --heat-full: #a8341a; --heat-ink: #ffffff; --muted: #a9b3c1;
  --perception: #9333ea; --actuation: #d97706; --dynamics: #1d5fd1; --contact: #0f8a5f;
}
@media (prefers-color-scheme: dark) { :root {
  --page: #0e1116; --card: #161a21; --ink: #e8ebf0; --soft: #98a2b3; --line: #29303b; --hover: #232a35;
  --accent: #7db0ff; --tint: #1a2840; --good: #6bd79b; --good-tint: #12301f; --warn: #f5c26b; --warn-tint: #362812;
  --bad: #ff9b8f; --bad-tint: #3b1a17; --before: #f5a94b; --after: #7db0ff; --free: #8a94a5; --floor: #e8ebf0;
  --heat-full: #ff9d7e; --heat-ink: #23100a; --muted: #556172;
  --perception: #c59bff; --actuation: #f5a94b; --dynamics: #7db0ff; --contact: #4fcf9c;
} }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body {
  margin: 0; background: var(--page); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif;
}
main { max-width: 1080px; margin: 0 auto; padding: 24px 24px 64px; }
h1 { font-size: 26px; line-height: 1.28; margin: 4px 0 14px; letter-spacing: -0.01em; text-wrap: balance; }
h2 { font-size: 19px; margin: 40px 0 0; }
h3 { font-size: 13px; margin: 0 0 10px; font-weight: 600; }
p { margin: 0; }
h1, p, h3 { overflow-wrap: anywhere; }
figure { margin: 0; min-width: 0; }
figcaption { font-size: 13px; margin-bottom: 6px; }
.soft, h3.soft { color: var(--soft); }
.small { font-size: 13px; }
.lead { color: var(--soft); margin-top: 2px; }
.below { margin-top: 12px; }
.number { font-variant-numeric: tabular-nums; white-space: nowrap; }
.card { background: var(--card); border: 1px solid var(--line); border-radius: 12px; padding: 16px; min-width: 0; }
.card > p + p { margin-top: 4px; }
.grid {
  display: grid; gap: 14px; align-items: start; grid-template-columns: repeat(auto-fit, minmax(min(100%, 300px), 1fr));
}
section > .card, section > .grid { margin-top: 14px; }
.answers { margin-top: 14px; align-items: stretch; }
.answers h3 { margin-bottom: 2px; }
.verdict { border-left: 5px solid var(--accent); padding: 20px 22px; }
.verdict.good { border-left-color: var(--good); }
.verdict.warn { border-left-color: var(--warn); }
.verdict.bad { border-left-color: var(--bad); }
.sure { display: flex; flex-wrap: wrap; gap: 6px 12px; align-items: center; }
.meter { width: 110px; height: 6px; border-radius: 3px; background: var(--line); overflow: hidden; }
.meter i { display: block; height: 100%; background: var(--soft); }
.note {
  display: inline-block; background: var(--warn-tint); color: var(--warn); border-radius: 8px; padding: 6px 12px;
}
.verdict .note { margin-top: 14px; }
.badge {
  display: inline-block; font-size: 12px; line-height: 1.3; font-weight: 600; padding: 2px 8px; border-radius: 99px;
  background: var(--tint); color: var(--accent); white-space: nowrap;
}
.badge.good { background: var(--good-tint); color: var(--good); }
.badge.warn { background: var(--warn-tint); color: var(--warn); }
.badge.bad { background: var(--bad-tint); color: var(--bad); }
.badge.plain { background: var(--hover); color: var(--soft); }
.chips { display: flex; flex-wrap: wrap; gap: 6px; margin-top: 10px; }
.big { font-size: 22px; line-height: 1.3; font-weight: 650; letter-spacing: -0.01em; }
.formula { margin-bottom: 8px; }
.size { margin-top: 10px; }
.stack { display: flex; gap: 2px; height: 18px; border-radius: 4px; overflow: hidden; }
.stack i { min-width: 2px; }
.site-perception { background: var(--perception); } .site-actuation { background: var(--actuation); }
.site-dynamics { background: var(--dynamics); } .site-contact { background: var(--contact); }
.legend { display: flex; flex-wrap: wrap; gap: 4px 18px; font-size: 13px; color: var(--soft); margin-top: 10px; }
.legend span { display: inline-flex; align-items: center; gap: 6px; }
.legend b { color: var(--ink); font-variant-numeric: tabular-nums; }
.squares i { width: 10px; height: 10px; border-radius: 3px; }
.key { width: 18px; border-top: 2.5px solid; }
.key.before { border-color: var(--before); } .key.after { border-color: var(--after); }
.key.recorded { border-color: #fff; outline: 1px solid var(--soft); height: 5px; background: #fff; border: 0; }
.key.freeform { border-color: var(--free); border-top-style: dotted; }
.key.floor { border-color: var(--floor); border-top-style: dashed; border-top-width: 1.5px; }
.maps { display: flex; flex-wrap: wrap; gap: 18px 36px; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; padding: 8px 10px 8px 0; border-bottom: 1px solid var(--line); font-weight: 400; }
thead th { font-size: 12px; color: var(--soft); font-weight: 600; white-space: nowrap; }
tbody tr:last-child > * { border-bottom: 0; }
td.right .small { white-space: normal; }
th.right, td.right { text-align: right; padding-right: 0; padding-left: 14px; }
.heat { width: auto; border-collapse: separate; border-spacing: 2px; font-variant-numeric: tabular-nums; }
.heat th, .heat td { border: 0; padding: 0; font-size: 12px; text-align: center; height: 32px; }
.heat tbody th {
  max-width: 112px; padding-right: 8px; text-align: right; color: var(--soft); font-size: 13px; line-height: 1.15;
}
.heat thead th { height: 20px; }
.heat tbody td {
  width: 50px; border-radius: 5px; background: color-mix(in oklab, var(--heat-full) var(--heat), var(--hover));
}
.heat tbody td.full { color: var(--heat-ink); }
.heat tbody td.strongest { outline: 2px solid var(--ink); outline-offset: -1px; font-weight: 700; }
.heat tbody td.untested { background: none; box-shadow: inset 0 0 0 1px var(--line); }
.scale { display: flex; align-items: center; gap: 8px; margin-top: 10px; }
.ramp {
  width: 120px; height: 8px; border-radius: 4px;
  background: linear-gradient(in oklab to right, var(--hover), var(--heat-full));
}
.times { display: grid; grid-template-columns: max-content 1fr; gap: 3px 10px; align-items: center; }
.strip { display: grid; gap: 1px; height: 22px; }
.strip i { border-radius: 3px; background: color-mix(in oklab, var(--heat-full) var(--heat), var(--hover)); }
.ends { display: flex; justify-content: space-between; color: var(--soft); font-variant-numeric: tabular-nums; }
.ranking {
  display: grid; grid-template-columns: max-content 1fr max-content max-content; gap: 9px 14px; align-items: center;
  font-size: 14px;
}
.ranking > div { display: contents; }
.ranking .number { text-align: right; }
.bar { height: 14px; border-radius: 3px; background: var(--hover); position: relative; }
.bar i { position: absolute; inset: 0 auto 0 0; background: var(--accent); border-radius: 3px; }
.bar i.muted { background: var(--muted); }
.bar b { position: absolute; top: -3px; bottom: -3px; width: 2px; margin-left: -1px; background: var(--ink); }
.levels {
  display: grid; grid-template-columns: max-content 1fr max-content; gap: 4px 12px; align-items: center;
  font-size: 14px;
}
.levels .inset { padding-left: 10px; color: var(--soft); }
.levels .number { text-align: right; }
.track { position: relative; height: 24px; display: block; min-width: 60px; margin: 0 7px; }
.track::before {
  content: ""; position: absolute; left: -7px; right: -7px; top: 11px; height: 2px; background: var(--hover);
}
.track b { position: absolute; top: 0; bottom: 0; border-left: 1.5px dashed var(--soft); margin-left: -1px; }
.track u { position: absolute; top: 10px; height: 4px; border-radius: 2px; background: var(--after); opacity: 0.45; }
.dot {
  position: absolute; top: 6px; width: 12px; height: 12px; margin-left: -6px; border-radius: 50%;
  border: 2px solid var(--card); background: var(--soft);
}
.dot.before { background: var(--before); } .dot.after { background: var(--after); }
.dot.freeform { background: var(--card); border-color: var(--free); }
.plots { display: grid; gap: 20px 28px; grid-template-columns: repeat(auto-fit, minmax(min(100%, 300px), 1fr)); }
.plot { position: relative; height: 230px; margin-left: 56px; }
.plot svg { position: absolute; inset: 0; width: 100%; height: 100%; overflow: visible; }
.plot .y span {
  position: absolute; right: calc(100% + 8px); transform: translateY(50%); font-size: 12px; color: var(--soft);
  white-space: nowrap; font-variant-numeric: tabular-nums;
}
.x { margin: 6px 0 0 56px; font-size: 12px; }
svg * { vector-effect: non-scaling-stroke; fill: none; }
.grid-line { stroke: var(--line); stroke-width: 1; }
.line { stroke-width: 2.2; stroke-linejoin: round; stroke-linecap: round; }
.line.before { stroke: var(--before); } .line.after { stroke: var(--after); }
.line.freeform { stroke: var(--free); stroke-dasharray: 1 5; }
.line.floor { stroke: var(--floor); stroke-width: 1.5; stroke-dasharray: 6 4; }
video { width: 100%; border-radius: 8px; background: #000; display: block; }
.film { max-width: 400px; margin-top: 12px; } .wide-film { max-width: 800px; margin-top: 12px; }
.stills { display: grid; gap: 12px; margin-top: 12px; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); }
.wide-stills { grid-template-columns: repeat(auto-fit, minmax(min(100%, 400px), 1fr)); }
.stills img { width: 100%; border-radius: 8px; display: block; }
.stills figcaption { margin: 4px 0 0; color: var(--soft); }
details { margin-top: 12px; }
summary { cursor: pointer; font-weight: 600; padding: 6px 0; }
pre {
  margin: 6px 0 0; padding: 12px; background: var(--page); border-radius: 8px; overflow-x: auto;
  font: 12.5px/1.55 ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace;
}
footer { display: flex; flex-wrap: wrap; gap: 4px 20px; margin-top: 40px; font-size: 13px; color: var(--soft); }
footer b { font-weight: 600; }
:focus-visible { outline: 2px solid var(--accent); outline-offset: 2px; }
@media (max-width: 600px) {
  main { padding: 12px 12px 48px; }
  h1 { font-size: 21px; }
  h2 { margin-top: 32px; }
  .card { padding: 14px; }
  .verdict { padding: 16px; }
  .heat tbody td { width: 42px; }
  .maps { gap: 18px; }
  .ranking { display: block; }
  .ranking > div { display: grid; grid-template-columns: 1fr max-content 72px; gap: 2px 10px; margin-bottom: 10px; }
  .ranking .bar { order: 1; grid-column: 1 / -1; height: 8px; }
  .plot { height: 190px; margin-left: 52px; }
  .x { margin-left: 52px; }
}
@media print {
  body { background: #fff; }
  .card { break-inside: avoid; }
}
"""
