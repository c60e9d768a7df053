// What a pointer or a key does to the world; `live` is the page's shared state (live.js).
"use strict";
const Tools = (() => {
  const NEAR = 26; // pixels that a finger may miss by
  const HINTS = {
    target: "Drag the ghosts to move the target, the knob to turn it",
    draw: "Draw the shape that the chain shall take: it is as long as the thick part",
    cut: "Tap a link to cut it",
    push: "Drag away from a unit to push it",
    thruster: "Tap a unit to turn its thruster off or on",
    wall: "Drag to draw a wall; tap one to take it away",
    gate: "Drag across the way: a wall with an opening, half as wide as the chain is long; tap it to take it away",
    current: "Drag in the direction in which the water shall flow; tap for still water",
  };
  const SHAPES = [
    () => 0,
    (part) => 1.6 * part,
    (part) => 1.3 * Math.sin(2 * Math.PI * part),
    (part) => 5.4 * part,
    (part) => (part < 0.55 ? 0 : 6 * (part - 0.55)),
  ];

  const middle = (points) => {
    const sum = points.reduce(([x, y], p) => [x + p[0], y + p[1]], [0, 0]);
    return sum.map((v) => v / points.length);
  };

  // The first part of a line: as much of it as a chain can take.
  function asLongAs(points, most) {
    let way = 0;
    const end = points.findIndex(([x, y], i) => {
      if (i) way += Math.hypot(x - points[i - 1][0], y - points[i - 1][1]);
      return way > most;
    });
    return end < 0 ? points : points.slice(0, Math.max(end, 2));
  }

  // The knob that turns a target: past its last point.
  function knob(live, chain) {
    const points = live.targetOf(chain), n = points.length;
    const [a, b] = [points[n - 2], points[n - 1]];
    const gap = Math.max(1.6 * Salp.sizes.link, 34 / live.camera.scale);
    const size = Math.hypot(b[0] - a[0], b[1] - a[1]) || 1;
    return [b[0] + (b[0] - a[0]) / size * gap, b[1] + (b[1] - a[1]) / size * gap];
  }

  function nearest(live, px, py, pointsOf) {
    let best = { apart: Infinity };
    for (const chain of live.chains) {
      pointsOf(chain).forEach(([x, y], index) => {
        const [sx, sy] = live.camera.toScreen(x, y), apart = Math.hypot(sx - px, sy - py);
        if (apart < best.apart) best = { chain, index, apart };
      });
    }
    return best;
  }

  const unitPoints = (chain) => chain.shown.map((unit) => [unit.x, unit.y]);
  const linkPoints = (chain) => chain.shown.slice(1).map((unit, i) => (
    [(unit.x + chain.shown[i].x) / 2, (unit.y + chain.shown[i].y) / 2]));

  // A target moved and turned here at once; the server hears of it once a frame.
  function place(live, chain, centre, turn) {
    const before = live.targetOf(chain), [cx, cy] = middle(before);
    const by = turn - live.turnOf(chain), [cos, sin] = [Math.cos(by), Math.sin(by)];
    const points = before.map(([x, y]) => [
      centre[0] + cos * (x - cx) - sin * (y - cy), centre[1] + sin * (x - cx) + cos * (y - cy)]);
    live.aim(chain, points, centre, turn);
  }

  function grabTarget(live, px, py) {
    for (const chain of live.chains) {
      const [kx, ky] = live.camera.toScreen(...knob(live, chain));
      if (Math.hypot(kx - px, ky - py) < NEAR) return turning(live, chain);
    }
    const { chain, apart } = nearest(live, px, py, (c) => live.targetOf(c));
    if (apart < Math.max(NEAR, Salp.REACHED * live.camera.scale)) return moving(live, chain, px, py);
    const unit = nearest(live, px, py, unitPoints);
    if (unit.apart < NEAR) live.select(unit.chain, unit.index);
    return null;
  }

  const onTarget = (live, chain, px, py) => live.targetOf(chain).some(([x, y]) => {
    const [sx, sy] = live.camera.toScreen(x, y);
    return Math.hypot(sx - px, sy - py) < Math.max(NEAR, Salp.REACHED * live.camera.scale);
  });

  // One finger moves the target; a second one that is put on it turns it, too.
  function moving(live, chain, px, py) {
    live.select(chain);
    let last = live.camera.toWorld(px, py);
    const by = (x, y, turn) => {
      const at = live.camera.toWorld(x, y), centre = middle(live.targetOf(chain));
      place(live, chain, centre.map((v, i) => v + at[i] - last[i]), live.turnOf(chain) + turn);
      last = at;
    };
    return {
      move: (x, y) => by(x, y, 0),
      second: (x, y) => onTarget(live, chain, x, y),
      twist: (x, y, turn) => by(x, y, turn),
      hold(x, y) { last = live.camera.toWorld(x, y); },
      end() { live.release(); },
    };
  }

  function turning(live, chain) {
    live.select(chain);
    const centre = middle(live.targetOf(chain)), [kx, ky] = knob(live, chain);
    let last = Math.atan2(ky - centre[1], kx - centre[0]);
    return {
      move(x, y) {
        const [wx, wy] = live.camera.toWorld(x, y), now = Math.atan2(wy - centre[1], wx - centre[0]);
        const by = Math.atan2(Math.sin(now - last), Math.cos(now - last));
        last = now;
        place(live, chain, centre, live.turnOf(chain) + by);
      },
      end() { live.release(); },
    };
  }

  function drawing(live, px, py) {
    const points = [live.camera.toWorld(px, py)];
    live.sketch = { points };
    return {
      move(x, y) {
        const [at, last] = [live.camera.toWorld(x, y), points[points.length - 1]];
        if (Math.hypot(at[0] - last[0], at[1] - last[1]) > 0.01) points.push(at);
      },
      end() {
        live.sketch = null;
        const stride = Math.ceil(points.length / 480);
        const few = points.filter((_, i) => i % stride === 0 || i === points.length - 1);
        const chain = live.chosen();
        if (few.length > 1 && chain) live.send("draw", { chain: chain.name, points: few });
        else live.toast("Draw a longer line: this is hardly more than a dot");
      },
    };
  }

  function arrow(live, from, end) {
    live.sketch = { points: [from, from], arrow: true };
    return {
      move(x, y) { live.sketch.points[1] = live.camera.toWorld(x, y); },
      end() {
        const [a, b] = live.sketch.points;
        live.sketch = null;
        end(b[0] - a[0], b[1] - a[1]);
      },
    };
  }

  function pushing(live, px, py) {
    const { chain, index, apart } = nearest(live, px, py, unitPoints);
    if (apart > NEAR) return null;
    live.select(chain, index);
    return arrow(live, unitPoints(chain)[index], (x, y) => {
      const size = Math.hypot(x, y), most = 3;
      const strength = size < 0.02 ? 0 : Math.min(6 * size, most) / size;
      if (strength) live.send("push", { chain: chain.name, unit: index, x: x * strength, y: y * strength });
    });
  }

  function tapping(live, px, py, pointsOf, act) {
    const { chain, index, apart } = nearest(live, px, py, pointsOf);
    if (apart > NEAR) return null;
    act(chain, index);
    return { move() {}, end() {} };
  }

  function flow(live, x, y) {
    const speed = Math.hypot(x, y), most = 0.3, less = speed > most ? most / speed : 1;
    live.send("flow", { x: x * less, y: y * less });
  }

  // The pieces of a wall between two points, with an opening in its middle if it has a width (m).
  function wallPieces([a, b], opening, width) {
    if (!opening) return [[...a, ...b, width]];
    const at = (part) => a.map((v, i) => v + part * (b[i] - v));
    const half = Math.min(opening / 2 / (Math.hypot(b[0] - a[0], b[1] - a[1]) || 1), 0.5);
    return [[...a, ...at(0.5 - half), width], [...at(0.5 + half), ...b, width]];
  }

  // An opening (m) half as wide as the chosen chain is long, but never too narrow.
  const openingFor = (live) => Math.max((live.chosen()?.units.length ?? 1) * Salp.sizes.link / 2, live.wall.opening);

  function walling(live, px, py, opening) {
    const begin = live.camera.toWorld(px, py);
    live.sketch = { points: [begin, begin], wall: true, opening };
    return {
      move(x, y) { live.sketch.points[1] = live.camera.toWorld(x, y); },
      end() {
        const [a, b] = live.sketch.points;
        live.sketch = null;
        if (Math.hypot(b[0] - a[0], b[1] - a[1]) * live.camera.scale < NEAR / 2) live.send("clear", { point: a });
        else live.send("wall", { begin: a, end: b, opening });
      },
    };
  }

  // By keyboard: a wall with an opening, halfway from the chosen chain to its target and across it.
  function gate(live, event) {
    const chain = live.chosen();
    if (!chain || !live.wall) return undefined;
    if (event.shiftKey) return live.send("clear");
    const [from, to] = [chain.units, live.targetOf(chain)].map(middle), far = Math.hypot(to[0] - from[0], to[1] - from[1]) || 1;
    const opening = openingFor(live), half = 2 * opening + chain.units.length * Salp.sizes.link;
    const across = [-(to[1] - from[1]) / far * half, (to[0] - from[0]) / far * half];
    const [begin, end] = [-1, 1].map((side) => [0, 1].map((i) => (from[i] + to[i]) / 2 + side * across[i]));
    return live.send("wall", { begin, end, opening });
  }

  const GRABS = {
    target: grabTarget,
    draw: drawing,
    push: pushing,
    cut: (live, x, y) => tapping(live, x, y, linkPoints, (chain, index) => {
      live.select(chain, index);
      live.send("cut", { chain: chain.name, link: index });
    }),
    thruster: (live, x, y) => tapping(live, x, y, unitPoints, (chain, index) => {
      live.select(chain, index);
      toggle(live);
    }),
    wall: (live, x, y) => walling(live, x, y, 0),
    gate: (live, x, y) => walling(live, x, y, openingFor(live)),
    current: (live, x, y) => arrow(live, live.camera.toWorld(x, y),
      (dx, dy) => flow(live, ...(Math.hypot(dx, dy) < 0.03 ? [0, 0] : [dx * 0.4, dy * 0.4]))),
  };

  function toggle(live) {
    const chain = live.chosen(), unit = chain && chain.units[live.unit];
    if (unit) live.send("thruster", { chain: chain.name, unit: live.unit, on: !unit[4] });
  }

  function shape(live, bend) {
    const chain = live.chosen();
    if (!chain) return;
    const n = chain.units.length, points = [[0, 0]], { link } = Salp.sizes;
    for (let i = 1; i < n; i++) {
      const angle = live.turnOf(chain) + bend((i - 1) / Math.max(n - 2, 1)), [x, y] = points[i - 1];
      points.push([x + link * Math.cos(angle), y + link * Math.sin(angle)]);
    }
    const [mx, my] = middle(points), [cx, cy] = middle(live.targetOf(chain));
    live.send("draw", { chain: chain.name, points: points.map(([x, y]) => [x + cx - mx, y + cy - my]) });
  }

  function nudge(live, event, x, y) {
    if (event.shiftKey) return flow(live, live.current[0] + 0.04 * x, live.current[1] + 0.04 * y);
    const chain = live.chosen(), by = event.altKey ? 0.01 : 0.05;
    if (!chain) return undefined;
    const [cx, cy] = middle(live.targetOf(chain));
    place(live, chain, [cx + by * x, cy + by * y], live.turnOf(chain));
    return live.release();
  }

  function spin(live, by) {
    const chain = live.chosen();
    if (!chain) return;
    place(live, chain, middle(live.targetOf(chain)), live.turnOf(chain) + by);
    live.release();
  }

  function kick(live) {
    const chain = live.chosen(), unit = chain && chain.units[live.unit];
    if (!unit) return;
    const [x, y] = [-Math.sin(unit[2]), Math.cos(unit[2])];
    live.send("push", { chain: chain.name, unit: live.unit, x: 1.5 * x, y: 1.5 * y });
  }

  function join(live) {
    const chain = live.chosen();
    if (live.chains.length < 2) return live.toast("There is only one chain: cut it first");
    const ends = (c) => [c.shown[0], c.shown[c.shown.length - 1]];
    const gap = (other) => Math.min(...ends(chain).flatMap((a) => ends(other).map(
      (b) => Math.hypot(a.x - b.x, a.y - b.y))));
    const others = live.chains.filter((c) => c !== chain).sort((a, b) => gap(a) - gap(b));
    return live.send("join", { chain: chain.name, other: others[0].name });
  }

  // A new random target, which is brought into view: it may be far from where one looked.
  function retarget(live, chain) {
    if (!chain) return;
    live.select(chain);
    live.follow();
    live.send("target", { chain: chain.name });
  }

  // The panel of troubles: each a button that is pressed in or not, the grade holds for all.
  function troubles(live, { names, grades }) {
    const get = (id) => document.getElementById(id);
    const send = (on, grade = get("grade").value) => live.send("trouble", { names: on, grade });
    get("names").replaceChildren(...names.map((name) => {
      const button = document.createElement("button");
      button.textContent = name;
      button.dataset.trouble = name;
      button.addEventListener("click", () => {
        const on = new Set(live.troubles);
        if (!on.delete(name)) on.add(name);
        send([...on]);
      });
      return button;
    }));
    get("grade").replaceChildren(...grades.map((name) => new Option(name, name)));
    get("grade").onchange = () => send(live.troubles);
    get("calm").onclick = () => send([]);
  }

  function showTroubles() {
    const panel = document.getElementById("troubles"), button = document.getElementById("trouble");
    panel.hidden = !panel.hidden;
    button.setAttribute("aria-expanded", !panel.hidden);
  }

  const withChain = (live, kind, more = () => ({})) => {
    const chain = live.chosen();
    if (chain) live.send(kind, { chain: chain.name, ...more(chain) });
  };

  const KEYS = {
    ArrowLeft: (live, event) => nudge(live, event, -1, 0),
    ArrowRight: (live, event) => nudge(live, event, 1, 0),
    ArrowUp: (live, event) => nudge(live, event, 0, 1),
    ArrowDown: (live, event) => nudge(live, event, 0, -1),
    q: (live) => spin(live, Math.PI / 18), e: (live) => spin(live, -Math.PI / 18),
    "+": (live) => withChain(live, "grow"), "=": (live) => withChain(live, "grow"),
    "-": (live) => withChain(live, "shrink"),
    m: showTroubles, n: (live) => live.next(), ",": (live) => live.mark(-1), ".": (live) => live.mark(1),
    x: (live) => withChain(live, "cut", (chain) => ({ link: Math.min(live.unit ?? Math.floor(chain.units.length / 2) - 1, chain.units.length - 2) })),
    j: join, w: gate, t: toggle, k: kick, c: (live) => live.send("flow", { x: 0, y: 0 }),
    " ": (live) => live.send("pause", { on: !live.paused }), s: (live) => live.send("step"),
    v: (live) => Recording.press(live), g: (live) => retarget(live, live.chosen()),
    "[": (live) => live.pace(-1), "]": (live) => live.pace(1), r: (live) => live.send("reset"),
    PageUp: (live) => live.zoom(1.25), PageDown: (live) => live.zoom(0.8), 0: (live) => live.follow(),
    "?": (live) => live.help(),
  };
  SHAPES.forEach((bend, i) => { KEYS[String(i + 1)] = (live) => shape(live, bend); });

  return { GRABS, HINTS, KEYS, asLongAs, join, knob, middle, retarget, showTroubles, troubles, wallPieces };
})();
