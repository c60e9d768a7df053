// Scenes of the swim page: the one that its link carries, guided ones, and policies that are dropped.
// Nothing of a link or a file is ever run; what cannot be read gets a sentence, and the page goes on.
"use strict";
const Scenes = (() => {
  const get = (id) => document.getElementById(id);
  const { live: { shortest, most, first: FIRST }, worlds, grades, troubles } = FACTS;
  const FARTHEST = 1000, LARGEST = 64; // m from the origin; MB of a file
  let refused = ""; // what was wrong with the link that the page was opened with

  // --- links: #length=12&world=posts&seed=3&target=0.100,-0.200,... ------------------------------

  const number = (text, low, high, whole = false) => {
    const value = Number(text);
    if (!/^-?[\d.]+$/.test(text) || !(value >= low && value <= high) || (whole && !Number.isInteger(value))) throw new RangeError();
    return value;
  };
  const oneOf = (text, names) => {
    if (!names.includes(text)) throw new RangeError();
    return text;
  };
  const PARTS = {
    length: ["a length of 2 to 128 units", (text) => number(text, shortest, most, true)],
    seed: ["a seed, a whole number", (text) => number(text, 0, 2 ** 32 - 1, true)],
    world: [`a world: ${Object.keys(worlds).join(", ")}`, (text) => oneOf(text, Object.keys(worlds))],
    target: ["a target with a point for each unit", (text) => points(text)],
    pieces: [`the lengths of at most ${FACTS.live.chains} chains, ${shortest} or more each, as many units as there are`, pieces],
    policy: ["the name of a policy", (text) => text],
    current: [`a current: two numbers of at most ${FACTS.live.current} m/s`, (text) => pairs(text, FACTS.live.current)[0]],
    troubles: ["troubles that there are", (text) => text.split(",").map((one) => oneOf(one, Object.keys(troubles)))],
    grade: ["a grade", (text) => oneOf(text, grades)],
  };

  function pairs(text, far) {
    const values = text.split(",").map((one) => number(one, -far, far));
    if (values.length % 2 || values.length > 2 * most) throw new RangeError();
    return Array.from({ length: values.length / 2 }, (_, i) => [values[2 * i], values[2 * i + 1]]);
  }

  const points = (text) => pairs(text, FARTHEST);

  function pieces(text) {
    const sizes = text.split(",").map((one) => number(one, shortest, most, true));
    if (sizes.length > FACTS.live.chains) throw new RangeError();
    return sizes;
  }

  /** The scene of a link, and what is wrong with it; then the scene is a usual one. */
  function parse(hash) {
    const scene = {};
    let name = "";
    try {
      for (const part of hash.replace(/^#/, "").split("&").filter(Boolean)) {
        const [key, value = "", ...rest] = decodeURIComponent(part).split("=");
        name = key;
        if (rest.length || !Object.hasOwn(PARTS, key)) throw new RangeError();
        scene[key] = PARTS[key][1](value);
      }
      const length = scene.length ?? FIRST;
      name = "target";
      if (scene.target && scene.target.length !== length) throw new RangeError();
      name = "pieces";
      if (scene.pieces && scene.pieces.reduce((sum, size) => sum + size) !== length) throw new RangeError();
    } catch {
      const meant = Object.hasOwn(PARTS, name) ? `it should say ${PARTS[name][0]}` : "it says what this page does not know";
      return { scene: {}, wrong: `The link is damaged: ${meant}.` };
    }
    return { scene, wrong: "" };
  }

  /** What the page begins with. */
  function first() {
    const { scene, wrong } = parse(location.hash);
    refused = wrong && `${wrong} This is a scene of the page's own.`;
    return scene;
  }

  function link(live) {
    const sizes = live.chains.map(({ units }) => units.length), parts = { length: sizes.reduce((sum, size) => sum + size, 0), ...live.scene };
    if (sizes.length > 1) parts.pieces = sizes.join(",");
    parts.target = live.chains.flatMap((one) => live.targetOf(one)).map(([x, y]) => `${x.toFixed(3)},${y.toFixed(3)}`).join(",");
    if (live.policy !== get("policy").options[0].value) parts.policy = encodeURIComponent(live.policy);
    if (live.current.some(Boolean)) parts.current = live.current.map((v) => v.toFixed(3)).join(",");
    if (live.troubles.length) Object.assign(parts, { troubles: live.troubles.join(","), grade: live.grade });
    return `#${Object.entries(parts).map(([key, value]) => `${key}=${value}`).join("&")}`;
  }

  function share(live) {
    const hash = link(live), address = location.href.replace(/#.*$/, "") + hash;
    location.replace(hash); // no new entry of the history, and nothing is loaded
    const told = () => live.toast("The link to this scene is in the address bar", "good");
    if (!navigator.clipboard) { told(); return; }
    navigator.clipboard.writeText(address).then(() => live.toast("The link to this scene is copied", "good"), told);
  }

  // --- guided scenes: three sentences each, then hands on -----------------------------------------

  const whole = (live) => live.chains[0];
  const GUIDED = {
    task: { title: "The paper's task", scene: { length: 8, seed: 5 }, says: [
      ["Eight units hang on soft joints, and each can push with one jet, across the chain and no other way."],
      ["Each unit swims to its own ghost: no one steers the chain as a whole, a unit hears only its two neighbours."],
      ["The target is taken once the whole chain is within 5.1 cm of it. Drag the ghosts: it follows."],
    ] },
    length: { title: "Any length", scene: { length: 12, seed: 8 }, says: [
      ["This controller was trained on chains of 2 to 16 units; here swim 12."],
      ["Now there are 40. It has never met so many, and its weights are the same.", (live) => live.send("resize", { chain: whole(live).name, length: 40 })],
      ["Pull the slider Length up to 128 and give it a new target: it swims on as you pull."],
    ] },
    sea: { title: "Trouble at sea", scene: { length: 16, seed: 11 }, says: [
      ["In still water with every jet at work, 16 units take their target like this."],
      ["Now a quarter of the jets is dead (the crosses): the others carry them along.", (live) => live.send("trouble", { names: ["dead"], grade: "medium" })],
      ["A changing current and noisy sensors come on top. Pour on more with the button Trouble, or take it all away.", (live) => live.send("trouble", { names: ["dead", "current", "noise"], grade: "medium" })],
    ] },
    split: { title: "Split, pass, merge", scene: { length: 12, seed: 6, world: "posts" }, says: [
      ["A chain of 12 among posts: as one it is long, and has to bend round them."],
      ["Cut in two, each half has its own target and finds its own way: the same weights steer both.", (live) => live.send("cut", { chain: whole(live).name, link: 5 })],
      ["With Join, and their ends near each other, they are one chain again. Cut where you like; each part may be as short as 2.", merge],
    ] },
  };

  // Joins the two halves once their ends are near, as the button does.
  function merge(live, left = 100) {
    if (live.chains.length < 2 || !left) return;
    const [a, b] = live.chains, ends = ({ units }) => [units[0], units[units.length - 1]];
    const gap = Math.min(...ends(a).flatMap((p) => ends(b).map((q) => Math.hypot(p[0] - q[0], p[1] - q[1]))));
    if (gap < FACTS.live.reach) live.send("join", { chain: a.name, other: b.name });
    else setTimeout(merge, 200, live, left - 1);
  }

  const guide = { name: "", at: 0 };

  function tell(live, name, at) {
    const { title, scene, says } = GUIDED[name], [sentence, act] = says[at];
    Object.assign(guide, { name, at });
    if (at === 0) live.send("scene", scene);
    act?.(live);
    get("guide").hidden = false;
    unfold(false);
    get("guide-title").textContent = `${title} ${at + 1}/${says.length}`;
    get("guide-says").textContent = sentence;
    get("guide-next").textContent = at + 1 < says.length ? "Next" : "Your turn";
    live.follow();
  }

  function next(live) {
    if (guide.at + 1 < GUIDED[guide.name].says.length) tell(live, guide.name, guide.at + 1);
    else get("guide").hidden = true;
  }

  // --- a policy of one's own ----------------------------------------------------------------------

  async function take(live, file) {
    if (!file) return;
    if (file.size > LARGEST * 2 ** 20) { live.toast(`A policy has at most ${LARGEST} MB: this file is larger`); return; }
    try { live.send("policy", { buffer: await file.arrayBuffer() }); } catch { live.toast("This file cannot be read"); }
  }

  function droppable(live) {
    const over = (event) => { event.preventDefault(); document.body.classList.toggle("dropping", event.type === "dragover"); };
    for (const name of ["dragover", "dragleave"]) document.addEventListener(name, over);
    document.addEventListener("drop", (event) => {
      over(event);
      take(live, event.dataTransfer.files[0]);
    });
    get("file").addEventListener("change", (event) => { take(live, event.target.files[0]); event.target.value = ""; });
  }

  // --- the panel ------------------------------------------------------------------------------------

  function hear(live, state) {
    live.scene = state.scene;
    live.world = state.scene.world;
    if (document.activeElement !== get("world")) get("world").value = state.scene.world;
    const chain = live.chosen(), slider = get("long");
    if (chain && document.activeElement !== slider) slider.value = chain.units.length;
    if (refused) { live.toast(refused); refused = ""; }
  }

  // How much of the water's lower end a guide hides: on a phone it is as wide as the page.
  const covers = () => (get("guide").offsetWidth > 0.7 * innerWidth ? get("guide").offsetHeight : 0);

  function unfold(on) {
    get("scene").hidden = !on;
    get("scenes").setAttribute("aria-expanded", on);
  }

  function begin(live) {
    const click = (id, act) => get(id).addEventListener("click", () => act(live));
    get("world").replaceChildren(...Object.keys(worlds).map((name) => new Option(name, name)));
    get("world").addEventListener("change", (event) => live.send("scene", { length: live.chosen()?.units.length, seed: live.scene.seed, world: event.target.value }));
    get("long").addEventListener("input", (event) => live.send("resize", { chain: live.chosen().name, length: +event.target.value }));
    get("long").addEventListener("change", (event) => event.target.blur());
    get("guided").replaceChildren(...Object.entries(GUIDED).map(([name, { title }]) => {
      const button = document.createElement("button");
      button.textContent = title;
      button.dataset.scene = name;
      button.addEventListener("click", () => tell(live, name, 0));
      return button;
    }));
    get("help").querySelector("dl").append(...get("more-help").content.children);
    click("scenes", () => {
      unfold(get("scene").hidden);
      if (!get("scene").hidden && !get("troubles").hidden) Tools.showTroubles(); // one panel at a time
    });
    click("trouble", () => unfold(false));
    click("share", share);
    click("guide-next", next);
    click("guide-close", () => { get("guide").hidden = true; });
    droppable(live);
    addEventListener("hashchange", () => {
      const { scene, wrong } = parse(location.hash);
      if (wrong) live.toast(`${wrong} The scene stays as it is.`);
      else if (location.hash !== link(live)) live.send("scene", scene);
    });
  }

  return { begin, covers, first, hear, link, parse };
})();
