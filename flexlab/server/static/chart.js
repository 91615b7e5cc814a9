// Small SVG drawings: axes with ticks, a colour scale that the colour-blind can read, marks that are links.
const VIRIDIS = ["440154", "482878", "3e4989", "31688e", "26828e", "1f9e89", "35b779", "6ece58", "b5de2b", "fde725"]
  .map((word) => [0, 2, 4].map((at) => parseInt(word.slice(at, at + 2), 16)));
const WIDE_SPREAD = 100; // ratio of the largest to the least value above which a scale is logarithmic

function svg(tag, properties = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(properties)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

function viridis(share) {
  const place = Math.min(Math.max(share, 0), 1) * (VIRIDIS.length - 1);
  const low = Math.min(Math.floor(place), VIRIDIS.length - 2);
  const mix = VIRIDIS[low].map((part, k) => Math.round(part + (place - low) * (VIRIDIS[low + 1][k] - part)));
  return `rgb(${mix.join(",")})`;
}

// A number as `number_text` of flexlab/text.py writes it: 1000, −0.5 and 2.5 · 10⁻⁹.
function number(value, digits = 3) {
  const shown = Number(value.toPrecision(digits)), size = Math.abs(shown);
  if (size === 0 || (size >= 1e-4 && size < 1e7)) return String(shown).replace("-", "−");
  const [mantissa, exponent] = size.toExponential().split("e").map(Number);
  const power = "10" + String(exponent).replace(/./g, (sign) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(sign)]);
  return (shown < 0 ? "−" : "") + (mantissa === 1 ? power : `${mantissa} · ${power}`);
}

// Numbers as texts, with enough digits to tell them apart.
function numbers(values) {
  for (let digits = 3; ; digits++) {
    const said = values.map((value) => number(value, digits));
    if (digits > 8 || new Set(said).size === new Set(values).size) return said;
  }
}

// A scale from the least to the largest value, as a share from 0 to 1; logarithmic where they are far apart.
function scaleOf(values) {
  const known = values.filter((value) => value !== null);
  const low = Math.min(...known);
  const high = Math.max(...known);
  const logarithmic = known.length > 0 && low > 0 && high > WIDE_SPREAD * low;
  const [a, b] = logarithmic ? [Math.log(low), Math.log(high)] : [low, high];
  return {
    low, high, logarithmic, empty: known.length === 0,
    share: (value) => (b > a ? ((logarithmic ? Math.log(value) : value) - a) / (b - a) : 0.5),
    value: (share) => (logarithmic ? Math.exp(a + share * (b - a)) : a + share * (b - a)),
  };
}

// About `count` round numbers of a scale.
function roundTicks(scale, count) {
  if (scale.empty) return [];
  if (scale.high === scale.low) return [scale.low];
  if (scale.logarithmic) {
    const ticks = [];
    const decades = Math.log10(scale.high / scale.low);
    for (let power = Math.floor(Math.log10(scale.low)); power <= Math.log10(scale.high); power++) {
      for (const digit of decades < 3 ? [1, 2, 5] : [1]) ticks.push(digit * 10 ** power);
    }
    const inside = ticks.filter((tick) => tick >= scale.low * 0.999 && tick <= scale.high * 1.001);
    return inside.filter((_, k) => k % Math.ceil(inside.length / count) === 0);
  }
  const raw = (scale.high - scale.low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((digit) => digit * power).find((size) => size >= raw);
  const ticks = [];
  for (let k = Math.ceil(scale.low / step - 1e-9); k * step <= scale.high + step * 1e-9; k++) ticks.push(k * step);
  return ticks;
}

function text(words, x, y, anchor = "middle", more = {}) {
  return svg("text", { x, y, "text-anchor": anchor, ...more }, words);
}

// Draws a frame with labelled axes: `across` and `up` are lists of [share of the side, words].
function frame(drawing, box, across, up, labels) {
  const { left, top, width, height } = box;
  drawing.append(svg("rect", { x: left, y: top, width, height, class: "frame" }));
  for (const [share, words] of across) {
    const x = left + share * width;
    drawing.append(svg("line", { x1: x, x2: x, y1: top + height, y2: top + height + 4, class: "tick" }),
      text(words, x, top + height + 17));
  }
  for (const [share, words] of up) {
    const y = top + (1 - share) * height;
    drawing.append(svg("line", { x1: left - 4, x2: left, y1: y, y2: y, class: "tick" }), text(words, left - 7, y + 4, "end"));
  }
  drawing.append(text(labels[0], left + width / 2, top + height + 38, "middle", { class: "title" }));
  const [x, y] = [13, top + height / 2];
  drawing.append(text(labels[1], x, y, "middle", { class: "title", transform: `rotate(-90 ${x} ${y})` }));
}
