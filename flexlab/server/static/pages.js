// What the pages of runs, studies and comparisons do in the browser. Each block looks for its own part of the page.

// Open panels lie within the window, and close on Escape and on a click elsewhere.
{
  const EDGE = 12; // px between a panel and the window's edge
  const fit = (event) => {
    const panel = event.target.matches?.("details.pop[open]") && event.target.querySelector(":scope > :not(summary)");
    if (!panel) return;
    panel.style.translate = "";
    const { left, right } = panel.getBoundingClientRect();
    const shift = Math.max(Math.min(document.documentElement.clientWidth - EDGE - right, 0), EDGE - left);
    if (shift) panel.style.translate = `${shift}px`;
  };
  document.addEventListener("toggle", fit, true); // It does not bubble.
  const closeAll = (except) => {
    for (const panel of document.querySelectorAll("details.pop[open]")) if (panel !== except) panel.open = false;
  };
  document.addEventListener("click", (event) => closeAll(event.target.closest("details.pop")));
  document.addEventListener("keydown", (event) => {
    const panel = event.key === "Escape" && document.querySelector("details.pop[open]");
    if (!panel) return;
    closeAll();
    panel.querySelector("summary").focus();
  });
}

// A second click on the button of a form that is on its way would begin the same work again.
{
  const SAME_CLICK = 1000; // ms
  const sent = new WeakMap(); // button → when it sent its form
  addEventListener("submit", (event) => {
    const button = event.submitter, now = performance.now();
    if (!button || event.defaultPrevented) return; // A script sends this form.
    if (now - sent.get(button) < SAME_CLICK) event.preventDefault();
    else sent.set(button, now);
  });
}

// A typed name counts even if its writer goes on by a preset's card or another link instead of the form's buttons.
{
  const field = document.querySelector('form[action$="/name"] [name="name"]');
  let sent = null; // while the name is on its way
  field?.addEventListener("change", () => {
    const body = new URLSearchParams({ name: field.value });
    sent = fetch(field.form.action, { method: "POST", body, keepalive: true, redirect: "manual" })
      .then((answer) => answer.type === "opaqueredirect", () => true);
  });
  if (field) addEventListener("click", async (event) => {
    const link = event.target.closest?.("a[href]");
    if (!sent || !link || event.ctrlKey || event.metaKey || event.shiftKey) return;
    event.preventDefault();
    if (await sent) location.assign(link.href);
    else field.form.requestSubmit(); // The server says what is wrong with the name.
  });
}

// Tasks under way: shows their progress and reloads the page when they end, unless the page is to stay.
{
  const LOOK = 600; // ms between two requests
  const look = async (line, said) => {
    let state = { working: true };
    try {
      const answer = await fetch(line.dataset.address, { cache: "no-store" });
      // A new server does not know it, or wants its new token: the page says so.
      if ([401, 403, 404].includes(answer.status)) return location.reload();
      if (answer.ok) state = await answer.json();
    } catch {
      state.sentence = "The server does not answer.";
    }
    if (!state.working && line.dataset.stays === undefined) return location.reload();
    if (state.sentence && state.sentence !== said) line.textContent = state.sentence;
    line.dataset.kind = state.kind ?? "";
    line.dispatchEvent(new CustomEvent("progress", { detail: state }));
    const bar = line.previousElementSibling;
    bar.value = Math.max(bar.value, state.share ?? 0);
    bar.hidden = !state.working;
    if (state.working) setTimeout(() => look(line, state.sentence ?? said), LOOK);
  };
  for (const line of document.querySelectorAll(".progress[data-working]")) look(line);
}

// A file that is too large is refused before it is sent; while one is being sent, the button says so.
{
  const form = document.getElementById("import");
  const button = form?.querySelector("button"), problem = form?.querySelector(".problem");
  form?.addEventListener("submit", (event) => {
    const [file] = form.elements.file.files;
    const largest = Number(form.dataset.largest);
    problem.hidden = !(file && file.size > largest);
    if (!problem.hidden) {
      event.preventDefault();
      problem.textContent = `${file.name} has ${(file.size / 1e9).toPrecision(3)} GB, over ${(largest / 1e9)} GB: ` +
        "export a shorter range of time, or put a recording (.rrd) into the logs folder yourself.";
      return;
    }
    button.disabled = true;
    button.textContent = "Importing …";
  });
  if (form) window.addEventListener("pageshow", () => {
    button.disabled = false;
    button.textContent = "Import";
  });
}

// Rerun's viewer needs the recording's full address, which only the browser knows for sure.
{
  const viewer = document.getElementById("viewer");
  if (viewer) {
    const base = document.currentScript.src.replace(/\/static\/[^/]*$/, "");
    const recording = new URL(viewer.dataset.recording, location.href).href;
    viewer.src = `${base}/viewer/?url=${encodeURIComponent(recording)}&hide_welcome_screen&renderer=webgl`;
  }
  // Continue starts from the viewer's cursor, unless another time was typed.
  const time = document.querySelector('form[action$="/continue"] [name="time"]');
  const LONGEST = 1e15; // ns: later times are the clock's
  const end = +viewer?.dataset.end || Infinity; // s: a playing viewer goes a little past it before it stops
  let counting = false; // Whether the viewer shows a count instead of a time; it does not always report its first timeline.
  let typed = false;
  time?.addEventListener("input", () => { typed = time.value !== ""; });
  addEventListener("message", (message) => {
    if (!time || typed || message.source !== viewer?.contentWindow || message.origin !== location.origin) return;
    let event;
    try { event = JSON.parse(message.data); } catch { return; } // "READY", the viewer's first message
    if (event?.type === "timeline_change") counting = event.timeline === "log_tick";
    else if (event?.type !== "time_update") return;
    if (counting || event.time > LONGEST) return;
    const told = (event.time / 1e9).toFixed(3);
    time.value = +told < end ? told : viewer.dataset.end;
  });
}

// The library's table: search as you type, sort by a click on a heading, choose runs.
const library = document.getElementById("runs");
if (library) {
  const body = library.tBodies[0], rows = [...body.rows], headings = [...library.tHead.rows[0].cells];
  const search = document.getElementById("search");
  const find = () => {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of rows) {
      const text = row.textContent.toLowerCase(); // as it is shown now, in any language
      row.hidden = !words.every((word) => text.includes(word));
    }
    document.getElementById("nothing").hidden = rows.some((row) => !row.hidden);
  };
  const key = (row, column) => row.cells[column].dataset.key ?? row.cells[column].textContent.trim().toLowerCase();
  const sort = (heading) => {
    const down = heading.getAttribute("aria-sort") === "ascending", column = heading.cellIndex;
    for (const other of headings) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", down ? "descending" : "ascending");
    rows.sort((a, b) => {
      const [p, q] = [key(a, column), key(b, column)];
      return (down ? -1 : 1) * (heading.dataset.sort === "number" ? p - q : p.localeCompare(q));
    });
    body.append(...rows);
  };
  const bar = document.getElementById("compare"), compare = bar.querySelector("button");
  const boxes = [...document.querySelectorAll("input[form=compare]")];
  const most = Number(compare.dataset.most);
  const count = () => {
    const chosen = boxes.filter((box) => box.checked).length;
    compare.disabled = chosen < 2 || chosen > most;
    compare.textContent = chosen ? `Compare ${chosen}` : "Compare";
    compare.title = chosen > most ? `At most ${most} runs can be compared at once` :
      chosen < 2 ? "Choose two runs or more in the table" : "";
    for (const button of bar.querySelectorAll("button[data-least]")) {
      button.disabled = chosen < 1;
      button.title = chosen ? "" : "Choose runs in the table";
    }
  };
  for (const box of boxes) box.addEventListener("change", count);
  bar.addEventListener("keydown", (event) => {
    // Enter in a field of the bar presses the button beside it, not the bar's first one.
    if (event.key !== "Enter" || event.target.tagName !== "INPUT") return;
    event.preventDefault();
    event.target.closest(".ask")?.querySelector("button").click();
  });
  window.addEventListener("pageshow", count); // Going back in the browser restores the choice, too.
  count();
  search.addEventListener("input", find);
  for (const heading of headings) {
    heading.tabIndex = heading.dataset.sort && heading.textContent.trim() ? 0 : -1;
    if (heading.tabIndex < 0) continue;
    heading.addEventListener("click", () => sort(heading));
    heading.addEventListener("keydown", (event) => {
      if (!["Enter", " "].includes(event.key)) return;
      event.preventDefault(); // Space would scroll.
      sort(heading);
    });
  }
  find();
}

// The forms of the page of studies: choosing a field fills in its range and shows its present value and its limits.
for (const fieldset of document.querySelectorAll("fieldset.axis")) {
  const field = fieldset.querySelector("select[name^=field]");
  if (!field) continue;
  const part = (name) => fieldset.querySelector(`[name^=${name}]`);
  const say = () => {
    const { now, allowed, choice } = field.selectedOptions[0].dataset;
    fieldset.querySelector(".allowed").textContent = now === undefined ? "" :
      choice ? `Now ${now}; ticked words are compared.` : `Now ${now}; allowed: ${allowed}.`;
    for (const input of fieldset.querySelectorAll("label > input:not([name^=words])")) {
      input.disabled = !field.value || Boolean(choice);
      input.parentElement.hidden = Boolean(choice);
    }
    for (const group of fieldset.querySelectorAll(".words")) {
      group.hidden = group.dataset.field !== field.value;
      for (const box of group.querySelectorAll("input")) box.disabled = group.hidden;
    }
  };
  field.addEventListener("change", () => {
    const { low = "", high = "", log } = field.selectedOptions[0].dataset;
    part("low").value = low;
    part("high").value = high;
    part("log").checked = Boolean(log);
    say();
  });
  say();
}
// Problems are shown below the form, which keeps what was typed.
for (const form of document.querySelectorAll(".study-form form")) {
  const button = form.querySelector("button"), problem = form.querySelector(".problem");
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    button.disabled = true;
    try {
      const answer = await fetch(form.action, { method: "POST", body: new URLSearchParams(new FormData(form)) });
      if (answer.redirected) return location.assign(answer.url);
      const page = new DOMParser().parseFromString(await answer.text(), "text/html");
      problem.textContent = page.querySelector(".message p")?.textContent ?? "The server does not answer.";
    } catch {
      problem.textContent = "The server does not answer.";
    }
    problem.hidden = false;
    button.disabled = false;
  });
  addEventListener("pageshow", () => { button.disabled = false; }); // Going back in the browser restores the disabled one.
}
{
  const source = document.getElementById("source");
  if (source) source.querySelector("button").hidden = true;
  source?.querySelector("select").addEventListener("change", () => source.requestSubmit());
}
