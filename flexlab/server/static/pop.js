// Opened panels close by Escape and by a click elsewhere.
function closeAll(except) {
  for (const panel of document.querySelectorAll("details.pop[open]")) if (panel !== except) panel.open = false;
}

document.addEventListener("click", (event) => closeAll(event.target.closest("details.pop")));
document.addEventListener("keydown", (event) => {
  const panel = event.key === "Escape" && document.querySelector("details.pop[open]");
  if (!panel) return;
  closeAll();
  panel.querySelector("summary").focus();
});
