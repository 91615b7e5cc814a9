// A file that is too large is refused before it is sent; while one is being sent, the button says so.
const form = document.getElementById("import");
const button = form.querySelector("button");
const problem = form.querySelector(".problem");

form.addEventListener("submit", (event) => {
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
window.addEventListener("pageshow", () => {
  button.disabled = false;
  button.textContent = "Import";
});
