// The library's table: search as you type, sort by a click on a heading.
const table = document.getElementById("runs");
const body = table.tBodies[0];
const rows = [...body.rows];
const texts = new Map(rows.map((row) => [row, row.textContent.toLowerCase()]));
const search = document.getElementById("search");

function find() {
  const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
  let found = 0;
  for (const row of rows) {
    row.hidden = !words.every((word) => texts.get(row).includes(word));
    found += !row.hidden;
  }
  document.getElementById("nothing").hidden = found > 0;
}

function key(row, column) {
  const cell = row.cells[column];
  return cell.dataset.key ?? cell.textContent.trim().toLowerCase();
}

function sort(heading) {
  const kind = heading.dataset.sort;
  if (!kind || !heading.textContent) return;
  const down = heading.getAttribute("aria-sort") === "ascending";
  for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
  heading.setAttribute("aria-sort", down ? "descending" : "ascending");
  const column = heading.cellIndex;
  rows.sort((a, b) => {
    const [p, q] = [key(a, column), key(b, column)];
    return (down ? -1 : 1) * (kind === "number" ? p - q : p.localeCompare(q));
  });
  body.append(...rows);
}

search.addEventListener("input", find);
for (const heading of table.tHead.rows[0].cells) {
  heading.tabIndex = heading.textContent ? 0 : -1;
  heading.addEventListener("click", () => sort(heading));
  heading.addEventListener("keydown", (event) => event.key === "Enter" && sort(heading));
}
find();
