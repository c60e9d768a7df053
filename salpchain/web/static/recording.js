// Recording what swims, and the replay of it in a window above the page.
"use strict";
const Recording = (() => {
  const get = (id) => document.getElementById(id);
  let mine = false, known = null, running = null;

  function press(live) {
    mine = true;
    live.send("record", { on: running === null });
  }

  // What the server says: seconds of the recording that runs, number of the newest that is finished.
  function hear(state) {
    const { recording, recorded } = state, news = known !== null && recorded > known;
    running = recording;
    const words = running === null ? "Record" : `Stop ${running.toFixed(1)} s`;
    if (get("record").textContent !== words) get("record").textContent = words;
    get("record").setAttribute("aria-pressed", running !== null);
    get("replay").hidden = !recorded;
    known = recorded;
    if (news && mine) { mine = false; show(); }
  }

  function show() {
    get("download").href = get("tab").href = get("player").src = Line.recording(known);
    get("download").download = `salpchain-recording-${known}.html`;
    get("which").textContent = `Recording ${known}`;
    get("recorded").showModal();
  }

  function begin(live) {
    get("record").addEventListener("click", () => press(live));
    get("replay").addEventListener("click", show);
    get("recorded").addEventListener("close", () => get("player").removeAttribute("src")); // it stops
  }

  return { begin, hear, press, show };
})();
