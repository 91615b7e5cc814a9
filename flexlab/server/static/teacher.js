// The teacher's page: one tile per lab, updated every 0.4 s while the page is visible.
const LOOK = 400, PATIENCE = 5000; // ms between two requests, and for one answer: a broken line gives none for minutes
const base = document.currentScript.src.replace(/\/static\/[^/]*$/, ""); // A proxy may put a path before ours.
const list = document.getElementById("labs");
const template = document.getElementById("tile");
const form = document.getElementById("class");
const said = document.getElementById("said");
const rules = document.getElementById("rules");
const tiles = new Map();
let changing = 0; // Changes of the rules that the server has not confirmed; meanwhile the rules that it sends may be old.
const DIGITS = { time: 1, error: 2 };

function write(node, text) {
  // Names and titles are visitors' own words: they become text, never HTML. The page may show them in another language.
  if ((window.flexlabEnglish?.(node) ?? node.textContent) !== text) node.textContent = text;
}

// The count of each answer, as bars and as numbers.
function showQuestions(questions) {
  const places = document.getElementById("questions");
  const now = JSON.stringify(questions);
  if (places.dataset.shown === now) return;
  places.dataset.shown = now;
  places.replaceChildren(...questions.map((asked) => {
    const table = document.getElementById("question").content.cloneNode(true).firstElementChild;
    const given = asked.options.reduce((sum, option) => sum + option.count, 0);
    const question = document.createElement("b");
    question.textContent = asked.question;
    table.caption.append(asked.lesson, question, `${given} of ${asked.of} ${asked.of === 1 ? "lab has guessed" : "labs have guessed"}`);
    for (const option of asked.options) {
      const row = table.tBodies[0].insertRow();
      const name = document.createElement("th");
      name.scope = "row";
      name.textContent = option.right ? `✓ ${option.text} (right)` : option.text;
      const bar = document.createElement("span");
      bar.className = "answer-bar";
      bar.style.width = `${(100 * option.count) / Math.max(asked.of, 1)}%`;
      row.append(name);
      row.classList.toggle("right-answer", option.right);
      row.insertCell().append(bar, String(option.count));
    }
    return table;
  }));
}

function showRules(now) {
  for (const [name, value] of Object.entries(now)) {
    const control = rules.elements[name];
    if (typeof value === "boolean") control.checked = value;
    else control.value = value;
  }
  rules.elements.step.disabled = !now.lesson;
}

function made(lab) {
  const tile = template.content.cloneNode(true).firstElementChild;
  tile.querySelector("a").href = `${base}${lab.lab}/`;
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
    hold.setAttribute("formaction", `${base}/teacher/${paused ? "resume" : "pause"}`);
  }
  write(document.getElementById("count"), labs.length ? `${labs.length} ${labs.length === 1 ? "lab" : "labs"}` : "");
  document.getElementById("nobody").hidden = labs.length > 0;
}

async function look() {
  if (document.hidden) return;
  try {
    const answer = await fetch(`${base}/teacher/labs`, { cache: "no-store", signal: AbortSignal.timeout(PATIENCE) });
    if ([401, 403].includes(answer.status)) return location.reload(); // A restarted server may want another token.
    if (!answer.ok) throw new Error(answer.statusText);
    const told = await answer.json();
    show(told.labs);
    showQuestions(told.questions);
    if (!changing) showRules(told.rules);
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

async function send(address, body) {
  try {
    const answer = await fetch(address, { method: "POST", body, headers: { Accept: "application/json" } });
    write(said, answer.ok ? (await answer.json()).sentence : "That did not work: reload this page.");
  } catch {
    write(said, "The server does not answer.");
  }
}

form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const button = event.submitter;
  const body = new URLSearchParams(new FormData(form, button));
  const address = button.getAttribute("formaction");
  if (!body.get("lab") && !confirm(button.dataset.ask)) return;
  await send(address, body);
  look();
});

// A switch acts at once; the page's next request shows the rules in force.
rules.addEventListener("change", async () => {
  changing += 1;
  rules.elements.step.disabled = false; // Disabled controls are not sent.
  await send(rules.action, new URLSearchParams(new FormData(rules)));
  changing -= 1;
  look();
});

document.addEventListener("visibilitychange", look);
follow();
