// The live page: hears the world from the server, draws it at every frame, says what the person does.
"use strict";
(() => {
  const get = (id) => document.getElementById(id);
  const water = get("water"), ctx = water.getContext("2d");
  const PACES = [...get("pace").options].map((option) => +option.value);
  const TRAIL = 120; // steps of the centroid's way that are shown

  const live = {
    chains: [], camera: new Salp.Camera(), current: [0, 0], paused: false, tool: "target",
    name: null, unit: null, sketch: null, held: null, step: 0.1, following: true, connected: false,
    epoch: null, time: null, heard: 0, around: null, world: "still", lags: [], frames: 0, framed: 0, states: 0, troubles: [],
  };
  const ripples = [], trails = new Map(), arrivals = new Map();
  let toasting = null, queued = null;

  // --- talking with the world, wherever it swims (line.js) ---------------------------------------

  const send = Line.open({
    hear: (message) => HEAR[message.type]?.(message),
    banner,
    begun() { live.connected = true; },
    lost() { live.connected = false; buttons(); },
    back() { live.toast("Connected again", "good"); },
  });

  live.send = (type, content = {}) => {
    if (!send({ type, ...content })) live.toast("The server does not answer yet");
  };

  const HEAR = {
    welcome(message) {
      live.step = message.step;
      live.most = message.most;
      live.wall = message.wall; // none where walls cannot be drawn
      live.epoch = null;
      live.world = message.world;
      Object.assign(Salp.sizes, { unit: message.unit, link: message.link });
      Tools.troubles(live, { names: message.troubles, grades: message.grades });
      get("policy").replaceChildren(...message.policies.map((name) => new Option(name, name)));
    },
    state: hearState,
    error: (message) => live.toast(message.text),
    notice: (message) => live.toast(message.text, "good"),
    recording: (message) => Line.keep(message),
  };

  function hearState(state) {
    const now = performance.now();
    live.states += 1;
    const jumped = state.epoch !== live.epoch, moved = jumped || state.time !== live.time;
    const old = new Map(live.chains.map((chain) => [chain.name, chain]));
    live.chains = state.chains.map((chain) => {
      const before = jumped ? null : old.get(chain.name);
      const same = before && before.units.length === chain.units.length;
      if (before && !moved) return { ...chain, from: before.from, at: before.at, shown: chain.units.map(asUnit) };
      if (!same) trails.delete(chain.name); // its middle has jumped
      return { ...chain, from: same ? before.shown : null, at: now, shown: chain.units.map(asUnit) };
    });
    if (jumped) { trails.clear(); arrivals.clear(); live.following = true; live.unit = null; }
    if (moved) { live.heard = now; live.chains.forEach(leaveTrail); }
    live.around = { ...state.around, camera: live.camera, steps: 1, dt: 1 };
    Surroundings.unpack(live.around);
    live.chains.forEach(celebrate);
    Object.assign(live, {
      epoch: state.epoch, time: state.time, paused: state.paused, pacing: state.speed, current: state.current,
      policy: state.policy, loading: state.loading, took: state.took, troubles: state.troubles,
      grade: state.grade, roughening: state.roughening,
    });
    Recording.hear(state);
    Line.tell?.(live, state);
    if (live.held?.waits) answerHeld(state);
    if (!live.chosen()) live.name = live.chains[0]?.name ?? null;
    words();
  }

  const asUnit = ([x, y, angle, thrust]) => ({ x, y, angle, thrust });

  function leaveTrail(chain) {
    const past = trails.get(chain.name) || [];
    past.push(Tools.middle(chain.units));
    trails.set(chain.name, past.slice(-TRAIL));
  }

  // Rings spread from every unit when a chain takes its target.
  function celebrate(chain) {
    const arrived = chain.arrived !== null && chain.arrived !== undefined;
    if (arrived && !arrivals.get(chain.name)) {
      chain.target.forEach(([x, y], i) => ripples.push({ x, y, begin: performance.now() + 18 * i }));
    }
    arrivals.set(chain.name, arrived);
  }

  // The server's word on a target that was just moved here: from then on its word counts.
  function answerHeld(state) {
    const chain = state.chains.find(({ name }) => name === live.held.chain);
    if (!chain) { live.held = null; return; }
    const [x, y] = Tools.middle(chain.target), { centre, turn, sent } = live.held;
    if (Math.hypot(x - centre[0], y - centre[1]) < 2e-3 && Math.abs(chain.turn - turn) < 2e-3) {
      live.held.waits = false;
      live.echo = sent;
      if (live.held.released) live.held = null;
    }
  }

  // --- what tools use ---------------------------------------------------------------------------

  live.chosen = () => live.chains.find(({ name }) => name === live.name);
  live.targetOf = (chain) => (live.held?.chain === chain.name ? live.held.points : chain.target);
  live.turnOf = (chain) => (live.held?.chain === chain.name ? live.held.turn : chain.turn);
  live.aim = (chain, points, centre, turn) => {
    live.held = { chain: chain.name, points, centre, turn, sent: performance.now(), waits: true };
    queued = { chain: chain.name, x: centre[0], y: centre[1], turn };
  };
  live.release = () => {
    flush();
    if (live.held) live.held.released = true;
    if (live.held && !live.held.waits) live.held = null;
  };
  live.select = (chain, unit = null) => { live.name = chain.name; live.unit = unit; words(); };
  live.next = () => {
    const at = live.chains.findIndex(({ name }) => name === live.name);
    if (live.chains.length) live.select(live.chains[(at + 1) % live.chains.length]);
  };
  live.mark = (way) => {
    const chain = live.chosen();
    if (!chain) return;
    const n = chain.units.length;
    live.unit = live.unit === null ? (way > 0 ? 0 : n - 1) : (live.unit + way + n) % n;
    words();
  };
  live.pace = (by) => {
    const at = PACES.indexOf(live.pacing);
    live.send("pace", { speed: PACES[Math.min(Math.max(at + by, 0), PACES.length - 1)] });
  };
  live.zoom = (factor) => {
    live.following = false;
    live.camera.zoom(factor, water.clientWidth / 2, water.clientHeight / 2);
  };
  live.follow = () => { live.following = true; };
  live.help = () => { get("help").showModal(); get("help").scrollTop = 0; };
  live.toast = (text, kind = "") => {
    get("toast").textContent = text;
    get("toast").hidden = false;
    get("toast").style.color = kind === "good" ? "var(--good)" : "";
    clearTimeout(toasting);
    toasting = setTimeout(() => { get("toast").hidden = true; }, 4000);
  };

  function flush() {
    if (queued) live.send("place", queued);
    queued = null;
  }

  // --- words and buttons ------------------------------------------------------------------------

  function banner(text, bad = false) {
    get("banner").textContent = text;
    get("banner").hidden = !text;
    get("banner").classList.toggle("bad", bad);
  }

  function say(id, text) { if (get(id).textContent !== text) get(id).textContent = text; }

  function words() {
    const chain = live.chosen();
    if (!chain) return;
    say("distance", `${(100 * chain.distance).toFixed(1)} cm`);
    say("speed", `${(100 * chain.speed).toFixed(1)} cm/s`);
    const there = chain.arrived !== null;
    say("success", chain.reached ? `reached in ${chain.arrived.toFixed(1)} s`
      : there ? "was reached" : `${chain.since.toFixed(1)} s on the way`);
    get("success").classList.toggle("good", chain.reached);
    say("length", `${chain.units.length} units`);
    const at = live.chains.indexOf(chain);
    const which = live.chains.length > 1 ? `Chain ${at + 1} of ${live.chains.length}` : "";
    const unit = live.unit === null ? "" : `unit ${live.unit + 1}${chain.units[live.unit]?.[4] ? "" : " (thruster off)"}`;
    const apart = chain.units.some((one) => one[5]) ? "Apart, until all have passed" : "";
    say("hint", [which, unit, apart].filter(Boolean).join(", ") || Tools.HINTS[live.tool]);
    banner(live.loading ? `Loading ${live.loading}: it swims in a moment`
      : live.roughening ? "The water changes in a moment" : "");
    offer();
    const where = live.world === "still" ? "" : `The world is ${live.world}, drawn anew at each reset. `;
    say("health", `${where}A step takes ${live.took} ms ${Line.where}.${lagWords()}`);
    buttons();
  }

  // A chain that is at its target, the chosen one first: what may come next, and the button for it.
  function offer() {
    const there = live.chains.filter(({ arrived }) => arrived !== null);
    const chain = there.includes(live.chosen()) ? live.chosen() : there[0];
    get("arrived").hidden = !chain;
    get("hint").hidden = Boolean(chain);
    live.offered = chain;
    if (!chain) return;
    const which = live.chains.length > 1 ? `Chain ${live.chains.indexOf(chain) + 1} arrived` : "Arrived";
    say("arrival", `${which} in ${chain.arrived.toFixed(1)} s.`);
  }

  function lagWords() {
    if (!live.lags.length) return "";
    const sorted = [...live.lags].sort((a, b) => a - b);
    return ` From a drag to the picture: ${sorted[Math.floor(sorted.length / 2)].toFixed(0)} ms.`;
  }

  function buttons() {
    say("pause", live.paused ? "Go on" : "Pause");
    get("pause").setAttribute("aria-pressed", live.paused);
    if (document.activeElement !== get("pace")) get("pace").value = String(live.pacing);
    const shown = live.loading || live.policy;
    if (document.activeElement !== get("policy") || !live.loading) get("policy").value = shown;
    for (const button of document.querySelectorAll("[data-trouble]")) {
      button.setAttribute("aria-pressed", live.troubles.includes(button.dataset.trouble));
    }
    if (document.activeElement !== get("grade")) get("grade").value = live.grade;
    say("trouble", live.troubles.length ? `Trouble (${live.troubles.length})` : "Trouble");
    get("join").disabled = live.chains.length < 2;
    get("shrink").disabled = (live.chosen()?.units.length ?? 0) <= 2;
    for (const button of document.querySelectorAll("[data-tool]")) {
      button.setAttribute("aria-pressed", button.dataset.tool === live.tool);
    }
    get("unwall").hidden = !["wall", "gate"].includes(live.tool);
    get("shapes").hidden = live.tool !== "target";
  }

  // --- drawing ----------------------------------------------------------------------------------

  // How much of a control step has been shown since a moment (ms).
  const partSince = (moment, now) => Math.min((now - moment) / (1000 * live.step / (live.pacing || 1)), 1);

  // Where a chain is between the last two states; it runs one control step behind the server.
  function show(chain, now) {
    const part = partSince(chain.at, now);
    chain.shown = chain.units.map(([x, y, angle, thrust, works, cut], i) => {
      const from = chain.from?.[i];
      return {
        x: from ? Salp.between(from.x, x, part) : x, y: from ? Salp.between(from.y, y, part) : y,
        angle: from ? Salp.betweenAngles(from.angle, angle, part) : angle,
        thrust, off: !works, cut, place: i / Math.max(chain.units.length - 1, 1),
        marked: chain.name === live.name && i === live.unit,
      };
    });
  }

  function keepInView(passed) { // ms since the last frame
    if (!live.following || live.sketch || live.held) return;
    const points = live.chains.flatMap((chain) => [
      ...chain.units, ...live.targetOf(chain), Tools.knob(live, chain)]);
    points.push(...Surroundings.corners({ ...live.around, target: points, centroid: [] }));
    const { camera } = live, [left, top, width, height] = camera.box;
    const above = 14 + get("shapes").offsetHeight, below = 40 + Math.max(
      get("arrived").offsetHeight || 30, Line.covers?.() ?? 0); // pixels
    camera.box = [left, top, width, Math.max(height - above - below, 100)];
    const goal = camera.whole(points, 0.16, 700);
    goal.y += (above - below) / 2 / goal.scale;
    camera.box = [left, top, width, height];
    const share = live.frames < 3 ? 1 : 1 - Math.exp(-passed / 270);
    for (const key of ["x", "y", "scale"]) camera[key] = Salp.between(camera[key], goal[key], share);
  }

  function drawChain(chain, seconds) {
    const { camera } = live, target = live.targetOf(chain), mine = chain.name === live.name;
    Salp.trail(ctx, camera, trails.get(chain.name) || []);
    Salp.strings(ctx, camera, target, chain.shown);
    Salp.ghosts(ctx, camera, target, chain.shown, mine ? 1.25 : 0.8);
    Salp.chain(ctx, camera, chain.shown, live.paused ? 0 : seconds);
    drawKnob(chain, target);
  }

  function drawKnob(chain, target) {
    const look = Salp.theme(), [x, y] = live.camera.toScreen(...Tools.knob(live, chain));
    const [ex, ey] = live.camera.toScreen(...target[target.length - 1]);
    ctx.setLineDash([3, 5]);
    ctx.beginPath();
    ctx.moveTo(ex, ey); ctx.lineTo(x, y);
    Salp.stroke(ctx, `rgba(${look.ghost}, 0.7)`, 1.5);
    ctx.setLineDash([]);
    ctx.beginPath();
    ctx.arc(x, y, 7, 0, 7);
    ctx.fillStyle = `rgba(${look.ghost}, 0.55)`;
    ctx.fill();
    Salp.stroke(ctx, look.ink, 1.5);
  }

  function drawRipples(now) {
    const look = Salp.theme();
    for (const ripple of ripples) {
      const age = (now - ripple.begin) / 1400;
      if (age < 0) continue;
      ctx.beginPath();
      ctx.arc(...live.camera.toScreen(ripple.x, ripple.y), (0.03 + 0.22 * age) * live.camera.scale, 0, 7);
      ctx.globalAlpha = Math.max(0, 0.5 * (1 - age));
      Salp.stroke(ctx, look.done, 2);
      ctx.globalAlpha = 1;
    }
    ripples.splice(0, ripples.findIndex((r) => now - r.begin < 1400) < 0 ? ripples.length
      : ripples.findIndex((r) => now - r.begin < 1400));
  }

  function drawSketch() {
    if (!live.sketch) return undefined;
    const look = Salp.theme(), { points, opening } = live.sketch;
    if (live.sketch.wall) return Surroundings.draw(ctx, { camera: live.camera, walls: Tools.wallPieces(points, opening, live.wall.width) });
    Salp.trace(ctx, live.camera, points);
    Salp.stroke(ctx, live.sketch.arrow ? look.ink : look.faint, live.sketch.arrow ? 3 : 1.5);
    if (!live.sketch.arrow) {
      Salp.trace(ctx, live.camera, Tools.asLongAs(points, Salp.sizes.link * ((live.chosen()?.units.length ?? 1) - 1)));
      Salp.stroke(ctx, look.ink, 4);
    }
    return live.sketch.arrow && arrowHead(points[0], points[1], look.ink);
  }

  function arrowHead(from, to, colour) {
    const [a, b] = [live.camera.toScreen(...from), live.camera.toScreen(...to)];
    const angle = Math.atan2(b[1] - a[1], b[0] - a[0]);
    ctx.beginPath();
    for (const side of [2.6, 0, -2.6]) {
      const [x, y] = side ? [b[0] + 12 * Math.cos(angle + side), b[1] + 12 * Math.sin(angle + side)] : b;
      if (side === 2.6) ctx.moveTo(x, y); else ctx.lineTo(x, y);
    }
    Salp.stroke(ctx, colour, 3);
  }

  function drawCurrent() {
    const [x, y] = live.current, speed = Math.hypot(x, y), look = Salp.theme();
    if (speed < 1e-3) return;
    const size = 18 + 120 * speed, angle = Math.atan2(-y, x);
    const { offsetTop, offsetHeight } = get("trouble"), px = 44, py = offsetTop + offsetHeight + 40;
    ctx.beginPath();
    ctx.moveTo(px - size / 2 * Math.cos(angle), py - size / 2 * Math.sin(angle));
    const tip = [px + size / 2 * Math.cos(angle), py + size / 2 * Math.sin(angle)];
    ctx.lineTo(...tip);
    for (const side of [2.6, -2.6]) {
      ctx.moveTo(...tip);
      ctx.lineTo(tip[0] + 9 * Math.cos(angle + side), tip[1] + 9 * Math.sin(angle + side));
    }
    Salp.stroke(ctx, look.ink, 2.5);
    ctx.fillStyle = look.faint;
    ctx.font = "12px system-ui, sans-serif";
    ctx.fillText(`current ${(100 * speed).toFixed(0)} cm/s`, 12, py + 44);
  }

  function frame(now) {
    flush();
    Salp.resize(water);
    live.camera.box = [0, 0, water.clientWidth, water.clientHeight];
    live.chains.forEach((chain) => show(chain, now));
    if (live.chains.length) { keepInView(now - live.framed); live.frames += 1; }
    live.framed = now;
    Salp.water(ctx, live.camera, now / 1000, live.current);
    if (live.around) {
      Surroundings.streaks(ctx, live.around, live.time + (partSince(live.heard, now) - 1) * live.step);
      Surroundings.draw(ctx, live.around);
    }
    live.chains.forEach((chain) => drawChain(chain, now / 1000));
    drawRipples(now);
    drawSketch();
    drawCurrent();
    Salp.scaleBar(ctx, live.camera);
    if (live.echo) {
      live.lags = [...live.lags.slice(-99), performance.now() - live.echo];
      live.echo = null;
    }
    requestAnimationFrame(frame);
  }

  // --- hands and keys ---------------------------------------------------------------------------

  Salp.pointers(water, () => live.camera, (x, y) => Tools.GRABS[live.tool](live, x, y),
    () => { live.following = false; });
  document.addEventListener("keydown", (event) => {
    document.documentElement.classList.add("keyboard");
    if (event.ctrlKey || event.metaKey || document.querySelector("dialog[open]")) return;
    const on = document.activeElement, key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (on.tagName === "SELECT" || (on.tagName === "BUTTON" && key === " ") || !Tools.KEYS[key]) return;
    event.preventDefault();
    Tools.KEYS[key](live, event);
  });
  for (const button of document.querySelectorAll("[data-tool]")) {
    button.addEventListener("click", () => { live.tool = button.dataset.tool; live.unit = null; words(); buttons(); });
  }
  for (const button of document.querySelectorAll("[data-key]")) {
    button.addEventListener("click", (event) => Tools.KEYS[button.dataset.key](live, event));
  }
  const click = (id, act) => get(id).addEventListener("click", act);
  click("pause", () => live.send("pause", { on: !live.paused }));
  click("step", () => live.send("step"));
  click("reset", () => live.send("reset"));
  click("fit", live.follow);
  click("keys", live.help);
  click("again", () => Tools.retarget(live, live.offered));
  click("trouble", Tools.showTroubles);
  click("unwall", () => live.send("clear"));
  click("join", () => Tools.join(live));
  click("grow", () => Tools.KEYS["+"](live));
  click("shrink", () => Tools.KEYS["-"](live));
  get("pace").addEventListener("change", (event) => live.send("pace", { speed: +event.target.value }));
  get("policy").addEventListener("change", (event) => {
    live.send("steer", { policy: event.target.value });
    event.target.blur();
  });

  Recording.begin(live);
  Line.begin?.(live);
  window.live = live;
  requestAnimationFrame(frame);
})();
