// What a page can do more where scripts run: sorting and filtering of long tables, two columns of many
// beside each other, values under the pointer in figures. Without them all is there to be read.
"use strict";
const LONG = 12, WIDE = 5;

const made = (tag, more, ...children) => {
  const one = Object.assign(document.createElement(tag), more);
  one.append(...children);
  return one;
};

// Number at the start of a cell, or its words: names come behind numbers.
const key = cell => {
  const text = (cell ? cell.textContent : "").trim().replace(/\u2212/g, "-").replace(/,(?=\d{3})/g, "");
  const number = /^(?:below |< )?(-?[\d.]+(?:e-?\d+)?)/.exec(text);
  return number ? [0, parseFloat(number[1]), text] : [text ? 1 : 2, 0, text];
};

const compared = (a, b) => a[0] - b[0] || a[1] - b[1] || a[2].localeCompare(b[2]);

function sortable(table) {
  const body = table.tBodies[0], first = [...body.rows];
  [...table.tHead.rows[0].cells].forEach((head, k) => {
    const sort = () => {
      const next = {none: "ascending", ascending: "descending", descending: "none"};
      const way = next[head.getAttribute("aria-sort") || "none"];
      for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
      if (way !== "none") head.setAttribute("aria-sort", way);
      const rows = first.filter(row => way === "none" || !row.classList.contains("group"));
      const keys = new Map(rows.map(row => [row, key(row.cells[k])]));
      if (way !== "none") rows.sort((a, b) => compared(keys.get(a), keys.get(b)));
      if (way === "descending") rows.reverse();
      body.replaceChildren(...rows);
    };
    head.tabIndex = 0;
    head.className += " sorts";
    head.title = "sort";
    head.addEventListener("click", sort);
    head.addEventListener("keydown", event => event.key === "Enter" && sort());
  });
}

function filtered(table) {
  const field = made("input", {type: "search", placeholder: "filter rows"});
  field.setAttribute("aria-label", "filter rows");
  field.addEventListener("input", () => {
    const words = field.value.toLowerCase().split(/\s+/);
    for (const row of table.tBodies[0].rows) {
      const text = row.textContent.toLowerCase();
      row.classList.toggle("away", !words.every(word => text.includes(word)));
    }
  });
  return field;
}

// Of many alike columns, two: the others go away.
function beside(table) {
  const heads = [...table.tHead.rows[0].cells].map(head => head.textContent.trim());
  const choices = ["all", "first", "second"].map((word, n) => n && made("select", {title: `${word} column`},
    made("option", {value: ""}, n === 1 ? "all columns" : "and"),
    ...heads.slice(1).map((head, k) => made("option", {value: k + 1}, head)))).slice(1);
  const choose = () => {
    const kept = choices.map(one => +one.value).filter(Boolean);
    for (const row of table.rows) [...row.cells].forEach((cell, k) => {
      cell.classList.toggle("away", kept.length > 0 && k > 0 && !kept.includes(k));
    });
  };
  for (const one of choices) {
    one.setAttribute("aria-label", one.title);
    one.addEventListener("change", choose);
  }
  return choices;
}

for (const scroll of document.querySelectorAll(".scroll")) {
  const table = scroll.querySelector("table");
  if (!table.tHead) continue;
  const tools = [];
  if (table.tBodies[0].rows.length >= LONG) {
    if ([...table.tBodies[0].rows].every(row => row.cells[0].textContent.trim())) sortable(table);
    tools.push(filtered(table));
  }
  if (scroll.hasAttribute("data-beside") && table.tHead.rows[0].cells.length > WIDE) tools.push(...beside(table));
  if (tools.length) scroll.before(made("div", {className: "tools"}, ...tools));
}

// What the place under the pointer stands for: a value, or the name of the nearest tick.
const value = (scale, part) => {
  const [title, log, low, high, names] = scale;
  const at = log ? low * (high / low) ** part : low + (high - low) * part;
  if (names.length) return names.reduce((a, b) => (Math.abs(b[0] - at) < Math.abs(a[0] - at) ? b : a))[1];
  const digits = `${+at.toPrecision(3)}`.replace(/-/g, "\u2212");
  return title ? `${title}: ${digits}` : digits;
};

const hover = made("div", {className: "told"});
hover.ariaHidden = "true";
document.body.append(hover);
for (const svg of document.querySelectorAll("svg[data-scales]")) {
  const [[left, top, width, height], x, y] = JSON.parse(svg.dataset.scales);
  svg.addEventListener("pointermove", event => {
    const place = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    const parts = [(place.x - left) / width, 1 - (place.y - top) / height];
    const inside = parts.every(part => part >= 0 && part <= 1) && !event.target.closest(".said");
    hover.textContent = inside ? [x, y].flatMap((scale, k) => (scale ? value(scale, parts[k]) : [])).join(" \u00b7 ") : "";
    hover.style.left = `${Math.min(event.clientX + 12, innerWidth - hover.offsetWidth - 4)}px`;
    hover.style.top = `${event.clientY + 14}px`;
  });
  svg.addEventListener("pointerleave", () => (hover.textContent = ""));
}

// Paper shows what is folded.
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach(one => (one.open = true)));
