// Shows the page in the language that the browser prefers, or that was chosen here: texts are replaced in place from that
// language's catalogue (/static/de.json). English, and texts that a catalogue lacks, stay as they are. In all languages, symbols
// such as f_d get a real subscript, and the code names in brackets, which sentences have for the terminal, are left out.
(() => {
  const script = document.currentScript;
  const base = script.src.replace(/\/static\/[^/]*$/, ""); // A proxy may put a path before ours.
  const offered = { en: "English", ...JSON.parse(script.dataset.languages) };
  const KEPT = "flexlab-language";
  const LONGEST_WAIT = 1500; // ms for which a page stays blank rather than show English
  const MOST_KEPT = 4000; // translations of sentences with numbers, and untranslated texts
  const LONGEST = 1000; // most characters of a text that is compared with patterns: longer ones were written by people
  const ATTRIBUTES = ["title", "label", "aria-label", "placeholder", "alt", "aria-valuetext", "value"];
  const MARKS = { CODE: ["`", "`"], KBD: ["`", "`"], B: ["**", "**"], STRONG: ["**", "**"], EM: ["*", "*"], I: ["*", "*"], A: ["[", "]"],
    SUB: ["<sub>", "</sub>"], WBR: ["", ""] };
  const ALONE = "script, noscript, style, textarea, pre, [translate=no]"; // Never translated.
  const PICTURE = 'img[src*="/assets/pictures/"], img.figure';
  const WORD = /\p{L}{3}/u, UNITS = /\b(m?rad|kHz|min|max|RMS|[Nn]a[Nn]|flexlab|[a-z]\w*([._]\w+)+)\b|(?<!\w)'[^']*'(?!\w)/g, NUMBER = /\d[\d.e+−-]*/g;
  const BEFORE_UNIT = /(?<=[\d}⁰¹²³⁴⁵⁶⁷⁸⁹]) (?=(?:[kmµ]?m|[km]?s|1\/s|k?Hz|[km]?N|N·m|m?J|m?rad|kg|[kMG]B|%)(?!\p{L}))|(?<=[=≈≤≥×]) (?=[+−-]?[\d{])| (?=[=≈≤≥×] [+−-]?[\d{])/gu; // no breaks
  const NEXT = "(?:\\p{Lu}|[a-z]\\w*[.:]\\S|line \\d)"; // how a sentence begins: a capital, the path of a field, a file, a line of it
  const SENTENCE = new RegExp(`(?<=[.!?✓]) (?=\\d|${NEXT})`, "u");
  const WITHIN = `((?:(?![.!?] ${NEXT})[^\`*])+?)`; // the value of a placeholder: part of one sentence
  const NUMERAL = "([+−-]?\\d(?:[\\d.e+−-]*\\d)?(?:(?: · 10)?[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?)";
  const KINDS = { n: NUMERAL, m: NUMERAL, code: "([a-z\\d](?:\\S*[^\\s.])?)", folder: "(\\S.*?)",
    symbol: "([A-Za-z]?[^\\sa-z]\\S*|[A-Za-z])" }; // else any part

  const SYMBOL = /(?<![\p{L}\p{Nd}_.\\-])(\p{L}\p{M}*)_([\p{L}\p{Nd}]{1,4})(?![\p{L}\p{Nd}_]|\.\p{L})/u;
  const PATH = "(?:controller|grips|initial|joints|left_arm|payload|right_arm|simulation|trajectory)(?:\\.\\w+)+";
  const FIELD_NAMES = new RegExp(` ?[(（]${PATH}(?: = [\\w.+−-]+)?(?:, ${PATH})*[)）]`, "gu"), IN_CODE = "code, kbd, pre";
  const PLAIN = "option, title, code, kbd, svg", FIELDS = "select[name^=field]"; // A menu of fields shows no such symbols.

  let exact = new Map(), patterns = new Map(), kept = new Map(), watching = null, language = "en";
  const texts = new WeakMap(), attributes = new WeakMap(); // node → { source: English, shown: its present text }
  const pictures = new WeakMap(); // image → its file
  const lowered = new WeakMap(); // text → { whole: what it shows, head: its own value, tail: the nodes after it }
  const own = new WeakSet(); // the nodes of such tails
  const untranslated = new Set();

  function read(catalogue) {
    [exact, patterns, kept] = [new Map(), new Map(), new Map()];
    untranslated.clear();
    for (const [english, translated] of Object.entries(catalogue)) {
      const shown = translated.replace(BEFORE_UNIT, "\u00a0");
      if (!/\{\w+\}/.test(english)) { exact.set(english, shown); continue; }
      const literals = english.split(/\{\w+\}/), names = [...english.matchAll(/\{(\w+)\}/g)].map(([, name]) => name);
      const form = new RegExp(`^${literals.map((part, k) => part.replace(/[.*+?^${}()|[\]\\]/g, "\\$&") +
        (k === names.length ? "" : KINDS[names[k]] ?? WITHIN)).join("")}$`, "su");
      const first = english.match(/^[^\s{]+(?= )/)?.[0] ?? "";
      const length = literals.join("").length;
      if (!patterns.has(first)) patterns.set(first, []);
      patterns.get(first).push({ form, names, shown, length, bare: !WORD.test(literals.join(" ")) });
    }
    for (const list of patterns.values()) list.sort((a, b) => b.length - a.length);
  }

  const isMore = (text) => SYMBOL.test(text) || text.search(FIELD_NAMES) >= 0; // whether it changes in English, too
  const isWords = (text) => exact.has(text) || WORD.test(text.replace(UNITS, ""));
  const fill = ({ names, shown }, values) => shown.replace(/\{(\w+)\}/g, (whole, name) => values[names.indexOf(name)] ?? whole);

  function byPattern(text, bare) {
    if (text.length > LONGEST) return undefined;
    let partly;
    for (const first of [text.split(" ", 1)[0], ""]) {
      for (const pattern of patterns.get(first) ?? []) {
        const match = pattern.bare === bare && pattern.form.exec(text);
        if (!match) continue;
        const missed = [];
        const values = match.slice(1).map((value, k) => {
          const found = pattern.names[k] in KINDS || !isWords(value) ? value : translate(value);
          if (found === undefined) missed.push(value);
          return found ?? value;
        });
        const found = { length: missed.length ? 0 : pattern.length, missed, shown: fill(pattern, values) };
        if ((!bare || !missed.length) && !(partly?.length >= found.length)) partly = found;
        if (!missed.length) break;
      }
    }
    partly?.missed.forEach(miss);
    return partly?.shown;
  }

  function bySentence(text) {
    const sentences = text.length > 4 * LONGEST ? [] : text.split(SENTENCE);
    if (sentences.length < 2) return undefined;
    const shown = [], missed = [];
    for (let first = 0, last; first < sentences.length; first = last) {
      let found;
      for (last = sentences.length; last > first; last -= 1) { // The longest known part.
        const part = sentences.slice(first, last).join(" ");
        if (part !== text) found = exact.get(part) ?? byPattern(part, false);
        if (found !== undefined) break;
      }
      if (found === undefined) {
        last = first + 1;
        found = byPattern(sentences[first], true) ?? (isWords(sentences[first]) ? undefined : sentences[first]);
        if (found === undefined) missed.push(sentences[first]);
      }
      shown.push(found ?? sentences[first]);
    }
    if (missed.length === sentences.length) return undefined;
    missed.forEach(miss);
    return shown.reduce((all, next) => all + (/[。！？]$/.test(all) ? "" : " ") + next);
  }

  // The translation of an English text; undefined if there is none.
  function translate(text) {
    if (exact.has(text)) return exact.get(text);
    if (kept.has(text)) return kept.get(text);
    const shown = byPattern(text, false) ?? bySentence(text) ?? byPattern(text, true);
    if (kept.size > MOST_KEPT) kept.clear();
    kept.set(text, shown);
    return shown;
  }

  function miss(text) {
    if (isWords(text) && untranslated.size < MOST_KEPT) untranslated.add(text.replace(NUMBER, "0"));
  }

  function shownBy(text) {
    const parts = lowered.get(text);
    return parts?.head === text.nodeValue ? parts.whole : text.nodeValue;
  }

  function current(text) {
    const seen = texts.get(text);
    return seen?.shown === shownBy(text) ? seen.source : shownBy(text);
  }

  function put(text, source, told) {
    const shown = text.parentElement?.closest(IN_CODE) ? told : told.replace(FIELD_NAMES, "");
    texts.set(text, { source, shown });
    if (shownBy(text) === shown && (lowered.has(text) || !SYMBOL.test(shown))) return;
    raise(text);
    const part = text.parentElement;
    if (part?.closest(FIELDS)) lower(text, shown, [shown.replace(new RegExp(` ${SYMBOL.source}(?= \\(|$)`, "u"), "")]);
    else lower(text, shown, part?.closest(PLAIN) ? [shown] : shown.split(SYMBOL));
  }

  // `rest`: for each symbol its letter, its subscript and the text after it.
  function lower(text, whole, [head, ...rest]) {
    const tail = [];
    if (text.nodeValue !== head + (rest[0] ?? "")) text.nodeValue = head + (rest[0] ?? "");
    if (text.nodeValue === whole) return;
    for (let k = 0; k < rest.length; k += 3) {
      const index = document.createElement("sub");
      index.textContent = rest[k + 1];
      tail.push(index, document.createTextNode(rest[k + 2] + (rest[k + 3] ?? "")));
    }
    for (const node of tail) own.add(node).add(node.firstChild ?? node);
    lowered.set(text, { whole, head: text.nodeValue, tail });
    text.after(...tail);
  }

  function raise(text) {
    lowered.get(text)?.tail.forEach((node) => node.remove());
    lowered.delete(text);
  }

  // A text and the texts and inline elements beside it make one sentence, in which elements become markdown marks.
  const flows = (node) => node?.nodeType === Node.TEXT_NODE || (node?.tagName in MARKS && !node.matches(ALONE));

  function runOf(text) {
    let first = text;
    while (first.parentNode?.tagName in MARKS) first = first.parentNode;
    while (flows(first.previousSibling)) first = first.previousSibling;
    const run = [];
    for (let node = first; flows(node); node = node.nextSibling) run.push(node);
    return run;
  }

  function flatten(nodes, parts = []) { // → marks (strings) and texts (nodes) in their order
    for (const node of nodes) {
      if (own.has(node)) continue;
      if (node.nodeType === Node.TEXT_NODE) parts.push(node);
      else if (node.tagName in MARKS) {
        const [before, after] = MARKS[node.tagName];
        if (before) parts.push(before);
        flatten(node.childNodes, parts);
        if (after) parts.push(after);
      }
    }
    return parts;
  }

  const spaces = (text) => text.replace(/\s+/g, " ");

  function showRun(parts) {
    const whole = spaces(parts.map((part) => typeof part === "string" ? part : current(part)).join(""));
    let found = language === "en" || !isWords(whole) ? undefined : exact.get(whole.trim()) ??
      byPattern(whole.trim(), false) ?? byPattern(whole.trim(), true);
    if (found === undefined) {
      if (!SYMBOL.test(whole) || parts.some((part) => typeof part === "string")) return whole.trim();
      found = whole.trim(); // viser breaks it after the _ of its symbol
      if (language !== "en") miss(found);
    }
    let rest = whole.match(/^ ?/)[0] + found + whole.match(/ ?$/)[0];
    const shown = [];
    for (const [k, part] of parts.entries()) {
      if (typeof part !== "string" && k > 0 && typeof parts[k - 1] !== "string") shown.push([part, ""]); // viser breaks long words
      else if (typeof part !== "string") {
        const mark = parts.slice(k + 1).find((later) => typeof later === "string");
        const end = mark === undefined ? rest.length : rest.indexOf(mark);
        if (end < 0) return whole.trim();
        shown.push([part, rest.slice(0, end)]);
        rest = rest.slice(end);
      } else if (rest.startsWith(part)) rest = rest.slice(part.length);
      else return whole.trim();
    }
    for (const [text, word] of shown) put(text, current(text), word);
    return "";
  }

  function showText(text) {
    const source = current(text), trimmed = spaces(source).trim();
    const alone = text.parentElement?.closest("code, kbd");
    const found = language === "en" || alone || !isWords(trimmed) ? undefined : translate(trimmed);
    put(text, source, found === undefined ? source : source.match(/^\s*/)[0] + found + source.match(/\s*$/)[0]);
    return found !== undefined || alone || !isWords(trimmed);
  }

  function showAttribute(part, name) {
    const menu = name === "value"; // A menu that is an input: its translation is drawn over it.
    if (menu ? part.getAttribute("aria-haspopup") !== "listbox" : !part.hasAttribute(name)) return;
    const known = attributes.get(part) ?? attributes.set(part, {}).get(part);
    const value = part.getAttribute(name) ?? "";
    const source = known[name]?.shown === value && !menu ? known[name].source : value;
    const found = language === "en" || !isWords(source) ? undefined : translate(source);
    if (found === undefined && language !== "en") miss(source);
    const shown = name === "value" ? found ?? source : (found ?? source).replace(FIELD_NAMES, "");
    known[name] = { source, shown };
    if (!menu) { if (value !== shown) part.setAttribute(name, shown); }
    else if (found === undefined) delete part.parentElement.dataset.flShown;
    else part.parentElement.dataset.flShown = shown;
  }

  // A drawing that is a file is replaced with a translated copy in the page.
  async function showPicture(image) {
    const file = pictures.get(image) ?? image.src;
    if (language === "en" && !pictures.has(image)) return;
    pictures.set(image, file);
    const answer = await fetch(file);
    if (!answer.ok) return;
    // Styles are renamed while the drawing is parsed: the page's policy, which holds for parsed text too, forbids inline ones.
    const drawing = new DOMParser().parseFromString((await answer.text()).replaceAll("style", "resting"), "image/svg+xml");
    for (const text of drawing.querySelectorAll("text")) {
      const source = text.textContent.trim();
      const shown = source.split("  ").map((part) => {
        const found = translate(part);
        if (found === undefined && language !== "en") miss(part);
        return found?.replace(` · ${part}`, "") ?? part; // a chart has no room for both
      }).join("  ");
      if (shown !== source) text.textContent = shown; // Else its raised exponents are kept.
    }
    image.src = language === "en" ? file
      : `data:image/svg+xml,${encodeURIComponent(new XMLSerializer().serializeToString(drawing).replaceAll("resting", "style"))}`;
  }

  function show(nodes, named = []) {
    const done = new Set();
    const text = (node) => {
      if (done.has(node) || own.has(node) || !node.isConnected || node.parentElement?.closest(ALONE)) return;
      const run = runOf(node), parts = flatten(run), among = parts.filter((part) => typeof part !== "string");
      for (const part of among) done.add(part);
      const flows = parts.length > 1 && run.some((part) => part.nodeType === Node.TEXT_NODE && isWords(current(part)));
      const left = flows ? showRun(parts) : "";
      if (flows && !left) return;
      if (left && among.some((part) => isWords(current(part)) && !part.parentElement.closest("code, kbd") && translate(spaces(current(part)).trim()) === undefined)) {
        for (const part of among) put(part, current(part), current(part)); // All in English rather than only a part.
        if (language !== "en") miss(left);
        return;
      }
      const missed = among.filter((part) => !showText(part)).map((part) => spaces(current(part)).trim());
      if (missed.length && language !== "en") (left ? [left] : missed).forEach(miss);
    };
    const element = (node) => {
      if (node.closest(ALONE)) return;
      for (const name of ATTRIBUTES) showAttribute(node, name);
      if (pictures.has(node) || node.matches(PICTURE)) showPicture(node);
    };
    for (const node of nodes) {
      if (node.nodeType === Node.TEXT_NODE) text(node);
      if (node.nodeType !== Node.ELEMENT_NODE || !node.isConnected) continue;
      element(node);
      const walker = document.createTreeWalker(node, NodeFilter.SHOW_ELEMENT | NodeFilter.SHOW_TEXT);
      while (walker.nextNode()) (walker.currentNode.nodeType === Node.TEXT_NODE ? text : element)(walker.currentNode);
    }
    for (const [part, name] of named) if (part.isConnected && !part.closest(ALONE)) showAttribute(part, name);
  }

  function changed(records) {
    const nodes = new Set(), named = [];
    const english = language === "en"; // Then only symbols are looked for.
    const isNew = (text) => !own.has(text) && texts.get(text)?.shown !== shownBy(text) && (!english || texts.has(text) || isMore(text.nodeValue));
    for (const { type, target, addedNodes, removedNodes, attributeName } of records) {
      if (type === "characterData") { if (isNew(target)) nodes.add(target); }
      else if (type === "attributes") named.push([target, attributeName]);
      else {
        for (const node of removedNodes) raise(node);
        for (const node of addedNodes) {
          if (node.nodeType === Node.TEXT_NODE ? isNew(node) : !own.has(node) && (!english || /_|\(\w+\./.test(node.textContent))) nodes.add(node);
        }
      }
    }
    show(nodes, named);
  }

  async function turnTo(code) {
    const catalogue = code === "en" ? {} : await (await fetch(`${base}/static/${code}.json`)).json();
    read(catalogue);
    language = code;
    document.documentElement.lang = code;
    show([document.documentElement]);
    watching ??= new MutationObserver(changed);
    watching.disconnect();
    const attributes = code === "en" ? {} : { attributes: true, attributeFilter: ATTRIBUTES };
    watching.observe(document.documentElement, { subtree: true, childList: true, characterData: true, ...attributes });
  }

  // For scripts that read the page: the English text of a part, or of its attribute, whatever language is shown.
  window.flexlabEnglish = (part, name) => {
    if (name) {
      const known = attributes.get(part)?.[name], value = part.getAttribute(name);
      return known?.shown === value ? known.source : value;
    }
    return flatten([...part.childNodes].flatMap(function inner(node) {
      return own.has(node) ? [] : node.nodeType === Node.TEXT_NODE ? [node] : [...node.childNodes].flatMap(inner);
    })).map(current).join("");
  };
  window.flexlabUntranslated = untranslated; // for whoever completes a catalogue
  const ask = window.confirm.bind(window);
  window.confirm = (question) => ask(translate(question) ?? question);

  function offer(chosen) {
    const choice = document.createElement("select");
    choice.className = "language";
    choice.translate = false;
    choice.setAttribute("aria-label", "Language / Sprache / 语言");
    for (const [code, name] of Object.entries(offered)) choice.add(new Option(name, code, false, code === chosen));
    choice.addEventListener("change", () => {
      try { localStorage.setItem(KEPT, choice.value); } catch { /* Then the choice holds for this page only. */ }
      turnTo(choice.value);
    });
    (document.getElementById("server-bar") ?? document.querySelector("body > header"))?.append(choice);
  }

  let before = null;
  try { before = localStorage.getItem(KEPT); } catch { /* No storage: the browser's languages count. */ }
  const preferred = [before, ...navigator.languages.map((name) => name.split("-")[0])];
  const chosen = preferred.find((code) => Object.hasOwn(offered, code)) ?? "en";
  if (chosen === "en") turnTo(chosen);
  else {
    const root = document.documentElement, appear = () => root.style.removeProperty("visibility");
    root.style.visibility = "hidden";
    setTimeout(appear, LONGEST_WAIT);
    turnTo(chosen).finally(appear);
  }
  addEventListener("DOMContentLoaded", () => setTimeout(() => offer(chosen)));
})();
