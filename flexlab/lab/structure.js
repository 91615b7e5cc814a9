// Evaluates the rules of the lab's style sheet that ask what a part contains (:has). A browser evaluates each of them again after
// any change of the page; as the lab's numbers change all the time, that took half of the page's work. This script evaluates them
// when the structure of the page has changed, and marks the selected parts; the rules in the sheet select the marks instead.
(() => {
  const MARK = "data-fl-rule", CHANGED = "flexlab-structure";
  // The parts that such rules refer to, without the numbers, curves and words that change all the time.
  const PARTS = `button, input, label, svg, img, [class*="mantine-"], .uplot-container, #server-bar, .fl-begin, .fl-scrub, .fl-back,
    .fl-box, .fl-why, .fl-caption, .fl-float, .fl-reports`;
  const STATES = ["class", "aria-expanded", "data-fl-play", "data-fl-panel"]; // attributes that such rules refer to
  const asked = []; // the selectors and the parts with their marks: [{ selector, marked }]

  // The selectors of a list; commas within parentheses do not separate.
  const separate = (list) => list.split(/,(?![^(]*\))(?![^(]*\([^()]*\)[^()]*\))/).map((part) => part.trim());

  // The selector of the marked parts, with the same specificity as `selector`.
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

  // ms between two rounds; least ratio of the pause to a round's duration; longest pause, ms: a slow machine evaluates less often,
  // but often enough that a person does not see unmarked parts for long.
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
  // An attribute that is set to its old value, as when an absent class is removed, has not changed.
  const matters = ({ type, target, attributeName, oldValue, addedNodes, removedNodes }) => type === "attributes"
    ? target.getAttribute(attributeName) !== oldValue
    : [...addedNodes].some(isPart) || [...removedNodes].some(isPart);
  // What floats over the picture would stand in the panel until the next round, and move the buttons there.
  const floats = ({ target, addedNodes }) => addedNodes.length > 0 && target.querySelector(":scope > div > .fl-scrub") !== null;
  const WATCHED = { subtree: true, childList: true, attributes: true, attributeFilter: STATES, attributeOldValue: true };

  window.flexlabAsked = asked;
  addEventListener("DOMContentLoaded", () => {
    for (const sheet of document.styleSheets) if (sheet.ownerNode?.textContent.includes(".fl-unseen")) takeOver(sheet.cssRules);
    new MutationObserver((changes) => {
      const mattering = changes.filter(matters), left = mattering.some(floats) ? 0 : next - performance.now();
      if (mattering.length === 0 || (due && left > 0)) return;
      if (left <= 0) ask(); // before the change is drawn
      else [due] = [true, setTimeout(ask, left)];
    }).observe(document.documentElement, WATCHED);
    ask();
  });
})();
