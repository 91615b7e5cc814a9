"""The page's style sheet: what viser's widgets need to become one compact, aligned panel in light and dark mode.

viser has no options for these things, and its page takes a style element. Nothing depends on it: without it the same
widgets stand below one another at their usual size.
"""

SHEET = """
/* Text has at least 4.5 times the brightness of its ground, or the reverse; viser's grays and its blue have 3.3 to 4. */
:root[data-mantine-color-scheme] { --mantine-color-dimmed: #5b6670; --fl-bad: #c92a2a; --mantine-color-red-text: #c92a2a;
  --mantine-color-anchor: var(--mantine-color-blue-8); --mantine-color-blue-filled: var(--mantine-color-blue-8);
  --mantine-color-blue-filled-hover: var(--mantine-color-blue-9); --mantine-color-gray-filled: var(--mantine-color-gray-7);
  --mantine-color-gray-filled-hover: var(--mantine-color-gray-8); --mantine-color-placeholder: #5b6670; }
:root[data-mantine-color-scheme="dark"] { --mantine-color-dimmed: #a6a6a6; --fl-bad: #ff8787; --mantine-color-red-text: #ff8787;
  --mantine-color-anchor: var(--mantine-color-blue-4); --mantine-color-placeholder: #a6a6a6; }
.mantine-Slider-markLabel { color: var(--mantine-color-dimmed) !important; }
[role="tab"] { opacity: 1 !important; }
[data-mantine-color-scheme="dark"] [role="tab"][aria-selected="true"] { color: var(--mantine-color-blue-4) !important; }
@media (prefers-reduced-motion: reduce) {
  *, ::before, ::after { animation: none !important; transition: none !important; scroll-behavior: auto !important; } }
/* For screen readers alone. */
.fl-unseen { position: absolute; clip-path: inset(50%); width: 1px; height: 1px; margin: 0; overflow: hidden; }
[data-fl-pressed]:focus-visible { outline: 2px solid var(--mantine-color-blue-filled); outline-offset: 1px; }
/* A quantity is a number box with its slider below: the box's label is wide, the slider has neither label nor box. */
div:has(> div > .mantine-NumberInput-root):not(:has(.mantine-Slider-root)) > div:first-child,
div:has(> div > div > .mantine-NumberInput-root):not(:has(.mantine-Slider-root)) > div:first-child {
  width: auto !important; flex: 1 1 auto !important; }
div:has(> p > label) + div:has(.mantine-NumberInput-root):not(:has(.mantine-Slider-root)) {
  flex: 0 0 6.2em !important; }
div:has(> p > label):has(+ div .mantine-Slider-root) { display: none; }
div:has(> .mantine-Slider-root) > .mantine-NumberInput-root { display: none; }
.mantine-Slider-root { margin: -0.35em 2.2em 0.35em 0.3em; }
/* The way back to the usual value stands at the end of the slider's line. */
div:has(.mantine-Slider-root) + div:has(> button[data-block]):not(:has(svg, img)) {
  display: block; position: relative; height: 0; margin: 0 !important; padding: 0 !important; }
div:has(.mantine-Slider-root) + div > button[data-block]:not(:has(svg, img)) {
  position: absolute; right: 0.7em; top: -2em; height: 1.5em; padding: 0 0.4em; }
/* Several numbers of one field stand in a row below their label. */
.mantine-Flex-root:has(> div .mantine-NumberInput-root + .mantine-NumberInput-root) { display: block !important; }
.mantine-Flex-root:has(> div .mantine-NumberInput-root + .mantine-NumberInput-root) > div { width: 100% !important; }
div:has(.mantine-NumberInput-root):not(:has(.mantine-Slider-root)) + div:has(> button[data-block]):not(:has(svg, img)) {
  display: block; position: relative; height: 0; margin: 0 !important; padding: 0 !important; }
div:has(.mantine-NumberInput-root):not(:has(.mantine-Slider-root)) + div > button[data-block]:not(:has(svg, img)) {
  position: absolute; right: 9.2em; top: -2.5em; height: 1.5em; padding: 0 0.4em; }
div:has(.mantine-NumberInput-root + .mantine-NumberInput-root) + div > button[data-block]:not(:has(svg, img)) {
  right: 0.8em; top: -4.3em; }
.mantine-NumberInput-controls { display: none; }
.mantine-NumberInput-input { text-align: right; font-variant-numeric: tabular-nums; padding-inline-end: 0.5em !important; }
label { letter-spacing: -0.2px; }
p:has(> label) { letter-spacing: -0.2px !important; color: var(--mantine-color-text) !important; }
/* A switch stands at the end of its line. */
div:has(> p > label):has(+ div .mantine-Checkbox-root) { width: auto !important; flex: 1 1 auto !important; }
div:has(> p > label) + div:has(.mantine-Checkbox-root) { flex: 0 0 auto !important; }
/* Buttons stand side by side. */
div:has(> button[data-block]) { display: inline-block; margin-inline: 0.6em 0; vertical-align: top; }
button[data-block] { width: auto; padding-inline: 0.8em; }
/* One big way to begin a run that stands at its start, over the picture. */
div:has(> .fl-begin) + div:has(> button) { position: fixed; z-index: 250; left: var(--fl-picture-middle, 50%); bottom: 4.5em;
  transform: translateX(-50%); margin: 0; padding: 0; }
div:has(> .fl-begin) + div > button { height: 3.2em !important; padding-inline: 1.4em !important; font-size: 1.25em;
  border-radius: 2em; box-shadow: 0 0.3em 1.2em rgba(0, 0, 0, 0.35); }
/* The bar that looks back runs along the lower edge of the picture, its words and its two buttons above it. */
.fl-scrub, div:has(> .fl-scrub) + div:has(.mantine-Slider-root), div:has(> .fl-scrub) + div + div:has(> button[data-block]),
div:has(> .fl-scrub) + div + div + div:has(> button[data-block]) { --fl-edge: calc(var(--fl-picture-below, 0px) + 2.5rem);
  position: fixed; z-index: 250; left: var(--fl-picture-middle, 50%); transform: translateX(-50%); bottom: var(--fl-edge);
  margin: 0 !important; padding: 0 !important; }
/* What is not the bar itself is the picture's: a click there goes through. */
div:has(> .fl-scrub) + div:has(.mantine-Slider-root) { width: min(26rem, calc(var(--fl-picture-width, 28rem) - 2rem));
  pointer-events: none; }
div:has(> .fl-scrub) + div .mantine-Slider-root { pointer-events: auto; }
.fl-scrub { pointer-events: none; }
div:has(> .fl-scrub) + div .mantine-Slider-root { margin: 0; --track-bg: rgb(134 142 150 / 0.55); }
div:has(> .fl-scrub) + div .mantine-Slider-track::before { background-color: var(--track-bg); }
div:has(> .fl-scrub) + div div:has(> p > label) { display: block; width: auto !important; }
div:has(> .fl-scrub) + div p { text-shadow: 0 0 0.4em var(--mantine-color-body), 0 0 0.2em var(--mantine-color-body); }
div:has(> .fl-scrub) + div .mantine-Slider-markWrapper { display: none; }
.fl-scrub { bottom: calc(var(--fl-edge) + 1.3rem); }
.fl-scrub .fl-box { background: var(--mantine-color-body); margin: 0; padding: 0.1em 0.6em; font-variant-numeric: tabular-nums; }
div:has(> .fl-scrub) + div + div:has(> button[data-block]) { bottom: calc(var(--fl-edge) + 3rem);
  transform: translateX(calc(-100% - 0.2rem)); }
div:has(> .fl-scrub) + div + div + div:has(> button[data-block]) { bottom: calc(var(--fl-edge) + 3rem);
  transform: translateX(0.2rem); }
/* The button that has the beam sound stands in the picture's other lower corner. */
.fl-hear { position: fixed; z-index: 250; bottom: calc(var(--fl-picture-below, 0px) + 0.5rem); padding: 0.15rem 0.7rem;
  right: calc(100vw - var(--fl-picture-left, 0px) - var(--fl-picture-width, 100vw) + 0.6rem); border: 0; border-radius: 1rem;
  font: 13px/1.5 system-ui, sans-serif; color: #e6eaf0; background: rgb(29 35 43 / 0.85); cursor: pointer; }
.fl-hear[aria-pressed="true"] { background: var(--mantine-color-blue-8); color: #fff; }
.fl-hear:focus-visible { outline: 2px solid #f2a33a; }
.fl-behind { position: fixed; z-index: 320; top: 3.2rem; left: var(--fl-picture-middle, 50%); transform: translateX(-50%);
  width: max-content; max-width: 92vw; box-sizing: border-box; margin: 0; padding: 0.3em 0.8em;
  border-radius: 4px; font: 14px/1.4 system-ui, sans-serif; color: #1c2430; background: #ffd8a8;
  pointer-events: none; }
.fl-behind[hidden] { display: none; }
/* All tabs stand on one line, the open one as wide as it was closed. */
[role="tab"], [role="tab"] * { font-weight: 500 !important; letter-spacing: -0.2px; }
[role="tablist"] { flex-wrap: nowrap !important; }
[role="tab"] { padding-inline: 0.3em !important; font-size: 0.92em !important; }
[role="tab"] * { font-size: inherit !important; }
@media (max-width: 1199px) { [role="tab"] { padding-inline: 0.15em !important; font-size: 0.82em !important; } }
/* In one column the sheet is as wide as the screen and leaves most of it to the picture. */
@media (max-width: 60em) {
  div[style*="position: fixed"][style*="width: 20em"] { width: 100% !important; max-height: 37% !important; }
  div[style*="position: fixed"][style*="width: 20em"] div[style="width: 20em;"] { width: 100% !important; }
  /* Plots and guide are opened at its head: below all the sliders nobody would find them. */
  div:has(> div > .mantine-Tabs-root > [role="button"][aria-expanded]) { display: flex; flex-direction: column; }
  div:has(> .mantine-Tabs-root > [role="button"][aria-expanded]) { order: -1; }
  /* Else a plot keeps the sheet as wide as it was once drawn. */
  .mantine-ScrollArea-content { min-width: 0 !important; }
  .fl-float { bottom: auto !important; top: 48px; width: 92vw !important; }
  div:has(> .fl-begin) + div:has(> button) { bottom: 42%; }
}

.fl { padding: 0 1.1em 0.5em 0.75em; font-size: 0.875em; line-height: 1.4; }
.fl-title { font-weight: 600; font-size: 1.05em; line-height: inherit; margin: 0; }
.fl-dim { color: var(--mantine-color-dimmed); }
.fl-grid { display: grid; grid-template-columns: auto auto; gap: 0 0.75em; font-variant-numeric: tabular-nums; }
.fl-grid > :nth-child(odd) { color: var(--mantine-color-dimmed); }
.fl-grid > :nth-child(even) { text-align: right; }
.fl-dot { display: inline-block; width: 0.65em; height: 0.65em; border-radius: 50%; margin-right: 0.45em; }
.fl-strip { display: inline-block; width: 4.5em; height: 0.7em; border-radius: 2px; vertical-align: middle; }
.fl-table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; margin-bottom: 0.5em; }
.fl-table th { font-weight: 500; color: var(--mantine-color-dimmed); text-align: left; padding: 0 0.5em 0 0; }
.fl-table td { padding: 0.1em 0.5em 0.1em 0; border-top: 1px solid var(--mantine-color-default-border); }
.fl-code { user-select: all; cursor: copy; overflow-wrap: anywhere; font-family: monospace; font-size: 0.85em;
  max-height: 6em; overflow-y: auto; padding: 0.3em 0.5em; border: 1px solid var(--mantine-color-default-border); }
.fl-line { overflow-wrap: anywhere; }
.fl-bad { color: var(--fl-bad); }
.fl-float { position: fixed; bottom: 4.2rem; left: var(--fl-picture-middle, 50%); transform: translateX(-50%); z-index: 300;
  pointer-events: none; width: clamp(14em, calc(var(--fl-picture-width, 40em) - 2em), 36em); padding: 0; }
:root:has(.fl-scrub > .fl-box) .fl-float { bottom: 7.8rem; }
.fl-float .fl-box { background: var(--mantine-color-body); box-shadow: 0 2px 12px rgba(0, 0, 0, 0.35); }
/* The factor of the drawn deflection is always to be seen, in the lower corner of the picture. */
.fl-caption { position: fixed; z-index: 4; left: calc(var(--fl-picture-left, 0px) + 0.6em);
  bottom: calc(var(--fl-picture-below, 0px) + 0.5em); padding: 0; pointer-events: none; font-weight: 500;
  text-shadow: 0 0 0.4em var(--mantine-color-body), 0 0 0.2em var(--mantine-color-body); }
/* The number for the back rows stands beside the plot of a presentation only. */
.fl-number { display: none; position: fixed; z-index: 6; right: 0.5rem; top: 0.5rem; width: 18rem; text-align: right;
  font-size: 1.6rem; padding: 0.5rem 1rem; }
.fl-number b { font-size: 4rem; line-height: 1.1; font-variant-numeric: tabular-nums; white-space: nowrap; }
/* The play screen is all that its panel shows, and nowhere else to be seen. */
html:not(.fl-playing) [data-fl-play], .fl-playing [data-dock-region="left"], .fl-playing [data-floating-window],
.fl-playing [data-fl-panel] > :not([data-fl-play]):not(:has(.fl-caption, .fl-float, .fl-begin)):not(:has(> .fl-begin) + *) {
  display: none !important; }
.fl-playing [data-dock-root] > div:first-child { left: 0 !important; }
.fl-playing [data-dock-root] > div[style*="box-shadow"],
.fl-playing div:has(> .mantine-Tabs-root > [role="button"][aria-expanded]) { display: none; }
/* It has no numbers that a warning of their accuracy could be about, nor the settings that such a warning names. */
.fl-playing .fl-caution { display: none; }
.fl-box { border-radius: 4px; padding: 0.4em 0.6em; margin: 0.2em 0; overflow-wrap: anywhere; }
.fl-error { background: rgba(224, 49, 49, 0.14); border-left: 3px solid #e03131; }
.fl-done { background: rgba(0, 158, 115, 0.16); border-left: 3px solid #009e73; }
.fl-badge { font-size: 0.75em; font-weight: 500; padding: 0.1em 0.5em; border-radius: 0.8em; white-space: nowrap;
  background: rgba(230, 159, 0, 0.25); }
.fl-info { background: rgba(0, 114, 178, 0.12); border-left: 3px solid #0072b2; }
.fl-why { margin-top: 0.35em; overflow-wrap: anywhere; }
.fl-why .fl-dim { display: inline-block; }
.fl-list { max-height: 11em; overflow-y: auto; overflow-wrap: anywhere; font-variant-numeric: tabular-nums; }
/* The labels of a slider's ends stay between its ends. */
.mantine-Slider-markWrapper:first-of-type .mantine-Slider-markLabel { transform: translate(-0.2em, 0.03rem) !important; }
.mantine-Slider-markWrapper:last-of-type .mantine-Slider-markLabel {
  transform: translate(calc(-100% + 0.4em), 0.03rem) !important; }
/* A value between the ends that means something is seen on the bar, filled or not, in light and dark. */
.mantine-Slider-markWrapper:not(:first-of-type):not(:last-of-type) .mantine-Slider-mark {
  background: #e8590c !important; border-color: #e8590c !important; }
/* Charts stand side by side where there is room for two. */
div:has(> div > .uplot-container) { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(22rem, 100%), 1fr));
  padding-top: 0.2em !important; }
div:has(> div > .uplot-container) > :not(:has(.uplot-container)) { grid-column: 1 / -1; }
[data-floating-window] { max-width: calc(var(--fl-picture-width, 100vw) - 16px); }
.uplot-container { margin-block: 0.1em; }
.uplot .u-legend { margin-top: 0 !important; }
.u-legend th, .u-legend td { padding: 2px !important; }
.uplot .u-legend .fl-unnamed { display: none; }
.u-legend .u-value { min-width: 2.3em; display: inline-block; text-align: left; font-variant-numeric: tabular-nums; }
"""


def style_element() -> str:
    """The sheet as an HTML element."""
    return f"<style>{SHEET}</style>"
