// What goes wrong at sea, and what stands in the water: troubles that are poured on chains, and the
// worlds that a reset draws. Their settings are the package's own and come in `FACTS`.
"use strict";
const Sea = (() => {
  const { worlds: WORLDS, troubles: TROUBLES, grades: GRADES, link: LINK, live: BOUNDS } = FACTS;
  const NEVER = Infinity, DT = FACTS.physics.control_step;
  const { apart, middle } = Pond;

  /** What the settings of all these troubles at a grade come to: [low, high] or a flag by path. */
  const settings = (names, grade) => Object.assign({}, ...names.map((name) => TROUBLES[name][GRADES.indexOf(grade)]));
  const drawn = (roll, range) => (range ? roll.between(...range) : 0);
  const whole = (roll, range, otherwise) => (range ? Math.round(roll.between(...range)) : otherwise);

  /** Water that flows one way, and another part that changes in time (Ornstein-Uhlenbeck). */
  class Water {
    constructor(roll, config) {
      const way = 2 * Math.PI * roll(), speed = drawn(roll, config["current.speed"]);
      this.mean = [speed * Math.cos(way), speed * Math.sin(way)];
      this.deviation = drawn(roll, config["current.wander"]);
      this.keep = Math.exp(-DT / FACTS.relaxation);
      this.now = [roll.normal() * this.deviation, roll.normal() * this.deviation];
      this.roll = roll;
    }
    get velocity() { return [0, 1].map((k) => this.mean[k] + this.now[k]); }
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

  /** Walls and posts around a start and a target (m), clear of both, as a world's settings say. */
  function obstacles(roll, config, units, target) {
    const around = { walls: [], posts: [] }, points = [...units, ...target], [start, goal] = [middle(units), middle(target)];
    const extent = units.length * LINK, way = Math.atan2(goal[1] - start[1], goal[0] - start[0]);
    const [along, across] = [[Math.cos(way), Math.sin(way)], [-Math.sin(way), Math.cos(way)]];
    if (config["obstacles.room"]) around.walls = room(roll.between(...config["obstacles.room"]) * extent, points, along, across);
    const place = () => {
      const far = roll.between(...config["obstacles.along"]) * apart(start, goal), side = roll() < 0.5 ? -1 : 1;
      const aside = side * roll.between(...config["obstacles.aside"]) * extent;
      return [0, 1].map((k) => start[k] + far * along[k] + aside * across[k]);
    };
    for (let left = whole(roll, config["obstacles.posts"], 0); left > 0; left--) {
      const radius = roll.between(...config["obstacles.post_radius"]);
      const at = Array.from({ length: BOUNDS.tries }, place).find((point) => points.every((one) => apart(one, point) > radius + LINK)
        && gap(point, around) > radius + 2 * LINK && (!around.walls.length || isOpen(start, point, { ...around, posts: [] })));
      if (at) around.posts.push([...at, radius]);
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

  return { NEVER, Senses, WORLDS, Water, equipped, gap, lets, obstacles, settings, solids, suits };
})();
