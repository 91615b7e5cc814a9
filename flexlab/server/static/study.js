// A study's page: its progress, then its results as a map, a curve or a trade-off.
const chart = document.getElementById("chart");

const bar = document.querySelector("progress");
document.querySelector(".progress")?.addEventListener("progress", async ({ detail }) => {
  if (bar && detail.share > bar.value) await refresh();
});

// Drawings have no subscripts.
const titled = (axis) => [axis.title, axis.symbol?.includes("_") ? "" : axis.symbol].filter(Boolean).join(" ") + (axis.unit ? ` (${axis.unit})` : "");

const shortened = (word, most) => (word.length * 6.6 + 14 > most ? `${word.slice(0, Math.max(Math.floor((most - 14) / 6.6) - 1, 3))}…` : word);

// Labels at the middles of an axis's cells: about `space` numbers, or all words, shortened to `most` px.
function cellTicks(axis, space, most) {
  const values = axis.values;
  const step = axis.numeric ? Math.ceil(values.length / Math.max(space, 2)) : 1;
  const said = axis.numeric ? numbers(values) : values.map((word) => shortened(String(word), most));
  return values.map((_, k) => [(k + 0.5) / values.length, said[k]]).filter((_, k) => k % step === 0);
}

function words(found, metric, cell) {
  const value = metric.values[cell];
  const said = (value) => (typeof value === "number" ? number(value, 4) : value);
  const at = found.axes.map((axis, k) => `${axis.symbol || axis.title} = ${said(place(found, cell, k))} ${axis.unit}`.trim());
  const read = found.status[cell] === null ? "not computed yet" : failedAt(found, cell) ? "failed" :
    value === null ? metric.missing : `${number(value, 4)} ${metric.unit}`;
  const why = found.sentence[cell] ? `. ${found.sentence[cell]}` : "";
  return `${at.join(", ")}: ${metric.title} ${read}${why}`;
}

// A cell's index on each axis of the sweep.
function places(found, cell) {
  const count = found.axes[1]?.values.length ?? 1;
  return [Math.floor(cell / count), cell % count];
}

const place = (found, cell, axis) => found.axes[axis].values[places(found, cell)[axis]];
const failedAt = (found, cell) => found.status[cell] !== null && found.status[cell] !== "finished";

// The horizontal and the vertical axis: words stand beside a map, where they have room.
function sides(found) {
  if (found.axes.length < 2) return found.axes[0].numeric ? [0] : [null, 0];
  return !found.axes[0].numeric && found.axes[1].numeric ? [1, 0] : [0, 1];
}

// The width that labels take, px.
function room(axis, most) {
  if (!axis || axis.numeric) return 0;
  return Math.min(Math.max(...axis.values.map((word) => String(word).length)) * 6.6 + 14, most);
}

// Round numbers of a scale, as [share of the side, words].
function labelled(scale, count, share = scale.share) {
  const ticks = roundTicks(scale, count);
  const said = numbers(ticks);
  return ticks.map((tick, k) => [share(tick), said[k]]);
}

// A mark whose values are shown when it is pointed at or reached with the arrow keys, and which opens its scenario.
function link(found, metric, cell, ...children) {
  const said = words(found, metric, cell);
  const made = svg("a", { href: chart.dataset.cells + cell, class: "cell", tabindex: cell === 0 ? 0 : -1, "aria-label": said,
    "data-cell": cell }, ...children);
  const tell = () => {
    document.getElementById("reading").textContent = said;
    // A border above all other cells, which would cover the cell's own.
    const cover = chart.querySelector(".chosen");
    for (const name of ["x", "y", "width", "height"]) cover?.setAttribute(name, children[0].getAttribute(name));
  };
  made.addEventListener("pointerenter", tell);
  made.addEventListener("focus", tell);
  return made;
}

const cross = (x, y, r) => svg("path", { d: `M${x - r} ${y - r}l${2 * r} ${2 * r}M${x - r} ${y + r}l${2 * r} ${-2 * r}`, class: "cross" });

// The mark of a cell as a point, or as a cross where it failed.
function point(found, metric, cell, x, y) {
  const kind = found.status[cell] === null ? "waiting" : metric.values[cell] === null ? "missing" : "point";
  return link(found, metric, cell, svg("circle", { cx: x, cy: y, r: 10, fill: "transparent" }),
    failedAt(found, cell) ? cross(x, y, 4) : svg("circle", { cx: x, cy: y, r: 4, class: kind }));
}

function drawMap(drawing, found, metric, box, narrow) {
  const [right, upward] = sides(found);
  const [across, up] = [found.axes[right], found.axes[upward]];
  const scale = scaleOf(metric.values);
  const [w, h] = [box.width / across.values.length, box.height / up.values.length];
  frame(drawing, box, cellTicks(across, box.width / 52, w), cellTicks(up, box.height / 26, box.left - 16), [across, up].map(titled));
  metric.values.forEach((value, cell) => {
    const at = places(found, cell);
    const x = box.left + at[right] * w;
    const y = box.top + box.height - (at[upward] + 1) * h;
    const failed = failedAt(found, cell);
    const marks = [svg("rect", { x, y, width: w + 0.3, height: h + 0.3, ...(failed ? { class: "failed" } :
      found.status[cell] === null ? { class: "waiting" } : value === null ? { class: "missing" } : { fill: viridis(scale.share(value)) }) })];
    if (failed) marks.push(cross(x + w / 2, y + h / 2, Math.min(w, h, 14) * 0.28));
    drawing.append(link(found, metric, cell, ...marks));
  });
  drawing.append(svg("rect", { class: "chosen" }));
  if (!scale.empty) colorBar(drawing, scale, box, narrow);
}

function colorBar(drawing, scale, box, narrow) {
  const steps = 48;
  const [x, y] = narrow ? [box.left, box.top + box.height + 56] : [box.left + box.width + 18, box.top];
  const length = narrow ? box.width : box.height;
  for (let k = 0; k < steps; k++) {
    const [from, size] = [(k * length) / steps, length / steps + (k < steps - 1 ? 1 : 0)];
    drawing.append(svg("rect", narrow ? { x: x + from, y, width: size, height: 12, fill: viridis((k + 0.5) / steps) } :
      { x, y: y + length - from - size, width: 14, height: size, fill: viridis((k + 0.5) / steps) }));
  }
  for (const [share, said] of labelled(scale, narrow ? 4 : 6)) {
    const at = share * length;
    drawing.append(narrow ? text(said, x + at, y + 28) : text(said, x + 20, y + length - at + 4, "start"));
  }
}

const MARGIN = 0.03; // free share at each end of an axis: marks at the ends are clear of the frame
const inset = (scale) => ({ ...scale, share: (value) => MARGIN + (1 - 2 * MARGIN) * scale.share(value) });

function drawCurve(drawing, found, metric, box) {
  const axis = found.axes[0];
  const logarithmic = axis.logarithmic;
  const sides = [scaleOf(axis.values), inset(scaleOf(metric.values))];
  const ends = [axis.values[0], axis.values.at(-1)].map((value) => (logarithmic ? Math.log(value) : value));
  const share = (value) => ((logarithmic ? Math.log(value) : value) - ends[0]) / (ends[1] - ends[0] || 1);
  const at = (cell) => [box.left + share(axis.values[cell]) * box.width,
    box.top + (1 - sides[1].share(metric.values[cell])) * box.height];
  frame(drawing, box, labelled({ ...sides[0], logarithmic }, box.width / 60, share), labelled(sides[1], box.height / 40),
    [titled(axis), `${metric.title} (${metric.unit})`]);
  const known = metric.values.map((value, cell) => [value, cell]).filter(([value]) => value !== null).map(([, cell]) => cell);
  drawing.append(svg("polyline", { points: known.map((cell) => at(cell).join(",")).join(" "), class: "curve" }));
  axis.values.forEach((value, cell) => {
    const [x, y] = metric.values[cell] === null ? [box.left + share(value) * box.width, box.top + box.height - 9] : at(cell);
    drawing.append(point(found, metric, cell, x, y));
  });
}

// One metric over a choice: its options one below the other, the first one on top.
function drawWords(drawing, found, metric, box) {
  const axis = found.axes[0];
  const scale = scaleOf(metric.values);
  const count = axis.values.length;
  const ticks = cellTicks(axis, count, box.left - 16).map(([share, word]) => [1 - share, word]);
  frame(drawing, box, labelled(scale, Math.max(box.width / 70, 3)), ticks, [`${metric.title} (${metric.unit})`, axis.title]);
  metric.values.forEach((value, cell) => {
    const x = box.left + (value === null ? 0.02 : scale.share(value)) * box.width;
    drawing.append(point(found, metric, cell, x, box.top + (cell + 0.5) / count * box.height));
  });
}

function drawTradeOff(drawing, found, box) {
  const marks = [...found.points, found.before, found.after].filter(Boolean);
  const sides = [0, 1].map((k) => inset(scaleOf(marks.map((mark) => mark[k]))));
  const ticks = sides.map((side, k) => labelled(side, [box.width / 70, box.height / 40][k]));
  frame(drawing, box, ticks[0], ticks[1], found.titles);
  const dot = (mark, name, r) => mark && drawing.append(svg("circle", { cx: box.left + sides[0].share(mark[0]) * box.width,
    cy: box.top + (1 - sides[1].share(mark[1])) * box.height, r, class: name }));
  for (const point of found.points) dot(point, "tried", 3);
  dot(found.before, "before", 6);
  dot(found.after, "after", 6);
}

function legendOf(...parts) {
  chart.querySelector(".legend").replaceChildren(...parts.filter(Boolean).map(([name, said]) => {
    const made = document.createElement("span");
    made.className = `key ${name}`;
    made.textContent = said;
    return made;
  }));
}

function draw(found, metric) {
  const holder = chart.querySelector(".drawing");
  const total = Math.max(holder.clientWidth, 240);
  const map = Boolean(found.axes?.[1]);
  const narrow = total < 560;
  const beside = found.axes && found.axes[sides(found)[1]];
  const left = Math.max(map || narrow ? 66 : 84, room(beside, total * 0.46) + 16);
  const box = { left, top: 12, width: total - left - (map && !narrow ? 92 : 18), height: 0 };
  box.height = Math.min(Math.max(box.width * 0.62, 220), 470);
  const height = box.top + box.height + (map && narrow ? 96 : 48);
  const drawing = svg("svg", { viewBox: `0 0 ${total} ${height}`, width: total, height, role: "group" });
  if (found.points) {
    drawTradeOff(drawing, found, box);
    chart.querySelector("figcaption").textContent = "What less of one metric costs in the other";
    legendOf(["tried", "tried"], found.before && ["before", "before"], found.after && ["after", "tuned"]);
  } else {
    (map ? drawMap : found.axes[0].numeric ? drawCurve : drawWords)(drawing, found, metric, box, narrow);
    chart.querySelector("figcaption").textContent = `${metric.title} (${metric.unit})`;
    const failed = found.status.filter((_, cell) => failedAt(found, cell)).length;
    const waiting = found.status.filter((status) => status === null).length;
    const missing = metric.values.filter((value) => value === null).length - failed - waiting;
    legendOf(waiting && ["waiting", `${waiting} not computed yet`], failed && ["failed", `${failed} failed`], missing > 0 && ["missing", `${missing} ${metric.missing}`]);
  }
  const chosen = holder.contains(document.activeElement) ? document.activeElement.dataset.cell : null;
  holder.replaceChildren(drawing);
  if (chosen !== null) holder.querySelector(`a.cell[data-cell="${chosen}"]`)?.focus();
}

function arrows(event, found) {
  const step = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] }[event.key];
  const cell = event.target.closest?.("a.cell");
  if (!step || !cell) return;
  event.preventDefault();
  const counts = [found.axes[0].values.length, found.axes[1]?.values.length ?? 1];
  const at = places(found, Number(cell.dataset.cell));
  const [right, upward] = sides(found);
  if (right === null) at[0] -= step[1];
  else [at[right], at[upward ?? 1]] = [at[right] + step[0], at[upward ?? 1] + step[1]];
  if (at.some((index, k) => index < 0 || index >= counts[k])) return;
  chart.querySelector(`a.cell[data-cell="${at[0] * counts[1] + at[1]}"]`).focus();
}

function tellFailures(found) {
  const reasons = new Map();
  found.sentence.forEach((said, cell) => {
    if (!failedAt(found, cell)) return;
    const cells = reasons.get(said) ?? [];
    reasons.set(said, [...cells, cell]);
  });
  const list = document.querySelector("#failures ul");
  list.replaceChildren();
  document.getElementById("failures").hidden = reasons.size === 0;
  for (const [said, cells] of [...reasons].slice(0, 20)) {
    const line = document.createElement("li");
    line.textContent = `${said} (${cells.length === 1 ? "one cell" : `${cells.length} cells`})`;
    list.append(line);
  }
}

const choice = document.getElementById("metric");
const KEPT = `metric of ${location.pathname}`; // keeps the shown metric when the page reloads at the end
let kept = null;
try { kept = sessionStorage.getItem(KEPT); } catch { /* A browser that blocks cookies has no storage. */ }
let found = null;

const load = async () => { found = await (await fetch(chart.dataset.address, { cache: "no-store" })).json(); };

function again() {
  draw(found, choice && found.metrics[choice.value]);
  if (choice) tellFailures(found);
}

// A running sweep has new cells.
async function refresh() {
  if (!found) return;
  await load();
  again();
}

async function show() {
  await load();
  if (choice) {
    const fields = found.metrics.map((metric) => metric.field);
    found.metrics.forEach((metric, k) => choice.add(new Option(`${metric.title} (${metric.unit})`, k)));
    choice.value = fields.indexOf([kept, "rms-y", choice.dataset.listed.split(" ")[0]].find((name) => fields.includes(name)));
    choice.addEventListener("change", () => {
      try { sessionStorage.setItem(KEPT, fields[choice.value]); } catch { /* As above. */ }
      again();
    });
    chart.addEventListener("keydown", (event) => arrows(event, found));
  }
  again();
  new ResizeObserver(() => {
    const drawn = chart.querySelector("svg");
    if (drawn && Math.abs(drawn.width.baseVal.value - chart.querySelector(".drawing").clientWidth) > 2) again();
  }).observe(chart);
}
if (chart) show();
