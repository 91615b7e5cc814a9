// The lab's additions to viser's page. They report to the lab which run this browser has drawn, which charts are on the screen
// and whether the system is dark, and let Esc close the list of keys. Without them the lab sends everything to everybody.
(() => {
  // viser handles messages in its drawing loop. Without WebGL it gets a context that draws nothing, so panel and plots still work.
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
      Object.assign(word.style, { position: "fixed", left: "var(--fl-picture-middle, 50%)", zIndex: 1,
        top: "var(--fl-picture-center, 40%)",
        transform: "translate(-50%, -50%)", width: "min(26em, var(--fl-picture-width, 80vw))", padding: "0.8em 1em", margin: 0,
        boxSizing: "border-box", font: "15px/1.4 var(--narrow)", color: "#222", background: "#fff", borderRadius: "6px" });
      document.body.append(word);
    });
  }

  const LOOK = 100; // ms between two checks, even in a hidden page
  const LIVELY = 1000; // ms after an event in which each check measures positions; also the period of measurements after that
  const english = (part) => window.flexlabEnglish?.(part) ?? part.textContent; // the English text in any shown language
  const BARS = ["#server-bar", "div:has(> .fl-scrub) + div:has(.mantine-Slider-root)"]; // links, and the bar that looks back
  const SHEET = 'div[style*="position: fixed"][style*="width: 20em"]'; // the panel of a page in one column
  // viser lays out a page in one column below 36em, but up to 60em there is no room for the scene beside a panel.
  const match = window.matchMedia.bind(window);
  window.matchMedia = (query) => {
    const list = match(query === "(max-width: 36em)" ? "(max-width: 60em)" : query);
    if (query.includes("dppx")) resolution = list;
    return list;
  };

  // Charts draw as many pixels as the screen has; in a presentation they are enlarged, which would blur them.
  const ENLARGED = 1.75; // `zoom` in page.css
  let resolution = null; // the charts' query, by which they learn of another resolution
  let resolved = devicePixelRatio;

  function sharpen() {
    const wanted = devicePixelRatio * (document.querySelector(".fl-presentation") ? ENLARGED : 1);
    if (wanted === resolved || !resolution) return;
    resolved = wanted;
    const own = Object.getOwnPropertyDescriptor(window, "devicePixelRatio");
    Object.defineProperty(window, "devicePixelRatio", { ...own, get: () => wanted, set: undefined });
    resolution.dispatchEvent(new Event("change"));
    Object.defineProperty(window, "devicePixelRatio", own);
  }

  // viser draws the scene's labels black on white boxes, even in dark mode: gray letters without a box suit both modes.
  const LABELS = [["vec4(1.0, 1.0, 1.0, 0.85 * vAlpha)", "vec4(0.0)"], ["vec4(0.0, 0.0, 0.0, a)", "vec4(0.46, 0.49, 0.53, a)"]];
  const drawing = window.WebGL2RenderingContext?.prototype;
  const shaderSource = drawing?.shaderSource;
  if (drawing) drawing.shaderSource = function (shader, text) {
    for (const [found, wanted] of LABELS) {
      if (!text.includes(found)) continue;
      text = text.replace(found, wanted);
      document.documentElement.dataset.flLabels = "plain"; // so that a test notices when viser has changed
    }
    shaderSource.call(this, shader, text);
  };

  // Charts write numbers as the browser's language does, with a hyphen and a comma after thousands; here numbers look the same in
  // all languages and everywhere on the page.
  Object.defineProperty(navigator, "language", { value: "en-US" });
  const format = Object.getOwnPropertyDescriptor(Intl.NumberFormat.prototype, "format");
  Object.defineProperty(Intl.NumberFormat.prototype, "format", { ...format,
    get() { const plain = format.get.call(this); return (value) => plain(value).replace("-", "−").replace(/(?<=\d),(?=\d{3})/g, ""); } });

  // viser adds the lab's own address to the URL of a page below a path, as if it were another server's.
  for (const name of ["pushState", "replaceState"]) {
    const plain = history[name].bind(history);
    history[name] = (state, title, url) => {
      const to = new URL(url ?? location.href, location.href);
      if (to.searchParams.get("websocket")?.split("://")[1].startsWith(location.host)) {
        to.searchParams.delete("websocket");
        to.search = to.search.replace(/=(?=&|$)/g, "");
      }
      plain(state, title, to.href);
    };
  }

  // viser connects again only while its page has the focus: one on a projector, or beside the teacher's page, would stay lost.
  document.hasFocus = () => !document.hidden;
  addEventListener("visibilitychange", () => dispatchEvent(new Event("focus")));

  // A menu is wider than a phone for an instant while it is placed: the phone would zoom out and close the menu.
  document.querySelector("meta[name=viewport]")?.setAttribute("content", "width=device-width, initial-scale=1, minimum-scale=1");

  const darkSystem = matchMedia("(prefers-color-scheme: dark)");
  let seenRun = 0;
  let drawnRun = 0;
  let again = 0; // how often the shown preset was chosen again
  let sent = "", sentAt = -Infinity;
  const SIGN = 1000; // ms between two reports while a mouse button is down

  function isComplete() {
    const node = window.__viserMutable?.nodeRefFromName;
    if (!node?.["/beam"] || !node["/arms/link"]) return false;
    let meshes = 0;
    node["/arms/link"].traverse((part) => { if (part.isMesh) meshes += 1; });
    return meshes > 0;
  }

  const LOGARITHMIC = 3; // uPlot's name for such a scale

  const share = (value) => Math.round(1000 * Math.min(Math.max(value, 0), 1)) / 1000;

  // The visible part of the time axis of each chart on the screen, as fractions of the whole.
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

  // The fractions of the picture's height that panels cover, at the top and at the bottom; and these with the bars, as far as they
  // leave two thirds of the rest: on a phone held across, one of them does not count.
  function covered() {
    const picture = window.__viserMutable?.canvas?.getBoundingClientRect();
    if (!picture?.height) return [[0, 0], [0, 0]];
    let top = picture.top, bottom = picture.bottom;
    function leaveOut(parts, least) {
      const middle = (top + bottom) / 2;
      for (const part of document.querySelectorAll(parts)) {
        const box = part.getBoundingClientRect();
        if (!box.height || box.width < least) continue;
        if (box.top + box.bottom < 2 * middle) top = Math.max(top, box.bottom);
        else bottom = Math.min(bottom, box.top);
      }
      return [share((top - picture.top) / picture.height), share((picture.bottom - bottom) / picture.height)];
    }
    const panels = leaveOut(`[data-floating-window], ${SHEET}`, picture.width / 2), free = bottom - top;
    let all = panels;
    for (const bar of BARS) {
      const before = [top, bottom], now = leaveOut(bar, 0);
      if (3 * (bottom - top) > 2 * free) all = now;
      else [top, bottom] = before;
    }
    return [panels, all];
  }

  // Each browser remembers which panels were open.
  const KEPT = "flexlab-open-panels";
  let lastOpen = [];
  try { lastOpen = JSON.parse(localStorage.getItem(KEPT) ?? "[]").filter((name) => ["guide", "plots"].includes(name)); }
  catch { /* No storage, or no list: both panels are folded at first. */ }
  let someoneActed = false;
  for (const kind of ["pointerup", "keyup"]) addEventListener(kind, () => { someoneActed = true; }, true);

  const guideIsOpen = () => Boolean(document.querySelector(".fl-guide")?.getClientRects().length);

  function keepOpenPanels() {
    document.documentElement.classList.toggle("fl-guided", guideIsOpen());
    if (!someoneActed || document.querySelector(".fl-presentation")) return;
    const open = [];
    if (guideIsOpen()) open.push("guide");
    const charts = Object.values(window.__viserTestpoints?.uplots ?? {});
    if (charts.some(({ chart }) => chart.root.offsetParent !== null)) open.push("plots");
    if (open.join() === lastOpen.join()) return;
    lastOpen = open;
    try { localStorage.setItem(KEPT, JSON.stringify(open)); } catch { /* As above. */ }
  }

  // A run counts as drawn one picture after all its parts exist: the page handles messages before it draws.
  function watchRun() {
    const run = Number(document.querySelector(".fl-run")?.dataset.run ?? 0);
    if (run === seenRun || !isComplete()) return;
    seenRun = run;
    requestAnimationFrame(() => requestAnimationFrame(() => { drawnRun = run; look(); }));
  }

  // The position of the picture between the panels: floating parts are centred in its free part.
  function measurePicture() {
    const box = window.__viserMutable?.canvas?.getBoundingClientRect();
    if (!box?.width) return;
    const style = document.documentElement.style;
    const [above, below] = hidden;
    style.setProperty("--fl-picture-center", `${Math.round(box.top + (1 + above - below) / 2 * box.height)}px`);
    style.setProperty("--fl-picture-middle", `${Math.round(box.left + box.width / 2)}px`);
    style.setProperty("--fl-picture-left", `${Math.round(box.left)}px`);
    style.setProperty("--fl-picture-below", `${Math.round(innerHeight - box.bottom + below * box.height)}px`);
    style.setProperty("--fl-picture-width", `${Math.round(box.width)}px`);
    // Opening a panel would push the plots against its edge.
    const plots = document.querySelector("[data-floating-window]");
    if (plots) style.setProperty("--fl-window-shift", `${Math.round(Math.max(box.left + 8 - plots.offsetLeft, 0))}px`);
  }

  // A legend shows values to a thousandth of the axis or finer, on a logarithmic axis to a tenth of its lower end, and a missing
  // one as –.
  function tellPlainly(series) {
    if (series.isPlain) return;
    series.isPlain = true;
    series.value = (chart, value) => {
      if (!Number.isFinite(value)) return "–";
      const shown = written(chart.scales[series.scale], value);
      return Number(shown) ? shown.replace("-", "−") : "0";
    };
  }

  function written({ min, max, distr }, value) {
    const digits = distr === LOGARITHMIC ? 1 - Math.floor(Math.log10(min)) : 3 - Math.floor(Math.log10(Math.max(-min, max)));
    return value.toFixed(Math.min(Math.max(digits, 0), 9));
  }

  // All values in a legend have the room of the widest one: otherwise a changing number would move the names.
  function giveRoom(chart) {
    const { y } = chart.scales;
    if (!Number.isFinite(y.min) || !Number.isFinite(y.max)) return;
    // A point takes less room than a digit, and a minus sign more, in some fonts nearly twice as much.
    const widths = [y.min, y.max].map((end) => written(y, end))
      .map((text) => text.length - (text.includes(".") ? 0.4 : 0) + (text.includes("-") ? 0.8 : 0));
    const room = `${Math.max(...widths)}ch`;
    if (chart.root.style.getPropertyValue("--fl-value") !== room) chart.root.style.setProperty("--fl-value", room);
  }

  // Positions change when a person acts or parts come and go; measuring them makes the browser lay out the page.
  let lively = Infinity, measured = -Infinity, hidden = [0, 0], taken = [0, 0], charts = {};
  for (const kind of ["flexlab-structure", "resize", "scroll", "wheel", "pointerdown", "pointermove", "pointerup", "keydown", "keyup"]) {
    addEventListener(kind, (event) => {
      if (kind !== "pointermove" || event.buttons) lively = performance.now() + LIVELY;
    }, { capture: true, passive: true });
  }

  function measure() {
    const now = performance.now();
    if (now > lively && now - measured < LIVELY) return;
    measured = now;
    if (lively === Infinity && isComplete()) lively = now + LIVELY;
    [hidden, taken] = covered();
    measurePicture();
    charts = openCharts();
    keepOpenPanels();
  }

  // Without a cursor in a chart, its legend shows the newest values; a spectrum has none.
  const told = new WeakMap(); // chart → the data that its legend shows

  function tellNewest() {
    for (const { chart } of Object.values(window.__viserTestpoints?.uplots ?? {})) {
      const isSpectrum = chart.scales.y.distr === LOGARITHMIC;
      chart.series.slice(isSpectrum ? 0 : 1).forEach(tellPlainly);
      if (chart.root.offsetParent === null) continue;
      giveRoom(chart);
      if (!(chart.cursor.left < 0)) continue;
      let last = isSpectrum ? null : chart.data[0].length - 1;
      while (last > 0 && !Number.isFinite(chart.data[1]?.[last])) last -= 1;
      if (told.get(chart) === chart.data && chart.legend.idx === last) continue;
      told.set(chart, chart.data);
      chart.setLegend({ idx: last }, false);
    }
  }

  // The play screen is in the same panel as the lab; the style sheet shows one of the two.
  // Until the play screen is found, the panel is hidden: the lab's fifty controls would flash up.
  if (new URLSearchParams(location.search).has("play")) document.documentElement.classList.add("fl-playing", "fl-searching");

  addEventListener("flexlab-structure", () => {
    if (document.querySelector("[data-fl-play]")) document.documentElement.classList.remove("fl-searching");
    markPlayScreen();
  });

  function markPlayScreen() {
    let part = document.querySelector(".fl-play");
    if (!part || part.closest("[data-fl-play]")) return;
    while (part.parentElement && !part.parentElement.querySelector(".fl-caption")) part = part.parentElement;
    part.dataset.flPlay = "";
    if (part.parentElement) part.parentElement.dataset.flPanel = "";
  }

  addEventListener("click", (event) => {
    const button = event.target.closest?.("[data-fl-play] button");
    if (!button || english(button).trim() !== "More") return;
    document.documentElement.classList.remove("fl-playing");
    history.replaceState(null, "", location.pathname);
  }, true);

  // The lab sends its time each second. The fastest message of this connection gives the offset of its clock, and so the age
  // of the picture if the line is slow or cut.
  const BEHIND = 3000, LASTING = 10; // age from which it is shown, ms; consecutive checks that must find it
  const old = Object.assign(document.createElement("p"), { className: "fl-behind", hidden: true });
  old.setAttribute("role", "status");
  let connection = "", labTime = NaN, quickest = Infinity, found = 0;

  function watchAge(way) {
    const told = Number(document.querySelector(".fl-run")?.dataset.at ?? NaN), now = performance.now();
    if (way !== connection) [connection, labTime, quickest] = [way, NaN, Infinity];
    // Until the new run's mark has come, after a connection, there is no time.
    if (told > 0 && told !== labTime) [labTime, quickest] = [told, Math.min(quickest, now - 1000 * told)];
    const age = now - 1000 * labTime - quickest;
    found = age > BEHIND && !document.hidden ? found + 1 : 0;
    const text = found > LASTING ? `The picture is ${Math.round(age / 1000)} s old: the connection to the lab is slow or lost.` : "";
    if (old.textContent !== text) old.textContent = text;
    old.hidden = !text;
    if (!old.isConnected) document.body?.append(old); // The page may not be complete yet.
  }

  // Whether a person has turned the camera: only then the page offers a way back.
  const LATER = 1000, TURNED = 1e-3; // ms for which a camera goes on moving after a gesture; least move that counts, m
  let placed = [], handled = -Infinity, held = false;
  const isPicture = ({ target }) => window.__viserMutable?.canvas?.parentElement?.contains(target) ?? false;
  addEventListener("pointerdown", (event) => { held = isPicture(event); }, true);
  for (const kind of ["pointerup", "pointercancel"]) {
    addEventListener(kind, () => { if (held) [held, handled] = [false, performance.now()]; }, true);
  }
  addEventListener("wheel", (event) => { if (isPicture(event)) handled = performance.now(); }, { capture: true, passive: true });
  const TURNING = /^(Arrow\w+|[adwsqe])$/i; // keys that turn the camera, unless they are typed in a slider, a tab or a text field
  addEventListener("keydown", ({ key, target }) => {
    if (TURNING.test(key) && !target.closest?.('input, textarea, [role="slider"], [role="tab"]')) handled = performance.now();
  }, true);
  addEventListener("click", ({ target }) => {
    if (!target.closest?.("div:has(> .fl-back) + div")) return;
    [held, handled] = [false, -Infinity];
    document.documentElement.classList.remove("fl-turned");
  }, true);

  function watchCamera() {
    const now = window.__viserMutable?.camera?.position.toArray() ?? [];
    if (!held && performance.now() - handled > LATER) placed = now;
    else if (now.some((part, axis) => Math.abs(part - placed[axis]) > TURNED)) document.documentElement.classList.add("fl-turned");
  }

  // Invisible parts that can be dragged must not hide the parts behind them: viser would write their depth.
  function showBehindUnseen() {
    for (const name of ["/grab", "/arms/grab"]) {
      window.__viserMutable?.nodeRefFromName?.[name]?.traverse(({ material }) => {
        if (material?.opacity === 0) material.depthWrite = false;
      });
    }
  }

  // The notice that no graphics card draws must not cover a corner of the scene for good.
  const NO_CARD = "Software WebGL rendering detected", READ = 8000; // time to read it, ms
  let word = null;

  function closeReadWord() {
    const shown = document.querySelector(".mantine-Notification-root");
    if (!shown || shown === word || !english(shown).startsWith(NO_CARD)) return;
    word = shown;
    word.dataset.flNoCard = "";
    setTimeout(() => shown.querySelector("button")?.click(), READ);
  }

  function look() {
    closeReadWord();
    showBehindUnseen();
    const name = document.querySelector(".fl-run")?.dataset.name;
    const title = document.querySelector("title");
    if (name && (!title || english(title) !== `${name} · flexlab`)) document.title = `${name} · flexlab`;
    watchRun();
    watchCamera();
    sharpen();
    tellNewest();
    const way = document.querySelector(".fl-reports")?.dataset.way;
    if (way !== connection) someoneActed = false; // With a new connection the panels are folded.
    measure();
    watchAge(way ?? connection);
    if (!way || !window.__viserMutable?.sendMessage) return;
    const report = JSON.stringify({ run: drawnRun, charts, dark: darkSystem.matches, width: innerWidth,
      covered: taken, height: Math.round(window.__viserMutable.canvas?.clientHeight ?? 0), open: lastOpen, again,
      hears: document.querySelector(".fl-hear")?.getAttribute("aria-pressed") === "true" });
    // The lab lets go of what a silent browser pulls; a mouse that is held still sends nothing by itself.
    if (sent === way + report && !(held && performance.now() - sentAt > SIGN)) return;
    [sent, sentAt] = [way + report, performance.now()];
    window.__viserMutable.sendMessage({ type: "GuiUpdateMessage", uuid: way, updates: { value: report } });
  }

  // The charts of one tab are zoomed together, even while the window moves on.
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
    buttons.find((button) => english(button).trim() === "Close")?.click();
    if (!document.querySelector(".fl-presentation") || document.querySelector(".mantine-Modal-content")) return;
    document.body.dispatchEvent(new KeyboardEvent("keydown", { key: "b", code: "KeyB", bubbles: true, cancelable: true }));
  }, true);
  // A browser does not report that the same file was chosen again, unless it forgets the choice: the file may have changed.
  addEventListener("click", ({ target }) => { if (target.matches?.('input[type="file"]')) target.value = ""; }, true);
  // After a choice by pointer, a menu gives up the focus: keys such as R are then for the lab again, not for the menu's search.
  addEventListener("click", ({ target, detail }) => {
    if (detail && target.closest?.('[role="option"]')) setTimeout(() => document.activeElement?.blur(), 0);
  }, true);
  // A menu reports nothing when the shown option is chosen again; in the menu of presets that restarts the preset.
  addEventListener("click", (event) => {
    const option = event.target.closest?.('[role="option"][aria-selected="true"]');
    const list = option?.closest('[role="listbox"]');
    const menu = list && document.querySelector(`[aria-controls="${list.id}"]`);
    if (menu && document.querySelector(".fl-preset")?.closest("div").nextElementSibling?.contains(menu)) again += 1;
  }, true);
  setInterval(look, LOOK);
})();
