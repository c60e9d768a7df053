// What goes wrong at sea, and what stands in the water: troubles that are poured on chains, and the
// worlds that a reset draws. Their settings are the package's own and come in `FACTS`.
"use strict";
const Sea = (() => {
  const { worlds: WORLDS, troubles: TROUBLES, grades: GRADES, link: LINK, live: BOUNDS } = FACTS;
  const GRID = 0.5, CELLS = 24, SLOWEST = 1e-4; // m, points each way, m/s, of the water that is drawn
  const NEVER = Infinity, DT = FACTS.physics.control_step;
  const { apart, middle } = Pond;

  /** What the settings of all these troubles at a grade come to: [low, high] or a flag by path. */
  const settings = (names, grade) => Object.assign({}, ...names.map((name) => TROUBLES[name][GRADES.indexOf(grade)]));
  const drawn = (roll, range) => (range ? roll.between(...range) : 0);
  const whole = (roll, range, otherwise) => (range ? Math.floor(roll.between(range[0], range[1] + 1)) : otherwise);
  const eitherSide = (roll, range) => (roll() < 0.5 ? -1 : 1) * roll.between(...range);
  const aim = (angle, size = 1) => [size * Math.cos(angle), size * Math.sin(angle)];

  // --- the water ----------------------------------------------------------------------------------

  /** How strong each of the dynamics is, of the usual. */
  const scale = (roll, config) => Object.fromEntries(["mass", "drag", "stiffness"].map((name) => {
    const range = config[`dynamics.${name}`];
    return [name, range ? roll.between(...range) : 1];
  }));

  /** Whether the water of such settings moves. */
  const flows = (config) => ["speed", "shear", "vortex", "wander"].some((name) => config[`current.${name}`]);

  /** A current along an angle (rad) whose speed grows across it at a rate (1/s). */
  function shear(rate, angle) {
    const [x1, y1] = aim(angle);
    return (x, y) => {
      const speed = rate * (y * x1 - x * y1);
      return [speed * x1, speed * y1, -rate / 2];
    };
  }

  /** A Lamb-Oseen vortex, fastest (m/s) on a ring of this radius (m) round its centre. */
  function vortex(speed, radius, [cx, cy]) {
    const { lambOseen: SHAPE } = FACTS, size = (1 + 1 / (2 * SHAPE)) * speed / radius;
    return (x, y) => {
      const [dx, dy] = [x - cx, y - cy], square = (dx * dx + dy * dy) / radius ** 2, decay = Math.exp(-SHAPE * square);
      const turns = square < 1e-6 ? SHAPE : (1 - decay) / square;
      return [-size * turns * dy, size * turns * dx, size * SHAPE * decay];
    };
  }

  /** Water that flows one way, by place, and by a part that changes in time (Ornstein-Uhlenbeck). */
  class Water {
    constructor(roll, config, extent) {
      const has = (name) => drawn(roll, config[`current.${name}`]), parts = [];
      this.mean = aim(2 * Math.PI * roll(), has("speed"));
      this.deviation = has("wander");
      this.now = [roll.normal() * this.deviation, roll.normal() * this.deviation];
      this.keep = Math.exp(-DT / has("relaxation"));
      if (config["current.shear"]) parts.push(shear(has("shear"), 2 * Math.PI * roll()));
      if (config["current.vortex"]) {
        const turn = roll() < 0.5 ? -1 : 1, centre = aim(2 * Math.PI * roll(), extent * roll.between(0.5, 1.5));
        parts.push(vortex(turn * has("vortex"), has("vortex_radius"), centre));
      }
      Object.assign(this, { roll, parts });
    }
    /** Velocity (m/s) and spin (rad/s) at a point (m). */
    at(x, y) {
      const sum = [this.mean[0] + this.now[0], this.mean[1] + this.now[1], 0];
      for (const part of this.parts) part(x, y).forEach((value, k) => { sum[k] += value; });
      return sum;
    }
    /** What a page draws of it around these points: velocities on a grid, or one; none if it is slow. */
    seen(points) {
      const [low, high] = this.parts.length ? [Math.min, Math.max].map((most, k) => [0, 1].map((axis) => (
        GRID * (Math.round(most(...points.map((point) => point[axis])) / GRID) + (k ? 2 : -2))))) : [[0, 0], [1, 1]];
      const count = this.parts.length ? CELLS : 1, along = (axis, i) => low[axis] + (high[axis] - low[axis]) * i / Math.max(count - 1, 1);
      const rows = Array.from({ length: count * count }, (_, i) => this.at(along(0, i % count), along(1, Math.floor(i / count))).slice(0, 2));
      const speed = Math.max(...rows.flat().map(Math.abs)), flow = Int8Array.from(rows.flat(), (v) => Math.round(v / speed * 127));
      return speed > SLOWEST ? { shape: [1, count, count], area: [low, high], speed, flow: Recorder.base64(flow) } : null;
    }
    advance() {
      const share = this.deviation * Math.sqrt(1 - this.keep ** 2);
      this.now = this.now.map((value) => value * this.keep + share * this.roll.normal());
    }
  }

  /** The chain with the thrusters of such settings, which may fail from a control step on. */
  function equipped(roll, one, config, time) {
    const n = one.works.length, order = Array.from({ length: n }, (_, i) => [roll(), i]).sort(([a], [b]) => a - b).map(([, i]) => i);
    const dead = Math.round(drawn(roll, config["thrusters.dead"]) * n), failing = Math.round(drawn(roll, config["thrusters.failing"]) * n);
    const works = Array(n).fill(true), failsAt = Array(n).fill(NEVER);
    order.slice(0, dead).forEach((i) => { works[i] = false; });
    order.slice(dead, dead + failing).forEach((i) => { failsAt[i] = time + Math.floor(roll.between(0, BOUNDS.limit)); });
    const gain = Array.from({ length: n }, () => (config["thrusters.gain"] ? drawn(roll, config["thrusters.gain"]) : 1));
    return { ...one, works, failsAt, gain };
  }

  /** Faulty sensors and late commands of all chains; they remember by the chain's name. */
  class Senses {
    constructor(roll, config) {
      const path = (name) => config[`sensing.${name}`];
      Object.assign(this, {
        roll, position: drawn(roll, path("position")), angle: drawn(roll, path("angle")),
        delay: whole(roll, path("delay"), 0), late: whole(roll, path("action_delay"), 0), repeat: whole(roll, path("repeat"), 1),
        faults: ["dropped", "stuck"].map((name) => ({ name, often: drawn(roll, path(name)), steps: whole(roll, path(`${name}_steps`), 1) })),
        known: new Map(),
      });
      this.faulty = this.position || this.angle || this.delay || this.faults.some(({ often }) => often);
    }
    memory(one) {
      const there = this.known.get(one.name);
      if (there?.n === one.works.length) return there;
      const made = { n: one.works.length, readings: [], told: null, asked: [], left: { dropped: [], stuck: [] } };
      this.known.set(one.name, made);
      return made;
    }
    /** Rows of a chain's units as its sensors tell them; `silent` units tell nothing at all. */
    tell(one) {
      const { units } = one.chain, memory = this.memory(one), { roll } = this;
      if (!this.faulty) return { rows: units, silent: [] };
      const noise = { x: this.position, y: this.position, a: this.angle, vx: this.position, vy: this.position, w: this.angle };
      const reading = Object.fromEntries(Pond.KEYS.map((key) => [key, units[key].map((value) => value + noise[key] * roll.normal())]));
      memory.readings = [reading, ...memory.readings].slice(0, this.delay + 1);
      const late = memory.readings.at(-1), told = Object.fromEntries(Pond.KEYS.map((key) => [key, late[key].slice()]));
      const silent = this.strike(memory);
      for (let i = 0; i < memory.n; i++) {
        if (memory.told && (memory.left.stuck[i] || memory.left.dropped[i])) Pond.KEYS.forEach((key) => { told[key][i] = memory.told[key][i]; });
      }
      memory.told = told;
      return { rows: told, silent };
    }
    strike({ n, left }) {
      for (const { name, often, steps } of this.faults) {
        left[name] = Array.from({ length: n }, (_, i) => (left[name][i] > 1 ? left[name][i] - 1 : often && this.roll() < often ? steps : 0));
      }
      return left.dropped.map((steps) => steps > 0);
    }
    /** The thrusts that act, where these were asked for. */
    given(one, asked, time) {
      const memory = this.memory(one);
      const held = time % this.repeat && memory.asked.length ? memory.asked[0] : Array.from(asked);
      memory.asked = [held, ...memory.asked].slice(0, this.late + 1);
      return memory.asked[this.late] ?? Array(memory.n).fill(0); // at first there is no thrust
    }
  }

  // --- walls and posts --------------------------------------------------------------------------


  /** How far a point is from the nearest surface (m): below zero inside, infinite if none. */
  function gap([x, y], { walls, posts }) {
    let least = Infinity;
    for (const [ax, ay, bx, by, width] of walls) {
      const size = Math.hypot(bx - ax, by - ay) / 2, [ux, uy] = [(bx - ax) / (2 * size), (by - ay) / (2 * size)];
      const [dx, dy] = [x - (ax + bx) / 2, y - (ay + by) / 2];
      const [u, v] = [Math.abs(dx * ux + dy * uy) - size, Math.abs(dy * ux - dx * uy) - width / 2];
      least = Math.min(least, Math.hypot(Math.max(u, 0), Math.max(v, 0)) + Math.min(Math.max(u, v), 0));
    }
    for (const [px, py, radius] of posts) least = Math.min(least, Math.hypot(x - px, y - py) - radius);
    return least;
  }

  /** Whether no surface lies across the straight way between two points. */
  function isOpen(begin, end, around) {
    const count = 2 + Math.floor(apart(begin, end) / BOUNDS.grain);
    return Array.from({ length: count }, (_, k) => k / (count - 1)).every((part) => (
      gap(begin.map((value, axis) => value + part * (end[axis] - value)), around) > 0));
  }

  /** Whether units can go straight from these points to those, and stand there. */
  const lets = (around) => (begin, end) => begin.every((from, i) => (
    gap(end[i], around) >= Math.min(BOUNDS.clear, gap(from, around) - 1e-6) && isOpen(from, end[i], around)));

  const suits = (target, units, around) => target.every((point) => gap(point, around) > LINK)
    && isOpen(middle(units), middle(target), around);

  // Pieces of wall and posts are alike: a middle line between two ends (of a post one point), and a rim.

  /** How far a point is from the line between two others (m). */
  function toLine([x, y], [[ax, ay], [bx, by]]) {
    const [wx, wy] = [bx - ax, by - ay], part = ((x - ax) * wx + (y - ay) * wy) / Math.max(wx * wx + wy * wy, 1e-12);
    const along = Math.min(Math.max(part, 0), 1);
    return Math.hypot(x - ax - along * wx, y - ay - along * wy);
  }

  /** How far two lines between ends are from each other (m). */
  function linesApart(one, other) {
    const side = ([[ax, ay], [bx, by]], [x, y]) => Math.sign((bx - ax) * (y - ay) - (by - ay) * (x - ax));
    const cross = (a, b) => side(a, b[0]) * side(a, b[1]) < 0;
    if (cross(one, other) && cross(other, one)) return 0;
    return Math.min(...one.map((end) => toLine(end, other)), ...other.map((end) => toLine(end, one)));
  }

  /** Walls and posts around a start and a target (m), clear of both, as a world's settings say. */
  function obstacles(roll, config, units, target) {
    const around = { walls: [], posts: [] }, points = [...units, ...target], [start, goal] = [middle(units), middle(target)];
    const extent = units.length * LINK, way = Math.atan2(goal[1] - start[1], goal[0] - start[0]);
    const [along, across] = [[Math.cos(way), Math.sin(way)], [-Math.sin(way), Math.cos(way)]];
    if (config["obstacles.room"]) around.walls = room(roll.between(...config["obstacles.room"]) * extent, points, along, across);
    const sides = around.walls.map(([ax, ay, bx, by]) => [[ax, ay], [bx, by]]), pieces = [];
    const placed = (size, rim) => Array.from({ length: BOUNDS.tries }, () => {
      const far = roll.between(...config["obstacles.along"]) * apart(start, goal), aside = eitherSide(roll, config["obstacles.aside"]) * extent;
      const turn = way + (size ? eitherSide(roll, config["obstacles.wall_angle"]) : 0);
      const [x, y] = [0, 1].map((k) => start[k] + far * along[k] + aside * across[k]), [u, v] = aim(turn, size / 2);
      return { line: [[x - u, y - v], [x + u, y + v]], middle: [x, y], rim };
    }).find(({ line, middle: at }) => points.every((point) => toLine(point, line) > rim + LINK)
      && sides.every((wall) => linesApart(line, wall) > rim + BOUNDS.wall / Math.SQRT2 + 2 * LINK && linesApart([start, at], wall) > 0)
      && pieces.every((piece) => linesApart(line, piece.line) > rim + piece.rim + 2 * LINK));
    const add = (size, rim) => {
      const found = placed(size, rim);
      if (found) pieces.push(found);
      return found;
    };
    for (let left = whole(roll, config["obstacles.walls"], 0); left > 0; left--) {
      const found = add(extent * roll.between(...config["obstacles.wall_length"]), BOUNDS.wall / Math.SQRT2);
      if (found) around.walls.push([...found.line.flat(), BOUNDS.wall]);
    }
    for (let left = whole(roll, config["obstacles.posts"], 0); left > 0; left--) {
      const found = add(0, roll.between(...config["obstacles.post_radius"]));
      if (found) around.posts.push([...found.middle, found.rim]);
    }
    return around;
  }

  /** Four walls along the way and across it, this far (m) from all points. */
  function room(free, points, along, across) {
    const width = BOUNDS.wall, size = [along, across].map((axis) => {
      const all = points.map(([x, y]) => x * axis[0] + y * axis[1]);
      return [Math.min(...all) - Math.max(free, BOUNDS.narrowest) - width / 2, Math.max(...all) + Math.max(free, BOUNDS.narrowest) + width / 2];
    });
    const [[left, right], [low, top]] = size, at = (u, v) => [0, 1].map((k) => u * along[k] + v * across[k]);
    return [
      ...[low, top].map((v) => [...at(left - width / 2, v), ...at(right + width / 2, v), width]),
      ...[left, right].map((u) => [...at(u, low - width / 2), ...at(u, top + width / 2), width]),
    ];
  }

  const solids = ({ walls, posts }) => [...walls.map(Physics.wall), ...posts.map(Physics.post)];

  return { NEVER, Senses, WORLDS, Water, equipped, flows, gap, lets, obstacles, scale, settings, shear, solids, suits, vortex };
})();
