// A study's page: how far it is, and then a map, a curve or a trade-off of what it found.
const state = document.getElementById("state");
const chart = document.getElementById("chart");
const LOOK = 700; // ms between two looks at how far it is

async function follow() {
  try {
    const answer = await fetch(state.dataset.address, { cache: "no-store" });
    if (!answer.ok) return location.reload();
    const told = await answer.json();
    if (!told.working) return location.reload();
    state.textContent = told.sentence;
    document.getElementById("progress").value = told.share;
  } catch {
    state.textContent = "The server does not answer.";
  }
  setTimeout(follow, LOOK);
}
if (state) setTimeout(follow, LOOK);

const titled = (axis) => [axis.title, axis.symbol].filter(Boolean).join(" ") + (axis.unit ? ` (${axis.unit})` : "");

// Of the middles of `count` equal cells, as many labels as fit.
function cellTicks(values, room) {
  const step = Math.ceil(values.length / Math.max(room, 2));
  const said = numbers(values);
  return values.map((_, k) => [(k + 0.5) / values.length, said[k]]).filter((_, k) => k % step === 0);
}

function words(found, metric, cell) {
  const value = metric.values[cell];
  const places = found.axes.map((axis, k) => `${axis.symbol || axis.title} = ${number(place(found, cell, k), 4)} ${axis.unit}`.trim());
  const read = found.status[cell] !== "finished" ? "failed" :
    value === null ? metric.missing : `${number(value, 4)} ${metric.unit}`;
  const why = found.sentence[cell] ? `. ${found.sentence[cell]}` : "";
  return `${places.join(", ")}: ${metric.title} ${read}${why}`;
}

function place(found, cell, axis) {
  const count = found.axes[1]?.values.length ?? 1;
  return found.axes[axis].values[axis === 0 ? Math.floor(cell / count) : cell % count];
}

// Round numbers of a scale at their places.
function labelled(scale, count, share = scale.share) {
  const ticks = roundTicks(scale, count);
  const said = numbers(ticks);
  return ticks.map((tick, k) => [share(tick), said[k]]);
}

// A mark that is read by pointing at it or going to it with the arrow keys, and opens its scenario.
function link(found, metric, cell, ...children) {
  const said = words(found, metric, cell);
  const made = svg("a", { href: chart.dataset.cells + cell, class: "cell", tabindex: cell === 0 ? 0 : -1, "aria-label": said,
    "data-cell": cell }, ...children);
  const tell = () => {
    document.getElementById("reading").textContent = said;
    // Above all other cells, which would cover its border.
    const cover = chart.querySelector(".chosen");
    for (const name of ["x", "y", "width", "height"]) cover?.setAttribute(name, children[0].getAttribute(name));
  };
  made.addEventListener("pointerenter", tell);
  made.addEventListener("focus", tell);
  return made;
}

function drawMap(drawing, found, metric, box, narrow) {
  const [across, up] = found.axes;
  const scale = scaleOf(metric.values);
  const [w, h] = [box.width / across.values.length, box.height / up.values.length];
  frame(drawing, box, cellTicks(across.values, box.width / 52), cellTicks(up.values, box.height / 26), [across, up].map(titled));
  metric.values.forEach((value, cell) => {
    const x = box.left + Math.floor(cell / up.values.length) * w;
    const y = box.top + box.height - (cell % up.values.length + 1) * h;
    const failed = found.status[cell] !== "finished";
    const marks = [svg("rect", { x, y, width: w + 0.3, height: h + 0.3, ...(failed ? { class: "failed" } :
      value === null ? { class: "missing" } : { fill: viridis(scale.share(value)) }) })];
    if (failed) {
      const [cx, cy, r] = [x + w / 2, y + h / 2, Math.min(w, h, 14) * 0.28];
      marks.push(svg("path", { d: `M${cx - r} ${cy - r}l${2 * r} ${2 * r}M${cx - r} ${cy + r}l${2 * r} ${-2 * r}`, class: "cross" }));
    }
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

function drawCurve(drawing, found, metric, box) {
  const axis = found.axes[0];
  const logarithmic = axis.logarithmic;
  const sides = [scaleOf(axis.values), scaleOf(metric.values)];
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
    const r = 4;
    const failed = found.status[cell] !== "finished";
    drawing.append(link(found, metric, cell, svg("circle", { cx: x, cy: y, r: 10, fill: "transparent" }), failed ?
      svg("path", { d: `M${x - r} ${y - r}l${2 * r} ${2 * r}M${x - r} ${y + r}l${2 * r} ${-2 * r}`, class: "cross" }) :
      svg("circle", { cx: x, cy: y, r, class: metric.values[cell] === null ? "missing" : "point" })));
  });
}

function drawTradeOff(drawing, found, box) {
  const marks = [...found.points, found.before, found.after].filter(Boolean);
  const sides = [0, 1].map((k) => scaleOf(marks.map((mark) => mark[k])));
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
  const left = map || narrow ? 66 : 84;
  const box = { left, top: 12, width: total - left - (map && !narrow ? 92 : 18), height: 0 };
  box.height = Math.min(Math.max(box.width * 0.62, 220), 470);
  const height = box.top + box.height + (map && narrow ? 96 : 48);
  const drawing = svg("svg", { viewBox: `0 0 ${total} ${height}`, width: total, height, role: "group" });
  if (found.points) {
    drawTradeOff(drawing, found, box);
    chart.querySelector("figcaption").textContent = "What less of one costs in the other";
    legendOf(["tried", "tried"], found.before && ["before", "before"], found.after && ["after", "tuned"]);
  } else {
    (map ? drawMap : drawCurve)(drawing, found, metric, box, narrow);
    chart.querySelector("figcaption").textContent = `${metric.title} (${metric.unit})`;
    const failed = found.status.filter((status) => status !== "finished").length;
    const missing = metric.values.filter((value) => value === null).length - failed;
    legendOf(failed && ["failed", `${failed} failed`], missing > 0 && ["missing", `${missing} ${metric.missing}`]);
  }
  holder.replaceChildren(drawing);
}

function arrows(event, found) {
  const step = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] }[event.key];
  const cell = event.target.closest?.("a.cell");
  if (!step || !cell) return;
  event.preventDefault();
  const [columns, rows] = [found.axes[0].values.length, found.axes[1]?.values.length ?? 1];
  const now = Number(cell.dataset.cell);
  const [column, row] = [Math.floor(now / rows) + step[0], (now % rows) + step[1]];
  if (column < 0 || column >= columns || row < 0 || row >= rows) return;
  chart.querySelector(`a.cell[data-cell="${column * rows + row}"]`).focus();
}

function tellFailures(found) {
  const reasons = new Map();
  found.sentence.forEach((said, cell) => {
    if (found.status[cell] === "finished") return;
    const cells = reasons.get(said) ?? [];
    reasons.set(said, [...cells, cell]);
  });
  const list = document.querySelector("#failures ul");
  document.getElementById("failures").hidden = reasons.size === 0;
  for (const [said, cells] of [...reasons].slice(0, 20)) {
    const line = document.createElement("li");
    line.textContent = `${said} (${cells.length === 1 ? "one cell" : `${cells.length} cells`})`;
    list.append(line);
  }
}

async function show() {
  const found = await (await fetch(chart.dataset.address, { cache: "no-store" })).json();
  const choice = document.getElementById("metric");
  let again = () => draw(found);
  if (choice) {
    const listed = choice.dataset.listed.split(" ");
    found.metrics.forEach((metric, k) => choice.add(new Option(`${metric.title} (${metric.unit})`, k)));
    choice.value = found.metrics.findIndex((metric) => metric.field === "rms-y" || metric.field === listed[0]);
    again = () => draw(found, found.metrics[choice.value]);
    choice.addEventListener("change", again);
    chart.addEventListener("keydown", (event) => arrows(event, found));
    tellFailures(found);
  }
  again();
  new ResizeObserver(() => {
    const drawn = chart.querySelector("svg");
    if (drawn && Math.abs(drawn.width.baseVal.value - chart.querySelector(".drawing").clientWidth) > 2) again();
  }).observe(chart);
}
if (chart) show();
