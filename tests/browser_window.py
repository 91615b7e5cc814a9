"""Windows of the tests' browser: as a person's, but drawn seldom, and the lab's pixels only where somebody looks at them.

A machine without a graphics card pays for each picture.
"""

import os
from typing import Any

from playwright.sync_api import Browser, BrowserContext

PAUSE = 250
"""ms without drawing after each picture: else the page draws all the time, and takes a whole processor."""
LEFT_OUT = (
    # Pages that stand ready below the address bar of every window, unseen: three quarters of an empty window's cost.
    *("WebUIOmniboxPopup", "WebUIOmniboxAimPopup"),
    # As playwright has it: of two such lists Chromium takes the last one.
    *("AvoidUnnecessaryBeforeUnloadCheckSync", "DestroyProfileOnBrowserClose", "HttpsUpgrades", "LensOverlay"),
    *("HttpsFirstBalancedModeAutoEnable", "MediaRouter", "PaintHolding", "ThirdPartyStoragePartitioning"),
    *("AvoidCorsURLLoaderRestartOnRedirect", "OptimizationHints", "NetworkTimeServiceQuerying", "AimEnabled"),
    *("PreconnectToSearch", "Translate"),
)
"""Features of Chromium that no test needs."""
SOFTWARE_RENDERING = [
    # Rerun's viewer is not compiled a second time, to run faster: no page of a test lives long enough to gain by it.
    "--js-flags=--no-wasm-tier-up --no-wasm-dynamic-tiering",
    f"--disable-features={','.join(LEFT_OUT)}",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-sandbox",
    "--ignore-gpu-blocklist",
]
"""What Chromium needs to draw the lab and rerun's viewer without a graphics card."""
BY_THE_PROCESSOR = "--disable-gpu-compositing"
"""Leaves all but the lab's scene to the processor: 2.5 times cheaper than to have a graphics card imitated for it. Rerun's viewer
cannot be looked at then."""
PATIENCE = 90_000
"""ms that a page on a busy machine may take for anything."""
PICTURES = bool(os.environ.get("FLEXLAB_PICTURES"))
"""Whether somebody wants screenshots to look at: each costs a second of a processor, and the lab is drawn for them."""
REST = "(rests) => window.flexlabRest(rests)"
"""Has a page draw nothing (true) until it is to go on (false)."""
SELDOM = f"""(() => {{
  const draw = window.requestAnimationFrame.bind(window);
  const waiting = new Map();
  let count = 0, timer = null, rests = false;
  const run = (now) => {{
    timer = null;
    const calls = [...waiting.values()];
    waiting.clear();
    for (const call of calls) {{ try {{ call(now); }} catch (error) {{ reportError(error); }} }}
  }};
  const begin = () => {{ if (!rests && waiting.size) timer ??= setTimeout(() => draw(run), {PAUSE}); }};
  window.requestAnimationFrame = (call) => {{
    count += 1;
    waiting.set(count, call);
    begin();
    return count;
  }};
  window.flexlabRest = (wanted) => {{ rests = wanted; begin(); }};
  window.cancelAnimationFrame = (number) => {{ waiting.delete(number); }};
}})()"""

UNDRAWN = """(() => {
  for (const call of ['Arrays', 'Elements', 'ArraysInstanced', 'ElementsInstanced'])
    WebGL2RenderingContext.prototype[`draw${call}`] = () => {};
})()"""
"""Leaves the last step of each picture out, the pixels: they take a processor, and only in some tests somebody looks at them."""
BUT_THE_VIEWER = f"if (!location.pathname.includes('/viewer/')) {UNDRAWN}"


def open_window(browser: Browser, width: int, height: int, drawn: bool = PICTURES, **options: Any) -> BrowserContext:
    """A browser's window of its own, px: no cookies yet, no page yet. `drawn`: somebody looks at the lab's scene."""
    context = browser.new_context(viewport={"width": width, "height": height}, **options)
    context.set_default_timeout(PATIENCE)
    context.add_init_script(SELDOM)
    if not drawn:
        context.add_init_script(BUT_THE_VIEWER)
    return context
