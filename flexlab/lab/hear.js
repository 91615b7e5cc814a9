// The beam's ring as sound, off until somebody turns it on: a sine for each tone that the lab sends (`ring_sound.py`).
(() => {
  const LOOK = 33, STALE = 700; // ms between two checks; ms after which tones that were not sent again fall silent
  const GLIDE = 0.03; // time constant with which pitch and loudness follow, s
  const FADE = 300; // ms in which a sound fades when it is turned off: without that, it would click
  const VOLUME = 0.3; // gain of the loudest tone; more than three of them share what a sound card can play
  const button = Object.assign(document.createElement("button"), { className: "fl-hear", type: "button", textContent: "Hear it" });
  button.setAttribute("aria-pressed", "false");
  button.title = "The beam's vibration as sound";
  let context = null, master = null, voices = [], on = false, looking, resting, count = "", changed = 0;

  function voice([pitch]) {
    const tone = context.createOscillator(), loudness = context.createGain();
    tone.frequency.value = pitch;
    loudness.gain.value = 0;
    tone.connect(loudness).connect(master);
    tone.start();
    return { tone, loudness };
  }

  function sound(tones) {
    while (voices.length < tones.length) voices.push(voice(tones[voices.length]));
    const share = 1 / Math.max(1, VOLUME * tones.reduce((sum, [, loud]) => sum + loud, 0));
    voices.forEach(({ tone, loudness }, index) => {
      const [pitch, loud] = tones[index] ?? [0, 0];
      if (pitch) tone.frequency.setTargetAtTime(pitch, context.currentTime, GLIDE);
      loudness.gain.setTargetAtTime(share * loud, context.currentTime, GLIDE);
    });
  }

  function look() {
    const told = document.querySelector(".fl-tones")?.dataset;
    const now = performance.now();
    if (told && told.count !== count) {
      [count, changed] = [told.count, now];
      const { factor, tones } = JSON.parse(told.tones);
      sound(tones);
      button.textContent = `Sound: pitch × ${factor}`;
    } else if (now - changed > STALE) {
      changed = Infinity;
      sound([]);
    }
  }

  function toggle() {
    on = !on;
    button.setAttribute("aria-pressed", String(on)); // page.js tells the lab
    button.textContent = on ? "Sound" : "Hear it";
    clearInterval(looking);
    clearTimeout(resting);
    if (!on) {
      sound([]);
      resting = setTimeout(() => context.suspend(), FADE);
      return;
    }
    looking = setInterval(look, LOOK);
    if (!context) {
      context = new AudioContext(); // A browser plays no sound before a click.
      master = context.createGain();
      master.gain.value = VOLUME;
      master.connect(context.destination);
    }
    context.resume();
  }

  button.addEventListener("click", toggle);
  addEventListener("DOMContentLoaded", () => document.body.append(button));
})();
