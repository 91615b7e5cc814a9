// The rules of the lab's sheet that ask what a part holds (:has), answered here: a browser asks each of them again after any
// change of the page, and the lab's numbers change all the time, which took half of the page's work. Here they are asked when
// the structure of the page has changed, and what they are about gets a mark that takes their place in the sheet.
(() => {
  const MARK = "data-fl-rule", CHANGED = "flexlab-structure";
  // What such rules speak of. Numbers, curves and words that change all the time are none of it.
  const PARTS = `button, input, label, svg, img, [class*="mantine-"], .uplot-container, #server-bar, .fl-begin, .fl-scrub, .fl-back,
    .fl-box, .fl-why, .fl-caption, .fl-float, .fl-reports`;
  const STATES = ["class", "aria-expanded", "data-fl-play", "data-fl-panel"]; // attributes of which such rules speak
  const asked = []; // the selectors, and the parts that have their marks: [{ selector, marked }]

  // The selectors of a list; those within parentheses are parts of one.
  const separate = (list) => list.split(/,(?![^(]*\))(?![^(]*\([^()]*\)[^()]*\))/).map((part) => part.trim());

  // What selects the marked parts, and counts as much as `selector` where rules compete.
  function markOf(selector, number) {
    const plain = selector.replace(/:(has|not|is|where)\b/g, " ").replace(/"[^"]*"/g, "");
    const count = (pattern) => (plain.match(pattern) ?? []).length;
    const ids = count(/#[\w-]+/g), classes = count(/\.[\w-]+|\[[^\]]*\]|(?<!:):[\w-]+/g);
    const kinds = count(/(?<![\w.#:[-])[a-z][\w-]*(?![^[]*\])/g);
    return `:where([${MARK}~="${number}"])${":not(#none)".repeat(ids)}${":not(.none)".repeat(classes)}${":not(none)".repeat(kinds)}`;
  }

  function takeOver(rules, parent) {
    for (const rule of rules) {
      const { selectorText: list } = rule;
      if (list?.includes(":has(")) {
        rule.selectorText = separate(list).map((selector) => {
          if (!selector.includes(":has(")) return selector;
          const [own, pseudo] = selector.match(/^(.*?)(::[\w-]+)?$/).slice(1);
          const nested = own.replace(/^& ?/, "");
          asked.push({ selector: parent ? `:is(${parent}) ${nested}` : own, marked: new Set() });
          return `${own === nested ? "" : "& "}${markOf(nested, asked.length - 1)}${pseudo ?? ""}`;
        }).join(", ");
      }
      if (rule.cssRules?.length) takeOver(rule.cssRules, list ?? parent);
    }
  }

  function put(part, number, holds) {
    const marks = new Set(part.getAttribute(MARK)?.split(" "));
    if (holds) marks.add(String(number));
    else marks.delete(String(number));
    part.setAttribute(MARK, [...marks].join(" "));
  }

  // ms between two rounds of questions, and the least pause over a round: a slow machine asks less often, but not so seldom that a
  // person sees for long what has no mark yet.
  const PAUSE = 200, SHARE = 10, LONGEST = 1000;
  let due = false, next = -Infinity;

  function ask() {
    const begun = performance.now();
    due = false;
    asked.forEach((question, number) => {
      const found = new Set(document.querySelectorAll(question.selector));
      for (const part of question.marked) if (!found.has(part)) put(part, number, false);
      for (const part of found) if (!question.marked.has(part)) put(part, number, true);
      question.marked = found;
    });
    const now = performance.now();
    next = now + Math.min(Math.max(PAUSE, SHARE * (now - begun)), LONGEST);
    dispatchEvent(new Event(CHANGED)); // for scripts that measure or name parts
  }

  const isPart = (node) => node.nodeType === Node.ELEMENT_NODE && (node.matches(PARTS) || node.querySelector(PARTS) !== null);
  // An attribute that is set to what it was, as a class is that is removed where it is not, has not changed.
  const matters = ({ type, target, attributeName, oldValue, addedNodes, removedNodes }) => type === "attributes"
    ? target.getAttribute(attributeName) !== oldValue
    : [...addedNodes].some(isPart) || [...removedNodes].some(isPart);
  const WATCHED = { subtree: true, childList: true, attributes: true, attributeFilter: STATES, attributeOldValue: true };

  window.flexlabAsked = asked;
  addEventListener("DOMContentLoaded", () => {
    for (const sheet of document.styleSheets) if (sheet.ownerNode?.textContent.includes(".fl-unseen")) takeOver(sheet.cssRules);
    new MutationObserver((changes) => {
      if (due || !changes.some(matters)) return;
      const left = next - performance.now();
      if (left <= 0) ask(); // before the change is drawn
      else [due] = [true, setTimeout(ask, left)];
    }).observe(document.documentElement, WATCHED);
    ask();
  });
})();
