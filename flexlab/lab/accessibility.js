// Adds what viser's page lacks for keyboards and screen readers: names, values with units, texts for pictures, landmarks.
(() => {
  const LOOK = 100, CALM = 1000; // ms between two checks: of changing values, and of what rarely changes
  const ICONS = { "list-search": "Commands (Ctrl+K)", adjustments: "Connection and scene", "arrow-back": "Back to the controls",
    maximize: "Enlarge the plot" };
  const REGIONS = { '[data-dock-region="right"]': "Controls", '[data-dock-region="left"]': "Guide",
    "[data-floating-window]": "Plots" };
  const PRESSED = "data-fl-pressed"; // marks parts that react to Enter and Space like a button

  // The English text of a part, or of its attribute, in any shown language.
  const english = (part, name) => window.flexlabEnglish?.(part, name) ?? (name ? part.getAttribute(name) : part.textContent);

  function mark(part, attributes) {
    for (const [name, value] of Object.entries(attributes)) {
      if (part && english(part, name) !== value) part.setAttribute(name, value);
    }
  }

  function all(selector, name) {
    for (const part of document.querySelectorAll(selector)) name(part);
  }

  const widget = (label) => label?.closest(".mantine-Flex-root")?.parentElement;
  let labels = new Map();
  const labelled = (part) => labels.get(part?.id);

  // A label is "name (unit)"; the slider of a quantity is called "name, slider" and is below its box.
  function parts(label) {
    const text = label ? english(label) : "";
    const [, name, unit] = text.match(/^(.*) \(([^()]*)\)$/) ?? [null, text, ""];
    return { text, name: name.replace(/, slider$/, ""), unit };
  }

  function nameSlider(thumb) {
    const slider = thumb.closest(".mantine-Slider-root");
    const own = labelled(slider), above = widget(own)?.previousElementSibling;
    let box = slider.parentElement.querySelector(".mantine-NumberInput-input"), said = parts(own);
    if (said.text.endsWith(", slider") && above) {
      box = above.querySelector(".mantine-NumberInput-input") ?? box;
      const whole = parts(labelled(box)).text;
      if (whole.startsWith(said.name)) said = { ...said, unit: whole.slice(said.name.length).replace(/^ \((.*)\)$/, "$1") };
    }
    const ago = -Number(thumb.getAttribute("aria-valuenow"));
    const value = said.name !== "Look back" ? `${box?.value ?? ""} ${said.unit}`.trim()
      : ago > 0 ? `${Number(ago.toFixed(3))} s ago` : "now";
    mark(thumb, { "aria-label": said.name, "aria-valuetext": value });
  }

  // Several numbers of one field share one label, which belongs to the first of them.
  function nameBoxes(first) {
    const boxes = [...first.closest(".mantine-Flex-root").querySelectorAll(".mantine-NumberInput-input")];
    const label = labelled(first);
    if (!label || boxes.length < 2) return;
    const { text } = parts(label);
    const listed = text.match(/\(([^()]*,[^()]*)\)/)?.[1].split(",") ?? [];
    boxes.forEach((box, index) => mark(box, {
      "aria-label": listed.length === boxes.length ? `${text}, ${listed[index].trim()}` : `${text}, ${index + 1} of ${boxes.length}` }));
  }

  // The label of a text field refers to no element.
  function nameText(input) {
    const label = input.closest(".mantine-Flex-root")?.querySelector("label");
    if (label) mark(input, { "aria-label": english(label) });
  }

  function nameButton(button) {
    const icon = [...button.querySelector("svg")?.classList ?? []].map((word) => ICONS[word.replace("tabler-icon-", "")]);
    const name = icon.find(Boolean);
    if (name) mark(button, { "aria-label": name });
    if (button.classList.contains("mantine-CloseButton-root")) mark(button, { "aria-label": "Close" });
    if (button.textContent.trim() !== "↺") return;
    const field = button.parentElement.previousElementSibling?.querySelector("label");
    mark(button, { "aria-label": `${parts(field).name}: back to its usual value` });
  }

  function nameFolder(head) {
    const open = head.querySelector(".tabler-icon-chevron-up") !== null;
    mark(head, { role: "button", tabindex: "0", "aria-expanded": String(open), [PRESSED]: "" });
    mark(head.parentElement, { role: "group", "aria-label": english(head) });
  }

  function tellChart({ chart }) {
    const values = [...chart.root.querySelectorAll(".u-legend .u-series:not(.fl-unnamed)")].map((row) =>
      `${english(row.querySelector(".u-label"))}: ${row.querySelector(".u-value").textContent}`);
    const title = [...chart.root.querySelectorAll(".u-title")].map((part) => english(part))[0] ?? "Plot";
    mark(chart.root.querySelector("canvas"), { role: "img", "aria-label": `${title}. ${values.join("; ")}` });
    for (const word of chart.root.querySelectorAll(".u-legend .u-series:not(:first-child):not(.fl-unnamed) .u-label")) {
      const shown = !word.closest(".u-series").classList.contains("u-off");
      mark(word, { role: "button", tabindex: "0", "aria-pressed": String(shown), [PRESSED]: "" });
    }
  }

  const [banner, heading, live] = ["header", "h1", "p"].map((tag) => document.createElement(tag));
  banner.className = live.className = "fl-unseen";
  banner.append(heading);
  mark(live, { role: "status", "aria-live": "polite" });
  let told;

  function tellCalmly() {
    if (document.hidden) return;
    const charts = Object.values(window.__viserTestpoints?.uplots ?? {});
    for (const entry of charts) if (entry.chart.root.offsetParent !== null) tellChart(entry);
    const summary = document.querySelector(".fl-summary")?.dataset.text;
    const scene = document.querySelector("canvas[data-engine]");
    if (summary) mark(scene, { role: "img", "aria-label": summary });
    if (heading.textContent !== document.title) heading.textContent = document.title;
    mark(document.getElementById("root"), { role: "main" });
    all("[data-dock-root] canvas", (canvas) => {
      if (scene && canvas !== scene && !canvas.closest(".uplot")) mark(canvas, { "aria-hidden": "true" });
    });
    for (const [selector, name] of Object.entries(REGIONS)) {
      all(selector, (region) => mark(region, { role: "region", "aria-label": name }));
    }
    // The labels of a folded panel open it too; a list of tabs may hold only tabs.
    all('[role="tablist"][data-dock-bar] > [role="button"]', (button) => mark(button, { "aria-hidden": "true", tabindex: "-1" }));
    all(".mantine-ScrollArea-viewport, [data-dock-scroll]", (part) => {
      if (part.scrollHeight > part.clientHeight + 1) mark(part, { tabindex: "0" });
    });
    all(".mantine-Paper-root > .mantine-Paper-root:first-child:has(+ *)", nameFolder);
  }

  let due = false;

  function look() {
    due = false;
    if (document.hidden) return;
    labels = new Map([...document.getElementsByTagName("label")].map((label) => [label.htmlFor, label]));
    all('[role="slider"]', nameSlider);
    all(".mantine-Flex-root > .mantine-NumberInput-root:first-child .mantine-NumberInput-input[id]", nameBoxes);
    all(".mantine-TextInput-input, .mantine-Textarea-input", nameText);
    all(".mantine-ActionIcon-root, .mantine-CloseButton-root, button[data-block]", nameButton);
    const { said, count } = document.querySelector(".fl-reports")?.dataset ?? {};
    if (count !== undefined && count !== told) live.textContent = said;
    told = count;
  }

  addEventListener("keydown", (event) => {
    const pressed = [" ", "Enter"].includes(event.key) && event.target.closest?.(`[${PRESSED}]`);
    if (!pressed) return;
    event.preventDefault();
    event.stopPropagation();
    pressed.click();
  }, true);
  addEventListener("click", () => setTimeout(tellCalmly, 0)); // Folders and curves report at once whether they are open.
  addEventListener("DOMContentLoaded", () => {
    document.body.prepend(banner);
    document.body.append(live);
    // An arrow key that moves a slider or goes to the next tab must neither step the run nor turn the camera.
    document.body.addEventListener("keydown", (event) => {
      if (event.key.startsWith("Arrow") && event.target.closest?.('[role="slider"], [role="tab"]')) event.stopPropagation();
    });
  });
  // Names and values are updated when parts were added or a value has changed; each round waits for changes that follow at once.
  const lookSoon = () => { if (!due) [due] = [true, setTimeout(look, LOOK)]; };
  for (const kind of ["flexlab-structure", "input", "visibilitychange"]) addEventListener(kind, lookSoon, true);
  new MutationObserver(lookSoon).observe(document, { subtree: true, attributes: true, attributeFilter: ["aria-valuenow", "value"] });
  setInterval(() => { look(); tellCalmly(); }, CALM);
})();
