// Plays the trajectories that this page holds, or what was recorded of a live world (recorded.js).
"use strict";
(() => {
  const get = (id) => document.getElementById(id), { bytes } = Salp;
  const SPEEDS = [...get("speed").options].map((option) => +option.value);
  const LINES = ["#22a7d6", "#f08c2e", "#d6589f", "#4caf50", "#8e7cf0", "#b5a32a"];

  // Numbers as they were before they were packed into 16 and 8 bits.
  function unpack(packed) {
    const position = new Int16Array(bytes(packed.position));
    const angle = new Int16Array(bytes(packed.angle)), thrust = new Int8Array(bytes(packed.thrust));
    const n = packed.length, times = packed.steps + 1;
    const swim = { ...packed, times, distance: new Float32Array(bytes(packed.distance)) };
    swim.x = (t, i) => packed.middle[0] + position[2 * (t * n + i)] * packed.grain;
    swim.y = (t, i) => packed.middle[1] + position[2 * (t * n + i) + 1] * packed.grain;
    swim.angle = (t, i) => angle[t * n + i] * Math.PI / 32767;
    swim.thrust = (t, i) => (t < packed.steps ? thrust[t * n + i] / 127 : 0);
    swim.centroid = Array.from({ length: times }, (_, t) => {
      let [x, y] = [0, 0];
      for (let i = 0; i < n; i++) { x += swim.x(t, i) / n; y += swim.y(t, i) / n; }
      return [x, y];
    });
    swim.effort = Float32Array.from({ length: packed.steps }, (_, t) => {
      let sum = 0;
      for (let i = 0; i < n; i++) sum += Math.abs(swim.thrust(t, i));
      return sum / n;
    });
    Surroundings.unpack(swim);
    if (packed.targets) Recorded.unpack(swim);
    if (packed.moving) {
      const flat = new Int16Array(bytes(packed.moving));
      const at = (t, i, axis) => packed.middle[axis] + flat[2 * (t * n + i) + axis] * packed.grain;
      swim.targetAt = (now) => {
        const first = Math.min(Math.floor(now), packed.steps), last = Math.min(first + 1, packed.steps);
        const point = (i, axis) => Salp.between(at(first, i, axis), at(last, i, axis), now - first);
        return Array.from({ length: n }, (_, i) => [point(i, 0), point(i, 1)]);
      };
    }
    swim.camera = new Salp.Camera();
    return swim;
  }

  const { swims: packed, world, sizes } = JSON.parse(get("data").textContent), swims = packed.map(unpack);
  Object.assign(Salp.sizes, sizes);
  world?.around.forEach(([, around]) => Surroundings.unpack(around));
  const together = world || swims.every((s) => JSON.stringify(s.target) === JSON.stringify(swims[0].target));
  const end = Math.max(...swims.map((s) => ((s.begin ?? 0) + s.steps) * s.dt), 1e-9);
  if (world) swims.forEach((swim) => { swim.camera = swims[0].camera; });
  const state = { time: 0, playing: false, speed: 2, touched: false };
  const water = get("water"), curves = get("curves");

  function scaleOf(swim) { return swim.link ? swim.link / 0.07 : 1; } // times the paper's links

  function name(swim) {
    const usual = { task: "reach", world: "still" };
    const where = Object.keys(usual).filter((k) => swim[k] && swim[k] !== usual[k]).map((k) => `, ${swim[k]}`);
    return `${swim.policy}, ${swim.length} units${where.join("")}`;
  }

  function words() {
    get("title").textContent = world ? world.title : swims.length === 1 ? name(swims[0]) : `${swims.length} swims`;
    const one = swims[0];
    const end = one.moving ? `followed its target for ${(one.steps * one.dt).toFixed(1)} s` : one.success ? `reached its target in ${(one.steps * one.dt).toFixed(1)} s`
      : `did not reach its target in ${(one.steps * one.dt).toFixed(1)} s`;
    get("about").textContent = world ? world.about : swims.length === 1 ? `${end}; seed ${one.seed}, trial ${one.trial}`
      : together ? "the same episode, side by side" : "side by side";
    document.title = `${get("title").textContent} - salpchain`;
  }

  // All points that a swim comes to, few of them.
  function reach(swim) {
    const points = [...swim.target, ...Surroundings.corners(swim)];
    const stride = Math.max(1, Math.floor(swim.times / 60));
    for (let t = 0; t < swim.times; t += stride) {
      for (let i = 0; i < swim.length; i++) points.push([swim.x(t, i), swim.y(t, i)]);
      if (swim.moving) points.push(...swim.targetAt(t));
    }
    return points;
  }

  // Turns the way to the target along the longer side of a view, to the right or upwards.
  function turnOf(swim, [, , width, height]) {
    const [x, y] = swim.centroid[0], count = swim.target.length;
    const goal = [0, 1].map((axis) => swim.target.reduce((sum, point) => sum + point[axis], 0) / count);
    return (width >= height ? 0 : Math.PI / 2) - Math.atan2(goal[1] - y, goal[0] - x);
  }

  // Everything that happens, below the words and above the scale bar.
  function fit() {
    state.touched = state.seen = false;
    if (world) return; // its view follows the chains
    const points = swims.map(reach), turn = turnOf(swims[0], swims[0].camera.box);
    swims.forEach((swim, k) => {
      const { camera } = swim, [left, top, width, height] = camera.box;
      camera.turn = together ? turn : turnOf(swim, camera.box);
      const above = Math.min(swims.length > 1 ? 50 : 34, height / 3), below = Math.min(28, height / 6);
      camera.box = [left, top + above, width, height - above - below];
      camera.fit(together ? points.flat() : points[k], 0.09 * scaleOf(swim));
      camera.box = [left, top, width, height];
      camera.pan(0, (above - below) / 2);
    });
  }

  function layout() {
    const { clientWidth: width, clientHeight: height } = water, count = world ? 1 : swims.length;
    const columns = Math.max(1, Math.min(count, Math.round(Math.sqrt(count * width / height))));
    const lines = Math.ceil(count / columns);
    swims.slice(0, count).forEach((swim, k) => {
      const here = Math.min(columns, count - Math.floor(k / columns) * columns);
      const wide = width / here, high = height / lines;
      swim.camera.box = [(k % columns) * wide, Math.floor(k / columns) * high, wide, high];
    });
    if (!state.touched) fit();
  }

  function cameraAt(x, y) {
    const inside = ({ camera: { box: [l, t, w, h] } }) => x >= l && x < l + w && y >= t && y < t + h;
    return (swims.find(inside) || swims[0]).camera;
  }

  function share(camera) {
    state.touched = true;
    if (together) for (const { camera: other } of swims) {
      [other.x, other.y, other.scale, other.turn] = [camera.x, camera.y, camera.scale, camera.turn];
    }
  }

  function unitsAt(swim, now) {
    const first = Math.min(Math.floor(now), swim.steps), last = Math.min(first + 1, swim.steps);
    const part = now - first, units = [], cut = new Set();
    for (const [link, from, to] of swim.cuts ?? []) if (from <= first && first <= to) cut.add(link);
    for (let i = 0; i < swim.length; i++) {
      units.push({
        x: Salp.between(swim.x(first, i), swim.x(last, i), part),
        y: Salp.between(swim.y(first, i), swim.y(last, i), part),
        angle: Salp.betweenAngles(swim.angle(first, i), swim.angle(last, i), part),
        thrust: swim.thrust(first, i), place: i / (swim.length - 1), mount: swim.mounts?.[i], cut: cut.has(i), off: swim.off?.includes(i) || (swim.dead?.[i] ?? Infinity) <= first,
      });
    }
    return units;
  }

  function drawBodies(ctx, swim, now, units) {
    const { camera } = swim, target = swim.targetAt?.(now) ?? swim.target;
    Object.assign(Salp.sizes, { unit: swim.unit ?? sizes.unit, link: swim.link, scale: scaleOf(swim) });
    Salp.trail(ctx, camera, swim.centroid.slice(0, Math.floor(now) + 1));
    Salp.strings(ctx, camera, target, units);
    Salp.ghosts(ctx, camera, target, units);
    Salp.chain(ctx, camera, units, state.time);
  }

  function colourOf(swim) { return LINES[(swim.chain ?? swims.indexOf(swim)) % LINES.length]; }

  function drawSwim(ctx, swim) {
    const { camera } = swim, now = Math.min(state.time / swim.dt, swim.steps);
    const units = unitsAt(swim, now), [left, top, width, height] = camera.box;
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, top, width, height);
    ctx.clip();
    Salp.water(ctx, camera, state.time);
    Surroundings.streaks(ctx, swim, now * swim.dt);
    Surroundings.draw(ctx, swim);
    drawBodies(ctx, swim, now, units);
    Salp.scaleBar(ctx, camera);
    const done = swim.success && now >= swim.steps, look = Salp.theme();
    ctx.font = "600 15px system-ui, sans-serif";
    ctx.fillStyle = look.ink;
    if (swims.length > 1) {
      ctx.fillText(name(swim), left + 34, top + 24, width - 44);
      ctx.fillStyle = colourOf(swim);
      ctx.fillRect(left + 14, top + 17, 14, 4);
    }
    ctx.font = "14px system-ui, sans-serif";
    ctx.fillStyle = done ? look.done : look.faint;
    const apart = `${(100 * swim.distance[Math.floor(now)]).toFixed(1)} cm to the target`;
    ctx.fillText(apart + (done ? ", reached" : ""), left + 14, top + (swims.length > 1 ? 44 : 24), width - 24);
    ctx.restore();
  }

  // Mean distance in centimetres where a metre would be too much of a unit for it.
  function panels() {
    const most = Math.max(...swims.map((s) => Math.max(...s.distance)), 0.001);
    const [unit, factor] = most < 1 ? ["cm", 100] : ["m", 1];
    const lines = (valuesOf) => swims.map((swim) => ({
      values: valuesOf(swim), dt: swim.dt, begin: (swim.begin ?? 0) * swim.dt, colour: colourOf(swim),
      goesOn: Boolean(world) && (swim.begin + swim.steps) * swim.dt < end - 1e-6,
    }));
    const jets = swims.some((swim) => swim.mounts); // whose whole push is not 1 N
    return [
      { title: "Mean distance to the target", unit, most: factor * most,
        lines: lines((swim) => swim.distance.map((value) => factor * value)) },
      { title: `Mean strength of the thrusts${jets ? ", of a whole jet" : ""}`, unit: jets ? "" : "N", most: 1, lines: lines((swim) => swim.effort) },
    ];
  }
  const shown = panels();

  function drawCurves() {
    const ctx = curves.getContext("2d"), { clientWidth: width, clientHeight: height } = curves;
    const style = getComputedStyle(document.body), colour = (name) => style.getPropertyValue(name).trim();
    const look = {
      ink: colour("--ink"), faint: colour("--faint"), line: colour("--line"), axis: colour("--faint"),
      page: colour("--page"),
    };
    ctx.clearRect(0, 0, width, height);
    state.curves = Curves.layout(width, height, shown, end);
    state.texts = Curves.draw(ctx, state.curves, state.time, look);
  }

  function draw() {
    if (!water.clientWidth || !water.clientHeight) return; // a frame that is not laid out yet
    if (Salp.resize(water) | Salp.resize(curves)) layout();
    const ctx = water.getContext("2d");
    if (world) Recorded.draw(ctx, world, swims, state, end, { unitsAt, drawBodies, colourOf });
    else swims.forEach((swim) => drawSwim(ctx, swim));
    drawCurves();
    get("scrub").value = state.time;
    get("scrub").setAttribute("aria-valuetext", `${state.time.toFixed(1)} seconds`);
    get("clock").textContent = `${state.time.toFixed(1)} / ${end.toFixed(1)} s`;
  }

  function play(on) {
    if (on && state.time >= end) state.time = 0;
    state.playing = on;
    get("play").textContent = on ? "Pause" : "Play";
    get("play").setAttribute("aria-label", on ? "Pause" : "Play");
  }

  function seek(time) { state.time = Math.min(Math.max(time, 0), end); }

  function faster(by) {
    const at = Math.min(Math.max(SPEEDS.indexOf(state.speed) + by, 0), SPEEDS.length - 1);
    state.speed = SPEEDS[at];
    get("speed").value = String(state.speed);
  }

  function look(change) {
    new Set(swims.map(({ camera }) => camera)).forEach(change);
    state.touched = true;
  }

  const zoom = (factor) => look((camera) => {
    const [left, top, width, height] = camera.box;
    camera.zoom(factor, left + width / 2, top + height / 2);
  });
  const step = (event, way) => { play(false); seek(state.time + way * (event.shiftKey ? 10 : 1) * swims[0].dt); };
  const help = () => { get("help").showModal(); get("help").scrollTop = 0; };
  const KEYS = {
    " ": () => play(!state.playing),
    ArrowRight: (event) => step(event, 1), ArrowLeft: (event) => step(event, -1),
    Home: () => seek(0), End: () => seek(end),
    ArrowUp: () => faster(1), ArrowDown: () => faster(-1),
    "+": () => zoom(1.25), "=": () => zoom(1.25), "-": () => zoom(0.8), "0": fit,
    w: () => look((c) => c.pan(0, 40)), s: () => look((c) => c.pan(0, -40)),
    a: () => look((c) => c.pan(40, 0)), d: () => look((c) => c.pan(-40, 0)),
    "?": help,
  };

  document.addEventListener("keydown", (event) => {
    document.documentElement.classList.add("keyboard");
    if (event.ctrlKey || event.metaKey || event.altKey || get("help").open) return;
    const on = document.activeElement, key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (on.tagName === "SELECT" || (on.tagName === "BUTTON" && key === " ") || !KEYS[key]) return;
    event.preventDefault();
    KEYS[key](event);
  });
  get("play").addEventListener("click", () => play(!state.playing));
  get("scrub").addEventListener("input", (event) => { play(false); seek(+event.target.value); });
  get("speed").addEventListener("change", (event) => { state.speed = +event.target.value; });
  get("fit").addEventListener("click", fit);
  get("keys").addEventListener("click", help);
  Salp.pointers(water, cameraAt, undefined, share);
  Salp.pointers(curves, cameraAt, (x) => {
    const go = (px) => { play(false); seek(Curves.timeAt(state.curves, px)); };
    go(x);
    return { move: go, end() {} };
  });

  let last = performance.now();
  function frame(now) {
    if (state.playing) {
      seek(state.time + ((now - last) / 1000) * state.speed);
      if (state.time >= end) play(false);
    }
    last = now;
    draw();
    requestAnimationFrame(frame);
  }
  get("scrub").max = end;
  // As many control steps in a second as of the paper's chains, or nearly.
  const pace = state.speed * (swims.find((swim) => swim.mounts)?.dt ?? 0.1) / 0.1;
  state.speed = SPEEDS.reduce((best, one) => (Math.abs(one - pace) < Math.abs(best - pace) ? one : best));
  get("speed").value = String(state.speed);
  words();
  play(!Salp.still.matches);
  window.replay = { state, swims, end };
  requestAnimationFrame(frame);
})();
