// The world of the page: chains that swim in it, and everything that a person may do to them. The
// counterpart of `salpchain/web/world.py` and `swimmer.py`; bounds and margins come in `FACTS`.
"use strict";
const Pond = (() => {
  const { live: BOUNDS, goal: GOAL, link: LINK } = FACTS;
  const TAU = 2 * Math.PI;

  /** What cannot be done, as a sentence; nothing has changed. */
  class Impossible extends Error {}

  // --- numbers ----------------------------------------------------------------------------------

  /** Random numbers in [0, 1) that follow from a seed (mulberry32). */
  function dice(seed) {
    let state = seed >>> 0;
    const next = () => {
      state = (state + 0x6d2b79f5) >>> 0;
      let t = Math.imul(state ^ (state >>> 15), 1 | state);
      t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
      return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
    };
    next.between = (low, high) => low + (high - low) * next();
    next.normal = () => Math.sqrt(-2 * Math.log(1 - next())) * Math.cos(TAU * next());
    return next;
  }

  const wrap = (angle) => angle - TAU * Math.floor((angle + Math.PI) / TAU);
  const apart = ([ax, ay], [bx, by]) => Math.hypot(ax - bx, ay - by);
  const middle = (points) => [0, 1].map((k) => points.reduce((sum, p) => sum + p[k], 0) / points.length);
  const placesOf = (one) => Array.from(one.chain.units.x, (x, i) => [x, one.chain.units.y[i]]);
  const lengthOf = (one) => one.target.length;

  // --- target poses -----------------------------------------------------------------------------

  function walked(start, bearings) {
    const points = [start];
    for (const angle of bearings) {
      const [x, y] = points[points.length - 1];
      points.push([x + LINK * Math.cos(angle), y + LINK * Math.sin(angle)]);
    }
    return points;
  }

  /** An arc or an S of chords of one link, in a random place near a chain's length away. */
  function randomTarget(roll, length, centre) {
    const whole = length * LINK, radius = Math.max(roll.between(0.2, 0.9) * whole, 0.08);
    const step = 2 * Math.asin(Math.min(LINK / (2 * radius), 1)) * (roll() < 0.5 ? -1 : 1);
    const double = roll() < 0.5, turn = TAU * roll();
    let angle = turn;
    const points = walked([0, 0], Array.from({ length: length - 1 }, (_, i) => {
      angle += double && i >= Math.floor(length / 2) ? -step : step;
      return angle;
    }));
    const way = TAU * roll(), far = 0.35 + roll.between(0.3, 0.55) * whole, [mx, my] = middle(points);
    return points.map(([x, y]) => [x - mx + centre[0] + far * Math.cos(way), y - my + centre[1] + far * Math.sin(way)]);
  }

  /** As many points as units along a drawn line (m), each one link from the one before. */
  function resampled(line, length) {
    const drawn = line.slice(1).reduce((sum, p, i) => sum + apart(p, line[i]), 0);
    if (!(drawn >= BOUNDS.shortestLine)) throw new Impossible("draw a longer line: this is hardly more than a dot");
    const points = [line[0]];
    let [bearing, at] = [null, 0];
    while (points.length < length) {
      const here = points[points.length - 1], [aim, next] = ahead(line, here, at);
      let wanted = aim ? Math.atan2(aim[1] - here[1], aim[0] - here[0]) : bearing;
      if (bearing !== null) wanted = bearing + Math.min(Math.max(wrap(wanted - bearing), -BOUNDS.sharpest), BOUNDS.sharpest);
      [bearing, at] = [wanted, next];
      points.push([here[0] + LINK * Math.cos(bearing), here[1] + LINK * Math.sin(bearing)]);
    }
    return points;
  }

  /** The first point of the line past `at` (in pieces) that is one link from here; or its end. */
  function ahead(line, here, at) {
    for (let piece = Math.floor(at); piece < line.length - 1; piece++) {
      const [a, b] = [line[piece], line[piece + 1]], low = piece === Math.floor(at) ? at - piece : 0;
      const part = crossing([a[0] - here[0], a[1] - here[1]], [b[0] - a[0], b[1] - a[1]]);
      if (part > low) return [[a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])], piece + part];
    }
    const last = line.length - 1;
    return [at < last && apart(line[last], here) > 0.2 * LINK ? line[last] : null, last];
  }

  /** Where a + part * way leaves the circle of one link around the origin; -1 nowhere on it. */
  function crossing([ax, ay], [wx, wy]) {
    const square = wx * wx + wy * wy, half = (ax * wx + ay * wy) / square;
    const part = -half + Math.sqrt(half * half - (ax * ax + ay * ay - LINK * LINK) / square);
    return part >= 0 && part <= 1 ? part : -1;
  }

  /** The points in the order in which the units have the shorter way to them. */
  function nearerWayRound(points, units) {
    const back = [...points].reverse(), sum = (some) => some.reduce((all, p, i) => all + apart(p, units[i]), 0);
    return sum(points) <= sum(back) ? points : back;
  }

  /** Whether the discrete Frechet distance of two chains of points is at most `limit` (m). */
  function within(one, other, limit) {
    const n = one.length, d = (i, j) => apart(one[i], other[j]);
    if (d(0, 0) > limit || d(n - 1, n - 1) > limit) return false;
    let open = Array(n).fill(false);
    for (let i = 0; i < n; i++) {
      const row = Array(n).fill(false);
      for (let j = 0; j < n; j++) {
        const led = i + j === 0 || open[j] || (j > 0 && (open[j - 1] || row[j - 1]));
        row[j] = led && d(i, j) <= limit;
      }
      open = row;
    }
    return open[n - 1];
  }

  // --- one chain --------------------------------------------------------------------------------

  const KEYS = ["x", "y", "a", "vx", "vy", "w"];

  /** A body's six numbers, and a chain of bodies from lists of them. */
  const body = (bodies, i) => KEYS.map((key) => bodies[key][i]);
  const bodiesOf = (b) => Array.from(b.x, (_, i) => body(b, i));
  function chainOf(units, links, rest) {
    const chain = Physics.chain(units.length);
    units.forEach((row, i) => KEYS.forEach((key, k) => { chain.units[key][i] = row[k]; }));
    links.forEach((row, i) => KEYS.forEach((key, k) => { chain.links[key][i] = row[k]; }));
    chain.rest.set(rest);
    return chain;
  }

  const partsOf = ({ chain: { units, links, rest } }) => [bodiesOf(units), bodiesOf(links), Array.from(rest)];

  /** A chain at rest along these points (m), each link between two of them; units face along it. */
  function laid(name, points, angles, target) {
    const units = points.map(([x, y], i) => [x, y, angles[i], 0, 0, 0]), links = [], rest = [];
    for (let i = 0; i + 1 < points.length; i++) {
      const [[ax, ay], [bx, by]] = [points[i], points[i + 1]];
      const angle = angles[i] + wrap(Math.atan2(by - ay, bx - ax) - angles[i]);
      links.push([(ax + bx) / 2, (ay + by) / 2, angle, 0, 0, 0]);
      rest.push(angle - angles[i], angle - angles[i + 1]);
    }
    const n = points.length;
    return aimed({
      name, chain: chainOf(units, links, rest), works: Array(n).fill(true), gain: Array(n).fill(1),
      failsAt: Array(n).fill(Infinity), thrust: new Float64Array(n), seen: null, turn: 0,
    }, target);
  }

  /** A straight chain around a point. */
  function straight(name, length, [x, y], angle, target) {
    const points = Array.from({ length }, (_, i) => {
      const way = LINK * (i - (length - 1) / 2);
      return [x + way * Math.cos(angle), y + way * Math.sin(angle)];
    });
    return laid(name, points, Array(length).fill(angle), target);
  }

  /** The chain with another target; its clock starts anew. */
  function aimed(one, target, turn = 0) {
    const units = placesOf(one), distance = target.reduce((sum, p, i) => sum + apart(p, units[i]), 0) / target.length;
    return { ...one, target, turn, since: 0, arrived: null, distance, reached: false };
  }

  function placed(one, [x, y], turn) {
    const [cx, cy] = middle(one.target), [cos, sin] = [Math.cos(turn - one.turn), Math.sin(turn - one.turn)];
    const shape = one.target.map(([u, v]) => [cos * (u - cx) - sin * (v - cy) + x, sin * (u - cx) + cos * (v - cy) + y]);
    return aimed(one, shape, turn);
  }

  function goneOn(points, count) {
    const [a, b] = points.slice(-2), size = Math.max(apart(a, b), 1e-9), [x, y] = [0, 1].map((k) => LINK * (b[k] - a[k]) / size);
    return [...points, ...Array.from({ length: count }, (_, i) => [b[0] + (i + 1) * x, b[1] + (i + 1) * y])];
  }

  /** One more unit at its end, at rest relative to its neighbour. */
  function grown(one, others, lets) {
    const places = placesOf(one), n = places.length, [before, last] = places.slice(-2);
    const bearing = Math.atan2(last[1] - before[1], last[0] - before[0]), taken = [...places.slice(0, -1), ...others];
    const angle = BOUNDS.leans.map((lean) => bearing + lean).find((way) => {
      const place = [last[0] + LINK * Math.cos(way), last[1] + LINK * Math.sin(way)];
      return taken.every((point) => apart(point, place) > BOUNDS.room) && lets([last], [place]);
    });
    if (angle === undefined) throw new Impossible("there is no room at the end of the chain: let it uncurl first");
    const [units, links, rest] = partsOf(one), unit = [...units[n - 1]], facing = unit[2] + wrap(angle - unit[2]);
    unit[0] += LINK * Math.cos(angle); unit[1] += LINK * Math.sin(angle); unit[2] = facing;
    const link = [...unit];
    link[0] = (unit[0] + last[0]) / 2; link[1] = (unit[1] + last[1]) / 2;
    return aimed({
      ...one, chain: chainOf([...units, unit], [...links, link], [...rest, 0, 0]), works: [...one.works, true],
      gain: [...one.gain, 1], failsAt: [...one.failsAt, Infinity], thrust: [...one.thrust, 0], seen: null,
    }, goneOn(one.target, 1), one.turn);
  }

  /** Units first to end (not counted), with what is theirs. */
  function part(one, first, end) {
    const [units, links, rest] = partsOf(one);
    return aimed({
      ...one, chain: chainOf(units.slice(first, end), links.slice(first, end - 1), rest.slice(2 * first, 2 * (end - 1))),
      works: one.works.slice(first, end), gain: one.gain.slice(first, end), failsAt: one.failsAt.slice(first, end),
      thrust: one.thrust.slice(first, end), seen: null,
    }, one.target.slice(first, end), one.turn);
  }

  function cut(one, link, name) {
    const n = lengthOf(one);
    if (!(link >= 0 && link < n - 1)) throw new Impossible(`the chain has links 0 to ${n - 2}, got ${link}`);
    if (Math.min(link + 1, n - link - 1) < BOUNDS.shortest) {
      throw new Impossible(`each part must keep at least ${BOUNDS.shortest} units: cut nearer the middle`);
    }
    const parts = [part(one, 0, link + 1), { ...part(one, link + 1, n), name }];
    const [a, b] = parts.map(({ target }) => middle(target)), size = Math.max(apart(a, b), 1e-9);
    return parts.map((each, k) => {
      const by = (k ? 1.5 : -1.5) * LINK / size;
      return aimed(each, each.target.map(([x, y]) => [x + by * (b[0] - a[0]), y + by * (b[1] - a[1])]), one.turn);
    });
  }

  /** The same chain counted from its other end: nothing moves. */
  function turnedRound(one) {
    const [units, links, rest] = partsOf(one), round = (row) => row.map((value, k) => (k === 2 ? value + Math.PI : value));
    return {
      ...one, chain: chainOf(units.reverse().map(round), links.reverse().map(round), rest.reverse()), seen: null,
      works: [...one.works].reverse(), gain: [...one.gain].reverse(), failsAt: [...one.failsAt].reverse(), thrust: Array.from(one.thrust, (t) => -t).reverse(),
      target: [...one.target].reverse(),
    };
  }

  /** One chain of both, linked where their ends are nearest; keeps the first one's name. */
  function joined(a, b, lets) {
    const pairs = [a, turnedRound(a)].flatMap((one) => [b, turnedRound(b)].map((other) => {
      const gap = apart(placesOf(one).at(-1), placesOf(other)[0]);
      return { one, other, gap };
    }));
    const { one, other, gap } = pairs.reduce((best, pair) => (pair.gap < best.gap ? pair : best));
    if (gap > BOUNDS.reach) {
      throw new Impossible(`the nearest ends are ${(100 * gap).toFixed(0)} cm apart: bring them within ${(100 * BOUNDS.reach).toFixed(0)} cm`);
    }
    const [units, links, rest] = partsOf(one), [more, moreLinks, moreRest] = partsOf(other);
    const [end, start] = [units.at(-1), more[0]], way = [start[0] - end[0], start[1] - end[1]];
    const hop = way.map((v) => v * (LINK / Math.max(gap, 1e-9) - 1)), moved = (row) => [row[0] + hop[0], row[1] + hop[1], ...row.slice(2)];
    const places = more.map(moved);
    if (!lets(placesOf(other), places) || !lets([end], [places[0]])) {
      throw new Impossible("a wall or a post is in the way of the joint: bring the ends elsewhere");
    }
    const angle = end[2] + wrap(Math.atan2(way[1], way[0]) - end[2]);
    const link = end.map((value, k) => (value + start[k]) / 2);
    link[0] = end[0] + (way[0] + hop[0]) / 2; link[1] = end[1] + (way[1] + hop[1]) / 2; link[2] = angle; link[5] = 0;
    const sides = [angle - end[2], angle - start[2]];
    return aimed({
      ...one, chain: chainOf([...units, ...places], [...links, link, ...moreLinks.map(moved)], [...rest, ...sides, ...moreRest]),
      works: [...one.works, ...other.works], gain: [...one.gain, ...other.gain], failsAt: [...one.failsAt, ...other.failsAt],
      thrust: [...one.thrust, ...other.thrust], seen: null,
    }, goneOn(one.target, lengthOf(other)), one.turn);
  }

  return {
    GOAL, Impossible, KEYS, aimed, apart, cut, dice, grown, joined, laid, lengthOf, middle, nearerWayRound, part, placed,
    placesOf, randomTarget, resampled, straight, turnedRound, within, wrap,
  };
})();
