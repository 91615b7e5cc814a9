// What the lab adds to viser's page. It tells the lab which run this browser has drawn, which charts are on the screen and
// whether the system is dark, and lets Esc close the list of keys. Without it the lab shows everything to everybody.
(() => {
  // viser works on messages while it draws. Where WebGL is missing it draws onto nothing: panel and plots then work all the same.
  const NO_PICTURE = "This browser cannot draw the scene: WebGL is off or missing. Turn on graphics (hardware) acceleration in its " +
    "settings and load this page again, or take another browser. Plots and controls work.";

  function drawingOntoNothing(canvas) {
    const constants = window.WebGL2RenderingContext ?? {};
    const answers = {
      getParameter: (name) => ({ [constants.VERSION]: "WebGL 2.0", [constants.SHADING_LANGUAGE_VERSION]: "WebGL GLSL ES 3.00",
        [constants.SCISSOR_BOX]: [0, 0, 1, 1], [constants.VIEWPORT]: [0, 0, 1, 1] })[name] ?? 16,
      getShaderPrecisionFormat: () => ({ rangeMin: 127, rangeMax: 127, precision: 23 }),
      getContextAttributes: () => ({ alpha: true, antialias: false, depth: true, stencil: false }),
      getSupportedExtensions: () => [],
      getProgramParameter: (_, name) => (name === constants.ACTIVE_UNIFORMS || name === constants.ACTIVE_ATTRIBUTES ? 0 : true),
      getShaderParameter: () => true,
      getProgramInfoLog: () => "",
      getShaderInfoLog: () => "",
      getError: () => 0,
      isContextLost: () => false,
      checkFramebufferStatus: () => constants.FRAMEBUFFER_COMPLETE,
    };
    return new Proxy({}, {
      get: (_, name) => name === "canvas" ? canvas : name === "drawingBufferWidth" ? canvas.width :
        name === "drawingBufferHeight" ? canvas.height : constants[name] ?? answers[name] ??
        (String(name).startsWith("create") ? () => ({}) : () => null),
    });
  }

  if (!document.createElement("canvas").getContext("webgl2")) {
    const original = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...options) {
      return original.call(this, kind, ...options) ?? (kind === "webgl2" ? drawingOntoNothing(this) : null);
    };
    addEventListener("DOMContentLoaded", () => {
      const word = Object.assign(document.createElement("p"), { textContent: NO_PICTURE, className: "fl-no-picture" });
      word.setAttribute("role", "status");
      Object.assign(word.style, { position: "fixed", left: "var(--fl-picture-middle, 50%)", top: "40%", zIndex: 1,
        transform: "translate(-50%, -50%)", width: "min(26em, var(--fl-picture-width, 80vw))", padding: "0.8em 1em", margin: 0,
        boxSizing: "border-box", font: "15px/1.4 system-ui, sans-serif", color: "#222", background: "#fff", borderRadius: "6px" });
      document.body.append(word);
    });
  }

  const LOOK = 100; // ms between two looks, in a page that nobody sees as well
  const darkSystem = matchMedia("(prefers-color-scheme: dark)");
  let seenRun = 0;
  let drawnRun = 0;
  let again = 0; // how often the shown preset was chosen once more
  let sent = "";

  function isComplete() {
    const node = window.__viserMutable?.nodeRefFromName;
    if (!node?.["/beam"] || !node["/arms/link"]) return false;
    let meshes = 0;
    node["/arms/link"].traverse((part) => { if (part.isMesh) meshes += 1; });
    return meshes > 0;
  }

  const share = (value) => Math.round(1000 * Math.min(Math.max(value, 0), 1)) / 1000;

  // Of each chart on the screen the part that is zoomed into, as shares of all that it has.
  function openCharts() {
    const open = {};
    if (document.hidden) return open;
    for (const [uuid, { chart }] of Object.entries(window.__viserTestpoints?.uplots ?? {})) {
      const box = chart.root.getBoundingClientRect();
      if (chart.root.offsetParent === null || box.bottom <= 0 || box.top >= innerHeight || !(box.width > 0)) continue;
      const times = chart.data[0];
      const first = times[0], span = times[times.length - 1] - first;
      const { min, max } = chart.scales.x;
      open[uuid] = span > 0 && min < max ? [share((min - first) / span), share((max - first) / span)] : [0, 1];
    }
    return open;
  }

  // A run is drawn one picture after all its parts are there: the page's own work on messages comes before its drawing.
  function watchRun() {
    const run = Number(document.querySelector(".fl-run")?.dataset.run ?? 0);
    if (run === seenRun || !isComplete()) return;
    seenRun = run;
    requestAnimationFrame(() => requestAnimationFrame(() => { drawnRun = run; look(); }));
  }

  // Where the picture is between the panels: what floats over it stands in its middle.
  function measurePicture() {
    const box = window.__viserMutable?.canvas?.getBoundingClientRect();
    if (!box?.width) return;
    const style = document.documentElement.style;
    style.setProperty("--fl-picture-middle", `${Math.round(box.left + box.width / 2)}px`);
    style.setProperty("--fl-picture-width", `${Math.round(box.width)}px`);
  }

  function look() {
    watchRun();
    measurePicture();
    const way = document.querySelector(".fl-reports")?.dataset.way;
    if (!way || !window.__viserMutable?.sendMessage) return;
    const report = JSON.stringify({ run: drawnRun, charts: openCharts(), dark: darkSystem.matches, width: innerWidth, again });
    if (sent === way + report) return;
    sent = way + report;
    window.__viserMutable.sendMessage({ type: "GuiUpdateMessage", uuid: way, updates: { value: report } });
  }

  // Charts of one tab show the same time: what is zoomed in one is zoomed in all, also while the window moves on.
  const chartAt = (target) => Object.values(window.__viserTestpoints?.uplots ?? {})
    .map((entry) => entry.chart).find((chart) => chart.root.contains(target));
  let zooming = null;

  function zoomTogether(source) {
    const extent = ({ data: [times] }) => [times[0], times[times.length - 1] - times[0]];
    const [first, span] = extent(source);
    const { min, max } = source.scales.x;
    if (!(span > 0) || !(min < max)) return;
    for (const { chart } of Object.values(window.__viserTestpoints.uplots)) {
      const [start, length] = extent(chart);
      if (chart === source || !(length > 0) || chart.cursor.sync?.key !== source.cursor.sync?.key) continue;
      chart.setScale("x", { min: start + (min - first) / span * length, max: start + (max - first) / span * length });
    }
  }

  addEventListener("mousedown", (event) => { zooming = chartAt(event.target) ?? null; }, true);
  for (const kind of ["mouseup", "dblclick"]) {
    addEventListener(kind, () => {
      const source = zooming;
      if (source) setTimeout(() => zoomTogether(source), 0);
    }, true);
  }

  addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    const buttons = [...document.querySelectorAll(".mantine-Modal-content button")];
    buttons.find((button) => button.textContent.trim() === "Close")?.click();
  }, true);
  // A menu tells nothing when the option is chosen that it shows; for the presets that means: start it anew.
  addEventListener("click", (event) => {
    const option = event.target.closest?.('[role="option"][aria-selected="true"]');
    const list = option?.closest('[role="listbox"]');
    const menu = list && document.querySelector(`[aria-controls="${list.id}"]`);
    if (menu && document.querySelector(".fl-preset")?.closest("div").nextElementSibling?.contains(menu)) again += 1;
  }, true);
  setInterval(look, LOOK);
})();
