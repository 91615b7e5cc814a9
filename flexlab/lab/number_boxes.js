// Makes number boxes accept 1.5e-3 and −3 as people write and copy them: viser's drop the letter and the sign, giving 1.53 and 3.
// A box that is left without a number shows its last one again. A typed number takes effect when the typing pauses, or at once on
// Enter, an arrow key, a shortcut or leaving the box: otherwise 600 would take effect as 6 and as 60 first. A pasted or dropped
// text that is no number is refused in a sentence: viser would drop its letters and take 0x10 for 10.
(() => {
  const POWER = /^[+-]?(\d+[.,]?\d*|[.,]\d+)e([+-]?\d*)$/i;
  const NUMBER = /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i;
  const DIGITS = { useGrouping: false, maximumSignificantDigits: 15 };
  const value = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value"), setValue = value.set;
  const isBox = (part) => part?.matches?.("input.mantine-NumberInput-input");
  const isNumber = (text) => text.trim() !== "" && Number.isFinite(Number(text));
  const REST = 400, PAUSE = 3000; // ms after which a typed number takes effect, and after which the typing counts as ended
  const READ = 5000, LONGEST = 20; // ms for which a refusal stays, and characters of the refused text in it
  const last = new WeakMap(); // box → its last number
  let held = null, timer = 0; // a box whose text has not taken effect yet
  let busy = null, pause = 0; // a box in which somebody types
  let written = null; // a number with a power of ten, as far as it is typed

  // While somebody types, the page changes neither text nor caret: an earlier value that arrives late would mix with the digits.
  const tell = function (text) { if (this !== busy) setValue.call(this, text); };
  const { setSelectionRange } = HTMLInputElement.prototype;
  const select = function (...range) { if (this !== busy) setSelectionRange.apply(this, range); };
  Object.defineProperty(HTMLInputElement.prototype, "value", { ...value, set: tell });
  Object.defineProperty(HTMLInputElement.prototype, "setSelectionRange", { value: select });

  function begin(box) {
    if (busy !== box) end();
    busy = box;
    clearTimeout(pause);
    pause = setTimeout(end, PAUSE);
  }

  function end() {
    const box = busy, acts = held !== null;
    act();
    busy = null;
    clearTimeout(pause);
    if (!box || acts) return; // the page will show what takes effect now
    const told = box[Object.keys(box).find((name) => name.startsWith("__reactProps$"))]?.value;
    if (told !== undefined) setValue.call(box, told);
  }

  function hold(box) {
    begin(box);
    held = box;
    clearTimeout(timer);
    timer = setTimeout(act, REST);
  }

  function act() {
    const box = held;
    held = null;
    clearTimeout(timer);
    if (!box) return;
    setValue.call(box, box.value.replace(/^([^,.]*),([^,]*)$/, "$1.$2")); // viser takes a comma for a point only if it is typed alone
    box.dispatchEvent(new Event("input", { bubbles: true }));
  }

  function show(box, text) {
    setValue.call(box, text);
    hold(box);
  }

  // In place of viser's box, which drops 2,5 and 1,234.5 without a word. A text that is dropped replaces the box's own.
  function paste(event) {
    const box = event.target, dropped = event.dataTransfer;
    if (!isBox(box)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (dropped) box.select();
    const text = (dropped ?? event.clipboardData).getData("text").trim(), number = text.replace("−", "-").replace(",", ".");
    const whole = box.value.slice(0, box.selectionStart) + number + box.value.slice(box.selectionEnd);
    if (NUMBER.test(whole) && Number.isFinite(Number(whole))) {
      show(box, /e/i.test(whole) ? Number(whole).toLocaleString("en-US", DIGITS) : whole);
      return;
    }
    const shown = text.length > LONGEST ? `${text.slice(0, LONGEST)}…` : text;
    const { right, bottom } = box.getBoundingClientRect();
    const word = Object.assign(document.createElement("p"),
      { className: "fl-refused", textContent: `'${shown}' is not a number: write one such as 0.5 or 1e3.` });
    word.setAttribute("role", "alert");
    Object.assign(word.style, { right: `${innerWidth - right}px`, top: `${bottom}px` });
    document.querySelector(".fl-refused")?.remove();
    document.body.append(word);
    setTimeout(() => word.remove(), READ);
  }

  function write(event) {
    const box = event.target;
    if (!isBox(box)) return;
    const before = written ?? box.value.slice(0, box.selectionStart);
    const after = written === null ? box.value.slice(box.selectionEnd) : "";
    written = null;
    if (event.data === null || !event.inputType.startsWith("insert")) return;
    const text = event.data.replaceAll("−", "-"), whole = (before + text + after).trim(), power = POWER.exec(whole);
    if (power) {
      event.preventDefault();
      written = whole;
      const number = Number(whole.replace(",", "."));
      if (/\d$/.test(power[2]) && Number.isFinite(number)) show(box, number.toLocaleString("en-US", DIGITS));
    } else if (text !== event.data) {
      event.preventDefault();
      document.execCommand("insertText", false, text);
    }
  }

  // An iPhone's keys for decimals have no minus sign, which the play screen does not need.
  const lacksMinus = /iPhone|iPod/.test(navigator.platform);
  addEventListener("pointerdown", ({ target }) => {
    if (lacksMinus && isBox(target) && !target.closest("[data-fl-play]")) target.inputMode = "text";
  }, true);

  const forget = () => { written = null; };
  const keep = ({ target }) => { if (isBox(target) && isNumber(target.value)) last.set(target, target.value); };
  const typed = (event) => {
    if (!event.isTrusted || !isBox(event.target)) return;
    event.stopImmediatePropagation();
    hold(event.target);
  };
  addEventListener("beforeinput", write, true);
  addEventListener("paste", paste, true);
  addEventListener("drop", paste, true);
  // viser's boxes note the caret at each key, and lose text that is written beyond the end of the text that they know.
  addEventListener("keydown", (event) => {
    const { key, ctrlKey, metaKey } = event;
    if (key.length > 1 && key !== "Shift") forget();
    if (["Enter", "Tab", "ArrowUp", "ArrowDown"].includes(key)) end();
    else if (ctrlKey || metaKey) { act(); if (isBox(event.target)) begin(event.target); }
    else if (isBox(event.target) && key !== "Escape") event.stopPropagation();
  }, true);
  addEventListener("pointerdown", () => { forget(); end(); }, true);
  addEventListener("focusin", keep, true);
  addEventListener("input", keep, true);
  addEventListener("input", typed, true);
  addEventListener("focusout", ({ target: box }) => {
    forget();
    if (isBox(box) && !isNumber(box.value) && last.has(box)) show(box, last.get(box));
    end();
  }, true);
})();
