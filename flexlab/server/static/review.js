// The viewer wants the recording's full address, which only the browser knows for sure.
const base = document.currentScript.src.replace(/\/static\/[^/]*$/, "");
const viewer = document.getElementById("viewer");
const recording = new URL(viewer.dataset.recording, location.href).href;
viewer.src = `${base}/viewer/?url=${encodeURIComponent(recording)}&hide_welcome_screen&renderer=webgl`;

// Continue goes on from the viewer's cursor, unless somebody has typed another time.
const time = document.querySelector('form[action$="/continue"] [name="time"]');
const LONGEST = 1e15; // ns: later ones are of the clock
const end = +viewer.dataset.end || Infinity; // s: playing, the viewer goes a little past it before it stops
let counting = false; // The viewer shows a count instead of a time; it does not always tell of the first timeline.
let typed = false;
time?.addEventListener("input", () => { typed = time.value !== ""; });
addEventListener("message", (message) => {
  if (message.source !== viewer.contentWindow || message.origin !== location.origin || !time || typed) return;
  let event;
  try { event = JSON.parse(message.data); } catch { return; } // "READY", which the viewer says first
  if (event?.type === "timeline_change") counting = event.timeline === "log_tick";
  else if (event?.type !== "time_update") return;
  if (counting || event.time > LONGEST) return;
  const told = (event.time / 1e9).toFixed(3);
  time.value = +told < end ? told : viewer.dataset.end;
});
