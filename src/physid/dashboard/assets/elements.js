/* Elements from data: text is always set as text, never as markup. */
const SVG = "http://www.w3.org/2000/svg";

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes || {})) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "text") element.textContent = value;
    else element.setAttribute(name, value === true ? "" : value);
    if (name === "muted") element.muted = true; // the attribute counts in parsed markup only
  }
  for (const child of children.flat(3)) {
    if (child === null || child === undefined || child === false) continue;
    element.append(child instanceof Node ? child : String(child));
  }
  return element;
}

const h = (tag, attributes, ...children) => fill(document.createElement(tag), attributes, children);
const s = (tag, attributes, ...children) => fill(document.createElementNS(SVG, tag), attributes, children);
/* A name that may be broken after a slash, a dot or an underscore. */
const breakable = (name) => name.split(/(?<=[/_.])/).flatMap((part, index) => (index ? [h("wbr"), part] : [part]));
const badge = (text, kind = "") => h("span", { class: `badge ${kind}` }, text);
const card = (...children) => h("div", { class: "card" }, ...children);
const section = (title, ...children) => h("section", {}, h("h2", {}, title), ...children);
const grid = (...children) => h("div", { class: "grid" }, ...children);

function table(columns, rows) {
  const head = columns.map((column) => h("th", { class: column.right ? "right" : "", scope: "col" }, column.title));
  const body = rows.map((row) =>
    h("tr", {}, columns.map((column) => h("td", { class: column.right ? "right number" : "" }, column.cell(row))))
  );
  return h("div", { class: "card scroll" }, h("table", {}, h("thead", {}, h("tr", {}, head)), h("tbody", {}, body)));
}
