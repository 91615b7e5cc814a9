// While the table is being computed, tell how far it is; show it when it is done.
const progress = document.getElementById("progress");
const LOOK = 600; // ms between two looks

async function look() {
  let state = { working: true };
  try {
    const answer = await fetch(progress.dataset.address, { cache: "no-store" });
    if (answer.ok) state = await answer.json();
  } catch {
    // The server may be busy: look again.
  }
  if (!state.working) {
    location.reload();
    return;
  }
  if (state.sentence) progress.textContent = state.sentence;
  setTimeout(look, LOOK);
}

if (progress.dataset.working) look();
