// Small helpers for building the page and writing numbers.

/** An element with properties and children; text goes in as text, never as HTML. */
export function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(properties)) {
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key in element && key !== "list") element[key] = value;
    else element.setAttribute(key, value);
  }
  element.append(...children);
  return element;
}

/** A select of [value, text] pairs. */
export function choice(options, value, onchange, title) {
  const select = make("select", { title, onchange: () => onchange(select.value) });
  for (const [v, text] of options) select.append(make("option", { value: v, textContent: text, selected: v === value }));
  return select;
}

/** 1234567 -> "1.23 M". */
export function si(value, unit = "") {
  const size = Math.abs(value);
  const [scale, prefix] = size >= 1e9 ? [1e9, "G"] : size >= 1e6 ? [1e6, "M"] : size >= 1e4 ? [1e3, "k"] : [1, ""];
  const scaled = value / scale;
  const digits = scale === 1 && Number.isInteger(value) ? 0 : Math.abs(scaled) >= 100 ? 0 : Math.abs(scaled) >= 10 ? 1 : 2;
  return `${scaled.toFixed(digits)}${prefix || unit ? " " : ""}${prefix}${unit}`;
}

/** Seconds with the digits that make sense for a simulation, or a time of day for clocks that count from 1970. */
export function seconds(t) {
  if (t > 1e9) return new Date(t * 1000).toISOString().slice(11, 23);
  return `${t.toFixed(3)} s`;
}

/** 0.00087 -> "0.87 ms". */
export function duration(t) {
  return t < 0.1 ? `${(1000 * t).toPrecision(2)} ms` : `${t.toPrecision(2)} s`;
}

export function table({ title, columns, rows, more }) {
  const body = rows.map((row) =>
    make("tr", {}, ...row.map((v) => make("td", { className: typeof v === "string" ? "text" : "", textContent: typeof v === "number" ? String(v) : v }))));
  const head = make("tr", {}, ...columns.map((c, i) => make("th", { className: rows.length && typeof rows[0][i] === "string" ? "text" : "", textContent: c })));
  const caption = more ? `${title} (${more} more not shown)` : title;
  return make("table", {}, make("caption", { textContent: caption }), make("thead", {}, head), make("tbody", {}, ...body));
}
