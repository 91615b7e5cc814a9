// Work that goes on: tells how far it is, and reloads the page when it is over, unless the page would lose by it.
const LOOK = 600; // ms between two looks

async function look(line) {
  let state = { working: true };
  try {
    const answer = await fetch(line.dataset.address, { cache: "no-store" });
    if (answer.status === 404) return location.reload(); // a new server does not know it: the page says so
    if (answer.ok) state = await answer.json();
  } catch {
    state.sentence = "The server does not answer.";
  }
  if (!state.working && line.dataset.stays === undefined) return location.reload();
  if (state.sentence) line.textContent = state.sentence;
  line.dataset.kind = state.kind ?? "";
  line.dispatchEvent(new CustomEvent("progress", { detail: state }));
  if (state.working) setTimeout(() => look(line), LOOK);
}

for (const line of document.querySelectorAll(".progress[data-working]")) look(line);
