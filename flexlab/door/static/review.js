// The viewer wants the recording's full address, which only the browser knows for sure.
const viewer = document.getElementById("viewer");
const recording = new URL(viewer.dataset.recording, location.href).href;
viewer.src = `/viewer/?url=${encodeURIComponent(recording)}&hide_welcome_screen&renderer=webgl`;
