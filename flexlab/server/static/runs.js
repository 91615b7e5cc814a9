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
  if (!kind || !heading.textContent.trim()) return;
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

const bar = document.getElementById("compare");
const compare = bar.querySelector("button");
const boxes = [...document.querySelectorAll("input[form=compare]")];
const most = Number(compare.dataset.most);

function count() {
  const chosen = boxes.filter((box) => box.checked).length;
  compare.disabled = chosen < 2 || chosen > most;
  compare.textContent = chosen ? `Compare ${chosen}` : "Compare";
  compare.title = chosen > most ? `At most ${most} runs can be compared at once` :
    chosen < 2 ? "Choose two runs or more in the table" : "";
  for (const button of bar.querySelectorAll("button[data-least]")) {
    button.disabled = chosen < 1;
    button.title = chosen ? "" : "Choose runs in the table";
  }
}

for (const box of boxes) box.addEventListener("change", count);
bar.addEventListener("keydown", (event) => {
  // Enter in a field of the bar means the button beside it, not the bar's first one.
  if (event.key !== "Enter" || event.target.tagName !== "INPUT") return;
  event.preventDefault();
  event.target.closest(".ask")?.querySelector("button").click();
});
// Going back in the browser brings the choice back, too.
window.addEventListener("pageshow", count);
count();

search.addEventListener("input", find);
for (const heading of table.tHead.rows[0].cells) {
  heading.tabIndex = heading.dataset.sort && heading.textContent.trim() ? 0 : -1;
  heading.addEventListener("click", () => sort(heading));
  heading.addEventListener("keydown", (event) => event.key === "Enter" && sort(heading));
}
find();
