// The line to a world that swims in this browser: in a worker, made from the scripts of this page, or
// in the page itself where none can be made. The counterpart of static/line.js.
"use strict";
const Line = (() => {
  const where = "in this browser";
  const KEPT = 3; // recordings that can be played; older ones are dropped
  const pages = new Map();
  const text = (id) => document.getElementById(id).textContent;

  const beginning = (scene) => ({ type: "begin", scene, weights: Salp.bytes(text("weights")) });

  // `hear` gets every message; the first thing the world hears is its scene.
  function open({ hear, banner, begun }) {
    banner("The water is being let in ...");
    const waiting = [beginning(Scenes.first())];
    let say = (message) => waiting.push(message);
    const ready = (way) => { say = way; waiting.splice(0).forEach(way); };
    const here = () => {
      const world = Tank.serve((message) => setTimeout(hear, 0, structuredClone(message)));
      ready((message) => setTimeout(world, 0, message));
    };
    begun();
    inWorker(hear, ready, here, banner);
    document.addEventListener("visibilitychange", () => say({ type: "watch", on: !document.hidden }));
    return (message) => { say(message); return true; };
  }

  function inWorker(hear, ready, otherwise, banner) {
    let worker, heard = false;
    const scripts = [...document.querySelectorAll("script[data-engine]")].map((script) => script.textContent);
    try {
      worker = new Worker(URL.createObjectURL(new Blob(scripts.map((one) => `${one}\n`), { type: "text/javascript" })));
    } catch { otherwise(); return; }
    worker.onmessage = ({ data }) => {
      if (!heard) ready((message) => worker.postMessage(message));
      heard = true;
      if (data.type !== "ready") hear(data);
    };
    worker.onerror = () => {
      worker.terminate();
      if (heard) banner("The water stands still: something went wrong. Load the page again.", true);
      else otherwise();
    };
  }

  // A recording as a page: the replay page, with its numbers put in as data.
  function keep({ number, data }) {
    const [before, after] = JSON.parse(text("player-page"));
    const inert = JSON.stringify(data).replace(/[<>&]/g, (sign) => `\\u${sign.charCodeAt(0).toString(16).padStart(4, "0")}`);
    pages.set(number, URL.createObjectURL(new Blob([before, inert, after], { type: "text/html" })));
    const old = number - KEPT;
    if (pages.has(old)) URL.revokeObjectURL(pages.get(old));
    pages.delete(old);
  }

  return { begin: Scenes.begin, covers: Scenes.covers, keep, open, recording: (number) => pages.get(number), tell: Scenes.hear, where };
})();
