// Tables that can be sorted and saved, figures that can be enlarged and saved. Nothing is fetched.
"use strict";

// A cell's number, or its text: "1,234", "3.2e-4", "✓ 12,800", "87 %" are numbers.
function valueOf(cell) {
  const text = cell.textContent.trim();
  const number = parseFloat(text.replace(/^[✓✗]\s*/, "").replace(/,/g, ""));
  return Number.isNaN(number) ? text : number;
}

function compare(a, b) {
  if (a === "" || b === "") return (a === "") - (b === "");
  if (typeof a === typeof b) return a < b ? -1 : a > b ? 1 : 0;
  return typeof a === "number" ? -1 : 1;
}

function sortBy(table, column, heading) {
  const down = heading.getAttribute("aria-sort") === "ascending";
  for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
  heading.setAttribute("aria-sort", down ? "descending" : "ascending");
  const body = table.tBodies[0];
  const rows = [...body.rows].map((row) => [valueOf(row.cells[column]), row]);
  rows.sort(([a], [b]) => (a === "" || b === "" || !down ? compare(a, b) : compare(b, a)));
  for (const [, row] of rows) body.append(row);
}

function save(name, href) {
  const link = document.createElement("a");
  link.download = name;
  link.href = href;
  link.textContent = name;
  return link;
}

function asCsv(text) {
  return "data:text/csv;charset=utf-8," + encodeURIComponent(text + "\n");
}

function csvOf(table) {
  const plain = (cell) => cell.textContent.trim().replace(/(\d),(?=\d{3})/g, "$1");
  const quote = (cell) => `"${plain(cell).replaceAll('"', '""')}"`;
  const lines = [...table.rows].map((row) => [...row.cells].map(quote).join(","));
  return asCsv(lines.join("\n"));
}

// Name of a figure or table: the mesh and the heading above it.
function nameOf(element, seen) {
  let mesh = "", title = "";
  for (const heading of document.querySelectorAll("h2, h3, summary")) {
    if (!(heading.compareDocumentPosition(element) & Node.DOCUMENT_POSITION_FOLLOWING)) break;
    if (heading.tagName === "H2") [mesh, title] = [heading.textContent, ""];
    else title = heading.textContent;
  }
  const stem = [mesh, title].filter(Boolean).join("-").toLowerCase().replace(/[^a-z0-9_-]+/g, "-").replace(/-$/, "");
  seen.set(stem, (seen.get(stem) || 0) + 1);
  return seen.get(stem) > 1 ? `${stem}-${seen.get(stem)}` : stem;
}

function tools(...links) {
  const line = document.createElement("p");
  line.className = "tools";
  line.append("save:");
  for (const link of links) line.append(" ", link);
  return line;
}

const names = new Map();
for (const table of document.querySelectorAll("table")) {
  if (!table.tHead) continue;
  // columns that mix units, as in the paper's tables, cannot be sorted
  if (!table.classList.contains("fixed")) [...table.tHead.rows[0].cells].forEach((heading, column) => {
    heading.tabIndex = 0;
    heading.title = "sort";
    heading.addEventListener("click", () => sortBy(table, column, heading));
    heading.addEventListener("keydown", (event) => {
      if (event.key === "Enter") sortBy(table, column, heading);
    });
  });
  const link = save(`${nameOf(table, names)}.csv`, "#");
  link.addEventListener("click", () => (link.href = csvOf(table)));
  (table.closest(".wide") || table).after(tools(link));
}
for (const image of document.querySelectorAll("figure img")) {
  const name = nameOf(image, names), { pdf, csv } = image.dataset;
  const links = [save(`${name}.svg`, image.src), save(`${name}.pdf`, pdf)];
  if (csv) links.push(save(`${name}-numbers.csv`, asCsv(csv)));
  image.closest("figure").append(tools(...links));
  image.addEventListener("click", () => image.classList.toggle("large"));
  image.title = "enlarge, or restore the size";
}
// Nothing is folded when the page is printed.
let folded = [];
addEventListener("beforeprint", () => {
  folded = [...document.querySelectorAll("details:not([open])")];
  for (const part of folded) part.open = true;
});
addEventListener("afterprint", () => folded.forEach((part) => (part.open = false)));
// A link to folded sections unfolds them.
for (const link of document.querySelectorAll('a[href="#reading"]'))
  link.addEventListener("click", () => {
    for (const part of document.querySelectorAll("#reading ~ details")) part.open = true;
  });
