"""Browser windows for the tests: they draw seldom, and leave out the pixels of the lab's scene where no test looks at it.

On a machine without a graphics card, each frame costs processor time.
"""

import os
from typing import Any

from playwright.sync_api import Browser, BrowserContext

PAUSE = 250
"""Pause after each frame, ms: without it a page draws all the time and takes a whole processor."""
VIEWERS_PAUSE = 1000
"""The same for rerun's viewer, each of whose frames takes a third of a second of processor time."""
LEFT_OUT = (
    # Hidden pages that every window keeps ready below its address bar: three quarters of an empty window's cost.
    *("WebUIOmniboxPopup", "WebUIOmniboxAimPopup"),
    # Playwright's own list, repeated here because Chromium takes only the last of two such lists.
    *("AvoidUnnecessaryBeforeUnloadCheckSync", "DestroyProfileOnBrowserClose", "HttpsUpgrades", "LensOverlay"),
    *("HttpsFirstBalancedModeAutoEnable", "MediaRouter", "PaintHolding", "ThirdPartyStoragePartitioning"),
    *("AvoidCorsURLLoaderRestartOnRedirect", "OptimizationHints", "NetworkTimeServiceQuerying", "AimEnabled"),
    *("PreconnectToSearch", "Translate"),
)
"""Features of Chromium that no test needs."""
SOFTWARE_RENDERING = [
    # Do not compile rerun's viewer a second time for speed: no page of a test lives long enough to gain from it.
    "--js-flags=--no-wasm-tier-up --no-wasm-dynamic-tiering",
    f"--disable-features={','.join(LEFT_OUT)}",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-sandbox",
    "--ignore-gpu-blocklist",
]
"""Options with which Chromium draws the lab and rerun's viewer without a graphics card."""
BY_THE_PROCESSOR = "--disable-gpu-compositing"
"""Draws everything but the lab's scene directly on the processor: 2.5 times cheaper than through the emulated graphics card.
Rerun's viewer cannot be seen then."""
PATIENCE = 90_000
"""Timeout for anything that a page does, ms: generous, as the machine may be busy."""
PICTURES = bool(os.environ.get("FLEXLAB_PICTURES"))
"""Whether to take screenshots for people: each costs a second of processor time, and the lab is drawn for them."""
REST = "(rests) => window.flexlabRest(rests)"
"""Script that stops a page from drawing (true) and lets it go on (false)."""
AT_ONCE = "(frames) => window.flexlabFrames(frames)"
"""Script that draws a number of frames without pauses."""
SELDOM = f"""(() => {{
  const draw = window.requestAnimationFrame.bind(window);
  const isViewer = location.pathname.includes('/viewer/') || new URLSearchParams(location.search).has('url');
  const pause = isViewer ? {VIEWERS_PAUSE} : {PAUSE};
  const waiting = new Map();
  let count = 0, timer = null, rests = false;
  const run = (now) => {{
    timer = null;
    const calls = [...waiting.values()];
    waiting.clear();
    for (const call of calls) {{ try {{ call(now); }} catch (error) {{ reportError(error); }} }}
  }};
  const begin = () => {{ if (!rests && waiting.size) timer ??= setTimeout(() => draw(run), pause); }};
  window.requestAnimationFrame = (call) => {{
    count += 1;
    waiting.set(count, call);
    begin();
    return count;
  }};
  window.flexlabRest = (wanted) => {{ rests = wanted; begin(); }};
  window.flexlabFrames = async (most) => {{
    for (let i = 0; i < most; i++) await new Promise((done) => draw((now) => {{ clearTimeout(timer); run(now); done(); }}));
  }};
  window.cancelAnimationFrame = (number) => {{ waiting.delete(number); }};
}})()"""

UNDRAWN = """(() => {
  let drawn = false;
  window.flexlabDraw = (wanted) => { drawn = wanted; };
  const all = WebGL2RenderingContext.prototype;
  for (const call of ['drawArrays', 'drawElements', 'drawArraysInstanced', 'drawElementsInstanced']) {
    const draw = all[call];
    all[call] = function (...what) { if (drawn) draw.apply(this, what); };
  }
})()"""
"""Script that skips the last step of each frame, the pixels: they take a processor, and few tests look at them."""
DRAW = "(wanted) => window.flexlabDraw?.(wanted)"
"""Script that has a page draw the pixels as well (true), or skip them again (false)."""
QUIET = "console.debug = () => {}"
"""Script without which rerun's viewer sends eleven thousand notes, each with a list of calls: a third of what it takes."""
BUT_THE_VIEWER = f"if (!location.pathname.includes('/viewer/')) {UNDRAWN}"


def open_window(browser: Browser, width: int, height: int, drawn: bool = PICTURES, **options: Any) -> BrowserContext:
    """Open a new browser context of this size, px, without cookies or pages. `drawn`: the test looks at the lab's scene."""
    context = browser.new_context(viewport={"width": width, "height": height}, **options)
    context.set_default_timeout(PATIENCE)
    context.add_init_script(SELDOM)
    context.add_init_script(QUIET)
    if not drawn:
        context.add_init_script(BUT_THE_VIEWER)
    return context
