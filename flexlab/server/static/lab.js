// What the server adds to the lab's page: links to other pages, a link to share, and a notice when the lab is gone.
(() => {
  const LOOK = 3000; // ms between two checks whether the lab is still there
  const stateAddress = document.currentScript.dataset.state;
  const base = document.currentScript.src.replace(/\/static\/[^/]*$/, ""); // A proxy may put a path before ours.

  function element(tag, properties = {}, ...children) {
    const made = Object.assign(document.createElement(tag), properties);
    made.append(...children);
    return made;
  }

  const sentence = element("p");
  const actions = element("p");
  const word = element("div", { className: "server-word", hidden: true, role: "alert" },
    element("div", {}, sentence, actions));

  let said = "", sharing = false;

  function say(text, ...buttons) {
    if (!word.hidden && said === text) return; // The element may show it in another language.
    [said, sharing] = [text, false];
    sentence.textContent = text;
    actions.replaceChildren(...buttons);
    word.hidden = false;
  }

  function done() {
    sharing = false;
    word.hidden = true;
    sharer.focus();
  }

  addEventListener("keydown", (event) => {
    if (!sharing || event.key !== "Escape") return;
    event.stopImmediatePropagation(); // Esc also ends a presentation.
    done();
  }, true);
  word.addEventListener("click", ({ target }) => { if (sharing && target === word) done(); });

  const link = (path, text) => element("a", { href: base + path, textContent: text });
  const button = (text, onclick) => element("button", { textContent: text, onclick });
  const sharer = button("Share", share);
  const live = Object.assign(link("", "Live data"), { hidden: true, target: "_blank", rel: "noopener" });
  const GONE = "Runs are kept. This page goes on by itself when the lab is back.";
  let missed = 0;
  let opened = false;

  async function look() {
    if (document.hidden) return;
    let answer, state;
    try {
      answer = await fetch(stateAddress, { cache: "no-store" });
      state = answer.ok ? await answer.json() : { open: false, sentence: `This lab is closed. ${GONE}` };
    } catch {
      missed += 1;
      if (missed > 1) say(`The lab does not answer: flexlab was closed, or the connection is gone. ${GONE}`);
      return;
    }
    if (answer.status === 401) {
      say("This lab needs its token.", link("/", "Sign in"));
      return;
    }
    missed = 0;
    if (state.open) {
      opened = true;
      if (!sharing) word.hidden = true;
      live.hidden = !state.live;
      if (state.live) live.href = base + state.live;
      return;
    }
    // A restarted server does not know earlier labs.
    if (opened && state.unknown) location.replace(`${base}/lab/`);
    say(state.sentence, link("/lab/", "Open a new lab"), link("/runs", "Runs"), link("/", "Start page"));
  }

  async function share() {
    let state;
    try { state = await (await fetch(stateAddress, { cache: "no-store" })).json(); } catch { /* `look` tells why. */ }
    if (!state?.open) return look();
    if (!state.link) {
      say("This scenario is too long for a link: download it as a file.", button("Close", done));
      sharing = true;
      return;
    }
    const address = base + state.link;
    const shown = element("input", { value: address, readOnly: true, ariaLabel: "Link to this lab" });
    const copy = async () => {
      shown.select();
      // Without https only the old way to the clipboard works.
      try { await navigator.clipboard.writeText(address); } catch { document.execCommand("copy"); }
      done();
    };
    say("This link opens the lab with the scenario as it is now:", shown, button("Copy", copy), button("Close", done));
    sharing = true;
    shown.select();
  }

  document.addEventListener("DOMContentLoaded", () => {
    const bar = element("nav", { id: "server-bar", ariaLabel: "flexlab" }, link("/", "Start"), link("/runs", "Runs"), link("/studies", "Studies"),
      sharer, live);
    document.body.append(bar, word);
    look();
    setInterval(look, LOOK);
    document.addEventListener("visibilitychange", look);
  });
})();
