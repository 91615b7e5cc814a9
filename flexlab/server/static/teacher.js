// The teacher's page: one tile per lab, brought up to date every 0.4 s while somebody looks at the page.
const LOOK = 400; // ms
const list = document.getElementById("labs");
const template = document.getElementById("tile");
const form = document.getElementById("class");
const said = document.getElementById("said");
const tiles = new Map();
const DIGITS = { time: 1, error: 2 };

function write(node, text) {
  // Names and titles are visitors' own words: they become text, never HTML.
  if (node.textContent !== text) node.textContent = text;
}

function made(lab) {
  const tile = template.content.cloneNode(true).firstElementChild;
  tile.querySelector("a").href = `${lab.lab}/`;
  for (const button of tile.querySelectorAll("button")) button.value = lab.lab;
  list.append(tile);
  return { tile, hold: tile.querySelector(".hold"), fields: [...tile.querySelectorAll("[data-field]")] };
}

function show(labs) {
  const present = new Set(labs.map((lab) => lab.lab));
  for (const [key, { tile }] of tiles) {
    if (!present.has(key)) { tile.remove(); tiles.delete(key); }
  }
  for (const lab of labs) {
    if (!tiles.has(lab.lab)) tiles.set(lab.lab, made(lab));
    const { tile, hold, fields } = tiles.get(lab.lab);
    for (const node of fields) {
      const value = lab[node.dataset.field];
      write(node, typeof value === "number" ? value.toFixed(DIGITS[node.dataset.field] ?? 0) : value);
    }
    tile.dataset.state = lab.state;
    tile.classList.toggle("unseen-lab", !lab.watching);
    const paused = lab.state === "paused";
    write(hold, paused ? "Resume" : "Pause");
    hold.setAttribute("formaction", paused ? "/teacher/resume" : "/teacher/pause");
  }
  write(document.getElementById("count"), labs.length ? `${labs.length} ${labs.length === 1 ? "lab" : "labs"}` : "");
  document.getElementById("nobody").hidden = labs.length > 0;
}

async function look() {
  if (document.hidden) return;
  try {
    const answer = await fetch("/teacher/labs", { cache: "no-store" });
    if (!answer.ok) throw new Error(answer.statusText);
    show(await answer.json());
    if (list.classList.contains("stale")) write(said, "");
    list.classList.remove("stale");
  } catch {
    list.classList.add("stale");
    write(said, "The server does not answer: what you see is old.");
  }
}

async function follow() {
  await look();
  setTimeout(follow, LOOK);
}

form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const button = event.submitter;
  const body = new URLSearchParams(new FormData(form, button));
  const address = button.getAttribute("formaction");
  if (!body.get("lab") && !confirm(button.dataset.ask)) return;
  try {
    const answer = await fetch(address, { method: "POST", body, headers: { Accept: "application/json" } });
    write(said, answer.ok ? (await answer.json()).sentence : "That did not work: reload this page.");
  } catch {
    write(said, "The server does not answer.");
  }
  look();
});

document.addEventListener("visibilitychange", look);
follow();
